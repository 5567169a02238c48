"""What nodes may do is written down without patterns; what comes in files is never executed."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable

import pytest
from recording_samples import wave
from support import CONFIG, REPOSITORY, syntax

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.recording import BagReader
from dvrk_gravity.ros import COMMANDS, UNHEARD

POLICIES = [CONFIG / "security" / f"{arm}.policy.xml" for arm in ("mtml", "mtmr")]
ARRAY = CONFIG / "security" / "effort_controller.policy.xml"


def test_the_policies_of_both_arms_differ_in_nothing_but_the_name():
    left, right = (path.read_text(encoding="utf-8") for path in POLICIES)
    assert left.replace("MTML", "MTMR") == right


def test_no_policy_allows_a_pattern():
    for path in (*POLICIES, ARRAY):
        for item in ElementTree.parse(path).getroot().iter():
            assert not set(item.text or "") & set("*?[")


FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "system", "popen", "literal_eval"}
FORBIDDEN_MODULES = {"pickle", "cPickle", "shelve", "marshal", "dill", "joblib"}


def suspicious(nodes: Iterable[ast.AST]) -> list[str]:
    """Return what in a module could execute what a file holds."""
    found = []
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] + [getattr(node, "module", None) or ""]
            found += [name for name in names if name.split(".")[0] in FORBIDDEN_MODULES]
        if isinstance(node, ast.Call):
            called = node.func
            owner = called.value.id if (
                isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name)
            ) else ""  # fmt: skip
            name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
            risky = [
                word for word in node.keywords if word.arg in ("Loader", "allow_pickle", "shell")
            ]
            given = {word.arg: ast.unparse(word.value) for word in risky}
            if name in FORBIDDEN_CALLS and owner != "re":
                found.append(name)
            if owner == "yaml" and "load" in name and given.get("Loader") != "_Loader":
                found.append(f"yaml.{name}")
            if given.get("allow_pickle", "False") != "False" or given.get("shell") == "True":
                found.append(ast.unparse(node))
    return found


def test_no_module_executes_what_a_file_holds():
    found = {path: suspicious(syntax(path)) for path in (REPOSITORY / "dvrk_gravity").rglob("*.py")}
    assert found
    assert not {path: calls for path, calls in found.items() if calls}


def test_the_search_finds_what_it_looks_for():
    for line in (
        "eval(text)", "import pickle", "from pickle import load", "yaml.load(text)", "os.system(x)",
        "yaml.load(text, Loader=yaml.Loader)", "np.load(f, allow_pickle=True)",
        "subprocess.run(x, shell=True)", "builtins.exec(x)",
    ):  # fmt: skip
        assert suspicious(ast.walk(ast.parse(line))), line


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


def test_nothing_but_the_arm_s_link_publishes_a_motion_command():
    commands = {name for name, _ in COMMANDS} | {*UNHEARD}
    package = REPOSITORY / "dvrk_gravity"
    found = []
    for path in sorted(package.rglob("*.py")):
        for node in syntax(path):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
                continue
            if node.func.attr != "create_publisher":
                continue
            where, topic = str(path.relative_to(package)), node.args[1]
            if isinstance(topic, ast.Constant):
                assert topic.value not in commands, f"{where} publishes {topic.value}"
            elif not (isinstance(topic, ast.Name) and topic.id == "TIMEOUT_TOPIC"):
                assert where in ELSEWHERE, f"{where} publishes {ast.unparse(topic)}"
                found.append(where)
    assert {*found} == {*ELSEWHERE}
