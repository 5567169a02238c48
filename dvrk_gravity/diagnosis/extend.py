"""Findings written into a model, as far as a model file can carry them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from dvrk_gravity.arm import GRAVITY, JOINT_NAMES, N_JOINTS
from dvrk_gravity.diagnosis.columns_body import (
    ALL_INERTIA,
    ALL_WEIGHTS,
    inertia_directions,
    moment_directions,
    payload_directions,
    shaft_torque,
)
from dvrk_gravity.diagnosis.hypothesis import Hypothesis
from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.effects import TERMS, Gravity, Payload
from dvrk_gravity.effects.cogging import MOST_RIPPLES
from dvrk_gravity.gravity import BETA_NAMES, LinkMass, beta_from_links, regressor
from dvrk_gravity.model import TorqueModel, model_parameters
from dvrk_gravity.tree import TREE_LINKS

Array = NDArray[np.float64]
Values = dict[str, Any]


def extended(
    motion: Motion, found: Sequence[tuple[Hypothesis, Array]]
) -> tuple[TorqueModel, tuple[bool, ...]]:
    """Return the model with what was found, and which findings it carries.

    What the arm does as a function of its state, its encoders' zeros and its efforts' bias go
    into the file. Wrong readings (scale, delay, clipping, coupling, coordinates) are to be put
    right where they arise, and what happens in time (drift, a push for a while) is no function of
    the state: they are left to the findings.

    Findings are functions of measured positions, a model's terms of true ones: the encoder
    offsets that the findings add are taken into account in every other finding.

    Args:
        motion: The motion, for its model and for the range on which cables were fitted.
        found: Hypotheses and their (k,) parameters, in order.
    """
    offset = motion.model.joint_offset + sum(
        (_shift(motion, *one) for one in found if one[0].effect == "joint_offset"),
        start=np.zeros(N_JOINTS),
    )
    values: Values = dict(motion.model.parameters())
    if offset.any():
        values["joint_offset"] = tuple(offset.tolist())
    carried = []
    for hypothesis, theta in found:
        write = _WRITERS.get(hypothesis.effect)
        changed = None if write is None else write(motion, values, hypothesis, theta)
        carried.append(changed is not None)
        if changed is not None:
            values = changed
    model = TorqueModel.from_parameters(values)
    names = {term.NAME for term in TERMS}
    others = tuple(term for term in motion.model.terms if term.NAME not in names)
    return replace(model, terms=(*model.terms, *others)), tuple(carried)


def _array(values: Mapping[str, Any], name: str, fallback: str = "") -> Array:
    value = values.get(name) or values.get(fallback) or np.zeros(N_JOINTS)
    return np.array(value, dtype=float)


def _shift(motion: Motion, hypothesis: Hypothesis, theta: Array) -> Array:
    """Return (7,) what the joints' encoders read too much, of a joint or of a motor, rad."""
    joint = hypothesis.joints[0]
    row = motion.arm.actuator_to_joint[:, joint] if hypothesis.place == "motor" else None
    return float(theta[0]) * (np.eye(N_JOINTS)[joint] if row is None else row)


def _zero(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values:
    del motion, hypothesis, theta  # in the file already: other findings depend on it
    return values


def _coulomb(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values:
    del motion
    joint, prefix = hypothesis.joints[0], f"coulomb_friction.{hypothesis.place}"
    up = _array(values, f"{prefix}_positive", f"{prefix}_negative")
    down = _array(values, f"{prefix}_negative", f"{prefix}_positive")
    up[joint] = max(0.0, up[joint] + theta[0])
    down[joint] = max(0.0, down[joint] + theta[-1])
    return values | {f"{prefix}_positive": tuple(up), f"{prefix}_negative": tuple(down)}


def _viscous(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values:
    del motion
    name = f"viscous_friction.{hypothesis.place}"
    level = _array(values, name)
    level[hypothesis.joints[0]] = max(0.0, level[hypothesis.joints[0]] + theta[0])
    return values | {name: tuple(level)}


def _cable(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values:
    named = hypothesis.describe(theta, hypothesis.setting)
    powers = np.array([value for name, value in named.items() if name.startswith("k")])
    return _add_polynomial(motion, values, hypothesis.joints[0], powers, len(powers) > 2)


def _bias(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values:
    del motion
    bias = _array(values, "torque_offset")
    bias[hypothesis.joints[0]] += theta[0]
    return values | {"torque_offset": tuple(bias.tolist())}


def _stribeck(
    motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array
) -> Values | None:
    del motion
    name, joint = f"stribeck_friction.{hypothesis.place}", hypothesis.joints[0]
    level, speed = _array(values, name), _array(values, f"{name}_velocity")
    if level[joint] > 0.0 or theta[0] < 0.0:
        return None  # a joint has one velocity
    level[joint], speed[joint] = theta[0], hypothesis.setting["velocity"]
    return values | {name: tuple(level.tolist()), f"{name}_velocity": tuple(speed.tolist())}


def _cogging(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values | None:
    motor = hypothesis.joints[0]
    ripple = hypothesis.describe(theta, hypothesis.setting)
    # The motor's angle is read off as far as the joints' are.
    angle = motion.arm.joint_to_actuator[motor] @ _array(values, "joint_offset")
    ripple["phase"] += ripple["cycles_per_revolution"] * float(angle)
    result = dict(values)
    for field, value in ripple.items():
        name = f"cogging.{field}.{JOINT_NAMES[motor]}"
        result[name] = (*(values.get(name) or ()), value)
    full = len(result[f"cogging.phase.{JOINT_NAMES[motor]}"]) > MOST_RIPPLES
    return None if full else result


def _contact(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values | None:
    del motion
    if "position" not in hypothesis.setting:
        return None  # for a while: no function of the state
    joint, wall = hypothesis.joints[0], hypothesis.describe(theta, hypothesis.setting)
    name = f"contact.{hypothesis.place.split()[0]}"
    stiffness, position = _array(values, name), _array(values, f"{name}_position")
    if stiffness[joint]:
        return None  # a joint has one on either side
    stiffness[joint] = wall["stiffness"]
    position[joint] = wall["position"] - _array(values, "joint_offset")[joint]
    return values | {
        name: tuple(stiffness.tolist()),
        f"{name}_position": tuple(position.tolist()),
    }


def _add_polynomial(
    motion: Motion, values: Values, joint: int, powers: Array, bounded: bool
) -> Values:
    name = f"elastic_cable.{JOINT_NAMES[joint]}"
    offset = _array(values, "joint_offset")[joint]
    # Of the true position.
    powers = np.array(Polynomial(powers)(Polynomial([offset, 1.0])).coef, dtype=np.float64)
    known = np.array(values.get(name) or (0.0,))
    total = np.zeros(max(len(known), len(powers)))
    total[: len(known)] += known
    total[: len(powers)] += powers
    result = values | {name: tuple(total.tolist())}
    if bounded:
        # Outside the motion nothing is known: the argument is held at the edge there.
        middle, half = motion.travel
        for edge, default, sign in (("valid_lower", -1e6, -1.0), ("valid_upper", 1e6, 1.0)):
            field = f"elastic_cable.{edge}"
            limits = np.array(values.get(field) or np.full(N_JOINTS, default))
            if not known.any() or abs(limits[joint]) >= 1e6:
                limits[joint] = middle[joint] + sign * half[joint] - offset
            result[field] = tuple(limits.tolist())
    return result


def _add_beta(values: Values, delta: Array) -> Values | None:
    beta = np.array(values.get("beta") or ())
    if not beta.size:
        return None
    needed = next(size for size in (10, 12, 14) if not np.any(np.abs(delta[size:]) > 1e-9))
    total = np.zeros(max(len(beta), needed))
    total[: len(beta)] += beta
    total += delta[: len(total)]
    return values | {"beta": tuple(total.tolist())}


def _payload(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values | None:
    link = f"link{hypothesis.joints[0] + 1}"
    if motion.model.term(Payload.NAME) is None and "payload.mass" not in values and theta[0] > 0.0:
        moment = tuple(theta[1:].tolist())
        named = {"mass": float(theta[0]), "first_moment": moment, "link": link}
        return values | {f"payload.{name}": value for name, value in named.items()}
    # Beside a payload that is there: part of the link.
    result = _add_beta(values, _link_beta(link, float(theta[0]), theta[1:]))
    if result is None:
        return None
    place = np.array([hypothesis.setting[axis] for axis in "xyz"])
    change = payload_directions(motion.arm, hypothesis.joints[0], place) @ theta
    return _add_inertia(result, link, change)


def _link_beta(link: str, mass: float, moment: Array) -> Array:
    """Return (14,) change of beta, N·m, from a link's mass, kg, and first moment, kg·m."""
    weight = beta_from_links({link: LinkMass(1.0)}, columns=14)
    place = [
        beta_from_links({link: LinkMass(1.0, tuple(axis.tolist()))}, columns=14) - weight
        for axis in np.eye(3)
    ]
    return mass * weight + np.array(place).T @ moment


def _com(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values | None:
    if hypothesis.place.startswith("weight only"):
        delta = np.zeros(14)
        delta[BETA_NAMES.index(hypothesis.place.split(", ")[1])] = theta[0]
        return _add_beta(values, delta)
    if hypothesis.place == ALL_WEIGHTS:
        return _add_beta(values, np.pad(theta, (0, 14 - len(theta))))
    link, letters = hypothesis.place.split()
    axes = ["xyz".index(letter) for letter in letters]
    moment = np.zeros(3)
    moment[axes] = theta / GRAVITY
    result = _add_beta(values, _link_beta(link, 0.0, moment))
    if result is None:
        return None
    change = moment_directions(motion.arm, hypothesis.joints[0], axes) @ theta
    return _add_inertia(result, link, change)


def _tilt(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values | None:
    del hypothesis
    term = motion.model.term(Gravity.NAME)
    if not isinstance(term, Gravity):
        return None
    vector = pin.rpy.rpyToMatrix(float(theta[0]), float(theta[1]), 0.0).T @ term.vector
    values = values | {"gravity_vector": tuple(vector.tolist())}
    if len(theta) == 2:
        return values
    # What weighs on a shaft that leans, as the first moments of link 1.
    q = np.zeros((4, N_JOINTS))
    q[:, 0] = np.linspace(-1.0, 1.0, len(q))
    per_moment = regressor(q, vector, len(BETA_NAMES))[:, 0, -2:]
    moments = np.linalg.lstsq(per_moment, theta[2:] @ shaft_torque(q), rcond=None)[0]
    return _add_beta(values, np.pad(moments, (len(BETA_NAMES) - len(moments), 0)))


def _add_inertia(values: Values, link: str, change: Array) -> Values:
    """Add (10,) inertial parameters to a link, if the model has inertia at all."""
    known = [name for name in values if name.startswith("link_inertia.")]
    if not known:
        return values
    name = f"link_inertia.{link}"
    row = np.array(values.get(name) or np.zeros(10)) + change
    return values | {name: tuple(row.tolist())}


def _inertia(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values:
    if hypothesis.place == ALL_INERTIA:
        change = np.zeros(10 * len(TREE_LINKS))
        change[motion.inertial] = theta
        for link, row in zip(TREE_LINKS, change.reshape(-1, 10), strict=True):
            name = f"link_inertia.{link}"
            total = np.array(values.get(name) or np.zeros(10)) + row
            values = values | {name: tuple(total.tolist())}
        return values
    link, form = hypothesis.place.split()
    change = inertia_directions(motion.arm, hypothesis.joints[0], form) @ theta
    name = f"link_inertia.{link}"
    row = np.array(values.get(name) or np.zeros(10)) + change
    return values | {name: tuple(row.tolist())}


def _rotor(motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array) -> Values | None:
    del motion
    inertia = _array(values, "rotor_inertia.motor")
    inertia[hypothesis.joints[0]] += theta[0]
    if inertia.min() < 0.0:
        return None
    return values | {"rotor_inertia.motor": tuple(inertia.tolist())}


def _presliding(
    motion: Motion, values: Values, hypothesis: Hypothesis, theta: Array
) -> Values | None:
    if theta[0] < 0.0:
        return None
    effect, joint = hypothesis.effect, hypothesis.joints[0]
    mine = f"{effect}.{hypothesis.place}.{JOINT_NAMES[joint]}"
    lengths = tuple(values.get(f"{effect}.displacement") or ())
    length = float(np.clip(hypothesis.setting["length"], 1e-4, 10.0))
    result = values | {f"{effect}.displacement": (*lengths, length)}
    for name in model_parameters(motion.arm):
        if name.startswith((f"{effect}.joint.", f"{effect}.motor.")) and values.get(name):
            result[name] = (*values[name], 0.0)
    before = tuple(values.get(mine) or np.zeros(len(lengths)).tolist())
    result[mine] = (*before, float(theta[0]))
    if len(theta) > 1:  # beside a change of the Coulomb friction that the model had
        result = _coulomb(motion, result, hypothesis, theta[1:])
    return result


_WRITERS = {
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "elastic_cable": _cable,
    "torque_offset": _bias,
    "joint_offset": _zero,
    "stribeck_friction": _stribeck,
    "cogging": _cogging,
    "contact": _contact,
    "payload": _payload,
    "link_com": _com,
    "base_tilt": _tilt,
    "link_inertia": _inertia,
    "rotor_inertia": _rotor,
    "presliding_hysteresis": _presliding,
}
