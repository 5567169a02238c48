"""What the data show to those who suppose an effect: the motion, and what is left unexplained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array


class Motion(Protocol):
    """N samples of an arm with the model on trial; see ``dvrk_gravity.diagnosis.data.motion``."""

    @property
    def model(self) -> Any:
        """The model on trial, a :class:`dvrk_gravity.model.torque_model.TorqueModel`."""

    @property
    def arm(self) -> Arm:
        """The arm."""

    @property
    def q(self) -> Array:
        """(N, n) measured positions."""

    @property
    def qd(self) -> Array:
        """(N, n) velocities."""

    @property
    def qdd(self) -> Array:
        """(N, n) accelerations."""

    @property
    def effort(self) -> Array:
        """(N, n) measured torques."""

    @property
    def reference(self) -> Array | None:
        """(N, n) torques measured in the same motion when all was well; ``None``: there is none."""

    @property
    def direction(self) -> Array | None:
        """(N, n) +1/-1 of static poses whose approach is known."""

    @property
    def time(self) -> Array:
        """(N,) s."""

    @property
    def thinned(self) -> int:
        """Of so many samples that were recorded one was kept."""

    @property
    def parts(self) -> tuple[slice, ...]:
        """Contiguous parts, uniformly sampled."""

    @property
    def static(self) -> bool:
        """Whether these are static poses."""

    @property
    def present(self) -> NDArray[np.bool_]:
        """(n,) which joints were recorded."""

    @property
    def step(self) -> Array:
        """(n,) steps of the positions."""

    @property
    def true_q(self) -> Array:
        """(N, n) positions as the model has them."""

    @property
    def modelled(self) -> Array:
        """(N, n) torque of the model."""

    @property
    def friction(self) -> Array:
        """(N, n) torque of the model's friction."""

    @property
    def acting(self) -> Array:
        """(N, n) torque that acts: the model's, or what was measured with and without a cause."""

    @property
    def slope(self) -> Array:
        """(N, n, n) change of the modelled torque [:, joint, by position of]."""

    @property
    def travel(self) -> tuple[Array, Array]:
        """(n,) middle and half of the way of each joint."""

    @property
    def moves(self) -> NDArray[np.bool_]:
        """(n,) which joints move enough to tell anything by."""

    @property
    def gravity(self) -> Array:
        """(3,) gravity in the base as the model has it, m/s^2."""

    @property
    def inertial(self) -> NDArray[np.int_]:
        """Link parameters whose inertial torques the motion tells apart."""

    def torque_at(self, q: Array, model: Any = None) -> Array:
        """Return (N, n) torques of a model at other positions in the same motion."""

    def slowest(self, row: Array) -> float:
        """Return the speed of a row of the joints below which its direction is uncertain."""

    def sign(self, row: Array, transition: float | None = None) -> Array:
        """Return (N,) direction of motion of a row of the joints."""

    def link_torque(self, link: int, directions: Array) -> Array:
        """Return (N, n, k) torques of (10, k) changes of a body's inertial parameters."""

    def inertial_torque(self, chosen: NDArray[np.int_]) -> Array:
        """Return (N, n, k) columns of some of the links' inertial parameters, gravity off."""


class Filtered(Protocol):
    """A motion and torques as they are compared: filtered and thinned to T samples."""

    @property
    def motion(self) -> Any:
        """The :class:`Motion` that it comes from."""

    @property
    def time(self) -> Array:
        """(T,) s."""

    def reduce(self, columns: Array) -> Array:
        """Return (T, …) filtered and thinned from (N, …) values."""


@dataclass(frozen=True, eq=False)
class Residual:
    """What the effects chosen so far leave unexplained, for those that are found in it.

    Attributes:
        data: The filtered data.
        torque: (T, n) residual.
        weight: (T, n) weights; zero where the choice must not look.
        allowed: (T,) samples that the choice may look at.
    """

    data: Filtered
    torque: Array
    weight: Array
    allowed: NDArray[np.bool_]
