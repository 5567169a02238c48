"""What the last start was accepted with, and how far changed parameters are from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.settings import CHANGE, Settings
from dvrk_gravity.compensate.start import SETTINGS as START
from dvrk_gravity.compensate.start import Start


class Deviation(NamedTuple):
    """Torque that no start has compared with what holds the arm.

    Attributes:
        reason: Which, in words for a person.
        measurable: A new start can compare it: it acts on an arm at rest.
    """

    reason: str
    measurable: bool


class Accepted:
    """The parameters of the last accepted start, beside those that are in force.

    A start compares the model with what holds the arm. What changes afterwards is compared with
    what it accepted, wherever the arm is by then.

    Attributes:
        settings: Those that the last start accepted.
    """

    def __init__(self, settings: Settings) -> None:
        """Take the settings that a start has accepted."""
        self.settings = settings

    def tolerance(self, settings: Settings) -> float:
        """Return the part of effort limits that may differ; one that is raised waits for a person.

        Args:
            settings: Those in force.
        """
        return min(self.settings.start_tolerance, settings.start_tolerance)

    def origin(
        self, start: Start, settings: Settings, position: Array, asked: bool
    ) -> tuple[Array, str]:
        """Return what a start begins with, as :meth:`Start.origin`.

        Args:
            start: What was measured.
            settings: What is to be commanded.
            position: (n,) where the arm is, rad or m.
            asked: A person has asked for this start, with its parameters as they are.

        Raises:
            StartRefusedError: The arm must not be commanded as things are.
        """
        unconfirmed = None if asked else self.deviation(settings, position)
        if unconfirmed is None:
            return start.origin(settings, settings.start_tolerance)
        return start.confirmed(
            settings, self.settings, self.tolerance(settings), unconfirmed.measurable
        )

    @np.errstate(over="ignore", invalid="ignore")
    def deviation(self, settings: Settings, position: Array) -> Deviation | None:
        """Return what settings ask for at (n,) positions beyond what was accepted, ``None``: none.

        Compared are the torque at rest, and the friction that is compensated at a speed at which
        it is whole.
        """
        before = self.settings
        if settings.asks_as(before):
            return None
        tolerance = self.tolerance(settings)
        worst, held, asked = self._furthest(before.at_rest(position), settings.at_rest(position))
        joint = settings.model.arm.joints[worst]
        if not abs(asked - held) <= tolerance * joint.effort_limit:
            return Deviation(
                f"changed parameters ask {joint.name} for {asked:.3g} {joint.effort_unit} where "
                f"those of the last start ask for {held:.3g}, more than start_tolerance apart",
                measurable=True,
            )
        for way in (1.0, -1.0):
            speed = way * START.dry * settings.model.arm.scale
            old, new = (way * each.parts(position, speed)[1] for each in (before, settings))
            # Less of it leaves the arm with more friction, which moves nothing.
            worst, less, more = self._furthest(old, np.maximum(new, old))
            joint = settings.model.arm.joints[worst]
            if not more - less <= tolerance * joint.effort_limit:
                return Deviation(
                    f"changed parameters compensate {more:.3g} {joint.effort_unit} of friction at "
                    f"{joint.name} where those of the last start compensate {less:.3g}, more than "
                    "start_tolerance apart, and at rest nothing can be measured of it",
                    measurable=False,
                )
        return None

    def change(self, settings: Settings, position: Array) -> str:
        """Return in words what settings change of what holds the arm at (n,) positions."""
        before, after = self.settings.at_rest(position), settings.at_rest(position)
        worst, old, new = self._furthest(before, after)
        joint = settings.model.arm.joints[worst]
        if not abs(new - old) > CHANGE.considerable * joint.effort_limit:
            return ""
        return (
            f"{joint.name} is held with {new:.3g} {joint.effort_unit} instead of {old:.3g} since "
            "parameters have been changed"
        )

    def _furthest(self, old: Array, new: Array) -> tuple[int, float, float]:
        """Return the joint at which (n,) torques differ most, by their limits, and both there."""
        worst = int(np.argmax(np.abs(new - old) / self.settings.model.arm.effort_limit))
        return worst, float(old[worst]), float(new[worst])
