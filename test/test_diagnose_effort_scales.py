"""Efforts at another scale are one cause, whatever its size, and the rest is judged in N·m."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dvrk_gravity.diagnosis import diagnose, effort_scales, load
from dvrk_gravity.effects import Estimate, TorqueScale
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import Recording
from testing.hide import hide
from testing.world import COARSE, World

KNOWN = World.draw(3, step=COARSE)
MODEL = KNOWN.model()

pytestmark = pytest.mark.usefixtures("four_folds", "brief_simulation")


@cache
def recorded() -> Recording:
    return KNOWN.record(3, 4, 10.0, 100.0)


def scaled(recording: Recording, factor: float, joint: str = "") -> Recording:
    assert recording.effort is not None
    factors = np.where(np.isin(recording.joints, [joint or recording.joints]), factor, 1.0)
    return replace(recording, effort=factors * recording.effort)


@pytest.mark.parametrize("factor", [1e-3, 0.1, 0.3, 4.0, 10.0])
def test_a_scale_of_all_efforts_is_the_one_cause(factor):
    (finding,) = diagnose(scaled(recorded(), factor), MODEL).findings

    assert (finding.effect, finding.joints) == ("torque_scale", recorded().joints)
    assert finding.place == "all"
    assert finding.certain
    assert finding.parameters["factor"].value == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize("factor", [0.05, 8.0])
def test_the_scale_of_one_joint_is_its_own(factor):
    (finding,) = diagnose(scaled(recorded(), factor, "elbow_pitch"), MODEL).findings

    assert (finding.effect, finding.joints) == ("torque_scale", ("elbow_pitch",))
    assert finding.parameters["factor"].value == pytest.approx(factor, rel=0.02)


def test_newton_millimetres_are_refused():
    with pytest.raises(RecordingError, match="expected N·m, not mN·m"):
        diagnose(scaled(recorded(), 1e3), MODEL)


def test_what_else_is_wrong_is_judged_at_the_right_scale():
    world, hidden = hide(KNOWN, "viscous_friction", np.random.default_rng(2))

    scale, friction = diagnose(scaled(world.record(3, 4, 10.0, 100.0), 10.0), MODEL).findings

    assert (scale.effect, friction.effect) == ("torque_scale", "viscous_friction")
    assert scale.parameters["factor"].value == pytest.approx(10.0, rel=0.02)
    assert friction.joints == hidden.joints
    truth = hidden.parameters["coefficient"]
    assert friction.parameters["coefficient"].value == pytest.approx(truth, rel=0.1)


def test_efforts_that_are_clipped_are_no_scale():
    """They stay at a level."""
    recording = recorded()
    level = 0.05 * np.abs(recording.effort).max(axis=0)
    clipped = replace(recording, effort=np.clip(recording.effort, -level, level))
    motion = load([clipped], MODEL).motion

    assert not list(effort_scales(motion, ~motion.silent, np.zeros(motion.arm.n)))


@pytest.mark.parametrize(("value", "words"), [(10.0, "times"), (0.1, "times"), (2.0, "% too high")])
def test_a_factor_that_is_far_off_is_told_as_one(value, words):
    factor = Estimate(value, 0.99 * value, 1.01 * value, "")
    assert TorqueScale.meaning("factor").in_words(factor).endswith(words)
