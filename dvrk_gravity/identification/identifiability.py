"""What the data identify: parameters with intervals, and plain words about the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, product

import numpy as np

from dvrk_gravity.arms import is_mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Column, beta_map
from dvrk_gravity.estimation import Solution, Uncertainty
from dvrk_gravity.gravity import BETA_NAMES
from dvrk_gravity.identification.base_combinations import base_parameters
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.design import Design
from dvrk_gravity.identification.holding import HoldingSettings
from dvrk_gravity.identification.kinematic_calibration import KINEMATIC
from dvrk_gravity.identification.result import FittedParameter, Identifiability
from dvrk_gravity.identification.rigid_columns import link_columns

_NAMED = 6  # parameters in a sentence; the report's table has all


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """When two parameters count as one.

    Attributes:
        inseparable: Correlation of their estimates from which on it is said. At 0.97 a standard
            error is four times what it would be with the other one known, 1 / sqrt(1 - 0.97^2).
    """

    inseparable: float = 0.97


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A named combination of the chosen coefficients.

    Attributes:
        name: As in the model file.
        unit: SI unit.
        direction: (p,) weights of the chosen coefficients.
        joint: Joint that it acts on, -1 for links and base.
        around: Value that the combination adds to.
        shared: Divided from another by a choice, so that its interval promises too much.
    """

    name: str
    unit: str
    direction: Array
    joint: int
    around: float = 0.0
    shared: bool = False


def describe(
    columns: Columns,
    chosen: Sequence[int],
    solution: Solution,
    spread: Uncertainty,
    design: Design,
    weight: Array,
) -> tuple[tuple[FittedParameter, ...], Identifiability]:
    """Return the identified numbers with intervals, and what cannot be told apart.

    Args:
        columns: All columns.
        chosen: Columns of the fit.
        solution: The fit.
        spread: Its covariance.
        design: The samples.
        weight: (N, n) weight of each sample in the fit.
    """
    quantities = list(_quantities(columns, chosen))
    parameters = []
    for quantity in quantities:
        value = quantity.around + float(quantity.direction @ solution.theta)
        interval = spread.interval(value, quantity.direction)
        known = spread.identifiable(quantity.direction) and not quantity.shared
        parameters.append(FittedParameter(quantity.name, value, quantity.unit, interval, known))
    prior = solution.prior
    # Of what the data say, in units of what was plausible before: one means "as much as that".
    information = np.linalg.eigvalsh(prior[:, None] * solution.data * prior)
    told = information[information > 1.0]
    condition = float(np.sqrt(told[-1] / told[0])) if len(told) else float("inf")
    statements = [
        *_motion_statements(design),
        *_pair_statements(quantities, spread, design),
        *_absent_statements(quantities, columns, chosen, solution, design, weight),
        *_dry_friction_statements(columns, chosen, solution),
        *_open_statements(quantities, spread),
    ]
    return tuple(parameters), Identifiability(
        len(told), len(information), condition, tuple(statements)
    )


def _quantities(columns: Columns, chosen: Sequence[int]) -> list[_Quantity]:
    index = {column: i for i, column in enumerate(chosen)}
    rigid = [index[i] for i in link_columns(columns) if i in index]
    found: list[_Quantity] = []

    def row(values: dict[int, float]) -> Array:
        direction = np.zeros(len(chosen))
        for i, value in values.items():
            direction[i] = value
        return direction

    springs = {columns.columns[i].index: index[i] for i in columns.select(effect="gravity")}
    if rigid:
        of_beta = beta_map(columns.mounted) @ columns.base if is_mtm(columns.arm) else ()
        for k, line in enumerate(of_beta):
            if not _is_there(line):
                continue
            values = dict(zip(rigid, line, strict=True))
            if k in springs:
                values[springs[k]] = 1.0
            found.append(_Quantity(f"beta[{k}] ({BETA_NAMES[k]})", "N·m", row(values), -1))
        for name, unit, combination in base_parameters(columns.mounted):
            line = combination @ columns.base
            if not _is_there(line):
                continue
            unit = columns.arm.own_unit(unit)
            found.append(_Quantity(name, unit, row(dict(zip(rigid, line, strict=True))), -1))
    names = columns.arm.joint_names
    for (j, joint), effect in product(enumerate(names), _with_powers(columns)):
        powers = [i for i in columns.select(effect=effect, joint=j) if i in index]
        matrix = columns.basis(effect)[j :: columns.arm.n, j :: columns.arm.n]
        for k in range(len(powers)):
            values = {index[i]: matrix[k, columns.columns[i].index] for i in powers}
            effort, way = columns.arm.effort_units[j], columns.arm.units[j]
            unit = effort + ("" if k == 0 else f"/{way}" if k == 1 else f"/{way}^{k}")
            found.append(_Quantity(f"{effect}.{joint}[{k}]", unit, row(values), j))
    dry = _divided(columns, chosen)
    for i in chosen:
        column = columns.columns[i]
        if column.unit:
            found.append(
                _Quantity(
                    columns.effect(i).coefficient_name(columns.arm, column),
                    column.site.unit(columns.arm, column.unit), row({index[i]: 1.0}),
                    column.joint,
                    shared=i in dry.get((column.site_kind, column.joint), ()),
                )
            )  # fmt: skip
        elif column.effect in KINEMATIC:
            kinematics, direction = columns.kinematics, row({index[i]: 1.0})
            tilt = column.effect == "base_tilt"
            around = kinematics.tilt[column.index] if tilt else kinematics.offset[column.joint]
            unit = "rad" if tilt else columns.arm.units[column.joint]
            found.append(
                _Quantity(kinematic_name(columns, column), unit, direction, column.joint, around)
            )
    return found


def _with_powers(columns: Columns) -> list[str]:
    """Return the names of the effects that are polynomials of their joint's position."""
    return [term.NAME for term in columns.terms_looked_for if term.POWERS]


def _is_there(line: Array) -> bool:
    """Tell whether the columns leave a combination of the links' parameters open at all."""
    return bool(np.abs(line).max() > 1e-9)


def kinematic_name(columns: Columns, column: Column) -> str:
    """Return the name of a zero or of an angle of the base."""
    if column.effect == "base_tilt":
        return f"base_tilt.{('roll', 'pitch')[column.index]}"
    return f"joint_offset[{columns.arm.joint_names[column.joint]}]"


def _divided(columns: Columns, chosen: Sequence[int]) -> dict[tuple[str, int], list[int]]:
    """Return by kind of site and joint the columns that divide one torque by a choice.

    The elements of presliding are a basis: which of them a search takes, and how friction is
    divided among them and Coulomb friction, is no property of the arm.
    """
    found: dict[tuple[str, int], list[int]] = {}
    for term in {columns.effect(i): None for i in chosen if columns.columns[i].unit}:
        if not term.DIVIDED_WITH:
            continue
        for effect in (term, *term.DIVIDED_WITH):
            for i in columns.select(effect=effect.NAME):
                site = columns.columns[i].site_kind, columns.columns[i].joint
                if i in chosen and (effect is term or site in found):
                    found.setdefault(site, []).append(i)
    return found


def _motion_statements(design: Design) -> list[str]:
    arm, span = design.columns.arm, np.ptp(design.state.q, axis=0)
    least = HoldingSettings().narrow * arm.scale
    return [
        f"{joint.name} moves over {joint.shown(width)} only: parameters that depend on its "
        "position are not identifiable; move it over most of its range"
        for joint, width, narrow in zip(arm.joints, span, least, strict=True)
        if width < narrow
    ]


def _ranges(design: Design) -> list[str]:
    """Return the range of each joint's positions in words."""
    low, high = design.state.q.min(axis=0), design.state.q.max(axis=0)
    return [
        f"{joint.shown(least).split()[0]} to {joint.shown(most)}"
        for joint, least, most in zip(design.columns.arm.joints, low, high, strict=True)
    ]


def _pair_statements(
    quantities: Sequence[_Quantity], spread: Uncertainty, design: Design
) -> list[str]:
    """Name pairs of gravity, elastic and friction parameters that data cannot tell apart."""
    ranges, joints_of = _ranges(design), design.columns.arm.joint_names
    named = [q for q in quantities if (q.joint >= 0 or q.name.startswith("beta")) and not q.shared]
    statements, inseparable = [], IdentifiabilitySettings().inseparable
    for a, first in enumerate(named):
        for second in named[a + 1 :]:
            together = spread.correlation(first.direction, second.direction)
            if abs(together) < inseparable:
                continue
            joints = {q.joint for q in (first, second) if q.joint >= 0}
            hint = (
                " and ".join(
                    f"a wider range of {joints_of[j]} (now {ranges[j]})" for j in sorted(joints)
                )
                or "poses that turn the links about other axes against gravity"
            )
            sign = "difference" if together > 0 else "sum"
            statements.append(
                f"{first.name} and {second.name} cannot be separated (correlation "
                f"{together:+.3f}): only a weighted {sign} of them is identifiable; {hint} would "
                "separate them"
            )
    return statements


def _absent_statements(
    quantities: Sequence[_Quantity],
    columns: Columns,
    chosen: Sequence[int],
    solution: Solution,
    design: Design,
    weight: Array,
) -> list[str]:
    """Name gravity parameters that a linear elastic torque left out of the model could replace.

    Over a short range sin q is q: data then choose neither, and beta holds the sum of both. The
    correlation is that of the fit with the elastic column added (Schur complement).
    """
    statements, ranges = [], _ranges(design)
    inseparable = IdentifiabilitySettings().inseparable
    index = list(chosen)
    inverse = np.linalg.inv(solution.precision)
    linear = [columns.select(effect=effect, index=1) for effect in _with_powers(columns)]
    for column in chain(*linear):
        if column in chosen:
            continue
        x = design.x[:, :, column] * weight
        shared = inverse @ np.tensordot(x, design.x[:, :, index], ((0, 1), (0, 1)))
        joint = columns.columns[column].joint
        alone = float(np.sum(x * design.x[:, :, column])) + columns.scale[column] ** -2
        rest = alone - shared @ solution.precision @ shared
        for quantity in (q for q in quantities if q.name.startswith("beta")):
            through = float(quantity.direction @ shared)
            own = float(quantity.direction @ inverse @ quantity.direction)
            if through**2 < inseparable**2 * (rest * own + through**2):
                continue
            name = columns.arm.joint_names[joint]
            statements.append(
                f"{quantity.name} includes any linear elastic torque of {name}: over "
                f"{ranges[joint]} the two cannot be separated; a wider range of {name} would "
                "separate them"
            )
    return statements


def _dry_friction_statements(
    columns: Columns, chosen: Sequence[int], solution: Solution
) -> list[str]:
    """Say where only the sum of Coulomb friction and presliding is identifiable."""
    value = dict(zip(chosen, solution.theta.tolist(), strict=True))
    names = columns.arm.joint_names
    where = [
        f"{names[joint]} ({kind}, {sum(value[i] for i in parts):.3g} "
        f"{columns.arm.effort_units[joint]} together)"
        for (kind, joint), parts in _divided(columns, chosen).items()
    ]
    if not where:
        return []
    return [
        f"dry friction of {', '.join(where)}: how it divides into Coulomb friction and presliding "
        "depends on the displacements chosen for the elements, so neither counts as identifiable; "
        "more and slower reversals would separate them"
    ]


def _open_statements(quantities: Sequence[_Quantity], spread: Uncertainty) -> list[str]:
    unidentifiable = [
        quantity.name for quantity in quantities if not spread.identifiable(quantity.direction)
    ]
    if not unidentifiable:
        return []
    lean = "leans" if len(unidentifiable) == 1 else "lean"
    shown = unidentifiable[:_NAMED]
    if len(unidentifiable) > len(shown):
        shown.append(f"{len(unidentifiable) - _NAMED} more (grey in the report's table)")
    return [
        f"{len(unidentifiable)} of the {len(quantities)} parameters by name still {lean} on the "
        "prior, which may have moved the estimate by more than half of its standard error: "
        f"{'; '.join(shown)}"
    ]
