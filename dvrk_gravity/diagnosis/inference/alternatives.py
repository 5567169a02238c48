"""Which selected effects hold, and which could take their places, once all of them are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.fit_context import FitContext
from dvrk_gravity.diagnosis.inference.held_out import HeldOut, Unconfirmed
from dvrk_gravity.diagnosis.inference.nonlinear import refined, relinearised
from dvrk_gravity.diagnosis.inference.selection import EffectTrial, Selection
from dvrk_gravity.estimation import Regression, eliminate_backward

_OVERLAP = 0.5  # of a torque, that another must reproduce to stand in its place. Chosen
_REJECTED = 8  # alternatives that are shown though they are worse
_ATTEMPTS = 3  # at a choice that held-out blocks confirm: a bound on time
CONTAINED = 1e-3
"""Part of a torque that may lie outside another's columns. Chosen."""


@dataclass(frozen=True, eq=False)
class SelectedEffect:
    """A selected hypothesis with those that could stand in its place.

    Attributes:
        trial: How it did beside all other selected ones.
        alternatives: Others in its place, best first, that the data cannot separate from it.
        rejected: Others in its place, best first, that are worse.
        forms: All further forms of those above, also such as need more parameters than these data
            show: further data may be explained by any.
        doubt: Why it is not certain, and what to record instead; empty: nothing speaks against it.
    """

    trial: EffectTrial
    alternatives: tuple[EffectTrial, ...]
    rejected: tuple[EffectTrial, ...]
    forms: tuple[EffectTrial, ...] = ()
    doubt: tuple[str, str] = ("", "")


def confirmed(
    selection: Selection, chosen: Sequence[Candidate]
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that hold in the end, and those that the held-out blocks do not confirm.

    In the place of one that fails the choice may find a simpler one.

    Args:
        selection: The choice.
        chosen: What it chose.
    """
    unconfirmed: list[Unconfirmed] = []
    for attempt in range(_ATTEMPTS):
        selection.report("comparing alternatives")
        chosen = selection.eliminate_backward(refine(selection, chosen)).candidates
        chosen, failed = _held_out_confirms(selection, chosen)
        unconfirmed += failed
        if not failed or attempt == _ATTEMPTS - 1:
            break
        selection = selection.excluding(effect.hypothesis for effect in failed)
        chosen = selection.run(chosen).candidates
    return list(chosen), unconfirmed


def _held_out_confirms(
    selection: Selection, chosen: Sequence[Candidate]
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that blocks show which no choice had seen, and those that they do not.

    Linearised at the fit: what made up for the product of two others, a tilt and weights that are
    off, is none there.

    Args:
        selection: The choice.
        chosen: What was chosen.
    """
    failed: list[Unconfirmed] = []

    def failing(kept: list[Candidate]) -> list[tuple[float, Candidate]]:
        acting, there = relinearised(selection.validation.weighted(kept), kept)
        held_out, context = HeldOut(acting), FitContext(acting, tuple(there))
        tested = [candidate for candidate in there if not candidate.hypothesis.refits_model]
        found = held_out.unconfirmed(
            there, tested, lambda candidate: selection.is_significant(context, candidate)
        )
        as_chosen = {id(at_fit): candidate for at_fit, candidate in zip(there, kept, strict=True)}
        failures.update({id(as_chosen[id(each)]): failure for failure, each in found})
        return [
            (0.0 if failure.gain is None else failure.gain.relative, as_chosen[id(each)])
            for failure, each in found
        ]

    # The weakest goes first: of two that share one torque, either may hold without the other.
    failures: dict[int, Unconfirmed] = {}
    kept = eliminate_backward(chosen, failing, lambda gone: failed.append(failures[id(gone)]))
    return kept, failed


def with_alternatives(selection: Selection, selected: Sequence[Candidate]) -> list[SelectedEffect]:
    """Return the selected hypotheses with those that could stand in their places."""
    whole = selection.at(selected)
    return [_stand_ins(selection, whole, candidate) for candidate in selected]


def refine(selection: Selection, selected: Sequence[Candidate]) -> list[Candidate]:
    """Give every place to the most parsimonious of the best for it, the others being known."""
    selected, settings = list(selected), selection.settings
    for i in range(len(selected)):
        if selected[i] in selection.always:
            continue
        whole = selection.at(selected)
        rest, validation = whole.without(selected[i]), whole.validation
        moved = refined(validation, selected[i], rest.candidates)
        if validation.misfit([*rest.candidates, moved]) < validation.misfit(selected):
            selected[i] = moved
        if len(selected) == 1 or selection.fixed(selected[i]):
            continue
        current = selection.evaluate(rest, selected[i])
        if current.day_to_day:  # no other cause is looked for in its place
            continue
        alternatives = [trial for trial in selection.best(rest) if trial.passes]
        if alternatives:
            # Beside those that came later, what was plausible may be so no more.
            standing = [current] if current.plausible else []
            preferred = selection.preferred([*standing, *alternatives])
            new, old = preferred.candidate, current.candidate
            simpler = new.parameters < old.parameters or preferred.day_to_day
            simpler = simpler or (
                preferred.typical and new.hypothesis.effect == old.hypothesis.EXPLAINED_BY
            )
            better = simpler or preferred.gain > current.gain + settings.equal_least
            if (better or not current.plausible) and preferred is not current:
                selection.report(f"{new.hypothesis} instead of {old.hypothesis}")
                selected[i] = new
    return selected


def _stand_ins(selection: Selection, whole: FitContext, selected: Candidate) -> SelectedEffect:
    rest, validation = whole.without(selected), whole.validation
    current = selection.evaluate(rest, selected)
    if current.day_to_day or selection.fixed(selected):
        return SelectedEffect(current, (), ())
    # Needless parameters make no alternative at the same site, but those that white noise would
    # make needful do. Elsewhere it is another cause: a tilt about an axis, a zero of its joint.
    more, here = current.gain + selection.settings.equal_least, selected.hypothesis.site
    trials = [
        trial
        for trial in selection.best(rest)
        if trial.candidate.hypothesis.key != selected.hypothesis.key
        and trial.gain > 0.0
        and trial.plausible
    ]
    alternatives = [
        trial
        for trial in trials
        if (
            trial.gain > more
            or trial.candidate.hypothesis.site != here
            or not contains(validation, trial.candidate, selected, rest.candidates)
        )
        and overlap(validation, selected, trial.candidate, rest.candidates) > _OVERLAP
    ]
    equal = tuple(
        trial
        for trial in alternatives
        if selection.as_good(trial, current)
        and validation.evidence(
            whole.candidates, [*rest.candidates, trial.candidate], current.inflation
        )
        <= selection.settings.equal_least
    )
    worse = [trial for trial in alternatives if trial not in equal]
    names = {trial.named for trial in (current, *equal)}
    forms = tuple(trial for trial in trials if trial.named in names and trial not in equal)
    return SelectedEffect(current, equal, tuple(worse[:_REJECTED]), forms)


def contains(
    validation: CrossValidation, larger: Candidate, smaller: Candidate, rest: Sequence[Candidate]
) -> bool:
    """Return whether a larger hypothesis is a smaller one with more parameters."""
    more = larger.size > smaller.size
    return more and overlap(validation, smaller, larger, rest) > 1.0 - CONTAINED


def spanned(validation: CrossValidation, candidate: Candidate, rest: Sequence[Candidate]) -> bool:
    """Return whether all torques of a hypothesis are such as those of others together."""
    columns = validation.design([candidate])
    left = validation.regression(rest).residual(columns)
    return float(np.sum(left**2)) <= CONTAINED * float(np.sum(columns**2))


def overlap(
    validation: CrossValidation, candidate: Candidate, other: Candidate, rest: Sequence[Candidate]
) -> float:
    """Return the part of a hypothesis' torque that another one's columns reproduce.

    Both are taken beside the rest: what that reproduces anyway does not count.
    """
    theta = validation.parameters([*rest, candidate])
    return reproduced(validation, candidate, theta[-candidate.size :], other, rest)[0]


def reproduced(
    validation: CrossValidation,
    candidate: Candidate,
    theta: Array,
    other: Candidate,
    rest: Sequence[Candidate],
) -> tuple[float, Array]:
    """Return which part of a torque another's columns reproduce, and its (k,) parameters there.

    Args:
        validation: The samples.
        candidate: The hypothesis.
        theta: Its parameters.
        other: Another one.
        rest: What both are taken beside.
    """
    base = validation.regression(rest)
    torque = base.residual(validation.design([candidate]) @ theta)
    columns = base.residual(validation.design([other]))
    free = Regression(columns, np.zeros((other.size, other.size)), base.trace)
    found = free.coefficients(torque)
    residual = torque - columns @ found
    return 1.0 - float(residual @ residual) / max(float(torque @ torque), 1e-300), found
