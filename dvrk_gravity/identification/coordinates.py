"""Are the columns of a recording those of the joints or those of the motors?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import State
from dvrk_gravity.estimation.normal_equations import fit
from dvrk_gravity.estimation.splits import make_folds
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.design import build_design
from dvrk_gravity.identification.motion import CalibrationMotion, Source, read, read_motions
from dvrk_gravity.identification.moves import start_columns
from dvrk_gravity.identification.selection import training_equations
from dvrk_gravity.recording import DataWarning
from dvrk_gravity.recording.data import Array, Coordinates


@dataclass(frozen=True)
class CoordinateSettings:
    """When the coordinates of a recording count as told.

    Attributes:
        duration: s of a recording that are looked at. Chosen: some periods of the slowest sine of
            an exciting motion, 0.07 Hz.
        clear: Ratio of the two held-out errors above which it does not matter, or cannot be told.
            Chosen.
    """

    duration: float = 40.0
    clear: float = 0.97


def detect_coordinates(recording: Source, arm: Arm) -> tuple[Coordinates, str]:
    """Return in which coordinates a plain model predicts held-out blocks better, and why.

    Of an arm whose motors each turn one joint, by as much, both are the same: no reason is given.

    Args:
        recording: Trajectory of all joints.
        arm: The arm.

    Raises:
        RecordingError: A recording that cannot serve.
    """
    if arm.direct_drive:
        return "joint", ""
    errors = coordinate_errors(recording, arm)
    best, other = sorted(errors, key=lambda system: errors[system])
    if errors[best] > CoordinateSettings().clear * errors[other]:
        return "joint", (
            "taken as joint coordinates; actuator coordinates would fit about equally well "
            f"(held-out error over torque {errors['joint']:.3f} and {errors['actuator']:.3f})"
        )
    return best, (
        f"taken as {best} coordinates: a plain model leaves a held-out error of "
        f"{errors[best]:.3f} of the torque, read as {other} coordinates {errors[other]:.3f}"
    )


def coordinate_errors(recording: Source, arm: Arm) -> dict[Coordinates, float]:
    """Return the held-out error of a plain model in either reading of a recording, over the torque.

    Of the efforts as they were recorded, for those of the motors are others in either reading; and
    by the determinant of the errors' covariance, the 2n-th root of it, which tells the likelihood
    of Gaussian errors that are independent at the motors or at the joints, whichever they are.
    """
    trajectory = replace(read(recording), coordinates=None)
    systems = get_args(Coordinates)
    errors, told = zip(
        *(_held_out_errors(trajectory, arm, system) for system in systems), strict=True
    )
    # The same samples in both: friction that holds a joint in one reading need not in the other.
    counted = np.logical_and(*told)
    seen = counted.any(axis=0)
    return {
        system: _size(np.where(counted, error, 0.0)[:, seen] / np.sqrt(counted.sum(axis=0)[seen]))
        for system, error in zip(systems, errors, strict=True)
    }


def doubt(recording: Source, arm: Arm, given: Coordinates) -> tuple[DataWarning, ...]:
    """Return a warning if the other coordinates than those given clearly fit better."""
    errors = coordinate_errors(recording, arm)
    best = min(errors, key=lambda system: errors[system])
    if best == given or errors[best] > CoordinateSettings().clear * errors[given]:
        return ()
    return (
        DataWarning(
            "coordinates",
            None,
            {"given": errors[given], "other": errors[best]},
            f"{recording.head.source} was given as {given} coordinates, but looks like {best} "
            f"ones: a plain model leaves a held-out error of {errors[given]:.3f} of the torque, as "
            f"{best} ones {errors[best]:.3f}",
        ),
    )


def _held_out_errors(
    recording: Source, arm: Arm, coordinates: Coordinates
) -> tuple[Array, NDArray[np.bool_]]:
    """Return (N, n) held-out errors of a plain model, and which of them say something.

    Of the efforts as they were recorded, over the RMS of each.
    """
    motions = [_head(motion) for motion in read_motions([recording], arm, coordinates).parts[:1]]
    q = motions[0].state.q
    columns = Columns(arm, q.min(axis=0), q.max(axis=0))
    design, chosen = build_design(columns, motions), start_columns(columns)
    folds = make_folds(design.time, design.part, design.state.q, design.rate)
    plain = replace(design, x=design.x[:, :, chosen])
    _, train = training_equations(plain, folds, np.ones_like(design.y))
    # A tenth of the torque is what such a model leaves; half a second is how long it stays.
    weight = 1.0 / (np.maximum(0.1 * design.y.std(axis=0), 1e-6) ** 2 * 0.5 * design.rate)
    scale, positive = columns.scale[chosen], columns.positive[chosen]
    error = np.zeros_like(design.y)
    for seen, tested in zip(train, folds.tested, strict=True):
        theta = fit(seen, weight, scale, positive).theta
        error[tested] = design.y[tested] - plain.x[tested] @ theta
    effort, told = design.y, design.told
    if coordinates == "joint":
        error, effort = arm.joint_effort(error), arm.joint_effort(effort)
        told = ~arm.joints_of(~told)
    rms = np.maximum(np.sqrt(np.mean(effort**2, axis=0)), 1e-6)
    return error / rms, told


def _size(error: Array) -> float:
    """Return the 2n-th root of the determinant of E' E of (N, n) errors E."""
    count = error.shape[1]
    floor = 1e-12 * np.eye(count)
    return float(np.exp(0.5 * np.linalg.slogdet(error.T @ error + floor)[1] / max(count, 1)))


def _head(motion: CalibrationMotion) -> CalibrationMotion:
    samples = int(CoordinateSettings().duration * motion.filter.rate)
    rows = slice(0, max(samples, 6 * motion.filter.edge))
    state = motion.state
    assert state.qd is not None
    assert state.qdd is not None
    told = np.broadcast_to(motion.told, motion.effort.shape)
    return replace(
        motion,
        time=motion.time[rows],
        told=told[rows],
        state=State(state.q[rows], state.qd[rows], state.qdd[rows]),
        effort=motion.effort[rows],
    )
