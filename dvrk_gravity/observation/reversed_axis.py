"""What the masses in an arm's file show of a recording: another mounting, or a joint misread.

A joint whose axis points the other way than in the arm's file has the other sign of motion and
effort; one that is read at its motor, before a gear, moves a multiple of its angle. Masses show it
where they bear on it: by their weight, or as they are accelerated. What the one joint is misread by
turns what all joints before it carry, so that these fit no better.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from dvrk_gravity.arms import Arm, gravity_in_base, rigid_body
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import readings
from dvrk_gravity.observation.nominal import Mounting, NominalTorque, apparent_gravity, mounting
from dvrk_gravity.recording import Note

_SAMPLES = 600  # compared: a bound on time
_FLOOR = 0.01  # part of the variance that is left anyway, of masses that are off by a tenth. Chosen
# Least gain in log-likelihood, per two samples. Seen of simulated arms (UR5, Panda, xArm7, Kinova,
# Z1, SO-101): right signs, with masses that are 50 % and 2 cm off, loads and tilts: up to .9; an
# axis reversed: 1.1 to 20 where the joint bears part of the weight.
_GAIN = 1.0
_AS_GOOD = 0.2  # less of it, with which another joint may be it instead. Chosen
# Gear ratios tried, and those about the best of them. Chosen: of less, a motion is hardly another,
# and of more it is beyond the limits.
_GEARS, _ABOUT = np.exp(np.arange(0.4, 2.2, 0.25)), np.exp(np.arange(-0.2, 0.25, 0.05))


@dataclass(frozen=True)
class Misread:
    """Why a recording is not of the arm as its file has it.

    Attributes:
        joints: Whose efforts it explains.
        reason: Short.
        line: What shows it, and what to do.
        record: What to record instead; ``""``: the same serves.
        mounted: Whether it is the mounting of the base.
    """

    joints: tuple[str, ...]
    reason: str
    line: str
    record: str
    mounted: bool

    @property
    def warning(self) -> Note:
        """That it may be so, where it is not refused."""
        return Note("misread", None, {}, self.line)


def misread(nominal: NominalTorque | None) -> Misread | None:
    """Return another mounting, or the reversed axis of a joint, that explains efforts far better.

    Args:
        nominal: Samples of a recording; ``None``: masses or efforts are not known.
    """
    # Of motors that share joints no sign is known.
    if nominal is None or not nominal.arm.direct_drive:
        return None
    arm, eye = nominal.arm, np.eye(nominal.arm.n)
    given = _unexplained(nominal, eye, eye, arm.gravity)
    base = mounting(nominal)
    # A tilt is none, but what it explains is no joint's.
    gravity = apparent_gravity(nominal)
    if base is not None:
        gravity = gravity_in_base(base.roll, base.pitch)
    gain = max(_GAIN, _gain(given, _unexplained(nominal, eye, eye, gravity)))
    found = [*_axes(nominal, given), *_geared(nominal, given)]
    best = max((each.gain for each in found), default=0.0)
    # Efforts of one joint with the wrong sign alone are said beside their scale.
    of_effort = max((each.gain for each in _axes(nominal, given, moves=False)), default=0.0)
    if best > max(gain, of_effort):
        return _of_joints([each for each in found if each.gain > best - _AS_GOOD])
    return None if base is None else _mounted(arm, base)


@dataclass(frozen=True)
class _Misreading:
    """How joints may be misread, and the gain in log-likelihood if they are."""

    gain: float
    joints: tuple[str, ...]
    words: str
    reason: str
    remedy: str
    record: str


def _axes(nominal: NominalTorque, given: Array, moves: bool = True) -> Iterator[_Misreading]:
    """Yield the joints with another sign of their motion, or of their efforts alone."""
    arm = nominal.arm
    for axis in readings(arm, np.ptp(nominal.q, axis=0) > 0.0):
        if not (axis.sign and axis.joints) or axis.moves != moves:
            continue
        after = _unexplained(nominal, axis.motion, axis.effort, arm.gravity)
        yield _Misreading(
            _gain(given, after), (arm.joint_names[axis.joints[0]],), axis.words,
            "its axis points the other way than in the arm's file",
            f"{axis.remedy}, or turn the axis in the arm's file",
            "positions, velocities and efforts with the signs of the arm's file",
        )  # fmt: skip


def _geared(nominal: NominalTorque, given: Array) -> Iterator[_Misreading]:
    """Yield the joints, and all together, with motor angles, at the ratio that weight shows."""
    arm, eye = nominal.arm, np.eye(nominal.arm.n)
    turn = np.array([joint.kind == "revolute" for joint in arm.joints])
    turn &= np.ptp(nominal.q, axis=0) > 0.0

    def gain(joints: Mask, ratio: float) -> float:
        motion = np.diag(np.where(joints, 1.0 / ratio, 1.0))
        return _gain(given, _unexplained(nominal, motion, eye, arm.gravity))

    for joints in (*np.eye(arm.n, dtype=bool)[turn], turn):
        most, ratio = max((gain(joints, each), each) for each in _GEARS.tolist())
        if most > _GAIN:
            most, ratio = max((gain(joints, each), each) for each in (ratio * _ABOUT).tolist())
        names = tuple(compress(arm.joint_names, joints.tolist()))
        whose = names[0] if len(names) == 1 else "all joints"
        yield _Misreading(
            most, names, f"the position of {whose} is about {ratio:.2g} times the angle",
            "its position is a motor's, before a gear",
            f"divide position and velocity of {whose} by the ratio of the gear",
            "positions of joints, not of motors",
        )  # fmt: skip


def _of_joints(found: Sequence[_Misreading]) -> Misread:
    """Return that a joint, one of these, is misread."""

    def each(key: str) -> str:
        return "; or ".join(dict.fromkeys(getattr(one, key) for one in found))

    return Misread(
        tuple(dict.fromkeys(name for one in found for name in one.joints)),
        each("reason"),
        f"{each('words')}, according to the masses in the arm's file: {each('remedy')}",
        each("record"),
        mounted=False,
    )


def _mounted(arm: Arm, base: Mounting) -> Misread:
    """Return that the base is mounted otherwise than the arm's file says."""
    roll, pitch = np.degrees((base.roll, base.pitch))
    signs = (
        "; or efforts have the wrong sign (all, or those that carry most): friction does not decide"
        if base.signs
        else ""
    )
    return Misread(
        arm.joint_names,
        "its base is mounted otherwise than the arm's file says",
        "according to the masses in the arm's file, gravity acts as on a base with "
        f"base_rpy: [{roll:.0f}, {pitch:.0f}, 0] (degrees): state the mounting, whatever it is, in "
        f"a .yaml that names the URDF (docs/own_arm.md){signs}",
        "",
        mounted=True,
    )


def _gain(before: Array, after: Array) -> float:
    """Return the gain in log-likelihood per two samples, of (n,) parts of efforts left."""
    return float(np.log((before + _FLOOR) / (after + _FLOOR)).sum())


def _unexplained(nominal: NominalTorque, motion: Array, effort: Array, gravity: Array) -> Array:
    """Return (n,) parts of the efforts' variance that masses and friction leave in a reading.

    The scale of each joint's efforts is free, and positive.
    """
    from scipy.optimize import nnls  # slow to load

    arm = nominal.arm
    rows = slice(None, None, max(1, len(nominal.q) // _SAMPLES))
    q, qd, qdd = (each[rows] @ motion.T for each in (nominal.q, nominal.qd, nominal.qdd))
    read = nominal.effort[rows] @ effort.T
    assert arm.inertial_parameters is not None
    needed = rigid_body.torque(arm, arm.inertial_parameters.ravel(), q, qd, qdd, gravity)
    left = np.ones(arm.n)
    for joint in range(arm.n):
        speed = qd[:, joint]
        columns = np.stack([needed[:, joint], np.sign(speed), speed, qdd[:, joint]], axis=1)
        own, columns = read[:, joint] - read[:, joint].mean(), columns - columns.mean(axis=0)
        size = np.linalg.norm(columns, axis=0)
        rest = nnls(columns / np.where(size > 0.0, size, 1.0), own)[1]
        left[joint] = rest**2 / max(float(own @ own), 1e-300)
    return left
