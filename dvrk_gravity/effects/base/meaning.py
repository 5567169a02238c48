"""What an estimated parameter means: its unit, its sign in words, what it plausibly is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from dvrk_gravity.units import interval, quantity

_TURN = 2.0 * math.pi  # an interval as wide says nothing of an angle
# Part of half an interval by which its middle may miss the value, and it is still shown as ±: less
# than is seen of half an interval of two digits.
_MIDDLE = 0.1

MORE = ("more", "less")
READS = ("too high", "too low")


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval.

    Attributes:
        value: Estimate.
        low: Lower end of the interval; NaN: not known.
        high: Upper end.
        unit: SI unit, ``""`` if it has none.
    """

    value: float
    low: float
    high: float
    unit: str

    def doubtful(self, neutral: float | None) -> bool:
        """Whether the interval holds the value that stands for no effect, if there is one."""
        return neutral is not None and self.low <= neutral <= self.high

    @property
    def shown(self) -> str:
        """The value with its 95 % interval and its unit, as one reads it: ± where it is even."""
        half = 0.5 * (self.high - self.low)
        if abs(self.high - half - self.value) <= _MIDDLE * half:
            return quantity(self.value, self.unit, half)
        return interval(self.value, self.low, self.high, self.unit)

    @property
    def magnitude(self) -> Estimate:
        """The same without its sign."""
        if self.value >= 0.0:
            return self
        return Estimate(-self.value, -self.high, -self.low, self.unit)

    def as_json(self) -> dict[str, Any]:
        """Return value, interval and unit as findings.json and the monitor's events have them."""
        known = not math.isnan(self.low)
        ci95 = [self.low, self.high] if known else None
        return {"value": self.value, "ci95": ci95, "unit": self.unit}

    def percent(self, neutral: float = 0.0) -> Estimate:
        """Return by how much it is off a neutral value, in percent."""
        value, low, high = (100.0 * (v - neutral) for v in (self.value, self.low, self.high))
        return Estimate(value, low, high, "%")

    def signed(self, senses: tuple[str, str]) -> str:
        """Return its magnitude and the word for its sign; `perhaps` if zero is in its interval."""
        words = f"{self.magnitude.shown} {senses[self.value < 0.0]}".rstrip()
        return f"perhaps {words}" if self.doubtful(0.0) else words


@dataclass(frozen=True)
class Meaning:
    """What a parameter of a finding means.

    Attributes:
        unit: Its unit on revolute joints; of prismatic ones N and m stand for N·m and rad.
        neutral: Value at which the effect is not there; ``None`` if it has none.
        senses: What a positive value means, and a negative one.
        label: What it is called in a table; by default its name.
        least: Smallest plausible value: beyond, the effect is a name for something else. From zero
            on, the interval of a setting that is searched for is even in its logarithm.
        greatest: Largest plausible value.
        percent: It is a factor, and shown as a change in percent.
        reported: It is shown at all, and not only used.
        certain: Its sign is never in doubt, since it describes a curve and no size.
    """

    unit: str = ""
    neutral: float | None = None
    senses: tuple[str, str] | None = None
    label: str = ""
    least: float = -math.inf
    greatest: float = math.inf
    percent: bool = False
    reported: bool = True
    certain: bool = False

    @property
    def positive(self) -> bool:
        """Whether it is positive by its nature."""
        return self.least >= 0.0

    def is_hedged(self, estimate: Estimate) -> bool:
        """Return whether an estimate is shown with `perhaps`: its interval holds the neutral value.

        Not one that is shown as so many times, as any angle, or without a sign.
        """
        if self.percent:
            believed = self.least <= estimate.value <= self.greatest
            return believed and estimate.percent(self.neutral or 0.0).doubtful(0.0)
        if _is_any_angle(estimate):
            return False
        if self.senses is not None:
            return estimate.doubtful(0.0)
        return not self.certain and estimate.doubtful(self.neutral)

    def in_words(self, estimate: Estimate) -> str:
        """Return an estimate in words; before one that is doubtful stands `perhaps`."""
        if self.percent and not self.least <= estimate.value <= self.greatest:
            return f"{estimate.shown} times"  # no change that anybody would count in percent
        if self.percent:
            return estimate.percent(self.neutral or 0.0).signed(self.senses or ("", ""))
        if _is_any_angle(estimate):
            return "any angle"
        if self.senses is not None:
            return estimate.signed(self.senses)
        return f"perhaps {estimate.shown}" if self.is_hedged(estimate) else estimate.shown


class Words:
    """The words of a claim by name: plain ones, and estimates, each as it is asked for.

    Attributes:
        hedged: Whether `perhaps` stands before an estimate that was asked for.
    """

    def __init__(
        self,
        plain: Mapping[str, str],
        estimates: Mapping[str, Estimate],
        meaning: Callable[[str], Meaning],
    ) -> None:
        """Take plain words, estimates, and what the names of estimates mean."""
        self._plain, self._estimates, self._meaning = plain, estimates, meaning
        self.hedged = False

    def __getitem__(self, name: str) -> str:
        """Return a plain word, or an estimate in words."""
        if name not in self._estimates:
            return self._plain[name]
        meaning, estimate = self._meaning(name), self._estimates[name]
        self.hedged |= meaning.is_hedged(estimate)
        return meaning.in_words(estimate)

    def __contains__(self, name: str) -> bool:
        """Return whether there is such an estimate."""
        return name in self._estimates


def _is_any_angle(estimate: Estimate) -> bool:
    return estimate.unit == "rad" and estimate.high - estimate.low > _TURN


def size(unit: str, senses: tuple[str, str] | None = None, label: str = "") -> Meaning:
    """Return the meaning of a size, zero where the effect is not there."""
    return Meaning(unit, 0.0, senses, label)


def meanings(**of: Meaning) -> Mapping[str, Meaning]:
    """Return the meanings of parameters by name, for an effect's ``MEANINGS``."""
    return MappingProxyType(of)
