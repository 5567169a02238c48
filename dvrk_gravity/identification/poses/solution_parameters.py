"""From the solution of a pose fit to the parameters of a model, and to their intervals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import MAX_DEGREE, as_value, write_rows
from dvrk_gravity.estimation import Uncertainty
from dvrk_gravity.identification.poses.solver import PoseSolution, Table
from dvrk_gravity.identification.result import FittedParameter
from dvrk_gravity.model import TorqueModel, coefficients_of
from dvrk_gravity.parameters import Value

CABLE = "directional_cable"  # fitted of each joint's own position
# Of the difference between the directions, a compensator applies in motion this part. Chosen: half
# of what poses that were approached and held show leaves friction enough that nothing is driven.
RATIO = 0.5
# Speed below which it applies none of it, rad/s (a tenth in m/s), chosen; and speed from which on
# it applies all of that part: the most usual ``sat_vec_vec`` of real console files.
DEAD_BAND = 0.02
SATURATION = 0.2


def coefficients_at(table: Table, solution: PoseSolution, theta: Array) -> dict[str, Array]:
    """Return the coefficients of each term of the model that other (p,) coefficients give."""
    values = model_values(table, replace(solution, theta=theta))
    return coefficients_of(TorqueModel.from_parameters(values, table.arm).terms)


def model_values(table: Table, solution: PoseSolution) -> dict[str, Value]:
    """Return the parameters of the model that a solution is, its shown torque apart."""
    return {
        "arm": table.arm.source or table.arm.name,
        **table.gravity_columns.parameters(solution.gravity),
        **_cables(table, solution),
        **_held_load(table, solution),
    }


def _cable_rows(table: Table, solution: PoseSolution, joint: int) -> dict[str, Array]:
    """Return by side (13, p) matrices from theta to a joint's coefficients, lowest power first."""
    columns = table.joints[joint]
    centre = 0.5 * (table.valid.lower[joint] + table.valid.upper[joint])
    half = 0.5 * (table.valid.upper[joint] - table.valid.lower[joint])
    # A joint that was not posed has nothing but constants.
    offset, slope = (-centre / half, 1.0 / half) if joint in table.poses.moving else (0.0, 0.0)
    line = np.zeros((1 + MAX_DEGREE, 1 + MAX_DEGREE))  # (offset + slope q)^k in column k
    for k in range(1 + MAX_DEGREE):
        coefficients = polynomial.polypow([offset, slope], k)
        line[: len(coefficients), k] = coefficients
    rows = {
        name: np.zeros((1 + MAX_DEGREE, len(solution.theta))) for name in ("positive", "negative")
    }
    for k, column in zip(solution.indices(joint), solution.columns[joint], strict=True):
        if columns.group[column] != 0:
            continue
        series = chebyshev.cheb2poly(columns.own[column])
        powers = line[:, : len(series)] @ series
        rows["positive"][:, k] += powers
        rows["negative"][:, k] += -powers if columns.along[column] else powers
    return rows


def _cables(table: Table, solution: PoseSolution) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for joint, name in enumerate(table.arm.joint_names):
        rows = _cable_rows(table, solution, joint)
        used = np.flatnonzero(np.any([side.any(axis=1) for side in rows.values()], axis=0))
        degree = int(used[-1]) if len(used) else 0
        for side, powers in rows.items():
            values[f"{CABLE}.{side}.{name}"] = as_value((powers @ solution.theta)[: degree + 1])
    scale = table.arm.scale
    return values | {
        f"{CABLE}.dead_band": as_value(DEAD_BAND * scale),
        f"{CABLE}.saturation_velocity": as_value(SATURATION * scale),
        f"{CABLE}.ratio": as_value(np.full(table.arm.n, RATIO)),
        **_range(CABLE, table),
    }


def _held_load(table: Table, solution: PoseSolution) -> dict[str, Value]:
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
        "held_load.orders": tuple(float(order) for orders in index for order in orders)
    }
    for kind, size in sizes.items():
        values |= write_rows(table.arm, f"held_load.{kind}", size)
    return values | _range("held_load", table)


def shown_torque(table: Table, scale: Array, weight: Array) -> dict[str, Value]:
    """Return the bounds of the efforts that the poses showed, widened by the residual's scale.

    Args:
        table: The columns at the poses.
        scale: (n,) robust scale of the residual, N·m or N.
        weight: (N, n) weights of the poses; 0 of those that are left out.
    """
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


def fitted_parameters(
    table: Table, solution: PoseSolution, spread: Uncertainty
) -> tuple[FittedParameter, ...]:
    """Return gravity's parameters and the cables' coefficients with intervals."""
    found = []
    for name, unit, direction in reported_quantities(table, solution):
        value = float(direction @ solution.theta)
        interval = spread.interval(value, direction)
        found.append(FittedParameter(name, value, unit, interval, spread.identifiable(direction)))
    return tuple(found)


def reported_quantities(table: Table, solution: PoseSolution) -> Iterator[tuple[str, str, Array]]:
    """Yield name, unit and (p,) row by theta of gravity's parameters and cables' coefficients."""
    yield from of_gravity(table, solution)
    for j, joint in enumerate(table.arm.joints):
        for side, rows in _cable_rows(table, solution, j).items():
            for power, row in enumerate(rows):
                if row.any():
                    unit = joint.effort_unit + (f"/{joint.unit}^{power}" if power else "")
                    yield f"{CABLE}.{side}.{joint.name}[{power}]", unit, row


def of_gravity(table: Table, solution: PoseSolution) -> Iterator[tuple[str, str, Array]]:
    """Yield name, unit and (p,) row by theta of each of gravity's parameters."""
    rest = np.zeros(len(solution.theta) - solution.count)
    for name, unit, direction in table.gravity_columns.quantities():
        yield name, unit, np.concatenate([direction, rest])
