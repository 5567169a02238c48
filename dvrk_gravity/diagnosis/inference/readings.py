"""Is the recording read rightly? Coordinates, signs and order, before any physics is blamed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.loading import Loaded
from dvrk_gravity.diagnosis.data.model_error import model_columns
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.scaled_efforts import effort_scales
from dvrk_gravity.effects import Estimate, Reading, readings
from dvrk_gravity.estimation import NORMAL_95


@dataclass(frozen=True)
class ReadingSettings:
    """When a recording counts as read wrongly.

    Attributes:
        alpha: Chance of another reading where nothing is wrong, corrected for their number: a tenth
            of the choice of effects, for everything after it stands on it. Chosen.
        least_removed: Part of a joint's error that must go. Chosen: a sign or an order that is
            wrong leaves little right.
        samples: Samples compared: a bound on time.
        blocks: Blocks of the test: Wilcoxon's least p-value is then 6e-8.
        independent: Samples that count as one. Chosen.
        beyond: Part of the samples, in the mean over the joints, by which a reading may lie further
            outside the joints' limits, and where the model was identified, than the recording as
            it is: it is of one arm. Chosen.
        clocks: Recorded over true time, between which it is looked for. Chosen.
        grid: Clocks that are tried first.
        clock: Relative difference from 1 from which on a clock is wrong: of what shows in torques
            alone, less is a matter of the links' inertia. Chosen.
        left_out: Spans of the recording, each of which is left out in turn for its interval.
        smoothed: Relative standard deviation beside that: low-passed accelerations are a little too
            small. Seen: clocks found .0024 to .0029 too large (test_diagnose_recording_faults.py).
        driving: Standard errors below zero that the power of friction is at least, where no reading
            has it so. Chosen: one chance in a thousand.
    """

    alpha: float = 0.001
    least_removed: float = 0.3
    samples: int = 600
    blocks: int = 24
    independent: float = 1.6
    beyond: float = 0.02
    clocks: tuple[float, float] = (0.2, 5.0)
    grid: int = 17
    clock: float = 0.08
    left_out: int = 8
    smoothed: float = 0.0025
    driving: float = 3.0


_SETTINGS = ReadingSettings()


@dataclass(frozen=True, eq=False)
class ReadingScore:
    """How another reading does with the model as it is.

    Attributes:
        reading: The reading.
        gain: Log-likelihood over the recording as it is read now.
        p_value: Paired block test, corrected for the number of readings.
        removed: Largest part of a joint's error that it removes.
    """

    reading: Reading
    gain: float
    p_value: float
    removed: float

    @property
    def passes(self) -> bool:
        """Whether it is significant and large."""
        large = self.removed > _SETTINGS.least_removed and self.gain > 0.0
        return large and self.p_value < _SETTINGS.alpha


@dataclass(frozen=True, eq=False)
class WrongReading:
    """A wrong reading.

    Attributes:
        score: How the right one does.
        motion: The motion as it was read before.
        alternatives: Others that do as well.
    """

    score: ReadingScore
    motion: MeasuredMotion
    alternatives: tuple[ReadingScore, ...]


def read_as(motion: MeasuredMotion, reading: Reading) -> MeasuredMotion:
    """Return a motion read another way, by its own clock: samples compare with those before."""
    direction = motion.direction
    if direction is not None:
        direction = np.where(direction @ reading.motion.T < 0.0, -1.0, 1.0)
    return replace(
        motion,
        q=motion.q @ reading.motion.T,
        qd=reading.rate * motion.qd @ reading.motion.T,
        qdd=reading.rate**2 * motion.qdd @ reading.motion.T,
        effort=motion.effort @ reading.effort.T,
        direction=direction,
        unread=np.broadcast_to(motion.unread, motion.q.shape) @ (reading.effort.T != 0.0),
        rounding=np.sqrt((motion.rounding * np.ones(motion.arm.n)) ** 2 @ reading.effort.T**2),
    )


def in_true_time(loaded: Loaded, reading: Reading) -> Loaded:
    """Return a motion that was read as a reading has it with times, and densities, by its clock."""
    motion, rate = loaded.motion, reading.rate
    if motion.rate is None:
        return loaded
    motion = replace(
        motion,
        time=motion.time / rate,
        rate=rate * motion.rate,
        rounding=motion.rounding / np.sqrt(rate),
    )
    return replace(loaded, motion=motion, floor=loaded.floor / np.sqrt(rate))


def try_readings(motion: MeasuredMotion) -> list[ReadingScore]:
    """Return how other readings do, best first.

    The error is compared joint by joint: of exchanged joints, each with what it was read as.
    """
    from scipy import stats

    if not motion.present.all():
        return []
    rows = np.linspace(0, len(motion.q) - 1, min(_SETTINGS.samples, len(motion.q))).astype(int)
    block = np.arange(len(rows)) * _SETTINGS.blocks // len(rows)
    few = _thinned(motion, rows)
    usable = ~motion.silent[rows]
    before = _beside_friction(few.residual, few, usable) ** 2 * usable
    as_it_is = _expected(few)
    pulling = tuple(term for term in motion.model.terms if not term.FRICTION)
    alternatives = [
        *readings(motion.arm, motion.moves),
        *_clocks(few, usable),
        *effort_scales(few, usable, as_it_is),
    ]
    scores = []
    farthest = _beyond(few) + _SETTINGS.beyond
    for same_motion in _by_motion(alternatives):
        read = read_as(few, same_motion[0])
        if _beyond(read) > farthest:
            continue
        # What a model leaves open where one reading takes the joints beyond all that it was
        # identified on, a reading that does not may settle. Of efforts alone it is in both.
        moved = same_motion[0].moves
        expected = np.minimum(as_it_is, _expected(read)) if moved else np.zeros_like(as_it_is)
        scale = np.maximum(before.mean(axis=0) + expected, 1e-12)
        for reading in same_motion:
            effort = few.effort @ reading.effort.T
            after = _beside_friction(effort - read.modelled, read, usable) ** 2 * usable
            mean = np.maximum(after.mean(axis=0) + expected, 1e-12)
            # Log-likelihood of a sample.
            gain = float((0.5 * np.log(scale / mean) - reading.density).sum())
            if gain <= 0.0:
                continue
            pull = read.torque_at(read.q, replace(read.model, terms=pulling))
            if _driving((effort - pull) * read.qd, block):
                continue
            better = np.bincount(block, (np.log(before + 0.1 * scale)
                                         - np.log(after + 0.1 * scale)).sum(axis=1))  # fmt: skip
            # Where a joint is held or bears nothing, a block says nothing of its sign: ranks may
            # leave in doubt what the likelihood, were there but one sample a block, does not.
            p_value = 2.0 * min(
                float(stats.wilcoxon(better, alternative="greater").pvalue),
                float(stats.chi2.sf(2.0 * _SETTINGS.blocks * gain, 1)),
            )
            scores.append(
                ReadingScore(
                    reading,
                    len(rows) / _SETTINGS.independent * gain,
                    min(1.0, p_value * len(alternatives)),
                    removed=float(1.0 - np.sqrt(np.min(mean / scale))),
                )
            )
    return sorted(scores, key=lambda score: -score.gain)


def _clocks(few: MeasuredMotion, usable: NDArray[np.bool_]) -> list[Reading]:
    """Return the clock by which the model's torques fit best, if it is another one.

    Where velocities were measured they show the clock (``diagnosis.recording_faults``); here only
    torques do, of inertia by its square and of viscous friction.

    Args:
        few: Samples of a motion.
        usable: (N, n) which of their efforts say something.
    """
    from scipy.optimize import minimize_scalar

    if few.static or few.timed or few.reference is not None:
        return []
    eye, counted = np.eye(few.arm.n), usable & few.moves
    least = _expected(few) + 1e-12

    def squares(log: float) -> Array:
        read = read_as(few, _clock(float(np.exp(log)), eye))
        return np.where(counted, _beside_friction(read.residual, read, usable) ** 2, 0.0)

    slowest, fastest = np.log(_SETTINGS.clocks).tolist()
    grid = np.linspace(slowest, fastest, _SETTINGS.grid)
    first = np.stack([squares(log) for log in grid])

    def best(kept: NDArray[np.bool_]) -> float:
        def misfit(square: Array) -> float:
            return float(np.log(square[kept].mean(axis=0) + least).sum())

        middle = int(np.argmin([misfit(square) for square in first]))
        ends = grid[max(middle - 1, 0)], grid[min(middle + 1, len(grid) - 1)]
        found = minimize_scalar(
            lambda log: misfit(squares(log)), bounds=ends, method="bounded",
            options={"xatol": 1e-4},
        )  # fmt: skip
        return float(found.x)

    whole = best(np.ones(len(few.q), dtype=bool))
    if abs(whole) < np.log1p(_SETTINGS.clock):
        return []
    # Efron and Tibshirani (1993), An Introduction to the Bootstrap, chapter 11: the jackknife.
    count = _SETTINGS.left_out
    span = np.arange(len(few.q)) * count // len(few.q)
    without = np.array([best(span != number) for number in range(count)])
    jackknife = np.sqrt((count - 1) * np.mean((without - without.mean()) ** 2))
    deviation = float(np.hypot(jackknife, _SETTINGS.smoothed))
    low, value, high = (
        float(np.exp(whole + sign * NORMAL_95 * deviation)) for sign in (-1.0, 0.0, 1.0)
    )
    return [_clock(value, eye, low, high)]


def _clock(value: float, eye: Array, low: float = 0.0, high: float = np.inf) -> Reading:
    factor = Estimate(value, low, high, "")
    words = (
        f"its clock runs wrong, its times are {factor.shown} of the true ones; no velocities were "
        "recorded that would show it, and inertia and viscous friction that are off alike at all "
        "joints would look the same"
    )
    return Reading(words, (), eye, eye, clock=factor)


def _by_motion(alternatives: Iterable[Reading]) -> Iterable[list[Reading]]:
    """Return readings in groups that differ in the efforts alone: one torque is theirs."""
    groups: dict[tuple[bytes, float], list[Reading]] = {}
    for reading in alternatives:
        groups.setdefault((reading.motion.tobytes(), reading.rate), []).append(reading)
    return groups.values()


def _expected(motion: MeasuredMotion) -> Array:
    """Return (n,) mean square of what a model may be off by if a motion is read rightly."""
    expected: Array = (model_columns(motion) ** 2).sum(axis=2).mean(axis=0)
    if motion.model.uncertainty is not None:
        expected += np.nan_to_num(motion.model.uncertainty.error) ** 2
    return expected


def _beyond(motion: MeasuredMotion) -> float:
    """Return which part of the positions is outside the limits, and outside what is identified."""
    q, known = motion.true_q, motion.model.uncertainty
    ranges = [(motion.arm.lower, motion.arm.upper)]
    if known is not None:
        ranges.append((known.lower, known.upper))
    return float(np.mean([np.mean((q < low) | (q > high)) for low, high in ranges]))


def _beside_friction(residual: Array, motion: MeasuredMotion, usable: NDArray[np.bool_]) -> Array:
    """Return (N, n) what dry and viscous friction and a rotor of each joint leave of a residual.

    None of less than nothing: what is read with the wrong sign shows no friction that can be. Of an
    identified model all is left, for it has its own.
    """
    from scipy.optimize import nnls

    if not motion.model.of_file:
        return residual
    rest = residual.copy()
    for joint in np.flatnonzero(motion.moves).tolist():
        speed, rows = motion.qd[:, joint], usable[:, joint]
        columns = np.stack([np.sign(speed), speed, motion.qdd[:, joint]], axis=1)
        rest[:, joint] -= columns @ nnls(columns[rows], residual[rows, joint])[0]
    return rest


def _driving(power: Array, block: NDArray[np.int_]) -> bool:
    """Tell whether friction would drive the arm, beyond chance.

    An arm that hangs from the ceiling weighs as one whose efforts have the wrong sign does; the
    friction of the one takes work, that of the other would give it.

    Args:
        power: (N, n) that efforts have beside what weight, inertia and springs of the model take.
        block: (N,) the block that each sample is in.
    """
    mean = np.bincount(block, power.sum(axis=1)) / np.bincount(block)
    error = np.std(mean, ddof=1) / np.sqrt(len(mean))
    return bool(mean.mean() < -_SETTINGS.driving * error)


def _thinned(motion: MeasuredMotion, rows: NDArray[np.int_]) -> MeasuredMotion:
    return replace(
        motion,
        q=motion.q[rows],
        qd=motion.qd[rows],
        qdd=motion.qdd[rows],
        effort=motion.effort[rows],
        direction=None if motion.direction is None else motion.direction[rows],
        unread=np.broadcast_to(motion.unread, motion.q.shape)[rows],
        time=motion.time[rows],
        parts=(slice(0, len(rows)),),
    )
