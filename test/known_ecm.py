"""An endoscope's arm of four joints, whose torques Pinocchio computes, and the model that knows it.

A diagnosis of it takes half of the time that one of a master arm takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing.flight_motion import PausedMotion
from testing.lab_motion import draw_calibration

ARM = Arm.load("ecm")
PITCH, INSERTION, ROLL = 1, 2, 3
BODIES = PlantFile.load("ecm").links
COULOMB = 0.01 * ARM.effort_limit
VISCOUS = 0.005 * ARM.effort_limit / ARM.scale
NOISE = 0.002 * ARM.effort_limit
Torque = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@cache
def model() -> TorqueModel:
    """Return the model that is right about the arm, by its parameters."""
    values: dict[str, object] = {
        "arm": "ecm",
        "coulomb_friction.joint_positive": COULOMB.tolist(),
        "coulomb_friction.transition_velocity": (0.01 * ARM.scale).tolist(),
        "viscous_friction.joint": VISCOUS.tolist(),
    }
    for body in ARM.bodies:
        if body.name in BODIES:
            row = body.frame.act(BODIES[body.name]).toDynamicParameters().tolist()
            values |= {f"link_weight.{body.name}": row[:4], f"link_inertia.{body.name}": row}
    return TorqueModel.from_parameters(values)


def motion(
    seed: int, seconds: float, speed: float = 1.0, rest: float = np.inf
) -> tuple[np.ndarray, ...]:
    """Return times, positions, velocities and accelerations of an exciting motion at 100 Hz."""
    sines = draw_calibration(ARM, seed)
    time = np.arange(0.0, seconds, 0.01)
    paused = replace(sines, frequency=speed * sines.frequency)
    return time, *PausedMotion(paused, ((rest, 1e5),) if rest < seconds else ()).at(time)


def recorded(
    seed: int,
    seconds: float = 12.0,
    more: Torque | None = None,
    gravity: np.ndarray = ARM.gravity,
    speed: float = 1.0,
    rest: float = np.inf,
) -> Recording:
    """Return a motion with efforts by Pinocchio, friction written out here, and ``more``.

    Args:
        seed: Of motion and noise.
        seconds: Its length.
        more: A further torque of (N, n) positions, velocities and accelerations.
        gravity: (3,) in the base frame, m/s^2.
        speed: Times the usual one.
        rest: From when on the arm stands still, s.
    """
    time, q, qd, qdd = motion(seed, seconds, speed, rest)
    tree = build_tree(ARM, BODIES, gravity)
    effort = np.array([tree.inverse_dynamics(*each) for each in zip(q, qd, qdd, strict=True)])
    effort += COULOMB * np.clip(qd / (0.01 * ARM.scale), -1.0, 1.0) + VISCOUS * qd
    effort += NOISE * np.random.default_rng(seed).standard_normal(q.shape)
    if more is not None:
        effort += more(q, qd, qdd)
    return Recording(ARM.joint_names, time, q, qd, effort)
