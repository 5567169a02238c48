"""Arms identified once for all tests that read them: made when first asked for, and kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import known_mtm
import known_poses
import numpy as np
import pinocchio as pin
from made_up_arm import made_up_arm, random_inertias
from robots import UR5

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.identification import Fit, fit_static, identify
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion
from testing.plain_world import PlainWorld
from testing.world import COARSE

FEW = ["coulomb_friction", "viscous_friction"]
"""Effects, for quick fits."""

_KEPT: list[TemporaryDirectory[str]] = []


@dataclass(frozen=True, eq=False)
class Identified:
    """A simulated arm, its recording, and what was identified from it."""

    world: PlainWorld
    recording: Recording
    fit: Fit

    @property
    def arm(self) -> Arm:
        return self.world.arm


@cache
def folder() -> Path:
    """Return a folder that is deleted when the tests end."""
    _KEPT.append(TemporaryDirectory())
    return Path(_KEPT[-1].name)


@cache
def mtm() -> Fit:
    """A master arm from half a minute of motion, everything looked for."""
    return identify([known_mtm.truth(1)], known_mtm.ARM)


@cache
def mtm_poses() -> Fit:
    """A master arm from a grid of four positions of each joint, both directions."""
    poses = known_poses.record(known_poses.truth(), known_poses.grid(4))
    return fit_static(poses, known_poses.ARM)


def world_of(arm: Arm, links: dict[str, pin.Inertia] | None = None) -> PlainWorld:
    """Return an arm that moves by Pinocchio's dynamics of links, those in its file by default."""
    return PlainWorld.of(arm, links or nominal_inertias(arm))


def identified(world: PlainWorld) -> Identified:
    recording = world.record(1, 20.0)
    return Identified(world, recording, identify(recording, world.arm))


@cache
def ur5() -> Identified:
    """Six joints, from a URDF."""
    return identified(world_of(Arm.load(UR5)))


@cache
def chain() -> Identified:
    """Four joints, one of which slides, with links that follow and a transmission."""
    arm = made_up_arm(folder())
    return identified(world_of(arm, random_inertias(arm, 3)))


@cache
def ur5_motion(
    masses: tuple[float, float] = (1.0, 1.0), load: float = 0.0, file: str = str(UR5)
) -> Recording:
    """Return a motion of an arm whose links weigh other parts of what its file says."""
    arm = Arm.load(file)
    links = nominal_inertias(arm)
    part = np.random.default_rng(3).uniform(*masses, len(links))
    drawn = {
        body: pin.Inertia(factor * link.mass, link.lever, factor * link.inertia)
        for (body, link), factor in zip(links.items(), part, strict=True)
    }
    world = PlainWorld.of(arm, drawn)
    if load:
        world = world.with_payload(arm.body_names[-1], load, (0.02, 0.05, 0.08))
    return world.record(1, 10.0)


def move(plant: PlantFile, seed: int, duration: float) -> Recording:
    """Return what a shipped plant shows of a random motion."""
    arm = SimulatedArm(plant.plant(), plant.sensors, seed, dt=COARSE)
    return record_motion(arm, Multisine.draw(plant.model.arm, seed), duration)
