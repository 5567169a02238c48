"""What an arm's readings make of the truth.

A wrong reading changes no torque. A model that knows of one says so in its file, as parameters
``reading.*``; recordings are put right by them before anything is compared
(``observation.without_known_errors``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array


@dataclass(frozen=True, eq=False)
class ReadingErrors:
    """Known errors of an arm's readings, in joint space.

    With true positions q, efforts tau and times t, what is read is ``position (q + joint_offset)``,
    ``effort tau(t - delay)`` up to ``limit``, and ``clock t``. Measured velocities are ``velocity``
    times the derivative of the position that is read.

    Attributes:
        position: (n, n) positions -> read ones.
        effort: (n, n) applied efforts -> read ones.
        velocity: (n,) read velocity over the derivative of the read position.
        limit: (n,) largest effort that is read, N·m or N; infinite: none is known.
        delay: By which efforts are late, s.
        clock: Recorded over true time.
        coordinates: Of recordings that do not state theirs; ``""``: not known.
    """

    position: Array
    effort: Array
    velocity: Array
    limit: Array
    delay: float = 0.0
    clock: float = 1.0
    coordinates: str = ""

    @classmethod
    def none(cls, n: int) -> ReadingErrors:
        """Return right readings of n joints."""
        return cls(np.eye(n), np.eye(n), np.ones(n), np.full(n, np.inf))

    @property
    def any(self) -> bool:
        """Whether anything is read wrongly."""
        eye = np.eye(len(self.velocity))
        return not (
            np.array_equal(self.position, eye)
            and np.array_equal(self.effort, eye)
            and (self.velocity == 1.0).all()
            and np.isinf(self.limit).all()
            and (self.delay, self.clock, self.coordinates) == (0.0, 1.0, "")
        )

    def at(self, joints: Sequence[int]) -> ReadingErrors:
        """Return the errors of some joints' readings, the others left out."""
        kept = list(joints)
        square = np.ix_(kept, kept)
        return replace(
            self,
            position=self.position[square],
            effort=self.effort[square],
            velocity=self.velocity[kept],
            limit=self.limit[kept],
        )

    def after(self, inner: ReadingErrors) -> ReadingErrors:
        """Return the errors of readings that make these of what others have made of the truth."""
        limit = self.limit.copy()
        for joint in np.flatnonzero(np.isfinite(inner.limit)).tolist():
            read = int(np.argmax(np.abs(self.effort[:, joint])))
            limit[read] = min(limit[read], abs(self.effort[read, joint]) * inner.limit[joint])
        return ReadingErrors(
            self.position @ inner.position,
            self.effort @ inner.effort,
            self.velocity * inner.velocity,
            limit,
            self.delay / inner.clock + inner.delay,  # delays are in true time
            self.clock * inner.clock,
            self.coordinates or inner.coordinates,
        )

    def true_limit(self) -> Array:
        """Return (n,) the same limit as the applied efforts have it, each at its main joint."""
        limit = np.full(len(self.limit), np.inf)
        for read in np.flatnonzero(np.isfinite(self.limit)).tolist():
            joint = int(np.argmax(np.abs(self.effort[read])))
            limit[joint] = min(limit[joint], self.limit[read] / abs(self.effort[read, joint]))
        return limit
