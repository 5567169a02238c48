"""Further identifications, of wrong recordings and by other ones, beside those of test/."""

from __future__ import annotations

from dataclasses import replace

import known_poses
import numpy as np
from known_mtm import ARM, parameter, truth
from known_poses import NOISE, between, grid, record, worst

from dvrk_gravity.identification import build_problem, estimate, fit_static, identify
from dvrk_gravity.model import start_columns
from dvrk_gravity.observation import decide_coordinates, observe
from dvrk_gravity.recording import Recording
from testing.lab_motion import draw_calibration
from testing.mujoco_world import MujocoWorld

POOR = "do_not_compensate"


def test_a_few_poses_where_the_arm_was_stuck_do_no_harm():
    recordings = record(known_poses.truth(), grid(4))
    stuck = recordings[0].effort.copy()
    stuck[100:110, 4] = -0.26
    fit = fit_static([replace(recordings[0], effort=stuck), recordings[1]], known_poses.ARM)
    assert worst(fit.model, known_poses.truth(), between()) < NOISE
    assert any("wrist_pitch: 10 of 2048 poses" in line for line in fit.handling)
    assert fit.model.torque(between())[:, 4].min() > -0.2


def test_recordings_kept_out_of_the_fit_judge_it():
    effects, other = ["coulomb_friction"], truth(2, 12.0)
    effort = other.effort.copy()  # something else acts on outer_yaw
    effort[:, 0] += 0.05 * np.random.default_rng(0).normal(size=len(effort)).cumsum()
    other = replace(other, effort=effort)
    fit = identify([truth(1, 12.0)], ARM, "joint", effects, validate=[other], physical=False)
    assert fit.model.verdict == fit.verdict.joints["outer_yaw"].level == POOR


def test_directions_that_are_exchanged_are_warned_of():
    exchanged = [
        replace(each, direction=-each.direction) for each in record(known_poses.truth(), grid(3))
    ]
    warnings = fit_static(exchanged, known_poses.ARM).warnings
    assert "shoulder_pitch" in [each.joint for each in warnings if each.kind == "effort_sign"]


def plain_estimate(recording: Recording):
    """Return a fit of the columns that every model begins with."""
    problem = build_problem(observe([recording], ARM), ARM)
    return estimate(problem, start_columns(problem.design.columns))


def test_a_burst_of_wrong_efforts_hardly_moves_the_parameters():
    recording = truth(1, 16.0)
    effort = recording.effort.copy()
    effort[600:612, 3] += 1.0  # fifty times the joint's Coulomb friction
    clean, hit = (plain_estimate(case) for case in (recording, replace(recording, effort=effort)))
    for name in ("coulomb_friction.joint[wrist_platform]", "beta[3]"):
        before, after = parameter(clean, name), parameter(hit, name)
        half = 0.5 * (before.ci95[1] - before.ci95[0])
        assert abs(after.value - before.value) < half, name
        assert 0.5 * (after.ci95[1] - after.ci95[0]) < 1.5 * half, name


def moved_less(recording: Recording, joint: int, part: float) -> Recording:
    """Return a recording one of whose joints goes through a part of the way."""
    middle = recording.position.mean(axis=0)
    parts = np.where(np.arange(7) == joint, part, 1.0)
    position = middle + parts * (recording.position - middle)
    return replace(recording, position=position, velocity=parts * recording.velocity)


def test_a_short_range_cannot_separate_gravity_from_a_spring():
    """The shoulder within a few degrees: sin q2 and q2 are the same line."""
    effects = ["coulomb_friction", "elastic_cable"]
    found = identify([moved_less(truth(4), 1, 0.1)], ARM, "joint", effects, physical=False)
    assert any("shoulder_pitch" in each for each in found.identifiability.statements)
    assert found.identifiability.rank < found.identifiability.columns
    open_ = {each.name for each in found.parameters if not each.identifiable}
    assert {"beta[0] (arm_x)", "beta[1] (arm_y)", "elastic_cable.shoulder_pitch[0]"} <= open_


def test_coordinates_are_recognised_by_errors_of_what_was_recorded():
    """A PSM's errors at its joints are correlated."""
    world = MujocoWorld.draw("psm", 3031)
    arm = world.arm
    joint = world.record(world.truth(draw_calibration(arm, 3031), 20.0), 3031)
    actuator = replace(
        joint, position=arm.actuator_position(joint.position), velocity=None,
        effort=arm.actuator_effort(joint.effort),
    )  # fmt: skip
    assert decide_coordinates(joint, arm, None).coordinates == "joint"
    assert decide_coordinates(actuator, arm, None).coordinates == "actuator"
