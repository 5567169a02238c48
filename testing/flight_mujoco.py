"""Flights of MuJoCo's arms: inverse dynamics along the motion that a controller makes of it.

The controller is a computed torque: with the arm's inertia M(q), what it does not know, d(t), moves
the arm off its way by

    M (a + 2 w v + w^2 x) = d,

so x follows from M^-1 d by a filter, and inverse dynamics, friction and sensors along the way with
x are those of the arm that yields. What happens enters d and, along the new way, the efforts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import cont2discrete, lfilter

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.recording import Recording
from testing.flight_motion import PausedMotion
from testing.happening import Happening
from testing.lab_motion import Sines, draw_calibration
from testing.lab_physics import AFTER, Truth, lagging
from testing.mujoco_arms import MujocoArm
from testing.mujoco_world import BEFORE, NAMES, MujocoWorld

STEP = 2e-3  # s, of the grid on which friction goes on
STIFFNESS = (40.0, 80.0)  # rad/s, w of the controllers
THICK = 4.0  # the cable that can snap to an arm's usual ones
RATE = 200.0  # Hz


@dataclass(frozen=True, eq=False)
class MujocoBench:
    """One of MuJoCo's arms as a :class:`testing.happening.Bench`.

    Attributes:
        world: The arm, its friction, cables and sensors.
        seed: Of what it was drawn from.
        calibration: The motion that it is identified from.
        cable: Index of the joint that has a thick cable.
        stiffness: w of its controller, rad/s.
    """

    world: MujocoWorld
    seed: int
    calibration: Sines
    cable: int
    stiffness: float

    @classmethod
    def draw(cls, name: str, seed: int) -> MujocoBench:
        """Draw an arm and its controller.

        Args:
            name: One of MuJoCo's arms (testing/mujoco_world.py).
            seed: Of everything that varies from one to the next.
        """
        random = np.random.default_rng([seed, NAMES.index(name), 17])
        world = MujocoWorld.draw(name, seed)
        joints = [joint for joint in range(world.arm.n) if joint != world.spring.joint]
        cable = int(random.choice(joints[: len(joints) - len(joints) // 3]))
        thick = np.ones(world.arm.n)
        thick[cable] = THICK
        known = world.cable
        known = replace(
            known, pull=thick * known.pull, bend=thick * known.bend, ripple=thick * known.ripple,
            lag=thick * known.lag,
        )  # fmt: skip
        sensors = replace(world.sensors, rate=RATE)
        world = replace(world, cable=known, sensors=sensors)
        stiffness = float(random.uniform(*STIFFNESS))
        return cls(world, seed, draw_calibration(world.arm, seed), cable, stiffness)

    @property
    def arm(self) -> Arm:
        """What the package knows of it."""
        return self.world.arm

    @property
    def engine(self) -> MujocoArm:
        """Its rigid body."""
        return self.world.engine

    @property
    def friction(self) -> Array:
        """(n,) level of the friction of its joints and their motors, N·m or N."""
        world = self.world
        return world.joint_friction.level + np.abs(
            self.arm.joint_effort(np.diag(world.motor_friction.level))
        ).sum(axis=0)

    @property
    def noise(self) -> Array:
        """(n,) standard deviation of an effort that is read, N·m or N at the joints."""
        sensors = self.world.sensors
        at_motors = np.diag(np.hypot(sensors.effort_noise, sensors.hum))
        return np.linalg.norm(self.arm.joint_effort(at_motors), axis=0)

    def calibrate(self) -> Recording:
        """See :class:`testing.happening.Bench`."""
        return self.world.record(self.world.truth(self.calibration), self.seed)

    def record(
        self, motion: PausedMotion, duration: float, happening: Happening | None, seed: int
    ) -> Recording:
        """See :class:`testing.happening.Bench`."""
        truth = self.truth(motion, duration, happening)
        if happening is not None:
            q, effort = happening.read(truth.time, truth.q, truth.effort)
            truth = replace(truth, q=q, effort=effort)
        return self.world.record(truth, seed)

    def truth(self, motion: PausedMotion, duration: float, happening: Happening | None) -> Truth:
        """Return what the arm does, and the efforts that it takes; arguments as of ``record``."""
        time = np.arange(-BEFORE, duration + AFTER, STEP)
        way = motion.at(time)
        carried, rubs = self._further(time, way, happening)
        if happening is not None and np.isfinite(happening.start):
            x, v, a = self._yielded(way[0], -carried - rubs)
            way = way[0] + x, way[1] + v, way[2] + a
            carried, rubs = self._further(time, way, happening)
        effort = self.world.effort(*way, carried) + rubs
        return Truth(self.arm, time, *way, effort)

    def cable_torque(self, q: Array) -> Array:
        """See :class:`testing.happening.Bench`."""
        world, torque = self.world, np.zeros_like(q)
        torque[:, self.cable] = world.cable.torque(q, np.zeros_like(q))[:, self.cable]
        return torque

    def _further(
        self, time: Array, way: tuple[Array, Array, Array], happening: Happening | None
    ) -> tuple[Array, Array]:
        """Return (T, n) the efforts that it takes more: what gears bear, and what joints rub."""
        q, qd, _ = way
        carried, rubs = np.zeros_like(q), np.zeros_like(q)
        if happening is None:
            return carried, rubs
        rows = happening.acts(time)
        if not rows.any():
            return carried, rubs
        there, joint = (q[rows], qd[rows], way[2][rows]), happening.joint
        if happening.what == "payload":
            carried[rows] = self.engine.added(there, joint, happening.size, happening.place)
        elif happening.what == "link_com":
            carried[rows] = self._moved_mass(there, happening, 1.0 + happening.size)
        elif happening.what == "base_tilt":
            carried[rows] = self._tilted(there, happening)
        elif happening.what == "gripper":
            rows = time >= happening.start
            there = (q[rows], qd[rows], way[2][rows])
            part, centre = happening.size, self.engine.centres[joint]
            change = self.engine.added(there, joint, part, centre + happening.place)
            change -= self.engine.added(there, joint, part, centre)
            carried[rows] = happening.grown(time[rows])[:, None] * change
        elif happening.what == "push":
            jacobian = self.engine.tip_jacobian(q[rows], np.zeros(3))
            carried[rows] = -np.einsum("tij,ti->tj", jacobian, happening.force(time[rows]))
        elif happening.what == "coulomb_friction":
            goal = np.zeros_like(there[1])
            goal[:, joint] = happening.size * np.sign(there[1][:, joint])
            rubs[rows] = lagging(there[0], goal, self.world.joint_friction.length)
        elif happening.what == "elastic_cable":
            whole = self.world.cable.torque(q, qd)
            rubs[rows, joint] = -whole[rows, joint]
        return carried, rubs

    def _moved_mass(
        self, there: tuple[Array, Array, Array], happening: Happening, factor: float
    ) -> Array:
        """Return efforts of a link's mass at a multiple of its place less those at its place."""
        engine, joint = self.engine, happening.joint
        mass = float(engine.model.body_mass[engine.bodies[joint]])
        moved = engine.added(there, joint, mass, factor * happening.place)
        return moved - engine.added(there, joint, mass, happening.place)

    def _tilted(self, there: tuple[Array, Array, Array], happening: Happening) -> Array:
        """Return the efforts of a mount that is tilted, less those of one that is not."""
        engine, still = self.engine, np.zeros_like(there[0])
        tilted = engine.torque(there[0], still, still, happening.tilted(self.arm.gravity))
        return tilted - engine.torque(there[0], still, still, self.arm.gravity)

    def _yielded(self, q: Array, pushed: Array) -> tuple[Array, Array, Array]:
        """Return how far, how fast and with which acceleration a push (T, n) moves the arm off."""
        acceleration = np.zeros_like(q)
        rows = np.flatnonzero(pushed.any(axis=1))
        if len(rows):
            rows = np.arange(rows[0], rows[-1] + 1)
            mass = self.engine.mass_matrix(q[rows])
            to_motor = self.arm.actuator_position(np.eye(self.arm.n)).T
            mass = mass + to_motor.T @ np.diag(self.world.rotors) @ to_motor
            acceleration[rows] = np.linalg.solve(mass, pushed[rows, :, None])[..., 0]
        w = self.stiffness
        servo = np.array([[0.0, 1.0], [-(w**2), -2.0 * w]]), np.array([[0.0], [1.0]])
        carry, take, *_ = cont2discrete((*servo, np.eye(2), np.zeros((2, 1))), STEP)
        # Both states by one filter each: x = (z - A)^-1 B u.
        bottom = [1.0, -float(np.trace(carry)), float(np.linalg.det(carry))]
        far = [0.0, take[0, 0], carry[0, 1] * take[1, 0] - carry[1, 1] * take[0, 0]]
        fast = [0.0, take[1, 0], carry[1, 0] * take[0, 0] - carry[0, 0] * take[1, 0]]
        x, v = (np.asarray(lfilter(top, bottom, acceleration, axis=0)) for top in (far, fast))
        return x, v, acceleration - 2.0 * w * v - w**2 * x
