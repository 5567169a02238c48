"""What nodes may do is written down without patterns; what comes in files is never executed."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ElementTree

import pytest
from recording_samples import wave
from support import CONFIG, REPOSITORY, syntax

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.recording import BagReader
from dvrk_gravity.ros import COMMANDS, UNREADABLE

POLICIES = [CONFIG / "security" / f"{arm}.policy.xml" for arm in ("mtml", "mtmr")]
ARRAY = CONFIG / "security" / "effort_controller.policy.xml"


def test_the_policies_of_both_arms_differ_in_nothing_but_the_name():
    left, right = (path.read_text(encoding="utf-8") for path in POLICIES)
    assert left.replace("MTML", "MTMR") == right


def test_no_policy_allows_a_pattern():
    for path in (*POLICIES, ARRAY):
        for item in ElementTree.parse(path).getroot().iter():
            assert not set(item.text or "") & set("*?[")


def test_a_file_that_asks_for_an_object_of_python_is_refused(tmp_path):
    path = tmp_path / "arm.yaml"
    for tag in ("object/apply:os.system ['true']", "name:os.system", "tuple [1, 2]"):
        path.write_text(f"name: !!python/{tag}\njoints: []\n")
        with pytest.raises(ConfigError, match=r"arm\.yaml"):
            Arm.load(str(path))


def test_an_arm_s_name_does_not_lead_out_of_the_package_s_files(tmp_path, monkeypatch):
    inside = tmp_path / "share" / "dvrk_gravity" / "config" / "arms"
    inside.mkdir(parents=True)
    source = (CONFIG / "arms" / "mtmr.yaml").read_bytes()
    (inside / "mine.yaml").write_bytes(source)
    (tmp_path / "share" / "outside.yaml").write_bytes(source)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert Arm.load("mine").name == "mtmr"
    for name in ("../../../outside", str(tmp_path / "share" / "outside"), "mtmr\0", ""):
        with pytest.raises(ConfigError):
            Arm.load(name)


def test_a_bag_s_metadata_does_not_lead_out_of_its_folder(tmp_path):
    wave(50).save(tmp_path / "bag")
    (data,) = (tmp_path / "bag").glob("*.db3")
    data.rename(tmp_path / "elsewhere.db3")
    metadata = tmp_path / "bag" / "metadata.yaml"
    text = metadata.read_text(encoding="utf-8")
    for path in ("../elsewhere.db3", str(tmp_path / "elsewhere.db3")):
        metadata.write_text(text.replace(data.name, path), encoding="utf-8")
        with pytest.raises(RecordingError), BagReader(tmp_path / "bag"):
            pass


# What may publish, and what: commands go through the arm's link, holds through what repeats them.
ELSEWHERE = {
    "ros/arm_link.py": "the commands",
    "ros/hold.py": "hold, until it has arrived",
    "ros/simulator_node.py": "what an arm measures",
    "cli/replay.py": "what a bag has measured, to a node of its own",
}


OF_WATCHDOG = ("WATCHDOG_TOPIC", "TIMEOUT_TOPIC")


def test_nothing_but_the_arm_s_link_publishes_a_motion_command():
    commands = {name for name, _ in COMMANDS} | {*UNREADABLE}
    package = REPOSITORY / "dvrk_gravity"
    found = []
    paths = [path for path in package.rglob("*.py") if "create_publisher" in path.read_text()]
    for path in sorted(paths):
        for node in syntax(path):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
                continue
            if node.func.attr != "create_publisher":
                continue
            where, topic = str(path.relative_to(package)), node.args[1]
            if isinstance(topic, ast.Constant):
                assert topic.value not in commands, f"{where} publishes {topic.value}"
            elif not (isinstance(topic, ast.Name) and topic.id in OF_WATCHDOG):
                assert where in ELSEWHERE, f"{where} publishes {ast.unparse(topic)}"
                found.append(where)
    assert {*found} == {*ELSEWHERE}
