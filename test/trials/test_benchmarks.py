"""Benchmarks: no threshold is forgotten by `make sensitivity`; `make peers` without the peers."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from dataclasses import is_dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support import REPOSITORY

import dvrk_gravity.diagnosis
import dvrk_gravity.estimation
import dvrk_gravity.identification
import dvrk_gravity.recording
from testing import mujoco_arms
from testing.lab_motion import draw_calibration

sys.path.insert(0, str(REPOSITORY / "benchmark"))
sys.path.insert(0, str(REPOSITORY / "benchmark" / "peers"))
import least_squares
import sensitivity
from exchange import Case, changed
from forward import ForwardWorld
from outcome import METHODS, US, Outcome, Row
from page import SECTIONS, better, page
from run import SCRIPTS, user_lines
from urdfs import write

ROOMS = (
    dvrk_gravity.diagnosis, dvrk_gravity.estimation, dvrk_gravity.identification,
    dvrk_gravity.recording,
)  # fmt: skip
# How a search goes on is given by who searches, and among their settings.
GIVEN = {"SearchSettings"}


def test_every_threshold_is_among_those_that_are_halved_and_doubled():
    found = set()
    for room in ROOMS:
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            for name, value in vars(importlib.import_module(module.name)).items():
                known = name.endswith("Settings") and is_dataclass(value) and name not in GIVEN
                if known and value.__module__ == module.name:
                    found.add(value)
    assert found == {settings for settings, _ in sensitivity.CLASSES}


def kind_of(name: str) -> int:
    return [settings.__name__ for settings, _ in sensitivity.CLASSES].index(name)


def test_a_threshold_that_is_changed_is_changed_only_for_a_while():
    kind, _ = sensitivity.CLASSES[kind_of("FilterSettings")]
    with sensitivity.changed(kind, "band", 2.0):
        assert kind().band == 16.0
        assert kind(band=3.0).band == 3.0
    with sensitivity.changed(kind, "blocks.duration", 0.5):
        assert kind().blocks.duration == 0.25
    assert kind().band == 8.0


def test_a_threshold_that_matters_moves_what_is_found():
    number = kind_of("TimingSettings")
    _, before = sensitivity.solve(number, None, 1.0)
    value, after = sensitivity.solve(number, "gap", 2.0)
    assert value == "7.0"
    assert sensitivity.moved(before, after)
    assert sensitivity.moved(before, before) == []


# --- beside other packages --------------------------------------------------------------------

LINES = dict.fromkeys(METHODS, 10)
GOOD = Outcome([0.1, 0.2], 0.1, 0.1, 1.0, 0.2, (95, 100, 100), (2, 2),
               diagnoses=[{"cpu": 1.0, "found": [{"effect": "payload", "joint": "b"}]},
                          {"cpu": 1.0, "found": []}])  # fmt: skip
BAD = Outcome([0.2, 0.3], 0.2, 0.2, 9.0, 0.9, (50, 100, 120), (0, 2),
              diagnoses=[{"cpu": 9.0, "found": []},
                         {"cpu": 9.0, "found": [{"effect": "payload", "joint": "a"}]}])  # fmt: skip


def row(ours: Outcome, peers: Outcome) -> Row:
    outcomes = {method: ours if method == US else peers for method in METHODS}
    return Row("arm", "an arm", ["a", "b"], [("payload", "b"), ("nothing", "")], outcomes)


@pytest.fixture(scope="module")
def ur5(tmp_path_factory) -> Case:
    folder = tmp_path_factory.mktemp("ur5")
    arm = mujoco_arms.arm_of("ur5")
    assert write(arm, folder / "arm.urdf") == ""
    return Case(folder, list(arm.joint_names), arm.source, f"{folder / 'arm.urdf'}",
                arm.effort_limit.tolist(), 100.0)  # fmt: skip


def test_the_first_table_sums_up_all_cases():
    text = page([row(GOOD, BAD), replace(row(GOOD, BAD), name="arm_four_minutes")], LINES, [], "")
    first = text[text.index(f"## {SECTIONS[0]}") : text.index(f"## {SECTIONS[1]}")]
    for line in (
        "| joints with the smallest error | 4 of 4 | 0 of 4 |",
        "| 95 % intervals that hold the truth | 95 % of 200 | 50 % of 200, 40 infinite |",
        "| links that a body can have | 4 of 4 | 0 of 4 |",
        "| hidden effects named first | 2 of 2 | 0 of 2 |",
        "| false alarms where nothing is hidden | 0 of 2 | 2 of 2 |",
        "| identification of four minutes at 1 kHz | 1.0 s, 0.20 GiB | 9.0 s, 0.90 GiB |",
    ):
        assert line in first


def test_nothing_is_called_better_that_is_worse_or_the_same():
    assert better([row(GOOD, BAD)], LINES) == []
    assert better([row(GOOD, GOOD)], LINES) == []


def test_least_squares_recovers_the_links_of_a_known_arm(ur5):
    model = pin.buildModelFromUrdf(ur5.urdf)
    data, random = model.createData(), np.random.default_rng(1)
    time = np.arange(0.0, 15.0, 0.01)
    q, qd, qdd = draw_calibration(mujoco_arms.arm_of("ur5"), 1).at(time)
    viscous = np.array([3.0, 3.0, 2.0, 0.5, 0.5, 0.5])
    effort = np.array([pin.rnea(model, data, *s) for s in zip(q, qd, qdd, strict=True)])
    effort += viscous * qd + 0.01 * random.standard_normal(q.shape)
    header = ["time", *(f"{j}.position" for j in ur5.joints), *(f"{j}.effort" for j in ur5.joints)]
    np.savetxt(ur5.folder / "train.csv", np.column_stack([time, q, effort]), delimiter=",",
               header=",".join(header), comments="")  # fmt: skip
    fitted = least_squares.fit(ur5, "train.csv")
    left = (fitted.predict(q, qd, qdd) - effort)[100:-100]
    assert np.sqrt(np.mean(left**2, axis=0)) == pytest.approx(0.01, abs=0.03)
    values = {p.name: p.value for p in fitted.parameters}
    found = [values[f"fv_{joint}"] for joint in ur5.joints]
    assert found == pytest.approx(viscous, abs=0.1)
    assert np.abs(changed(fitted, fitted)).size == 0


def test_mujoco_moves_an_arm_by_the_friction_and_rotors_that_are_its_own(ur5):
    world = ForwardWorld.draw("ur5", "friction", 3, Path(ur5.urdf).read_text())
    truth = world.truth(draw_calibration(world.arm, 3), 0.0, 2.0, 0.0)
    viscous, dry, rotors = world.parameters
    _, qd, qdd = truth.motion
    sure = np.abs(qd) > 0.1  # elsewhere MuJoCo's soft friction creeps
    expected = world.rigid.torque(*truth.motion) + viscous * qd + dry * np.sign(qd) + rotors * qdd
    left = np.where(sure, truth.effort - expected, 0.0)[500:]
    assert np.sqrt(np.mean(left**2, axis=0)) == pytest.approx(0.0, abs=0.05 * dry.max())
    assert sure.mean() > 0.3


def test_a_user_s_lines_are_counted_in_every_method():
    counts = {method: user_lines(script) for method, script in SCRIPTS.items()}
    assert 0 < counts[US] < 10
    assert all(20 < counts[method] < 120 for method in METHODS[1:])
