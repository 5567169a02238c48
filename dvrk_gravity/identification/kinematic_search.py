"""The search for zeros of joints and a tilt of the base that improve the held-out error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.identification.kinematic_calibration import (
    KINEMATIC,
    KinematicCalibration,
    KinematicSettings,
)
from dvrk_gravity.identification.kinematic_statements import kinematic_statements
from dvrk_gravity.identification.motion import CalibrationMotion
from dvrk_gravity.identification.moves import starts
from dvrk_gravity.identification.problem import Problem, choose, pose, reweighed, solved


@dataclass(frozen=True)
class KinematicSearchSettings:
    """When the iteration for zeros and tilt ends.

    Attributes:
        steps: Of Gauss and Newton, at most. Chosen: it converges quadratically.
        tolerance: Change of a zero or of the tilt that ends it, rad. Chosen: far below any
            interval.
        rough_tolerance: The same before terms are chosen anew, rad. Chosen: the cosine of 0.01 rad
            is 1 to 5e-5, so that the slopes there are as good as those at the end.
        farthest: Of a zero or the tilt, standard deviations of what is plausible
            (``KinematicSettings``): beyond that they stand for something else. Chosen: what a
            diagnosis takes for possible, too.
    """

    steps: int = 6
    tolerance: float = 1e-4
    rough_tolerance: float = 1e-2
    farthest: float = 6.0


def around_calibration(
    problem: Problem,
    chosen: list[int],
    motions: Sequence[CalibrationMotion],
    report: Callable[[str, float], None],
) -> tuple[Problem, list[int], tuple[str, ...]]:
    """Return the problem around the best zeros and tilt, if any helps, and its columns.

    The third is what can be said of zeros and tilt in these data, whether any helps or not.

    Their own columns stay in the fit, so that all parameters' intervals know of them. What was
    chosen around wrong kinematics may have made up for it, so the other columns are chosen anew.

    Args:
        problem: Around the kinematics that are assumed.
        chosen: Its columns.
        motions: What it was posed of.
        report: Called with the stage and the share of it that is done.
    """
    assumed, settings = problem.selection, KinematicSearchSettings()
    if not any(assumed.allowed(effect) for effect in KINEMATIC):
        return problem, chosen, ()
    report("zeros and tilt", 0.0)
    around, start = started = _moved(problem, chosen, solved(problem, chosen).theta, motions)
    selection = around.selection
    selection.choices = []
    found = selection.kinematics(start)
    choices = selection.choices
    if len(found) == len(start):
        assumed.choices += choices
        return problem, chosen, kinematic_statements(around, start)
    report("zeros and tilt", 0.3)
    around, found = _converged(around, found, motions, settings.rough_tolerance)
    columns = around.design.columns
    moved = [i for i in found if columns.columns[i].effect in KINEMATIC]
    plain = [sorted({*initial, *moved}) for initial in starts(columns, around.selection.effects)]
    around.selection.choices = [choice for choice in (*assumed.choices, *choices) if choice.kept]
    around, found = choose(around, [found, *plain], lambda share: report("choice of terms", share))
    chosen_anew = around.selection.choices
    choices = [choice for choice in choices if choice not in chosen_anew] + chosen_anew
    around, found = _converged(around, found, motions, settings.tolerance)
    beyond = _beyond(around, found)
    if beyond:
        return problem, chosen, (*kinematic_statements(*started), *beyond)
    around.selection.choices = choices
    return around, found, kinematic_statements(around, found)


def _beyond(problem: Problem, chosen: Sequence[int]) -> tuple[str, ...]:
    """Return sentences about zeros and a tilt that are too far off to be that."""
    found = _calibration(problem, chosen, solved(problem, chosen).theta)
    arm = problem.design.columns.arm
    most = KinematicSearchSettings().farthest * KinematicSettings().misplaced
    offsets = found.offset + np.zeros(arm.n)
    far = [(f"the zero of {arm.joint_names[j]}", offsets[j], arm.units[j])
           for j in np.flatnonzero(np.abs(offsets) > most * arm.scale).tolist()]  # fmt: skip
    tilt = float(np.max(np.abs(found.tilt)))
    if tilt > most:
        far.append(("the base's tilt", tilt, "rad"))
    return tuple(
        f"{what} would have to be off by {value:.2g} {unit} to improve the held-out error, which "
        "is more than a zero or a tilt can be: taken as the arm's file says"
        for what, value, unit in far
    )


def _calibration(problem: Problem, chosen: Sequence[int], fitted: Array) -> KinematicCalibration:
    """Return the kinematics that (k,) coefficients of a fit ask for."""
    columns = problem.design.columns
    theta = np.zeros(len(columns.columns))
    theta[list(chosen)] = fitted
    return columns.corrected(theta)


def _moved(
    problem: Problem, chosen: Sequence[int], fitted: Array, motions: Sequence[CalibrationMotion]
) -> tuple[Problem, list[int]]:
    """Return the problem around the kinematics that (k,) coefficients of a fit ask for."""
    columns, selection = problem.design.columns, problem.selection
    there = _calibration(problem, chosen, fitted)
    around = pose(motions, columns.arm, selection.effects, kinematics=there)
    same = columns.same(chosen, around.design.columns)
    return reweighed(around, same), same


def _converged(
    problem: Problem, chosen: list[int], motions: Sequence[CalibrationMotion], within: float
) -> tuple[Problem, list[int]]:
    """Return the problem around the kinematics that a fit changes by no more than some rad."""
    for _ in range(KinematicSearchSettings().steps):
        columns = problem.design.columns
        fitted = solved(problem, chosen).theta
        change = [
            abs(value)
            for i, value in zip(chosen, fitted.tolist(), strict=True)
            if columns.columns[i].effect in KINEMATIC
        ]
        if max(change) < within:
            break
        problem, chosen = _moved(problem, chosen, fitted, motions)
    return problem, chosen
