"""Any arm with inertia from its file or drawn, and friction at its joints; its recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import PlantPart
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import PlanLimits, exciting_motion
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import Sensors, SimulatedArm, record_motion
from testing import physics
from testing.hidden_plant import HiddenPlant, Torque

STEP = 2e-3  # s, of the simulation: a fifth of the servo's time constant
# Of a joint's largest effort: friction as industrial arms have it, at rest and at one rad/s (0.1
# m/s), and the noise of a measured effort.
COULOMB, VISCOUS, NOISE = 0.02, 0.02, 0.003
COUNT = 1e-5  # rad or m, step of the encoders


@dataclass(frozen=True, eq=False)
class PlainWorld:
    """An arm, its links' inertia, and friction; its weight is Pinocchio's, no effect's.

    Attributes:
        arm: Geometry and limits.
        links: Inertia of its bodies, in their link frames.
        coulomb: (n,) dry friction of the joints, N·m or N.
        viscous: (n,) N·m·s/rad or N·s/m.
        extra: Further torques.
    """

    arm: Arm
    links: Mapping[str, pin.Inertia]
    coulomb: Array
    viscous: Array
    extra: tuple[Torque, ...] = ()

    @classmethod
    def of(cls, arm: Arm, links: Mapping[str, pin.Inertia]) -> PlainWorld:
        """Return the world of an arm with usual friction."""
        effort = arm.effort_limit
        return cls(arm, links, COULOMB * effort, VISCOUS * effort / arm.scale)

    def with_payload(self, link: str, mass: float, com: tuple[float, float, float]) -> PlainWorld:
        """Return it with a point mass, kg, at (3,) a point of a link's frame, m."""
        carried = self.links[link] + pin.Inertia(mass, np.array(com), np.zeros((3, 3)))
        return replace(self, links={**self.links, link: carried})

    def with_friction(self, joint: int, level: float) -> PlainWorld:
        """Return it with more dry friction at a joint, N·m or N."""
        return replace(self, coulomb=self.coulomb + level * np.eye(self.arm.n)[joint])

    def simulated(self, seed: int, friction: float = 1.0, step: float = STEP) -> SimulatedArm:
        """Return the arm that moves, with a part of its friction and nothing that carries it.

        Args:
            seed: Seed of the sensors' noise.
            friction: Factor on friction.
            step: Of the simulation, s.
        """
        arm, none = self.arm, np.zeros(self.arm.n)
        parts = (
            PlantPart(weight=build_tree(arm, self.links, arm.gravity)),
            physics.coulomb(friction * np.array([self.coulomb, self.coulomb, none, none])),
            physics.viscous(friction * self.viscous),
        )
        plant = HiddenPlant(TorqueModel(arm, ()), self.links, none, parts, self.extra)
        sensors = Sensors(none + COUNT, None, None, NOISE * arm.actuator_effort_limit)
        return SimulatedArm(plant, sensors, seed, builtin_compensation=False, dt=step)

    def record(self, seed: int, duration: float, rate: float = 100.0) -> Recording:
        """Record an exciting motion within the arm's limits.

        Args:
            seed: Seed of motion and noise.
            duration: s.
            rate: Hz.
        """
        motion = exciting_motion(PlanLimits.of(self.arm), duration + 10.0, seed)
        return record_motion(self.simulated(seed), motion, duration, rate)
