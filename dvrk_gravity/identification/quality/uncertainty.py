"""What an identification leaves uncertain: the model's coefficients, and its torque at rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Site
from dvrk_gravity.estimation import (
    LONGEST_CORRELATION,
    Solution,
    Uncertainty,
    correlation_time,
    omitted_columns,
    prior_precision,
)
from dvrk_gravity.identification.result import Holding
from dvrk_gravity.identification.trajectories.problem import Problem
from dvrk_gravity.model import (
    CalibrationSamples,
    Columns,
    ModelUncertainty,
    TorqueModel,
    coefficients_of,
)
from dvrk_gravity.observation import Design, Observation

# Part of the torque of a column outside the model, above which it is uncertain whether the model
# has it: so much its own columns reproduce in the data. The choice of terms separates the rest.
# Chosen: as much as another must reproduce to take a finding's place.
OVERLAP = 0.5
# Part of its prior's standard deviation below which a direction counts as known. Chosen: of a
# joint's plausible cable or friction that is less than effort sensors resolve.
KNOWN = 3e-3
SAME = 1e-9  # relative: rounding
# Random poses at which torque at rest is judged. The RMS of a standard error over N of them is
# known to about 1 / sqrt(2 N), 5 %.
POSES = 200
# Range below which a joint determines nothing that depends on its position, rad (times the arm's
# scale). Chosen: within 7.5 deg on either side a sine is a line to 0.3 %.
NARROW = float(np.radians(15.0))


@dataclass(frozen=True)
class KnownError:
    """Error of a model on data that its fit had not seen.

    Attributes:
        rms: (n,) in joint space, N·m.
        correlation: (n,) s, correlation time.
        band: Hz; both are of what lies below this.
        speed: (n,) greatest speeds among these data.
    """

    rms: Array
    correlation: Array
    band: float
    speed: Array


def known_error(design: Design, blind: Array, band: float) -> KnownError:
    """Return the error of (N, n) torques at the motors, each predicted by a fit without it."""
    rows = design.compared.all(axis=1)
    error = design.columns.arm.joint_effort(design.y - blind)[rows]
    longest = int(LONGEST_CORRELATION * design.rate)
    correlation = correlation_time(error, design.part[rows], longest) / design.rate
    assert design.state.qd is not None
    speed = np.abs(design.state.qd).max(axis=0)
    return KnownError(np.sqrt(np.mean(error**2, axis=0)), correlation, band, speed)


def kept_samples(parts: Sequence[Observation]) -> CalibrationSamples | None:
    """Return the first complete samples, for the model's file; ``None`` if there are none.

    Parts that lack a motor's torque, if only for a while, are left out: they would not show the
    model's error.
    """
    whole = [part for part in parts if part.measured.all() and not part.invalid_motor_effort.any()]
    if not whole or whole[0].rate is None:
        return None
    arrays = ((part.q, part.qd, part.qdd, part.effort) for part in whole)
    return CalibrationSamples.of(arrays, whole[0].rate)


def confounded(problem: Problem, chosen: Sequence[int]) -> list[int]:
    """Return the columns outside the model that the chosen ones may replace."""
    columns, index = problem.design.columns, np.array(chosen, dtype=np.int64)
    gram, _ = problem.sums.whole.combined(problem.weighting.motor)
    inside = gram[np.ix_(index, index)]
    inside = inside + prior_precision(inside, columns.scale[index])
    others = _others(gram, index, columns)
    beside = gram[np.ix_(index, others)]
    reproduced = np.einsum("ij,ij->j", beside, np.linalg.solve(inside, beside))
    found = others[reproduced > OVERLAP * np.diag(gram)[others]]
    return [column for column in found.tolist() if columns.offers(columns.columns[column])]


def _others(gram: Array, index: NDArray[np.int64], columns: Columns) -> NDArray[np.int64]:
    """Return the columns that are no multiple of one at ``index``, nor of an earlier one.

    Of those that a fit chooses one of, the same friction with several settings, the middle one;
    none where one is chosen.
    """
    own = np.diag(gram)
    # A motor that moves its own joint alone is that joint: no other place.
    collinear = gram**2 > (1.0 - SAME) * np.outer(own, own)
    repeated = np.asarray(np.triu(collinear, 1).any(axis=0) | collinear[index].any(axis=0))
    families: dict[tuple[str, Site], list[int]] = {}
    for i, column in enumerate(columns.columns):
        if column.family is not None:
            families.setdefault(column.family, []).append(i)
    for members in families.values():
        kept = [] if set(members) & set(index.tolist()) else [members[len(members) // 2]]
        repeated[np.setdiff1d(members, kept)] = True
    return np.setdiff1d(np.flatnonzero(~repeated), index)


def omitted_effects(
    problem: Problem, chosen: Sequence[int], solution: Solution, meat: Array
) -> Array:
    """Return (p, p) second moment of all columns' errors from effects that a model lacks.

    Args:
        problem: The problem.
        chosen: Columns of the fit.
        solution: The fit.
        meat: Covariance of the scores of all columns, from noise.
    """
    columns, index = problem.design.columns, np.array(chosen, dtype=np.int64)
    gram, side = problem.sums.whole.combined(problem.weighting.motor)
    others = _others(gram, index, columns)
    offered = np.array([columns.offers(columns.columns[i]) for i in others], dtype=bool)
    score = side - gram[:, index] @ solution.theta
    return omitted_columns(solution, gram, score, meat, index, others[offered], columns.scale)


def held_by_terms(columns: Columns, theta: Array, wanted: Sequence[int]) -> list[int]:
    """Return which of some columns are parameters of a model's terms.

    A term may have room for its own elements alone: the coefficient of an element that it does not
    have, zero in the model, is no parameter of it.

    Args:
        columns: All columns.
        theta: (p,) the model's coefficients of all of them.
        wanted: The columns in question.
    """
    here, unit = _layout(columns, theta), np.diag(columns.scale)
    return [
        column
        for column in wanted
        if theta[column] != 0.0 or _layout(columns, theta + unit[column]) == here
    ]


def _layout(columns: Columns, theta: Array) -> dict[str, int]:
    """Return the number of coefficients of each term of a model."""
    return {name: len(values) for name, values in coefficients_of(columns.terms(theta)).items()}


def model_uncertainty(
    columns: Columns,
    theta: Array,
    index: Sequence[int],
    spread: Uncertainty,
    error: KnownError,
    model: TorqueModel,
    kept: CalibrationSamples | None,
) -> ModelUncertainty:
    """Return the posterior of the coefficients of a model of trajectories.

    Args:
        columns: All columns of the fit.
        theta: (p,) coefficients of all of them, zero of those that the model does not have.
        index: Columns that the model is not sure of.
        spread: Covariance of their coefficients.
        error: The model's held-out error.
        model: The model.
        kept: Samples that show what that error depends on; ``None``: none.
    """
    directions = _uncertain_directions(spread, columns.scale[list(index)])
    whole = np.zeros((len(columns.columns), directions.shape[1]))
    whole[list(index)] = directions

    def coefficients(at: Array) -> dict[str, Array]:
        return coefficients_of(columns.terms(at))

    here, kinematics = coefficients(theta), columns.corrected_kinematics(theta)
    there = [coefficients(theta + change) for change in whole.T]
    moved = [columns.corrected_kinematics(theta + change) for change in whole.T]
    arm = columns.arm
    zeros, base = kinematics.offset + np.zeros(arm.n), kinematics.mount(arm).gravity
    own = coefficients_of(model.terms)
    offset = [calibration.offset - zeros for calibration in moved]
    gravity = [calibration.mount(arm).gravity - base for calibration in moved]
    return ModelUncertainty(
        coefficients={name: own[name] for name in here},
        deviations=_deviations(here, there),
        offset=np.reshape(offset, (-1, arm.n)).T,
        gravity=np.reshape(gravity, (-1, 3)).T,
        error=error.rms,
        band=error.band,
        correlation_time=error.correlation,
        lower=columns.valid.lower,
        upper=columns.valid.upper,
        speed=error.speed,
        calibration=kept,
    )


def uncertainty_of_poses(
    model: TorqueModel,
    theta: Array,
    index: NDArray[np.int64],
    spread: Uncertainty,
    scale: Array,
    coefficients: Callable[[Array], dict[str, Array]],
    error: Array,
    q: Array,
) -> ModelUncertainty:
    """Return the posterior of the coefficients of a model of static poses.

    Args:
        model: The model.
        theta: (p,) coefficients of the fit.
        index: Those of the model's terms, without the load that stiction held.
        spread: Covariance of all.
        scale: (p,) prior standard deviations.
        coefficients: From the fit's to those of the model's terms.
        error: (n,) RMS held-out error in joint space, N·m.
        q: (N, n) positions of the poses.
    """
    here, own = coefficients(theta), coefficients_of(model.terms)
    part = np.ix_(index, index)
    marginal = Uncertainty(spread.covariance[part], spread.bias[part])
    found = _uncertain_directions(marginal, scale[index])
    directions = np.zeros((len(theta), found.shape[1]))
    directions[index] = found
    there = [coefficients(theta + change) for change in directions.T]
    unknown, size = np.full(model.arm.n, np.nan), len(there)
    return ModelUncertainty(
        coefficients={name: own[name] for name in here},
        deviations=_deviations(here, there),
        offset=np.zeros((model.arm.n, size)), gravity=np.zeros((3, size)), error=error,
        band=np.nan, correlation_time=unknown, lower=q.min(axis=0), upper=q.max(axis=0),
        speed=unknown,
    )  # fmt: skip


def _uncertain_directions(spread: Uncertainty, scale: Array) -> Array:
    """Return (p, d) one standard deviation of each independent uncertain combination.

    Args:
        spread: Covariance of p coefficients; the prior's pull on them counts, too.
        scale: (p,) prior standard deviations.
    """
    relative = spread.total / np.outer(scale, scale)
    variance, vectors = np.linalg.eigh(relative)
    uncertain = variance > KNOWN**2
    return scale[:, None] * vectors[:, uncertain] * np.sqrt(variance[uncertain])


def _deviations(
    here: Mapping[str, Array], there: Sequence[Mapping[str, Array]]
) -> dict[str, Array]:
    """Return by term (k, d) differences of its (k,) coefficients in each of d directions."""
    return {
        name: np.reshape([shifted[name] - value for shifted in there], (len(there), len(value))).T
        for name, value in here.items()
    }


def dry_friction(model: TorqueModel) -> Array:
    """Return (n,) torques that oppose each joint where it alone begins to move, N·m."""
    ways = np.eye(model.arm.n)
    q = np.tile(np.mean(model.arm.range, axis=0), (len(ways), 1))
    up, down = (model.torque(q, direction=way) for way in (ways, -ways))
    return np.asarray(0.5 * np.diag(up - down))


def rest_error(rows: Callable[[Array], Array], covariance: Array, q: Array) -> Array:
    """Return (K, n) standard errors of the torque at rest, N·m or N.

    Args:
        rows: From (K, n) positions to (K, n, p) joint torques of each coefficient, at rest.
        covariance: (p, p) second moment of their errors.
        q: (K, n) positions, rad or m.
    """
    columns = rows(q)
    variance = np.einsum("kjp,pq,kjq->kj", columns, covariance, columns, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def holding(
    rows: Callable[[Array], Array],
    theta: Array,
    covariance: Array,
    visited: Array,
    arm: Arm,
    friction: Array | float = 0.0,
) -> dict[str, Holding]:
    """Return the torque at rest and its standard error, by joint: what a compensator sends.

    At recorded poses (joints that hardly moved anywhere within their limits), and anywhere within
    the arm's limits. What the data leave open has the prior's size.

    Args:
        rows: From (K, n) positions to (K, n, p) joint torques of each coefficient, at rest.
        theta: (p,) coefficients.
        covariance: (p, p) second moment of their errors.
        visited: (N, n) recorded positions, rad or m.
        arm: The arm.
        friction: (n,) dry friction of the joints, N·m.
    """
    random = np.random.default_rng(0)
    lower, upper = visited.min(axis=0), visited.max(axis=0)
    anywhere = random.uniform(*arm.range, (POSES, visited.shape[1]))
    recorded = visited[random.integers(0, len(visited), POSES)]
    recorded = np.where(upper - lower < NARROW * arm.scale, anywhere, recorded)
    found = []
    for poses in (recorded, anywhere):
        each = rows(poses) @ theta, rest_error(rows, covariance, poses)
        found += [np.sqrt(np.mean(value**2, axis=0)) for value in each]
    rubbing = np.broadcast_to(friction, lower.shape)
    return {
        joint: Holding(*(float(values[k]) for values in (*found, lower, upper, rubbing)))
        for k, joint in enumerate(arm.joint_names)
    }
