"""Faults of a recording's clock, or of its velocities' unit, by comparison with the positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from dvrk_gravity.effects import UNITS, Estimate
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.recording import Recording, VelocityFit, compare_velocity

# Part of a velocity that its multiple of the differentiated position leaves, up to which it is that
# multiple. Chosen: late or coarse velocities of real arms leave up to .1 (the recordings of
# docs/psm.md and docs/identification.md).
_PROPORTIONAL = 0.2
# Relative difference of joints' multiples that count as the same. Chosen: twice what those of a
# real master arm's wrist are off.
_SAME = 0.08
# Relative difference from 1 of the multiple of all joints, from which on the clock is wrong. Chosen
# likewise.
_CLOCK = 0.08
# The same of a joint's own multiple that is not a unit's. Chosen: less is a matter of its filter or
# of its encoder, and the differentiated position is used instead.
_GROSS = 0.2
_UNIT = 0.05  # relative difference of a multiple from that of a unit. Chosen likewise
# Factor by which a clock may be wrong. Chosen: 1 kHz taken for 100 Hz; what is more, has a unit in
# it.
_FARTHEST_CLOCK = 10.0


@dataclass(frozen=True, eq=False)
class VelocityFault:
    """Velocities that are a multiple of the differentiated positions.

    Attributes:
        joints: Their joints.
        factor: The multiple, with its 95 % interval.
        removed: Part of their difference that it explains, and its 95 % interval.
        p_value: Of a multiple of 1.
        unit: The unit with such a multiple; ``""``: none that is known.
        exact: That unit's multiple, or the estimate.
        whole: Whether all velocities have it.
        clock: Whether the clock is to be corrected, not the velocities.
    """

    joints: tuple[str, ...]
    factor: Estimate
    removed: tuple[float, float, float]
    p_value: float
    unit: str
    exact: float
    whole: bool
    clock: bool

    def mend(self, part: Recording) -> Recording:
        """Return a part of the recording without the fault."""
        if self.clock:
            assert part.time is not None
            return replace(part, time=part.time / self.factor.value)
        assert part.velocity is not None
        scale = np.where(np.isin(part.joints, self.joints), self.exact, 1.0)
        return replace(part, velocity=part.velocity / scale)


def velocity_fault(recording: Recording) -> VelocityFault | None:
    """Return a fault of the clock, or else of the unit of some velocities.

    The clock is wrong if no velocity agrees with it, and most have the same multiple: of the others
    the unit is wrong, too. Instead, all velocities may be too large by one factor. The data do not
    separate the two, and the clock is more probable: only a driver that differentiates over a wrong
    interval has all velocities wrong by one factor. No clock is wrong by as much as a unit may be:
    of a larger multiple the nearest unit's is taken off before.
    """
    if recording.time is None or len(recording) < 3:
        return None
    every = zip(recording.joints, compare_velocity(recording), strict=True)
    fits = {joint: fit for joint, fit in every if fit is not None and _proportional(fit)}
    wrong = {joint: fit for joint, fit in fits.items() if _scaled(fit)}
    if not wrong:
        return None
    units = {joint: _unit(fit, recording, joint) for joint, fit in wrong.items()}
    middle = float(np.median([fit.slope for fit in wrong.values()]))
    most = {
        joint: fit
        for joint, fit in wrong.items()
        if abs(fit.slope / middle - 1.0) < _SAME and not units[joint]
    }
    if len(wrong) == len(fits) < 2 * len(most):
        # What is left of a unit once the clock is right, is that unit's.
        size = _size_beside_clock(middle, _unit_of(recording, next(iter(most))))
        beside = {
            joint: replace(fit, slope=fit.slope / size, residual=fit.residual / size)
            for joint, fit in most.items()
        }
        clock = abs(np.log(middle / size)) <= np.log(_FARTHEST_CLOCK)
        return _fault(beside, "", 0.0, whole=len(most) > 1, clock=bool(clock))
    gross = [
        joint
        for joint, fit in wrong.items()
        if units[joint] or abs(np.log(fit.slope)) > np.log1p(_GROSS)
    ]
    if not gross:
        return None
    unit = units[gross[0]]
    same = [joint for joint in gross if unit and units[joint] == unit] or [gross[0]]
    exact = UNITS[_unit_of(recording, gross[0])].get(unit, 0.0)
    whole = len(same) == len(fits) > 1
    return _fault({joint: wrong[joint] for joint in same}, unit, exact, whole, clock=False)


def _fault(
    fits: Mapping[str, VelocityFit], unit: str, exact: float, whole: bool, clock: bool
) -> VelocityFault:
    """Return the common multiple of some joints, each of which has it by itself."""
    slope = np.array([fit.slope for fit in fits.values()])
    rest = np.array([fit.residual for fit in fits.values()])
    error = np.array([_slope_error(fit) for fit in fits.values()])
    weight = error**-2 / np.sum(error**-2)
    value = float(weight @ slope)
    # Joints that differ by more than their standard errors do not share a better known multiple.
    spread = float(np.sqrt(weight @ (slope - value) ** 2 / max(len(slope) - 1, 1)))
    deviation = max(float(np.sum(error**-2)) ** -0.5, spread)
    low, high = (value + sign * NORMAL_95 * deviation for sign in (-1.0, 1.0))

    def removed(factor: float) -> float:
        before = np.sqrt(np.mean((slope - 1.0) ** 2 + rest**2))
        after = np.sqrt(np.mean((slope / factor - 1.0) ** 2 + (rest / factor) ** 2))
        return float(1.0 - after / before)

    ends = sorted(removed(factor) for factor in (low, value, high))
    return VelocityFault(
        tuple(fits),
        Estimate(value, low, high, ""),
        (removed(value), ends[0], ends[-1]),
        2.0 * NormalDist().cdf(-abs(value - 1.0) / deviation),
        unit,
        exact or value,
        whole,
        clock,
    )


def _slope_error(fit: VelocityFit) -> float:
    return max(fit.residual, 1e-4) / float(np.sqrt(fit.samples))


def _proportional(fit: VelocityFit) -> bool:
    """Whether a velocity is a multiple of the differentiated position, 1 included."""
    return fit.slope > 0.0 and fit.residual <= _PROPORTIONAL * fit.slope


def _scaled(fit: VelocityFit) -> bool:
    """Whether the multiple differs from 1."""
    error = 4.0 * _slope_error(fit) / fit.slope
    return abs(np.log(fit.slope)) > max(np.log1p(_CLOCK), error)


def _unit_of(recording: Recording, joint: str) -> str:
    arm = recording.arm
    return "rad" if arm is None else arm.joints[arm.joint_names.index(joint)].unit


def _size_beside_clock(multiple: float, unit: str) -> float:
    """Return the unit's multiple that leaves the clock nearest to right; 1: a clock alone may be.

    Args:
        multiple: Of all velocities.
        unit: Of the positions.
    """
    if abs(np.log(multiple)) <= np.log(_FARTHEST_CLOCK):
        return 1.0
    sizes = (1.0, *UNITS[unit].values())
    return min(sizes, key=lambda size: abs(np.log(multiple / size)))


def _unit(fit: VelocityFit, recording: Recording, joint: str) -> str:
    """Return the unit in which a velocity is such a multiple; ``""``: none that is known."""
    known = UNITS[_unit_of(recording, joint)]
    return next((name for name, size in known.items() if abs(fit.slope / size - 1.0) < _UNIT), "")
