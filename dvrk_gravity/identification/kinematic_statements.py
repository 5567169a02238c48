"""How well data identify zeros of joints and tilt of the base, in plain words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.identifiability import kinematic_name
from dvrk_gravity.identification.kinematic_calibration import KINEMATIC, offset_joints
from dvrk_gravity.identification.problem import Problem


@dataclass(frozen=True)
class KinematicStatementSettings:
    """What is worth saying of zeros and tilt.

    Attributes:
        well: Half of a 95 % interval up to which a zero counts as well known, rad. Chosen: 1 deg
            turns a weight moment of 1 N·m so far that it is off by 0.017 N·m at most.
        entangled: Factor by which an interval grows when the others are unknown, too, that is worth
            a word. Chosen.
    """

    well: float = float(np.radians(1.0))
    entangled: float = 2.0


def never_shown(arm: Arm) -> str:
    """Say what no motion of an arm identifies."""
    *others, last = (n for j, n in enumerate(arm.joint_names) if j not in offset_joints(arm))
    parts = [
        *(f"the joint offset of {name} (weights do not depend on it)" for name in others[:1]),
        f"the joint offset of {last} (equivalent to another centre of mass of its link)",
        "a payload (equivalent to parameters of the links that carry it)",
        "a constant torque offset (equivalent to the constant of a cable's torque)",
    ]
    return f"not identifiable from torques, and held at the assumed values: {'; '.join(parts)}"


def kinematic_statements(problem: Problem, chosen: Sequence[int]) -> tuple[str, ...]:
    """Say which zeros and tilt are not identifiable, and which of them are correlated.

    Args:
        problem: With slopes.
        chosen: Columns of the fit; its zeros and tilt, if any, are judged like all others.
    """
    columns, settings = problem.design.columns, KinematicStatementSettings()
    kinematics = [i for i, column in enumerate(columns.columns) if column.effect in KINEMATIC]
    information = _information(problem, [i for i in chosen if i not in kinematics], kinematics)
    first = NORMAL_95 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information)
    second = NORMAL_95 * np.sqrt(np.diag(covariance))
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    names = [kinematic_name(columns, columns.columns[i]) for i in kinematics]
    hidden, entangled = [], []
    for k, name in enumerate(names):
        alone, together = (
            _shown(columns, kinematics[k], half_width[k]) for half_width in (first, second)
        )
        if first[k] > settings.well * _scale(columns, kinematics[k]):
            hidden.append(f"{name} (±{alone})")
        elif second[k] > settings.entangled * first[k]:
            other = int(np.argmax(np.abs(correlation[k]) - np.eye(len(names))[k]))
            entangled.append(
                f"{name} is known to ±{alone} if the other joint offsets and the tilt are right, "
                f"but only to ±{together} if they are unknown, too; it is most strongly correlated "
                f"with {names[other]} ({correlation[k, other]:+.2f})"
            )
    if hidden:
        entangled.append(
            f"{', '.join(hidden)}: smaller errors than these are not identifiable from these "
            "data: parameters of links, springs and elastic torque compensate for them; faster "
            "motion, or a wider range of the joint, would identify them"
        )
    return (*entangled, never_shown(columns.arm))


def _scale(columns: Columns, index: int) -> float:
    """Return what counts as a rad of a zero or of the tilt."""
    joint = columns.columns[index].joint
    return 1.0 if joint < 0 else float(columns.arm.scale[joint])


def _shown(columns: Columns, index: int, value: float) -> str:
    """Return an error of a zero or of the tilt as a person says it."""
    joint = columns.columns[index].joint  # negative: of the tilt
    slides = joint >= 0 and columns.arm.joints[joint].kind == "prismatic"
    return f"{1e3 * value:.2g} mm" if slides else f"{np.degrees(value):.2g} deg"


def _information(problem: Problem, others: Sequence[int], kinematics: Sequence[int]) -> Array:
    """Return (k, k) information on zeros and tilt, the other columns of a fit unknown."""
    both = [*others, *kinematics]
    scale = problem.design.columns.scale[both]
    gram = problem.equations.select(both).gram
    total = np.tensordot(problem.weighting.certainty, gram, 1) + np.diag(1.0 / scale**2)
    known, rest = slice(0, len(others)), slice(len(others), None)
    through = np.linalg.solve(total[known, known], total[known, rest])
    return np.asarray(total[rest, rest] - total[rest, known] @ through)
