"""What the masses in an arm's file show of a recording: another mounting, or an axis reversed.

A joint whose axis points the other way than in the arm's file has the other sign of motion and
effort. Masses show it where they bear on it: by their weight, or as they are accelerated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm, gravity_in_base, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Reading, readings
from dvrk_gravity.intake.nominal import Mounting, NominalTorque, mounting

_SAMPLES = 600  # compared: a bound on time
_FLOOR = 0.01  # part of the variance that is left anyway, of masses that are off by a tenth. Chosen
# Least gain in log-likelihood, per two samples. Seen of simulated arms (UR5, Panda, xArm7, Kinova,
# Z1, SO-101): right signs, with masses that are 50 % and 2 cm off, loads and tilts: up to .9; an
# axis reversed: 1.1 to 20 where the joint bears part of the weight.
_GAIN = 1.0
_AS_GOOD = 0.2  # less of it, with which another joint may be it instead. Chosen


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
    gain = _GAIN
    if base is not None:
        turned = _unexplained(nominal, eye, eye, gravity_in_base(base.roll, base.pitch))
        gain = max(gain, _gain(given, turned))
    axes = [
        (_gain(given, _unexplained(nominal, each.motion, each.effort, arm.gravity)), each)
        for each in readings(arm, np.ptp(nominal.q, axis=0) > 0.0)
        if each.sign and each.moves
    ]
    best = max((each for each, _ in axes), default=0.0)
    if best > gain:
        return _reversed(arm, [axis for each, axis in axes if each > best - _AS_GOOD])
    return None if base is None else _mounted(arm, base)


def _reversed(arm: Arm, axes: Sequence[Reading]) -> Misread:
    """Return that a joint, one of these, has the other sign."""
    joints = tuple(dict.fromkeys(arm.joint_names[axis.joints[0]] for axis in axes))
    shown = "; or ".join(axis.words for axis in axes)
    remedy = "; or ".join(axis.remedy for axis in axes)
    return Misread(
        joints,
        "its axis points the other way than in the arm's file",
        f"{shown}, according to the masses in the arm's file (its axis points the other way than "
        f"there): {remedy}; or turn the axis in the arm's file",
        "positions, velocities and efforts with the signs of the arm's file",
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
