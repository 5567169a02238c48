"""What an identification from trajectories solves for in a term."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.site import Kind, Site
from dvrk_gravity.errors import EffectError

PRIOR_FRACTION = 0.2
"""What one effect may plausibly take of a motor's largest torque, as a standard deviation."""


def effort_of_motor(arm: Arm, kind: Kind) -> Array:
    """Return (n,) the largest effort of each motor, there or at its own joint."""
    if kind is Kind.MOTOR:
        return arm.actuator_effort_limit
    ratio = np.abs(np.diag(arm.joint_to_actuator))
    return np.where(ratio > 0.0, ratio * arm.actuator_effort_limit, arm.effort_limit)


def unit_way(arm: Arm, kind: Kind) -> Array:
    """Return (n,) the way of each joint, or of its motor, that counts as much as a rad."""
    if kind is not Kind.MOTOR:
        return arm.scale
    ratio = np.abs(np.diag(arm.joint_to_actuator))
    return np.where(ratio > 0.0, ratio, 1.0) * arm.scale


@dataclass(frozen=True)
class Column:
    """One unknown of a fit.

    Attributes:
        effect: The effect's name.
        site: Where it acts.
        index: Number within that: power of the position, element of presliding, roll or pitch.
        scale: Prior standard deviation, in the unit of its coefficient.
        positive: Must not be negative.
        unit: Unit of its coefficient; ``""`` where parameters are combinations of several.
    """

    effect: str
    site: Site
    index: int
    scale: float
    positive: bool = False
    unit: str = ""

    def __post_init__(self) -> None:
        """Refuse a prior that is none.

        Raises:
            EffectError: ``scale`` is not positive and finite.
        """
        if not 0.0 < self.scale < np.inf:
            raise EffectError(self.effect, f"a column's scale is {self.scale}, expected above 0")

    @property
    def site_kind(self) -> str:
        """``joint`` or ``motor``; ``""`` for what acts at neither."""
        return self.site.kind.value if self.site.kind in (Kind.JOINT, Kind.MOTOR) else ""

    @property
    def joint(self) -> int:
        """Index of the joint or motor, -1 for what acts at neither."""
        return self.site.index if self.site_kind else -1

    @property
    def key(self) -> tuple[str, Site, int]:
        """What tells it from other columns of the same effects."""
        return self.effect, self.site, self.index


@dataclass(frozen=True)
class ModelChange:
    """A change of the model that is tried.

    Attributes:
        add: Columns that come in.
        remove: Columns that go.
        text: What it is.
    """

    add: tuple[int, ...]
    remove: tuple[int, ...]
    text: str


class ColumnTable(Protocol):
    """All columns that a fit may use; see ``dvrk_gravity.identification.columns``."""

    @property
    def arm(self) -> Arm:
        """The arm."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """What they are, in order."""

    def select(self, **wanted: object) -> list[int]:
        """Return the indices of the columns whose fields have the wanted values."""


def site_columns(
    effect: str, kind: Kind, scale: Array, index: int, positive: bool, unit: str
) -> Iterator[Column]:
    """Yield the columns of an effect that acts at every joint, or at every motor.

    Args:
        effect: Its name.
        kind: Where it acts.
        scale: (n,) prior standard deviations.
        index: Of all of them.
        positive: Coefficients must not be negative.
        unit: Of the coefficients.
    """
    for joint, size in enumerate(scale.tolist()):
        yield Column(effect, Site(kind, joint), index, size, positive, unit)
