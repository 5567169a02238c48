"""Identification from static poses, each approached in a known direction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import inner_slabs, masks, sequential, slabs
from dvrk_gravity.identification import result, static_report
from dvrk_gravity.identification.errors import joint_errors
from dvrk_gravity.identification.holding import holding
from dvrk_gravity.identification.model_uncertainty import uncertainty_of_poses
from dvrk_gravity.identification.result import Fit, JointError, Trace
from dvrk_gravity.identification.static_model import coefficients_at, fit_poses
from dvrk_gravity.identification.static_poses import Poses, read_poses
from dvrk_gravity.identification.static_selection import choose
from dvrk_gravity.identification.static_solver import PoseSettings, Table
from dvrk_gravity.identification.verdict import judge
from dvrk_gravity.identification.weights import contradictions, idle
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Coordinates, DataWarning, Recording

Report = Callable[[str, float], None]


def fit_static(
    recordings: Sequence[Recording],
    arm: Arm,
    coordinates: Coordinates = "joint",
    report: Report = lambda stage, share: None,
    for_console: bool = False,
) -> Fit:
    """Fit gravity, cables and what stiction holds to static poses.

    Which functions of the pose a joint's torque has, and how smooth they are, is chosen by the
    error on slabs of poses held out. All coefficients are then solved for at once, with a robust
    loss and with priors that keep in check what the poses do not determine.

    Args:
        recordings: Static poses of all joints with efforts, best in both directions.
        arm: The arm.
        coordinates: Of the recordings; the direction of approach is each joint's own.
        report: Called with the stage and the share of it that is done.
        for_console: Fit what the dVRK console has, and nothing else.

    Raises:
        RecordingError: A joint or the efforts missing, too few poses, or nothing that moves.
    """
    poses, warnings = read_poses(recordings, arm, coordinates)
    held_out, predicted = _held_out(
        poses, arm, lambda share: report("held-out error", share), for_console
    )
    report("fit", 0.0)
    choices: list[result.Choice] = []
    table = Table.of(poses, arm, for_console)
    model, solution, _, weight = fit_poses(table, choose(table, choices.append))
    spread = static_report.uncertainty(table, solution, weight)
    fitted = model.torque(poses.q, direction=poses.direction)

    def shown(effort: Array) -> Array:
        return arm.actuator_effort(effort) if coordinates == "actuator" else effort

    measured = shown(poses.effort)
    training = joint_errors(arm.joint_names, measured, shown(fitted))
    held = holding(lambda q: solution.at_rest(table, q), solution.theta, spread, poses.q, arm)
    # Poses left out of the fit count in the errors that are printed, but are no fault of the model.
    used = np.all(weight > 0.0, axis=1)
    unseen = used[held_out]
    resting = idle(arm, poses.q, static=True)
    resting = arm.motors_of(resting) if coordinates == "actuator" else resting
    errors = partial(
        joint_errors, arm.joint_names, constant=measured[used].mean(axis=0), idle=resting
    )
    against = contradictions(model, poses.q, poses.effort, held)
    verdict = judge(
        errors(measured[held_out][unseen], shown(predicted)[unseen]),
        errors(measured[used], shown(fitted)[used]),
        held, arm, coordinates, static=True,
        with_friction=[arm.joint_names[joint] for joint in poses.undirected], against=against,
    )  # fmt: skip
    error = (poses.effort[held_out] - predicted)[unseen]
    uncertainty = uncertainty_of_poses(
        model, solution.theta, solution.without_stiction(table), spread,
        solution.prior,
        partial(coefficients_at, table, solution), np.sqrt(np.mean(error**2, axis=0)), poses.q,
    )  # fmt: skip
    return Fit(
        model=replace(model, verdict=verdict.level, reason=verdict.reason, uncertainty=uncertainty),
        held_out=errors(measured[held_out], shown(predicted)),
        training=training,
        parameters=static_report.parameters(table, solution, spread),
        identifiability=static_report.identifiability(table, solution, spread),
        choices=tuple(choices),
        warnings=(*warnings, *_driven(model, poses, training)),
        handling=tuple(_handling(poses, weight, arm)),
        validation="one slab of poses for each joint that moved, at positions of that joint which "
        "neither fit nor choice had seen",
        coordinates=coordinates,
        samples=len(poses),
        physical={},
        traces=tuple(_traces(poses, measured, shown(fitted), arm, coordinates)),
        holding=held,
        verdict=verdict,
        against=against,
    )


def _driven(
    model: TorqueModel, poses: Poses, errors: Mapping[str, JointError]
) -> Iterator[DataWarning]:
    """Yield warnings about joints that friction would drive: upwards they need less than down.

    Told is what is more than a fraction of the error that the model leaves.
    """
    arm = model.arm
    up, down = (model.torque(poses.q, direction=np.full(poses.q.shape, s)) for s in (1.0, -1.0))
    friction = 0.5 * np.mean(up - down, axis=0)
    for joint in poses.moving:
        name, unit = arm.joint_names[joint], arm.joints[joint].effort_unit
        if friction[joint] < -poses.settings.driven * errors[name].rmse:
            yield DataWarning(
                "effort_sign", name, {"friction": float(friction[joint])},
                f"friction is {friction[joint]:.2g} {unit}, as if it drove the joint: directions "
                "exchanged, or an effort of the wrong sign?",
            )  # fmt: skip


def predict_unseen(
    poses: Poses, unseen: NDArray[np.bool_], arm: Arm, for_console: bool = False
) -> Array:
    """Return (N, n) torques at the unseen poses, all choices made on the others, N·m or N."""
    model = fit_model(poses.rows(~unseen), arm, for_console)
    return model.torque(poses.q[unseen], direction=poses.direction[unseen])


def fit_model(poses: Poses, arm: Arm, for_console: bool = False) -> TorqueModel:
    """Return the model that :func:`fit_static` would choose for some poses."""
    table = Table.of(poses, arm, for_console)
    return fit_poses(table, choose(table))[0]


def _held_out(
    poses: Poses, arm: Arm, progress: Callable[[float], None], for_console: bool
) -> tuple[NDArray[np.int64], Array]:
    """Return rows of held-out poses and their (N, n) predictions by fits that never saw them."""
    unseen = middle_slabs(poses)
    predicted = []
    for number, mask in enumerate(unseen):
        progress(number / len(unseen))
        predicted.append(predict_unseen(poses, mask, arm, for_console))
    return np.concatenate([np.flatnonzero(mask) for mask in unseen]), np.concatenate(predicted)


def middle_slabs(poses: Poses) -> list[NDArray[np.bool_]]:
    """Return the (N,) mask of the slab in the middle of each joint that moved."""
    if not inner_slabs(poses.q, poses.moving):
        return masks(sequential(len(poses), poses.settings.blocks))
    numbers = (slabs(poses.q[:, joint]) for joint in poses.moving)
    return [number == (number.max() + 1) // 2 for number in numbers if number.max() >= 2]


def _handling(poses: Poses, weight: Array, arm: Arm) -> list[str]:
    lines = ["static poses, used as they are; Huber's loss"]
    outlier = PoseSettings().robust.outlier
    for joint, name in enumerate(arm.joint_names):
        excluded = int((weight[:, joint] == 0.0).sum())
        if excluded:
            worst = float(np.abs(poses.effort[weight[:, joint] == 0.0, joint]).max())
            lines.append(
                f"{name}: {excluded} of {len(poses)} poses left out, more than {outlier:g} "
                f"standard deviations off all others (up to {worst:.3f} {arm.effort_units[joint]})"
            )
    if not np.all(weight > 0.0):
        lines.append("poses left out on a joint count in the errors, not in the verdict")
    return lines


def _traces(
    poses: Poses, measured: Array, fitted: Array, arm: Arm, coordinates: Coordinates
) -> list[Trace]:
    q = arm.actuator_position(poses.q) if coordinates == "actuator" else poses.q
    return [
        Trace(
            arm.joint_names, None, q[rows], None, measured[rows], fitted[rows], coordinates, False
        )
        for rows in (poses.part == part for part in np.unique(poses.part))
    ]
