"""What a recording shows by itself to be wrong with it: put right before a model is asked.

A velocity column that is a multiple of the differentiated positions has another unit, or the clock
runs wrong; a plain model of the arm tells joint from actuator coordinates. None of it needs the
model on trial, which may be too poor to tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.findings import NO_TERM, Alternative, Finding, Gain
from dvrk_gravity.diagnosis.load import LoadSettings, load
from dvrk_gravity.effects.base.meaning import Estimate
from dvrk_gravity.effects.time_scale import TimeScale
from dvrk_gravity.effects.velocity_scale import UNITS, VelocityScale
from dvrk_gravity.effects.wrong_coordinates import WrongCoordinates, readings
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation.covariance import NORMAL_95
from dvrk_gravity.identification.coordinates import CoordinateErrors, decide_coordinates
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import DataWarning, Recording, RecordingFile
from dvrk_gravity.recording.data import Coordinates
from dvrk_gravity.recording.files import join
from dvrk_gravity.recording.velocity import VelocityFit, compare_velocity

Array = NDArray[np.float64]
Mend = Callable[[Recording], Recording]


@dataclass(frozen=True)
class FaultSettings:
    """When velocities say that a clock or a unit is wrong.

    Attributes:
        looked_at: s of a recording that are looked at. Chosen: that of a stretch of a long one.
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

    looked_at: float = 60.0
    proportional: float = 0.2
    alike: float = 0.08
    clock: float = 0.08
    gross: float = 0.2
    unit: float = 0.05
    surely: float = 3.0
    blocks: int = 24


_SETTINGS = FaultSettings()


@dataclass(frozen=True, eq=False)
class PutRight:
    """Recordings as they are to be read, and what was wrong with them.

    Attributes:
        recordings: The recordings.
        findings: What was wrong, first what concerns all joints.
        warnings: That what was given of them looks otherwise.
    """

    recordings: list[Recording | RecordingFile]
    findings: tuple[Finding, ...] = ()
    warnings: tuple[DataWarning, ...] = ()

    @property
    def of_reference(self) -> tuple[DataWarning, ...]:
        """The same as warnings about a reference, of which there are no findings."""
        faults = (
            DataWarning(
                "velocity_mismatch" if finding.parameters else "coordinates",
                None,
                {name: estimate.value for name, estimate in finding.parameters.items()},
                f"reference: {finding.sentence}",
            )
            for finding in self.findings
        )
        return (*faults, *self.warnings)


@dataclass(frozen=True, eq=False)
class _Fault:
    """One fault, and how it is put right."""

    finding: Finding
    mend: Mend


def put_right(
    recordings: Sequence[Recording | RecordingFile],
    model: TorqueModel,
    coordinates: Coordinates | None,
    still: Mapping[str, float],
) -> PutRight:
    """Return recordings without the faults that they show by themselves, and what these are.

    Args:
        recordings: Trajectories or static poses.
        model: The model on trial; it is asked only whether the clock or all velocities are wrong.
        coordinates: What those of them are in that do not say themselves that they are in the
            motors'; ``None``: nobody knows, and it is a finding if they are not in the joints'.
        still: Where joints stood that the recordings do not hold.
    """
    right, findings, warnings = [], list[Finding](), list[DataWarning]()
    for recording in recordings:
        head = _beginning(recording)
        while fault := _of_velocities(head, model, still):
            findings.append(_named(fault.finding, head, len(recordings)))
            recording, head = _mended(recording, fault.mend), fault.mend(head)
        stated = head.coordinates
        given = stated if stated == "actuator" else coordinates
        decision = decide_coordinates(head, model.arm, given)
        warnings += decision.warnings
        if decision.coordinates != stated:
            recording = _mended(recording, partial(_read_in, decision.coordinates))
            if given is None and decision.errors is not None:
                found = _coordinates_finding(model.arm, decision.coordinates, decision.errors)
                findings.append(_named(found, head, len(recordings)))
        right.append(recording)
    return PutRight(right, tuple(findings), tuple(warnings))


def _beginning(recording: Recording | RecordingFile) -> Recording:
    """Return what is looked at of a recording."""
    parts: list[Recording] = []
    for part in recording.parts():
        parts.append(part)
        first = parts[0].time
        if first is None or part.time is None:
            continue
        end = float(first[0]) + _SETTINGS.looked_at
        if part.time[-1] > end:
            parts[-1] = part.rows(part.time <= end) if part.time[0] <= end else part.rows(slice(1))
            break
    return join(parts) if len(parts) > 1 else parts[0]


def _mended(recording: Recording | RecordingFile, mend: Mend) -> Recording | RecordingFile:
    return mend(recording) if isinstance(recording, Recording) else recording.mended(mend)


def _read_in(coordinates: Coordinates, recording: Recording) -> Recording:
    return replace(recording, coordinates=coordinates)


def _named(finding: Finding, recording: Recording, count: int) -> Finding:
    """Return a finding that names its recording, where there are several."""
    if count == 1:
        return finding
    return replace(finding, sentence=f"{recording.source}: {finding.sentence}")


def _coordinates_finding(arm: Arm, right: Coordinates, errors: CoordinateErrors) -> Finding:
    """Return the finding that a recording is in other coordinates than it was taken for."""
    reading = next(
        each for each in readings(arm, np.ones(arm.n, dtype=bool)) if each.coordinates == right
    )
    wrong = next(system for system in errors.whole if system != right)
    step = np.log(errors.blocks[right] / np.maximum(errors.blocks[wrong], 1e-12))
    mean, error = float(step.mean()), float(np.std(step, ddof=1)) / np.sqrt(len(step))
    high, removed, low = (
        1.0 - np.exp(mean + sign * NORMAL_95 * error) for sign in (-1.0, 0.0, 1.0)
    )
    gain = Gain(removed, low, high, float(norm.cdf(mean / max(error, 1e-9))))
    return Finding(
        effect=WrongCoordinates.NAME,
        joints=(),
        place=reading.words,
        parameters={},
        gain=gain,
        alternatives=(),
        rejected=(),
        sentence=(
            f"The recording is read wrongly: {reading.words}; read rightly, {100 * removed:.0f} % "
            "of the error that a plain model leaves on held-out blocks is gone"
        ),
        picture=None,
        left_out=NO_TERM,
        remedy=reading.remedy,
    )


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


def _of_velocities(
    recording: Recording, model: TorqueModel, still: Mapping[str, float]
) -> _Fault | None:
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
) -> _Fault:
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


def _clock(multiple: _Multiple, recording: Recording) -> _Fault:
    factor, rate = multiple.factor, recording.rate or 0.0
    sentence = (
        f"the recording's clock runs wrong: its times are {factor.shown} of the true ones "
        f"({rate:.4g} Hz, truly {rate * factor.value:.4g} Hz), by the velocities of all joints; "
        "the rest is judged in true times"
    )

    def mend(part: Recording) -> Recording:
        assert part.time is not None
        return replace(part, time=part.time / factor.value)

    return _Fault(_finding(TimeScale, (), "clock", multiple, sentence), mend)


def _velocities(multiple: _Multiple, count: int) -> _Fault:
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

    return _Fault(
        _finding(VelocityScale, joints, unit or "another scale", multiple, sentence), mend
    )


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
