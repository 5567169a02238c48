"""What hypotheses are not linear in: searched settings, the model's product with a cause, slopes.

Secants: the columns of a cause that is not linear, times the parameters at which they were built,
are its whole torque. Least squares of secants leave a residual that is orthogonal to them, and not
to the slope of the torque, as at its minimum it has to be: a delay looks shorter than it is. Steps
along the slopes (Gauss and Newton) from the parameters of the secants correct that.

Products: in a tilted base weights have other torques than in a level one. What a calibration left
open between weights and springs shows there. Linearised again at the fit, it is in values and
intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.effects import ChangesModelTorque, Hypothesis, OwnTangent, TwoForms

EDGE_STEP = 0.03  # s, of the search for an edge: about one kept sample
_EDGE_REACH = 0.6  # s, likewise: a little more than a block that is held out, see ``BlockSettings``
# Log-likelihood lost at the ends of a 95 % profile interval: half the 95 % point of chi-squared
# with one degree of freedom.
_PROFILE = 1.92
_STEPS = 12  # evaluations in the search for a setting. Chosen: a bound on time
_RESOLUTION = 1e-3  # of the range in which it is searched, to which it is found. Chosen
# Rounds in the search for a setting that a fit itself determines: it converges quadratically, and
# halves the way where it begins too far. Chosen: a bound on time.
_FIXED_POINTS = 10
_TOLERANCE = 1e-3  # change of such a setting, of its size, at which the search ends. Chosen
# Log-likelihood that a reading of other causes' torque has to bring: odds of 20 to one, "strong" in
# the scale of Kass and Raftery (1995).
_PRODUCTS = 3.0

_ROUNDS = 4  # of linearising model and cause again: a bound on time
_SETTLED = 3e-3  # change of the cause's parameters, of their size, at which they end. Chosen

_SLOPE_ROUNDS = 3  # one is enough where a secant is nearly a slope. Chosen: a bound on time
# Of central differences, of the largest parameter. Chosen: their error grows with its square.
_SLOPE_STEP = 0.02


def begun(
    validation: CrossValidation, candidate: Candidate, beside: Sequence[Candidate]
) -> Candidate:
    """Return a candidate at the setting that its own fit determines, if it fits better there."""
    if not candidate.hypothesis.refine_first:
        return candidate
    there = refined(validation, candidate, beside)
    better = validation.misfit([*beside, there]) < validation.misfit([*beside, candidate])
    return there if better else candidate


def refined(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate]
) -> Candidate:
    """Return a candidate with its non-linear settings at their best beside the others.

    Where the best ones are not plausible, at the nearest likely ones.
    """
    hypothesis = candidate.hypothesis
    if hypothesis.EFFORT_READING:
        return _likeliest_form(validation, candidate, others)
    if hypothesis.unclamped is not hypothesis:
        hypothesis = hypothesis.unclamped
        candidate = validation.data.candidate(hypothesis)
    for _ in range(_FIXED_POINTS if hypothesis.fixed_point else 0):
        theta = validation.parameters([*others, candidate])
        before, hypothesis = hypothesis.setting, hypothesis.relinearised(theta[-candidate.size :])
        now = {name: hypothesis.setting[name] for name in hypothesis.fixed_point}
        moved = [abs(value - before[name]) for name, value in now.items()]
        size = max(map(abs, now.values()))
        candidate = validation.data.candidate(hypothesis)
        if max(moved) <= _TOLERANCE * size:
            break
    if hypothesis.fixed_point:
        theta = validation.parameters([*others, candidate])
        likely = candidate.hypothesis.clamped(theta[-candidate.size :])
        if likely is not None:
            candidate = validation.data.candidate(likely)
    for name in candidate.hypothesis.refine:
        if name in candidate.hypothesis.edges:
            middle = 0.5 * sum(plateau(validation, candidate, others, name))
            candidate = rebuilt(validation, candidate.hypothesis, name, middle)
        else:
            candidate = _searched(validation, candidate, others, name)
    return candidate


def _searched(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate], name: str
) -> Candidate:
    """Return a candidate with one setting at its best in the range to search, if better there."""
    from scipy.optimize import minimize_scalar  # slow to load

    hypothesis = candidate.hypothesis
    low, high = hypothesis.search_range(name, validation.data.motion)

    def at(part: float) -> Candidate:
        return rebuilt(validation, hypothesis, name, float(low + part * (high - low)))

    best = minimize_scalar(
        lambda part: validation.misfit([*others, at(part)]),
        bounds=(0.0, 1.0), method="bounded", options={"maxiter": _STEPS, "xatol": _RESOLUTION},
    )  # fmt: skip
    return at(best.x) if best.fun < validation.misfit([*others, candidate]) else candidate


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
    return whole if gain > _PRODUCTS else alone


def _read(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate], of_others: bool
) -> Candidate:
    """Return a reading of what the model says that acts, or of other causes' torque, too.

    The fit beside the reading determines how large the others are; the two alternate.
    """
    hypothesis = replace(candidate.hypothesis, reads_others=of_others)
    motion = validation.data.motion
    candidate = validation.data.candidate(hypothesis)
    last = np.full(candidate.size, np.inf)
    for _ in range(_FIXED_POINTS if of_others or hypothesis.fixed_point else 0):
        *fitted, (_, theta) = split(
            [*others, candidate], validation.parameters([*others, candidate])
        )
        if np.abs(theta - last).max() <= _TOLERANCE * np.abs(theta).max():
            break
        last = theta
        hypothesis = hypothesis.relinearised(theta)
        # Columns of all samples are large: one cause's at a time.
        beside = np.zeros(motion.q.shape)
        for other, values in fitted if of_others else ():
            cause = other.hypothesis
            if not (cause.EFFORT_READING or cause.refits_model):
                beside += cause.regressor(motion) @ values
        candidate = validation.data.candidate(hypothesis, replace(motion, known_torque=beside))
    return candidate


def plateau(
    validation: CrossValidation, candidate: Candidate, others: Sequence[Candidate], name: str
) -> tuple[float, float]:
    """Return the times, s, between which an edge explains as well: its 95 % profile interval.

    An edge within a block that is held out may be anywhere in it.
    """
    hypothesis = candidate.hypothesis
    step, reach = EDGE_STEP, _EDGE_REACH
    grid = hypothesis.setting[name] + np.arange(-reach, reach + 0.5 * step, step)
    costs = np.array(
        [validation.misfit([*others, rebuilt(validation, hypothesis, name, t)]) for t in grid]
    )
    best = int(np.argmin(costs))
    # Only the interval that contains the best.
    outside = np.flatnonzero(costs > costs[best] + _PROFILE)
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


def relinearised(
    validation: CrossValidation, chosen: Sequence[Candidate]
) -> tuple[CrossValidation, list[Candidate]]:
    """Return a validation in which the model's parameters act beside what was chosen, and that.

    The same where nothing that was chosen changes what they do.
    """
    data, result = validation.data, list(chosen)
    motion, uncertainty = data.motion, data.motion.model.uncertainty
    if uncertainty is None:
        return validation, result
    last: Array | None = None
    for _ in range(_ROUNDS):
        own_parameters, theta = validation.solution(result)
        acting, at = motion.model, {}
        for i, (candidate, values) in enumerate(split(result, theta)):
            claim = candidate.hypothesis
            if isinstance(claim, ChangesModelTorque):
                acting, at[i] = claim.applied_to(acting, values), values
        if not at:
            break
        now = np.concatenate(list(at.values()))
        if last is not None and np.abs(now - last).max() <= _SETTLED * np.abs(now).max():
            break
        last = now
        # After them comes what no term has, on which no cause acts.
        terms = uncertainty.shift_terms(motion.model.terms, own_parameters[: uncertainty.size])
        moved = replace(motion, model=replace(motion.model, terms=terms))
        beside = replace(motion, model=acting)
        acting_data = data.relinearised(beside, own_parameters)
        for i, hypothesis in enumerate(candidate.hypothesis for candidate in result):
            if i in at:
                result[i] = acting_data.candidate(hypothesis.relinearised(at[i]), moved)
            elif not hypothesis.EFFORT_READING:
                # A payload weighs in the base as it leans, too; readings have what acts already.
                result[i] = acting_data.candidate(hypothesis, beside)
        validation = CrossValidation.of(acting_data).weighted(result)
    return validation, result


def tangents(
    validation: CrossValidation, chosen: Sequence[Candidate]
) -> tuple[CrossValidation, list[Candidate]]:
    """Return a validation in which causes act along their slopes at the fit, and these causes.

    A fit to that yields the parameters of nonlinear least squares; what it leaves is not measured.
    The same where all that was chosen is linear.
    """
    data, found = validation.data, validation.parameters(chosen)
    if not any(candidate.hypothesis.fixed_point for candidate in chosen):
        return validation, list(chosen)
    for _ in range(_SLOPE_ROUNDS):
        curved, result = data.residual, list(chosen)
        for i, (candidate, theta) in enumerate(split(chosen, found)):
            if candidate.hypothesis.fixed_point and theta.any():
                bend, torque = _bend(data, candidate, theta)
                curved = curved + bend @ theta - torque
                result[i] = Candidate.of(candidate.hypothesis, candidate.columns() + bend)
        there = replace(
            CrossValidation.of(replace(data, residual=curved)),
            weight=validation.weight, intraclass=validation.intraclass,
        )  # fmt: skip
        found = there.parameters(result)
    return there, result


def _bend(data: FilteredData, candidate: Candidate, theta: Array) -> tuple[Array, Array]:
    """Return (T, n, k) slopes of a cause's torque by its parameters less its columns.

    And (T, n) its torque less that of its columns. Both of the model's torque alone: how a
    reading of the torque of other causes bends, is left out.
    """

    def torque(parameters: Array) -> Array:
        there = data.candidate(candidate.hypothesis.relinearised(parameters))
        return there.columns() @ parameters

    columns = data.candidate(candidate.hypothesis).columns()
    curved, claim = torque(theta) - columns @ theta, candidate.hypothesis
    own = claim.tangent(data.motion) if isinstance(claim, OwnTangent) else None
    if own is not None:
        return data.reduce(own) - columns, curved
    step = _SLOPE_STEP * float(np.abs(theta).max())
    slopes = [
        (torque(theta + change) - torque(theta - change)) / (2.0 * step)
        for change in step * np.eye(len(theta))
    ]
    return np.stack(slopes, axis=2) - columns, curved


def setting_columns(
    validation: CrossValidation, candidate: Candidate, theta: Array
) -> tuple[list[str], list[Candidate]]:
    """Return slopes of a candidate's torque by its searched settings, as further columns."""
    names, slopes = [], []
    hypothesis = candidate.hypothesis
    for name in hypothesis.refine:
        value = hypothesis.setting[name]
        step = 0.05 if name in hypothesis.edges else 0.02 * abs(value)
        if step == 0.0:
            continue
        up, down = (rebuilt(validation, hypothesis, name, value + s) for s in (step, -step))
        slope = (up.columns() - down.columns()) @ theta / (2.0 * step)
        if np.any(slope != 0.0):
            names.append(name)
            slopes.append(Candidate.of(hypothesis, slope[:, :, None]))
    return names, slopes
