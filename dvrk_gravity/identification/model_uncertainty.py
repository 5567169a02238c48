"""What an identification leaves uncertain, in the coefficients of the model's own terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import (
    LONGEST_CORRELATION,
    Uncertainty,
    correlation_time,
    prior_precision,
)
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.design import Design
from dvrk_gravity.identification.problem import Problem
from dvrk_gravity.model import CalibrationSamples, ModelUncertainty, TorqueModel, coefficients_of


@dataclass(frozen=True)
class PosteriorSettings:
    """What of a fit counts as uncertain.

    Attributes:
        overlap: Part of the torque of a column that the model does not have, above which it is
            uncertain whether it has it: so much its own columns reproduce in the data. What is
            told apart better than that the choice of terms has seen. Chosen: as much as another
            must reproduce to stand in a finding's place.
        certain: Part of its prior's standard deviation below which a direction is taken to be
            known: of what a joint may plausibly have as cable or friction that is less than effort
            sensors tell.
        same: Part of a column's torque by which one that is the same may miss it: rounding.
    """

    overlap: float = 0.5
    certain: float = 3e-3
    same: float = 1e-9


@dataclass(frozen=True)
class KnownError:
    """What a model left of data that its fit had not seen.

    Attributes:
        rms: (n,) in joint space, N·m.
        together: (n,) s in which errors hang together.
        band: Hz; both are of what lies below this.
        speed: (n,) greatest speeds among these data.
    """

    rms: Array
    together: Array
    band: float
    speed: Array


def known_error(design: Design, blind: Array, band: float) -> KnownError:
    """Return the error of (N, n) torques at the motors that fits predicted without seeing them."""
    rows = design.compared.all(axis=1)
    error = design.columns.arm.joint_effort(design.y - blind)[rows]
    longest = int(LONGEST_CORRELATION * design.rate)
    together = correlation_time(error, design.part[rows], longest) / design.rate
    assert design.state.qd is not None
    speed = np.abs(design.state.qd).max(axis=0)
    return KnownError(np.sqrt(np.mean(error**2, axis=0)), together, band, speed)


def stood_in_for(
    problem: Problem, chosen: Sequence[int], settings: PosteriorSettings | None = None
) -> list[int]:
    """Return the columns that the chosen ones stand in for.

    Args:
        problem: The problem.
        chosen: Columns of the fit.
        settings: When one stands in for another.
    """
    settings = settings or PosteriorSettings()
    columns, index = problem.design.columns, np.array(chosen, dtype=np.int64)
    gram, _ = problem.equations.combined(problem.weighting.motor)
    inside = gram[np.ix_(index, index)]
    inside = inside + prior_precision(inside, columns.scale[index])
    others = np.setdiff1d(np.arange(len(columns.columns)), index)
    beside = gram[np.ix_(index, others)]
    reproduced = np.einsum("ij,ij->j", beside, np.linalg.solve(inside, beside))
    own = np.diag(gram)
    # A motor that moves its own joint alone is that joint: no other place.
    collinear = gram**2 > (1.0 - settings.same) * np.outer(own, own)
    twins = np.asarray(np.triu(collinear, 1).any(axis=0))
    new = ~twins[others] & ~np.asarray(collinear[np.ix_(index, others)].any(axis=0))
    found = others[new & (reproduced > settings.overlap * own[others])]
    return [column for column in found.tolist() if columns.offers(columns.columns[column])]


def held_by_terms(columns: Columns, theta: Array, wanted: Sequence[int]) -> list[int]:
    """Return which of some columns the terms of a model can hold.

    A term may have room for what it is made of alone: the coefficient of an element that it does
    not have, zero in the model, is no parameter of it.

    Args:
        columns: All columns.
        theta: (p,) the model's coefficients of all of them.
        wanted: The columns that are asked about.
    """
    here, unit = _layout(columns, theta), np.diag(columns.scale)
    return [
        column
        for column in wanted
        if theta[column] != 0.0 or _layout(columns, theta + unit[column]) == here
    ]


def _layout(columns: Columns, theta: Array) -> dict[str, int]:
    """Return how many coefficients each term of a model has."""
    return {name: len(values) for name, values in coefficients_of(columns.terms(theta)).items()}


def model_uncertainty(
    columns: Columns,
    theta: Array,
    index: Sequence[int],
    spread: Uncertainty,
    error: KnownError,
    model: TorqueModel,
    kept: CalibrationSamples | None,
    settings: PosteriorSettings | None = None,
) -> ModelUncertainty:
    """Return the posterior of a model's coefficients.

    Args:
        columns: All columns of the fit.
        theta: (p,) coefficients of all of them, zero of those that the model does not have.
        index: Columns that the model is not sure of.
        spread: Covariance of theirs; what the prior moved them by counts as uncertain, too.
        error: What the model left.
        model: The model made of them.
        kept: What shows of what that error depends; ``None``: nothing does.
        settings: Which directions count.
    """
    directions = _uncertain_directions(spread, columns.scale[list(index)], settings)
    whole = np.zeros((len(columns.columns), directions.shape[1]))
    whole[list(index)] = directions

    def coefficients(at: Array) -> dict[str, Array]:
        return coefficients_of(columns.terms(at))

    here, kinematics = coefficients(theta), columns.corrected(theta)
    there = [coefficients(theta + change) for change in whole.T]
    moved = [columns.corrected(theta + change) for change in whole.T]
    arm = columns.arm
    zeros, base = kinematics.offset + np.zeros(arm.n), kinematics.mounted(arm).gravity
    own = coefficients_of(model.terms)
    return ModelUncertainty(
        coefficients={name: own[name] for name in here},
        deviations=_deviations(here, there),
        offset=np.stack([calibration.offset - zeros for calibration in moved], axis=1),
        gravity=np.stack(
            [calibration.mounted(arm).gravity - base for calibration in moved], axis=1
        ),
        error=error.rms,
        band=error.band,
        together=error.together,
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
    """Return what static poses leave uncertain of a model.

    Args:
        model: The model.
        theta: (p,) coefficients of the fit.
        index: Those that the model's terms are made of, but for the load that stiction held.
        spread: Covariance of all.
        scale: (p,) standard deviations before any data.
        coefficients: From the fit's to those of the model's terms.
        error: (n,) RMS, in joint space, of the error at poses that no fit had seen, N·m.
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
        band=np.nan, together=unknown, lower=q.min(axis=0), upper=q.max(axis=0), speed=unknown,
    )  # fmt: skip


def _uncertain_directions(
    spread: Uncertainty, scale: Array, settings: PosteriorSettings | None = None
) -> Array:
    """Return (p, d) one standard deviation of each independent combination that is uncertain.

    Args:
        spread: Covariance of p coefficients; what the prior moved them by counts, too.
        scale: (p,) standard deviations before any data.
        settings: Which directions count.
    """
    relative = (spread.covariance + spread.bias) / np.outer(scale, scale)
    variance, vectors = np.linalg.eigh(relative)
    uncertain = variance > (settings or PosteriorSettings()).certain ** 2
    return scale[:, None] * vectors[:, uncertain] * np.sqrt(variance[uncertain])


def _deviations(
    here: Mapping[str, Array], there: Sequence[Mapping[str, Array]]
) -> dict[str, Array]:
    """Return by term (k, d) differences of its (k,) coefficients in each of d directions."""
    return {
        name: np.reshape([shifted[name] - value for shifted in there], (len(there), len(value))).T
        for name, value in here.items()
    }
