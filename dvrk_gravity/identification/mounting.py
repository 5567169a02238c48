"""How an arm is mounted, as its efforts show: a URDF takes its base to stand upright."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.effects.base_tilt import BaseTilt
from dvrk_gravity.recording import Recording

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
    """

    turned: float = BaseTilt.meaning("roll").greatest
    removed: float = 0.75
    usual: float = 0.17


def mounting(
    recording: Recording, arm: Arm, settings: MountingSettings | None = None
) -> tuple[float, float] | None:
    """Return roll and pitch of the base, rad, where its efforts show another than the arm's.

    The torque of given masses is linear in gravity, and dry and viscous friction are in their
    sizes; of gravity its strength is free, so that a wrong unit or masses that are wrong alike do
    not matter.

    Args:
        recording: Positions and efforts of all joints, in joint coordinates.
        arm: The arm, with the masses in its file.
        settings: When it is another.

    Returns:
        ``None`` where the efforts show what the arm's file says, or do not tell.
    """
    settings = settings or MountingSettings()
    assert arm.inertial_parameters is not None
    assert recording.effort is not None
    parameters = arm.inertial_parameters.ravel()
    weight = np.stack(
        [
            rigid_body.torque(arm, parameters, recording.position, None, None, axis)
            for axis in np.eye(3)
        ],
        axis=2,
    )
    way = np.gradient(recording.position, axis=0)
    rest = []
    for joint in range(arm.n):  # what its friction cannot explain
        friction = np.stack([np.sign(way[:, joint]), way[:, joint]], axis=1)
        both = np.column_stack([recording.effort[:, joint], weight[:, joint]])
        rest.append(both - friction @ np.linalg.lstsq(friction, both, rcond=None)[0])
    effort, columns = np.split(np.concatenate(rest), [1], axis=1)
    effort = effort[:, 0]
    shown = np.linalg.lstsq(columns, effort, rcond=None)[0]
    given = columns @ arm.gravity
    size = float(np.linalg.norm(shown))
    cosine = shown @ arm.gravity / max(size * np.linalg.norm(arm.gravity), 1e-300)
    if size == 0.0 or cosine > np.cos(settings.turned):
        return None
    strength = max(0.0, float(given @ effort) / max(float(given @ given), 1e-300))
    left, explained = effort - strength * given, effort - columns @ shown
    if explained @ explained > (1.0 - settings.removed) * (left @ left):
        return None
    # Efforts of the wrong sign weigh as on the ceiling, but friction would drive the joints.
    needed = weight @ shown
    power = ((recording.effort - needed) * way).sum(axis=0)
    if power @ (needed**2).sum(axis=0) < 0.0:
        return None
    direction = shown / size
    usual = _USUAL[np.argmax(_USUAL @ direction)]
    if usual @ direction > np.cos(settings.usual):
        direction = usual
    x, y, z = direction.tolist()
    along_x = y == 0.0 and z == 0.0  # gravity along x: roll has no effect on it
    return 0.0 if along_x else float(np.arctan2(0.0 - y, -z)), float(np.arcsin(x))
