"""The nearest model that the dVRK console's calibration file can hold, by least squares.

The console has gravity with ten parameters on an upright base, and for each of joints 1 to 6 one
polynomial of degree four while the joint moves up and one while it moves down. What a compensator
does with a model at rest is fitted over the calibrated range by gravity and the mean of the two
polynomials; what it adds in motion, by half their difference. :mod:`.conversion` says what
is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS
from dvrk_gravity.arms.mtm import gravity
from dvrk_gravity.arrays import Array
from dvrk_gravity.console.document import stated_polynomials
from dvrk_gravity.console.file import LEVEL, N_GRAVITY, N_POLYNOMIALS, N_POWERS, form_model
from dvrk_gravity.effects import Blend, JointPolynomials, PlantPart, Range, State, Term, evaluate
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.parameters import node_parameters

RATIO, DEAD_BAND = "friction_compensation.ratio", "friction_compensation.dead_band"


@dataclass(frozen=True)
class ProjectionSettings:
    """How a model is brought into the console's form.

    Attributes:
        poses: At which it is fitted; there are 40 unknowns. Chosen.
        part: A tie between gravity and polynomials (sin q2 is q2 over a short range) goes to the
            smaller change: using all of what is plausible, this part of a joint's largest torque…
        slight: … must lower the error by this part of it (RMS) to be worth it. Chosen.
        still: A joint that moved less, rad, was not posed, and gets constants only. Chosen.
        saturation: Speed from which on friction is whole, rad/s: the most usual ``sat_vec_vec`` of
            real files.
        nothing: N·m, less than which a coefficient contributes nowhere in the range.
    """

    poses: int = 2000
    part: float = 0.2
    slight: float = 1e-4
    still: float = 0.1
    saturation: float = 0.2
    nothing: float = 1e-9


SETTINGS = ProjectionSettings()


def project(model: TorqueModel) -> tuple[TorqueModel, tuple[str, ...]]:
    """Return the model in the console's form that commands what a compensator would.

    Returns:
        Gravity of ten parameters with cables by direction of degree four, and what was
        changed on the way for safety, a line each.

    Raises:
        ConfigError: Terms whose ranges have nothing in common.
    """
    valid = calibrated_range(model)
    lower, upper = within_limits(model, valid)
    stated = [polynomials for _, polynomials in stated_polynomials(model)]
    blend = stated[0].blend or _own_blend(model)
    beta, mean = _fit_at_rest(model, stated, lower, upper)
    half = np.zeros((N_POWERS, N_JOINTS))
    for each in stated:
        half += _quartics(each.half_difference, model.joint_offset, lower, upper)
    level, smaller = _dry_friction(model)
    ratio, notes = _ratio(model, blend, level, smaller, half)
    half[0] += level
    polynomials = JointPolynomials(mean + half, mean - half, valid)
    form = form_model(model.arm, beta, polynomials, replace(blend, ratio=ratio))
    node = {name: value for name, value in model.node.items() if name not in (RATIO, DEAD_BAND)}
    return replace(form, node=node, document=model.document), notes


def within_limits(model: TorqueModel, valid: Range) -> tuple[Array, Array]:
    """Return the edges of the part of a range that lies within the arm's limits.

    Raises:
        ConfigError: There is none.
    """
    lower = np.maximum(valid.lower, model.arm.lower)
    upper = np.minimum(valid.upper, model.arm.upper)
    for joint, low, high in zip(JOINT_NAMES, lower.tolist(), upper.tolist(), strict=True):
        if low > high:
            raise ConfigError(
                f"valid_lower of {joint}", low, f"at most {high:g}: the ranges of the model's "
                "terms and the arm's limits have nothing in common",
            )  # fmt: skip
    return lower, upper


def calibrated_range(model: TorqueModel) -> Range:
    """Return the measured positions on which all of a model was fitted, else the arm's limits."""
    lower, upper = np.full(N_JOINTS, -np.inf), np.full(N_JOINTS, np.inf)
    for term in model.terms:
        if term.fitted_range is not None:
            lower = np.maximum(lower, term.fitted_range.lower + model.joint_offset)
            upper = np.minimum(upper, term.fitted_range.upper + model.joint_offset)
    # An edge a full turn beyond the joint's limits is none: model files have finite numbers.
    far = 2.0 * np.pi + np.abs([model.arm.lower, model.arm.upper]).max(axis=0)
    return Range(
        np.where(lower < -far, model.arm.lower, lower),
        np.where(upper > far, model.arm.upper, upper),
    )


def commanded_torque(model: TorqueModel, q: Array, qd: Array | None = None) -> Array:
    """Return (N, 7) torques that the compensator commands before its limits, N·m.

    Args:
        model: The model.
        q: (N, 7) measured positions, rad.
        qd: (N, 7) velocities beyond the dead band of its friction compensation, rad/s.
    """
    at = q - model.joint_offset
    part = np.array(_setting(model, RATIO))
    torque = np.zeros(q.shape)
    for term in model.terms:
        if not term.COMPENSATED:
            continue
        smooth, friction = term.split(part)
        if smooth is not None:
            torque += smooth.torque(State(at))  # of what is carried the weight alone
        if friction is not None:
            torque += friction.torque(State(at, qd))
    return torque


def unsupported_parts(model: TorqueModel) -> tuple[str, ...]:
    """Return what the console has nothing for, a line each."""
    never = [term.NAME for term in model.terms if not term.COMPENSATED]
    speed = [
        term.NAME
        for term in model.terms
        if term.FRICTION and term.COMPENSATED and _dry_levels(term) is None
    ]
    notes = []
    if never:
        notes.append(f"left out, as by the compensator: {', '.join(never)}")
    if speed:
        notes.append(
            f"left out, friction that depends on speed: {', '.join(speed)} (at some speeds "
            "the console would compensate more than there is)"
        )
    return tuple(notes)


def uniform_poses(lower: Array, upper: Array, count: int, seed: int) -> Array:
    """Return (count, 7) positions, uniform between two edges, the same ones each time."""
    return np.random.default_rng(seed).uniform(lower, upper, (count, N_JOINTS))


def _setting(model: TorqueModel, name: str) -> tuple[float, ...]:
    value = model.node.get(name, node_parameters(model.arm)[name].default)
    assert isinstance(value, tuple)
    return value


def _own_blend(model: TorqueModel) -> Blend:
    """Return the blend of the compensator's friction; none of a difference is applied."""
    dead_band = np.array(_setting(model, DEAD_BAND))
    saturation = np.maximum(SETTINGS.saturation, 2.0 * dead_band)
    return Blend(dead_band, saturation, np.zeros(N_JOINTS))


def _fit_at_rest(
    model: TorqueModel, stated: Iterable[JointPolynomials], lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Fit what the compensator commands at rest, beginning with what the console has, too.

    Returns:
        (10,) beta in N·m and (5, 7) coefficients of the mean polynomials.
    """
    q = uniform_poses(lower, upper, SETTINGS.poses, 1)
    able = model.arm.effort_limit
    beta, mean = np.zeros(N_GRAVITY), np.zeros((N_POWERS, N_JOINTS))
    for term in model.terms:
        if term.gravity_beta is not None:
            beta += term.gravity_beta[:N_GRAVITY]
    for each in stated:
        mean += _quartics(each.mean, model.joint_offset, lower, upper)
    y = gravity.regressor(q, LEVEL, N_GRAVITY)
    rest = commanded_torque(model, q) - y @ beta - evaluate(mean, q)
    columns = [y / able[:, None]]
    scale = [np.full(N_GRAVITY, SETTINGS.part * able[1])]
    for joint in range(N_POLYNOMIALS):
        values = _legendre(q[:, joint], lower[joint], upper[joint])
        block = np.zeros((SETTINGS.poses, N_JOINTS, values.shape[1]))
        block[:, joint] = values / able[joint]
        columns.append(block)
        scale.append(np.full(values.shape[1], SETTINGS.part * able[joint]))
    x = np.concatenate(columns, axis=2).reshape(SETTINGS.poses * N_JOINTS, -1)
    prior = np.diag(SETTINGS.slight * np.sqrt(SETTINGS.poses) / np.concatenate(scale))
    right = np.concatenate([(rest / able).ravel(), np.zeros(len(prior))])
    theta = np.linalg.lstsq(np.vstack([x, prior]), right)[0]
    start = N_GRAVITY
    for joint in range(N_POLYNOMIALS):
        powers = _powers(lower[joint], upper[joint])
        mean[:, joint] += powers @ theta[start : start + powers.shape[1]]
        start += powers.shape[1]
    return beta + theta[:N_GRAVITY], _without_rounding(mean, lower, upper)


def _quartics(coefficients: Array, offset: Array, lower: Array, upper: Array) -> Array:
    """Return (5, 7) coefficients nearest to (k, 7) ones of true positions, of joints 1 to 6."""
    found = np.zeros((N_POWERS, N_JOINTS))
    nodes = np.cos(np.linspace(0.0, np.pi, 201))  # denser at the edges
    for joint in range(N_POLYNOMIALS):
        true = np.polynomial.Polynomial([-offset[joint], 1.0])
        powers = coefficients[:, joint]
        if offset[joint]:
            powers = np.atleast_1d(np.polynomial.Polynomial(powers)(true).coef)
        if not powers[N_POWERS:].any():
            rows = min(N_POWERS, len(powers))
            found[:rows, joint] = powers[:rows]
            continue
        q = 0.5 * (lower[joint] + upper[joint]) + 0.5 * (upper[joint] - lower[joint]) * nodes
        x = _legendre(q, lower[joint], upper[joint])
        value = np.polynomial.polynomial.polyval(q, powers)
        found[:, joint] = _powers(lower[joint], upper[joint]) @ np.linalg.lstsq(x, value)[0]
    return _without_rounding(found, lower, upper)


def _legendre(q: Array, low: float, high: float) -> Array:
    """Return (N, k) Legendre polynomials over a range; constants alone where it is none."""
    degree = N_POWERS - 1 if high - low >= SETTINGS.still else 0
    half = max(0.5 * (high - low), SETTINGS.still)
    scaled = (q - 0.5 * (low + high)) / half
    return np.asarray(np.polynomial.legendre.legvander(scaled, degree), dtype=float)


def _powers(low: float, high: float) -> Array:
    """Return (5, k): powers of the position from the polynomials of :func:`_legendre`."""
    count = N_POWERS if high - low >= SETTINGS.still else 1
    matrix = np.zeros((N_POWERS, count))
    for k in range(count):
        domain = (low, high) if count > 1 else (low - 1.0, low + 1.0)
        polynomial = np.polynomial.Legendre.basis(k, domain=domain)
        matrix[: k + 1, k] = polynomial.convert(kind=np.polynomial.Polynomial).coef
    return matrix


def _without_rounding(coefficients: Array, lower: Array, upper: Array) -> Array:
    """Return coefficients with those at zero that are rounding."""
    reach = np.maximum(np.abs(lower), np.abs(upper)) ** np.arange(N_POWERS)[:, None]
    return np.where(np.abs(coefficients) * reach < SETTINGS.nothing, 0.0, coefficients)


def _dry_friction(model: TorqueModel) -> tuple[Array, Array]:
    """Return dry friction as levels of joints by themselves, N·m, and the levels that it has.

    Friction of a motor that several joints turn follows none of their directions alone; its
    level at each is the least-squares one over all directions.

    Returns:
        (7,) levels of joints by themselves, and (14,) those of joints and of motors, of both
        directions the smaller.
    """
    ways, level, smaller = _directions(), np.zeros(N_JOINTS), np.zeros(2 * N_JOINTS)
    for term in model.terms:
        dry = _dry_levels(term)
        if dry is not None:
            torque = term.torque(State(np.zeros(ways.shape), direction=ways))
            level += (ways * torque).mean(axis=0)
            smaller += dry.min(axis=0)
    level[N_POLYNOMIALS:] = 0.0
    return level, smaller


def _dry_levels(term: Term) -> Array | None:
    """Return (2, 14) levels, N·m, of friction that the compensator applies at any speed.

    Moving up and moving down, at the joints and then at the motors. ``None``: the term is no such
    friction.
    """
    friction = term.split(np.ones(N_JOINTS))[1] if term.COMPENSATED else None
    plant = PlantPart() if friction is None else friction.plant()
    with_speed = (plant.fade, plant.damping, plant.drag)
    return plant.dry if all(part is None for part in with_speed) else None


def _directions() -> Array:
    """Return (16, 7) signs, balanced for every three joints (a folded-over Hadamard matrix)."""
    from scipy.linalg import hadamard

    half = hadamard(8)[:, 1:].astype(float)
    return np.concatenate([half, -half])


def _ratio(
    model: TorqueModel, blend: Blend, level: Array, smaller: Array, half: Array
) -> tuple[Array, tuple[str, ...]]:
    """Return (7,) parts of the differences that are applied, and what was done to them.

    In no motion may the console put more power into the arm than the model's dry friction
    takes out. Both are linear between the planes on which a joint or a motor stands still, so
    that the worst motion lies on an edge where those planes meet.
    """
    wanted = np.array(_setting(model, RATIO))
    # Of a cable's friction the compensator applies the smaller of both parts.
    least = np.minimum(wanted, blend.ratio)
    ratio = np.where(half.any(axis=0), least, np.where(level > 0.0, wanted, blend.ratio))
    to_motor = model.arm.joint_to_actuator
    joint, motor = np.split(smaller, 2)
    before = ratio.copy()
    for motion in _edges(to_motor):
        taken = float(joint @ np.abs(motion) + motor @ np.abs(to_motor @ motion))
        given = float((ratio * level) @ np.abs(motion))
        if given > taken * (1.0 + 1e-9):
            ratio = np.where(np.abs(motion) > 0.0, ratio * taken / given, ratio)
    lowered = [
        f"{name} {was:.2g} to {now:.2g}"
        for name, was, now in zip(JOINT_NAMES, before, ratio, strict=True)
        if now < was
    ]
    if not lowered:
        return ratio, ()
    note = (
        f"{RATIO} lowered ({', '.join(lowered)}): in some motions a motor that "
        "several joints turn has less friction than these joints would have by themselves"
    )
    return ratio, (note,)


def _edges(to_motor: Array) -> Iterator[Array]:
    """Yield (7,) motions in which as many joints and motors as possible stand still."""
    planes: list[Array] = []
    for row in np.vstack([np.eye(N_JOINTS), to_motor]):
        unit = row / np.linalg.norm(row)
        if not any(np.abs(unit @ other) > 1.0 - 1e-9 for other in planes):
            planes.append(unit)
    for chosen in combinations(planes, N_JOINTS - 1):
        _, size, basis = np.linalg.svd(np.array(chosen))
        if size[-1] > 1e-9:
            motion = basis[-1]
            yield np.where(np.abs(motion) > 1e-9, motion, 0.0)
