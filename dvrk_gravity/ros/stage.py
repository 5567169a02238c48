"""An arm's demonstration: plant, model, poses, a hand's push, and a load that is fastened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DRY_SPEED, Settings
from dvrk_gravity.effects import last_link
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files.resources import config_path, shipped
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Multisine
from dvrk_gravity.ros.presence import namespace_of
from dvrk_gravity.ros.processes import PRIVATE
from dvrk_gravity.simulate import Plant, PlantFile, SimulatedArm, record_motion

MODEL = "model.yaml"
"""In the demonstration's folder: the plant's own terms."""

# Poses and push are all chosen so that there is something to see. Poses lie in this part of the
# joints' ranges, about their middle, where the weight takes this part of the effort limits at most;
# of so many that are drawn, so many are used.
RANGE, BEARABLE, DRAWN, POSES = 0.5, 0.6, 300, 3
# The hand moves so many joints, from the base on, with this acceleration beyond their dry friction,
# rad/s^2 (Arm.scale).
PUSHED, ACCELERATION = 3, 0.4
# The load takes this part of a joint's effort limit at most, along the motion.
LOADED = 0.2
# Seed and s of a motion that a monitor's model is identified from; seed and number of poses between
# which the arm moves while it is watched.
LEARNED, LEARNING = 1, 30.0
MONITOR_MOTION_SEED, BETWEEN = 5, 40


@dataclass(frozen=True, eq=False)
class Stage:
    """The arm, plant, model, poses and push of a demonstration.

    Attributes:
        arm: The arm.
        plant: Name or file of the plant; ``""``: the arm's.
        model: Parameter file of the compensator.
        own_model: Whether it has the plant's own terms.
        poses: (k, n) positions at which the arm is released, rad or m.
        push: (n,) efforts of the hand, N·m or N.
        monitor_poses: (k, n) positions between which it moves while a load is fastened, rad or m.
        namespace: Of its topics, one that no arm has: a replayed bag commands no arm either.
    """

    arm: Arm
    plant: str
    model: Path
    own_model: bool
    poses: Array
    push: Array
    monitor_poses: Array
    namespace: str

    @classmethod
    def of(cls, arm: Arm, plant: str, model: Path | None, folder: Path) -> Stage:
        """Prepare an arm's demonstration with a plant's name or file; ``""``: the arm's.

        Without a model it is the package's for the arm, or else the plant's own terms, written to
        ``folder``.

        Raises:
            ConfigError: A model or a plant of another arm, or an unusable one.
        """
        truth = PlantFile.load(plant) if plant else PlantFile.of(arm)
        _same_joints("plant", plant, truth.model.arm, arm)
        if model is None:
            model = _shipped_model(arm)
        own = model is None
        if model is None:
            model = folder / MODEL
            truth.model.save(model, f"The terms of the simulated {arm.name}.")
        loaded = TorqueModel.load(model)
        _same_joints("model", str(model), loaded.arm, arm)
        try:  # as the compensator will
            Settings.from_parameters(loaded.parameters())
        except ConfigError as error:
            raise error if error.source else error.in_file(model) from None
        poses, push = _choose_poses_and_push(truth.plant())
        monitor_poses = Multisine.draw(arm, MONITOR_MOTION_SEED).at(
            np.linspace(0.0, 0.9 * BETWEEN, BETWEEN)
        )[0]
        return cls(
            arm, plant, model, own, poses, push, monitor_poses, f"{PRIVATE}{namespace_of(arm)}"
        )


def identify_demo_model(arm: str, plant: str, friction_scale: float, path: Path) -> Path:
    """Identify a model of a simulated arm, as a monitor needs one, and write it to a file.

    Args:
        arm: The arm's name or file.
        plant: Name or file of its plant; ``""``: the arm's.
        friction_scale: Factor on its friction.
        path: File to write.
    """
    of_arm = Arm.load(arm)
    truth = PlantFile.load(plant) if plant else PlantFile.of(of_arm)
    simulated = SimulatedArm(truth.plant(friction_scale), truth.sensors)
    motion = Multisine.draw(of_arm, LEARNED)
    fit = identify(record_motion(simulated, motion, LEARNING), of_arm)
    fit.model.save(path, f"Identified from {LEARNING:g} s of a simulated {of_arm.name}.")
    return path


def demo_load(arm: Arm, poses: Array) -> dict[str, float | str]:
    """Return mass, kg, and link of a load that is well below what an arm can carry.

    Args:
        arm: The arm.
        poses: (k, n) positions where it is carried, rad or m.
    """
    link = last_link(arm)
    unit = {"payload.mass": 1.0, "payload.link": link}
    torque = TorqueModel.from_parameters(unit, arm).torque(poses)
    part = float(np.max(np.abs(torque) / arm.effort_limit))
    return {"mass": float(f"{LOADED / part:.1g}"), "link": link}


def _choose_poses_and_push(plant: Plant) -> tuple[Array, Array]:
    """Return (k, n) poses far from one another, the first under much weight, and a (n,) push."""
    arm = plant.model.arm
    poses = mtm.defaults.DEMONSTRATED_POSES if mtm.is_mtm(arm) else _poses(plant)
    plant.reset(poses[0])
    pushed = np.arange(arm.n) < PUSHED
    acceleration = ACCELERATION * arm.scale * pushed
    truth, begin = plant.model.physical(), poses[0] + plant.model.joint_offset
    # At rest it is zero, at this speed whole.
    moving = truth.torque(begin, DRY_SPEED * arm.scale)
    friction = np.abs(moving - truth.torque(begin)) * pushed
    return poses, plant.mass_matrix() @ acceleration + friction


def _poses(plant: Plant) -> Array:
    arm = plant.model.arm
    lowest, highest = arm.range
    middle, half = 0.5 * (lowest + highest), 0.5 * (highest - lowest)
    parts = np.random.default_rng(0).uniform(-1.0, 1.0, (DRAWN, arm.n))
    drawn = middle + RANGE * half * parts
    weights = []
    for pose in drawn:
        plant.reset(pose)
        weights.append(np.abs(plant.smooth_torque()) / arm.effort_limit)
    largest = np.max(weights, axis=1)
    allowed = np.flatnonzero(largest <= BEARABLE)
    if not len(allowed):
        allowed = np.array([int(np.argmin(largest))])
    chosen = [int(allowed[np.argmax(largest[allowed])])]
    while len(chosen) < POSES:
        ways = np.linalg.norm(parts[:, None] - parts[chosen], axis=2).min(axis=1)
        chosen.append(int(allowed[np.argmax(ways[allowed])]))
    return drawn[chosen]


def _shipped_model(arm: Arm) -> Path | None:
    whole = () if arm.urdf else shipped("")  # a URDF's arm is its own, whatever its name
    named = [name for name in whole if name.partition("_")[0] == arm.name]
    return config_path(f"{named[0]}.yaml") if named else None


def _same_joints(what: str, given: str, found: Arm, arm: Arm) -> None:
    if found.joint_names != arm.joint_names:
        raise ConfigError(what, given, f"one with the joints of {arm.name}, not of {found.name}")
