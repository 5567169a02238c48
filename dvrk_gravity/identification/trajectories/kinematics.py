"""Encoder offsets and tilt of the base: searched by held-out error, and how well data show them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import MISPLACED
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification.quality.identifiability import kinematic_name
from dvrk_gravity.identification.trajectories.problem import (
    Problem,
    problem_of,
    with_motor_weights,
)
from dvrk_gravity.identification.trajectories.selection import choose, search
from dvrk_gravity.model import (
    Columns,
    KinematicCalibration,
    kinematic_columns,
    kinematic_moves,
    offset_joints,
    search_starts,
)
from dvrk_gravity.observation import Observation, build_design

STEPS = 6  # of Gauss and Newton, at most. Chosen: it converges quadratically
# Change of an offset or of the tilt that ends the iteration, rad. Chosen: far below any interval.
TOLERANCE = 1e-4
# The same before terms are chosen again, rad. Chosen: the cosine of 0.01 rad is 1 to 5e-5, so that
# the slopes there are as good as those at the end.
ROUGH_TOLERANCE = 1e-2
# Largest offset or tilt, in plausible standard deviations (``MISPLACED``): beyond that they stand
# for something else. Chosen: what a diagnosis takes for possible, too.
FARTHEST = 6.0
# Half of a 95 % interval up to which an offset is well known, rad. Chosen: 1 deg turns a weight
# moment of 1 N·m so far that it is off by 0.017 N·m at most.
WELL = float(np.radians(1.0))
# Factor by which an interval grows when the others are unknown, too, that is reported. Chosen.
ENTANGLED = 2.0


def calibrate(
    problem: Problem,
    chosen: list[int],
    motions: Sequence[Observation],
    report: Callable[[str, float], None],
) -> tuple[Problem, list[int], tuple[str, ...]]:
    """Return the problem at the best offsets and tilt, if any helps, its columns, and statements.

    Their columns stay in the fit, so that all parameters' intervals include them. Columns chosen at
    wrong kinematics may have compensated for them, so the others are chosen again.

    Args:
        problem: At the assumed kinematics.
        chosen: Its columns.
        motions: Of the problem.
        report: Called with the stage and the share of it that is done.
    """
    displaced = kinematic_columns(problem.design.columns.arm)
    if not any(problem.allowed(column.effect) for column in displaced):
        return problem, chosen, ()
    report("zeros and tilt", 0.0)
    around, start = started = _moved(problem, chosen, problem.fit(chosen).theta, motions)
    found, tried = search(around, start, kinematic_moves, lazy=None)
    if len(found) == len(start):
        problem = replace(problem, choices=(*problem.choices, *tried))
        return problem, chosen, kinematic_statements(around, start)
    report("zeros and tilt", 0.3)
    around, found = _converged(around, found, motions, ROUGH_TOLERANCE)
    columns = around.design.columns
    moved = [i for i in found if i in columns.kinematic]
    plain = [sorted({*initial, *moved}) for initial in search_starts(columns, around.effects)]
    kept = tuple(choice for choice in (*problem.choices, *tried) if choice.kept)
    around, found = choose(
        replace(around, choices=kept), [found, *plain],
        lambda share: report("choice of terms", share),
    )  # fmt: skip
    again = around.choices
    around, found = _converged(around, found, motions, TOLERANCE)
    if beyond := _beyond(around, found):
        return problem, chosen, (*kinematic_statements(*started), *beyond)
    around = replace(around, choices=(*(each for each in tried if each not in again), *again))
    return around, found, kinematic_statements(around, found)


def _beyond(problem: Problem, chosen: Sequence[int]) -> tuple[str, ...]:
    """Return sentences about implausibly large offsets and tilt."""
    found = _calibration(problem, chosen, problem.fit(chosen).theta)
    arm = problem.design.columns.arm
    most = FARTHEST * MISPLACED
    offsets = found.offset + np.zeros(arm.n)
    far = [(f"the encoder offset of {arm.joint_names[j]}", offsets[j], arm.units[j])
           for j in np.flatnonzero(np.abs(offsets) > most * arm.scale).tolist()]  # fmt: skip
    tilt = float(np.max(np.abs(found.tilt)))
    if tilt > most:
        far.append(("the base's tilt", tilt, "rad"))
    return tuple(
        f"{what} would have to be {value:.2g} {unit} to improve the held-out error, which is "
        "implausible: kept as in the arm's file"
        for what, value, unit in far
    )


def _calibration(problem: Problem, chosen: Sequence[int], fitted: Array) -> KinematicCalibration:
    """Return the kinematics that (k,) coefficients of a fit correct to."""
    columns = problem.design.columns
    theta = np.zeros(len(columns.columns))
    theta[list(chosen)] = fitted
    return columns.corrected_kinematics(theta)


def _moved(
    problem: Problem, chosen: Sequence[int], fitted: Array, motions: Sequence[Observation]
) -> tuple[Problem, list[int]]:
    """Return the problem at the kinematics that (k,) coefficients of a fit correct to."""
    design, old = problem.design, problem.design.columns
    columns = old.at(_calibration(problem, chosen, fitted))
    # Before there were slopes, nothing has moved yet.
    stays = range(len(old.columns)) if old.kinematics.links is None else old.by_motion
    known = {old.columns[index].key: index for index in stays}
    kept = {i: known[c.key] for i, c in enumerate(columns.columns) if c.key in known}
    new = [i for i in range(len(columns.columns)) if i not in kept]
    x = np.empty((*design.y.shape, len(columns.columns)))
    x[..., list(kept)] = design.x[..., list(kept.values())]
    x[..., new] = build_design(columns, motions, chosen=new).x
    design = replace(design, columns=columns, x=x)
    around = problem_of(design, motions, problem.effects, problem.least_gain)
    same = old.same(chosen, columns)
    return with_motor_weights(around, same), same


def _converged(
    problem: Problem, chosen: list[int], motions: Sequence[Observation], within: float
) -> tuple[Problem, list[int]]:
    """Return the problem at kinematics that a fit changes by less than ``within`` rad."""
    for _ in range(STEPS):
        columns = problem.design.columns
        fitted = problem.fit(chosen).theta
        change = [
            abs(value)
            for i, value in zip(chosen, fitted.tolist(), strict=True)
            if i in columns.kinematic
        ]
        if max(change) < within:
            break
        problem, chosen = _moved(problem, chosen, fitted, motions)
    return problem, chosen


def kinematic_statements(problem: Problem, chosen: Sequence[int]) -> tuple[str, ...]:
    """Return sentences on offsets and tilt that are not identifiable, or correlated.

    Args:
        problem: With slopes.
        chosen: Columns of the fit; its offsets and tilt, if any, are judged like all others.
    """
    columns = problem.design.columns
    kinematics = columns.kinematic
    information = _information(problem, [i for i in chosen if i not in kinematics], kinematics)
    first = NORMAL_95 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information)
    second = NORMAL_95 * np.sqrt(np.diag(covariance))
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    names = [kinematic_name(columns, columns.columns[i]) for i in kinematics]
    hidden, lines = [], list[str]()
    for k, name in enumerate(names):
        alone, among = (_shown(columns, kinematics[k], width[k]) for width in (first, second))
        if first[k] > WELL * _scale(columns, kinematics[k]):
            hidden.append(f"{name} (±{alone})")
        elif second[k] > ENTANGLED * first[k]:
            other = int(np.argmax(np.abs(correlation[k]) - np.eye(len(names))[k]))
            lines.append(
                f"{name} is known to ±{alone} if the other joint offsets and the tilt are right, "
                f"but only to ±{among} if they are unknown, too; it is most strongly correlated "
                f"with {names[other]} ({correlation[k, other]:+.2f})"
            )
    if hidden:
        lines.append(
            f"{', '.join(hidden)}: smaller errors are not identifiable from these data, as "
            "parameters of links, springs and elastic torque compensate for them; faster motion, "
            "or a wider range of the joint, would identify them"
        )
    return (*lines, _never_shown(columns.arm))


def _never_shown(arm: Arm) -> str:
    """Return a sentence on what no motion of an arm identifies."""
    *others, last = (n for j, n in enumerate(arm.joint_names) if j not in offset_joints(arm))
    parts = [
        *(f"the joint offset of {name} (weights do not depend on it)" for name in others[:1]),
        f"the joint offset of {last} (equivalent to another centre of mass of its link)",
        "a payload (equivalent to parameters of the links that carry it)",
        "a constant torque offset (equivalent to the constant of a cable's torque)",
    ]
    return f"not identifiable from torques, and held at the assumed values: {'; '.join(parts)}"


def _scale(columns: Columns, index: int) -> float:
    """Return the equivalent of a rad for an offset or the tilt."""
    joint = columns.columns[index].joint
    return 1.0 if joint < 0 else float(columns.arm.scale[joint])


def _shown(columns: Columns, index: int, value: float) -> str:
    """Return an error of an offset or of the tilt in deg or mm."""
    joint = columns.columns[index].joint  # negative: of the tilt
    slides = joint >= 0 and columns.arm.joints[joint].kind == "prismatic"
    return f"{1e3 * value:.2g} mm" if slides else f"{np.degrees(value):.2g} deg"


def _information(problem: Problem, others: Sequence[int], kinematics: Sequence[int]) -> Array:
    """Return (k, k) information on offsets and tilt, the other columns of a fit unknown."""
    both = [*others, *kinematics]
    scale = problem.design.columns.scale[both]
    gram = problem.sums.whole.select(both).gram
    total = np.tensordot(problem.weighting.certainty, gram, 1) + np.diag(1.0 / scale**2)
    known, rest = slice(0, len(others)), slice(len(others), None)
    through = np.linalg.solve(total[known, known], total[known, rest])
    return np.asarray(total[rest, rest] - total[rest, known] @ through)
