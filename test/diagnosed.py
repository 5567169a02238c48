"""Arms, recordings, models and diagnoses that the tests of the diagnosis share, each made once.

The small arm turns, turns, slides and turns (``testing/chain.yaml``). Its torques are Pinocchio's
inverse dynamics of its links, and rotors and friction that are written out here. In the laboratory
it is another one: MuJoCo computes its rigid body, and nobody models its friction and cables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin
from made_up_arm import random_inertias
from support import REPOSITORY

from dvrk_gravity import identify
from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import Diagnosis, Finding, diagnose
from dvrk_gravity.identification import Fit
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.lab_motion import draw_calibration, draw_other
from testing.lab_physics import Truth
from testing.mujoco_world import MujocoWorld
from testing.world import COARSE, World

ARM = Arm.load(REPOSITORY / "testing" / "chain.yaml")
YAW, PITCH, INSERTION, ROLL = range(ARM.n)
LINKS = random_inertias(ARM, 3)
ROTORS = np.array([0.02, 0.02, 2e-4, 3e-3])  # kg·m^2, at the motors
COULOMB = np.array([0.3, 0.3, 1.0, 0.05])  # N·m or N
VISCOUS = np.array([0.3, 0.3, 3.0, 0.03])  # N·m·s/rad or N·s/m
NOISE = np.array([0.05, 0.05, 0.1, 0.01])  # N·m or N
MIDDLE, HALF = np.array([0.0, 0.1, 0.13, 0.0]), np.array([1.0, 0.9, 0.09, 2.0])  # rad or m
RATE, DURATION = 100.0, 10.0  # Hz, s


def eye(joint: int) -> Array:
    """Return (n,) one at a joint of the small arm, else zero."""
    return np.eye(ARM.n)[joint]


@cache
def model() -> TorqueModel:
    """Return the model that knows all of the small arm."""
    bodies = {
        body.name: body.frame.act(LINKS[body.name]).toDynamicParameters() for body in ARM.bodies
    }
    return TorqueModel.from_parameters(
        {f"link_weight.{name}": tuple(values[:4]) for name, values in bodies.items()}
        | {f"link_inertia.{name}": tuple(values) for name, values in bodies.items()}
        | {
            "rotor_inertia.motor": tuple(ROTORS),
            "coulomb_friction.joint_positive": tuple(COULOMB),
            "coulomb_friction.joint_negative": tuple(COULOMB),
            "viscous_friction.joint": tuple(VISCOUS),
        },
        ARM,
    )


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of the small arm: (N,) times, s, and (N, n) positions and their derivatives."""

    time: Array
    q: Array
    qd: Array
    qdd: Array

    def torque(
        self, links: Mapping[str, pin.Inertia] = LINKS, gravity: Array = ARM.gravity
    ) -> Array:
        """Return (N, n) torques of the arm, N·m or N."""
        tree = build_tree(ARM, links, gravity)
        samples = zip(self.q, self.qd, self.qdd, strict=True)
        rigid = np.array([tree.inverse_dynamics(*sample) for sample in samples])
        rotors = ARM.joint_effort(ROTORS * ARM.actuator_position(self.qdd))
        return rigid + rotors + COULOMB * np.sign(self.qd) + VISCOUS * self.qd

    def read(self, effort: Array, seed: int = 1, **changes: object) -> Recording:
        """Return a recording of efforts, with noise."""
        noise = NOISE * np.random.default_rng(seed).normal(size=effort.shape)
        fields = {
            "joints": ARM.joint_names, "time": self.time, "position": self.q, "velocity": self.qd,
            "effort": effort + noise, "source": "small arm", "arm": ARM,
        }  # fmt: skip
        return Recording(**(fields | changes))


@cache
def moving(
    seed: int = 0, duration: float = DURATION, fastest: float = 0.7, rate: float = RATE
) -> Motion:
    """Return a motion of two sines a joint, up to some frequency, Hz."""
    random = np.random.default_rng(seed)
    time = np.arange(int(duration * rate)) / rate
    q, qd, qdd = np.tile(MIDDLE, (len(time), 1)), *np.zeros((2, len(time), ARM.n))
    for frequency in random.uniform(0.1, fastest, (2, ARM.n)):
        omega, phase = 2.0 * np.pi * frequency, random.uniform(0.0, 6.0, ARM.n)
        angle = time[:, None] * omega + phase
        q += 0.5 * HALF * np.sin(angle)
        qd += 0.5 * HALF * omega * np.cos(angle)
        qdd -= 0.5 * HALF * omega**2 * np.sin(angle)
    return Motion(time, q, qd, qdd)


@cache
def recorded(seed: int = 0, duration: float = DURATION) -> Recording:
    """Return what sensors say of the small arm where nothing is wrong."""
    motion = moving(seed, duration)
    return motion.read(motion.torque(), seed)


def loaded(mass: float, com: tuple[float, float, float], link: str = "link4") -> dict:
    """Return the links of the small arm of which one carries a point mass, kg, at a place, m."""
    more = pin.Inertia(mass, np.array(com), np.zeros((3, 3)))
    return {**LINKS, link: LINKS[link] + more}


def poses(count: int = 60, seed: int = 0) -> Array:
    """Return (N, n) static poses of the small arm."""
    return MIDDLE + HALF * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, ARM.n))


def of_poses(q: Array, effort: Array, seed: int = 1, **changes: object) -> Recording:
    """Return a recording of static poses, with a tenth of the noise of a motion."""
    noise = 0.1 * NOISE * np.random.default_rng(seed).normal(size=q.shape)
    fields = {"joints": ARM.joint_names, "time": None, "position": q, "effort": effort + noise}
    return Recording(**({"arm": ARM, **fields} | changes))


def only(diagnosis: Diagnosis) -> Finding:
    """Return the one finding."""
    assert len(diagnosis.findings) == 1, diagnosis
    return diagnosis.findings[0]


def named(diagnosis: Diagnosis) -> list[tuple[str, tuple[str, ...]]]:
    """Return effect and joints of every finding."""
    return [(finding.effect, finding.joints) for finding in diagnosis.findings]


def claims(diagnosis: Diagnosis) -> set[tuple[str, tuple[str, ...]]]:
    """Return effect and joints of every finding, alternatives included."""
    return {
        (claim.effect, tuple(claim.joints))
        for finding in diagnosis.findings
        for claim in (finding, *finding.alternatives)
    }


def holds(finding: Finding, name: str, truth: float, rel: float = 0.1) -> bool:
    """Return whether a parameter is right to a part, or its interval holds the truth."""
    found = finding.parameters[name]
    return abs(found.value - truth) <= rel * abs(truth) or found.low <= truth <= found.high


# A master arm of seven joints, simulated with sensors.
@cache
def seven(seed: int = 5) -> World:
    """Return a world whose own model is right."""
    return World.draw(seed, step=COARSE)


@cache
def of_seven(seed: int = 5) -> Recording:
    """Return ten seconds of it."""
    return seven(seed).record(3, 4, DURATION, RATE)


# The small arm in a laboratory.
LAB_SEED = 4


@cache
def lab() -> MujocoWorld:
    """Return the arm in the laboratory."""
    return MujocoWorld.draw("chain", LAB_SEED)


@cache
def identified() -> Fit:
    """Return what was identified of it."""
    calibration = lab().truth(draw_calibration(lab().arm, LAB_SEED))
    return identify(lab().record(calibration, LAB_SEED), lab().arm)


@cache
def another(seed: int, duration: float = 12.0) -> Truth:
    """Return another motion of it, about where the calibration went."""
    calibration = draw_calibration(lab().arm, LAB_SEED)
    return lab().truth(draw_other(lab().arm, seed, calibration), duration)


def seen(truth: Truth, seed: int = 1, extra: Array | float = 0.0) -> Recording:
    """Return what its sensors say of a motion, with extra (T, n) torques."""
    return lab().record(replace(truth, effort=truth.effort + extra), seed)


@cache
def clean(seed: int) -> Diagnosis:
    """Return the diagnosis of another motion of it, where nothing has changed."""
    return diagnose(seen(another(seed), seed), identified().model)
