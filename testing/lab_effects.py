"""Effects hidden in what a motion takes, sized by what a good model leaves of each joint's torque.

They are written for the trials alone: torques of masses come from an engine that the caller brings
(MuJoCo, or Pinocchio on recorded motions), all else from the formulas below.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.signal import butter, sosfiltfilt

from dvrk_gravity.arms import gravity_in_base
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import evaluate
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.hidden_parts import Hidden, found, saturated
from testing.lab_physics import Truth, lagging

Random = np.random.Generator
G = 9.81

SIZES = (1.5, 6.0)  # times what the model leaves, RMS
_TRIES = 30  # at a place where the effect can be as large as that
_HALVINGS = 40
BAND = 8.0  # Hz; what a model leaves, and what is hidden, are compared below that


def left_by(model: TorqueModel, recording: Recording) -> Array:
    """Return (n,) what a model leaves of a recording, RMS below :data:`BAND`, N·m or N."""
    found = evaluate(model, [recording], "joint", BAND)
    return np.array([error.rmse for error in found.joints.values()])


class Bodies(Protocol):
    """What computes the torques of masses along a motion."""

    def added(
        self, motion: tuple[Array, Array, Array], joint: int, mass: float, com: Array,
        inertia: float = 0.0,
    ) -> Array:  # fmt: skip
        """Return (T, n) efforts of a point mass, kg, and an inertia, kg·m^2, on a joint's link."""

    def torque(self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None) -> Array:
        """Return (T, n) efforts of the arm's own masses under some gravity."""


@dataclass(frozen=True, eq=False)
class Setting:
    """Where an effect is hidden.

    Attributes:
        truth: The motion and its efforts without it.
        bodies: The arm's masses.
        residual: (n,) what the identified model leaves of the motion, RMS below :data:`BAND`, N·m
            or N.
        payload: Least and greatest mass that somebody would fasten to the arm, kg.
        reach: How far from a link's centre it may be along each axis, m.
        centres: (n, 3) about where in its own frame each joint's link is, m.
        delay: How much older than positions the sensors' efforts are without it, s.
        rotors: (n,) reflected inertia at the motors, kg·m^2 or kg; zero where nobody knows.
    """

    truth: Truth
    bodies: Bodies
    residual: Array
    payload: tuple[float, float]
    reach: float
    centres: Array
    delay: float = 0.0
    rotors: Array | float = 0.0

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.truth.arm.n

    @cached_property
    def speed(self) -> Array:
        """(n,) RMS of the velocities."""
        return np.sqrt(np.mean(self.truth.qd**2, axis=0))

    @cached_property
    def way(self) -> Array:
        """(n,) half of the way of the joints."""
        return 0.5 * np.ptp(self.truth.q, axis=0)

    @cached_property
    def by_gravity(self) -> Array:
        """(3, T, n) efforts for one m/s^2 along every axis of the base."""
        q = self.truth.q
        still = np.zeros_like(q)
        return np.stack([self.bodies.torque(q, still, still, axis) for axis in np.eye(3)])

    def slope(self, joint: int) -> Array:
        """Return (T, n) change of the efforts with a joint's position, N·m/rad."""
        q, qd, qdd = self.truth.motion
        step = np.zeros(self.n)
        step[joint] = 1e-4
        change = self.bodies.torque(q + step, qd, qdd) - self.bodies.torque(q - step, qd, qdd)
        return change / 2e-4

    def ratio(self, torque: Array) -> float:
        """Return the largest RMS of a torque (T, n) in units of what the model leaves.

        Below :data:`BAND`, as what is left: noise that is scaled, clipped or late is noise still.
        """
        return float(np.max(np.sqrt(np.mean(self.slow(torque) ** 2, axis=0)) / self.residual))

    def slow(self, torque: Array) -> Array:
        """Return a torque (T, n) below :data:`BAND`."""
        return np.asarray(sosfiltfilt(self._low_pass, torque, axis=0))

    @cached_property
    def _low_pass(self) -> Array:
        rate = 1.0 / float(np.median(np.diff(self.truth.time)))
        return np.asarray(butter(2, BAND, fs=rate, output="sos"))


@dataclass(frozen=True, eq=False)
class Hiding:
    """A motion with an effect hidden in it.

    Attributes:
        truth: What the sensors see.
        hidden: What was hidden.
        ratio: Its RMS in units of what the model leaves, on the joint where that is most; of a
            push, while it pushes.
    """

    truth: Truth
    hidden: Hidden
    ratio: float


def hide(
    setting: Setting, effect: str, random: Random, joint: int | None = None,
    sizes: tuple[float, float] = SIZES, shapers: Mapping[str, Shaper] | None = None,
) -> Hiding:  # fmt: skip
    """Hide an effect, some times as large as what the model leaves if it can be.

    Args:
        setting: Where.
        effect: Name in the vocabulary, or ``"nothing"``.
        random: Where joint, size and shape come from.
        joint: Index of the joint, or of the link's; ``None``: drawn.
        sizes: Least and greatest, in units of what the model leaves.
        shapers: How each is hidden; by default :data:`HIDERS`.

    Raises:
        ConfigError: No such effect.
    """
    shapers = shapers or HIDERS
    if effect not in shapers:
        raise ConfigError("effect", effect, f"one of {', '.join(sorted(shapers))}")
    target = float(np.exp(random.uniform(*np.log(sizes))))
    best: Hiding | None = None
    for _ in range(_TRIES):
        where = int(random.integers(setting.n)) if joint is None else joint
        hiding = shapers[effect](setting, random, where, target)
        if best is None or abs(hiding.ratio - target) < abs(best.ratio - target):
            best = hiding
        if best.ratio > 0.95 * sizes[0] or effect == "nothing":
            break
    assert best is not None
    return best


Shaper = Callable[[Setting, Random, int, float], Hiding]


def _scaled(
    setting: Setting, unit: Array, least: float, greatest: float, target: float
) -> tuple[float, float]:
    """Return the factor on a torque within limits that comes next to a ratio, and that ratio."""
    size = setting.ratio(unit)
    factor = float(np.clip(target / max(size, 1e-12), least, greatest))
    return factor, factor * size


def _searched(
    setting: Setting, torque: Callable[[float], Array], least: float, greatest: float, target: float
) -> tuple[float, float]:
    """Return the setting of a torque that grows with it which comes next to a ratio."""
    low, high = least, greatest
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        if setting.ratio(torque(middle)) < target:
            low = middle
        else:
            high = middle
    return low, setting.ratio(torque(low))


def _with(setting: Setting, torque: Array, ratio: float, hidden: Hidden) -> Hiding:
    truth = setting.truth
    return Hiding(replace(truth, effort=truth.effort + torque), hidden, ratio)


def _on(setting: Setting, joint: int, values: Array) -> Array:
    torque = np.zeros_like(setting.truth.effort)
    torque[:, joint] = values
    return torque


def _own(
    setting: Setting, joint: int, shape: Array, target: float, effect: str,
    **per_unit: float,
) -> Hiding:  # fmt: skip
    """Hide a torque of one joint that is as large as it is to be; parameters grow with it."""
    unit = _on(setting, joint, shape)
    factor, ratio = _scaled(setting, unit, 0.0, np.inf, target)
    parameters = {name: factor * value for name, value in per_unit.items()}
    return _with(setting, factor * unit, ratio, _found(setting, effect, joint, **parameters))


def _found(setting: Setting, effect: str, joint: int | None, **parameters: float) -> Hidden:
    return found(setting.truth.arm, effect, joint, **parameters)


def _and(hiding: Hiding, **parameters: float) -> Hiding:
    hidden = hiding.hidden
    return replace(hiding, hidden=replace(hidden, parameters={**hidden.parameters, **parameters}))


def _sign(random: Random) -> float:
    return float(random.choice([-1.0, 1.0]))


def _nothing(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    del random, joint, target
    return Hiding(setting.truth, _found(setting, "nothing", None), 0.0)


def payload(setting: Setting, joint: int, mass: float, com: Array) -> Hiding:
    """Fasten a mass to a link.

    Args:
        setting: Where.
        joint: Whose link.
        mass: kg.
        com: (3,) in the link's frame, m.
    """
    torque = setting.bodies.added(setting.truth.motion, joint, mass, com)
    return _with(setting, torque, setting.ratio(torque), _mass(setting, joint, mass, com))


def _mass(setting: Setting, joint: int, mass: float, com: Array) -> Hidden:
    moments = {f"first_moment_{axis}": mass * at for axis, at in zip("xyz", com, strict=True)}
    return _found(setting, "payload", joint, mass=mass, **moments)


def _payload(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    # Things are fastened to what is far out, mostly.
    joint = setting.n - 1 if random.random() < 0.4 else max(joint, 1)
    com = setting.centres[joint] + setting.reach * random.uniform(-1.0, 1.0, 3)
    unit = setting.bodies.added(setting.truth.motion, joint, 1.0, com)
    mass, ratio = _scaled(setting, unit, *setting.payload, target)
    return _with(setting, mass * unit, ratio, _mass(setting, joint, mass, com))


def _link_com(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    joint = max(joint, 1)
    axis = np.eye(3)[random.integers(3)]
    plus, minus = (
        setting.bodies.added(setting.truth.motion, joint, 0.5, side * axis) for side in (1.0, -1.0)
    )
    moment = G * setting.payload[1] * setting.reach * 4.0  # N·m, of what is plausible
    unit = (plus - minus) / G
    factor, ratio = _scaled(setting, unit, 0.02 * moment, moment, target)
    factor *= _sign(random)
    return _with(setting, factor * unit, ratio,
                 _found(setting, "link_com", joint, delta_beta=factor))  # fmt: skip


def _link_inertia(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    del random
    inertia = 1e-3
    unit = setting.bodies.added(setting.truth.motion, joint, 0.0, np.zeros(3), inertia) / inertia
    factor, ratio = _scaled(setting, unit, 0.0, np.inf, target)
    return _with(setting, factor * unit, ratio,
                 _found(setting, "link_inertia", joint, inertia=factor))  # fmt: skip


def _base_tilt(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    del joint
    way = random.uniform(0.0, 2.0 * np.pi)
    base = setting.truth.arm.gravity

    def torque(angle: float) -> Array:
        change = gravity_in_base(angle * np.cos(way), angle * np.sin(way)) - base
        return np.tensordot(change, setting.by_gravity, 1)

    angle, ratio = _searched(setting, torque, np.radians(0.3), np.radians(6.0), target)
    roll, pitch = angle * np.cos(way), angle * np.sin(way)
    return _with(setting, torque(angle), ratio,
                 _found(setting, "base_tilt", None, roll=roll, pitch=pitch))  # fmt: skip


def _joint_offset(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    scale = float(setting.truth.arm.scale[joint])
    greatest = np.radians(8.0) * scale
    size, ratio = _scaled(setting, setting.slope(joint), 0.05 * greatest, greatest, target)
    offset = size * _sign(random)
    shift = np.zeros(setting.n)
    shift[joint] = offset
    truth = replace(setting.truth, q=setting.truth.q + shift)
    return Hiding(truth, _found(setting, "joint_offset", joint, offset=offset), ratio)


def _torque_scale(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    unit = _on(setting, joint, setting.truth.effort[:, joint])
    part, ratio = _scaled(setting, unit, 0.03, 0.4, target)
    part *= _sign(random)
    return _with(setting, part * unit, ratio,
                 _found(setting, "torque_scale", joint, factor=1.0 + part))  # fmt: skip


def _torque_offset(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    shape = np.full(len(setting.truth.time), _sign(random))
    return _own(setting, joint, shape, target, "torque_offset", offset=float(shape[0]))


def _direction(setting: Setting, joint: int) -> Array:
    """Return (T,) the sign of the velocity, which a joint turns round within a hair's breadth."""
    qd = setting.truth.qd[:, joint]
    result: Array = np.tanh(qd / (0.01 * setting.speed[joint]))
    return result


def _coulomb(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    way = _direction(setting, joint)
    down = float(random.choice([1.0, random.uniform(0.7, 1.5)]))
    shape = np.where(way > 0.0, 1.0, down) * way
    return _own(setting, joint, shape, target, "coulomb_friction", positive=1.0, negative=down)


def _viscous(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    del random
    shape = setting.truth.qd[:, joint]
    return _own(setting, joint, shape, target, "viscous_friction", coefficient=1.0)


def _stribeck(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    qd = setting.truth.qd[:, joint]
    velocity = float(setting.speed[joint] * random.uniform(0.2, 0.6))
    shape = _direction(setting, joint) * np.exp(-((qd / velocity) ** 2))
    hiding = _own(setting, joint, shape, target, "stribeck_friction", level=1.0)
    return _and(hiding, velocity=velocity)


def _presliding(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    q, qd = setting.truth.q[:, [joint]], setting.truth.qd[:, [joint]]
    length = float(setting.way[joint] * random.uniform(0.05, 0.25))
    shape = lagging(q, np.sign(qd), np.array([length]))[:, 0]
    hiding = _own(setting, joint, shape, target, "presliding_hysteresis", level=1.0)
    return _and(hiding, length=length)


def _cable(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    q = setting.truth.q[:, joint]
    away = q - q.mean()
    if random.random() < 0.5:
        sign = _sign(random)
        return _own(setting, joint, sign * away, target, "elastic_cable", stiffness=sign)
    bent = np.tanh((away - random.uniform(-0.5, 0.5) * setting.way[joint])
                   / (random.uniform(0.3, 0.8) * setting.way[joint]))  # fmt: skip
    return _own(setting, joint, bent * _sign(random), target, "elastic_cable")


def _rotor(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    del random
    arm, motor = setting.truth.arm, np.zeros_like(setting.truth.qdd)
    motor[:, joint] = arm.actuator_position(setting.truth.qdd)[:, joint]
    unit = arm.joint_effort(motor)
    factor, ratio = _scaled(setting, unit, 0.0, np.inf, target)
    return _with(setting, factor * unit, ratio,
                 _found(setting, "rotor_inertia", joint, inertia=factor))  # fmt: skip


def _coupling(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    others = [other for other in range(setting.n) if 1 <= abs(other - joint) <= 2]
    source = int(random.choice(others))
    unit = _on(setting, joint, setting.truth.effort[:, source])
    factor, ratio = _scaled(setting, unit, 0.002, 0.3, target)
    factor *= _sign(random)
    names = setting.truth.arm.joint_names
    hidden = Hidden("joint_coupling", (names[joint], names[source]), {"factor": factor})
    return _with(setting, factor * unit, ratio, hidden)


def _delay(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    del random, joint
    time, effort = setting.truth.time, setting.truth.effort

    def late(delay: float) -> Array:
        columns = [np.interp(time - delay, time, column) for column in effort.T]
        return np.stack(columns, axis=1) - effort

    delay, ratio = _searched(setting, late, 0.003, 0.05, target)
    # Of efforts and positions, as a recording shows it: the model knows of no other one either.
    told = _found(setting, "time_delay", None, delay=delay + setting.delay)
    return _with(setting, late(delay), ratio, told)


def _drift(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    constant = float(random.uniform(6.0, 30.0))
    time = setting.truth.time
    begin = max(time[0], 0.0)  # drift that was over by then would be an offset
    shape = _sign(random) * (1.0 - np.exp(-np.maximum(time - begin, 0.0) / constant))
    sign = float(np.sign(shape[-1]))
    hiding = _own(setting, joint, shape, target, "thermal_drift", torque=sign)
    return _and(hiding, time_constant=constant)


def _saturation(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    del random
    effort = setting.truth.effort[:, joint]
    most = float(np.percentile(np.abs(effort), 99.5))

    def cut(part: float) -> Array:
        limit = (1.0 - part) * most
        return _on(setting, joint, np.clip(effort, -limit, limit) - effort)

    part, ratio = _searched(setting, cut, 0.05, 0.6, target)
    hidden = _found(setting, "effort_saturation", joint, limit=(1.0 - part) * most)
    return _with(setting, cut(part), ratio, hidden)


def _cogging(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    arm = setting.truth.arm
    at = arm.actuator_position(setting.truth.q)[:, joint]
    cycles = float(random.uniform(8.0, 24.0) / (0.5 * np.ptp(at)))
    phase = float(random.uniform(-np.pi, np.pi))
    motor = np.zeros_like(setting.truth.q)
    motor[:, joint] = np.cos(cycles * at + phase)
    unit = arm.joint_effort(motor)
    factor, ratio = _scaled(setting, unit, 0.0, np.inf, target)
    hidden = _found(setting, "cogging", joint, amplitude=factor, cycles_per_revolution=cycles,
                    phase=phase)  # fmt: skip
    return _with(setting, factor * unit, ratio, hidden)


def _contact(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    truth, sign = setting.truth, _sign(random)
    if random.random() < 0.4:  # something in the way of the joint gives like a spring
        q = truth.q[:, joint]
        wall = float(np.quantile(q, 0.8 if sign > 0.0 else 0.2))
        shape = np.maximum(sign * (q - wall), 0.0) * sign
        return _and(_own(setting, joint, shape, target, "contact", stiffness=1.0), position=wall)
    length = truth.time[-1] - max(truth.time[0], 0.0)
    start = max(truth.time[0], 0.0) + float(random.uniform(0.1, 0.6) * length)
    end = start + float(random.uniform(0.07, 0.2) * length)
    shape = sign * ((truth.time >= start) & (truth.time < end))
    share = np.sqrt(np.mean(shape**2))
    hiding = _own(setting, joint, shape, target * share, "contact", torque=sign)
    return _and(replace(hiding, ratio=hiding.ratio / share), start=start, end=end)


def _spring(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    first = min(joint, setting.n - 2)
    second = first + int(random.integers(1, min(3, setting.n - first)))
    q, scale = setting.truth.q, setting.truth.arm.scale
    ratio = float(random.uniform(0.6, 1.6) * scale[first] / scale[second])
    row = np.zeros(setting.n)
    row[first], row[second] = 1.0, ratio * _sign(random)
    stretch = q @ row
    slack = random.uniform(*np.quantile(stretch, [0.1, 0.9]))
    unit = (stretch - slack)[:, None] * row
    stiffness, size = _scaled(setting, unit, 0.0, np.inf, target)
    names = setting.truth.arm.joint_names
    hidden = Hidden("joint_spring", (names[first], names[second]),
                    {"stiffness": stiffness, "ratio": ratio})  # fmt: skip
    return _with(setting, stiffness * unit, size, hidden)


def _encoder_scale(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    truth, turned = setting.truth, np.eye(setting.n)[joint]

    def read(part: float) -> tuple[Array, Array, Array]:
        q, qd, qdd = (values * (1.0 + part * turned) for values in truth.motion)
        return q, qd, qdd

    small = 1e-3
    unit = (setting.bodies.torque(*read(small)) - setting.bodies.torque(*read(-small))) / (
        2.0 * small
    )
    part, ratio = _scaled(setting, unit, 0.005, 0.15, target)
    part *= _sign(random)
    q, qd, qdd = read(part)
    return Hiding(replace(truth, q=q, qd=qd, qdd=qdd),
                  _found(setting, "encoder_scale", joint, factor=1.0 + part), ratio)  # fmt: skip


def _falling_constant(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    """Let a motor saturate: currents, read as efforts, are too large towards the peak."""
    del random
    effort = setting.truth.effort[:, joint]

    def more(part: float) -> Array:
        return _on(setting, joint, saturated(effort, part) - effort)

    part, ratio = _searched(setting, more, 0.005, 0.13, target)
    return _with(setting, more(part), ratio, _found(setting, "torque_saturation", joint))


def _flexible(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    """Let a joint give way under its load: the encoder is at the motor, the link behind it.

    By 5 deg at most, and so little that it resonates above the band that is compared: no servo
    would hold an arm that swings within it, and a recorded motion would have shown that.
    """
    del random
    truth = setting.truth
    step = float(truth.time[1] - truth.time[0])
    link = setting.bodies.torque(*truth.motion)
    load = setting.slow(_on(setting, joint, link[:, joint]))  # recorded accelerations have noise
    rate = np.gradient(load, step, axis=0)
    give = load, rate, np.gradient(rate, step, axis=0)

    def read(compliance: float) -> tuple[Array, Array, Array]:
        q, qd, qdd = (x + compliance * y for x, y in zip(truth.motion, give, strict=True))
        return q, qd, qdd

    still = np.zeros_like(truth.q)
    pushed = setting.bodies.torque(truth.q, still, still + np.eye(setting.n)[joint])
    inertia = float((pushed - setting.bodies.torque(truth.q, still, still))[:, joint].max())
    most = min(
        np.radians(5.0) * float(truth.arm.scale[joint]) / np.abs(load).max(),
        1.0 / (inertia * (2.0 * np.pi * BAND) ** 2),
    )
    small = 0.01 * most
    unit = (setting.bodies.torque(*read(small)) - link) / small
    compliance, ratio = _scaled(setting, unit, 0.02 * most, most, target)
    q, qd, qdd = read(compliance)
    rotors = setting.rotors * truth.arm.actuator_position(qdd - truth.qdd)
    effort = truth.effort + truth.arm.joint_effort(rotors)
    told = _found(setting, "joint_flexibility", joint, stiffness=1.0 / compliance)
    return Hiding(replace(truth, q=q, qd=qd, qdd=qdd, effort=effort), told, ratio)


HIDERS: Mapping[str, Shaper] = {
    "nothing": _nothing,
    "payload": _payload,
    "base_tilt": _base_tilt,
    "link_com": _link_com,
    "joint_offset": _joint_offset,
    "torque_scale": _torque_scale,
    "torque_offset": _torque_offset,
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "stribeck_friction": _stribeck,
    "presliding_hysteresis": _presliding,
    "elastic_cable": _cable,
    "rotor_inertia": _rotor,
    "link_inertia": _link_inertia,
    "joint_coupling": _coupling,
    "time_delay": _delay,
    "thermal_drift": _drift,
    "effort_saturation": _saturation,
    "cogging": _cogging,
    "contact": _contact,
    "joint_spring": _spring,
    "encoder_scale": _encoder_scale,
    "torque_saturation": _falling_constant,
    "joint_flexibility": _flexible,
}
"""Effect -> how it is hidden; new ones at the end, so that others keep their random numbers."""
