"""How an arm is mounted, as its efforts show: a URDF takes its base to stand upright."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from dvrk_gravity.effects import MAX_TILT
from dvrk_gravity.identification.nominal_torque import NominalTorque

# Where gravity points on floors, walls, ceilings, and half-way between two or three of them.
_USUAL = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_USUAL /= np.linalg.norm(_USUAL, axis=1, keepdims=True)


@dataclass(frozen=True)
class MountingSettings:
    """When gravity acts from elsewhere than an arm's file says.

    Attributes:
        turned: rad between both directions; a smaller angle is a tilt, which has an effect.
        removed: Part of what the given direction leaves that the one shown removes, variance.
            Chosen: masses that are wrong turn gravity, too, and then explain little.
        usual: rad, within which a floor, a wall, a ceiling or half-way between them is meant.
            Chosen: what friction and masses that are a little wrong turn gravity by.
        blocks: Of time, by whose means the power of friction is tested.
        deviations: Standard errors from zero that say which sign it has. Chosen: one chance in a
            hundred.
    """

    turned: float = MAX_TILT
    removed: float = 0.75
    usual: float = 0.17
    blocks: int = 10
    deviations: float = 3.0


@dataclass(frozen=True)
class Mounting:
    """How a base seems to be mounted.

    Attributes:
        roll: rad.
        pitch: rad.
        signs: Whether efforts of the wrong sign would show the same.
    """

    roll: float
    pitch: float
    signs: bool


def mounting(nominal: NominalTorque, settings: MountingSettings | None = None) -> Mounting | None:
    """Return how the base seems to be mounted, where its efforts show another way than the file.

    The torque of given masses is linear in gravity, and dry and viscous friction are in their
    sizes; of gravity the strength is free, and of inertia, so that a wrong unit or masses that are
    wrong alike do not matter.

    Returns:
        ``None`` where the efforts show what the arm's file says, or do not tell.
    """
    from scipy.optimize import nnls  # slow to load

    settings = settings or MountingSettings()
    gravity = nominal.arm.gravity
    rest = []
    for joint in range(nominal.arm.n):  # what its friction cannot explain
        speed = nominal.qd[:, joint]
        friction = np.stack([np.sign(speed), speed], axis=1)
        needed = (nominal.effort[:, joint], nominal.inertia[:, joint], nominal.weight[:, joint])
        every = np.column_stack(needed)
        rest.append(every - friction @ np.linalg.lstsq(friction, every, rcond=None)[0])
    effort, inertia, weight = np.split(np.concatenate(rest), [1, 2], axis=1)
    effort = effort[:, 0]
    free = np.column_stack([weight, inertia])
    given = np.column_stack([weight @ gravity, inertia])
    found = np.linalg.lstsq(free, effort, rcond=None)[0]
    shown = found[:3]
    strength = float(np.linalg.norm(shown))
    cosine = shown @ gravity / max(strength * np.linalg.norm(gravity), 1e-300)
    if strength == 0.0 or cosine > np.cos(settings.turned):
        return None
    # No strength below zero, which would be another direction.
    left = effort - given @ nnls(given, effort)[0]
    explained = effort - free @ found
    if explained @ explained > (1.0 - settings.removed) * (left @ left):
        return None
    # Efforts of the wrong sign weigh as on the ceiling, but friction would drive the joints.
    needed = nominal.weight @ shown + found[3] * nominal.inertia
    bears = (needed**2).sum(axis=0)
    power = ((nominal.effort - needed) * nominal.qd) @ (bears / bears.sum())
    mean = np.array([part.mean() for part in np.array_split(power, settings.blocks)])
    error = settings.deviations * np.std(mean, ddof=1) / np.sqrt(settings.blocks)
    if mean.mean() < -error:
        return None
    direction = shown / strength
    usual = _USUAL[np.argmax(_USUAL @ direction)]
    if usual @ direction > np.cos(settings.usual):
        direction = usual
    x, y, z = direction.tolist()
    along_x = y == 0.0 and z == 0.0  # gravity along x: roll has no effect on it
    roll = 0.0 if along_x else float(np.arctan2(0.0 - y, -z))
    opposite = direction @ gravity < -np.cos(settings.usual) * np.linalg.norm(gravity)
    return Mounting(roll, float(np.arcsin(x)), bool(opposite and mean.mean() <= error))
