"""The settings of a hypothesis that its torque is not linear in: searched for, and how sure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.effects import Hypothesis, TwoForms


@dataclass(frozen=True)
class RefinementSettings:
    """How settings are searched for.

    Attributes:
        edge_step: s, of the search for an edge: about one kept sample.
        edge_reach: s, likewise: a little more than a block that is held out, see ``BlockSettings``.
        profile: Log-likelihood lost at the ends of a 95 % profile interval: half the 95 % point of
            chi-squared with one degree of freedom.
        steps: Evaluations in the search for a setting. Chosen: a bound on time.
        fixed_points: Rounds in the search for a setting that its own fit tells: it converges
            quadratically, and halves the way where it begins too far. Chosen: a bound on time.
        tolerance: Change of such a setting, of its size, at which the search ends. Chosen.
        products: Log-likelihood that a reading of other causes' torque has to bring: odds of 20 to
            one, "strong" in the scale of Kass and Raftery (1995).
    """

    edge_step: float = 0.03
    edge_reach: float = 0.6
    profile: float = 1.92
    steps: int = 12
    fixed_points: int = 10
    tolerance: float = 1e-3
    products: float = 3.0


def begun(
    validation: CrossValidation, candidate: Candidate, beside: Sequence[Candidate]
) -> Candidate:
    """Return a candidate at the setting that its own fit tells, if it fits better there."""
    if not candidate.hypothesis.refine_first:
        return candidate
    there = refined(validation, candidate, beside)
    better = validation.misfit([*beside, there]) < validation.misfit([*beside, candidate])
    return there if better else candidate


def refined(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate]
) -> Candidate:
    """Return a candidate with its non-linear settings at their best beside the others."""
    settings = RefinementSettings()
    hypothesis = candidate.hypothesis
    if hypothesis.EFFORT_READING:
        return _likeliest_form(validation, candidate, others)
    for _ in range(settings.fixed_points if hypothesis.fixed_point else 0):
        theta = validation.parameters([*others, candidate])
        before, hypothesis = hypothesis.setting, hypothesis.relinearised(theta[-candidate.size :])
        now = {name: hypothesis.setting[name] for name in hypothesis.fixed_point}
        moved = [abs(value - before[name]) for name, value in now.items()]
        size = max(map(abs, now.values()))
        candidate = validation.data.candidate(hypothesis)
        if max(moved) <= settings.tolerance * size:
            break
    for name in hypothesis.refine:
        if name in hypothesis.edges:
            middle = 0.5 * sum(plateau(validation, candidate, others, name))
            candidate = rebuilt(validation, hypothesis, name, middle)
            hypothesis = candidate.hypothesis
            continue
        centre = hypothesis.setting[name]
        low, high = hypothesis.search_range(name, validation.data.motion)

        def cost(value: float, hypothesis: Hypothesis = hypothesis, name: str = name) -> float:
            return validation.misfit([*others, rebuilt(validation, hypothesis, name, value)])

        best = minimize_scalar(
            cost, bounds=(low, high), method="bounded",
            options={"maxiter": settings.steps, "xatol": 1e-3 * (high - low)},
        )  # fmt: skip
        if best.fun < cost(centre):
            candidate = rebuilt(validation, hypothesis, name, float(best.x))
            hypothesis = candidate.hypothesis
    return candidate


def _likeliest_form(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate]
) -> Candidate:
    """Return a reading of what acts in the form that fits better, if it has two.

    Which does, shows at the settings where either is best.
    """
    found = _reading_beside(validation, candidate, others)
    claim = candidate.hypothesis
    form = claim.alternative_form if isinstance(claim, TwoForms) else None
    if form is None:
        return found
    other = _reading_beside(validation, validation.data.candidate(form), others)
    better = validation.misfit([*others, other]) < validation.misfit([*others, found])
    return other if better else found


def _reading_beside(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate]
) -> Candidate:
    """Return a reading of what acts, of the torque of other causes, too, if that fits better.

    Efforts that read a part too much read that of a payload's torque as well, and late ones that of
    friction: products of two causes, which no sum of both holds. Friction that is another one looks
    like a reading, and reads nothing of other causes.
    """
    alone = _read(validation, candidate, others, of_others=False)
    if not others:
        return alone
    whole = _read(validation, candidate, others, of_others=True)
    gain = validation.misfit([*others, alone]) - validation.misfit([*others, whole])
    return whole if gain > RefinementSettings().products else alone


def _read(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate], of_others: bool
) -> Candidate:
    """Return a reading of what the model says that acts, or of other causes' torque, too.

    How large the others are, the fit beside the reading tells; the one is found from the other, by
    turns.
    """
    settings, hypothesis = RefinementSettings(), candidate.hypothesis
    motion = validation.data.motion
    candidate = validation.data.candidate(hypothesis)
    last = np.full(candidate.size, np.inf)
    for _ in range(settings.fixed_points if of_others or hypothesis.fixed_point else 0):
        *fitted, (_, theta) = split(
            [*others, candidate], validation.parameters([*others, candidate])
        )
        if np.abs(theta - last).max() <= settings.tolerance * np.abs(theta).max():
            break
        last = theta
        hypothesis = hypothesis.relinearised(theta)
        # Columns of all samples are large: one cause's at a time.
        beside = np.zeros(motion.q.shape)
        for other, values in fitted if of_others else ():
            cause = other.hypothesis
            if not (cause.EFFORT_READING or cause.refits_model):
                beside += cause.regressor(motion) @ values
        candidate = validation.data.candidate(hypothesis, replace(motion, beside=beside))
    return candidate


def plateau(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate], name: str
) -> tuple[float, float]:
    """Return the times, s, between which an edge explains as well: its 95 % profile interval.

    An edge within a block that is held out may be anywhere in it.
    """
    settings, hypothesis = RefinementSettings(), candidate.hypothesis
    step, reach = settings.edge_step, settings.edge_reach
    grid = hypothesis.setting[name] + np.arange(-reach, reach + 0.5 * step, step)
    costs = np.array(
        [validation.misfit([*others, rebuilt(validation, hypothesis, name, t)]) for t in grid]
    )
    best = int(np.argmin(costs))
    # Only what hangs together with the best.
    outside = np.flatnonzero(costs > costs[best] + settings.profile)
    low = int(outside[outside < best].max(initial=-1)) + 1
    high = int(outside[outside > best].min(initial=len(grid))) - 1
    return float(grid[low]), float(grid[high])


def rebuilt(
    validation: CrossValidation, hypothesis: Hypothesis, name: str, value: float
) -> Candidate:
    """Return a hypothesis with one setting changed."""
    return validation.data.candidate(
        replace(hypothesis, setting={**hypothesis.setting, name: value})
    )
