"""What an identification leaves uncertain, in the coefficients of the model's own terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.estimation.covariance import Uncertainty
from dvrk_gravity.estimation.noise import NoiseSettings, correlation_time
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.design import Design
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording.data import Array
from dvrk_gravity.uncertainty import ModelUncertainty, coefficients_of


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
    rows = design.measured.all(axis=1)
    error = design.columns.arm.joint_effort(design.y - blind)[rows]
    longest = int(NoiseSettings().longest * design.rate)
    together = correlation_time(error, design.part[rows], longest) / design.rate
    assert design.state.qd is not None
    speed = np.abs(design.state.qd).max(axis=0)
    return KnownError(np.sqrt(np.mean(error**2, axis=0)), together, band, speed)


def model_uncertainty(
    columns: Columns,
    chosen: Sequence[int],
    theta: Array,
    spread: Uncertainty,
    error: KnownError,
    model: TorqueModel,
) -> ModelUncertainty:
    """Return the posterior of a model's coefficients.

    Args:
        columns: All columns of the fit.
        chosen: Those of the model.
        theta: (p,) their coefficients.
        spread: Their covariance; what the prior moved them by counts as uncertain, too.
        error: What the model left.
        model: The model made of them.
    """
    variance, vectors = np.linalg.eigh(spread.covariance + spread.bias)
    whole = np.zeros((len(columns.columns), len(theta)))
    whole[list(chosen)] = vectors * np.sqrt(np.maximum(variance, 0.0))
    whole = whole[:, variance > 0.0]
    centre = np.zeros(len(columns.columns))
    centre[list(chosen)] = theta

    def coefficients(at: Array) -> dict[str, Array]:
        return coefficients_of(columns.terms(at))

    here, kinematics = coefficients(centre), columns.corrected(centre)
    there = [coefficients(centre + change) for change in whole.T]
    moved = [columns.corrected(centre + change) for change in whole.T]
    arm = columns.arm
    zeros, base = kinematics.offset + np.zeros(arm.n), kinematics.mounted(arm).gravity
    own = coefficients_of(model.terms)
    return ModelUncertainty(
        coefficients={name: own[name] for name in here},
        deviations={
            name: np.stack([one[name] - value for one in there], axis=1)
            for name, value in here.items()
        },
        offset=np.stack([one.offset - zeros for one in moved], axis=1),
        gravity=np.stack([one.mounted(arm).gravity - base for one in moved], axis=1),
        error=error.rms,
        band=error.band,
        together=error.together,
        lower=columns.valid.lower,
        upper=columns.valid.upper,
        speed=error.speed,
    )


def uncertainty_of_poses(model: TorqueModel, error: Array, q: Array) -> ModelUncertainty:
    """Return what static poses leave uncertain: the error at poses that no fit had seen.

    It holds what the parameters are off by, too: weight and cables make up for each other, and only
    their sum is told well.

    Args:
        model: The model.
        error: (n,) its RMS in joint space, N·m.
        q: (N, n) positions of the poses.
    """
    unknown, none = np.full(model.arm.n, np.nan), np.zeros((model.arm.n, 0))
    return ModelUncertainty(
        coefficients={}, deviations={}, offset=none, gravity=np.zeros((3, 0)), error=error,
        band=np.nan, together=unknown, lower=q.min(axis=0), upper=q.max(axis=0), speed=unknown,
    )  # fmt: skip
