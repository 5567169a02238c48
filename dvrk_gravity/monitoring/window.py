"""The last seconds of a monitored motion as whitened samples: residual, what is uncertain, causes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis import FRICTION_BY_LOAD, FRICTION_PART, MeasuredMotion, expect
from dvrk_gravity.effects import Hypothesis
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.change_test import ChangeTest, whitened
from dvrk_gravity.monitoring.rows import Rows

_OTHER_MOTION = 1.22  # of the known error, in another motion; ``identification.expected_error``
_SHAPES = 5  # of a joint's misfit: constant, position and its square, direction, speed
_STUCK = 0.05  # part of a stuck row that the low-pass may leave in a sample, as of a diagnosis
_LEAST_CORRELATION = 0.05  # s, where a model does not know its residual's


@dataclass(frozen=True, eq=False)
class Band:
    """By how much a model's torque is off without a cause.

    Attributes:
        deviation: (n,) RMS of errors that the uncertain directions do not describe, N·m.
        correlation_time: (n,) s of these.
    """

    deviation: Array
    correlation_time: Array

    @classmethod
    def of(cls, model: TorqueModel, measured: Array) -> Band:
        """Return that of an identified model.

        Args:
            model: The model.
            measured: (n,) RMS residual of a first stretch, N·m, for joints of which the model knows
                no error.
        """
        known, n = model.uncertainty, model.arm.n
        error = np.full(n, np.nan) if known is None else known.error
        time = np.full(n, np.nan) if known is None else known.correlation_time
        return cls(
            np.where(np.nan_to_num(error) > 0.0, _OTHER_MOTION * error, measured),
            np.fmax(np.nan_to_num(time), _LEAST_CORRELATION),
        )


@dataclass(frozen=True, eq=False)
class Window:
    """m samples of the last seconds, a few times a second, in whitened units.

    Attributes:
        motion: The rows beside the model.
        time: (m,) s.
        usable: (m, n) samples that say something.
        residual: (m, n) whitened residual.
        torque: (m, n) the same in N·m.
        open: (m, n, d + e) torque of what is uncertain, N·m per standard deviation: d directions that
            are the same in every window (the model's own parameters, friction of the day, smooth
            misfits), and e of this window alone (beyond what was identified, friction by load).
        fixed: d.
    """

    motion: MeasuredMotion
    time: Array
    usable: Mask
    residual: Array
    torque: Array
    open: Array
    fixed: int
    _filter: LowPassed
    _follows: Mask
    _band: Band

    @classmethod
    def of(
        cls, model: TorqueModel, rows: Rows, residual: Array, band: Band, settings: Sampling,
        without: Sequence[tuple[float, float]] = (),
    ) -> Window:  # fmt: skip
        """Return the samples of (K, n) rows with their low-passed residual.

        Args:
            model: The model.
            rows: The rows.
            residual: (K, n) of the observer, N·m.
            band: By how much the model is off.
            settings: Of observer and samples.
            without: Spans of time that are left out, s.
        """
        motion = measured_motion(model, rows, settings.row_rate)
        low = LowPassed.of(motion, settings)
        expected = expect(motion)
        time = low.decimated(rows.time)
        usable = low(motion.silent.astype(float)) < _STUCK
        usable &= motion.present
        for begin, end in without:
            usable[(time >= begin) & (time <= end)] = False
        step = low.stride / settings.row_rate
        follows = np.zeros_like(usable)
        follows[1:] = usable[1:] & usable[:-1] & (np.diff(time) < 1.5 * step)[:, None]
        known = 0 if model.uncertainty is None else model.uncertainty.size
        columns = low(expected.columns)
        fixed = np.concatenate(
            [
                columns[:, :, :known],
                low(_diagonal(FRICTION_PART * expected.friction)),
                low(_misfits(motion, band.deviation)),
            ],
            axis=2,
        )
        found = cls(
            motion, time, usable, residual, low.decimated(residual),
            np.concatenate([fixed, columns[:, :, known:]], axis=2), fixed.shape[2],
            low, follows, band,
        )  # fmt: skip
        return replace(found, residual=found.white(found.torque))

    def white(self, values: Array) -> Array:
        """Return (m, n, …) samples, whitened; zero where they say nothing."""
        step = self._filter.stride / (self.motion.rate or 1.0)
        kept = np.exp(-step / self._band.correlation_time)
        white = whitened(values, self._follows, self._band.deviation, kept)
        return np.where(
            self.usable.reshape(*self.usable.shape, *(1,) * (values.ndim - 2)), white, 0.0
        )

    def deviation(self, test: ChangeTest, rows: slice) -> Array:
        """Return (r, n) standard deviation of the residual in some samples, N·m.

        Errors, and what is uncertain about the model as the samples leave it.
        """
        left = test.deviation_of(self.open[rows].reshape(-1, self.open.shape[2]))
        return np.hypot(self._band.deviation, left.reshape(-1, self.motion.arm.n))

    def rubbed(self, torque: Array) -> Array:
        """Return (m, n, n) torque by which friction grows with (m, n) torque that joints transmit."""
        signs = np.column_stack([self.motion.sign(row) for row in np.eye(self.motion.arm.n)])
        return _diagonal(FRICTION_BY_LOAD * np.abs(torque) * self._filter(signs))

    def columns(self, hypothesis: Hypothesis) -> Array:
        """Return (m, n, k) low-passed torque of a cause per unit of its parameters, N·m."""
        return self._filter(hypothesis.regressor(self.motion))

    def causes(self) -> Iterator[Hypothesis]:
        """Yield what may have changed, of the same form in every window."""
        for effect in effects.effects():
            yield from effect.watched(self.motion)


@dataclass(frozen=True)
class Sampling:
    """How measurements are reduced.

    Attributes:
        row_rate: Rows a second: the observer's steps. Chosen: six times its band.
        band: Hz, of the observer's low-pass; that of the known error of identified models.
        stride: Rows a sample: first-order noise of that band then has a correlation of 0.06.
    """

    row_rate: float = 50.0
    band: float = 5.65
    stride: int = 4

    @property
    def gain(self) -> float:
        """The observer's gain, 1/s."""
        return 2.0 * np.pi * self.band


@dataclass(frozen=True, eq=False)
class LowPassed:
    """The observer's low-pass on signals of rows, and every so-maniest row.

    Attributes:
        parts: Rows that follow one another.
        kept: What a step keeps, e^(-K T).
        stride: Rows a sample.
    """

    parts: tuple[slice, ...]
    kept: float
    stride: int

    @classmethod
    def of(cls, motion: MeasuredMotion, settings: Sampling) -> LowPassed:
        """Return that of the rows of a motion."""
        kept = float(np.exp(-settings.gain / settings.row_rate))
        return cls(motion.parts, kept, settings.stride)

    def __call__(self, values: Array) -> Array:
        """Return (m, …) samples of (K, …) signals."""
        from scipy.signal import lfilter

        pieces = []
        for part in self.parts:
            own = values[part]
            state = self.kept * own[:1]
            pieces.append(lfilter([1.0 - self.kept], [1.0, -self.kept], own, axis=0, zi=state)[0])
        return self.decimated(np.concatenate(pieces))

    def decimated(self, values: Array) -> Array:
        """Return every so-maniest of (K, …) rows, the last one among them."""
        return values[(len(values) - 1) % self.stride :: self.stride]


def measured_motion(model: TorqueModel, rows: Rows, rate: float) -> MeasuredMotion:
    """Return rows beside a model, as a diagnosis has a motion."""
    gaps = np.flatnonzero(np.diff(rows.time) > 1.5 / rate) + 1
    parts = tuple(
        slice(first, last) for first, last in zip((0, *gaps), (*gaps, len(rows)), strict=True)
    )
    qdd = np.zeros_like(rows.qd)
    for part in parts:
        if part.stop - part.start > 1:
            qdd[part] = np.gradient(rows.qd[part], 1.0 / rate, axis=0)
    n = model.arm.n
    return MeasuredMotion(
        model=model, q=rows.q, qd=rows.qd, qdd=qdd, effort=rows.effort, time=rows.time, parts=parts,
        rate=rate, present=np.ones(n, dtype=bool), step=np.zeros(n), clock=(0,) * len(parts),
    )  # fmt: skip


def _diagonal(values: Array) -> Array:
    """Return (K, n, n) columns that act on one joint each from (K, n) torques."""
    return values[:, :, None] * np.eye(values.shape[1])


def _misfits(motion: MeasuredMotion, deviation: Array) -> Array:
    """Return (K, n, 5 n) smooth functions of a joint's own state that sum up to its deviation.

    What a model lacks recurs wherever the arm returns: as noise alone it would seem to vanish with
    time.
    """
    known, n = motion.model.uncertainty, motion.arm.n
    low, high = motion.q.min(axis=0), motion.q.max(axis=0)
    speed = motion.speed
    if known is not None:
        low, high = known.lower, known.upper
        speed = np.where(np.nan_to_num(known.speed) > 0.0, known.speed, speed)
    place = (motion.true_q - 0.5 * (low + high)) / np.maximum(0.5 * (high - low), 1e-6)
    place = np.clip(place, -1.0, 1.0)
    sign = np.column_stack([motion.sign(row) for row in np.eye(n)])
    fast = np.clip(motion.qd / np.maximum(speed, 1e-6), -1.0, 1.0)
    shapes = (np.ones_like(place), place, place**2, sign, fast)
    return np.concatenate([_diagonal(deviation / np.sqrt(_SHAPES) * s) for s in shapes], axis=2)
