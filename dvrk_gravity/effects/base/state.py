"""Where an arm is and how it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ShapeError
from dvrk_gravity.validation import floats


@dataclass(frozen=True, eq=False)
class State:
    """Where the arm is and how it moves, in joint space.

    Attributes:
        q: (…, n) positions, rad.
        qd: (…, n) velocities, rad/s; ``None`` if unknown: friction is then left out.
        qdd: (…, n) accelerations, rad/s^2; ``None`` counts as zero.
        direction: (…, n) +1/-1, the way in which a static pose was approached;
            where given, it replaces the sign of the velocity in dry friction.

    Samples of an (N, n) state that has velocities follow each other in time; it matters only
    to friction that remembers where the motion last reversed.
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
        """Check the shapes and build a state.

        Args:
            q: (…, n) positions.
            qd: Velocities, if they are known.
            qdd: Accelerations, if they are known.
            direction: Ways of approach, if they are known.
            joints: The arm's number n of joints; ``None``: that of ``q``.

        Raises:
            ShapeError: ``q`` is not (…, n), or another array's shape differs from it.
            ArgumentError: What holds no numbers.
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
