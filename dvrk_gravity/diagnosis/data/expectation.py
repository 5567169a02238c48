"""What should have been measured, and by how much that may be off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.baseline_error import baseline_columns
from dvrk_gravity.diagnosis.data.model_error import FRICTION_PART, model_columns
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion


@dataclass(frozen=True, eq=False)
class Expectation:
    """The torque that a model or a baseline recording leads to expect in a motion of N samples.

    Attributes:
        torque: (N, n) its mean, N·m.
        columns: (N, n, d) torques by which that may be off in d independent directions, one
            standard deviation each, N·m.
        known_error: (n,) RMS error that is known to remain, N·m; zero if unknown.
        friction: (N, n) torque of friction that may have changed since calibration, N·m; zero for a
            model without uncertainty, for friction stated in an arm's file, and for poses.
        friction_variation: (n,) RMS torque by which that varies from day to day, N·m.
        predicts: Whether it is known in other motions as well, and for an arm without wrong
            readings. Else it was measured in this motion: wrong readings are in it, too, and of an
            effect only the change is known.
        identified: Whether it was measured or fitted, so that what it lacks are single causes; an
            arm's own file lacks several at every joint.
    """

    torque: Array
    columns: Array
    known_error: Array
    friction: Array
    friction_variation: Array
    predicts: bool
    identified: bool

    @property
    def day_to_day_error(self) -> Array:
        """(n,) known error together with day-to-day friction variation, N·m RMS."""
        return np.hypot(self.known_error, self.friction_variation)

    def filtered(self, low_pass: Callable[[Array], Array]) -> Expectation:
        """Return it at T filtered samples."""
        torque, columns, friction = map(low_pass, (self.torque, self.columns, self.friction))
        return replace(self, torque=torque, columns=columns, friction=friction)


def expect(motion: MeasuredMotion) -> Expectation:
    """Return what a motion's baseline recording leads to expect, or else its model."""
    return _of_model(motion) if motion.reference is None else _of_baseline(motion, motion.reference)


def _of_model(motion: MeasuredMotion) -> Expectation:
    known, friction = motion.model.uncertainty, np.zeros(motion.q.shape)
    if known is not None and not (motion.model.of_file or motion.static):
        friction = motion.friction
    varies = FRICTION_PART * np.sqrt(np.mean(friction**2, axis=0))
    error = np.zeros(motion.arm.n) if known is None else np.nan_to_num(known.error)
    return Expectation(
        motion.modelled, model_columns(motion), error, friction, varies, predicts=True,
        identified=known is not None and not motion.model.of_file,
    )  # fmt: skip


def _of_baseline(motion: MeasuredMotion, measured: Array) -> Expectation:
    """Return what one of two recordings leads to expect: its columns have friction's changes."""
    nothing, none = np.zeros(motion.q.shape), np.zeros(motion.arm.n)
    columns = baseline_columns(motion)
    return Expectation(measured, columns, none, nothing, none, predicts=False, identified=True)
