"""What velocities show of a recording's clock and of their own unit, beside the positions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from dvrk_gravity.diagnosis.data.loading import LoadSettings, load
from dvrk_gravity.diagnosis.results.findings import NO_TERM, Alternative, Finding, Gain
from dvrk_gravity.effects import UNITS, Estimate, TimeScale, VelocityScale
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording, VelocityFit, compare_velocity

Mend = Callable[[Recording], Recording]


@dataclass(frozen=True)
class VelocityFaultSettings:
    """When velocities say that a clock or a unit is wrong.

    Attributes:
        proportional: Part of a velocity that its multiple of the differentiated position leaves, up
            to which it is that multiple. Chosen: late or coarse velocities of real arms leave up to
            .1 (the recordings of docs/psm.md and docs/identification.md).
        alike: Relative difference of joints' multiples that are one. Chosen: twice what those of
            a real master arm's wrist are off.
        clock: Relative difference from 1 of the multiple that all joints have, from which on the
            clock is wrong. Chosen likewise.
        gross: The same of a joint's own multiple, that of no unit. Chosen: less is a matter of its
            filter or of its encoder, and the differentiated position is used instead.
        unit: Relative difference of a multiple from that of a unit. Chosen likewise.
        surely: Standard errors by which the model fits one clock better than the other. Chosen: one
            chance in a thousand.
        blocks: Blocks by whose errors that is judged.
    """

    proportional: float = 0.2
    alike: float = 0.08
    clock: float = 0.08
    gross: float = 0.2
    unit: float = 0.05
    surely: float = 3.0
    blocks: int = 24


_SETTINGS = VelocityFaultSettings()


@dataclass(frozen=True, eq=False)
class Fault:
    """One fault, and how it is put right."""

    finding: Finding
    mend: Mend


@dataclass(frozen=True, eq=False)
class _Multiple:
    """What multiple of differentiated positions velocities are.

    Attributes:
        joints: Names.
        factor: The multiple, with its 95 % interval.
        gain: Part of what velocities and differentiated positions differ by that it explains.
        unit: The unit that velocities of such a multiple have; ``""``: none that is known.
        exact: The unit's own multiple, or the one that was found.
    """

    joints: tuple[str, ...]
    factor: Estimate
    gain: Gain
    unit: str
    exact: float

    @classmethod
    def of(cls, fits: Mapping[str, VelocityFit], unit: str, exact: float = 0.0) -> _Multiple:
        """Return the multiple of some joints together, each of which has it by itself."""
        slope = np.array([fit.slope for fit in fits.values()])
        rest = np.array([fit.residual for fit in fits.values()])
        error = np.array([_slope_error(fit) for fit in fits.values()])
        weight = error**-2 / np.sum(error**-2)
        value = float(weight @ slope)
        # Joints that differ by more than each is uncertain by share no better known multiple.
        spread = float(np.sqrt(weight @ (slope - value) ** 2 / max(len(slope) - 1, 1)))
        deviation = max(float(np.sum(error**-2)) ** -0.5, spread)
        low, high = (value + sign * NORMAL_95 * deviation for sign in (-1.0, 1.0))

        def explained(factor: float) -> float:
            before = np.sqrt(np.mean((slope - 1.0) ** 2 + rest**2))
            after = np.sqrt(np.mean((slope / factor - 1.0) ** 2 + (rest / factor) ** 2))
            return float(1.0 - after / before)

        ends = sorted(explained(factor) for factor in (low, value, high))
        p_value = float(2.0 * norm.sf(abs(value - 1.0) / deviation))
        gain = Gain(explained(value), ends[0], ends[-1], p_value)
        return cls(tuple(fits), Estimate(value, low, high, ""), gain, unit, exact or value)


def _slope_error(fit: VelocityFit) -> float:
    return max(fit.residual, 1e-4) / float(np.sqrt(fit.samples))


def fault_of_velocities(
    recording: Recording, model: TorqueModel, still: Mapping[str, float]
) -> Fault | None:
    """Return what velocities say of the clock, or else of the unit of some of them.

    The clock is wrong if no velocity fits it, and most are one multiple: of the others the unit is
    wrong, too.
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
        if abs(fit.slope / middle - 1.0) < _SETTINGS.alike and not units[joint]
    }
    if len(wrong) == len(fits) < 2 * len(most):
        return _clock_or_velocities(_Multiple.of(most, ""), recording, model, still)
    gross = [
        joint
        for joint, fit in wrong.items()
        if units[joint] or abs(np.log(fit.slope)) > np.log1p(_SETTINGS.gross)
    ]
    if not gross:
        return None
    first = gross[0]
    alike = [joint for joint in gross if units[first] and units[joint] == units[first]] or [first]
    exact = UNITS[_unit_of(recording, first)].get(units[first], 0.0)
    multiple = _Multiple.of({joint: wrong[joint] for joint in alike}, units[first], exact)
    return _velocities(multiple, len(fits))


def _proportional(fit: VelocityFit) -> bool:
    """Tell whether a velocity is a multiple of the differentiated position, be it once."""
    return fit.slope > 0.0 and fit.residual <= _SETTINGS.proportional * fit.slope


def _scaled(fit: VelocityFit) -> bool:
    """Tell whether the multiple is another one than once."""
    error = 4.0 * _slope_error(fit) / fit.slope
    return abs(np.log(fit.slope)) > max(np.log1p(_SETTINGS.clock), error)


def _unit_of(recording: Recording, joint: str) -> str:
    arm = recording.arm
    return "rad" if arm is None else arm.joints[arm.joint_names.index(joint)].unit


def _unit(fit: VelocityFit, recording: Recording, joint: str) -> str:
    """Return the unit in which a velocity is such a multiple; ``""``: none that is known."""
    known = UNITS[_unit_of(recording, joint)]
    return next(
        (name for name, size in known.items() if abs(fit.slope / size - 1.0) < _SETTINGS.unit), ""
    )


def _clock_or_velocities(
    multiple: _Multiple, recording: Recording, model: TorqueModel, still: Mapping[str, float]
) -> Fault:
    """Return which of the two is wrong where all velocities are one multiple, by the model.

    A wrong clock is believed sooner: only a driver that differentiates by a wrong interval has all
    velocities wrong alike.
    """
    clock = _clock(multiple, recording)
    better = _clock_fits_better(clock.mend(recording), multiple.factor.value, model, still)
    if better < -_SETTINGS.surely:
        return _velocities(multiple, len(multiple.joints))
    if better > _SETTINGS.surely:
        return clock
    other = Alternative(
        VelocityScale.NAME,
        multiple.joints,
        "velocities of all joints that are too large or too small alike would look the same, and "
        "the model's torques do not tell them apart: a stopwatch tells",
    )
    return replace(clock, finding=replace(clock.finding, alternatives=(other,)))


def _clock(multiple: _Multiple, recording: Recording) -> Fault:
    factor, rate = multiple.factor, recording.rate or 0.0
    sentence = (
        f"the recording's clock runs wrong: its times are {factor.shown} of the true ones "
        f"({rate:.4g} Hz, truly {rate * factor.value:.4g} Hz), by the velocities of all joints; "
        "the rest is judged in true times"
    )

    def mend(part: Recording) -> Recording:
        assert part.time is not None
        return replace(part, time=part.time / factor.value)

    return Fault(_finding(TimeScale, (), "clock", multiple, sentence), mend)


def _velocities(multiple: _Multiple, count: int) -> Fault:
    joints, unit = multiple.joints, multiple.unit
    of = "all joints" if len(joints) == count > 1 else ", ".join(joints)
    looks = f", as if in {unit}" if unit else ""
    sentence = (
        f"the velocity of {of} is {multiple.factor.shown} times the differentiated position{looks}"
        "; the rest is judged with it put right"
    )

    def mend(part: Recording) -> Recording:
        assert part.velocity is not None
        scale = np.where(np.isin(part.joints, joints), multiple.exact, 1.0)
        return replace(part, velocity=part.velocity / scale)

    return Fault(_finding(VelocityScale, joints, unit or "another scale", multiple, sentence), mend)


def _finding(
    effect: type[TimeScale] | type[VelocityScale],
    joints: tuple[str, ...],
    place: str,
    multiple: _Multiple,
    sentence: str,
) -> Finding:
    return Finding(
        effect=effect.NAME,
        joints=joints,
        place=place,
        parameters={"factor": multiple.factor},
        gain=multiple.gain,
        alternatives=(),
        rejected=(),
        sentence=sentence,
        picture=None,
        left_out=NO_TERM,
        remedy=effect.REMEDY,
    )


def _clock_fits_better(
    mended: Recording, factor: float, model: TorqueModel, still: Mapping[str, float]
) -> float:
    """Return by how many standard errors a model fits a mended clock better than the recorded one.

    Args:
        mended: The recording in what may be its true times.
        factor: Recorded over true time.
        model: The model on trial.
        still: Where joints stood that the recording does not hold.
    """
    try:
        motion = load([mended], model, still, LoadSettings(shortest=0.0)).motion
    except RecordingError:  # whoever reads it next says why
        return 0.0
    as_recorded = replace(motion, qd=motion.qd / factor, qdd=motion.qdd / factor**2)
    usable = ~motion.silent & motion.present
    square = [np.where(usable, each.residual, 0.0) ** 2 for each in (motion, as_recorded)]
    scale = np.maximum(np.minimum(*(each.mean(axis=0) for each in square)), 1e-12)
    difference = ((square[1] - square[0]) / scale).sum(axis=1)
    blocks = np.array([part.mean() for part in np.array_split(difference, _SETTINGS.blocks)])
    error = float(np.std(blocks, ddof=1)) / np.sqrt(len(blocks))
    return float(blocks.mean()) / error if error > 0.0 else 0.0
