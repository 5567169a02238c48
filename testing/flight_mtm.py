"""Flights of a master arm in the package's simulator, whose controller knows the arm as it was."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import Measurement, Plant, SimulatedArm, simulate
from testing import mujoco_arms
from testing.flight_motion import PausedMotion
from testing.happening import Happening
from testing.lab_motion import Sines, draw_calibration
from testing.mujoco_arms import MujocoArm
from testing.world import COARSE, World

SERVO = 100.0  # rad/s, of a critically damped servo that is equally stiff in every pose
RATE = 200.0  # Hz
BEFORE = 0.5  # s, for which the arm moves before a recording
SNAPS = (0, 1, 3, 4)  # joints whose cable may snap: what has a way worth a cable
CABLE = np.array([0.06, 0.1, 0.06, 0.06, 0.02, 0.012, 0.004])  # N·m at the ends of the way, thick
WAY = np.array([0.5, 0.4, 0.4, 1.5, 1.2, 0.4, 1.5])  # rad, half of it
_TOGETHER = 1000  # steps whose set points are evaluated at a time


@dataclass(frozen=True, eq=False)
class MtmBench:
    """A master arm as a :class:`testing.happening.Bench`.

    Attributes:
        world: The arm and its sensors.
        seed: Of what it was drawn from.
        calibration: The motion that it is identified from.
        cable: Index of the joint that has a thick cable.
    """

    world: World
    seed: int
    calibration: Sines
    cable: int

    @classmethod
    def draw(cls, seed: int) -> MtmBench:
        """Draw an arm; the seed is of everything that varies from one to the next."""
        random = np.random.default_rng([seed, 18])
        world = World.draw(8000 + seed, step=COARSE)
        joint = int(random.choice(SNAPS))
        cable = world.cable.copy()
        # Straight and bent parts that together are the thick cable's at the end of the way.
        parts = np.array([random.uniform(0.6, 1.0), random.uniform(-0.3, 0.3), 0.3])
        cable[1:, joint] = CABLE[joint] * parts / WAY[joint] ** np.arange(1, 4)
        return cls(replace(world, cable=cable), seed, draw_calibration(world.arm, seed), joint)

    @property
    def arm(self) -> Arm:
        """What the package knows of it."""
        return self.world.arm

    @cached_property
    def engine(self) -> MujocoArm:
        """Its rigid body."""
        return mujoco_arms.mtm("mtmr", self.world.links, self.world.gravity)

    @property
    def friction(self) -> Array:
        """(n,) level of the friction of its joints and their motors, N·m."""
        up, _, motor_up, _ = self.world.coulomb
        return up + np.abs(self.arm.joint_effort(np.diag(motor_up))).sum(axis=0)

    @property
    def noise(self) -> Array:
        """(n,) standard deviation of an effort that is read, N·m at the joints."""
        noise = self.world.sensors.effort_noise
        assert noise is not None
        return np.linalg.norm(self.arm.joint_effort(np.diag(noise)), axis=0)

    def calibrate(self) -> Recording:
        """See :class:`testing.happening.Bench`."""
        return self.record(PausedMotion(self.calibration), 30.0, None, self.seed)

    def record(
        self, motion: PausedMotion, duration: float, happening: Happening | None, seed: int
    ) -> Recording:
        """See :class:`testing.happening.Bench`."""
        pilot = _Pilot(self, motion, happening, seed)
        simulate(pilot.simulated, pilot, BEFORE, RATE)
        recording = simulate(pilot.simulated, pilot, duration, RATE)
        if happening is None:
            return recording
        assert recording.time is not None
        assert recording.effort is not None
        q, effort = happening.read(recording.time, recording.position, recording.effort)
        return replace(recording, position=q, effort=effort)

    def cable_torque(self, q: Array) -> Array:
        """See :class:`testing.happening.Bench`."""
        torque, at = np.zeros_like(q), q[:, self.cable]
        torque[:, self.cable] = np.polynomial.polynomial.polyval(
            at, self.world.cable[:, self.cable]
        )
        return torque

    def changed(self, happening: Happening, part: float = 1.0) -> World:
        """Return the arm after something happened, or (of a gripper's motion) a part of it."""
        world, joint = self.world, happening.joint
        link = f"link{joint + 1}"
        if happening.what == "payload":
            return _loaded(world, link, happening.size, happening.place)
        if happening.what == "gripper":
            centre = world.links[link].lever
            world = _loaded(world, link, happening.size, centre + part * happening.place)
            return _loaded(world, link, -happening.size, centre)
        if happening.what == "link_com":
            body = world.links[link]
            moved = pin.Inertia(body.mass, (1.0 + happening.size) * body.lever, body.inertia)
            return replace(world, links={**world.links, link: moved})
        if happening.what == "base_tilt":
            return replace(world, gravity=happening.tilted(world.gravity))
        if happening.what == "coulomb_friction":
            coulomb = world.coulomb.copy()
            coulomb[:2, joint] += happening.size
            return replace(world, coulomb=coulomb)
        if happening.what == "elastic_cable":
            cable = world.cable.copy()
            cable[:, self.cable] = 0.0
            return replace(world, cable=cable)
        return world


def _loaded(world: World, link: str, mass: float, place: Array) -> World:
    body, load = world.links[link], np.asarray(place)
    total = body.mass + mass
    lever = (body.mass * body.lever + mass * load) / total
    about = np.zeros((3, 3))
    for part, at in ((body.mass, body.lever - lever), (mass, load - lever)):
        about += part * (at @ at * np.eye(3) - np.outer(at, at))
    whole = pin.Inertia(total, lever, body.inertia + about)
    return replace(world, links={**world.links, link: whole})


class _Pilot:
    """The controller, in its own knowledge of the arm, and what happens to the arm meanwhile."""

    def __init__(
        self, bench: MtmBench, motion: PausedMotion, happening: Happening | None, seed: int
    ) -> None:
        self._bench, self._motion, self._happening = bench, motion, happening
        world = bench.world
        self._known = world.plant()
        self._todo = [] if happening is None else self._changes(happening)
        plant: Plant = world.plant()
        if self._todo and not np.isfinite(self._todo[0][0]):
            plant = self._todo.pop(0)[1]
        q, qd, _ = motion.at(np.array([-BEFORE]))
        plant.reset(np.clip(q[0], *world.arm.range), qd[0])
        self._changed = not np.isfinite(happening.start) if happening is not None else False
        self.simulated = SimulatedArm(
            plant, world.sensors, seed, builtin_compensation=False, dt=world.step
        )
        self._goals = np.empty((0, 3, world.arm.n))
        self._row, self._first = 0, 0
        self._command()

    def __call__(self, simulated: SimulatedArm, _: Measurement) -> None:
        """Command the next step."""
        time = simulated.plant.time - BEFORE
        while self._todo and time >= self._todo[0][0] - 1e-9:
            simulated.plant = _went_on(self._todo.pop(0)[1], simulated.plant)
            self._changed = True
        happening = self._happening
        if happening is not None and happening.what == "push":
            step = simulated.dt
            force = happening.force(np.array([time + 0.5 * step]))
            if force.any():
                jacobian = self._bench.engine.tip_jacobian(simulated.plant.q[None], np.zeros(3))
                simulated.push(jacobian[0].T @ force[0], 0.5 * step)
        self._command()

    def _changes(self, happening: Happening) -> list[tuple[float, Plant]]:
        """Return when the arm becomes which."""
        if happening.what == "gripper":
            parts = np.linspace(0.0, 1.0, 11)[1:]
            smooth = parts**2 * (3.0 - 2.0 * parts)
            return [
                (
                    happening.start + part * happening.lasts,
                    self._bench.changed(happening, s).plant(),
                )
                for part, s in zip(parts.tolist(), smooth.tolist(), strict=True)
            ]
        changed = self._bench.changed(happening)
        return [] if changed is self._bench.world else [(happening.start, changed.plant())]

    def _command(self) -> None:
        """Command M(q) (a + 2 w e' + w^2 e) and the weight, of the arm as the controller knows it.

        Friction and velocity torques it does not know.
        """
        plant = self.simulated.plant
        knows = plant
        if self._changed:
            self._known.reset(plant.q, plant.v)
            knows = self._known
        goal, speed, acceleration = self._goal()
        wanted = acceleration + 2.0 * SERVO * (speed - plant.v) + SERVO**2 * (goal - plant.q)
        self.simulated.servo_jf(knows.mass_matrix() @ wanted + knows.smooth_torque())

    def _goal(self) -> Array:
        """Return (3, n) position, velocity and acceleration for the next step."""
        if self._row == len(self._goals):
            steps = np.arange(self._first, self._first + _TOGETHER)
            times = np.asarray((steps + 1) * self.simulated.dt - BEFORE, dtype=np.float64)
            self._goals = np.stack(self._motion.at(times), axis=1)
            self._first, self._row = self._first + _TOGETHER, 0
        self._row += 1
        return self._goals[self._row - 1]


def _went_on(plant: Plant, before: Plant) -> Plant:
    """Let a plant go on from the state of another one."""
    plant.reset(before.q, before.v)
    plant.time, plant.placed, plant.acted = before.time, before.placed, before.acted
    plant._v_before = before._v_before
    return plant
