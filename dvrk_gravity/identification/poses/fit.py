"""Identification from static poses, each approached in a known direction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation import (
    Uncertainty,
    inner_slabs,
    masks,
    sequential,
    slabs,
)
from dvrk_gravity.identification.poses.reading import Poses, read_poses
from dvrk_gravity.identification.poses.selection import choose
from dvrk_gravity.identification.poses.solution_parameters import (
    CABLE,
    coefficients_at,
    fitted_parameters,
    model_values,
    of_gravity,
    reported_quantities,
    shown_torque,
)
from dvrk_gravity.identification.poses.solver import (
    ROBUST,
    Composition,
    PoseSolution,
    Table,
    pose_uncertainty,
    solve_robust,
)
from dvrk_gravity.identification.quality.identifiability import determined
from dvrk_gravity.identification.quality.uncertainty import (
    holding,
    rest_error,
    uncertainty_of_poses,
)
from dvrk_gravity.identification.quality.verdict import judge
from dvrk_gravity.identification.quality.weights import contradictions, idle
from dvrk_gravity.identification.result import (
    Fit,
    Identifiability,
    JointError,
    Trace,
    joint_errors,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Coordinates, Note, Recording

Report = Callable[[str, float], None]

BLOCKS = 5  # held out where no joint has three positions (Kohavi 1995: five to ten)
DRIVEN = 0.3  # part of the model's error that negative friction may be by chance. Chosen
# Correlation of two estimates from which on they are inseparable. Chosen: a standard error is then
# five times what it would be with the other one known.
INSEPARABLE = 0.98


def fit_static(
    recordings: Sequence[Recording],
    arm: Arm,
    coordinates: Coordinates = "joint",
    report: Report = lambda stage, share: None,
    for_console: bool = False,
) -> Fit:
    """Fit gravity, cables and the load held by stiction to static poses.

    Which functions of the pose a joint's torque has, and how smooth they are, is chosen by the
    error on held-out slabs of poses. All coefficients are then solved for at once, with a robust
    loss and with priors for what the poses do not determine.

    Args:
        recordings: Static poses of all joints with efforts, best in both directions.
        arm: The arm.
        coordinates: Of the recordings; the direction of approach is each joint's own.
        report: Called with the stage and the share of it that is done.
        for_console: Fit only what the dVRK console has.

    Raises:
        RecordingError: A joint or the efforts missing, too few poses, or nothing that moves.
    """
    poses, warnings = read_poses(recordings, arm, coordinates)
    held_out, predicted = _held_out(
        poses, arm, lambda share: report("held-out error", share), for_console
    )
    report("fit", 0.0)
    table = Table.of(poses, arm, for_console)
    chosen, choices = choose(table)
    model, solution, _, weight = fit_poses(table, chosen)
    spread = pose_uncertainty(table, solution, weight)
    fitted = model.torque(poses.q, direction=poses.direction)

    def shown(effort: Array) -> Array:
        return arm.actuator_effort(effort) if coordinates == "actuator" else effort

    measured = shown(poses.effort)
    training = joint_errors(arm.joint_names, measured, shown(fitted))
    at_rest = partial(solution.at_rest, table)
    held = holding(at_rest, solution.theta, spread.total, poses.q, arm)
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
        model, solution.theta, solution.without_stiction(table), spread, solution.prior,
        partial(coefficients_at, table, solution), np.sqrt(np.mean(error**2, axis=0)), poses.q,
    )  # fmt: skip
    return Fit(
        model=replace(model, verdict=verdict.level, reason=verdict.reason, uncertainty=uncertainty),
        held_out=errors(measured[held_out], shown(predicted)),
        training=training,
        parameters=fitted_parameters(table, solution, spread),
        identifiability=pose_identifiability(table, solution, spread),
        choices=tuple(choices),
        warnings=(*warnings, *_driven(model, poses, training)),
        handling=tuple(_handling(poses, weight, arm)),
        validation="one slab of poses for each joint that moved, at positions of that joint which "
        "neither fit nor choice had seen",
        coordinates=coordinates,
        samples=len(poses),
        physical={},
        traces=tuple(_traces(poses, measured, shown(fitted), arm, coordinates)),
        rest_error=partial(rest_error, at_rest, spread.total),
        holding=held,
        verdict=verdict,
        against=against,
    )


def _driven(model: TorqueModel, poses: Poses, errors: Mapping[str, JointError]) -> Iterator[Note]:
    """Yield warnings about joints with negative friction: upwards they need less than down."""
    arm = model.arm
    up, down = (model.torque(poses.q, direction=np.full(poses.q.shape, s)) for s in (1.0, -1.0))
    friction = 0.5 * np.mean(up - down, axis=0)
    for joint in poses.moving:
        name, unit = arm.joint_names[joint], arm.joints[joint].effort_unit
        if friction[joint] < -DRIVEN * errors[name].rmse:
            yield Note(
                "effort_sign", name, {"friction": float(friction[joint])},
                f"friction is {friction[joint]:.2g} {unit}, as if it drove the joint: directions "
                "exchanged, or an effort of the wrong sign?",
            )  # fmt: skip


def predict_unseen(poses: Poses, unseen: Mask, arm: Arm, for_console: bool = False) -> Array:
    """Return (N, n) torques at the unseen poses, all choices made on the others, N·m or N."""
    model = fit_model(poses.rows(~unseen), arm, for_console)
    return model.torque(poses.q[unseen], direction=poses.direction[unseen])


def fit_model(poses: Poses, arm: Arm, for_console: bool = False) -> TorqueModel:
    """Return the model that :func:`fit_static` would choose for some poses."""
    table = Table.of(poses, arm, for_console)
    return fit_poses(table, choose(table)[0])[0]


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


def middle_slabs(poses: Poses) -> list[Mask]:
    """Return the (N,) mask of the slab in the middle of each joint that moved."""
    if not inner_slabs(poses.q, poses.moving):
        return masks(sequential(len(poses), BLOCKS))
    numbers = (slabs(poses.q[:, joint]) for joint in poses.moving)
    return [number == (number.max() + 1) // 2 for number in numbers if number.max() >= 2]


def _handling(poses: Poses, weight: Array, arm: Arm) -> list[str]:
    lines = ["static poses, unfiltered; Huber's loss"]
    for joint, name in enumerate(arm.joint_names):
        out = weight[:, joint] == 0.0
        if out.any():
            worst = float(np.abs(poses.effort[out, joint]).max())
            lines.append(
                f"{name}: {int(out.sum())} of {len(poses)} poses left out, more than "
                f"{ROBUST.outlier:g} standard deviations off all others (up to {worst:.3f} "
                f"{arm.effort_units[joint]})"
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


def fit_poses(
    table: Table, choices: Sequence[Composition]
) -> tuple[TorqueModel, PoseSolution, Array, Array]:
    """Fit the chosen columns and build the model.

    Returns:
        The model, the solution, (n,) robust residual scale in N·m or N, and (N, n) weights.
    """
    solution, scale, weight = solve_robust(table, choices)
    values = model_values(table, solution)
    if table.gravity_columns.bounded:
        values |= shown_torque(table, scale, weight)
    return TorqueModel.from_parameters(values, table.arm), solution, scale, weight


def pose_identifiability(
    table: Table, solution: PoseSolution, spread: Uncertainty
) -> Identifiability:
    """Return what the poses determine."""
    return determined(solution, tuple(_statements(table, solution, spread)))


def _statements(table: Table, solution: PoseSolution, spread: Uncertainty) -> Iterator[str]:
    poses, joints = table.poses, table.arm.joints
    for j, joint in enumerate(joints):
        if j not in poses.moving:
            yield (
                f"{joint.name} was posed at {joint.shown(float(poses.q[:, j].mean()))} only: a "
                "constant is all of its torque that is identifiable"
            )
    if undirected := [joints[joint].name for joint in poses.undirected]:
        whose = "its" if len(undirected) == 1 else "their"
        yield (
            f"{', '.join(undirected)}: approached from one direction only, or from unknown ones: "
            f"{whose} friction and {whose} cable torque cannot be separated, and the errors "
            "include friction; approach every pose from both directions"
        )
    quantities = {name: direction for name, _, direction in reported_quantities(table, solution)}
    for first, _, of_first in of_gravity(table, solution):
        for j, power in product(poses.moving, (0, 1)):
            joint = joints[j]
            second = f"{CABLE}.positive.{joint.name}[{power}]"
            if second not in quantities:
                continue
            correlation = spread.correlation(of_first, quantities[second])
            if abs(correlation) > INSEPARABLE:
                low, high = (joint.shown(float(edge[j])) for edge in (poses.lower, poses.upper))
                yield (
                    f"{first} and {second} cannot be separated (correlation {correlation:+.3f}): "
                    f"a wider range of {joint.name} than {low.split()[0]} to {high} would"
                )
