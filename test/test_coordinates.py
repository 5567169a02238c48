"""Joint or actuator coordinates: every verb decides by the same code, whatever the model."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import correct_recordings
from dvrk_gravity.effects import Gravity
from dvrk_gravity.identification import coordinates_of, evaluate
from dvrk_gravity.observation import CoordinateErrors, decide_coordinates
from dvrk_gravity.recording import Recording
from testing.world import COARSE, World

KNOWN = World.draw(5, step=COARSE)
ARM = KNOWN.arm
# As a console's file is converted: weight alone, and nothing that says how sure it is.
WEIGHT = replace(
    KNOWN.model(), terms=tuple(t for t in KNOWN.model().terms if isinstance(t, Gravity))
)


@cache
def recorded() -> Recording:
    return KNOWN.record(3, 4, 14.0, 100.0)


@cache
def of_motors() -> Recording:
    right = recorded()
    return replace(
        right,
        position=ARM.actuator_position(right.position),
        velocity=ARM.actuator_position(right.velocity),
        effort=ARM.actuator_effort(right.effort),
    )


@pytest.mark.parametrize(("recording", "truth"), [(recorded, "joint"), (of_motors, "actuator")])
def test_every_verb_reads_a_recording_in_the_same_coordinates(recording, truth):
    decision = decide_coordinates(recording(), ARM, None)
    assert decision.coordinates == truth
    assert evaluate(WEIGHT, recording()).coordinates == truth
    right = correct_recordings([recording()], WEIGHT, None, {})
    assert right.recordings[0].coordinates == truth
    assert [finding.effect for finding in right.faults] == (
        [] if truth == "joint" else ["wrong_coordinates"]
    )
    assert all(finding.p_value < 1e-3 for finding in right.faults)
    # What `identify` has found and corrected before is no news to a diagnosis.
    actuator = replace(WEIGHT, detected_coordinates="actuator")
    as_before = correct_recordings([recording()], actuator, None, {})
    assert (as_before.faults, as_before.warnings) == ((), ())
    assert as_before.recordings[0].coordinates == truth


def poses(recording: Recording) -> Recording:
    few = recording.rows(slice(None, None, 20))
    return replace(few, time=None, velocity=None)


def part(recording: Recording) -> Recording:
    return replace(
        recording, joints=recording.joints[:-1], position=recording.position[:, :-1],
        velocity=recording.velocity[:, :-1], effort=recording.effort[:, :-1],
    )  # fmt: skip


@pytest.mark.parametrize("shown", [poses, part])
@pytest.mark.parametrize(("recording", "truth"), [(recorded, "joint"), (of_motors, "actuator")])
def test_where_no_plain_model_can_be_fitted_the_model_at_hand_decides_in_every_verb(
    shown, recording, truth
):
    seen = shown(recording())
    model, still = KNOWN.model(), {ARM.joint_names[-1]: 0.0}
    decision = coordinates_of(model, [seen], None, {} if shown is poses else still)
    assert decision.coordinates == truth
    if shown is poses:
        assert evaluate(model, seen).coordinates == truth
    right = correct_recordings([seen], model, None, still)
    assert right.recordings[0].coordinates == truth
    assert right.faults == ()
    assert len(right.warnings) == (truth == "actuator")
    # What was said of them is not decided again.
    assert correct_recordings([seen], model, "joint", still).recordings[0].coordinates == "joint"


def test_what_was_said_of_coordinates_is_doubted_by_every_verb_alike():
    (doubt,) = decide_coordinates(of_motors(), ARM, "joint").warnings
    assert doubt in evaluate(WEIGHT, of_motors(), "joint").warnings
    assert doubt in correct_recordings([of_motors()], WEIGHT, "joint", {}).warnings
    said = replace(of_motors(), coordinates="actuator")
    right = correct_recordings([said], WEIGHT, None, {})
    assert (right.faults, right.warnings) == ((), ())


@pytest.mark.parametrize(
    "steps", [0.3 * np.cos(np.arange(12)), -0.12 + 0.15 * np.sin(np.arange(12))]
)
def test_coordinates_that_are_better_in_some_folds_only_are_not_clearly_better(steps):
    blocks = {"joint": np.ones(12), "actuator": np.exp(steps)}
    errors = CoordinateErrors({"joint": 0.22, "actuator": 0.17}, blocks)
    assert not errors.clearly_not("joint")
    sure = replace(errors, blocks={**blocks, "actuator": np.exp(-0.3 + 0.1 * steps)})
    assert sure.clearly_not("joint")


@pytest.mark.parametrize(("size", "read"), [(0.3, "actuator"), (0.9, "joint")])
def test_where_all_folds_agree_the_model_at_hand_must_not_be_sure_of_the_opposite(size, read):
    sizes = {"joint": 0.4, "actuator": size}
    decision = decide_coordinates(of_motors(), ARM, None, sizes.__getitem__)
    assert decision.errors.clearly_not("joint")
    assert decision.coordinates == read


def test_a_psm_s_motors_are_recognised(measured_data):
    arm = Arm.load("psm")
    recording = Recording.load(measured_data / "psm" / "psm_one_bare.csv", arm)
    seen = recording.between(recording.time[0] + 5.0, recording.time[0] + 15.0)
    assert decide_coordinates(seen, arm, None).coordinates == "actuator"
