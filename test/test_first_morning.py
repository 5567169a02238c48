"""What someone new types on the first morning: names in capitals, paths with blanks, --version."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from support import MODEL_FILE, REPOSITORY
from test_arms_files import a_joint, urdf

import dvrk_gravity
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.intake import require_all
from dvrk_gravity.model import TorqueModel, parts
from dvrk_gravity.recording import Recording


@pytest.mark.parametrize(
    "words", [["--version"], ["identify", "--version"], ["watchdog", "--version"]]
)
def test_the_version_is_that_of_the_package(words, capsys):
    try:
        status = main(words)
    except SystemExit as ended:
        status = ended.code
    assert (status, capsys.readouterr().out) == (0, f"dvrk_gravity {dvrk_gravity.__version__}\n")


@pytest.mark.parametrize("name", ["MTMR", "Psm", "eCm", "mtml"])
def test_the_name_of_an_arm_may_be_in_any_case_and_a_model_has_it_in_small_letters(name, tmp_path):
    arm = Arm.load(name)
    assert arm.name == name.lower()
    TorqueModel(arm, ()).save(tmp_path / "model.yaml")
    assert f"arm: {name.lower()}\n" in (tmp_path / "model.yaml").read_text()


def test_the_path_of_an_arm_stays_as_it_is_and_a_wrong_name_is_shown_as_it_was_given(tmp_path):
    path = tmp_path / "My Arm.URDF"
    urdf(tmp_path, a_joint("one", "a", "b"), links="ab").rename(path)
    assert Arm.load(path).source == str(path)
    assert Arm.file(str(path)) == path
    with pytest.raises(ConfigError, match="got 'MTMX'"):
        Arm.load("MTMX")


def branching(tmp_path) -> Arm:
    """Return a mobile robot: a wheel, and a torso with two arms of two joints."""
    joints = (
        a_joint("wheel", "a", "b"), a_joint("torso", "a", "c"),
        a_joint("left_1", "c", "d"), a_joint("left_2", "d", "e"),
        a_joint("right_1", "c", "f"), a_joint("right_2", "f", "g"),
    )  # fmt: skip
    return Arm.load(urdf(tmp_path, *joints, links="abcdefg"))


@pytest.mark.parametrize(
    ("recorded", "ends"),
    [
        (("left_1", "left_2"), ["e"]),
        (("torso", "left_1", "left_2", "right_1"), ["e", "f"]),
        (("wheel",), ["b"]),
        (("somebody_elses",), []),
    ],
)
def test_of_a_robot_with_branches_the_parts_that_were_recorded_are_named(recorded, ends, tmp_path):
    arm = branching(tmp_path)
    named = [f"{arm.source}#{end}" for end in ends]
    assert parts(arm, recorded) == named
    if ends:
        assert set(recorded) & set(Arm.load(named[0]).joint_names)
    head = Recording(recorded, np.arange(3.0), *np.zeros((3, 3, len(recorded))))
    with pytest.raises(RecordingError) as caught:
        require_all(head, arm, {})
    hint = f"or a part of the robot: --arm {' or '.join(named)}"
    assert str(caught.value).endswith(hint) == bool(ends)
    assert "\n" not in str(caught.value)


def test_a_chain_and_an_arm_that_is_a_part_have_no_parts(tmp_path):
    assert parts(Arm.load(f"{branching(tmp_path).source}#e"), ("left_1",)) == []
    assert parts(Arm.load("psm"), ("yaw",)) == []


@pytest.mark.parametrize("node", ["compensator", "watchdog", "simulator"])
def test_the_help_of_a_node_lists_its_parameters(node, capsys):
    with pytest.raises(SystemExit):
        main([node, "--help"])
    shown = capsys.readouterr().out
    listed = {
        "compensator": "  timeout (double, 0.1 s): hold the arm and stop after this long",
        "watchdog": "  watchdog_timeout (double, 0.1 s): watchdog: hold the arm after this long",
        "simulator": "  realtime_factor (double, 1): simulated seconds per second",
    }
    assert listed[node] in shown
    assert "  arm (string, mtmr): " in shown
    assert shown.rstrip().splitlines()[-1].startswith("example: ")


def test_a_help_computes_nothing(capsys):
    """Pinocchio takes longer to load than a help may take."""
    script = (
        "import sys\nfrom dvrk_gravity.__main__ import main\n"
        "try:\n    main(['compensator', '--help'])\nexcept SystemExit:\n    pass\n"
        "assert not {'pinocchio', 'rclpy', 'scipy'} & set(sys.modules)\n"
    )
    subprocess.run(
        [sys.executable, "-c", script], check=True, stdout=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip


def test_a_console_file_is_not_written_under_the_other_arm_s_name(tmp_path, capsys):
    model = tmp_path / "m.yaml"
    TorqueModel.load(MODEL_FILE).save(model)
    right, left = tmp_path / "gc-MTMR-5.json", tmp_path / "gc-MTML-5.json"
    assert main(["convert", str(model), str(left)]) == 2
    error = capsys.readouterr().err
    assert "ARM_NAME: got 'MTMR', expected MTML, as in its name, or gc-MTMR-5.json" in error
    assert not left.exists()
    assert main(["convert", str(model), str(right)]) == 0


def test_a_console_file_under_the_other_arm_s_name_is_not_read(tmp_path, capsys):
    model, right = tmp_path / "m.yaml", tmp_path / "gc-MTMR-5.json"
    TorqueModel.load(MODEL_FILE).save(model)
    assert main(["convert", str(model), str(right)]) == 0
    for name, status in (("gc-MTML-5.json", 2), ("calibration.json", 0)):
        renamed = tmp_path / name
        renamed.write_text(right.read_text())
        capsys.readouterr()
        assert main(["convert", str(renamed), str(tmp_path / f"{status}.yaml")]) == status
        assert (str(renamed) in capsys.readouterr().err) == bool(status)
    mirrored = json.loads(right.read_text()) | {"ARM_NAME": "MTML"}
    right.write_text(json.dumps(mirrored))
    assert main(["convert", str(right), str(tmp_path / "mirrored.yaml")]) == 2


@pytest.mark.parametrize(
    "arm", ["mtmr", "my arms/xarm 7.urdf", 'ro"bot $1.urdf#tool link', "a'b.yaml"]
)
def test_make_hands_a_path_on_whole(arm, tmp_path):
    """The recipe, with a Python that prints its arguments in place of the package's."""
    rules = (REPOSITORY / "Makefile").read_text().splitlines()
    (line,) = [rule for rule in rules if "-m dvrk_gravity demo" in rule]
    recipe = line.replace("$(IN_WORKSPACE) $(BIN)/python", "$(PRINTS)")
    (tmp_path / "prints").write_text("#!/bin/sh\nprintf '%s\\n' \"$@\"\n")
    (tmp_path / "prints").chmod(0o755)
    (tmp_path / "Makefile").write_text(f"demo:\n{recipe}\nARM ?= mtmr\nexport ARM\n")
    escaped = arm.replace("$", "$$")
    made = subprocess.run(
        ["make", "-s", "demo", f"ARM={escaped}", f"PRINTS={tmp_path}/prints"], cwd=tmp_path,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    words = made.stdout.splitlines()
    assert words[words.index("--arm") + 1] == arm
    name = os.path.basename(arm)
    assert words[words.index("--out") + 1] == f"out/demo/{name.rpartition('.')[0] or name}"
    assert len(words) == 7
