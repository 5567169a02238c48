"""Identification from trajectories: build the problem, choose its columns, judge the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import (
    Folds,
    FoldSettings,
    NotConvergedError,
    Solution,
    Uncertainty,
    autocorrelated_scores,
    sandwich,
)
from dvrk_gravity.identification.quality.identifiability import describe
from dvrk_gravity.identification.quality.physical import (
    certificate,
    physical_links,
    possible_links,
)
from dvrk_gravity.identification.quality.uncertainty import (
    KnownError,
    confounded,
    dry_friction,
    held_by_terms,
    holding,
    kept_samples,
    known_error,
    model_uncertainty,
    omitted_effects,
    rest_error,
)
from dvrk_gravity.identification.quality.verdict import judge, of_clock
from dvrk_gravity.identification.quality.weights import contradictions, idle
from dvrk_gravity.identification.result import (
    Fit,
    FittedParameter,
    Holding,
    Identifiability,
    JointError,
    Trace,
    joint_errors,
)
from dvrk_gravity.identification.trajectories.kinematics import calibrate
from dvrk_gravity.identification.trajectories.problem import LEAST_GAIN, Problem, build_problem
from dvrk_gravity.identification.trajectories.selection import choose, with_loads
from dvrk_gravity.model import Columns, TorqueModel, search_starts
from dvrk_gravity.observation import (
    Design,
    Observation,
    log_of,
    noise_floor,
    warnings_of,
    without_standing,
)
from dvrk_gravity.parameters import node_parameters
from dvrk_gravity.recording import DEFAULT_CUTOFF, Coordinates, Note

Report = Callable[[str, float], None]
# Written with a model although they are the defaults: they show whoever edits it that only part of
# an identified friction is compensated.
_SHOWN = ("friction_compensation.ratio", "friction_compensation.dead_band")
_NO_BODIES = (
    "no bodies near the fit were found: links are those of a free fit; are signs and "
    "units of the efforts right?"
)
_TINY = 1e-12  # weight of what is held out in a mean, so that there always is one


@dataclass(frozen=True, eq=False)
class ColumnFit:
    """A fit of chosen columns.

    Attributes:
        solution: The coefficients.
        free: (p,) the same where links need not be bodies.
        links: (10 bodies,) link parameters, if they are physically consistent.
        predicted: (N, n) torque of the fit, N·m.
        blind: (N, n) torque, each sample predicted by a fit that had not seen it, N·m.
        parameters: Named, with intervals.
        identifiability: What the data determine.
        rest_error: From (K, n) positions to (K, n) standard errors of the torque at rest, N·m.
        holding: Gravity torque and its uncertainty, by joint.
        meat: Covariance of the scores of all columns.
    """

    solution: Solution
    free: Array
    links: Array | None
    predicted: Array
    blind: Array
    parameters: tuple[FittedParameter, ...]
    identifiability: Identifiability
    rest_error: Callable[[Array], Array]
    holding: Mapping[str, Holding]
    meat: Array


def fit_dynamic(
    observed: Sequence[Observation],
    arm: Arm,
    coordinates: Coordinates,
    effects: Sequence[str] | None = None,
    physical: bool | None = None,
    report: Report = lambda stage, share: None,
    form: type[Columns] = Columns,
    least_gain: float = LEAST_GAIN,
) -> Fit:
    """Fit a model to trajectories and judge it.

    Args:
        observed: Trajectories; one of all joints at least.
        arm: The arm.
        coordinates: Of the recordings.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        physical: Physically consistent links: every pseudo-inertia positive definite. ``None``: if
            there are any near the fit.
        report: Called with the stage and the share of it that is done.
        form: Which columns there are.
        least_gain: See :class:`Problem`.

    Raises:
        RecordingError: A recording that cannot be used.
        NotConvergedError: No bodies near the fit, where ``physical`` requires them.
    """
    parts, standing = without_standing([part for each in observed for part in each.split()], arm)
    if all(part.invalid_motor_effort.all() for part in parts):
        raise RecordingError(
            observed[0].sources[0],
            f"determines no motor's torque, as {', '.join(standing)} stand still: expected motions "
            "of all joints",
        )
    problem = build_problem(
        parts, arm, effects, lambda share: report("regressor", share), form, least_gain
    )
    # Effects that were not allowed are no error that the model must have.
    limited = effects is not None and form is Columns
    with_all = problem if limited else None  # its regressor is large
    problem, chosen = choose(
        problem, search_starts(problem.design.columns, effects),
        lambda share: report("choice of terms", share),
    )  # fmt: skip
    problem, chosen = with_loads(problem, chosen, parts)
    problem, chosen, kinematic = calibrate(problem, chosen, parts, report)
    columns, design = problem.design.columns, problem.design
    warnings = warnings_of(observed)
    try:
        found = estimate(problem, chosen, physical is not False)
    except NotConvergedError:
        if physical:
            raise
        warnings += (Note("no_bodies", None, {}, _NO_BODIES),)
        found = estimate(problem, chosen, physical=False)
    constant = _constants(design, problem.sums.folds)
    floor = noise_floor([p.noise_left(coordinates) for p in parts], [len(p) for p in parts])
    held_out, training = (
        _errors(design, predicted, coordinates, constant, floor)
        for predicted in (found.blind, found.predicted)
    )
    theta, free = np.zeros((2, len(columns.columns)))
    theta[list(chosen)], free[list(chosen)] = found.solution.theta, found.free
    model = _model(columns, theta, found.links)
    whole = design.compared.all(axis=1)
    q, effort = design.state.q[whole], arm.joint_effort(design.y)[whole]
    against = (
        *of_clock(warnings, arm),
        # Bodies near a fit hide what is wrong with efforts: no body has a negative mass.
        *contradictions(_model(columns, free, None), q, effort, found.holding),
    )
    duration = sum(float(np.ptp(motion.time)) for motion in parts)
    verdict = judge(
        held_out, training, found.holding, arm, coordinates, duration=duration, against=against
    )
    error = known_error(design, found.blind, DEFAULT_CUTOFF)
    kept = None if limited else kept_samples(parts)
    if with_all is not None:
        error = _with_all_terms(with_all, error, report)
    uncertainty = model_uncertainty(
        columns, theta, *_posterior(problem, chosen, theta, found), error, model, kept
    )
    statements = (*found.identifiability.statements, *kinematic)
    return Fit(
        model=replace(model, verdict=verdict.level, reason=verdict.reason, uncertainty=uncertainty),
        held_out=held_out,
        training=training,
        parameters=found.parameters,
        identifiability=replace(found.identifiability, statements=statements),
        choices=problem.choices,
        warnings=warnings,
        handling=(*log_of(observed), *_not_fitted(standing)),
        validation=how_validated(problem.sums.folds),
        coordinates=coordinates,
        samples=sum(len(motion) for motion in parts),
        physical={} if found.links is None else certificate(arm, found.links),
        traces=_traces(design, found.blind, coordinates),
        rest_error=found.rest_error,
        holding=found.holding,
        verdict=verdict,
        against=against,
    )


def _not_fitted(standing: Sequence[str]) -> list[str]:
    """Return a line about joints that never move, if there are any."""
    if not standing:
        return []
    return [
        f"not fitted: efforts of {', '.join(standing)}, which never move: friction may hold any "
        "torque up to its level"
    ]


def estimate(problem: Problem, chosen: Sequence[int], physical: bool = True) -> ColumnFit:
    """Fit the chosen columns and estimate their uncertainty.

    Args:
        problem: The problem.
        chosen: Columns of the fit.
        physical: Physically consistent links.
    """
    design, weighting = problem.design, problem.weighting
    columns, index = design.columns, list(chosen)
    solution = problem.fit(chosen)
    free, links = solution.theta, None
    # Where bodies of the same torque exist, there is nothing to correct, in held-out blocks either.
    corrected = False
    if physical:
        links = possible_links(columns, solution.theta[: columns.base.shape[1]])
        corrected = links is None
    if corrected:
        theta, links = physical_links(columns, index, solution)
        solution = replace(solution, theta=theta)
    predicted = design.x[:, :, index] @ solution.theta
    blind = problem.unseen(
        index, lambda found: physical_links(columns, index, found)[0] if corrected else found.theta
    )
    meat = _meat(problem, predicted, blind)
    own = np.ix_(index, index)
    omitted = omitted_effects(problem, index, solution, meat)
    spread = replace(sandwich(solution, meat[own]), omitted=omitted[own])
    weight = weighting.sample * weighting.motor
    parameters, identifiability = describe(columns, index, solution, spread, design, weight)
    # Effects that the model lacks hold the arm, too: the fit's columns replace part of them.
    everything, errors = np.zeros(len(meat)), omitted.copy()
    everything[index], errors[own] = solution.theta, spread.total
    at_rest = partial(_at_rest, columns)
    held = holding(
        at_rest, everything, errors, design.state.q, columns.arm,
        dry_friction(_model(columns, everything, links)),
    )  # fmt: skip
    return ColumnFit(
        solution, free, links, predicted, blind, parameters, identifiability,
        partial(rest_error, at_rest, errors), held, meat,
    )  # fmt: skip


def _meat(problem: Problem, predicted: Array, blind: Array) -> Array:
    """Return the covariance of the scores of all columns from (N, n) predicted torques."""
    design, weighting = problem.design, problem.weighting
    x = np.where(design.informative[:, :, None], design.x, 0.0)
    fitted, unseen = (weighting.sample * (design.y - torque) for torque in (predicted, blind))
    return autocorrelated_scores(
        x, fitted, unseen, design.part, design.rate, weighting.motor, design.compared
    )


def _posterior(
    problem: Problem, chosen: Sequence[int], theta: Array, found: ColumnFit
) -> tuple[list[int], Uncertainty]:
    """Return the columns that the model is not sure of, and their coefficients' covariance.

    Beside the chosen ones these are columns that the chosen ones may replace: their absence is no
    more certain than their presence. What else the model lacks is its known error.
    """
    columns = problem.design.columns
    wanted = sorted({*chosen, *confounded(problem, chosen)})
    index = held_by_terms(columns, theta, wanted)
    free = np.ones(len(index), dtype=bool)  # a sign that is held at zero is no certainty either
    solution = replace(problem.fit(index), free=free)
    return index, sandwich(solution, found.meat[np.ix_(index, index)])


def _at_rest(columns: Columns, q: Array) -> Array:
    """Return (K, n, p) joint torques of all columns at (K, n) positions at rest."""
    return np.matmul(columns.arm.joint_to_actuator.T, columns.at_rest(q))


def _with_all_terms(problem: Problem, own: KnownError, report: Report) -> KnownError:
    """Return the error of a model with all terms, where this one may not have all.

    What a model was not allowed to explain is not known error: it is to be found. So the
    correlation time of this model's errors is not known either.
    """
    free = replace(problem, effects=None)
    columns = problem.design.columns
    free, chosen = choose(
        free, search_starts(columns), lambda share: report("what all terms would leave", share)
    )
    error = known_error(free.design, free.unseen(chosen), own.band)
    error = replace(error, correlation=np.full(len(own.rms), np.nan))
    return error if np.sum(error.rms**2 / own.rms**2) < len(own.rms) else own


def how_validated(folds: Folds) -> str:
    """Return a sentence on what was held out."""
    text = (
        f"{len(folds.tested)} blocks, each predicted by a fit to the others with a gap of "
        f"{FoldSettings().gap:g} s; the choice of terms used them"
    )
    found = sorted({round(period, 2) for period in folds.periods})
    if found:
        shown = ", ".join(f"{period:g}" for period in found)
        text += f"; the motion repeats every {shown} s, so equal phases are held out together"
    if folds.shared:
        text += "; recordings show the same motion: the same states are held out of all of them"
    return text


def _model(columns: Columns, theta: Array, links: Array | None) -> TorqueModel:
    declared = node_parameters(columns.arm)
    node = {name: declared[name].default for name in _SHOWN}
    offset = columns.corrected_kinematics(theta).offset
    return TorqueModel(columns.arm, columns.terms(theta, links), node, joint_offset=offset)


def _constants(design: Design, folds: Folds) -> Array:
    """Return (N, n) efforts predicted by a constant, the mean of what was not held out."""
    constant = np.empty_like(design.y)
    for tested, excluded in zip(folds.tested, folds.excluded, strict=True):
        fitted = design.compared.copy()
        fitted[excluded] = False
        constant[tested] = np.average(design.y, axis=0, weights=np.maximum(fitted, _TINY))
    return constant


def _errors(
    design: Design, predicted: Array, coordinates: Coordinates, constant: Array, floor: Array
) -> dict[str, JointError]:
    arm = design.columns.arm
    # The errors are those of recordings of all joints.
    rows = design.compared.all(axis=1)
    measured, predicted, constant = (array[rows] for array in (design.y, predicted, constant))
    resting = idle(arm, design.state.q[rows], static=False)
    if coordinates == "joint":
        measured, predicted, constant = (
            arm.joint_effort(array) for array in (measured, predicted, constant)
        )
    else:
        resting = arm.motors_of(resting)
    return joint_errors(arm.joint_names, measured, predicted, constant, resting, floor)


def _traces(design: Design, predicted: Array, coordinates: Coordinates) -> tuple[Trace, ...]:
    arm = design.columns.arm
    traces = []
    for part in np.unique(design.part):
        rows = design.part == part
        if not design.measured[rows].all():
            continue
        q, qd = design.state.q[rows], design.state.qd
        assert qd is not None
        qd, measured, torque = qd[rows], design.y[rows], predicted[rows]
        if coordinates == "joint":
            measured, torque = arm.joint_effort(measured), arm.joint_effort(torque)
        else:
            q, qd = arm.actuator_position(q), arm.actuator_position(qd)
        traces.append(
            Trace(arm.joint_names, design.time[rows], q, qd, measured, torque, coordinates, True)
        )
    return tuple(traces)
