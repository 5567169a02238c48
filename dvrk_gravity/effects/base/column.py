"""The columns of a fit: where an unknown acts, how large it plausibly is; moves of a search."""

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
"""Prior standard deviation of one effect's torque, as a fraction of a motor's largest. Chosen."""
MISPLACED = 0.1
"""That of an encoder offset or the base's tilt, rad (10 mm where a joint slides).

Chosen, about 6 deg: data overrule it.
"""


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
        alternative: A fit takes one of those of its effect at its site: their settings differ.
    """

    effect: str
    site: Site
    index: int
    scale: float
    positive: bool = False
    unit: str = ""
    alternative: bool = False

    def __post_init__(self) -> None:
        """Check the prior.

        Raises:
            EffectError: ``scale`` is not positive and finite.
        """
        if not 0.0 < self.scale < np.inf:
            raise EffectError(self.effect, f"a column's scale is {self.scale}, expected above 0")

    @property
    def joint(self) -> int:
        """Index of the joint or motor, -1 for what acts at neither."""
        return self.site.index if self.site.kind in (Kind.JOINT, Kind.MOTOR) else -1

    @property
    def family(self) -> tuple[str, Site] | None:
        """What a fit takes one of; ``None``: it is no alternative."""
        return (self.effect, self.site) if self.alternative else None

    @property
    def key(self) -> tuple[str, Site, int]:
        """Its identity, whatever its prior."""
        return self.effect, self.site, self.index


@dataclass(frozen=True)
class SearchMove:
    """A step of a search: columns to add and to remove, and its name."""

    add: tuple[int, ...]
    remove: tuple[int, ...]
    text: str


class ColumnTable(Protocol):
    """All columns that a fit may use; see ``dvrk_gravity.identification.columns``."""

    @property
    def arm(self) -> Arm: ...
    @property
    def columns(self) -> tuple[Column, ...]: ...

    def select(self, effect: str, site: Site | None = None, index: int | None = None) -> list[int]:
        """Return the indices of an effect's columns, at one site or of one number if given."""


def site_columns(
    effect: str, kind: Kind, scale: Array, index: int, positive: bool, unit: str
) -> Iterator[Column]:
    """Yield the columns of an effect at every joint or motor, with (n,) prior deviations."""
    for joint, size in enumerate(scale.tolist()):
        yield Column(effect, Site(kind, joint), index, size, positive, unit)
