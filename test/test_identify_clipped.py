"""Efforts that a limit clipped are no measurement of what the arm took, and are not fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.identification import identify
from dvrk_gravity.recording import clipped_efforts
from testing.lab_motion import draw_calibration
from testing.mujoco_world import MujocoWorld

SEED, JOINT = 4, 1


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    return MujocoWorld.draw("chain", SEED)


@pytest.fixture(scope="module")
def recording(world):
    return world.record(world.truth(draw_calibration(world.arm, SEED)), SEED)


@pytest.fixture(scope="module")
def clipped(recording):
    """One joint's effort never passes six tenths of what it takes."""
    effort = recording.effort.copy()
    limit = 0.6 * np.abs(effort[:, JOINT]).max()
    effort[:, JOINT] = np.clip(effort[:, JOINT], -limit, limit)
    return replace(recording, effort=effort)


def test_a_model_of_clipped_efforts_holds_the_arm_as_one_of_whole_efforts_does(
    world, recording, clipped
):
    whole, part = (identify(each, world.arm) for each in (recording, clipped))

    q = recording.position[::50]
    there, here = whole.model.torque(q)[:, JOINT], part.model.torque(q)[:, JOINT]
    assert np.abs(here - there).max() < 0.05 * np.abs(there).max()
    assert any("clipped" in line for line in part.handling)
    assert not any("clipped" in line for line in whole.handling)


def test_what_is_clipped_is_where_the_limit_was_reached(recording, clipped):
    assert clipped_efforts(recording) == []

    spans = clipped_efforts(clipped)

    limit = np.abs(clipped.effort[:, JOINT]).max()
    assert {span.joint for span in spans} == {JOINT}
    assert {abs(span.value) for span in spans} == {limit}
    inside = np.zeros(len(clipped), dtype=bool)
    for span in spans:
        inside[slice(*span.rows)] = True
    at_limit = np.abs(clipped.effort[:, JOINT]) == limit
    assert np.mean(at_limit[inside]) == 1.0
    assert np.mean(inside[at_limit]) > 0.8
