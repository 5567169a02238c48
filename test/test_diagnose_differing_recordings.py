"""Recordings that contradict each other are told so, and what each of them says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.report import evaluation_text
from testing.lab_effects import payload
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

pytestmark = pytest.mark.usefixtures("brief_simulation")

MASS, CENTRE = 1.2, np.array([0.0, 0.02, 0.08])  # kg, m
DURATION = 14.0  # s, of each recording


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    return MujocoWorld.draw("ur5", 5)


@pytest.fixture(scope="module")
def model(world, four_folds):
    return identify(world.record(world.truth(draw_calibration(world.arm, 5)), 5), world.arm).model


def recorded(world: MujocoWorld, seed: int, mass: float, name: str):
    return replace(_recorded(world, seed, mass), source=f"/somewhere/{name}")


@cache
def _recorded(world: MujocoWorld, seed: int, mass: float):
    motion = draw_other(world.arm, seed, draw_calibration(world.arm, 5))
    truth = world.truth(motion, DURATION)
    if mass:
        setting = world.setting(truth, np.ones(world.arm.n))
        truth = payload(setting, world.arm.n - 1, mass, CENTRE).truth
    return world.record(truth, seed)


def test_a_load_in_one_of_two_recordings_is_not_said_to_be_half_of_it_in_both(world, model):
    recordings = [recorded(world, 7, 0.0, "bare.csv"), recorded(world, 8, MASS, "loaded.csv")]

    diagnosis = diagnose(recordings, model)

    (found,) = diagnosis.findings
    assert diagnosis.verdict == "partly_explained"
    assert "recordings differ about" in found.sentence
    assert "bare.csv: none of it" in found.sentence
    carried = found.sentence.split("loaded.csv: wrist_3_joint's link carries ")[1].split()[0]
    assert float(carried) == pytest.approx(MASS, rel=0.01)
    assert found.remedy == "diagnose each recording alone"
    assert found.left_out == "the recordings differ about it"
    assert not any(name.startswith("payload.") for name in diagnosis.model.parameters())


def test_a_load_in_both_is_one_load(world, model):
    recordings = [recorded(world, 7, MASS, "a.csv"), recorded(world, 8, MASS, "b.csv")]

    (found,) = diagnose(recordings, model).findings

    assert found.parameters["mass"].value == pytest.approx(MASS, rel=0.02)
    assert "differ" not in found.sentence
    assert found.left_out == ""


def test_a_warning_says_which_of_two_recordings_it_is_about(world, model):
    whole, worse = recorded(world, 7, 0.0, "good.csv"), recorded(world, 8, 0.0, "bad.csv")
    effort = worse.effort.copy()
    effort[len(worse) // 2 :, 2] = effort[len(worse) // 2, 2]  # a drive that reports one value
    frozen = replace(worse, effort=effort)

    together = diagnose([whole, frozen], model).warnings
    evaluated = evaluate(model, [whole, frozen]).warnings
    (alone,) = evaluate(model, [frozen]).warnings

    assert str(alone).startswith("elbow_joint: ")
    assert str(together[0]) == str(evaluated[0]) == f"bad.csv: {alone}"


def test_errors_of_several_recordings_are_told_by_recording_too(world, model):
    bare, loaded = recorded(world, 7, 0.0, "bare.csv"), recorded(world, 8, MASS, "loaded.csv")

    both = evaluate(model, [bare, loaded])

    assert list(both.recordings) == ["bare.csv", "loaded.csv"]
    for recording, label in ((bare, "bare.csv"), (loaded, "loaded.csv")):
        alone = evaluate(model, [recording]).joints
        for joint, error in both.recordings[label].items():
            assert error.rmse == pytest.approx(alone[joint].rmse, rel=1e-12)
    (line,) = [text for text in evaluation_text(both, model) if text.startswith("loaded.csv: ")]
    assert "shoulder_lift_joint" in line
