"""Which hypotheses could take the places of selected effects, once all of them are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.nonlinear import refined
from dvrk_gravity.diagnosis.inference.selection import EffectTrial, Selection
from dvrk_gravity.estimation import Regression

_FEW = 4  # effects, up to which one is looked for that takes the places of two: a bound on time
_OVERLAP = 0.5  # of a torque, that another must reproduce to stand in its place. Chosen
_REJECTED = 8  # alternatives that are shown though they are worse

_CONTAINED = 1e-3  # of a torque, that may lie outside another's columns. Chosen


@dataclass(frozen=True, eq=False)
class SelectedEffect:
    """A selected hypothesis with those that could stand in its place.

    Attributes:
        trial: How it did beside all other selected ones.
        alternatives: Others in its place, best first, that the data cannot separate from it.
        rejected: Others in its place, best first, that are worse.
        doubt: Why it is not certain, and what to record instead; empty: nothing speaks against it.
    """

    trial: EffectTrial
    alternatives: tuple[EffectTrial, ...]
    rejected: tuple[EffectTrial, ...]
    doubt: tuple[str, str] = ("", "")


def explained(selection: Selection, selected: Sequence[Candidate]) -> list[SelectedEffect]:
    """Return the selected hypotheses with those that could stand in their places."""
    return [_stand_ins(selection, selected, i) for i in range(len(selected))]


def refine(selection: Selection, selected: list[Candidate]) -> list[Candidate]:
    """Give every place to the most parsimonious of the best for it, the others being known."""
    validation, settings = selection.validation, selection.settings
    for i in range(len(selected)):
        if selected[i] in selection.always:
            continue
        rest = [*selected[:i], *selected[i + 1 :]]
        validation.weigh(validation.out_of_fold(selected))
        moved = refined(validation, selected[i], rest)
        if validation.misfit([*rest, moved]) < validation.misfit(selected):
            selected[i] = moved
        if len(selected) == 1 or selection.fixed(selected[i]):
            continue
        without = validation.score(rest)
        current = selection.evaluate(rest, selected[i], without)
        if current.day_to_day:  # no other cause is looked for in its place
            continue
        alternatives = [trial for trial in selection.best(rest, without) if trial.passes]
        if alternatives:
            # Beside those that came later, what was plausible may be so no more.
            standing = [current] if current.plausible else []
            preferred = selection.preferred([*standing, *alternatives])
            new, old = preferred.candidate, current.candidate
            simpler = new.parameters < old.parameters or preferred.day_to_day
            simpler = simpler or new.hypothesis.effect == old.hypothesis.EXPLAINED_BY
            better = simpler or preferred.gain > current.gain + settings.equal_least
            if (better or not current.plausible) and preferred is not current:
                selection.report(f"{new.hypothesis} instead of {old.hypothesis}")
                selected[i] = new
    return selected


def merge(selection: Selection, selected: list[Candidate]) -> list[Candidate]:
    """Let one hypothesis take the places of two where it explains as well.

    A cause that is named at the wrong joint needs a second one to make up for that. Where many
    causes act, few of them stand for one another, and looking for those takes too long.
    """
    validation, settings = selection.validation, selection.settings
    found = sum(not selection.fixed(candidate) for candidate in selected)
    if not 2 <= found <= _FEW:
        return selected
    for i in range(len(selected)):
        if selection.fixed(selected[i]):
            continue
        rest = [*selected[:i], *selected[i + 1 :]]
        validation.weigh(validation.out_of_fold(selected))
        whole = validation.score(selected).likelihood
        without = validation.score(rest)
        if selection.evaluate(rest, selected[i], without).day_to_day:
            continue
        key = selected[i].hypothesis.key
        alternatives = [
            trial.candidate
            for trial in selection.best(rest, without)
            if trial.passes and trial.candidate.hypothesis.key != key
        ]
        for other in alternatives[: settings.refined]:
            replaced = [*selected[:i], other, *selected[i + 1 :]]
            for second in rest:
                if selection.fixed(second):
                    continue
                smaller = [kept for kept in replaced if kept is not second]
                if validation.score(smaller).likelihood >= whole - settings.equal_least:
                    selection.report(
                        f"{other.hypothesis} instead of {selected[i].hypothesis} "
                        f"and {second.hypothesis}"
                    )
                    return merge(selection, smaller)
    return selected


def _stand_ins(selection: Selection, selected: Sequence[Candidate], i: int) -> SelectedEffect:
    validation, settings = selection.validation, selection.settings
    rest = [*selected[:i], *selected[i + 1 :]]
    validation.weigh(validation.out_of_fold(selected))
    without = validation.score(rest)
    current = selection.evaluate(rest, selected[i], without)
    if current.day_to_day or selection.fixed(selected[i]):
        return SelectedEffect(current, (), ())
    key = selected[i].hypothesis.key
    # Needless parameters make no alternative at the same site, but those that white noise would
    # make needful do. Elsewhere it is another cause: a tilt about an axis, a zero of its joint.
    more, here = current.gain + settings.equal_least, selected[i].hypothesis.site
    alternatives = [
        trial
        for trial in selection.best(rest, without)
        if trial.candidate.hypothesis.key != key
        and trial.gain > 0.0
        and trial.plausible
        and (
            trial.gain > more
            or trial.candidate.hypothesis.site != here
            or not contains(validation, trial.candidate, selected[i], rest)
        )
        and overlap(validation, selected[i], trial.candidate, rest) > _OVERLAP
    ]
    least = current.gain - selection.margin([current])
    equal = tuple(trial for trial in alternatives if trial.gain > least)
    worse = tuple(trial for trial in alternatives if trial.gain <= least)
    return SelectedEffect(current, equal, worse[:_REJECTED])


def contains(
    validation: CrossValidation, larger: Candidate, smaller: Candidate, rest: Sequence[Candidate]
) -> bool:
    """Return whether a larger hypothesis is a smaller one with more parameters."""
    more = larger.size > smaller.size
    return more and overlap(validation, smaller, larger, rest) > 1.0 - _CONTAINED


def spanned(validation: CrossValidation, candidate: Candidate, rest: Sequence[Candidate]) -> bool:
    """Return whether all torques of a hypothesis are such as those of others together."""
    columns = validation.design([candidate])
    left = validation.regression(rest).residual(columns)
    return float(np.sum(left**2)) <= _CONTAINED * float(np.sum(columns**2))


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
