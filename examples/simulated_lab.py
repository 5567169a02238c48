"""The arms of these examples: simulated, so that they need no robot and no data.

With an arm of your own: ``Recording.load("my_bag", arm="mtmr")`` in place of ``record``.
"""

from __future__ import annotations

from dataclasses import replace

from dvrk_gravity import Arm, Recording, TorqueModel
from dvrk_gravity.planning import Multisine
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion

ARM = Arm.load("mtmr")
RATE = 100.0  # Hz
STEP = 2.5e-3  # s


def record(seed: int, seconds: float = 20.0, arm: Arm = ARM, **changed: list[float]) -> Recording:
    """Record a simulated arm along an exciting motion.

    Args:
        seed: Of the motion and of the sensors' noise.
        seconds: Length.
        arm: The arm; of a URDF the plant is what its file states.
        changed: Parameters of the simulated arm that differ from what it was calibrated with, by
            their name in a model file with ``__`` for the dot: ``viscous_friction__joint``.
    """
    plant = PlantFile.of(arm)
    values = plant.model.parameters() | {
        name.replace("__", "."): value for name, value in changed.items()
    }
    plant = replace(plant, model=TorqueModel.from_parameters(values))
    simulated = SimulatedArm(plant.plant(), plant.sensors, seed, dt=STEP)
    return record_motion(simulated, Multisine.draw(arm, seed), seconds, RATE)
