"""Faults that recordings show by themselves, corrected.

A velocity column that is a multiple of the differentiated positions has another unit, or the clock
runs wrong; a plain model of the arm separates joint from actuator coordinates. The model under test
may be too poor for that: it decides only whether a clock or all velocities are wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.data.loading import LoadSettings, beginning, load
from dvrk_gravity.effects import (
    Estimate,
    ReadingErrors,
    SensorEffect,
    reading_effect,
    readings,
    remedy_text,
)
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import coordinates_of
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import (
    CoordinateErrors,
    Decision,
    VelocityFault,
    decide_coordinates,
    held_beyond,
    velocity_fault,
)
from dvrk_gravity.recording import Coordinates, Note, Recording

# Standard errors by which the model fits one clock better than the other. Chosen: one chance in a
# thousand.
_SIGNIFICANT = 3.0
_BLOCKS = 24  # whose mean errors give that standard error


@dataclass(frozen=True, eq=False)
class Fault:
    """A fault of a recording, which was corrected.

    Attributes:
        effect: Name in the vocabulary.
        joints: Names of the joints; empty for all.
        place: What is wrong.
        removed: Part of the error that the correction removes, and its 95 % interval.
        p_value: Of the correction.
        sentence: The fault in words, with figures.
        remedy: What to do about it.
        factor: By which something is wrong; ``None``: by none.
        alternatives: Other effects that would look the same, their joints, and why.
        of_one: Whether it is one of several recordings that has it.
    """

    effect: str
    joints: tuple[str, ...]
    place: str
    removed: tuple[float, float, float]
    p_value: float
    sentence: str
    remedy: str
    factor: Estimate | None = None
    alternatives: tuple[tuple[str, tuple[str, ...], str], ...] = ()
    of_one: bool = False


@dataclass(frozen=True, eq=False)
class CorrectedRecordings:
    """Corrected recordings, and their faults.

    Attributes:
        recordings: The recordings.
        faults: The faults, those of all joints first.
        warnings: That given coordinates look wrong.
        errors: The faults that all recordings share, as errors of readings.
        processing_log: What was done as at identification.
    """

    recordings: list[Recording]
    faults: tuple[Fault, ...]
    warnings: tuple[Note, ...]
    errors: ReadingErrors
    processing_log: tuple[str, ...]

    @property
    def of_reference(self) -> tuple[Note, ...]:
        """The same as warnings about a reference, of which there are no findings."""
        faults = (
            Note(
                "velocity_mismatch" if fault.factor else "coordinates",
                None,
                {"factor": fault.factor.value} if fault.factor else {},
                f"reference: {fault.sentence}",
            )
            for fault in self.faults
        )
        return (*faults, *self.warnings)


def correct_recordings(
    recordings: Sequence[Recording],
    model: TorqueModel,
    coordinates: Coordinates | None,
    fixed_positions: Mapping[str, float],
) -> CorrectedRecordings:
    """Return recordings corrected for the faults that they show by themselves, and these faults.

    Args:
        recordings: Trajectories or static poses.
        model: The model under test.
        coordinates: Of recordings that do not state actuator coordinates; ``None``: not known, and
            a finding if they are not joint coordinates.
        fixed_positions: Where joints stood that the recordings do not hold.
    """
    right, faults, warnings, processing_log = [], list[Fault](), list[Note](), list[str]()
    several = len(recordings) > 1
    read = ReadingErrors.none(model.arm.n)

    def note(fault: Fault, recording: Recording, errors: ReadingErrors) -> None:
        nonlocal read
        sentence = f"{recording.source}: {fault.sentence}" if several else fault.sentence
        # Of several recordings each may have been written in another way.
        carried = bool(model.terms) and not several  # without a model nothing is extended
        remedy = remedy_text(fault.remedy, carried, reading=True)
        faults.append(replace(fault, sentence=sentence, of_one=several, remedy=remedy))
        if not several:
            read = read.after(errors)

    for recording in recordings:
        head = beginning(recording)
        while found := velocity_fault(head):
            found, fault = _velocity_fault(found, head, model, fixed_positions)
            note(fault, head, _errors(found, model.arm))
            recording, head = found.mend(recording), found.mend(head)
        stated = head.coordinates
        given = stated if stated == "actuator" else coordinates
        decision = _coordinates(head, model, given, fixed_positions)
        warnings += decision.warnings
        if decision.coordinates != stated:
            recording = replace(recording, coordinates=decision.coordinates)
            if given is None and decision.coordinates == model.detected_coordinates:
                processing_log.append(
                    f"{decision.reason}, as those that the model was identified from"
                )
            elif given is None and decision.errors is not None:
                right_one = ReadingErrors.none(model.arm.n)
                errors = replace(right_one, coordinates=decision.coordinates)
                effect = reading_effect(model.arm, errors)
                fault = _wrong_coordinates(model.arm, effect, decision.coordinates, decision.errors)
                note(fault, head, errors)
            elif given is None:
                text = f"{decision.reason}: --coordinates overrides this"
                warnings.append(Note("coordinates", None, {}, text))
        right.append(recording)
    return CorrectedRecordings(right, tuple(faults), tuple(warnings), read, tuple(processing_log))


def _coordinates(
    recording: Recording,
    model: TorqueModel,
    given: Coordinates | None,
    fixed_positions: Mapping[str, float],
) -> Decision:
    """Return the coordinates as every verb decides them."""
    stood, _ = held_beyond([recording], model.arm, fixed_positions)
    unknown = set(model.arm.joint_names) - {*recording.joints, *stood}
    if not model.terms or unknown or recording.effort is None:
        return decide_coordinates(recording, model.arm, given)
    return coordinates_of(model, [recording], given, stood)


def _errors(fault: VelocityFault, arm: Arm) -> ReadingErrors:
    right = ReadingErrors.none(arm.n)
    if fault.clock:
        return replace(right, clock=fault.factor.value)
    wrong = np.isin(arm.joint_names, fault.joints)
    return replace(right, velocity=np.where(wrong, fault.exact, 1.0))


def _effect(fault: VelocityFault, arm: Arm) -> type[SensorEffect]:
    return reading_effect(arm, _errors(fault, arm))


def _velocity_fault(
    fault: VelocityFault,
    recording: Recording,
    model: TorqueModel,
    fixed_positions: Mapping[str, float],
) -> tuple[VelocityFault, Fault]:
    """Return the fault as the model decides it, of the clock or of the velocities, and in words."""
    alternatives: tuple[tuple[str, tuple[str, ...], str], ...] = ()
    if fault.clock:
        better = _clock_fits_better(
            fault.mend(recording), fault.factor.value, model, fixed_positions
        )
        if better < -_SIGNIFICANT:
            fault = replace(fault, clock=False)
        elif better <= _SIGNIFICANT:
            why = (
                "velocities of all joints equally too large or too small would look the "
                "same, and the model's torques do not separate the two: a stopwatch does"
            )
            other = _effect(replace(fault, clock=False), model.arm)
            alternatives = ((other.NAME, fault.joints, why),)
    shown, rate = fault.factor.shown, recording.rate or 0.0
    effect = _effect(fault, model.arm)
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
    return fault, Fault(
        effect.NAME, joints, place, fault.removed, fault.p_value, sentence, effect.REMEDY,
        fault.factor, alternatives,
    )  # fmt: skip


def _wrong_coordinates(
    arm: Arm, effect: type[SensorEffect], right: Coordinates, errors: CoordinateErrors
) -> Fault:
    """Return the fault that a recording is in other coordinates than it was taken for."""
    reading = next(
        each for each in readings(arm, np.ones(arm.n, dtype=bool)) if each.coordinates == right
    )
    wrong = next(system for system in errors.whole if system != right)
    step = np.log(errors.blocks[right] / np.maximum(errors.blocks[wrong], 1e-12))
    mean, error = float(step.mean()), float(np.std(step, ddof=1)) / np.sqrt(len(step))
    high, removed, low = (
        1.0 - np.exp(mean + sign * NORMAL_95 * error) for sign in (-1.0, 0.0, 1.0)
    )
    p_value = NormalDist().cdf(mean / max(error, 1e-9))
    sentence = (
        f"The recording is in {right} coordinates and does not state so (`identify` and `evaluate` "
        f"read it so, too); against {wrong} coordinates, {100 * removed:.0f} % of the error that a "
        "plain model leaves on held-out blocks is gone"
    )
    return Fault(
        effect.NAME, (), reading.words, (removed, low, high), p_value, sentence,
        reading.remedy,
    )  # fmt: skip


def _clock_fits_better(
    mended: Recording, factor: float, model: TorqueModel, fixed_positions: Mapping[str, float]
) -> float:
    """Return by how many standard errors a model fits a mended clock better than the recorded one.

    Args:
        mended: The recording in what may be its true times.
        factor: Recorded over true time.
        model: The model under test.
        fixed_positions: Where joints stood that the recording does not hold.
    """
    try:
        motion = load([mended], model, fixed_positions, LoadSettings(shortest=0.0))
    except RecordingError:  # the next to read it raises it, too
        return 0.0
    as_recorded = replace(motion, qd=motion.qd / factor, qdd=motion.qdd / factor**2)
    usable = ~motion.silent & motion.present
    square = [np.where(usable, each.residual, 0.0) ** 2 for each in (motion, as_recorded)]
    scale = np.maximum(np.minimum(*(each.mean(axis=0) for each in square)), 1e-12)
    difference = ((square[1] - square[0]) / scale).sum(axis=1)
    blocks = np.array([part.mean() for part in np.array_split(difference, _BLOCKS)])
    error = float(np.std(blocks, ddof=1)) / np.sqrt(len(blocks))
    return float(blocks.mean()) / error if error > 0.0 else 0.0
