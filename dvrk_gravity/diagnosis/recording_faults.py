"""Faults that a recording shows by itself, corrected before a model is judged, as findings.

A velocity column that is a multiple of the differentiated positions has another unit, or the clock
runs wrong; a plain model of the arm separates joint from actuator coordinates. None of it needs the
model on trial, which may be too poor; it is asked only whether a clock or all velocities are wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import norm

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.data.loading import LoadSettings, load
from dvrk_gravity.diagnosis.inference.held_out import Gain
from dvrk_gravity.diagnosis.results.findings import NO_TERM, Alternative, Finding
from dvrk_gravity.effects import TimeScale, VelocityScale, WrongCoordinates, readings
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.intake import CoordinateErrors, VelocityFault, decide_coordinates, velocity_fault
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Coordinates, DataWarning, Recording, RecordingFile, join

_BEGINNING = 60.0  # s of a recording that are looked at. Chosen: a stretch of a long one
# Standard errors by which the model fits one clock better than the other. Chosen: one chance in a
# thousand.
_SURELY = 3.0
_BLOCKS = 24  # whose mean errors give that standard error


@dataclass(frozen=True, eq=False)
class PutRight:
    """Corrected recordings, and their faults.

    Attributes:
        recordings: The recordings.
        findings: The faults, those of all joints first.
        warnings: That given coordinates look wrong.
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


def put_right(
    recordings: Sequence[Recording | RecordingFile],
    model: TorqueModel,
    coordinates: Coordinates | None,
    still: Mapping[str, float],
) -> PutRight:
    """Return recordings corrected for the faults that they show by themselves, and these faults.

    Args:
        recordings: Trajectories or static poses.
        model: The model on trial.
        coordinates: Of recordings that do not state actuator coordinates; ``None``: not known, and
            a finding if they are not joint coordinates.
        still: Where joints stood that the recordings do not hold.
    """
    right, findings, warnings = [], list[Finding](), list[DataWarning]()

    def note(finding: Finding, recording: Recording) -> None:
        several = len(recordings) > 1
        sentence = f"{recording.source}: {finding.sentence}" if several else finding.sentence
        findings.append(replace(finding, sentence=sentence))

    for recording in recordings:
        head = beginning(recording)
        while found := velocity_fault(head):
            fault, finding = _velocity_finding(found, head, model, still)
            note(finding, head)
            recording, head = _mended(recording, fault.mend), fault.mend(head)
        stated = head.coordinates
        given = stated if stated == "actuator" else coordinates
        decision = decide_coordinates(head, model.arm, given)
        warnings += decision.warnings
        if decision.coordinates != stated:
            recording = _mended(recording, partial(replace, coordinates=decision.coordinates))
            if given is None and decision.errors is not None:
                note(_coordinates_finding(model.arm, decision.coordinates, decision.errors), head)
        right.append(recording)
    return PutRight(right, tuple(findings), tuple(warnings))


def beginning(recording: Recording | RecordingFile) -> Recording:
    """Return the part of a recording that is looked at."""
    parts: list[Recording] = []
    for part in recording.parts():
        parts.append(part)
        first = parts[0].time
        if first is None or part.time is None:
            continue
        end = float(first[0]) + _BEGINNING
        if part.time[-1] > end:
            parts[-1] = part.rows(part.time <= end) if part.time[0] <= end else part.rows(slice(1))
            break
    return join(parts) if len(parts) > 1 else parts[0]


def _mended(
    recording: Recording | RecordingFile, mend: Callable[[Recording], Recording]
) -> Recording | RecordingFile:
    return mend(recording) if isinstance(recording, Recording) else recording.mended(mend)


def _velocity_finding(
    fault: VelocityFault, recording: Recording, model: TorqueModel, still: Mapping[str, float]
) -> tuple[VelocityFault, Finding]:
    """Return the fault as the model decides it, of the clock or of the velocities, as a finding."""
    alternatives: tuple[Alternative, ...] = ()
    if fault.clock:
        better = _clock_fits_better(fault.mend(recording), fault.factor.value, model, still)
        if better < -_SURELY:
            fault = replace(fault, clock=False)
        elif better <= _SURELY:
            why = (
                "velocities of all joints that are too large or too small alike would look the "
                "same, and the model's torques do not separate the two: a stopwatch does"
            )
            alternatives = (Alternative(VelocityScale.NAME, fault.joints, why),)
    shown, rate = fault.factor.shown, recording.rate or 0.0
    effect: type[TimeScale | VelocityScale] = TimeScale if fault.clock else VelocityScale
    joints = () if fault.clock else fault.joints
    if fault.clock:
        place = "clock"
        sentence = (
            f"the recording's clock runs wrong: its times are {shown} of the true ones "
            f"({rate:.4g} Hz, truly {rate * fault.factor.value:.4g} Hz), by the velocities of all "
            "joints; the rest is judged in true times"
        )
    else:
        place = fault.unit or "another scale"
        of = "all joints" if fault.whole else ", ".join(fault.joints)
        looks = f", as if in {fault.unit}" if fault.unit else ""
        sentence = (
            f"the velocity of {of} is {shown} times the differentiated position{looks}; the rest "
            "is judged with it corrected"
        )
    gain = Gain(*fault.removed, fault.p_value)
    finding = _finding(effect.NAME, joints, place, gain, sentence, effect.REMEDY)
    return fault, replace(finding, parameters={"factor": fault.factor}, alternatives=alternatives)


def _finding(
    effect: str, joints: tuple[str, ...], place: str, gain: Gain, sentence: str, remedy: str
) -> Finding:
    return Finding(
        effect=effect,
        joints=joints,
        place=place,
        parameters={},
        gain=gain,
        alternatives=(),
        rejected=(),
        sentence=sentence,
        picture=None,
        left_out=NO_TERM,
        remedy=remedy,
    )


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
    sentence = (
        f"The recording is read wrongly: {reading.words}; read rightly, {100 * removed:.0f} % "
        "of the error that a plain model leaves on held-out blocks is gone"
    )
    return _finding(WrongCoordinates.NAME, (), reading.words, gain, sentence, reading.remedy)


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
    blocks = np.array([part.mean() for part in np.array_split(difference, _BLOCKS)])
    error = float(np.std(blocks, ddof=1)) / np.sqrt(len(blocks))
    return float(blocks.mean()) / error if error > 0.0 else 0.0
