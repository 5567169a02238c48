"""Arms whose rigid body MuJoCo computes and whose friction, cables and sensors nobody models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing import mujoco_arms
from testing.lab_effects import Setting
from testing.lab_motion import Sines
from testing.lab_physics import AFTER, Cable, Friction, LabSensors, Spring, Truth
from testing.mujoco_arms import MujocoArm

Random = np.random.Generator

NAMES = (
    "mtmr", "mtml", "ur5", "panda", "chain", "ur10", "kinova", "panda_gripper", "psm", "ecm",
)  # fmt: skip
PLANTS = {"mtmr": "mtmr_28002", "mtml": "mtmr_28002", "psm": "psm", "ecm": "ecm"}
# kg, m: what is fastened to them, where; an endoscope is 0.8 to 2.5 kg.
LOADS = {"psm": ((0.01, 0.15), 0.03), "ecm": ((0.05, 1.0), 0.05)}
STEP = 1e-3  # s, of the grid on which friction goes on
BEFORE = 1.0  # s, of motion before a recording
DURATION = 30.0  # s


@dataclass(frozen=True, eq=False)
class Sizes:
    """What is usual for an arm; arrays are (n,).

    Attributes:
        friction: Coulomb's level at the joints, N·m or N.
        motor_friction: At the motors.
        cable: Level of the cables.
        rotors: Reflected inertia at the motors, kg·m^2 or kg.
        position_step: Of the encoders at the motors, rad or m.
        effort_noise: At the motors, N·m or N.
        spring: Joint that has a spring, and its torque, N·m.
        payload: Least and greatest mass that somebody would fasten to it, kg.
        reach: How far from a link's centre of mass that would be along each axis, m.
    """

    friction: Array
    motor_friction: Array
    cable: Array
    rotors: Array
    position_step: Array
    effort_noise: Array
    spring: tuple[int, float]
    payload: tuple[float, float]
    reach: float

    @classmethod
    def of(cls, arm: Arm) -> Sizes:
        """Return those of an arm.

        Of a da Vinci's arm: of its plant file, and as seen on real ones. Of others friction and
        noise are a part of the largest efforts, as in ``plain_world``.
        """
        if mtm.is_mtm(arm):
            plant, position_step, effort_noise = _plant(arm.name)
            return cls(
                friction=np.array([0.02, 0.03, 0.02, 0.02, 0.004, 0.003, 0.001]),
                motor_friction=np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.0]),
                cable=np.array([0.02, 0.02, 0.02, 0.02, 0.007, 0.004, 0.001]),
                rotors=plant.rotor_inertia,
                position_step=position_step,
                effort_noise=effort_noise,
                spring=(4, 0.01),
                payload=(0.02, 0.1),
                reach=0.03,
            )
        if arm.name in PLANTS:
            plant, position_step, effort_noise = _plant(arm.name)
            known = plant.model.parameters()
            none = np.zeros(arm.n)
            friction, motors = (
                np.asarray(known.get(f"coulomb_friction.{where}_positive", none))
                for where in ("joint", "motor")
            )
            payload, reach = LOADS[arm.name]
            return cls(
                friction=friction,
                motor_friction=motors,
                cable=0.35 * (friction + motors),  # to friction as below
                rotors=plant.rotor_inertia,
                position_step=position_step,
                effort_noise=effort_noise,
                spring=(1, float(friction[1])),
                payload=payload,
                reach=reach,
            )
        effort, motor = arm.effort_limit, arm.actuator_effort_limit
        moved = np.abs(arm.actuator_to_joint - np.diag(np.diag(arm.actuator_to_joint))).sum(axis=0)
        largest = float(effort[: arm.n // 2].max())
        return cls(
            friction=0.02 * effort,
            motor_friction=0.01 * motor * (moved > 0.0),
            cable=0.007 * effort,
            rotors=2e-3 * motor,
            position_step=2e-5 * np.ones(arm.n),
            effort_noise=0.003 * motor,
            spring=(1, 0.05 * float(effort[1])),
            payload=(0.002 * largest, 0.012 * largest),
            reach=0.08,
        )


@dataclass(frozen=True, eq=False)
class MujocoWorld:
    """An arm in a laboratory.

    Attributes:
        arm: What the package knows of it: geometry and limits.
        sizes: What is usual for it.
        engine: Its rigid body.
        rotors: (n,) reflected inertia at the motors, kg·m^2 or kg.
        joint_friction: At the joints.
        motor_friction: At the motors.
        cable: At the joints.
        spring: One.
        sensors: Its electronics.
    """

    arm: Arm
    sizes: Sizes
    engine: MujocoArm
    rotors: Array
    joint_friction: Friction
    motor_friction: Friction
    cable: Cable
    spring: Spring
    sensors: LabSensors

    @classmethod
    def draw(cls, name: str, seed: int) -> MujocoWorld:
        """Draw an arm of some kind.

        Args:
            name: One of ``NAMES``.
            seed: Of everything that varies from one to the next.
        """
        random = np.random.default_rng([seed, NAMES.index(name)])
        arm = mujoco_arms.arm_of(name)
        sizes, n = Sizes.of(arm), arm.n
        lower, upper = (np.clip(limit, -2.0 * np.pi, 2.0 * np.pi) for limit in arm.range)
        fast = 0.5 * arm.scale
        motors = np.abs(np.diag(arm.joint_to_actuator))
        joint, torque = sizes.spring
        return cls(
            arm=arm,
            sizes=sizes,
            engine=_engine(name, arm, random),
            rotors=sizes.rotors * random.uniform(0.6, 1.4, n),
            joint_friction=Friction.draw(sizes.friction, fast, arm.scale, random),
            motor_friction=Friction.draw(sizes.motor_friction, fast * motors, arm.scale * motors,
                                         random),
            cable=Cable.draw(sizes.cable, lower, upper, random),
            spring=Spring(joint, torque * random.uniform(0.5, 1.5), random.uniform(-1.0, 1.0),
                          random.uniform(0.2, 0.5)),
            sensors=LabSensors.draw(sizes.position_step, sizes.effort_noise, random),
        )  # fmt: skip

    def truth(self, motion: Sines, duration: float = DURATION) -> Truth:
        """Return what a motion takes, from ``BEFORE`` seconds before it to a little after.

        Args:
            motion: The motion, kept exactly.
            duration: s.
        """
        time = np.arange(-BEFORE, duration + AFTER, STEP)
        q, qd, qdd = motion.at(time)
        return Truth(self.arm, time, q, qd, qdd, self.effort(q, qd, qdd))

    def effort(self, q: Array, qd: Array, qdd: Array, carried: Array | float = 0.0) -> Array:
        """Return (T, n) efforts of a motion (T, n) on a fine grid of times, N·m or N.

        Args:
            q: Positions.
            qd: Velocities.
            qdd: Accelerations.
            carried: (T, n) what the arm's gears bear beside its own masses.
        """
        arm = self.arm
        rigid = self.engine.torque(q, qd, qdd) + carried
        at_motor = arm.actuator_position(q), arm.actuator_position(qd)
        rotors = self.rotors * arm.actuator_position(qdd)
        rubbing = self.motor_friction.torque(*at_motor, arm.actuator_effort(rigid))
        return (
            rigid
            + arm.joint_effort(rotors + rubbing)
            + self.joint_friction.torque(q, qd, rigid)
            + self.cable.torque(q, qd)
            + self.spring.at(q)
        )

    def at_rest(self, q: Array) -> Array:
        """Return (T, n) efforts that hold the arm, halfway between both ways of slow motion."""
        still = np.zeros_like(q)
        rigid = self.engine.torque(q, still, still)
        at_motor = self.motor_friction.middle(self.arm.actuator_effort(rigid))
        return (
            rigid
            + self.cable.torque(q, still)
            + self.spring.at(q)
            + self.joint_friction.middle(rigid)
            + self.arm.joint_effort(at_motor)
        )

    def setting(self, truth: Truth, residual: Array) -> Setting:
        """Return where effects are hidden.

        Args:
            truth: The motion without them.
            residual: (n,) what the identified model leaves, RMS, N·m or N.
        """
        sizes, engine = self.sizes, self.engine
        return Setting(
            truth, engine, residual, sizes.payload, sizes.reach, engine.centres, self.sensors.delay,
            self.rotors,
        )  # fmt: skip

    def record(self, truth: Truth, noise: int) -> Recording:
        """Return what the sensors say of it; the seed is the noise's."""
        return self.sensors.read(truth, noise, f"MuJoCo's {self.arm.name}")


def _engine(name: str, arm: Arm, random: Random) -> MujocoArm:
    if name in PLANTS:
        links = PlantFile.load(PLANTS[name]).links
        drawn = {
            body: pin.Inertia(link.mass * factor, link.lever, link.inertia * factor)
            for (body, link), factor in zip(
                links.items(), random.uniform(0.7, 1.4, len(links)), strict=True
            )
        }
        build = mujoco_arms.mtm if mtm.is_mtm(arm) else mujoco_arms.table
        return build(name, drawn, arm.gravity)
    if name == "chain":
        sizes = (2.0, 1.5, 0.8, 0.3)
        drawn = {f"link{i}": _link(random, size) for i, size in enumerate(sizes, start=1)}
        return mujoco_arms.table(name, drawn, arm.gravity)
    return mujoco_arms.urdf(arm, random.uniform(0.7, 1.4, arm.n).tolist())


def _plant(name: str) -> tuple[PlantFile, Array, Array]:
    """Return an arm's plant, the steps of its encoders and the noise of its efforts."""
    plant = PlantFile.load(PLANTS[name])
    step, noise = plant.sensors.position_step, plant.sensors.effort_noise
    assert step is not None
    assert noise is not None
    return plant, step, noise


def _link(random: Random, mass: float) -> pin.Inertia:
    """Return that of a few point masses, which makes it physical."""
    masses = mass * random.uniform(0.1, 0.3, 6)
    points = random.normal(0.0, 0.06, (6, 3))
    lever = masses @ points / masses.sum()
    inertia = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p))
        for m, p in zip(masses, points - lever, strict=True)
    )
    return pin.Inertia(masses.sum(), lever, inertia)
