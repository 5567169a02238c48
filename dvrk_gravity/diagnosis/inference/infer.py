"""Which effects explain a recording: hypotheses, selection, comparison, confirmation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.expectation import changed_friction, changed_springs
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.alternatives import (
    SelectedEffect,
    confirmed,
    spanned,
    with_alternatives,
)
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.detectable import Detectable, detectable
from dvrk_gravity.diagnosis.inference.fit_context import FitContext
from dvrk_gravity.diagnosis.inference.held_out import Unconfirmed
from dvrk_gravity.diagnosis.inference.nonlinear import begun, relinearised
from dvrk_gravity.diagnosis.inference.recurring_misfit import AtCalibration
from dvrk_gravity.diagnosis.inference.remaining import (
    minor_effects,
    unexplained_joints,
    unexplained_structure,
)
from dvrk_gravity.diagnosis.inference.selection import EffectTrial, Selection
from dvrk_gravity.diagnosis.inference.significance import Multiplicity
from dvrk_gravity.effects import Hypothesis, Kind

_DOUBTFUL = 1.5  # times the noise: then the masses of a model without uncertainty are free. Chosen
_OTHER_ARM = "effects were not looked for: no effect of one arm explains a recording of the other"
_FREE_GAIN = 20.0  # log-likelihood that they must gain, less costs: of five parameters. Chosen


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """The hypotheses about a motion that need no search in its residual.

    Attributes:
        context: The samples, ready for comparisons, with the ordinary effects.
        pool: The hypotheses with their columns.
    """

    context: FitContext
    pool: list[Candidate]

    @property
    def motion(self) -> MeasuredMotion:
        """The motion."""
        return self.context.validation.data.motion

    @classmethod
    def about(cls, motion: MeasuredMotion) -> Hypotheses:
        """Return those about a motion."""
        return cls.of(ordinary_effects(motion))

    @classmethod
    def of(cls, context: FitContext) -> Hypotheses:
        """Return those of the motion of a context."""
        validation = context.validation
        pool = _acting(validation, every_hypothesis(validation.data.motion))
        return cls(context, [begun(validation, each, context.candidates) for each in pool])


def every_hypothesis(motion: MeasuredMotion) -> Iterable[Hypothesis]:
    """Yield every hypothesis that needs no search in the residual."""
    for effect in effects.effects():
        yield from effect.hypotheses(motion)


def _acting(validation: CrossValidation, claims: Iterable[Hypothesis]) -> list[Candidate]:
    """Return hypotheses with their columns, but for those that do nothing in a motion."""
    return [each for each in validation.data.candidates(claims) if each.acts.any()]


def ordinary_effects(motion: MeasuredMotion) -> FitContext:
    """Return the filtered data of a motion, ready for comparisons, with the ordinary effects.

    These are the effects that any joint has and an arm's own file states poorly, of plausible
    size. Where an identified model is tested, only a load that is stated.
    """
    validation = CrossValidation.of(FilteredData.of(motion))
    names = {term.NAME for term in effects.terms() if term.EVERYWHERE} & poorly_stated(motion)
    claims = (each for each in every_hypothesis(motion) if each.STATED or each.effect in names)
    found: dict[tuple[str, tuple[int, ...]], Candidate] = {}
    for candidate in _acting(validation, claims):
        hypothesis = candidate.hypothesis
        if hypothesis.STATED or candidate.size == 1:
            found.setdefault((hypothesis.effect, hypothesis.joints), candidate)
    expected = list(found.values())
    while expected:
        fitted = split(expected, validation.parameters(expected))
        kept = [each for each, theta in fitted if each.hypothesis.plausible(theta)]
        if len(kept) == len(expected):
            break
        expected = kept
    return FitContext(validation, tuple(expected))


def poorly_stated(motion: MeasuredMotion) -> set[str]:
    """Return the effects that an arm's own file states poorly: friction, rotors.

    Its values are often placeholders, such as one damping for all joints.
    """
    if not motion.model.of_file or motion.measured_twice:
        return set()
    return {term.NAME for term in effects.terms() if term.EVERYWHERE or term.FRICTION}


@dataclass(frozen=True, eq=False)
class Posterior:
    """What explains a recording.

    Attributes:
        validation: The samples, linearised at the fit.
        selected: Effects.
        unexplained: Structure that no effect explains.
        unexplained_joints: Joints with error beyond noise at which there is no such structure.
        unconfirmed: Effects that the held-out blocks do not confirm.
        minor: Effects that are significant, and smaller than the model's error at calibration.
        day_to_day: Selected changes of friction within day-to-day variation.
        stated: What is known to be there, and not significant.
        pool: Hypotheses that need no search.
        at_calibration: What the calibration recording shows of the hypotheses.
        floor: (n,) RMS that noise alone leaves, N·m.
        detectable: What would have been found.
    """

    validation: CrossValidation
    selected: tuple[SelectedEffect, ...]
    unexplained: tuple[EffectTrial, ...]
    unexplained_joints: tuple[int, ...]
    unconfirmed: tuple[Unconfirmed, ...]
    minor: tuple[EffectTrial, ...]
    day_to_day: tuple[Candidate, ...]
    stated: tuple[Candidate, ...]
    pool: tuple[Candidate, ...]
    at_calibration: AtCalibration | None
    floor: Array
    detectable: tuple[Detectable, ...]

    @property
    def motion(self) -> MeasuredMotion:
        """The motion as it was finally read."""
        return self.validation.data.motion


def silent(line: str) -> None:
    """Ignore a line of progress."""
    del line


def infer(hypotheses: Hypotheses, say: Callable[[str], None] = silent) -> Posterior:
    """Return what explains a motion, in the samples of selection and confirmed on held-out ones.

    Beside a reference, friction and springs are first taken to vary from day to day. Where the fit
    needs more than that, they are hypotheses like any other. Before causes are known that cannot be
    judged: a weight looks like a spring of the joint that lifts it.

    Args:
        hypotheses: About the motion, beside what is expected of it.
        say: Called with one line at every step.
    """
    posterior = _selected(hypotheses, say)
    friction, springs = _changed_joints(posterior)
    while friction or springs:
        say("comparing hypotheses with changed friction and springs")
        changed = replace(hypotheses.motion, changed_friction=friction, changed_springs=springs)
        beside = _selected(Hypotheses.about(changed), say)
        found = {
            joint
            for effect in beside.selected
            for joint in effect.trial.candidate.hypothesis.joints
        }
        if found.issuperset((*friction, *springs)):
            return beside
        # At joints where no effect fits, the change counts as day-to-day variation.
        friction = tuple(joint for joint in friction if joint in found)
        springs = tuple(joint for joint in springs if joint in found)
    return posterior


def _changed_joints(posterior: Posterior) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return joints whose friction, and whose springs, changed by more than from day to day."""
    motion, validation = posterior.motion, posterior.validation
    if not motion.measured_twice:
        return (), ()
    named = [effect.trial.candidate for effect in posterior.selected]
    mean, covariance = validation.posterior(named)
    causes: dict[int, list[int]] = {}
    first = validation.model_size
    for candidate in named:
        hypothesis, last = candidate.hypothesis, first + candidate.size
        if hypothesis.site.kind is Kind.JOINT and not effects.is_friction(hypothesis.effect):
            for joint in hypothesis.joints:
                causes.setdefault(joint, []).extend(range(first, last))
        first = last
    friction = changed_friction(motion, mean[: validation.model_size])
    return friction, changed_springs(motion, mean, covariance, causes)


def _selected(hypotheses: Hypotheses, say: Callable[[str], None]) -> Posterior:
    """Return effects and unexplained structure that the samples of selection show."""
    validation, pool = hypotheses.context.validation, hypotheses.pool
    data, motion = validation.data, hypotheses.motion
    # Single links first: what the masses of all links explain is not yet a cause.
    sparse = [candidate for candidate in pool if not candidate.hypothesis.refits_model]
    at_calibration = AtCalibration.of(motion)
    selection = Selection(
        validation,
        sparse,
        say,
        ordinary=hypotheses.context.candidates,
        at_calibration=at_calibration,
    )
    say("comparing hypotheses")
    chosen = selection.run()

    def noise(context: FitContext) -> Array:
        return data.noise_rms(motion.noise, context.validation.residual(context.candidates))

    # What may be off in some directions was free in these, and is no further.
    if not validation.model_size and np.any(chosen.score.rms > _DOUBTFUL * noise(chosen)):
        selection, chosen = _with_free_masses(selection, chosen, pool)
    kept, unconfirmed = confirmed(selection, chosen.candidates)
    if unconfirmed:  # nor is it an alternative
        selection = selection.excluding(effect.hypothesis for effect in unconfirmed)
    # Masses that were only free are no cause: they come last.
    kept.sort(key=lambda candidate: candidate.hypothesis.refits_model)
    selected = with_alternatives(selection, kept)
    say("looking for unexplained structure")
    floor = noise(selection.at(kept))
    motion.release()
    selected, unexplained = unexplained_structure(selection, selected, floor)
    return _posterior(
        hypotheses, selection.multiplicity, selected, unexplained, unconfirmed, at_calibration
    )


def empty_posterior(hypotheses: Hypotheses) -> Posterior:
    """Return a posterior without effects, of a recording of the other arm: no effect explains it.

    Args:
        hypotheses: About the motion.
    """
    motion, validation = hypotheses.motion, hypotheses.context.validation
    motion = replace(motion, processing_log=(*motion.processing_log, _OTHER_ARM))
    validation = replace(validation, data=replace(validation.data, motion=motion))
    nothing = Hypotheses(replace(hypotheses.context, validation=validation), [])
    return _posterior(nothing, Multiplicity.of(hypotheses.pool))


def with_load_elsewhere(
    posterior: Posterior, say: Callable[[str], None] = silent
) -> Posterior | None:
    """Return what explains a motion whose load is not where it is stated to be.

    A stated place that is wrong leaves the load's torque to other causes, which are certain: so a
    load anywhere is tried where one at that place is not significant, or not alone.

    Args:
        posterior: What explains it with a load at that place.
        say: Called with one line at every step.

    Returns:
        ``None`` where no place is stated, or the stated one explains it as well.
    """
    motion = posterior.motion
    if motion.payload_at is None or (not posterior.stated and len(posterior.selected) == 1):
        return None
    say("comparing with a load at another place")
    # What changed beside a load at that place need not have.
    anywhere = infer(
        Hypotheses.about(replace(motion, payload_at=None, changed_friction=(), changed_springs=())),
        say,
    )
    named = [effect.trial.candidate for effect in anywhere.selected]
    if not any(isinstance(each.hypothesis, effects.PayloadHypothesis) for each in named):
        return None
    stated = [effect.trial.candidate for effect in posterior.selected]
    gain = anywhere.validation.score(named).likelihood
    gain -= posterior.validation.score(stated).likelihood
    return anywhere if gain > _FREE_GAIN else None


def _posterior(
    hypotheses: Hypotheses, multiplicity: Multiplicity, found: Sequence[SelectedEffect] = (),
    unexplained: Sequence[EffectTrial] = (), unconfirmed: Sequence[Unconfirmed] = (),
    at_calibration: AtCalibration | None = None,
) -> Posterior:  # fmt: skip
    """Return what was found, linearised at the fit, and what is known to be there."""
    pool, named = hypotheses.pool, [effect.trial.candidate for effect in found]
    validation, there = relinearised(hypotheses.context.validation.weighted(named), named)
    selected = [
        replace(effect, trial=replace(effect.trial, move=candidate))
        for effect, candidate in zip(found, there, strict=True)
    ]
    stated = _stated(pool, validation, there)
    day_to_day = [effect.trial.candidate for effect in selected if effect.trial.day_to_day]
    selected = [effect for effect in selected if not effect.trial.day_to_day]
    named = [effect.trial.candidate for effect in selected]
    data = validation.data
    floor = data.noise_rms(data.motion.noise, validation.residual(named))
    joints = unexplained_joints(validation, [*named, *day_to_day], unexplained, floor)
    sparse = [each for each in pool if not (each.hypothesis.refits_model or each.hypothesis.STATED)]
    minor = minor_effects(validation, sparse, selected, unexplained, at_calibration)
    seen = detectable(FitContext(validation, tuple(named)), pool, multiplicity)
    data.release()
    return Posterior(
        validation, tuple(selected), tuple(unexplained), joints, tuple(unconfirmed),
        tuple(minor), tuple(day_to_day), stated, tuple(pool), at_calibration, floor, seen,
    )  # fmt: skip


def _stated(
    pool: Sequence[Candidate], validation: CrossValidation, chosen: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """Return what is known to be there, and was not selected, as it acts beside what was."""
    found = {candidate.hypothesis.key for candidate in chosen}
    return tuple(
        validation.data.candidate(candidate.hypothesis)
        for candidate in pool
        if candidate.hypothesis.STATED and candidate.hypothesis.key not in found
    )


def _with_free_masses(
    selection: Selection, chosen: FitContext, pool: Sequence[Candidate]
) -> tuple[Selection, FitContext]:
    """Return the better of a selection and one with the model's masses fitted as well.

    Masses that were fitted while a cause was missing have absorbed part of it, which shows only
    when they are free.
    """
    selection.report("comparing hypotheses with the model's own parameters free")
    always = [candidate for candidate in pool if candidate.hypothesis.refits_model]
    # The masses take the place of all causes at links, and of scales that they span.
    pool = [
        candidate
        for candidate in pool
        if candidate in always
        or not (
            candidate.hypothesis.site.kind is Kind.LINK
            or spanned(chosen.validation, candidate, always)
        )
    ]
    free = Selection(selection.validation, pool, selection.report, always)
    other = free.run()
    # Cross-validation already charges for what the masses overfit.
    cost = sum(candidate.cost for candidate in always)
    gain = other.score.likelihood + cost - chosen.score.likelihood
    return (free, other) if gain > _FREE_GAIN else (selection, chosen)
