"""Whether an arm's efforts are those that its motion takes: a hand, or what is in its way."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting.driver import States
from dvrk_gravity.compensate import DRY_SPEED, LAG, MotionError, Sample
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import effort_band


@dataclass(frozen=True)
class EffortSettings:
    """When an effort counts as another one than the motion's.

    Attributes:
        every: The model is asked this often, s: at 0.6 Hz torques move by 4 % from one to the next.
        window: What it said for so long back counts, s: the arm lags, by LAG at most, and its
            effort is measured some 10 ms late.
        margin: Part of the motor's greatest effort that it may be outside of the band. Chosen.
        lasts: It has to be outside for so long, s. Chosen: a servo's answer to a step ends
            within it, and an arm at 60 deg/s goes 6 deg.
    """

    every: float = 0.02
    window: float = LAG + 0.03
    margin: float = 0.1
    lasts: float = 0.1


class EffortWatch:
    """Stops an arm whose efforts are beyond its model's band, or its limits, for a while.

    The band is that of what was commanded within the arm's lag, with any friction that a joint so
    slow may have: at rest it is anything between both directions'. Without a model only the limits
    are watched.
    """

    def __init__(
        self,
        arm: Arm,
        greatest: Array,
        model: TorqueModel | None,
        settings: EffortSettings | None = None,
    ) -> None:
        """Watch nothing yet.

        Args:
            arm: The arm.
            greatest: (n,) limits of the motors' efforts, N·m or N.
            model: The arm's.
            settings: When it stops.
        """
        self._arm, self._greatest, self._model = arm, greatest, model
        self._settings = settings or EffortSettings()
        self._margin = self._settings.margin * arm.actuator_effort_limit
        self._slow = DRY_SPEED * arm.scale * np.array([[1.0], [-1.0]])
        self._bands: deque[tuple[float, Array, Array]] = deque()  # time, lowest, highest
        self._outside: float | None = None  # since when

    def __call__(self, sample: Sample, states: States) -> None:
        """Look at a measurement, and at the set point of that moment.

        Raises:
            MotionError: Naming the motor, its effort, and what was expected.
        """
        if sample.effort is None:
            return
        now = 1e-9 * sample.stamp
        effort = self._arm.actuator_effort(sample.effort)
        lowest, highest = self._expected(now, states)
        beyond = np.maximum(lowest - effort, effort - highest) - self._margin
        worst = int(np.argmax(beyond / self._margin))
        if not beyond[worst] > 0.0:
            self._outside = None
            return
        since = now if self._outside is None else self._outside
        self._outside = since
        if now - since >= self._settings.lasts:
            joint = self._arm.joints[worst]
            unit = self._arm.effort_units[worst]
            low, high = lowest[worst] - self._margin[worst], highest[worst] + self._margin[worst]
            of = "its model" if self._model is not None else "its limits"
            raise MotionError(
                f"{joint.name}'s motor has {effort[worst]:.3g} {unit} for {now - since:.1f} s, "
                f"expected {low:.3g} to {high:.3g} by {of}: is a hand on the arm, or something in "
                "its way?"
            )

    def _expected(self, now: float, states: States) -> tuple[Array, Array]:
        """Return (n,) lowest and (n,) highest efforts of the motors."""
        if self._model is None:
            return -self._greatest, self._greatest
        bands, of = self._bands, self._settings
        if not bands or now - bands[-1][0] >= of.every:
            q, qd, qdd = states
            both = State(np.stack([q, q]), qd + self._slow, np.stack([qdd, qdd]))
            torque, half = effort_band(self._model, both)
            bands.append((now, (torque - half).min(axis=0), (torque + half).max(axis=0)))
        while len(bands) > 1 and now - bands[0][0] > of.window:
            bands.popleft()
        lowest = np.min([low for _, low, _ in bands], axis=0)
        highest = np.max([high for _, _, high in bands], axis=0)
        return np.maximum(lowest, -self._greatest), np.minimum(highest, self._greatest)
