"""What static poses tell about the parameters, and what they cannot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import Uncertainty, clustered_scores, masks, sandwich, sequential
from dvrk_gravity.identification.result import FittedParameter, Identifiability
from dvrk_gravity.identification.static_model import cable_name, cable_rows
from dvrk_gravity.identification.static_solver import PoseSolution, Table


@dataclass(frozen=True)
class PoseReportSettings:
    """What is said of a fit to static poses.

    Attributes:
        inseparable: Correlation of two estimates from which on they count as one. Chosen: a
            standard error is then five times what it would be with the other one known.
        clusters: Blocks of poses whose residuals hang together, at most. Chosen: a sandwich
            of few of them is too narrow, and few may mean less than 20 to 50 (Cameron and Miller
            2015).
    """

    inseparable: float = 0.98
    clusters: int = 50


def uncertainty(table: Table, solution: PoseSolution, weight: Array) -> Uncertainty:
    """Return the covariance of the coefficients.

    Stiction's residuals hang together over neighbouring poses; the sandwich sums them over
    contiguous blocks of poses (Liang and Zeger 1986) before squaring.
    """
    residual = table.poses.effort - solution.predict(table)
    scores = []
    clusters = sequential(len(residual), min(PoseReportSettings().clusters, len(residual)))
    for mask in masks(clusters):
        score = np.zeros(len(solution.theta))
        for joint in range(residual.shape[1]):
            pull = weight[mask, joint] * residual[mask, joint]
            score[: solution.count] += table.gravity[mask, joint].T @ pull
            chosen = table.matrices[joint][mask][:, solution.columns[joint]]
            score[solution.indices(joint)] += chosen.T @ pull
        scores.append(score)
    return sandwich(solution, clustered_scores(np.array(scores)))


def parameters(
    table: Table, solution: PoseSolution, spread: Uncertainty
) -> tuple[FittedParameter, ...]:
    """Return gravity's parameters and the cables' coefficients with confidence."""
    found = []
    for name, unit, direction in _quantities(table, solution):
        value = float(direction @ solution.theta)
        found.append(
            FittedParameter(
                name,
                value,
                unit,
                spread.interval(value, direction),
                spread.identifiable(direction),
            )
        )
    return tuple(found)


def identifiability(table: Table, solution: PoseSolution, spread: Uncertainty) -> Identifiability:
    """Say what the poses determine."""
    prior = solution.prior
    scaled = prior[:, None] * solution.data * prior
    information = np.linalg.eigvalsh(scaled)
    known = information[information > 1.0]  # more from the data than from the prior
    condition = float(np.sqrt(known[-1] / known[0])) if len(known) else float("inf")
    return Identifiability(
        len(known), len(information), condition, tuple(_statements(table, solution, spread))
    )


def _quantities(table: Table, solution: PoseSolution) -> Iterator[tuple[str, str, Array]]:
    yield from _of_gravity(table, solution)
    for j, joint in enumerate(table.arm.joints):
        for side, rows in cable_rows(table, solution, j).items():
            for power, row in enumerate(rows):
                if row.any():
                    unit = joint.effort_unit + (f"/{joint.unit}^{power}" if power else "")
                    yield f"{cable_name(side, joint.name)}[{power}]", unit, row


def _of_gravity(table: Table, solution: PoseSolution) -> Iterator[tuple[str, str, Array]]:
    rest = np.zeros(len(solution.theta) - solution.count)
    for name, unit, direction in table.gravity_columns.quantities():
        yield name, unit, np.concatenate([direction, rest])


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
            f"{whose} friction and {whose} cable torque cannot be separated, and what friction "
            "held is in the errors; approach every pose from both directions"
        )
    quantities = {name: direction for name, _, direction in _quantities(table, solution)}
    for first, _, of_first in _of_gravity(table, solution):
        for j, power in product(poses.moving, (0, 1)):
            joint = joints[j]
            second = f"{cable_name('positive', joint.name)}[{power}]"
            if second not in quantities:
                continue
            together = spread.correlation(of_first, quantities[second])
            if abs(together) > PoseReportSettings().inseparable:
                low, high = (joint.shown(float(edge[j])) for edge in (poses.lower, poses.upper))
                yield (
                    f"{first} and {second} cannot be separated (correlation {together:+.3f}): "
                    f"a wider range of {joint.name} than {low.split()[0]} to {high} would"
                )
