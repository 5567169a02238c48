"""The pipeline of a diagnosis: build the problem, infer what explains it, report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.data.faults import Fault, correct_recordings
from dvrk_gravity.diagnosis.data.loading import load, require_gravity, require_predictable
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.data.reference import compared, model_of, require_moving
from dvrk_gravity.diagnosis.inference.infer import (
    empty_posterior,
    infer,
    silent,
    with_load_elsewhere,
)
from dvrk_gravity.diagnosis.readings.correction import correct_readings
from dvrk_gravity.diagnosis.results.assembly import report
from dvrk_gravity.diagnosis.results.diagnosis import Diagnosis
from dvrk_gravity.effects import ReadingErrors, place_of, require_visible_load
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import (
    check_mass,
    contradiction,
    in_their_unit,
    known_fixed_positions,
    require_newtons,
    stated_coordinates,
    with_held,
    without_known_errors,
)
from dvrk_gravity.recording import (
    Coordinates,
    Given,
    Note,
    Recording,
    about_arm,
    is_duplicate,
    known_coordinates,
    opened,
)


def diagnose(
    recordings: Given | Iterable[Given],
    model: TorqueModel | str | Path | None = None,
    progress: Callable[[str], None] | None = None,
    still: Mapping[str, float] | None = None,
    coordinates: Coordinates | None = None,
    reference: Given | None = None,
    arm: Arm | str | Path | None = None,
    known_payload: float | None = None,
    payload_at: str | None = None,
) -> Diagnosis:
    """Find what a model gets wrong about recordings, confirmed on held-out data.

    Args:
        recordings: One or more trajectories, or sets of static poses, or the paths of their files;
            in joint or actuator coordinates, as each says. Of trajectories longer than ten minutes
            together, stretches are used.
        model: The model under test, or its path; may be left out with a reference.
        progress: Called with one line at every step.
        still: Positions of joints that the recordings do not hold, rad.
        coordinates: Of the recordings; ``None``: detected, and a finding where they are not joint
            coordinates and do not say so.
        reference: A baseline recording of the same motion: findings are what changed since.
        arm: The arm, where there is no model.
        known_payload: Mass that a link carries, kg: the payload found is compared with it.
        payload_at: ``LINK[:X,Y,Z]``, m: a load is there (:func:`effects.place_of`); its mass is
            reported whatever it is. Where a load at another place explains the recordings clearly
            better, that is said, and the findings are with that one.

    Returns:
        Findings, gains on held-out blocks, and the extended model.

    Raises:
        RecordingError: Recordings that show too little: too short, no effort, no motion.
        ConfigError: A model of absurd torques; neither model nor arm, or two arms.
        ArgumentError: An argument of a wrong type.
    """
    if known_payload is not None:
        check_mass(known_payload)
    say = progress or silent
    say("reading")
    motion, faults, errors = build(
        recordings, model, still, coordinates, reference, arm, payload_at
    )
    wrong, hypotheses = correct_readings(motion, say)
    if contradiction(hypotheses.motion.warnings) and not wrong:
        as_stated, elsewhere = empty_posterior(hypotheses), None
    else:
        as_stated = infer(hypotheses, say)
        elsewhere = with_load_elsewhere(as_stated, say)
    say("measuring gains on held-out blocks")
    diagnosis = report(elsewhere or as_stated, faults, wrong, known_payload, errors)
    if elsewhere is not None:
        diagnosis = replace(diagnosis, misplaced=str(payload_at))
    return diagnosis


def build(
    recordings: Given | Iterable[Given],
    model: TorqueModel | str | Path | None = None,
    still: Mapping[str, float] | None = None,
    coordinates: Coordinates | None = None,
    reference: Given | None = None,
    arm: Arm | str | Path | None = None,
    payload_at: str | None = None,
) -> tuple[MeasuredMotion, tuple[Fault, ...], ReadingErrors]:
    """Return what is to be explained; for the arguments see `diagnose`.

    Returns:
        The motion beside the model or the reference; faults of the recordings themselves, which
        were corrected; errors of readings that the model knows, and those faults.
    """
    model = None if model is None else TorqueModel.of(model)
    arm = arm_for(model, None if arm is None else Arm.of(arm), reference is not None)
    place = None if payload_at is None else place_of(arm, payload_at)
    coordinates = known_coordinates(coordinates)
    whole = opened(recordings, coordinates or "joint", arm)
    still = known_fixed_positions(still, arm)
    if not whole:
        raise RecordingError("recordings", "none given, expected at least one")
    tested = model or model_of(arm)
    coordinates = coordinates or stated_coordinates(tested)
    whole, corrected = without_known_errors(whole, tested, coordinates)
    errors = tested.reading_errors
    tested = replace(tested, reading_errors=ReadingErrors.none(arm.n))
    references = [] if reference is None else opened(reference, coordinates or "joint", arm)
    warnings = list[Note]()
    if references:
        references, _ = without_known_errors(
            references, replace(tested, reading_errors=errors), coordinates
        )
        read = correct_recordings(references, tested, coordinates, still)
        # The difference of two recordings that are misread in two ways would look like physics.
        references, coordinates = read.recordings, read.recordings[0].coordinates
        warnings += read.of_reference
    read = correct_recordings(whole, tested, coordinates, still)
    given = None if model is None else tested
    tested, prepared, notes = _prepared(given, arm, read.recordings, still)
    motion = load(prepared, tested, still)
    doubts = tested.arm.warnings if tested.of_file else ()  # an identified model has its own
    motion = replace(
        motion,
        processing_log=(*read.processing_log, *motion.processing_log),
        warnings=(
            *about_arm(doubts),
            *corrected,
            *warnings,
            *read.warnings,
            *notes,
            *motion.warnings,
        ),
    )
    if references:
        motion = _beside_reference(motion, prepared, references[0], tested, still)
    else:
        require_predictable(motion, prepared)
        require_gravity(motion, prepared[0].source)
    if place is not None:
        motion = replace(motion, payload_at=place)
        require_visible_load(motion, str(payload_at))
    joints = [arm.joint_names.index(name) for name in motion.arm.joint_names]
    return motion, read.faults, errors.after(read.errors).at(joints)


def arm_for(model: TorqueModel | None, arm: Arm | None, reference: bool) -> Arm:
    """Return the arm of a diagnosis.

    Args:
        model: The model under test, if there is one.
        arm: The arm, if it is given.
        reference: Whether there is a reference.

    Raises:
        ConfigError: Neither model nor arm, two different arms, or no model and no reference.
    """
    if model is None:
        if not reference:
            raise ConfigError("--model", None, "a model; or --arm with --reference")
        if arm is None:
            raise ConfigError("--arm", None, "the arm, or a --model, with --reference")
        return arm
    if arm is not None and arm.joint_names != model.arm.joint_names:
        its = f"{model.arm.name} with {', '.join(model.arm.joint_names)}"
        raise ConfigError("--arm", arm.name, f"that of the model, {its}, or none")
    return model.arm


def _prepared(
    model: TorqueModel | None,
    arm: Arm,
    recordings: Sequence[Recording],
    still: Mapping[str, float],
) -> tuple[TorqueModel, Sequence[Recording], tuple[Note, ...]]:
    """Return model and recordings in one unit of effort, and notes on that.

    An arm without an identified model may lack joints that were held.
    """
    if model is None:
        arm, recordings, held = with_held(recordings, arm, still)
        arm, unit = in_their_unit(arm, recordings)
        return model_of(arm), [each.of(arm) for each in recordings], (*unit, *held)
    odd = require_newtons(model, recordings)
    if not model.of_file:
        return model, recordings, odd
    arm, recordings, held = with_held(recordings, arm, still)
    return TorqueModel.from_arm(arm), recordings, (*odd, *held)


def _beside_reference(
    motion: MeasuredMotion,
    recordings: Sequence[Recording],
    reference: Recording,
    model: TorqueModel,
    still: Mapping[str, float],
) -> MeasuredMotion:
    """Return what recordings and a reference both show."""
    names = [each.source for each in (recordings[0], reference)]
    for recording in (*recordings, reference):
        require_moving(recording)
    if is_duplicate(reference, recordings):
        raise RecordingError(names[1], "--reference is the recording being diagnosed")
    exact = replace(model, uncertainty=None)  # the model's error is in both recordings
    motion = replace(motion, model=exact)
    return compared(motion, load([reference], model, still), names)
