"""A master arm whose torques Pinocchio computes, with friction and a spring written out here."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import JOINT_NAMES, Arm, build_tree
from dvrk_gravity.recording import Recording

ARM = Arm.load("mtmr")
COULOMB = np.array([0.03, 0.04, 0.05, 0.02, 0.004, 0.003, 0.001])
VISCOUS = np.array([0.02, 0.03, 0.02, 0.003, 0.0008, 0.0005, 0.0001])
SPRING = 0.0074  # N·m/rad, joint 5
NOISE = np.array([0.02, 0.02, 0.02, 0.003, 0.001, 0.001, 0.0002])
SIZES = {  # mass kg, centre m
    "link1": (1.0, (0.0, 0.0, 0.02)),
    "link2": (0.65, (-0.2, 0.0, 0.0)),
    "link3": (0.3, (-0.25, 0.0, 0.0)),
    "link4": (0.14, (0.0, -0.084, -0.08)),
    "link5": (0.04, (0.0, 0.036, -0.065)),
    "link6": (0.05, (0.0, -0.025, 0.05)),
    "link7": (0.02, (0.0, 0.0, 0.01)),
}


def truth(
    seed: int, duration: float = 24.0, rate: float = 100.0, gravity: np.ndarray = ARM.gravity
) -> Recording:
    """Return an exciting motion with torques from Pinocchio and friction written out here."""
    random = np.random.default_rng(seed)
    time = np.arange(int(duration * rate)) / rate
    half = 0.35 * (ARM.upper - ARM.lower) * np.array([1, 1, 1, 0.7, 0.7, 1, 0.2])
    q, qd, qdd = np.zeros((3, len(time), 7))
    q += 0.5 * (ARM.upper + ARM.lower)
    for _ in range(5):
        rate_ = 2.0 * np.pi * random.uniform(0.1, 0.7, 7)
        angle = time[:, None] * rate_ + random.uniform(0.0, 6.3, 7)
        q += half / 4 * np.sin(angle)
        qd += half / 4 * rate_ * np.cos(angle)
        qdd -= half / 4 * rate_**2 * np.sin(angle)
    bodies = {body: pin.Inertia.FromSphere(mass, 0.05) for body, (mass, _) in SIZES.items()}
    for body, (_, centre) in SIZES.items():
        bodies[body].lever = np.array(centre)
    tree = build_tree(ARM, bodies, gravity)
    effort = np.array([tree.inverse_dynamics(*sample) for sample in zip(q, qd, qdd, strict=True)])
    # The elbow's friction is its motor's, which turns with q2 + q3.
    at_joint = np.array([1, 1, 0, 1, 1, 1, 1])
    effort += at_joint * COULOMB * np.sign(qd) + VISCOUS * qd
    effort[:, 1:3] += COULOMB[2] * np.sign(qd[:, 1] + qd[:, 2])[:, None]
    effort[:, 4] += SPRING * q[:, 4]
    effort += ARM.joint_effort(random.normal(size=q.shape) * NOISE)
    return Recording(JOINT_NAMES, time, q, qd, effort)


def parameter(fit, name: str):
    return next(fitted for fitted in fit.parameters if fitted.name.startswith(name))
