"""What a calibration does to an arm: move it, and release it under compensation."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting import Driver, SimulatedDriver
from dvrk_gravity.compensate import simulate_release
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import PlantFile

_FAR = 100.0  # rad or m, of an arm that has run away


class Rig(Protocol):
    """An arm that is moved and compensated."""

    @property
    def simulated(self) -> str:
        """What is simulated, in words; ``""``: nothing, it is an arm."""

    @property
    def friction(self) -> float:
        """Part of its friction that it has while it is released."""

    @property
    def resumes(self) -> bool:
        """Whether a motion that was stopped goes on where it was; else it is made again."""

    def driver(self) -> AbstractContextManager[Driver]:
        """Return what moves it, once entered."""

    def release(self, model: Path, pose: Array, seconds: float) -> Array:
        """Release it where it is held, compensated, and hold it again.

        Args:
            model: The compensator's file.
            pose: (n,) where it is, rad or m.
            seconds: For so long, or until it has moved away.

        Returns:
            (n,) largest way of each joint, rad or m.

        Raises:
            MotionError: It could not be released.
        """


class SimulatedRig:
    """A simulated arm in this process, faster than real time.

    Attributes:
        simulated: In words.
        friction: Part of its friction that it has while it is released.
        resumes: Never: it takes no time, and the motion is the same again, to the last bit.
    """

    resumes = False

    def __init__(self, plant: PlantFile, seed: int, friction: float) -> None:
        """Build it.

        Args:
            plant: The hidden truth.
            seed: Of the sensors' noise.
            friction: Part of its friction that it has while it is released.
        """
        self._plant, self._seed, self.friction = plant, seed, friction
        self._at: Array | None = None
        self.simulated = plant.source or "a plant"

    def driver(self) -> SimulatedDriver:
        """Return what moves it from where it was released last, or else from where it starts."""
        return SimulatedDriver(self._plant, seed=self._seed, at=self._at)

    def release(self, model: Path, pose: Array, seconds: float) -> Array:
        """Release it at a pose: :meth:`Rig.release`."""
        plant = self._plant.plant(self.friction)
        self._at = pose - self._plant.model.joint_offset
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                way = simulate_release(plant, TorqueModel.load(model), pose, seconds, self.friction)
        except ConfigError as error:
            if error.field != "effort":  # not finite: the arm has run away
                raise
            return np.full(len(pose), _FAR)
        return np.nan_to_num(np.abs(way).max(axis=0), nan=_FAR, posinf=_FAR)
