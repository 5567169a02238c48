"""A master arm with its rotors in MuJoCo, beside the package's plant."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, LinkMass, beta_from_links
from dvrk_gravity.effects import Gravity
from testing.mujoco_arms import mtm

ROTORS = np.array([0.0043, 0.0026, 0.0038, 0.00012, 0.000062, 0.000062, 0.000015])
# Motor angles from joint angles, written out: a3 = q2 + q3, a4 = q4 + 0.6697 q3.
MOTORS = np.eye(7)
MOTORS[2, 1], MOTORS[3, 2] = 1.0, 0.6697


def weight_of(arm: Arm, links: Mapping[str, pin.Inertia]) -> Gravity:
    """The gravity term of these links, from the closed form."""
    masses = {name: LinkMass(body.mass, tuple(body.lever)) for name, body in links.items()}
    return Gravity(arm, beta_from_links(masses, columns=14), np.array([0.0, 0.0, -9.81]))


class MtmInMujoco:
    """Accelerations and energy of an MTMR made of these links."""

    def __init__(self, links: Mapping[str, pin.Inertia]) -> None:
        self.engine = mtm("mtmr", links, (0.0, 0.0, -9.81))

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        unit, rest = np.eye(7), np.zeros((7, 7))
        held = self.engine.torque(rest + q, rest, rest)
        mass = (self.engine.torque(rest + q, rest, unit) - held).T
        bias = self.engine.torque(q[None], v[None], rest[:1])[0]
        return np.linalg.solve(mass + MOTORS.T @ np.diag(ROTORS) @ MOTORS, tau - bias)

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        model, data = self.engine.model, mujoco.MjData(self.engine.model)
        data.qpos[:], data.qvel[:] = self.engine.expand @ q, self.engine.expand @ v
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return float(data.energy.sum() + 0.5 * ROTORS @ (MOTORS @ v) ** 2)
