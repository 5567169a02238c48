"""What could have been seen: the smallest change of each kind that would have been found.

A change of size s that nobody knows of adds s² D² to a joint's mean squared error E², with D the
RMS torque per unit that neither the model's own parameters nor the other effects make up for; these
parameters move by s u, at their prior's cost. Both are evidence. By the likelihood, thresholds and
multiplicity of selection and confirmation it has to be so much that noise, which makes twice the
evidence a non-central chi-square, leaves less than the threshold in one of twenty recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import groupby

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.fit_context import FitContext
from dvrk_gravity.diagnosis.inference.held_out import JUDGEMENT, HeldOut
from dvrk_gravity.diagnosis.inference.selection import SELECTION
from dvrk_gravity.diagnosis.inference.significance import Multiplicity, Significance

POWER = 0.95
"""Part of the recordings in which a change of that size is found. A convention."""

_BELOW = 1.645  # standard errors: one normal estimate in twenty is lower by more
_DOUBLINGS = 40  # of a size that is within its own error: what is larger then, is not visible
_HALVINGS = 6  # of the interval that holds a size: to a hundredth of it. Chosen


@dataclass(frozen=True)
class Detectable:
    """The smallest change of one kind that would have been found.

    Attributes:
        effect: Name of the effect.
        joint: Name of the joint; ``""``: of the arm.
        parameter: Name of the parameter that changes.
        size: By how much, SI; infinite if no change that is possible would.
        unit: Its unit.
    """

    effect: str
    joint: str
    parameter: str
    size: float
    unit: str


def detectable(
    context: FitContext, pool: Sequence[Candidate], multiplicity: Multiplicity
) -> tuple[Detectable, ...]:
    """Return what would have been found in :data:`POWER` of such recordings, site by site.

    Args:
        context: The effects that were found, with the samples.
        pool: Hypotheses whose columns are there already.
        multiplicity: Of how many torques one had to be the best.
    """
    validation = context.validation
    there = {(each.hypothesis.key, each.size): each for each in pool}
    asked = list[tuple[Candidate, Array]]()
    for effect in effects.effects():
        for hypothesis, theta in effect.unit_changes(validation.data.motion):
            candidate = there.get((hypothesis.key, len(theta)))
            if candidate is None or candidate.hypothesis.setting != hypothesis.setting:
                candidate = validation.data.candidate(hypothesis)
            asked.append((candidate, theta))
    held_out = HeldOut(validation).samples / max(len(validation.choice.rows), 1)
    needed = cache(partial(_needed, validation.significance))
    found = dict[tuple[str, str], Detectable]()
    for (candidate, theta), (left, moved) in zip(asked, _seen(context, asked), strict=True):
        hypothesis = candidate.hypothesis
        key = hypothesis.effect, hypothesis.names[0] if hypothesis.of_joint else ""
        gains = (needed(candidate.size, n) for n in (multiplicity.n_comparisons(candidate), 1))
        size = _smallest(context, candidate, theta, left, moved, held_out, *gains)
        if key not in found or size > found[key].size:  # the direction that shows least
            parameter = next(iter(hypothesis.parameters(theta)))
            found[key] = Detectable(*key, parameter, size, hypothesis.unit(parameter))
    return tuple(found.values())


def _seen(
    context: FitContext, asked: Sequence[tuple[Candidate, Array]]
) -> Iterator[tuple[Array, Array]]:
    """Yield of each change what a fit of the model and of the effects that were found leaves of it.

    Itself excepted, if it was found: (R, n) torque, N·m, scaled so that its mean over all samples
    is that over the usable ones, and the (d,) parameters of the model, in standard deviations.
    """
    validation, weight = context.validation, context.validation.weight
    there = {(each.hypothesis.effect, each.hypothesis.joints) for each in context.candidates}

    def kind(pair: tuple[Candidate, Array]) -> tuple[str, tuple[int, ...]]:
        key = pair[0].hypothesis.effect, pair[0].hypothesis.joints
        return key if key in there else ("", ())

    for found, pairs in groupby(asked, kind):
        rest = [
            each
            for each in context.candidates
            if (each.hypothesis.effect, each.hypothesis.joints) != found
        ]
        torque = np.stack([validation.torque(*pair) for pair in pairs], axis=2)
        regression = validation.regression(rest)
        target = (torque * weight[:, None]).reshape(-1, torque.shape[2])
        theta = regression.coefficients(target)
        left = (target - regression.design @ theta).reshape(torque.shape)
        scale = np.sqrt(len(left) / validation.choice.counts) / np.where(weight > 0.0, weight, 1.0)
        left = left * scale[:, None]
        moved = theta[: validation.model_size]
        yield from ((left[:, :, i], moved[:, i]) for i in range(torque.shape[2]))


def _smallest(
    context: FitContext, candidate: Candidate, theta: Array, left: Array, moved: Array,
    held_out: float, among: float, alone: float,
) -> float:  # fmt: skip
    """Return the least multiple of (k,) parameters that is found; infinite: none is.

    Args:
        context: The effects beside it, with the samples.
        candidate: The hypothesis.
        theta: The parameters.
        left: (R, n) what of their torque is not made up for, N·m.
        moved: (d,) by how much that moves the model's parameters, in standard deviations.
        held_out: Samples that are held out, over those of the choice.
        among: Gain that selection needs, see :func:`_needed`.
        alone: ... and that confirmation needs.
    """
    validation = context.validation
    rms = validation.size(candidate, theta)
    judged = (validation.weight > 0.0) & (rms > 0.0)
    if not judged.any():
        return np.inf
    added, cost = np.mean(left**2, axis=0), 0.5 * float(moved @ moved)
    known = context.score.rms**2
    samples = validation.samples / validation.inflation(context.score.error, left * judged)
    samples = np.where(validation.weight > 0.0, samples, 0.0)
    counted = np.array([samples, held_out * samples])
    least = SELECTION.least(validation, context.friction.uncertain)
    significance = validation.significance

    def is_significant(size: float) -> bool:
        with_it = known + size**2 * added
        removed = 1.0 - np.sqrt(known / np.maximum(with_it, 1e-300))
        if not np.any(removed[judged] > JUDGEMENT.least_removed):
            return False
        gain, confirmed = significance.gain(with_it, known, counted).sum(axis=1).tolist()
        enough = gain + significance.of_model(size**2 * cost) >= among and confirmed >= alone
        return enough and bool(np.any((size - scatter) * rms[judged] >= least[judged]))

    def is_found(size: float) -> bool:
        torque = (size - scatter) * validation.torque(candidate, theta)
        expected = context.friction.explains(candidate.hypothesis.effect, torque)
        matters = judged & ((size - scatter) * rms >= least)
        unexpected = not expected.any() or bool(np.any(matters & ~expected))
        return unexpected and is_significant(size)

    variance = np.maximum(np.maximum(known, validation.known_error**2), 1e-300)
    scatter = _BELOW / np.sqrt(max(float(samples @ (added / variance)) + 2.0 * cost, 1e-300))
    size = _least(is_significant, scatter)
    if np.isfinite(size) and not is_found(size):  # as friction changes from day to day
        size = _least(is_found, size)
    possible = np.isfinite(size) and candidate.hypothesis.plausible(size * theta)
    return size if possible else np.inf


def _needed(significance: Significance, parameters: int, comparisons: int) -> float:
    """Return the gain by some parameters of which noise leaves enough.

    Twice a gain that is exactly significant is the 5 % point of the chi-square whose
    non-centrality is twice this one.
    """
    from scipy.special import chndtrinc

    def passes(gain: float) -> bool:
        p_value = significance.p_value(np.zeros(0), gain, parameters, comparisons)
        return p_value < SELECTION.alpha

    return 0.5 * float(chndtrinc(2.0 * _least(passes, 1.0), parameters, 1.0 - POWER))


def _least(passes: Callable[[float], bool], start: float) -> float:
    """Return the least value that passes, as all above it do; infinite: none is found."""
    low, high = 0.0, start
    for _ in range(_DOUBLINGS):
        if passes(high):
            break
        low, high = high, 2.0 * high
    else:
        return np.inf
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if passes(middle) else (middle, high)
    return high
