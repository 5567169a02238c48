"""The diagnosis itself: readings, then physics, then what has no name, then the proof."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.assemble import assemble
from dvrk_gravity.diagnosis.at_calibration import AtCalibration
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.confirmed import at_the_fit, confirmed
from dvrk_gravity.diagnosis.corrected_readings import read_rightly
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.fit_to_judge import require_gravity, require_predictable
from dvrk_gravity.diagnosis.held_out import Unconfirmed
from dvrk_gravity.diagnosis.loading import Loaded, load
from dvrk_gravity.diagnosis.nameless import with_nameless
from dvrk_gravity.diagnosis.no_news import no_news
from dvrk_gravity.diagnosis.overlap import spanned
from dvrk_gravity.diagnosis.places import SelectedEffect, explained
from dvrk_gravity.diagnosis.readings import WrongReading
from dvrk_gravity.diagnosis.recording_faults import put_right
from dvrk_gravity.diagnosis.reference import arm_for, compared, model_of, require_moving
from dvrk_gravity.diagnosis.reference_error import pulling_otherwise, rubbing_otherwise
from dvrk_gravity.diagnosis.result import Diagnosis
from dvrk_gravity.diagnosis.selection import EffectTrial, Selection
from dvrk_gravity.diagnosis.simulation_check import in_simulation
from dvrk_gravity.diagnosis.unstated import unstated
from dvrk_gravity.diagnosis.weighed import weighed
from dvrk_gravity.effects import Kind
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.intake import check_mass, in_their_unit, known_still, require_newtons, with_held
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import (
    Coordinates,
    DataWarning,
    Duplicates,
    Given,
    Recording,
    RecordingFile,
    about_arm,
    known_coordinates,
    opened,
)


@dataclass(frozen=True)
class RunSettings:
    """How the steps of a diagnosis follow each other.

    Attributes:
        doubtful: Times the noise, above which the masses of a model that does not tell how sure it
            is may move along. Chosen.
        moving_gain: Log-likelihood that they must then bring, all costs taken off: what five
            parameters cost. Chosen.
    """

    doubtful: float = 1.5
    moving_gain: float = 20.0


_SETTINGS = RunSettings()


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was selected, before it is put into words.

    Attributes:
        loaded: The motion as it was finally read.
        wrong: Wrong readings found, in the order in which they were put right.
        validation: The validation.
        selected: Named effects in order.
        unknown: Structure without a name.
        unconfirmed: Effects that the held-out blocks do not show.
        minor: Effects that are significant, and smaller than what the model is known to miss.
        other_day: Friction that changed as it does from one day to another: chosen, but no news.
        pool: Hypotheses that need no search.
        at_calibration: What was there when the model was identified.
    """

    loaded: Loaded
    wrong: tuple[WrongReading, ...]
    validation: CrossValidation
    selected: tuple[SelectedEffect, ...]
    unknown: tuple[EffectTrial, ...]
    unconfirmed: tuple[Unconfirmed, ...]
    minor: tuple[EffectTrial, ...]
    other_day: tuple[Candidate, ...]
    pool: tuple[Candidate, ...]
    at_calibration: AtCalibration | None


def diagnose(
    recordings: Given | Iterable[Given],
    model: TorqueModel | str | Path | None = None,
    progress: Callable[[str], None] | None = None,
    simulated: bool = False,
    still: Mapping[str, float] | None = None,
    coordinates: Coordinates | None = None,
    reference: Given | None = None,
    arm: Arm | str | Path | None = None,
    known_payload: float | None = None,
) -> Diagnosis:
    """Tell what a model gets wrong about recordings, and prove it on data held out.

    Args:
        recordings: One or more trajectories, or sets of static poses; in joint or actuator
            coordinates, as each says; or the paths of their files. Of trajectories longer than ten
            minutes together, stretches are looked at; one in a file is not held in memory then.
        model: The model on trial, or the path of its file; may be left out with a reference.
        progress: Called with one line at every step.
        simulated: Also compare given and extended model in the simulator, which takes seconds.
        still: Where joints stood that the recordings do not hold: joint position, rad.
        coordinates: Of the recordings; ``None``: found out (``decide_coordinates``), and a finding
            where they are not the joints' coordinates, nor say so themselves.
        reference: The same motion when all was well: what changed since is told, and the model, if
            there is one, only takes it in.
        arm: The arm, where there is no model.
        known_payload: Mass that a link is said to carry, kg: the payload found is compared with it.

    Returns:
        Findings, gains on held-out blocks, and the model extended by what it can carry.

    Raises:
        RecordingError: Recordings that cannot tell: too short, no effort, no motion.
        ConfigError: A model of absurd torques; neither model nor arm, or two arms.
        ArgumentError: An argument of a wrong type.
    """
    if known_payload is not None:
        check_mass(known_payload)
    model = None if model is None else TorqueModel.of(model)
    arm = arm_for(model, None if arm is None else Arm.of(arm), reference is not None)
    coordinates = known_coordinates(coordinates)
    whole, said = opened(recordings, coordinates or "joint", arm), tuple[str, ...]()
    still = known_still(still, arm)
    if not whole:
        raise RecordingError("recordings", "none given, expected at least one")
    on_trial, beside, other = model or model_of(arm), tuple[DataWarning, ...](), None
    if reference is not None:
        (other,) = opened(reference, coordinates or "joint", arm)
        read = put_right([other], on_trial, coordinates, still)
        # Of two that are misread alike the difference looks like physics.
        (other,), coordinates = read.recordings, read.recordings[0].head.coordinates
        beside = read.of_reference
    right = put_right(whole, on_trial, coordinates, still)
    whole = right.recordings
    if model is None:
        arm, whole, held = with_held(whole, arm, still)
        arm, said = in_their_unit(arm, whole)
        whole, model = [recording.of(arm) for recording in whole], model_of(arm)
        said = (*said, *held)
    else:
        said = require_newtons(model, whole)
        if model.of_file:
            arm, whole, held = with_held(whole, arm, still)
            model, said = TorqueModel.stated(arm), (*said, *held)
    say = progress or _silent
    say("reading")
    loaded = load(whole, model, still)
    doubts = about_arm(arm.doubts if model.of_file else ())  # an identified model has its own
    loaded = replace(
        loaded,
        handling=(*said, *loaded.handling),
        warnings=(*doubts, *beside, *right.warnings, *loaded.warnings),
        faults=right.findings,
    )
    if other is None:
        require_predictable(loaded.motion, whole)
        require_gravity(loaded.motion, whole[0].head.source)
    else:
        loaded = _beside_reference(loaded, whole, other, model, still)
    outcome = investigate(loaded, say)
    say("measuring gains on held-out blocks")
    diagnosis = assemble(
        outcome.loaded, outcome.wrong, outcome.validation, outcome.selected, outcome.unknown,
        outcome.unconfirmed, outcome.minor, outcome.other_day, outcome.pool,
        outcome.at_calibration,
    )  # fmt: skip
    if known_payload is not None:
        diagnosis = replace(
            diagnosis,
            weighed=weighed(diagnosis.findings, known_payload, arm, reference is not None),
        )
    shown = simulated and reference is None
    if not shown or not any(finding.in_model for finding in diagnosis.findings):
        return diagnosis
    say("simulating motion and drift")
    spans = outcome.validation.data.held_out_spans
    compared = in_simulation(model, diagnosis.model, outcome.loaded.motion, spans)
    return replace(diagnosis, in_simulation=compared)


def _beside_reference(
    loaded: Loaded,
    recordings: Sequence[Recording | RecordingFile],
    other: Recording | RecordingFile,
    model: TorqueModel,
    still: Mapping[str, float],
) -> Loaded:
    """Return what recordings and a reference both show."""
    for recording in (*recordings, other):
        require_moving(recording)
    heads = [recording.head for recording in (recordings[0], other)]
    before = Duplicates()
    for recording in (*recordings, other):
        before.read(recording)
    if before.skipped:  # the last of them
        raise RecordingError(heads[1].source, "is what is diagnosed, too: expected another one")
    sure = replace(model, uncertainty=None)  # what it does not know, it does not know in either
    loaded = replace(loaded, motion=replace(loaded.motion, model=sure))
    return compared(loaded, load([other], model, still), [head.source for head in heads])


def investigate(loaded: Loaded, say: Callable[[str], None]) -> Outcome:
    """Choose readings, effects and nameless structure."""
    read = read_rightly(loaded, say)
    loaded, validation, pool = read.loaded, read.validation, read.pool
    # One link before all of them: what every mass together explains is no cause yet.
    sparse = [candidate for candidate in pool if not candidate.hypothesis.refits_model]
    at_calibration = AtCalibration.of(loaded.motion)
    selection = Selection(
        validation, sparse, say, expected=unstated(validation, pool), at_calibration=at_calibration
    )
    say("weighing hypotheses")
    chosen = _from_friction(validation, selection, selection.run(), say)
    floor = validation.data.noise_rms(loaded.floor, validation.residual(chosen))
    # A model that tells how sure it is has been free to move as far as it says, and no further.
    motion = loaded.motion
    telling = motion.model.uncertainty is not None or motion.reference is not None
    if not telling and np.any(validation.score(chosen).rms > _SETTINGS.doubtful * floor):
        selection, chosen = _with_model_moving(validation, pool, selection, chosen, say)
    noise = validation.data.noise_rms(loaded.floor, validation.residual(chosen))
    chosen, unconfirmed = confirmed(selection, chosen, noise)
    # Masses that only moved along are no cause: they come last.
    chosen.sort(key=lambda candidate: candidate.hypothesis.refits_model)
    selected = explained(selection, chosen)
    say("looking for structure without a name")
    floor = validation.data.noise_rms(loaded.floor, validation.residual(chosen))
    validation.release()
    selected, unknown = with_nameless(validation, selection, selected, floor)
    again = _with_changes_told(loaded, validation, selected, say)
    if again is not None:
        return again
    validation, selected, unknown, failed = at_the_fit(selection, selected, unknown, floor)
    unconfirmed += failed
    other_day = [effect.trial.candidate for effect in selected if effect.trial.other_day]
    selected = [effect for effect in selected if not effect.trial.other_day]
    minor = no_news(validation, sparse, selected, unknown, at_calibration)
    return Outcome(loaded, read.wrong, validation, tuple(selected), tuple(unknown),
                   tuple(unconfirmed), tuple(minor), tuple(other_day), tuple(pool),
                   at_calibration)  # fmt: skip


def _from_friction(
    validation: CrossValidation,
    selection: Selection,
    chosen: list[Candidate],
    say: Callable[[str], None],
) -> list[Candidate]:
    """Return the better of a choice with a cause of all joints, and one that begins with friction.

    What one wrong scale of all efforts explains best alone, friction of all joints and a load may
    explain better together, and one at a time nothing leads from the one to the others.
    """
    hypotheses = [candidate.hypothesis for candidate in chosen]
    if not any(each.common_cause and not effects.is_friction(each.effect) for each in hypotheses):
        return chosen
    best, best_likelihood = chosen, validation.score(chosen).likelihood
    for start in selection.pool:
        if start.hypothesis.common_cause and effects.is_friction(start.hypothesis.effect):
            say(f"beginning with {start.hypothesis}")
            other = selection.run([*selection.always, *selection.expected, start])
            likelihood = validation.score(other).likelihood
            if likelihood > best_likelihood:
                best, best_likelihood = other, likelihood
    validation.weigh(validation.out_of_fold(best))
    return best


def _with_changes_told(
    loaded: Loaded,
    validation: CrossValidation,
    selected: Sequence[SelectedEffect],
    say: Callable[[str], None],
) -> Outcome | None:
    """Return the outcome where friction or springs are no other day's; ``None`` if all are."""
    motion = loaded.motion
    if motion.reference is None or motion.rubs_otherwise or motion.pulls_otherwise:
        return None
    named = [effect.trial.candidate for effect in selected]
    mean, covariance = validation.posterior(named)
    rubs = rubbing_otherwise(motion, mean[: validation.model_size])
    pulls = pulling_otherwise(motion, mean, covariance, _of_joints(named, validation.model_size))
    while rubs or pulls:
        say("weighing hypotheses with friction and springs that are others")
        changed = replace(motion, rubs_otherwise=rubs, pulls_otherwise=pulls)
        outcome = investigate(replace(loaded, motion=changed), say)
        hypotheses = [effect.trial.candidate.hypothesis for effect in outcome.selected]
        told = {joint for hypothesis in hypotheses for joint in hypothesis.joints}
        if told.issuperset((*rubs, *pulls)):
            return outcome
        # What no name fits is left to the days, joint by joint.
        rubs, pulls = (
            tuple(joint for joint in joints if joint in told) for joints in (rubs, pulls)
        )
    return None


def _of_joints(named: Sequence[Candidate], first: int) -> dict[int, list[int]]:
    """Return by joint which parameters are of its own and of no friction.

    Args:
        named: Candidates, as they are fitted together.
        first: Number of the first's first parameter.
    """
    found: dict[int, list[int]] = {}
    for candidate in named:
        hypothesis, last = candidate.hypothesis, first + candidate.size
        if hypothesis.site.kind is Kind.JOINT and not effects.is_friction(hypothesis.effect):
            for joint in hypothesis.joints:
                found.setdefault(joint, []).extend(range(first, last))
        first = last
    return found


def _with_model_moving(
    validation: CrossValidation,
    pool: Sequence[Candidate],
    selection: Selection,
    chosen: list[Candidate],
    say: Callable[[str], None],
) -> tuple[Selection, list[Candidate]]:
    """Return the better of a choice and one beside which the model's masses are fitted anew.

    Masses that were fitted without a cause that is missing have made up for it as far as they
    could; only when they move along does the cause get its due.
    """
    say("weighing hypotheses with the model's own parameters moving along")
    always = [candidate for candidate in pool if candidate.hypothesis.refits_model]
    # What links weigh is theirs to say now, and so is the scale of all that they take.
    pool = [
        candidate
        for candidate in pool
        if candidate in always
        or not (
            candidate.hypothesis.site.kind is Kind.LINK or spanned(validation, candidate, always)
        )
    ]
    moving = Selection(validation, pool, say, always)
    other = moving.run()
    validation.weigh(validation.out_of_fold(other))
    whole = validation.score(other).likelihood
    # What the masses overfit shows in the folds that they have not seen: no further cost.
    cost = sum(candidate.cost for candidate in always)
    gain = whole + cost - validation.score(chosen).likelihood
    if gain <= _SETTINGS.moving_gain:
        return selection, chosen
    return moving, other


def _silent(line: str) -> None:
    del line
