"""One's own arm from its recordings to a model: known loads, its own unit, joints not recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

import fitted
import numpy as np
import pytest
from fitted import FEW
from robots import PANDA, UR5

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel

GAINS = np.array([12.0, 14.0, 11.0, 9.0, 10.5, 8.5])  # N·m/A
MASS, COM = 2.0, (0.02, 0.05, 0.08)  # kg, m in the last link's frame
HAND, FINGER = f"{PANDA}#panda_hand", "panda_finger_joint1"


@dataclass(frozen=True)
class Lab:
    """Where a UR5's recordings in amperes are, without a load and with one."""

    folder: Path


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Lab:
    folder = tmp_path_factory.mktemp("lab")
    world = fitted.world_of(Arm.load(UR5))
    carrying = world.with_payload(world.arm.body_names[-1], MASS, COM)
    for name, each in (("currents", world), ("loaded", carrying)):
        recording = each.record(1, 20.0)
        read = replace(recording, effort=recording.effort / GAINS, arm=None)
        read.save(folder / f"{name}.csv")
    return Lab(folder)


def run(*words: object) -> int:
    return main([str(word) for word in words])


def test_identify_with_a_known_load_writes_a_model_of_the_arm_without_it(lab, tmp_path, capsys):
    out, files = tmp_path / "model.yaml", [lab.folder / f"{x}.csv" for x in ("currents", "loaded")]
    options = ("--known-payload", MASS, "--terms", ",".join(FEW), "--no-physical")
    assert run("identify", *files, "--arm", UR5, "--out", out, *options) == 0
    bare = evaluate(TorqueModel.load(out), [files[0]], "joint").joints
    assert max(error.nrmse for error in bare.values()) < 0.15


def test_without_gains_a_model_is_in_its_recording_s_unit_until_one_is_stated(
    lab, tmp_path, capsys
):
    out, data = tmp_path / "model.yaml", lab.folder / "currents.csv"
    fit = identify(data, UR5, effects=FEW, physical=False)
    units = {parameter.unit for parameter in fit.parameters}
    assert units.isdisjoint({"N·m", "kg", "kg·m", "kg·m^2", "N"})
    fit.model.save(out)
    assert TorqueModel.load(out).arm.effort_units == ("a.u.",) * 6
    assert run("evaluate", data, "--model", out) == 1  # it is not to be compensated with
    shown = capsys.readouterr().out
    assert "RMSE a.u." in shown
    assert "N·m" not in shown
    assert run("evaluate", data, "--model", out, "--drive-gains", "1,2,3,4,5,6") == 2
    assert "the model is in a.u." in capsys.readouterr().err
    stated, options = tmp_path / "stated.yaml", ("--effort-unit", "N·m", "--no-physical")
    words = ("identify", data, "--arm", UR5, "--terms", "viscous_friction", "--out", stated)
    assert run(*words, *options) in (0, 1)  # whatever the verdict on it
    assert TorqueModel.load(stated).arm.effort_units == ("N·m",) * 6


@pytest.fixture(scope="module")
def without_fingers(tmp_path_factory) -> Path:
    """A Panda's seven joints, of an arm that has eight."""
    path = tmp_path_factory.mktemp("panda") / "seven.csv"
    replace(fitted.ur5_motion(file=HAND), arm=None).save(path)
    return path


def without_joint(path: Path, joint: str) -> Path:
    """Write a recording without one of its joints."""
    header, *rows = path.read_text().split()
    kept = [not name.startswith(f"{joint}.") for name in header.split(",")]
    text = [",".join(compress(row.split(","), kept)) for row in (header, *rows)]
    left = path.parent / f"without_{joint}.csv"
    left.write_text("\n".join(text))
    return left


def test_joints_beyond_those_recorded_are_held_where_it_is_said_and_need_not_be_judged(
    without_fingers, tmp_path
):
    fit = identify(without_fingers, PANDA, effects=["viscous_friction"], physical=False)
    fit.model.save(tmp_path / "model.yaml")
    assert TorqueModel.load(tmp_path / "model.yaml").arm.held == {FINGER: 0.0}
    six = without_joint(without_fingers, "panda_joint7")
    still, effects = {FINGER: 0.02}, ["viscous_friction"]
    fit = identify(six, PANDA, effects=effects, still=still, physical=False)
    assert fit.model.arm.held == {"panda_joint7": 0.0, **still}
    whole = Arm.load(PANDA)
    found = evaluate(TorqueModel(whole, ()), [without_fingers], "joint")
    assert list(found.joints) == list(whole.joint_names[:7])


def test_a_joint_that_carries_the_recorded_ones_has_to_be_recorded(without_fingers):
    six = without_joint(without_fingers, "panda_joint2")
    with pytest.raises(RecordingError, match="has no panda_joint2, panda_finger_joint1"):
        identify(six, PANDA)
