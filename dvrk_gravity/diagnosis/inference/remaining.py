"""What remains beside selected effects: unexplained structure or error, and minor effects.

Structure is any smooth function of the state; effects that it refutes are dropped. Error beyond
noise that no such function explains remains, too. Minor effects
are significant, and expected: smaller than the model's known error, of which they may be a part, or
present at calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.inference.alternatives import SelectedEffect
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.fit_context import FitContext
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.inference.recurring_misfit import AtCalibration
from dvrk_gravity.diagnosis.inference.selection import SELECTION, EffectTrial, Selection
from dvrk_gravity.diagnosis.inference.significance import Significance
from dvrk_gravity.effects import unexplained_hypotheses

_AT_FLOOR = 1.05  # times the noise: nothing worth finding is left. Chosen
_MOST_FUNCTIONS = 3  # functions: a bound on time
# Of an effect's torque that an unexplained one beside it must have to make its name uncertain. Less
# is another error of a model that is never complete. Chosen: drag that differs by 60 % over a range
# is beyond (test/test_diagnose_quiet.py).
_DOUBTFUL = 1.0 / 3.0
_REFUTED = 0.5  # of a function's gain: effects that gain less do not fit. Chosen
_MOST_MINOR = 3  # effects, one a joint. Chosen
ABOVE = 2.5  # times the noise, or the model's known error: more is structure, if it lasts. Chosen
_FAR_ABOVE = 5.0  # times likewise: more cannot be noise, of whatever colour. Chosen
# Times likewise, twice as many of what may be noise, that no day-to-day friction variation excuses.
# Chosen: joints of real arms leave less, days later; drag that depends on two positions left 22
# times of it, and passed as expected.
_NEVER_EXPECTED = 8.0
_LASTING = 0.6  # of an error that lasts as long as a motion does, and noise does not. Chosen


# Part of a joint's error that such a function must remove: three times what an effect must on
# held-out blocks (``JudgementSettings``), for it has more parameters. Chosen.
_LEAST = 0.09


def unexplained_structure(
    selection: Selection, selected: list[SelectedEffect], floor: Array
) -> tuple[list[SelectedEffect], list[EffectTrial]]:
    """Return the selected effects that are not refuted, and the structure that none explains.

    Args:
        selection: The model selection.
        selected: The effects it selected.
        floor: (n,) noise, N·m.
    """
    data = selection.validation.data
    named = selection.at([effect.trial.candidate for effect in selected], final=True)
    # Not clean where the floor is unknown.
    clean = named.score.rms <= _AT_FLOOR * floor
    joints = np.flatnonzero(data.motion.present & ~clean).tolist()
    pool = list(data.candidates(unexplained_hypotheses(data.motion, joints)))
    unknown, beside_all, context = list[EffectTrial](), list[EffectTrial](), named
    while len(unknown) < _MOST_FUNCTIONS:
        best = selection.best(context, pool)
        significant = [trial for trial in best if trial.passes and not trial.day_to_day]
        beside_all = beside_all if unknown else significant
        strong = [
            trial
            for trial in significant
            if trial.removed > _LEAST and np.any(trial.size > data.expectation.day_to_day_error)
        ]
        if not strong:
            break
        unknown.append(strong[0])
        context = selection.at(context.extended(strong[0].candidate).candidates, final=True)
    held_out = HeldOut(context.validation)
    unknown = [
        trial
        for trial in unknown
        if not held_out.unconfirmed([*named.candidates, trial.candidate], [trial.candidate])
    ]
    for trial in unknown:
        refuted = [each for each in named.candidates if _refuted(named, each, trial.candidate)]
        for candidate in refuted:
            named = named.without(candidate)
    kept = {id(candidate) for candidate in named.candidates}
    return [
        replace(effect, doubt=_doubt(selection, named, effect.trial, pool, beside_all))
        for effect in selected
        if id(effect.trial.candidate) in kept
    ], unknown


def _doubt(
    selection: Selection, named: FitContext, effect: EffectTrial,
    pool: Sequence[Candidate], beside_all: Sequence[EffectTrial],
) -> tuple[str, str]:  # fmt: skip
    """Return why an effect is not certain, and what to record; empty if no alternative stands up.

    The omnibus alternative is any smooth function of the state. It stands up if it is significant
    beside all effects at a joint of this one, with a good part of this one's torque, or does better
    in its place, the cost of its parameters included.

    Args:
        selection: The model selection.
        named: All effects.
        effect: The effect in question.
        pool: The functions.
        beside_all: Those of them that are significant beside all effects.
    """
    candidate = effect.candidate
    joints = candidate.hypothesis.joints
    for trial in beside_all:
        function = trial.candidate.hypothesis
        if function.joints[0] in joints and _torque(trial) > _DOUBTFUL * _torque_before(effect):
            of, where = function.words()["what"], function.names[0]
            why = f"beside it an error of {where} remains that depends on {of}"
            return why, function.remedy(carried=False)
    functions = [each for each in pool if each.hypothesis.joints[0] in joints]
    if selection.fixed(candidate) or not functions:
        return "", ""
    rest = named.without(candidate)
    current = selection.evaluate(rest, candidate)
    least = current.gain + selection.settings.equal_least * current.inflation
    better = [trial for trial in selection.best(rest, functions) if trial.gain > least]
    if not better:
        return "", ""
    function = better[0].candidate.hypothesis
    of = function.words()["what"]
    why = f"any smooth function of {of} explains unseen blocks better"
    return why, function.remedy(carried=False)


def _torque(trial: EffectTrial) -> float:
    """Return the RMS torque that a function explains, in units of the error without it.

    By the error that it removes: its own parameters may be ill-conditioned.
    """
    return float(np.sqrt(1.0 - (1.0 - trial.removed) ** 2))


def _torque_before(effect: EffectTrial) -> float:
    """Return the RMS torque that an effect explains, in units of the error left with it."""
    return _torque(effect) / max(1.0 - effect.removed, 1e-9)


def _refuted(named: FitContext, candidate: Candidate, function: Candidate) -> bool:
    """Return whether an arbitrary function does so much better that an effect does not fit."""
    if not set(candidate.hypothesis.joints) & set(function.hypothesis.joints):
        return False
    rest = named.without(candidate)
    without = rest.score.likelihood
    gain = named.score.likelihood - without
    return gain < _REFUTED * (rest.extended(function).score.likelihood - without)


def unexplained_joints(
    validation: CrossValidation, causes: Sequence[Candidate], unknown: Sequence[EffectTrial],
    floor: Array,
) -> tuple[int, ...]:  # fmt: skip
    """Return joints whose error is beyond noise, and that no other unknown structure names.

    Args:
        validation: The samples.
        causes: The selected effects, day-to-day variation included.
        unknown: Structure that no effect explains.
        floor: (n,) noise, N·m.
    """
    data, held_out = validation.data, HeldOut(validation)
    error = held_out.error(causes)
    # Out of fold as well: the edge of a push may lie in a held-out block.
    rms = np.minimum(held_out.rmse(error), validation.score(causes).rms)
    # A floor from high frequencies assumes white noise; one from repetition need not.
    white = (data.noise_source(floor) != "repetition") & ~(held_out.lasting(error) > _LASTING)
    likely = np.fmax(floor, proven_error(data))
    uncertainty = data.motion.model.uncertainty
    if uncertainty is not None:
        # Day-to-day friction variation is fitted, but not whatever else changed: a PSM's wrist.
        most = _NEVER_EXPECTED / ABOVE * likely
        likely = np.fmin(np.fmax(likely, data.expectation.day_to_day_error), most)
        # At an unloaded joint of a file nothing is expected, nor is noise known.
        likely[np.isnan(floor) & np.isnan(uncertainty.error)] = np.nan
    named = {joint for trial in unknown for joint in trial.candidate.hypothesis.joints}
    large = np.flatnonzero(rms > np.where(white, _FAR_ABOVE, ABOVE) * likely).tolist()
    return tuple(joint for joint in large if joint not in named)


def proven_error(data: FilteredData) -> Array:
    """Return (n,) RMS error that is expected of what the fit leaves on held-out samples, N·m.

    An identified model's error at calibration alone: its uncertain parameters have been fitted, at
    the cost of their prior, and would count twice. A file's model has no calibration; NaN of a
    model without uncertainty.
    """
    known = data.motion.model.uncertainty
    if known is None or data.motion.model.of_file:
        return expected_error(data)
    return np.asarray(known.error)


def expected_error(data: FilteredData) -> Array:
    """Return (n,) RMS error that a model expects of itself on held-out samples, N·m.

    From its error at calibration, day-to-day friction variation, and its parameters' posterior; NaN
    of a model without uncertainty.
    """
    if data.motion.model.uncertainty is None:
        return np.full(data.motion.arm.n, np.nan)
    usable = data.usable[data.held_out]
    variance = (data.model_columns[data.held_out] ** 2).sum(axis=2)
    variance = np.minimum(variance, data.motion.arm.effort_limit**2)
    mean = np.where(usable, variance, 0.0).sum(axis=0) / np.maximum(usable.sum(axis=0), 1)
    return np.sqrt(data.expectation.day_to_day_error**2 + mean)


def minor_effects(
    validation: CrossValidation,
    pool: Sequence[Candidate],
    selected: Sequence[SelectedEffect],
    unknown: Sequence[EffectTrial],
    at_calibration: AtCalibration | None,
) -> list[EffectTrial]:
    """Return what is significant beside the findings, and expected: not reported as a finding.

    It is less than the model's known error, of which, too, it may be a part: what the model is
    known to miss has causes as well; or there was as much of it when the model was identified.

    Args:
        validation: What compares hypotheses.
        pool: Those that need no search.
        selected: Named findings.
        unknown: Structure without a name.
        at_calibration: What was there when the model was identified.
    """
    if not validation.known_error.any():
        return []
    lenient = replace(validation.significance.settings, least=0.0)
    significance = Significance(validation.data, lenient)
    validation = replace(validation, significance=significance)
    chosen = [effect.trial.candidate for effect in selected]
    chosen += [trial.candidate for trial in unknown]
    settings = replace(SELECTION, consequence=0.0, day_to_day=0.0, share=0.0)
    selection = Selection(
        validation, pool, lambda line: None, settings=settings, at_calibration=at_calibration
    )
    context = selection.at(chosen)
    # What is more was a finding, had held-out blocks confirmed it.
    most = SELECTION.least(validation)
    minor: list[EffectTrial] = []
    trials = selection.best(context)
    for_all = [trial for trial in trials if _is_minor(trial, most)][:1]
    if for_all and for_all[0].candidate.hypothesis.common_cause:
        # One for all joints: others are listed as far as they differ from it.
        trials = selection.best(context.extended(for_all[0].candidate))
        minor += for_all
    joints: set[int] = set()
    for trial in trials:
        own = trial.candidate.hypothesis.joints
        if _is_minor(trial, most) and joints.isdisjoint(own):
            minor.append(trial)
            joints.update(own)
    return minor[:_MOST_MINOR]


def _is_minor(trial: EffectTrial, most: Array) -> bool:
    """Return whether a trial is of something, and no finding."""
    return (trial.passes and not np.any(trial.size > most)) or trial.seen_before
