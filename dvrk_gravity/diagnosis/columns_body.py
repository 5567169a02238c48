"""Hypotheses about the rigid body: payload, centres of mass, inertia, base."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity import gravity
from dvrk_gravity.arm import GRAVITY, N_JOINTS, Arm
from dvrk_gravity.diagnosis.hypothesis import Hypothesis
from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.effects import Gravity, Payload
from dvrk_gravity.identification.columns import beta_map, prior_scale
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.tree import TREE_LINKS, link_frames

Array = NDArray[np.float64]
Setting = Mapping[str, float]

_SHAFT = 0.03  # N·m that link 1 may plausibly weigh on its joint in a base that is tilted
_TILT = 1e-4  # rad, for a difference quotient
# The joint whose link carries each entry of beta.
BETA_JOINTS = (1, 1, 2, 2, 3, 4, 4, 4, 5, 5, 6, 6)
_AXES = ("x", "y", "z")
ALL_WEIGHTS = "weight of all links"
ALL_INERTIA = "inertia of all links"


def body(motion: Motion) -> Iterator[Hypothesis]:
    """Yield everything that changes the links or the base."""
    if not motion.present.all():
        return
    for joint in range(1, N_JOINTS):
        yield _payload(joint)
        for axis in range(3):
            yield _moment(joint, (axis,))
        yield _moment(joint, (0, 1, 2))
        if not motion.static:
            for form in ("isotropic", "principal"):
                yield _inertia(joint, form)
    for index in range(len(BETA_JOINTS)):
        yield _beta(index)
    yield _all_weights(motion.arm)
    if not motion.static:
        yield _all_inertia(motion)
    weight = motion.model.term(Gravity.NAME)
    if isinstance(weight, Gravity):
        yield _tilt(knows_shaft=len(weight.beta) > len(BETA_JOINTS))


def link_columns(motion: Motion, joint: int, directions: Array) -> Array:
    """Return (N, 7, k) torques of changes of a link's inertial parameters.

    Args:
        motion: The motion.
        joint: Index of the link's joint.
        directions: (10, k) changes in Pinocchio's joint frame.
    """
    return motion.link_torque(TREE_LINKS.index(f"link{joint + 1}"), directions)


def payload_directions(arm: Arm, joint: int, place: Array) -> Array:
    """Return (10, 4) inertial parameters per kg and per kg·m of a point mass on a link.

    They are quadratic in where the mass is, hence linearised there.

    Args:
        arm: The arm.
        joint: Index of the link's joint.
        place: (3,) in the link's distal DH frame, m.
    """
    frame = link_frames(arm)[f"link{joint + 1}"]

    def parameters(where: Array) -> Array:
        point = pin.Inertia(1.0, where, np.zeros((3, 3)))
        return np.asarray(frame.act(point).toDynamicParameters())

    # A central difference of a quadratic is exact.
    slopes = [0.5 * (parameters(place + axis) - parameters(place - axis)) for axis in np.eye(3)]
    base = parameters(place) - np.array(slopes).T @ place
    return np.column_stack([base, *slopes])


def inertia_directions(arm: Arm, joint: int, form: str) -> Array:
    """Return (10, k) inertial parameters per kg·m^2 of rotational inertia of a link.

    Args:
        arm: The arm.
        joint: Index of the link's joint.
        form: ``isotropic`` (k = 1) or ``principal`` (k = 3, about the axes of the DH frame).
    """
    frame = link_frames(arm)[f"link{joint + 1}"]
    tensors = [np.eye(3)] if form == "isotropic" else [np.diag(row) for row in np.eye(3)]
    directions = []
    for tensor in tensors:
        turned = frame.rotation @ tensor @ frame.rotation.T
        xx, xy, xz, yy, yz, zz = turned[np.triu_indices(3)]
        directions.append([0.0, 0.0, 0.0, 0.0, xx, xy, yy, xz, yz, zz])
    return np.array(directions).T


def moment_directions(arm: Arm, joint: int, axes: Sequence[int]) -> Array:
    """Return (10, k) inertial parameters per N·m of weight moment along a link's axes."""
    directions = np.zeros((10, len(axes)))
    directions[1:4] = link_frames(arm)[f"link{joint + 1}"].rotation[:, list(axes)]
    return directions / GRAVITY


def _payload(joint: int) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        place = np.array([setting[axis] for axis in _AXES])
        return link_columns(motion, joint, payload_directions(motion.arm, joint, place))

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        del setting
        mass = float(theta[0])
        moments = {f"first_moment_{a}": float(m) for a, m in zip(_AXES, theta[1:], strict=True)}
        safe = mass if abs(mass) > 1e-4 else 1e-4
        place = np.clip(theta[1:] / safe, -0.3, 0.3)
        return {"mass": mass, **moments} | {a: float(p) for a, p in zip(_AXES, place, strict=True)}

    return Hypothesis(
        "payload", (joint,), f"link{joint + 1}", build, describe,
        dict.fromkeys(_AXES, 0.0), fixed_point=_AXES,
    )  # fmt: skip


def _moment(joint: int, axes: tuple[int, ...]) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        return link_columns(motion, joint, moment_directions(motion.arm, joint, axes))

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        del setting
        if len(axes) == 1:
            return {"delta_beta": float(theta[0])}
        return {f"delta_beta_{_AXES[a]}": float(t) for a, t in zip(axes, theta, strict=True)}

    place = f"link{joint + 1} " + "".join(_AXES[axis] for axis in axes)
    return Hypothesis("link_com", (joint,), place, build, describe)


def _beta(index: int) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        return gravity.regressor(motion.true_q, motion.gravity, 12)[:, :, [index]]

    place = f"weight only, {gravity.BETA_NAMES[index]}"
    return Hypothesis(
        "link_com", (BETA_JOINTS[index],), place, build,
        lambda theta, _: {"delta_beta": float(theta[0])},
    )  # fmt: skip


def _all_weights(arm: Arm) -> Hypothesis:
    """Return the hypothesis that beta as a whole is another one."""
    count = len(BETA_JOINTS)
    size = np.linalg.norm(beta_map(arm)[:count] * prior_scale(), axis=1)
    return Hypothesis(
        "link_com", (), ALL_WEIGHTS,
        lambda motion, _: gravity.regressor(motion.true_q, motion.gravity, count),
        lambda theta, _: {
            f"delta_beta_{name}": float(value)
            for name, value in zip(gravity.BETA_NAMES, theta, strict=False)
        },
        plausible_size=tuple(size.tolist()),
    )  # fmt: skip


def _all_inertia(motion: Motion) -> Hypothesis:
    """Return the hypothesis that the links' inertia as a whole is another one, or missing.

    Its many coefficients mean nothing one by one.
    """
    chosen = motion.inertial
    return Hypothesis(
        "link_inertia", (), ALL_INERTIA, lambda motion, _: motion.inertial_torque(chosen),
        lambda *_: {},
        variable="acceleration", plausible_size=tuple(prior_scale()[chosen].tolist()),
    )  # fmt: skip


def _inertia(joint: int, form: str) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        return link_columns(motion, joint, inertia_directions(motion.arm, joint, form))

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        del setting
        if form == "isotropic":
            return {"inertia": float(theta[0])}
        return {f"inertia_{a}{a}": float(t) for a, t in zip(_AXES, theta, strict=True)}

    return Hypothesis(
        "link_inertia", (joint,), f"link{joint + 1} {form}", build, describe,
        variable="acceleration",
    )  # fmt: skip


def _tilt(knows_shaft: bool) -> Hypothesis:
    """Return the hypothesis of a tilted base.

    Args:
        knows_shaft: Whether the model knows what link 1 weighs, which a level base never shows: it
            turns about the vertical. If not, that comes with the tilt.
    """

    def build(motion: Motion, setting: Setting) -> Array:
        # The slope half-way makes slope times angle right to second order.
        at = (0.5 * setting["roll"], 0.5 * setting["pitch"])
        here = _tilted_torque(motion, *at)
        roll = (_tilted_torque(motion, at[0] + _TILT, at[1]) - here) / _TILT
        pitch = (_tilted_torque(motion, at[0], at[1] + _TILT) - here) / _TILT
        columns = [roll, pitch]
        if not knows_shaft:
            shaft = np.zeros((2, *roll.shape))
            shaft[:, :, 0] = shaft_torque(motion.true_q)
            columns += [*shaft]
        return np.stack(columns, axis=2)

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        del setting
        return {"roll": float(theta[0]), "pitch": float(theta[1])}

    return Hypothesis(
        "base_tilt", (), "base", build, describe,
        {"roll": 0.0, "pitch": 0.0}, fixed_point=("roll", "pitch"),
        plausible_size=() if knows_shaft else (np.inf, np.inf, _SHAFT, _SHAFT),
    )  # fmt: skip


def shaft_torque(q: Array) -> Array:
    """Return (2, N) torques of a weight on link 1 at (N, 7) positions, in a base that is tilted."""
    return np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])])


def tilted(model: TorqueModel, roll: float, pitch: float) -> TorqueModel:
    """Return what of a model has weight, with its base turned further by roll and pitch, rad."""
    turn = pin.rpy.rpyToMatrix(roll, pitch, 0.0).T
    terms = tuple(
        replace(term, vector=turn @ term.vector)
        for term in model.terms
        if isinstance(term, Gravity | Payload)
    )
    return replace(model, terms=terms)


def _tilted_torque(motion: Motion, roll: float, pitch: float) -> Array:
    return motion.torque_at(motion.q, tilted(motion.model, roll, pitch))
