"""Contact with the environment: an elastic wall at a position, or a push for a while."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import (
    Values,
    as_array,
    as_value,
    joint_arrays,
    position_offset,
)
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.meaning import Estimate, Meaning, Words, meanings
from dvrk_gravity.effects.base.motion import Motion, Residual, State
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.effects.base.term import Term
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

_BIN = 0.25  # s
_SHORTEST, _LONGEST = 0.75, 0.5  # s, and part of the recording
_LONGEST_GAP = 10.0  # s; twice the longest block that is held out of ten minutes
_WINDOWS = 200  # about as many differ
_PERCENTILES = (55.0, 62.0, 69.0, 76.0, 83.0, 90.0)  # of the position, where walls are tried
_WALL_REACH = 0.3  # rad, of the search for where a wall begins


@dataclass(frozen=True, eq=False)
class Contact(Term):
    """tau = stiffness (q - position) beyond a position, zero before it.

    A wall pushes back with a positive stiffness; the compensator does not push against it.

    Attributes:
        above: (n,) N·m/rad of the wall that begins above ``above_position``.
        above_position: (n,) rad.
        below: (n,) N·m/rad of the wall that begins below ``below_position``.
        below_position: (n,) rad.
    """

    NAME = "contact"
    REMEDY = "keep hands, cables and drapes off the arm while it is recorded"
    NOT_FITTED = "`diagnose` finds it and extends the model"
    MEANINGS = meanings(
        # What the actuators apply is against a push.
        torque=Meaning(
            "N·m", 0.0, ("in the negative direction", "in the positive direction"), "pushes"
        ),
        stiffness=Meaning("N·m/rad", 0.0, ("back", "onwards"), "pushes"),
        start=Meaning("s"),
        end=Meaning("s"),
        position=Meaning("rad"),
    )
    COMPENSATED = False

    above: Array
    above_position: Array
    below: Array
    below_position: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        declared = (
            ("above", "N·m/rad", "stiffness of a wall above a position"),
            ("above_position", "rad", "where it begins"),
            ("below", "N·m/rad", "stiffness of a wall below a position"),
            ("below_position", "rad", "where it begins"),
        )
        return joint_arrays(arm, cls.NAME, declared)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Contact | None:
        n = arm.n
        arrays: list[Array] = []
        for side in ("above", "below"):
            stiffness = as_array(values.get(f"{cls.NAME}.{side}"), n, 0.0)
            position = values.get(f"{cls.NAME}.{side}_position")
            if stiffness.any() and not position:
                joint = arm.joint_names[int(np.argmax(stiffness != 0.0))]
                raise ConfigError(f"{cls.NAME}.{side}_position of {joint}", None, "a position")
            arrays += [stiffness, as_array(position, n, 0.0)]
        term = cls(*arrays)
        return term if term.above.any() or term.below.any() else None

    def parameters(self) -> dict[str, Value]:
        used = [side for side in ("above", "below") if getattr(self, side).any()]
        names = [name for side in used for name in (side, f"{side}_position")]
        return {f"{self.NAME}.{name}": as_value(getattr(self, name)) for name in names}

    @classmethod
    def search(cls, basis: Any, residual: Residual) -> Iterator[Hypothesis]:
        """Yield walls all over each joint's way, and when each joint is pushed most."""
        motion = residual.data.motion
        for joint in np.flatnonzero(motion.moves).tolist():
            for percentile in _PERCENTILES:
                for side, edge in ((1.0, percentile), (-1.0, 100.0 - percentile)):
                    position = float(np.percentile(motion.q[:, joint], edge))
                    yield WallHypothesis(
                        arm=motion.arm, site=Site.joint(joint),
                        form="above a position" if side > 0.0 else "below a position",
                        side=side, setting={"position": position},
                    )  # fmt: skip
        if motion.static:
            return
        time = residual.data.time[residual.allowed]
        for joint in np.flatnonzero(motion.present).tolist():
            window = push_window(time, residual.torque[residual.allowed, joint])
            if window is None:
                continue
            begin, end = window
            # What lasts as long as the choice may look is taken to last as long as the recording.
            if end >= time.max() - _BIN:
                end = float(motion.time[-1]) + _BIN
            if begin <= time.min() + _BIN:
                begin = float(motion.time[0])
            yield PushHypothesis(
                arm=motion.arm, site=Site.joint(joint),
                setting={"start": begin, "end": end},
            )  # fmt: skip

    def torque(self, state: State) -> Array:
        over = np.maximum(state.q - self.above_position, 0.0)
        under = np.minimum(state.q - self.below_position, 0.0)
        return self.above * over + self.below * under


@dataclass(frozen=True, eq=False, kw_only=True)
class PushHypothesis(Hypothesis):
    """Something pushes a joint for a while: no function of the state, and in no model file."""

    EFFECT = Contact
    CLAIM = "an external force pushes {joint} with {torque} between {start} and {end}"

    form: str = "for a while"
    refine = ("start", "end")
    edges = ("start", "end")
    variable = "time"
    n_comparisons = _WINDOWS
    transient = True

    def regressor(self, motion: Motion) -> Array:
        inside = (motion.time >= self.setting["start"]) & (motion.time < self.setting["end"])
        return spread(self.site.row(self.arm), inside.astype(float))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"torque": float(theta[0]), **self.setting}


@dataclass(frozen=True, eq=False, kw_only=True)
class WallHypothesis(Hypothesis):
    """A joint runs into an elastic wall.

    Attributes:
        side: 1 if it stands above a position, -1 below.
    """

    EFFECT = Contact
    EXPLAINED_BY = "payload"

    side: float
    refine = ("position",)
    n_comparisons = len(_PERCENTILES)
    extrapolates = False

    def regressor(self, motion: Motion) -> Array:
        depth = self.side * (motion.q[:, self.site.index] - self.setting["position"])
        return spread(self.site.row(self.arm), np.maximum(depth, 0.0))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"stiffness": float(self.side * theta[0]), **self.setting}

    def search_range(self, name: str, motion: Motion) -> tuple[float, float]:
        return self.setting[name] - _WALL_REACH, self.setting[name] + _WALL_REACH

    @property
    def _above(self) -> str:
        return "above" if self.side > 0.0 else "below"

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """``None`` if the joint has a wall on that side already."""
        joint, wall = self.site.index, self.parameters(theta)
        name = f"{self.effect}.{self._above}"
        stiffness, position = (
            as_array(values.get(key), self.arm.n, 0.0) for key in (name, f"{name}_position")
        )
        if stiffness[joint]:
            return None
        stiffness[joint] = wall["stiffness"]
        position[joint] = wall["position"] - position_offset(self.arm, values)[joint]
        return {**values, name: as_value(stiffness), f"{name}_position": as_value(position)}

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        stiffness = parameters["stiffness"]
        way = "back" if stiffness.value > 0.0 else "onwards"
        return (
            f"an external force pushes {self.names[0]} {way} {self._above} "
            f"{words['position']}, with {stiffness.magnitude.shown}"
        )

    def remedy(self, carried: bool) -> str:
        """A cable may pull from a position on, too."""
        more = f"look at the cables and springs across {self.names[0]}, one may pull from there on"
        return f"{super().remedy(carried)}; or {more}"


def push_window(time: Array, residual: Array) -> tuple[float, float] | None:
    """Return begin and end of the while in which a residual is off its median most."""
    order = np.argsort(time, kind="stable")
    time, residual = time[order], residual[order]
    # All pairs of bins are compared: of a long time without a sample there are to be few.
    cut = np.cumsum(np.maximum(np.diff(time, prepend=time[0]) - _LONGEST_GAP, 0.0))
    time = time - cut
    start, end = float(time[0]), float(time[-1])
    count = int((end - start) / _BIN)
    if count < 12:
        return None
    index = np.minimum(((time - start) / _BIN).astype(int), count - 1)
    number = np.bincount(index, minlength=count)
    centred = residual - np.median(residual)
    sums = np.concatenate([[0.0], np.cumsum(np.bincount(index, centred, minlength=count))])
    numbers = np.concatenate([[0], np.cumsum(number)])
    first, last = np.triu_indices(count + 1, k=round(_SHORTEST / _BIN))
    inside = numbers[last] - numbers[first]
    usable = (inside > 0) & (last - first < _LONGEST * count)
    power = np.where(usable, (sums[last] - sums[first]) ** 2 / np.maximum(inside, 1), 0.0)
    best = int(np.argmax(power))
    begin, stop = (start + _BIN * float(edge[best]) for edge in (first, last))
    inner = np.searchsorted(time, [begin, stop]) - [0, 1]  # its first and last sample
    begin_cut, stop_cut = cut[np.clip(inner, 0, len(time) - 1)].tolist()
    return begin + begin_cut, stop + stop_cut
