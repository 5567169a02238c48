"""What a recording shows by itself to be wrong with it: put right before a model is asked.

A velocity column that is a multiple of the differentiated positions has another unit, or the clock
runs wrong; a plain model of the arm tells joint from actuator coordinates. None of it needs the
model on trial, which may be too poor to tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import norm

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.results.findings import NO_TERM, Finding, Gain
from dvrk_gravity.diagnosis.velocity_faults import Mend, fault_of_velocities
from dvrk_gravity.effects import WrongCoordinates, readings
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import CoordinateErrors, decide_coordinates
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Coordinates, DataWarning, Recording, RecordingFile, join

_LOOKED_AT = 60.0  # s of a recording. Chosen: that of a stretch of a long one


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
        head = beginning(recording)
        while fault := fault_of_velocities(head, model, still):
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


def beginning(recording: Recording | RecordingFile) -> Recording:
    """Return what is looked at of a recording."""
    parts: list[Recording] = []
    for part in recording.parts():
        parts.append(part)
        first = parts[0].time
        if first is None or part.time is None:
            continue
        end = float(first[0]) + _LOOKED_AT
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
