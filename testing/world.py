"""A simulated arm, its recordings, and the model that would be right about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, LinkMass, beta_from_links, link_frames
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import (
    CoulombFriction,
    ElasticCable,
    Gravity,
    LinkInertia,
    Range,
    RotorInertia,
    ViscousFriction,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, Sensors, SimulatedArm, record_motion, record_poses
from testing import physics
from testing.hidden_plant import HiddenPlant, Torque

# s: steps of a quarter of the servo's time constant do where many arms are recorded.
COARSE = 2.5e-3

Reading = Callable[[Recording], Recording]
"""What a wrong reading makes of a recording."""


@dataclass(frozen=True, eq=False)
class World:
    """A master arm with its sensors: everything that a recording depends on but motion and noise.

    Attributes:
        arm: Geometry and limits.
        links: Inertia of the links; gravity follows from the same masses.
        counterweight: (14,) what springs and weights outside the links add to beta, N·m.
        gravity: (3,) gravity in the base frame, m/s^2.
        coulomb: (4, n) N·m: joint up, joint down, motor up, motor down.
        viscous: (n,) at the joints, N·m·s/rad.
        cable: (k, n) polynomial of each joint's elastic torque, N·m/rad^k.
        stribeck: (2, n) further dry friction at the joints: levels at rest, N·m, and the velocities
            that leave 1/e of them, rad/s.
        rotors: (n,) reflected inertia at the motors, kg·m^2.
        extra: Further torques.
        sensors: The sensors.
        readings: What is done to a recording afterwards, in order.
        step: Length of the plant's steps, s.
    """

    arm: Arm
    links: Mapping[str, pin.Inertia]
    counterweight: Array
    gravity: Array
    coulomb: Array
    viscous: Array
    cable: Array
    stribeck: Array
    rotors: Array
    sensors: Sensors
    extra: tuple[Torque, ...] = ()
    readings: tuple[Reading, ...] = field(default=())
    step: float = 1e-3

    @classmethod
    def draw(cls, seed: int, plant: str = "mtmr_28002", step: float = 1e-3) -> World:
        """Draw a plausible arm around a plant file's inertia and sensors.

        Args:
            seed: Seed of everything that varies from arm to arm.
            plant: Plant file whose links, rotors and sensors are the middle.
            step: Length of the plant's steps, s.
        """
        random = np.random.default_rng(seed)
        content = PlantFile.load(plant)
        n = content.model.arm.n
        links = {
            name: pin.Inertia(body.mass * factor, body.lever, body.inertia * factor)
            for (name, body), factor in zip(
                content.links.items(), random.uniform(0.8, 1.25, len(content.links)), strict=True
            )
        }
        counterweight = np.zeros(14)
        # Springs and weights at the arm and the forearm, as far as they act like mass.
        counterweight[[0, 2]] = random.uniform([-1.2, -0.7], [0.2, -0.4])
        n = len(content.model.arm.joints)
        joint = np.array([0.02, 0.03, 0.02, 0.02, 0.004, 0.003, 0.001])
        joint = joint * random.uniform(0.5, 1.5, n)
        motor = np.zeros(n)
        motor[2] = 0.02 * random.uniform(0.5, 1.5)
        viscous = np.array([0.02, 0.02, 0.02, 0.003, 0.0005, 0.0005, 0.0001])
        cable = np.zeros((4, n))
        cable[1, :6] = np.array([0.05, 0.0, 0.05, 0.015, 0.006, 0.004])
        cable[1:] *= random.uniform(0.5, 1.5, (3, n))
        return cls(
            arm=content.model.arm,
            links=links,
            counterweight=counterweight,
            gravity=content.model.arm.gravity,
            coulomb=np.array([joint, joint, motor, motor]),
            viscous=viscous * random.uniform(0.5, 1.5, n),
            cable=cable,
            stribeck=np.zeros((2, n)),
            rotors=content.rotor_inertia * random.uniform(0.8, 1.2, n),
            sensors=content.sensors,
            step=step,
        )

    @property
    def beta(self) -> Array:
        """(14,) gravity base parameters, N·m."""
        masses = {
            name: LinkMass(body.mass, tuple(body.lever.tolist()))
            for name, body in self.links.items()
        }
        return beta_from_links(masses, columns=14) + self.counterweight

    def model(self) -> TorqueModel:
        """Return the model that knows this world, but for ``extra``, ``stribeck`` and readings."""
        nothing = np.zeros(len(self.arm.joints))
        up, down, motor_up, motor_down = self.coulomb
        friction = (
            CoulombFriction(
                self.arm, up, down, motor_up, motor_down, nothing + 0.01, nothing, nothing
            ),
            ViscousFriction(self.arm, self.viscous, nothing),
        )
        elastic = ElasticCable(self.arm, self.cable, Range(nothing - np.inf, nothing + np.inf))
        frames = link_frames(self.arm)
        links = np.array(
            [
                frames[name].act(self.links[name]).toDynamicParameters()
                for name in self.arm.body_names
            ]
        )
        inertia = (LinkInertia(self.arm, links), RotorInertia(self.arm, self.rotors))
        return TorqueModel(self.arm, (self._weight(), elastic, *friction, *inertia))

    def plant(self) -> HiddenPlant:
        """Return the arm that moves."""
        parts = [
            physics.cable(self.cable),
            physics.coulomb(self.coulomb),
            physics.viscous(self.viscous),
        ]
        if self.stribeck[0].any():
            parts.append(physics.stribeck(*self.stribeck))
        model = TorqueModel(self.arm, (self._weight(),))
        return HiddenPlant(model, self.links, self.rotors, tuple(parts), self.extra)

    def record(
        self, motion: int, noise: int, duration: float = 30.0, rate: float = 200.0
    ) -> Recording:
        """Record a drawn exciting motion.

        Args:
            motion: Seed of the motion.
            noise: Seed of the sensors' noise.
            duration: s.
            rate: Hz.
        """
        arm = SimulatedArm(self.plant(), self.sensors, noise, dt=self.step)
        recording = record_motion(arm, Multisine.draw(self.arm, motion), duration, rate)
        return self._read(recording)

    def record_poses(self, poses: int, noise: int, count: int = 150) -> Recording:
        """Record drawn static poses; the seeds are as in :meth:`record`."""
        arm = SimulatedArm(self.plant(), self.sensors, noise, dt=self.step)
        return self._read(record_poses(arm, poses, count))

    def _weight(self) -> Gravity:
        return Gravity(self.arm, self.beta, self.gravity)

    def _read(self, recording: Recording) -> Recording:
        for reading in self.readings:
            recording = reading(recording)
        return recording
