"""What an effect sees of an arm: a state, a recorded motion, and a residual of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ShapeError
from dvrk_gravity.validation import floats


@dataclass(frozen=True, eq=False)
class State:
    """Positions of the arm and their derivatives, in joint space.

    Attributes:
        q: (…, n) positions, rad.
        qd: (…, n) velocities, rad/s; ``None``: unknown, and friction is left out.
        qdd: (…, n) accelerations, rad/s^2; ``None``: zero.
        direction: (…, n) +1/-1, the direction in which a static pose was approached; dry friction
            then has its sign and not the velocity's.

    Samples of an (N, n) state with velocities are in order of time, which matters only to friction
    that depends on where the motion last reversed.
    """

    q: Array
    qd: Array | None = None
    qdd: Array | None = None
    direction: Array | None = None

    @classmethod
    def of(
        cls,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        qdd: ArrayLike | None = None,
        direction: ArrayLike | None = None,
        joints: int | None = None,
    ) -> State:
        """Check the shapes, (…, n) each, and build a state.

        ``joints`` is the arm's n; by default that of ``q``.

        Raises:
            ShapeError: ``q`` is not (…, n), or another array's shape differs from it.
            ArgumentError: An array has no numbers.
        """
        position = floats("q", q)
        if position.ndim == 0 or joints not in (None, position.shape[-1]):
            raise ShapeError("q", position.shape, f"(…, {'n' if joints is None else joints})")
        rest: dict[str, Array | None] = {}
        for name, given in (("qd", qd), ("qdd", qdd), ("direction", direction)):
            array = None if given is None else floats(name, given)
            if array is not None and array.shape != position.shape:
                raise ShapeError(name, array.shape, f"{position.shape}, as q")
            rest[name] = array
        return cls(position, **rest)

    def rows(self, which: slice | NDArray[np.int64]) -> State:
        """Return some of the samples of an (N, n) state."""
        rest = (self.qd, self.qdd, self.direction)
        return State(self.q[which], *(None if array is None else array[which] for array in rest))


class Motion(Protocol):
    """N samples of an arm with the model under test; see ``dvrk_gravity.diagnosis.motion``.

    Attributes:
        model: The model under test, a :class:`dvrk_gravity.model.TorqueModel`.
        arm: The arm.
        q: (N, n) measured positions.
        qd: (N, n) velocities.
        qdd: (N, n) accelerations.
        effort: (N, n) measured torques.
        expected: (N, n) torque of a baseline recording of the same motion, or else of the model.
        measured_twice: Whether it is that of a recording.
        direction: (N, n) +1/-1, the directions in which static poses were approached, if known.
        time: (N,) s.
        thinned: One of so many recorded samples was kept.
        parts: Contiguous parts with uniform sampling.
        static: Whether these are static poses.
        present: (n,) which joints were recorded.
        step: (n,) resolution of the positions.
        true_q: (N, n) positions corrected by the model's encoder zeros.
        modelled: (N, n) torque of the model.
        friction: (N, n) torque of the model's friction.
        applied_torque: (N, n) torque that acts: the model's, or the mean of both recordings.
        slope: (N, n, n) derivative of the modelled torque [:, joint, by position of].
        travel: (n,) middle of each joint's range in the motion, and half its width.
        moves: (n,) which joints move enough to identify anything.
        gravity: (3,) the model's gravity in the base frame, m/s^2.
        payload_at: Body that is known to carry a load, and (3,) its place in the link frame, m.
        inertial: Link parameters whose inertial torques the motion separates.
    """

    @property
    def model(self) -> Any: ...
    @property
    def arm(self) -> Arm: ...
    @property
    def q(self) -> Array: ...
    @property
    def qd(self) -> Array: ...
    @property
    def qdd(self) -> Array: ...
    @property
    def effort(self) -> Array: ...
    @property
    def expected(self) -> Array: ...
    @property
    def measured_twice(self) -> bool: ...
    @property
    def direction(self) -> Array | None: ...
    @property
    def time(self) -> Array: ...
    @property
    def thinned(self) -> int: ...
    @property
    def parts(self) -> tuple[slice, ...]: ...
    @property
    def static(self) -> bool: ...
    @property
    def present(self) -> NDArray[np.bool_]: ...
    @property
    def step(self) -> Array: ...
    @property
    def true_q(self) -> Array: ...
    @property
    def modelled(self) -> Array: ...
    @property
    def friction(self) -> Array: ...
    @property
    def applied_torque(self) -> Array: ...
    @property
    def slope(self) -> Array: ...
    @property
    def travel(self) -> tuple[Array, Array]: ...
    @property
    def moves(self) -> NDArray[np.bool_]: ...
    @property
    def gravity(self) -> Array: ...
    @property
    def payload_at(self) -> tuple[int, Array] | None: ...
    @property
    def inertial(self) -> NDArray[np.int_]: ...

    def state_at(self, q: Array) -> State:
        """Return the states with other (N, n) positions in the same motion."""

    def torque_at(self, q: Array, model: Any = None) -> Array:
        """Return (N, n) torques of a model at other positions in the same motion."""

    def slowest(self, row: Array) -> float:
        """Return the speed below which the direction of a row of the joints is uncertain."""

    def sign(self, row: Array, transition: float | None = None) -> Array:
        """Return (N,) direction of motion of a row of the joints."""

    def link_torque(self, link: int, directions: Array) -> Array:
        """Return (N, n, k) torques of (10, k) changes of a body's inertial parameters."""

    def inertial_torque(self) -> Array:
        """Return (N, n, k) columns of :attr:`inertial`, without gravity."""


class Filtered(Protocol):
    """A motion and torques as they are compared: filtered and decimated to T samples.

    Attributes:
        motion: The :class:`Motion`.
        time: (T,) s.
    """

    @property
    def motion(self) -> Any: ...
    @property
    def time(self) -> Array: ...

    def reduce(self, columns: Array) -> Array:
        """Return (T, …) filtered and decimated from (N, …) values."""


@dataclass(frozen=True, eq=False)
class Residual:
    """What the effects chosen so far leave unexplained.

    Attributes:
        data: The filtered data.
        torque: (T, n) residual.
        weight: (T, n) weights; zero at samples held out of the choice.
        allowed: (T,) samples that the choice may use.
    """

    data: Filtered
    torque: Array
    weight: Array
    allowed: NDArray[np.bool_]
