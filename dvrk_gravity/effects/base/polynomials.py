"""Torque that is a polynomial of each joint's own position, and differs with the direction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Range


@dataclass(frozen=True, eq=False)
class Blend:
    """How torque goes from the mean of two directions to that of one as the speed rises.

    Attributes:
        dead_band: (n,) speed below which the two are averaged, rad/s.
        saturation_velocity: (n,) speed from which on the blend is full, rad/s.
        ratio: (n,) part of the difference that is applied at full blend, 0 to 1.
        shape: How the blend rises from the dead band on: ``linear`` or ``sine``.
    """

    dead_band: Array
    saturation_velocity: Array
    ratio: Array
    shape: str = "linear"


@dataclass(frozen=True, eq=False)
class JointPolynomials:
    """tau_j = k0 + k1 q_j + k2 q_j^2 + …, one set of coefficients for each direction of motion.

    Attributes:
        positive: (degree + 1, n) coefficients while moving up, lowest power first, N·m/rad^k.
        negative: (degree + 1, n) coefficients while moving down.
        valid: Range of positions on which they were fitted; outside, q_j is held at its edge.
        blend: How the velocity chooses between them; ``None``: both are the same.
    """

    positive: Array
    negative: Array
    valid: Range
    blend: Blend | None = None

    @cached_property
    def mean(self) -> Array:
        """(degree + 1, n) coefficients at rest."""
        return 0.5 * (self.positive + self.negative)

    @cached_property
    def half_difference(self) -> Array:
        """(degree + 1, n) coefficients of what is added moving up, and taken away moving down."""
        return 0.5 * (self.positive - self.negative)
