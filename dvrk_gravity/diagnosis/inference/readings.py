"""Wrong coordinates, signs, order, scales and clocks, corrected before effects are considered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.candidate import Candidate, Score
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.loading import Loaded
from dvrk_gravity.diagnosis.data.model_error import model_columns
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.baseline import baseline_effects, prepared
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import Gain, HeldOut
from dvrk_gravity.diagnosis.inference.selection import Selection
from dvrk_gravity.diagnosis.scaled_efforts import effort_scales
from dvrk_gravity.effects import Estimate, Reading, readings
from dvrk_gravity.estimation import NORMAL_95, bonferroni, likelihood_ratio

_ALPHA = 0.001  # of a wrong correction: a tenth of that of effects, which rest on it. Chosen
_LEAST_REMOVED = 0.3  # of a joint's error. Chosen: a wrong sign or order leaves little right
_SAMPLES = 600  # compared: a bound on time
_BLOCKS = 24  # of the test: Wilcoxon's least p-value is then 6e-8
_INDEPENDENT = 1.6  # samples per independent one. Chosen
_BEYOND = 0.02  # more of the samples that may be outside limits and identified range. Chosen
_CLOCKS = (0.2, 5.0)  # recorded over true time, between which a clock is looked for. Chosen
_GRID = 17  # clocks that are tried first
_CLOCK = 0.08  # relative error of a clock: of what only torques show, less is wrong inertia. Chosen
_LEFT_OUT = 8  # spans of the recording, each left out in turn for the clock's interval
# Relative standard deviation in addition: low-passed accelerations are a little too small. Seen:
# clocks found .0024 to .0029 too large (test_diagnose_recording_faults.py).
_SMOOTHED = 0.0025
_DRIVING = 3.0  # standard errors by which friction may not drive the arm: one chance in a thousand
_SHARE = 0.7  # of the best effect's gain that a reading must reach, which explains most. Chosen
_ALTERNATIVE = 0.97  # of its gain, that another reading must reach to be listed. Chosen
_COMPARED = 4  # readings compared with the model's parameters free: a bound on time
_MOST = 3  # wrong readings found one after the other: a bound on time


@dataclass(frozen=True, eq=False)
class ReadingScore:
    """How another reading of a recording does with the given model.

    Attributes:
        reading: The reading.
        gain: Log-likelihood gain over the present reading.
        p_value: Of a paired block test, corrected for the number of readings.
        removed: Largest part of a joint's error that it removes.
    """

    reading: Reading
    gain: float
    p_value: float
    removed: float

    @property
    def passes(self) -> bool:
        """Whether it is significant and large."""
        return self.removed > _LEAST_REMOVED and self.gain > 0.0 and self.p_value < _ALPHA


@dataclass(frozen=True, eq=False)
class WrongReading:
    """A reading that was wrong.

    Attributes:
        score: The correct reading and how it does.
        motion: The motion as it was read.
        alternatives: Other readings that do as well.
    """

    score: ReadingScore
    motion: MeasuredMotion
    alternatives: tuple[ReadingScore, ...]


@dataclass(frozen=True, eq=False)
class CorrectedReading:
    """A recording as it is to be read.

    Attributes:
        loaded: The motion.
        wrong: Wrong readings, in the order in which they were corrected.
        validation: The samples, ready for comparisons.
        pool: Hypotheses that need no search.
    """

    loaded: Loaded
    wrong: tuple[WrongReading, ...]
    validation: CrossValidation
    pool: list[Candidate]


def correct_readings(loaded: Loaded, say: Callable[[str], None]) -> CorrectedReading:
    """Return the motion as it is to be read; two recordings of one motion were read alike."""
    wrong: list[WrongReading] = []
    while loaded.motion.reference is None and len(wrong) < _MOST:
        found = _wrong_reading(loaded, say)
        if found is None:
            break
        say(f"wrong reading: {found.score.reading.words}")
        wrong.append(found)
        loaded = _corrected(loaded, found.score.reading)
    say("building hypotheses")
    validation, pool = prepared(loaded.motion)
    return CorrectedReading(loaded, tuple(wrong), validation, pool)


def _wrong_reading(loaded: Loaded, say: Callable[[str], None]) -> WrongReading | None:
    """Return what is wrong with the present reading, if another one is significantly better.

    The better one must pass a rough test, gain about as much as the best effect does, with the
    model's parameters free within its uncertainty, and gain with certainty on held-out blocks.
    """
    motion = loaded.motion
    tried = try_readings(motion)
    passing = [score for score in tried if score.passes]
    if not passing:
        return None
    say("building hypotheses")
    validation, pool = prepared(motion)
    beside = baseline_effects(validation, pool)
    present = validation.score(beside)
    best = Selection(validation, pool, say).best(beside, present)
    least = _SHARE * max((trial.gain for trial in best if trial.plausible), default=0.0)
    before = HeldOut(validation).error(beside) if motion.model.of_file else None
    validation.release()
    del validation, pool, best  # a long recording leaves no room for two
    scores = _compared(motion, passing[:_COMPARED], present)
    say("building hypotheses")
    validation, pool = prepared(read_as(motion, scores[0].reading))
    beside = baseline_effects(validation, pool)
    read = validation.score(beside)
    held_out = HeldOut(validation)
    # What friction hides does not count, where a model states it poorly.
    after = held_out.as_read() if before is None else held_out.error(beside)
    if before is None:
        before = error_as_read(motion, validation.data, held_out)
    _, gain = reading_gain(scores[0], before, after, held_out)
    certain = gain.low > 0.0 and gain.relative > held_out.settings.least_removed
    enough = _gain(scores[0], validation, present, read) > least
    inflation = validation.inflation(read.error, present.error - read.error)
    p_value = likelihood_ratio(validation.gain(present, read, inflation), 1)
    if not (enough and certain and bonferroni(p_value, len(tried)) < _ALPHA):
        return None
    limit = _ALTERNATIVE * scores[0].gain
    others = tuple(score for score in scores[1:] if score.gain > limit)
    return WrongReading(scores[0], motion, others)


def _corrected(loaded: Loaded, reading: Reading) -> Loaded:
    """Return a motion in another reading, its noise and its times included."""
    motion, floor, rate = read_as(loaded.motion, reading), loaded.floor, reading.rate
    if reading.scale is not None:
        floor = floor * np.diag(reading.effort)
    if reading.clock is not None and motion.rate is not None:
        floor = floor / np.sqrt(rate)
        motion = replace(
            motion,
            time=motion.time / rate,
            rate=rate * motion.rate,
            rounding=motion.rounding / np.sqrt(rate),
        )
    return replace(loaded, motion=motion, floor=floor)


def read_as(motion: MeasuredMotion, reading: Reading) -> MeasuredMotion:
    """Return a motion in another reading, at its own times so that samples compare."""
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


def reading_gain(
    score: ReadingScore, before: Array, after: Array, held_out: HeldOut
) -> tuple[list[int], Gain]:
    """Return the joints that a reading is judged by, and its gain there from (H, n) errors."""
    old, new = held_out.rmse(before), held_out.rmse(after)
    joints = list(score.reading.joints) or [int(np.argmin(new / np.maximum(old, 1e-12)))]
    return joints, held_out.gain(before, after, joints)


def error_as_read(motion: MeasuredMotion, data: FilteredData, held_out: HeldOut) -> Array:
    """Return (H, n) errors of the recording as it was read first, at the same samples."""
    error = data.reduce(motion.residual)[held_out.rows]
    return np.where(data.usable[held_out.rows], error, np.nan)


def error_beside_baseline(motion: MeasuredMotion) -> Array:
    """Return (H, n) held-out errors of a motion with the baseline effects fitted."""
    validation, pool = prepared(motion)
    return HeldOut(validation).error(baseline_effects(validation, pool))


def try_readings(motion: MeasuredMotion) -> list[ReadingScore]:
    """Return how other readings do, best first, by the error of each joint as it was named."""
    from scipy import stats

    if not motion.present.all():
        return []
    rows = np.linspace(0, len(motion.q) - 1, min(_SAMPLES, len(motion.q))).astype(int)
    block = np.arange(len(rows)) * _BLOCKS // len(rows)
    few = motion.at(rows)
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
    farthest = _beyond(few) + _BEYOND
    # Readings that differ in the efforts alone share the model's torque.
    groups: dict[tuple[bytes, float], list[Reading]] = {}
    for reading in alternatives:
        groups.setdefault((reading.motion.tobytes(), reading.rate), []).append(reading)
    for same_motion in groups.values():
        read = read_as(few, same_motion[0])
        if _beyond(read) > farthest:
            continue
        # A reading that keeps the joints within the identified range may decide against one that
        # leaves it. For efforts alone the model's error is in both.
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
            # Held or unloaded joints do not show their sign in ranks, but in the likelihood.
            p_value = 2.0 * min(
                float(stats.wilcoxon(better, alternative="greater").pvalue),
                float(stats.chi2.sf(2.0 * _BLOCKS * gain, 1)),
            )
            scores.append(
                ReadingScore(
                    reading,
                    len(rows) / _INDEPENDENT * gain,
                    min(1.0, p_value * len(alternatives)),
                    removed=float(1.0 - np.sqrt(np.min(mean / scale))),
                )
            )
    return sorted(scores, key=lambda score: -score.gain)


def _clocks(few: MeasuredMotion, usable: Mask) -> list[Reading]:
    """Return the clock with which the model's torques fit best, if the recorded one is wrong.

    Where velocities were measured they show the clock (``recording_faults``); here only torques do,
    inertia by its square and viscous friction.
    """
    from scipy.optimize import minimize_scalar

    if few.static or few.timed or few.reference is not None:
        return []
    eye, counted = np.eye(few.arm.n), usable & few.moves
    least = _expected(few) + 1e-12

    def squares(log: float) -> Array:
        read = read_as(few, _clock(float(np.exp(log)), eye))
        return np.where(counted, _beside_friction(read.residual, read, usable) ** 2, 0.0)

    slowest, fastest = np.log(_CLOCKS).tolist()
    grid = np.linspace(slowest, fastest, _GRID)
    first = np.stack([squares(log) for log in grid])

    def best(kept: Mask) -> float:
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
    if abs(whole) < np.log1p(_CLOCK):
        return []
    # Efron and Tibshirani (1993), An Introduction to the Bootstrap, chapter 11: the jackknife.
    count = _LEFT_OUT
    span = np.arange(len(few.q)) * count // len(few.q)
    without = np.array([best(span != number) for number in range(count)])
    jackknife = np.sqrt((count - 1) * np.mean((without - without.mean()) ** 2))
    deviation = float(np.hypot(jackknife, _SMOOTHED))
    low, value, high = (
        float(np.exp(whole + sign * NORMAL_95 * deviation)) for sign in (-1.0, 0.0, 1.0)
    )
    return [_clock(value, eye, low, high)]


def _clock(value: float, eye: Array, low: float = 0.0, high: float = np.inf) -> Reading:
    factor = Estimate(value, low, high, "")
    words = (
        f"its clock is wrong, its times are {factor.shown} of the true ones; without recorded "
        "velocities, equally wrong inertia and viscous friction at all joints would look the same"
    )
    return Reading(words, (), eye, eye, clock=factor)


def _expected(motion: MeasuredMotion) -> Array:
    """Return (n,) mean square of a model's error in a motion that is read correctly."""
    expected: Array = (model_columns(motion) ** 2).sum(axis=2).mean(axis=0)
    if motion.model.uncertainty is not None:
        expected += np.nan_to_num(motion.model.uncertainty.error) ** 2
    return expected


def _beyond(motion: MeasuredMotion) -> float:
    """Return the part of positions outside the limits and outside the identified range."""
    q, known = motion.true_q, motion.model.uncertainty
    ranges = [(motion.arm.lower, motion.arm.upper)]
    if known is not None:
        ranges.append((known.lower, known.upper))
    return float(np.mean([np.mean((q < low) | (q > high)) for low, high in ranges]))


def _beside_friction(residual: Array, motion: MeasuredMotion, usable: Mask) -> Array:
    """Return (N, n) a residual without dry and viscous friction and rotor of each joint.

    Each is non-negative, so that reversed efforts show none. An identified model has its own.
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


def _driving(power: Array, block: np.ndarray) -> bool:
    """Return whether friction would drive the arm, beyond chance.

    An arm on the ceiling and one with reversed efforts have the same weight, but friction takes
    work from the one and would add to the other. ``power`` is that of efforts less the weight,
    inertia and springs of the model.
    """
    mean = np.bincount(block, power.sum(axis=1)) / np.bincount(block)
    error = np.std(mean, ddof=1) / np.sqrt(len(mean))
    return bool(mean.mean() < -_DRIVING * error)


def _compared(
    motion: MeasuredMotion, scores: Sequence[ReadingScore], present: Score
) -> list[ReadingScore]:
    """Return readings by their gain with the model's parameters free, best first.

    With fixed ones, a wrong reading inside the identified range beats a right one outside it.
    """
    if len(scores) == 1:
        return list(scores)
    found = []
    for score in scores:
        read = read_as(motion, score.reading)
        if motion.model.of_file:
            validation, pool = prepared(read)
            beside = baseline_effects(validation, pool)
        else:
            validation, beside = CrossValidation(FilteredData.of(read)), []
        gain = _gain(score, validation, present, validation.score(beside))
        found.append(replace(score, gain=gain))
    return sorted(found, key=lambda score: -score.gain)


def _gain(score: ReadingScore, validation: CrossValidation, present: Score, read: Score) -> float:
    """Return the log-likelihood gain of a reading, in the units of the efforts as recorded."""
    scaled = float((validation.samples * (validation.weight > 0.0)) @ score.reading.density)
    return read.likelihood - present.likelihood - scaled
