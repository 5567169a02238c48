"""Whether an arm's efforts are those that its motion takes: a hand, or what is in its way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting.driver import Path
from dvrk_gravity.compensate import DRY_SPEED, LAG, MotionError, Sample
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import effort_band


@dataclass(frozen=True)
class EffortSettings:
    """When an effort is not explained by the motion.

    Attributes:
        step: Step at which the model is evaluated along the path, s. A torque at 0.6 Hz changes by
            15 % of its amplitude within a step, and the window holds both of its ends.
        horizon: Length of the path that is evaluated at a time, s. An identified MTM's takes 3 ms,
            less than a period of the set points.
        window: Length of the path, back from the set point, whose efforts are all expected, s: the
            arm lags by up to LAG, and its effort is measured some 10 ms late.
        margin: Distance from the band that is allowed, as a part of the motor's greatest effort.
            Twice what undisturbed simulated arms need with their plant's own model: at most .046
            for an MTM, .031 for a PSM, .004 for an ECM, on covering plans of 8 and 20 s
            (`test_an_undisturbed_arm_needs_half_of_the_margin`).
        duration: Time beyond the margin after which the arm is stopped, s: a servo's answer to a
            step has ended, and an arm at 60 deg/s has gone 6 deg.
    """

    step: float = 0.04
    horizon: float = 0.12
    window: float = LAG + 0.03
    margin: float = 0.1
    duration: float = 0.1


class EffortWatch:
    """Stops an arm whose efforts are beyond its model's band, or its limits, for a while.

    The band is that of the path within the arm's lag, with any friction that a joint so slow may
    have: at rest it is anything between both directions'. Outside of the range that the model was
    identified on it is wider. Without a model only the limits are watched. An arm whose efforts
    are missing is stopped, too.
    """

    def __init__(
        self,
        path: Path,
        arm: Arm,
        greatest: Array,
        model: TorqueModel | None,
        settings: EffortSettings | None = None,
    ) -> None:
        """Watch nothing yet.

        Args:
            path: What the arm is to follow.
            arm: The arm.
            greatest: (n,) limits of the motors' efforts, N·m or N.
            model: The arm's.
            settings: When it stops.
        """
        self._path, self._arm, self._greatest, self._model = path, arm, greatest, model
        self._settings = settings or EffortSettings()
        self._margin = self._settings.margin * arm.actuator_effort_limit
        self._slow = DRY_SPEED * arm.scale
        # (N, n) each, from the path's beginning on in steps of `step`.
        self._lowest = self._highest = np.empty((0, arm.n))
        self._outside: float | None = None  # since when

    def __call__(self, sample: Sample, moment: float) -> None:
        """Look at a measurement, and at the path at that moment, s.

        Raises:
            MotionError: Naming the motor, its effort, and what was expected.
        """
        now = 1e-9 * sample.stamp
        if sample.effort is None:
            if self._has_persisted(now):
                raise MotionError(
                    "measured_js has no finite efforts: a hand would not be noticed, and nothing "
                    "could be identified"
                )
            return
        effort = self._arm.actuator_effort(sample.effort)
        lowest, highest = self._expected_range(moment)
        beyond = np.maximum(lowest - effort, effort - highest) / self._margin
        worst = int(np.argmax(beyond))
        if not beyond[worst] > 1.0:
            self._outside = None
            return
        if self._has_persisted(now):
            low, high = (
                end[worst] + way * self._margin[worst] for end, way in ((lowest, -1), (highest, 1))
            )
            by = "its limits" if self._model is None else "its model and its limits"
            raise MotionError(
                f"{self._arm.joint_names[worst]}'s motor has {effort[worst]:.3g} "
                f"{self._arm.effort_units[worst]} for {self._settings.duration:g} s, {low:.3g} to "
                f"{high:.3g} expected by {by}: is a hand on the arm, or something in its way?"
            )

    def _has_persisted(self, now: float) -> bool:
        """Note that an effort is wrong; return whether it has been for long enough."""
        self._outside = now if self._outside is None else self._outside
        return now - self._outside >= self._settings.duration

    def _expected_range(self, moment: float) -> tuple[Array, Array]:
        """Return (n,) lowest and (n,) highest efforts of the motors within the arm's lag."""
        if self._model is None:
            return -self._greatest, self._greatest
        of = self._settings
        last = int(moment / of.step) + 1
        while last >= len(self._lowest):  # also after a pause of ours
            self._look_ahead(self._model)
        window = slice(max(last - int(np.ceil(of.window / of.step)) - 1, 0), last + 1)
        lowest, highest = self._lowest[window].min(axis=0), self._highest[window].max(axis=0)
        # What a model does not know, its limits bound.
        return np.fmax(lowest, -self._greatest), np.fmin(highest, self._greatest)

    def _look_ahead(self, model: TorqueModel) -> None:
        """Ask the model about the next part of the path."""
        of = self._settings
        steps = len(self._lowest) + np.arange(round(of.horizon / of.step), dtype=float)
        time: Array = np.asarray(of.step * steps, dtype=float)
        q, qd, qdd = (np.vstack([each, each]) for each in self._path(time))
        slow = np.repeat([self._slow, -self._slow], len(time), axis=0)
        qd = qd + slow
        torque, half = effort_band(model, State(q, qd, qdd))
        half += _extrapolation_error(model, q, qd, qdd, torque)
        low, high = (ends.reshape(2, len(time), -1) for ends in (torque - half, torque + half))
        self._lowest = np.vstack([self._lowest, low.min(axis=0)])
        self._highest = np.vstack([self._highest, high.max(axis=0)])


def _extrapolation_error(
    model: TorqueModel, q: Array, qd: Array, qdd: Array, effort: Array
) -> Array:
    """Return (N, n) by how much efforts are less certain outside of a model's identified range.

    It is the change of the model's effort from the nearest state within the range, since terms
    that cannot be separated there differ outside; and of a joint that is itself outside, a part of
    its greatest effort: all of it as far outside as its range is wide (chosen), since a cable's
    torque is held constant there, whatever the cable does. Of static poses the greatest speed is
    not known (NaN): none was measured.
    """
    known = model.uncertainty
    if known is None:
        return np.zeros_like(effort)
    arm = model.arm
    lower, upper = known.lower + model.joint_offset, known.upper + model.joint_offset
    fastest = np.nan_to_num(known.speed)
    within = np.clip(q, lower, upper)
    nearest = State(within, np.clip(qd, -fastest, fastest), qdd)
    change = np.abs(effort - arm.actuator_effort(model.torque_at(nearest)))
    width = np.maximum(upper - lower, np.finfo(float).tiny)
    own = np.minimum(np.abs(q - within) / width, 1.0) * arm.effort_limit
    return change + own @ np.abs(arm.actuator_to_joint)
