"""Benchmarks: no threshold is forgotten by `make sensitivity`; `make peers` without the peers."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from dataclasses import is_dataclass

import numpy as np
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
import sensitivity
from forward import ForwardWorld
from outcome import METHODS, US
from run import SCRIPTS, user_lines
from urdfs import write

ROOMS = (
    dvrk_gravity.diagnosis, dvrk_gravity.estimation, dvrk_gravity.identification,
    dvrk_gravity.recording,
)  # fmt: skip


def test_every_threshold_is_among_those_that_are_halved_and_doubled():
    found = set()
    for room in ROOMS:
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            for name, value in vars(importlib.import_module(module.name)).items():
                known = name.endswith("Settings") and is_dataclass(value)
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


def test_mujoco_moves_an_arm_by_the_friction_and_rotors_that_are_its_own(tmp_path):
    assert write(mujoco_arms.arm_of("ur5"), tmp_path / "arm.urdf") == ""
    world = ForwardWorld.draw("ur5", "friction", 3, (tmp_path / "arm.urdf").read_text())
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
