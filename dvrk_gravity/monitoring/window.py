"""The last seconds of a motion as whitened samples: residual, what is uncertain, causes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.compensate import DRY_SPEED
from dvrk_gravity.diagnosis import (
    FRICTION_BY_LOAD,
    FRICTION_PART,
    FilterSettings,
    MeasuredMotion,
    expect,
)
from dvrk_gravity.effects import Hypothesis, point_mass_directions
from dvrk_gravity.identification import OTHER_MOTION
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.change_test import ChangeTest, whiten
from dvrk_gravity.monitoring.observer import local_noise, white_noise
from dvrk_gravity.monitoring.rows import Rows

_SHAPES = 5  # of a joint's misfit: constant, position and its square, direction, speed
_STUCK = FilterSettings().stuck
# Times the greatest identified speed, up to which a row counts. Chosen: of eight arms errors up to
# twice that speed are as at others. Of positions nothing beyond the identified range: a spring that
# is held at its edge there was off by 26 errors at 3 % beyond it.
_FASTER = 2.5
# Of the greatest identified speed, below which friction is no function of speed that recurs: it
# builds up, sticks and slips. As the identification has it (`SLOW`).
_CREEPS = 0.1
# Likewise, below which it may stand, held by any friction up to its level, while others that share
# a joint with it move. Chosen: a wrist's motor breaks away at that.
_STANDS = 0.01
SHAPE = 0.2  # of a cause's torque, that its columns may be off by. Chosen
_OF_SHAPE = 0.05  # likewise, by no smooth function of position. Chosen
_SPIKE = 15  # samples, less than half of which a spike lasts: half a second. Chosen
# Standard deviations of errors by which it exceeds twice what is around it. Chosen: the torque of a
# load, too, changes within a second, by parts of itself.
_STANDS_OUT = 4.0
_AROUND = 2.0  # s, of samples from which the noise of one is known. Chosen
_LEAST_CORRELATION = 0.05  # s, where a model does not know its residual's


@dataclass(frozen=True, eq=False)
class Band:
    """By how much a model's torque is off without a cause.

    Attributes:
        error: (n,) RMS of errors that the uncertain directions do not describe, N·m.
        correlation_time: (n,) s of these.
        gain: (n,) of the observer, 1/s.
    """

    error: Array
    correlation_time: Array
    gain: Array

    @classmethod
    def of(cls, model: TorqueModel, measured: Array, gain: Array) -> Band:
        """Return the error band of an identified model.

        Args:
            model: The model.
            measured: (n,) RMS residual of a first stretch, N·m, for joints of which the model knows
                no error.
            gain: (n,) of the observer, 1/s.
        """
        known, n = model.uncertainty, model.arm.n
        error = np.full(n, np.nan) if known is None else known.error
        time = np.full(n, np.nan) if known is None else known.correlation_time
        return cls(
            np.where(np.nan_to_num(error) > 0.0, OTHER_MOTION * error, measured),
            np.fmax(np.nan_to_num(time), _LEAST_CORRELATION),
            gain,
        )


@dataclass(frozen=True, eq=False)
class Window:
    """m samples of the last seconds, a few times a second, in whitened units.

    Attributes:
        motion: The samples beside the model.
        time: (m,) s.
        usable: (m, n) samples that say something.
        torque: (m, n) residual, N·m.
        uncertain_torque: (m, n, d + e) torque of what is uncertain, N·m per standard deviation: d
            directions that are the same in every window (the model's own parameters, friction of
            the day, smooth misfits), and e of this window alone (beyond what was identified,
            friction by load).
        n_fixed: d.
        error: (n,) standard deviation of errors that the directions do not describe, N·m.
        error_factor: (m, n) by which it is larger, where a joint creeps or noise is more than
            usually.
        available: (m, n) samples that are there, whether they say something or friction holds a
            joint.
        breakaway_torque: (n,) torque that friction can hold at rest, N·m.
    """

    motion: MeasuredMotion
    time: Array
    usable: Mask
    torque: Array
    uncertain_torque: Array
    n_fixed: int
    error: Array
    error_factor: Array
    available: Mask
    breakaway_torque: Array
    _filter: LowPass
    _correlation: Array

    @classmethod
    def of(
        cls, model: TorqueModel, rows: Rows, unexpected: Array, band: Band, settings: Sampling,
        without: Sequence[tuple[float, float]] = (),
    ) -> Window:  # fmt: skip
        """Return the samples of (K, n) rows.

        Args:
            model: The model.
            rows: The rows.
            unexpected: (K, n) measured minus expected torque of each row, N·m.
            band: By how much the model is off.
            settings: Of observer and samples.
            without: Spans of time that are left out, s.
        """
        motion = measured_motion(model, rows, settings)
        low = LowPass.of(motion, band.gain)
        expected = expect(motion)
        time = motion.time
        beyond = np.broadcast_to(_outside_identified_range(motion)[:, None], motion.q.shape)
        heard = motion.present & (low(beyond.astype(float)) < _STUCK)
        for begin, end in without:
            heard[(time >= begin) & (time <= end)] = False
        usable = heard & (low(motion.stuck.astype(float)) < _STUCK)
        step = 1.0 / settings.sample_rate
        known = 0 if model.uncertainty is None else model.uncertainty.size
        columns = low(expected.columns)
        fixed = np.concatenate(
            [
                columns[:, :, :known],
                low(_diagonal(FRICTION_PART * expected.friction)),
                low(_misfit_columns(motion, band.error)),
            ],
            axis=2,
        )
        torque = low(settings.average(unexpected))
        noise = np.maximum(white_noise(torque), local_noise(torque, round(_AROUND / step)))
        now = np.hypot(band.error, noise)
        error = np.median(now, axis=0)
        # Of an error of first order and white noise, seen as one error of first order.
        correlation = np.exp(-step / band.correlation_time) * (band.error / now) ** 2
        slow = low(FRICTION_PART * np.abs(expected.friction) * _low_speed_weight(motion, _CREEPS))
        held = breakaway_torque(model, motion.q[-1])
        stands = low(held * _low_speed_weight(motion, _STANDS) * ~motion.stuck)
        larger = np.sqrt(now**2 + slow**2 + stands**2) / error
        return cls(
            motion, time, usable, torque, np.concatenate([fixed, columns[:, :, known:]], axis=2),
            fixed.shape[2], error, larger, heard, held, low, correlation,
        )  # fmt: skip

    def with_rests(self) -> Window:
        """Return the window with samples of resting joints, their breakaway torque as error."""
        at_rest = self._filter(np.where(self.motion.stuck, self.breakaway_torque / self.error, 0.0))
        return replace(
            self, usable=self.available, error_factor=np.hypot(self.error_factor, at_rest)
        )

    @cached_property
    def measured_torque(self) -> Array:
        """(m, n) low-passed measured torque, N·m."""
        return self._filter(self.motion.effort)

    def without_spikes(self) -> Window:
        """Return the window without spikes of up to half a second: knocks, jumps of an encoder.

        An encoder that slips by two degrees, say, lets a controller move the arm so far at once: of
        the acceleration, which is not in the readings, no change knows.
        """
        from scipy.ndimage import binary_dilation, median_filter

        size = self.torque / (self.error * self.error_factor)
        usual = median_filter(size, (_SPIKE, 1), mode="nearest")
        above = np.abs(size - usual) > _STANDS_OUT + np.abs(usual)
        spikes = binary_dilation(above, np.ones((3, 1)))
        return replace(self, usable=self.usable & ~spikes)

    @property
    def step(self) -> float:
        """What a sample lasts, s."""
        assert self.motion.rate is not None  # no static poses
        return 1.0 / self.motion.rate

    @property
    def ends(self) -> Array:
        """(m,) s: each is the mean of what was measured in the step before."""
        return self.time + 0.5 * self.step

    @cached_property
    def residual(self) -> Array:
        """(m, n) whitened residual."""
        return self.whiten(self.torque)

    @cached_property
    def uncertain(self) -> Array:
        """(m, n, d + e) whitened torque of what is uncertain."""
        return self.whiten(self.uncertain_torque)

    @cached_property
    def _follows(self) -> Mask:
        """(m, n) whether the sample before is one of the same part, and usable."""
        follows = np.zeros_like(self.usable)
        follows[1:] = self.usable[1:] & self.usable[:-1]
        follows[1:] &= (np.diff(self.time) < 1.5 * self.step)[:, None]
        return follows

    def whiten(self, values: Array, rows: slice = slice(None)) -> Array:
        """Return (r, n, …) whitened values of some samples, zero where they are not usable.

        Before the first of them the values are zero.
        """
        usable, larger = (
            each.reshape(*each.shape, *(1,) * (values.ndim - 2))
            for each in (self.usable[rows], self.error_factor[rows])
        )
        follows, kept = self._follows[rows], self._correlation[rows]
        white = whiten(values / larger, follows, self.error, kept)
        return np.where(usable, white, 0.0)

    def deviation(self, test: ChangeTest, rows: slice) -> Array:
        """Return (r, n) standard deviation of the residual in some samples, N·m.

        Errors, and what is uncertain about the model as the samples leave it.
        """
        left = test.deviation_of(
            self.uncertain_torque[rows].reshape(-1, self.uncertain_torque.shape[2])
        )
        return np.hypot(self.error * self.error_factor[rows], left.reshape(-1, self.motion.arm.n))

    def without_change(self, hypothesis: Hypothesis, theta: Array, since: float) -> Window:
        """Return the window less the torque of a change, whose size and shape stay uncertain.

        Its size by as much as itself, and by the friction that grows with it; its shape, since no
        cable is a polynomial, by a fifth that depends on position, and by errors of a twentieth.

        Args:
            hypothesis: The change.
            theta: (k,) its parameters.
            since: When it began, s.
        """
        columns = self.columns(hypothesis, since)
        torque, place = columns @ theta, _normalized_positions(self.motion)
        rubs = FRICTION_BY_LOAD * np.abs(torque) * self._filter(self.motion.signs)
        shapes = [_diagonal(SHAPE * torque * place**power) for power in (1, 2)]
        uncertain = [self.uncertain_torque, columns * np.abs(theta), _diagonal(rubs), *shapes]
        return replace(
            self, torque=self.torque - torque, uncertain_torque=np.concatenate(uncertain, axis=2),
            error_factor=np.hypot(self.error_factor, _OF_SHAPE * torque / self.error),
        )  # fmt: skip

    def columns(self, hypothesis: Hypothesis, since: float = -np.inf) -> Array:
        """Return (m, n, k) low-passed torque of a cause per unit of its parameters, N·m.

        Args:
            hypothesis: The cause.
            since: When it began, s.
        """
        return self._filter_from(hypothesis.regressor(self.motion), since)

    def white_columns(self, causes: Sequence[Hypothesis]) -> list[Array]:
        """Return (m, n, k) whitened low-passed torque of each cause, per unit of its parameters."""
        each = [cause.regressor(self.motion) for cause in causes]
        together = self.whiten(self._filter(np.concatenate(each, axis=2)))
        edges = np.cumsum([columns.shape[2] for columns in each])
        return list(map(np.ascontiguousarray, np.split(together, edges[:-1], axis=2)))

    def load(self, body: int, since: float) -> Array:
        """Return (m, n, 10) whitened torque of a load by :func:`effects.place_terms`, per kg."""
        directions = point_mass_directions(self.motion.arm, body)
        return self.whiten(self._filter_from(self.motion.link_torque(body, directions), since))

    def _filter_from(self, columns: Array, since: float) -> Array:
        """Return the low-passed (m, n, k) torque of what began at a time, s."""
        part = np.clip((self.ends - since) / self.step, 0.0, 1.0)
        return self._filter(part[:, None, None] * columns)

    def causes(self) -> Iterator[Hypothesis]:
        """Yield what may have changed, of the same form in every window."""
        for effect in effects.effects():
            yield from effect.monitor_hypotheses(self.motion)


@dataclass(frozen=True)
class Sampling:
    """How measurements are reduced.

    Attributes:
        row_rate: Rows a second: the observer's steps. Chosen: nine times its band.
        rows_per_sample: Rows that a sample of the tests is the average of: noise behind the fastest
            observer then has a correlation of 0.06, and tests cost what the columns of all samples
            cost.
    """

    row_rate: float = 50.0
    rows_per_sample: int = 4

    @property
    def sample_rate(self) -> float:
        """Samples a second."""
        return self.row_rate / self.rows_per_sample

    def average(self, values: Array) -> Array:
        """Return averages of (K, …) rows, the last one among them."""
        count = len(values) // self.rows_per_sample
        grouped = values[len(values) - count * self.rows_per_sample :]
        return grouped.reshape(count, self.rows_per_sample, *values.shape[1:]).mean(axis=1)


@dataclass(frozen=True, eq=False)
class LowPass:
    """The observer's low-pass on signals of samples.

    Attributes:
        parts: Samples that follow one another.
        decay: (n,) what a step keeps, e^(-K T).
    """

    parts: tuple[slice, ...]
    decay: Array

    @classmethod
    def of(cls, motion: MeasuredMotion, gain: Array) -> LowPass:
        """Return the low-pass for a motion's samples, with the observer's (n,) gains in 1/s."""
        assert motion.rate is not None  # no static poses
        return cls(motion.parts, np.exp(-gain / motion.rate))

    def __call__(self, values: Array) -> Array:
        """Return (m, n, …) low-passed signals."""
        from scipy.signal import lfilter

        result = np.empty_like(values)
        for part in self.parts:
            for joint, kept in enumerate(self.decay.tolist()):
                own = values[part, joint]
                start = kept * own[:1]
                result[part, joint], _ = lfilter([1.0 - kept], [1.0, -kept], own, axis=0, zi=start)
        return result


def breakaway_torque(model: TorqueModel, q: Array) -> Array:
    """Return the (n,) torque that friction can hold at rest at (n,) positions, N·m."""
    model, speed = model.physical(), DRY_SPEED * model.arm.scale
    still = model.torque(q)
    either = [np.abs(model.torque(q, way * speed) - still) for way in (-1.0, 1.0)]
    return np.asarray(np.min(either, axis=0))


def measured_motion(model: TorqueModel, rows: Rows, settings: Sampling) -> MeasuredMotion:
    """Return the samples of rows beside a model, as a diagnosis has a motion.

    Accelerations are averages over the rows of a sample, as the momentum's changes are.
    """
    qdd = np.zeros_like(rows.qd)
    for part in rows.parts(1.5 / settings.row_rate):
        if part.stop - part.start > 1:
            qdd[part] = np.gradient(rows.qd[part], 1.0 / settings.row_rate, axis=0)
    means = Rows(*map(settings.average, rows.arrays))
    parts = means.parts(1.5 / settings.sample_rate)
    return MeasuredMotion(
        model=model, q=means.q, qd=means.qd, qdd=settings.average(qdd), effort=means.effort,
        time=means.time, parts=parts, rate=settings.sample_rate,
        present=np.ones(model.arm.n, dtype=bool), step=np.zeros(model.arm.n),
        clock=(0,) * len(parts),
    )  # fmt: skip


def _outside_identified_range(motion: MeasuredMotion) -> Mask:
    """Return (K,) rows in which a joint is beyond what the model was identified on.

    There the model may be off by more than anything that could be named.
    """
    known = motion.model.uncertainty
    if known is None or motion.model.of_file:
        return np.zeros(len(motion.q), dtype=bool)
    q = motion.true_q
    outside = (q < known.lower) | (q > known.upper)
    fastest = np.where(np.nan_to_num(known.speed) > 0.0, known.speed, np.inf)
    return np.asarray(np.any(outside | (np.abs(motion.qd) > _FASTER * fastest), axis=1))


def _low_speed_weight(motion: MeasuredMotion, part: float) -> Array:
    """Return (K, n) whether a joint or a motor that moves it is slower than a part of its fastest.

    One at rest, next to nothing at twice that speed.
    """
    to_motor, fastest = motion.arm.joint_to_actuator, _greatest_speed(motion)
    of_motors = np.hypot.reduce(to_motor * fastest, axis=1)
    speeds = motion.qd / fastest, motion.arm.actuator_position(motion.qd) / of_motors
    joint, motor = (np.exp(-np.square(speed / part)) for speed in speeds)
    return np.maximum(joint, np.max(motor[:, :, None] * (to_motor != 0.0), axis=1))


def _greatest_speed(motion: MeasuredMotion) -> Array:
    """Return (n,) greatest speed that the model was identified at, else the motion's RMS."""
    known = motion.model.uncertainty
    speed = np.zeros(motion.arm.n) if known is None else np.nan_to_num(known.speed)
    return np.maximum(np.where(speed > 0.0, speed, motion.speed), 1e-6)


def _diagonal(values: Array) -> Array:
    """Return (K, n, n) columns that act on one joint each from (K, n) torques."""
    return values[:, :, None] * np.eye(values.shape[1])


def _normalized_positions(motion: MeasuredMotion) -> Array:
    """Return (K, n) positions within the identified range, from -1 to 1, else within their own."""
    known = motion.model.uncertainty
    low, high = motion.q.min(axis=0), motion.q.max(axis=0)
    if known is not None:
        low, high = known.lower, known.upper
    place = (motion.true_q - 0.5 * (low + high)) / np.maximum(0.5 * (high - low), 1e-6)
    return np.clip(place, -1.0, 1.0)


def _misfit_columns(motion: MeasuredMotion, deviation: Array) -> Array:
    """Return (K, n, 5 n) smooth functions of a joint's own state that sum up to its deviation.

    What a model lacks recurs wherever the arm returns: as noise alone it would seem to vanish with
    time.
    """
    place = _normalized_positions(motion)
    fast = np.clip(motion.qd / _greatest_speed(motion), -1.0, 1.0)
    shapes = (np.ones_like(place), place, place**2, motion.signs, fast)
    return np.concatenate([_diagonal(deviation / np.sqrt(_SHAPES) * s) for s in shapes], axis=2)
