"""Record an exciting motion of a simulated arm, faster than real time."""

from __future__ import annotations

from pathlib import Path

from dvrk_gravity import Recording
from dvrk_gravity.planning import PlanLimits, covering_motion
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion


def record(plant: PlantFile | str | Path, seed: int, duration: float = 40.0) -> Recording:
    """Return a recording at 200 Hz.

    Args:
        plant: What is simulated: ``mtmr_28002``, ``psm``, ``ecm``, a .urdf, or a plant.
        seed: Each is another motion.
        duration: s.
    """
    file = plant if isinstance(plant, PlantFile) else PlantFile.load(plant)
    arm = SimulatedArm(file.plant(), file.sensors, seed, builtin_compensation=False)
    motion = covering_motion(PlanLimits.of(file.model.arm), duration, seed)
    return record_motion(arm, motion, duration)
