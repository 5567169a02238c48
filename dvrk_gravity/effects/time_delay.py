"""Efforts and positions that are stamped apart."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Hypothesis
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import SensorEffect
from dvrk_gravity.effects.base.site import THE_ARM
from dvrk_gravity.parameters import Parameter, Value

_SMALL = 1e-3  # s: below, a slope serves in place of a secant
_FIRST = 0.01  # s, first guess
_WHILE = 0.0625  # s; chosen: over twice that, half of 3.5 Hz is left, and nothing of 8


class TimeDelay(SensorEffect):
    """effort(t) = applied effort(t - delay): efforts and positions have different time stamps."""

    NAME = "time_delay"
    DELAY = "reading.effort_delay"
    REMEDY = "stamp positions and efforts together, or delay the positions as much before a fit"
    MEANINGS = meanings(
        delay=Meaning("s", 0.0, ("late", "early"), "efforts are", least=-0.3, greatest=0.3)
    )

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        meaning = "efforts are stamped this much later than positions"
        return (Parameter(cls.DELAY, 0.0, "s", meaning, lower=-1.0, upper=1.0),)

    @classmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        delay = values.get(cls.DELAY, 0.0)
        assert isinstance(delay, float)
        return replace(errors, delay=delay)

    @classmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        return {cls.DELAY: errors.delay} if errors.delay else {}

    @classmethod
    def invalidates_commands(cls, arm: Arm, errors: ReadingErrors) -> bool:
        """Late positions do; late efforts do not, which are read at rest alone."""
        return errors.delay < 0.0

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        if motion.static:
            return
        yield DelayHypothesis(arm=motion.arm, site=THE_ARM, setting={"delay": 0.0})
        # Sharp where joints turn back, or hardly moved by the noise of a model's accelerations.
        if not motion.measured_twice:
            yield DelayHypothesis(
                arm=motion.arm, site=THE_ARM, setting={"delay": 0.0}, over_a_while=True
            )


class TwoForms(ABC):
    """A hypothesis whose regressor has a second form; the likelier of both is taken."""

    @property
    @abstractmethod
    def alternative_form(self) -> Hypothesis | None:
        """The same claim with columns of the other form; ``None``: not in this comparison."""


class RequiresParts(ABC):
    """A hypothesis of one parameter whose torque has parts, of which the first must be present."""

    @abstractmethod
    def required_parts(self, motion: Motion) -> tuple[Hypothesis, ...]:
        """Return the parts, the required one first; empty: it is judged as a whole."""


class AbsorbedByModel(ABC):
    """A hypothesis that an identified model may have absorbed, unseen, into its own parameters."""

    @abstractmethod
    def absorbed_variance(self, motion: Motion) -> float:
        """Return the variance of each parameter about zero at the model's calibration."""


class OwnTangent(ABC):
    """A hypothesis that knows the derivative of its torque better than finite differences do."""

    @abstractmethod
    def tangent(self, motion: Motion) -> Array | None:
        """Return (N, n, k) d tau / d theta at its setting; ``None``: use finite differences."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DelayHypothesis(TwoForms, RequiresParts, AbsorbedByModel, OwnTangent, Hypothesis):
    """Efforts are late against positions; to be put right where they are stamped.

    Attributes:
        of_friction: Whether the model's friction is late; ``None``: all that it has is.
        over_a_while: Of torques' means over a while, in which noise is nearly gone.
    """

    EFFECT = TimeDelay
    EFFORT_READING = True
    COHERENT_ERRORS = True
    CLAIM = "efforts and positions have different time stamps: efforts are {delay}"

    of_friction: bool | None = None
    over_a_while: bool = False
    form: str = "effort"
    fixed_point = ("delay",)
    variable = "time"
    extrapolates = False

    def regressor(self, motion: Motion) -> Array:
        """Return the secant of the model's torque by the delay, -tau' for a short one.

        Of the model's torque: measured efforts share their noise with the residual, and a shift of
        them would explain it. Against a reference, half of the shift is the reference's and half
        the efforts', which keeps the columns' noise uncorrelated with the residual's.
        """
        step = self.setting["delay"] if abs(self.setting["delay"]) > _SMALL else _FIRST
        if self.against_reference:
            if self.over_a_while:
                return mean_slope_by_delay(motion, self.setting["delay"])[:, :, None]
            was = delay_signal(motion, motion.effort, -step)
            becomes = delay_signal(motion, motion.expected, step)
            return (0.5 * (motion.effort - was + becomes - motion.expected) / step)[:, :, None]
        acting = motion.applied_torque
        if self.of_friction is not None:
            acting = motion.friction if self.of_friction else acting - motion.friction
        if self.over_a_while:
            acting = _smooth(motion, acting)
        return ((delay_signal(motion, acting, step) - acting) / step)[:, :, None]

    @property
    def alternative_form(self) -> Hypothesis | None:
        return None if self.against_reference else replace(self, over_a_while=not self.over_a_while)

    def tangent(self, motion: Motion) -> Array | None:
        """A column with noise of its own would make the delay seem surer than it is."""
        if not self.against_reference:
            return None
        return mean_slope_by_delay(motion, self.setting["delay"])[:, :, None]

    def required_parts(self, motion: Motion) -> tuple[Hypothesis, ...]:
        """Return the delays of everything but friction, and of friction.

        Presliding makes friction late where a joint reverses, but not weight and inertia. Against a
        reference the part that must be late is the torque without noise.
        """
        if self.against_reference:
            return (replace(self, over_a_while=True),)
        if not any(term.FRICTION for term in motion.model.terms):
            return ()
        return replace(self, of_friction=False), replace(self, of_friction=True)

    def absorbed_variance(self, motion: Motion) -> float:
        """S^2: it looks like damping and mass.

        Of its calibration anything up to a sample, early or late, is usual and nobody sees it:
        uniform. Of a reference half of that is: clocks of positions and efforts run freely.
        """
        model = motion.model
        interval = float(np.median(np.diff(motion.time))) / motion.thinned
        if self.against_reference:
            return interval**2 / 12.0
        identified = model.uncertainty is not None and not model.of_file
        return interval**2 / 3.0 if identified else 0.0

    def reading_errors(self, theta: Array) -> ReadingErrors:
        return replace(ReadingErrors.none(self.arm.n), delay=float(theta[0]))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"delay": float(theta[0])}


def delay_signal(motion: Motion, torque: Array, late: float) -> Array:
    """Return (N, n) a torque as it was so many seconds before, at the ends as it is there.

    By cubic splines: straight lines between samples are means, and take noise away.
    """
    from scipy.interpolate import CubicSpline

    result = np.empty_like(torque)
    for part in motion.parts:
        time = motion.time[part]
        then = np.clip(time - late, time[0], time[-1])
        result[part] = CubicSpline(time, torque[part], axis=0)(then)
    return result


def _smooth(motion: Motion, torque: Array) -> Array:
    """Return (N, n) the mean of a torque over a while about each sample, or what there is of it."""
    from scipy.interpolate import CubicSpline

    result = np.empty_like(torque)
    for part in motion.parts:
        sums = CubicSpline(motion.time[part], torque[part], axis=0).antiderivative()
        first, last = _averaging_windows(motion.time[part], motion.time[part])
        result[part] = (sums(last) - sums(first)) / (last - first)[:, None]
    return result


def _slope_by_delay(motion: Motion, torque: Array, late: float) -> Array:
    """Return (N, n) how a torque changes with its delay, N·m/s: minus its slope, so long before.

    Over a while, in which noise is nearly gone: in a column it makes a delay look smaller, and
    surer, than it is. Zero where all of that is outside what was recorded.
    """
    from scipy.interpolate import CubicSpline

    result = np.empty_like(torque)
    for part in motion.parts:
        time = motion.time[part]
        first, last = _averaging_windows(time - late, time)
        spline = CubicSpline(time, torque[part], axis=0)
        length = np.where(last > first, last - first, np.inf)
        result[part] = (spline(first) - spline(last)) / length[:, None]
    return result


def _averaging_windows(moments: Array, time: Array) -> tuple[Array, Array]:
    """Return (N,) when a while about some moments begins and ends, within recorded times."""
    first, last = (np.clip(moments + way, time[0], time[-1]) for way in (-_WHILE, _WHILE))
    return first, last


def mean_slope_by_delay(motion: Motion, delay: float = 0.0) -> Array:
    """Return (N, n) the same of measured and expected torque, their mean, laid over each other.

    Args:
        motion: N samples.
        delay: By which the efforts are late, s.
    """
    efforts = _slope_by_delay(motion, motion.effort, -0.5 * delay)
    return 0.5 * (efforts + _slope_by_delay(motion, motion.expected, 0.5 * delay))
