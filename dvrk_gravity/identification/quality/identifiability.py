"""What the data of trajectories determine: parameters with intervals, and sentences on the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, combinations, product

import numpy as np

from dvrk_gravity.arms import Arm, is_mtm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import (
    Column,
    Kind,
    Site,
    base_directions,
    beta_map,
    link_columns,
    samples,
    spring_columns,
    weight_directions,
)
from dvrk_gravity.estimation import Solution, Uncertainty
from dvrk_gravity.gravity import BETA_NAMES
from dvrk_gravity.identification.quality.uncertainty import NARROW
from dvrk_gravity.identification.result import FittedParameter, Identifiability
from dvrk_gravity.model import Columns
from dvrk_gravity.observation import Design

_NAMED = 6  # parameters in a sentence; the report's table has all
_SHOWN = 3  # parameters named in one combination
# Of a joint's range: what `excite` uses (0.9) within its margins to both stops (0.05 each).
_ALL = 0.8
# Correlation of two estimates from which on they count as inseparable. At 0.97 a standard error is
# four times what it would be with the other one known, 1 / sqrt(1 - 0.97^2).
INSEPARABLE = 0.97

_INERTIAL = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_UNITS = ("kg", *("kg·m",) * 3, *("kg·m^2",) * 6)

# Name, unit and (parameters,) combination of each.
BaseParameters = tuple[tuple[str, str, Array], ...]


@lru_cache(maxsize=8)
def base_parameters(arm: Arm) -> BaseParameters:
    """Return name, unit and (10 bodies,) combination of the arm's base inertial parameters."""
    full = rigid_body.regressor(arm, *samples(arm), arm.gravity)
    return _base_parameters(arm, full, base_directions(arm).shape[1])


@lru_cache(maxsize=8)
def base_weights(arm: Arm) -> BaseParameters:
    """Return the same of masses and first moments, (4 bodies,), as far as they act at rest."""
    full = rigid_body.weight_regressor(arm, samples(arm)[0], arm.gravity)
    return _base_parameters(arm, full, weight_directions(arm).shape[1])


def _base_parameters(arm: Arm, full: Array, rank: int) -> BaseParameters:
    """Return the base parameters of a regressor.

    Its independent columns come from a QR with pivoting; each other column is a combination of
    those, and its parameter joins theirs (Gautier 1991; Khalil and Dombre 2002).

    Args:
        arm: The arm.
        full: (N, n, p) columns of each body's parameters, body by body.
        rank: Number of combinations that act.
    """
    from scipy.linalg import qr, solve_triangular

    full = full.reshape(-1, full.shape[-1])
    of_body = full.shape[-1] // len(arm.bodies)
    norm = np.linalg.norm(full, axis=0)
    norm[norm < 1e-9 * norm.max()] = np.inf
    r, order = qr(full / norm, mode="r", pivoting=True)
    depends = solve_triangular(r[:rank, :rank], r[:rank, rank:])
    found = []
    for k in range(rank):
        combination = np.zeros(full.shape[1])
        combination[order[k]] = 1.0
        finite = np.isfinite(norm[order[rank:]])
        ratio = depends[k] * np.where(finite, norm[order[rank:]], 0.0) / norm[order[k]]
        combination[order[rank:]] = np.where(np.abs(ratio) > 1e-9, ratio, 0.0)
        first = int(order[k])
        name = _combination_name(arm, combination, first, of_body)
        found.append((name, _UNITS[first % of_body], combination))
    return tuple(found)


def _combination_name(arm: Arm, combination: Array, first: int, of_body: int) -> str:
    def name(i: int) -> str:
        return f"{_INERTIAL[i % of_body]}({arm.body_names[i // of_body]})"

    others = [i for i in np.flatnonzero(combination).tolist() if i != first]
    others.sort(key=lambda i: -abs(combination[i]))
    text = name(first)
    for i in others[:_SHOWN]:
        text += f" {combination[i]:+.3g} {name(i)}"
    return text + (f" + {len(others) - _SHOWN} more" if len(others) > _SHOWN else "")


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A named combination of the chosen coefficients.

    Attributes:
        name: As in the model file.
        unit: SI unit.
        direction: (p,) weights of the chosen coefficients.
        joint: Joint that it acts on, -1 for links and base.
        around: Value that the combination adds to.
        divided: Divided from another by a choice, so that its interval is too narrow.
    """

    name: str
    unit: str
    direction: Array
    joint: int
    around: float = 0.0
    divided: bool = False


def describe(
    columns: Columns,
    chosen: Sequence[int],
    solution: Solution,
    spread: Uncertainty,
    design: Design,
    weight: Array,
) -> tuple[tuple[FittedParameter, ...], Identifiability]:
    """Return the identified numbers with intervals, and what cannot be separated.

    Args:
        columns: All columns.
        chosen: Columns of the fit.
        solution: The fit.
        spread: Its covariance.
        design: The samples.
        weight: (N, n) weight of each sample in the fit.
    """
    quantities = _quantities(columns, chosen)
    parameters = []
    for quantity in quantities:
        value = quantity.around + float(quantity.direction @ solution.theta)
        interval = spread.interval(value, quantity.direction)
        known = spread.identifiable(quantity.direction) and not quantity.divided
        parameters.append(FittedParameter(quantity.name, value, quantity.unit, interval, known))
    statements = (
        *_motion_statements(design),
        *_pair_statements(quantities, spread, design),
        *_absent_statements(quantities, columns, chosen, solution, design, weight),
        *_dry_friction_statements(columns, chosen, solution),
        *_open_statements(quantities, spread),
    )
    return tuple(parameters), determined(solution, statements)


def determined(solution: Solution, statements: tuple[str, ...]) -> Identifiability:
    """Return rank and condition of what the data of a fit determine, with statements about it."""
    # Information in units of the prior's: above one, the data determine more than it does.
    information = np.linalg.eigvalsh(solution.prior[:, None] * solution.data * solution.prior)
    known = information[information > 1.0]
    condition = float(np.sqrt(known[-1] / known[0])) if len(known) else float("inf")
    return Identifiability(len(known), len(information), condition, statements)


def _quantities(columns: Columns, chosen: Sequence[int]) -> list[_Quantity]:
    index = {column: i for i, column in enumerate(chosen)}
    rigid = [index[i] for i in link_columns(columns) if i in index]
    arm, kinematics = columns.arm, columns.kinematics
    found: list[_Quantity] = []

    def row(values: dict[int, float]) -> Array:
        direction = np.zeros(len(chosen))
        direction[list(values)] = list(values.values())
        return direction

    springs = {columns.columns[i].index: index[i] for i in spring_columns(columns) if i in index}
    if rigid:
        of_beta = beta_map(columns.mounted) @ columns.base if is_mtm(arm) else ()
        for k, line in enumerate(of_beta):
            if not _is_there(line):
                continue
            values = dict(zip(rigid, line, strict=True))
            if k in springs:
                values[springs[k]] = 1.0
            found.append(_Quantity(f"beta[{k}] ({BETA_NAMES[k]})", "N·m", row(values), -1))
        for name, unit, combination in base_parameters(columns.mounted):
            line = combination @ columns.base
            if _is_there(line):
                direction = row(dict(zip(rigid, line, strict=True)))
                found.append(_Quantity(name, arm.own_unit(unit), direction, -1))
    for (j, joint), effect in product(enumerate(arm.joints), _with_powers(columns)):
        powers = [i for i in columns.select(effect, Site.joint(j)) if i in index]
        matrix = columns.basis(effect)[j :: arm.n, j :: arm.n]
        for k in range(len(powers)):
            values = {index[i]: matrix[k, columns.columns[i].index] for i in powers}
            per = "" if k == 0 else f"/{arm.units[j]}" if k == 1 else f"/{arm.units[j]}^{k}"
            unit = arm.effort_units[j] + per
            found.append(_Quantity(f"{effect}.{joint.name}[{k}]", unit, row(values), j))
    divided = _divided(columns, chosen)
    for i in chosen:
        column, direction = columns.columns[i], row({index[i]: 1.0})
        if column.unit:
            found.append(
                _Quantity(
                    columns.effect(i).coefficient_name(arm, column),
                    column.site.unit(arm, column.unit), direction, column.joint,
                    divided=i in divided.get(column.site, ()),
                )
            )  # fmt: skip
        elif i in columns.kinematic:
            tilt = column.site.kind is Kind.BASE
            around = kinematics.tilt[column.index] if tilt else kinematics.offset[column.joint]
            unit = "rad" if tilt else arm.units[column.joint]
            name = kinematic_name(columns, column)
            found.append(_Quantity(name, unit, direction, column.joint, around))
    return found


def _with_powers(columns: Columns) -> list[str]:
    """Return the names of the effects that are polynomials of their joint's position."""
    return [term.NAME for term in columns.candidate_terms if term.polynomials is not None]


def _is_there(line: Array) -> bool:
    """Whether the columns leave a combination of the links' parameters open at all."""
    return bool(np.abs(line).max() > 1e-9)


def kinematic_name(columns: Columns, column: Column) -> str:
    """Return the name of an encoder offset or of an angle of the base."""
    if column.site.kind is Kind.BASE:
        return f"{column.effect}.{('roll', 'pitch')[column.index]}"
    return f"{column.effect}[{columns.arm.joint_names[column.joint]}]"


def _divided(columns: Columns, chosen: Sequence[int]) -> dict[Site, list[int]]:
    """Return by site the columns that divide one torque by a choice.

    The elements of presliding are a basis: which of them a search takes, and how friction is
    divided among them and Coulomb friction, is no property of the arm.
    """
    found: dict[Site, list[int]] = {}
    for term in {columns.effect(i): None for i in chosen if columns.columns[i].unit}:
        if not term.DIVIDED_WITH:
            continue
        for effect in (term, *term.DIVIDED_WITH):
            for i in columns.select(effect.NAME):
                site = columns.columns[i].site
                if i in chosen and (effect is term or site in found):
                    found.setdefault(site, []).append(i)
    return found


def _motion_statements(design: Design) -> list[str]:
    arm, span = design.columns.arm, np.ptp(design.state.q, axis=0)
    return [
        f"{joint.name} moves over {joint.shown(width)} only: parameters that depend on its "
        "position are not identifiable; move it over most of its range"
        for joint, width, narrow in zip(arm.joints, span, NARROW * arm.scale, strict=True)
        if width < narrow
    ]


def _ranges(design: Design) -> list[str]:
    """Return the range of each joint's positions in words."""
    low, high = design.state.q.min(axis=0), design.state.q.max(axis=0)
    return [
        f"{joint.shown(least).split()[0]} to {joint.shown(most)}"
        for joint, least, most in zip(design.columns.arm.joints, low, high, strict=True)
    ]


def _spent(design: Design) -> list[bool]:
    """Return of each joint whether it moved as far as a motion within its stops may ask for."""
    arm, way = design.columns.arm, np.ptp(design.state.q, axis=0)
    return [bool(each) for each in way >= _ALL * (arm.upper - arm.lower)]


def _pair_statements(
    quantities: Sequence[_Quantity], spread: Uncertainty, design: Design
) -> list[str]:
    """Name inseparable pairs of gravity, elastic and friction parameters."""
    ranges, joints_of, spent = _ranges(design), design.columns.arm.joint_names, _spent(design)
    named = [q for q in quantities if (q.joint >= 0 or q.name.startswith("beta")) and not q.divided]
    statements = []
    for first, second in combinations(named, 2):
        correlation = spread.correlation(first.direction, second.direction)
        if abs(correlation) < INSEPARABLE:
            continue
        joints = sorted({q.joint for q in (first, second) if q.joint >= 0})
        wider = " and ".join(
            f"a wider range of {joints_of[j]} (now {ranges[j]})" for j in joints if not spent[j]
        )  # fmt: skip
        if joints and not wider:
            remedy = f"the limits of {' and '.join(joints_of[j] for j in joints)} leave no more"
        else:
            wider = wider or "poses that turn the links about other axes against gravity"
            remedy = f"{wider} would separate them"
        statements.append(
            f"{first.name} and {second.name} cannot be separated (correlation {correlation:+.3f}): "
            f"only a weighted {'difference' if correlation > 0 else 'sum'} of them is "
            f"identifiable; {remedy}"
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
    """Name gravity parameters that a linear elastic torque outside the model could replace.

    Over a short range sin q is q: data then choose neither, and beta holds the sum of both. The
    correlation is that of the fit with the elastic column added (Schur complement).
    """
    statements, ranges, spent = [], _ranges(design), _spent(design)
    index = list(chosen)
    inverse = np.linalg.inv(solution.precision)
    linear = [columns.select(effect, index=1) for effect in _with_powers(columns)]
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
            if through**2 < INSEPARABLE**2 * (rest * own + through**2):
                continue
            name = columns.arm.joint_names[joint]
            remedy = (
                f"the limits of {name} leave no more"
                if spent[joint]
                else f"a wider range of {name} would separate them"
            )
            statements.append(
                f"{quantity.name} includes any linear elastic torque of {name}: over "
                f"{ranges[joint]} the two cannot be separated; {remedy}"
            )
    return statements


def _dry_friction_statements(
    columns: Columns, chosen: Sequence[int], solution: Solution
) -> list[str]:
    """Name joints where only the sum of Coulomb friction and presliding is identifiable."""
    value = dict(zip(chosen, solution.theta.tolist(), strict=True))
    where = [
        f"{columns.arm.joint_names[site.index]} ({site.kind.value}, "
        f"{sum(value[i] for i in parts):.3g} {columns.arm.effort_units[site.index]} together)"
        for site, parts in _divided(columns, chosen).items()
    ]
    if not where:
        return []
    return [
        f"dry friction of {', '.join(where)}: how it divides into Coulomb friction and presliding "
        "depends on the displacements chosen for the elements, so neither counts as identifiable; "
        "more and slower reversals would separate them"
    ]


def _open_statements(quantities: Sequence[_Quantity], spread: Uncertainty) -> list[str]:
    names = [q.name for q in quantities if not spread.identifiable(q.direction)]
    if not names:
        return []
    shown = names[:_NAMED]
    if len(names) > len(shown):
        shown.append(f"{len(names) - _NAMED} more (grey in the report's table)")
    return [
        f"{len(names)} of {len(quantities)} named parameters depend on the prior, which may have "
        f"moved the estimate by more than half of its standard error: {'; '.join(shown)}"
    ]
