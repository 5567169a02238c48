"""From the coefficients of static poses to a torque model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import MAX_DEGREE, as_value, write_rows
from dvrk_gravity.identification.static_solver import (
    Composition,
    PoseSolution,
    Table,
    solve_robust,
)
from dvrk_gravity.model import TorqueModel, coefficients_of
from dvrk_gravity.parameters import Value

_CABLE = "directional_cable"  # what is fitted of each joint's own position


@dataclass(frozen=True)
class DirectionSettings:
    """What a compensator applies of the difference between the directions in motion.

    Attributes:
        ratio: Part of it. Chosen: half of what poses that were approached and held show leaves
            friction enough that nothing is driven.
        dead_band: Speed below which none of it is applied, rad/s (a tenth in m/s). Chosen.
        saturation: Speed from which on all of that part is, likewise: the most usual
            ``sat_vec_vec`` of real console files.
    """

    ratio: float = 0.5
    dead_band: float = 0.02
    saturation: float = 0.2


def fit_poses(
    table: Table, choices: Sequence[Composition]
) -> tuple[TorqueModel, PoseSolution, Array, Array]:
    """Fit what was chosen and build the model.

    Returns:
        The model, the solution, (n,) robust residual scale in N·m or N, and (N, n) weights.
    """
    solution, scale, weight = solve_robust(table, choices)
    values = _values(table, solution)
    if table.gravity_columns.bounded:
        values |= _shown(table, scale, weight)
    return TorqueModel.from_parameters(values, table.arm), solution, scale, weight


def coefficients_at(table: Table, solution: PoseSolution, theta: Array) -> dict[str, Array]:
    """Return the coefficients of each term of the model that other (p,) coefficients make."""
    values = _values(table, replace(solution, theta=theta))
    return coefficients_of(TorqueModel.from_parameters(values, table.arm).terms)


def _values(table: Table, solution: PoseSolution) -> dict[str, Value]:
    return {
        "arm": table.arm.source or table.arm.name,
        **table.gravity_columns.parameters(solution.gravity),
        **_cables(table, solution),
        **_held(table, solution),
    }


def cable_name(side: str, joint: str) -> str:
    """Return the name of the parameter that holds a joint's coefficients, positive or negative."""
    return f"{_CABLE}.{side}.{joint}"


def cable_rows(table: Table, solution: PoseSolution, joint: int) -> dict[str, Array]:
    """Return (13, p) matrices from theta to a joint's coefficients, lowest power first.

    Keys: ``positive`` and ``negative``.
    """
    columns = table.joints[joint]
    centre = 0.5 * (table.valid.lower[joint] + table.valid.upper[joint])
    half = 0.5 * (table.valid.upper[joint] - table.valid.lower[joint])
    # A joint that was not posed has nothing but constants.
    offset, slope = (-centre / half, 1.0 / half) if joint in table.poses.moving else (0.0, 0.0)
    powers_of_line = _powers_of_line(offset, slope)
    rows = {
        name: np.zeros((1 + MAX_DEGREE, len(solution.theta))) for name in ("positive", "negative")
    }
    for k, column in zip(solution.indices(joint), solution.columns[joint], strict=True):
        if columns.group[column] != 0:
            continue
        series = chebyshev.cheb2poly(columns.own[column])
        powers = powers_of_line[:, : len(series)] @ series
        sign = -1.0 if columns.along[column] else 1.0
        rows["positive"][:, k] += powers
        rows["negative"][:, k] += sign * powers
    return rows


def _powers_of_line(offset: float, slope: float) -> Array:
    """Return (13, 13) coefficients of (offset + slope q)^k in column k, lowest power first."""
    result = np.zeros((1 + MAX_DEGREE, 1 + MAX_DEGREE))
    for k in range(1 + MAX_DEGREE):
        coefficients = polynomial.polypow([offset, slope], k)
        result[: len(coefficients), k] = coefficients
    return result


def _cables(table: Table, solution: PoseSolution) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for joint, name in enumerate(table.arm.joint_names):
        rows = cable_rows(table, solution, joint)
        used = np.flatnonzero(np.any([side.any(axis=1) for side in rows.values()], axis=0))
        degree = int(used[-1]) if len(used) else 0
        for side, powers in rows.items():
            values[cable_name(side, name)] = as_value((powers @ solution.theta)[: degree + 1])
    blend, scale = DirectionSettings(), table.arm.scale
    settings = {
        "dead_band": blend.dead_band * scale,
        "saturation_velocity": blend.saturation * scale,
        "ratio": np.full(table.arm.n, blend.ratio),
    }
    for setting, value in settings.items():
        values[f"{_CABLE}.{setting}"] = as_value(value)
    return values | _range(_CABLE, table)


def _held(table: Table, solution: PoseSolution) -> dict[str, Value]:
    """Return the parameters of the functions of other joints' positions, if there are any."""
    index: dict[tuple[int, ...], int] = {}
    entries = []
    for joint in range(table.arm.n):
        columns = table.joints[joint]
        for k, column in zip(solution.indices(joint), solution.columns[joint], strict=True):
            if columns.group[column] != 0:
                function = index.setdefault(tuple(columns.orders[column].tolist()), len(index))
                kind = "difference" if columns.along[column] else "mean"
                entries.append((kind, joint, function, solution.theta[k]))
    if not index:
        return {}
    sizes = {kind: np.zeros((len(index), table.arm.n)) for kind in ("mean", "difference")}
    for kind, joint, function, value in entries:
        sizes[kind][function, joint] = value
    values: dict[str, Value] = {
        "held_load.orders": tuple(float(order) for function in index for order in function)
    }
    for kind, size in sizes.items():
        values |= write_rows(table.arm, f"held_load.{kind}", size)
    return values | _range("held_load", table)


def _shown(table: Table, scale: Array, weight: Array) -> dict[str, Value]:
    effort = table.poses.effort
    used = weight > 0.0
    lower = np.where(used, effort, np.inf).min(axis=0) - scale
    upper = np.where(used, effort, -np.inf).max(axis=0) + scale
    return {"shown_torque.lower": as_value(lower), "shown_torque.upper": as_value(upper)}


def _range(term: str, table: Table) -> dict[str, Value]:
    return {
        f"{term}.valid_lower": as_value(table.valid.lower),
        f"{term}.valid_upper": as_value(table.valid.upper),
    }
