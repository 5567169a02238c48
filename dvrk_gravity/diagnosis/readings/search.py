"""Other coordinates, signs, orders, scales and clocks in which a recording may be read.

A factor of all efforts, as of another unit, is in every sample and dominates all other error.
Clipped efforts stay at a level; scaled ones do not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import ANY_UNIT
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.expectation import model_columns
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects import Estimate, Reading, readings
from dvrk_gravity.estimation import NORMAL_95, likelihood_ratio

ALPHA = 0.001  # of a wrong correction: a tenth of that of effects, which rest on it. Chosen
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
# clocks found .0024 to .0029 too large (test_diagnose_readings.py).
_SMOOTHED = 0.0025
_DRIVING = 3.0  # standard errors by which friction may not drive the arm: one chance in a thousand
# Read over true efforts, between which a scale is looked for: N·mm for N·m, and as much the other
# way; and scales of a first grid: then a step is 3 %.
_SCALES = (0.5e-3, 2e3)
_SCALE_GRID = 500
# Correlation of a joint's efforts with the model's, from which on they are these at some scale.
# Chosen: less than a third of them is then left, and a square wave, to which clipping takes a sine,
# has .90.
_LIKE = 0.95
# Part of the squared residual of clipping that a scale may leave. Chosen: where a joint's effort is
# dry friction alone, both leave the same.
_LEVEL = 0.5
_SCALE_SPANS = 8  # parts of the recording, each of which is left out in turn for the interval


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
        return self.removed > _LEAST_REMOVED and self.gain > 0.0 and self.p_value < ALPHA


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
        invalid_effort=np.broadcast_to(motion.invalid_effort, motion.q.shape)
        @ (reading.effort.T != 0.0),
        rounding=np.sqrt((motion.rounding * np.ones(motion.arm.n)) ** 2 @ reading.effort.T**2),
    )


def try_readings(motion: MeasuredMotion) -> list[ReadingScore]:
    """Return how other readings do, best first, by the error of each joint as it was named.

    None where joints are missing, nor of two recordings of one motion, which were read equally.
    """
    if motion.measured_twice or not motion.present.all():
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
        *_clocks(few, usable, as_it_is),
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
        most = as_it_is if same_motion[0].moves else np.zeros_like(as_it_is)
        found = []
        for reading in same_motion:
            effort = few.effort @ reading.effort.T
            after = _beside_friction(effort - read.modelled, read, usable) ** 2 * usable
            # Monotonic in the model's error, which takes longer to find.
            ends = [_gains(before, after, error) for error in (np.zeros_like(most), most)]
            if (np.max(ends, axis=0) - reading.density).sum() > 0.0:
                found.append((reading, effort, after))
        if not found:
            continue
        expected = np.minimum(most, _expected(read)) if most.any() else most
        scale = np.maximum(before.mean(axis=0) + expected, 1e-12)
        for reading, effort, after in found:
            gain = float((_gains(before, after, expected) - reading.density).sum())
            if gain <= 0.0:
                continue
            mean = np.maximum(after.mean(axis=0) + expected, 1e-12)
            pull = read.torque_at(read.q, replace(read.model, terms=pulling))
            if _driving((effort - pull) * read.qd, block):
                continue
            from scipy.stats import wilcoxon  # slow to load, and rarely needed

            better = np.bincount(block, (np.log(before + 0.1 * scale)
                                         - np.log(after + 0.1 * scale)).sum(axis=1))  # fmt: skip
            # Held or unloaded joints do not show their sign in ranks, but in the likelihood.
            p_value = 2.0 * min(
                float(wilcoxon(better, alternative="greater").pvalue),
                likelihood_ratio(_BLOCKS * gain, 1),
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


def _gains(before: Array, after: Array, expected: Array) -> Array:
    """Return (n,) log-likelihood gains of a sample, of (N, n) squared errors beside the model's."""
    old, new = (np.maximum(square.mean(axis=0) + expected, 1e-12) for square in (before, after))
    return np.asarray(0.5 * np.log(old / new))


def _clocks(few: MeasuredMotion, usable: Mask, expected: Array) -> list[Reading]:
    """Return the clock with which the model's torques fit best, if the recorded one is wrong.

    Where velocities were measured they show the clock (``faults``); here only torques do,
    inertia by its square and viscous friction.
    """
    from scipy.optimize import minimize_scalar

    if few.static or few.timed:
        return []
    eye, counted = np.eye(few.arm.n), usable & few.moves
    least = expected + 1e-12

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


def effort_scales(few: MeasuredMotion, usable: Mask, least: Array) -> Iterator[Reading]:
    """Yield the scales by which efforts are the model's, of all joints and of each alone.

    Only those beyond the range of ``torque_scale``, a cause beside others.

    Args:
        few: Samples of a motion.
        usable: (N, n) their usable efforts.
        least: (n,) mean square of the model's known error, (N·m)².
    """
    arm = few.arm
    if arm.read_in == ANY_UNIT:
        return
    products = _products(few, usable)
    read, both, modelled = products.sum(axis=0).T
    like = both > _LIKE * np.sqrt(read * modelled)
    like &= (modelled > 0.0) & ~_clipped(few, usable)
    count = np.maximum(usable.sum(axis=0), 1)
    groups = [np.array([joint]) for joint in np.flatnonzero(like & few.moves)]
    if 2 * like.sum() > few.moves.sum():
        groups.insert(0, np.arange(arm.n))
    for joints in groups:
        used = joints[like[joints]]
        scale = _estimated_scale(products[:, used], count[used], least[used])
        own = tuple(joints.tolist()) if len(joints) == 1 < arm.n else ()
        factors = np.ones(arm.n)
        factors[joints] = 1.0 / scale.value
        where = f"the effort of {arm.joint_names[own[0]]} reads" if own else "all efforts read"
        words = (
            f"{where} {scale.shown} times the true ones"
            if not own
            else (f"{where} {scale.shown} times the true one")
        )
        reading = Reading(words, own, np.eye(arm.n), np.diag(factors), scale=scale)
        meaning = reading.effect.meaning("factor")
        if not meaning.least <= scale.value <= meaning.greatest:
            yield reading


def _products(few: MeasuredMotion, usable: Mask) -> Array:
    """Return (S, n, 3) sums over each span: of squares of the efforts, of the model's, and between.

    In the order effort², effort times model, model². Beside a constant, and beside friction and a
    rotor where the model comes from a file that states neither.
    """
    span = np.arange(len(few.q)) * _SCALE_SPANS // len(few.q)
    result = np.zeros((_SCALE_SPANS, few.arm.n, 3))
    for joint in range(few.arm.n):
        rows = usable[:, joint]
        columns = [np.ones(len(few.q))]
        if few.model.of_file and not few.static:
            speed = few.qd[:, joint]
            columns += [np.sign(speed), speed, few.qdd[:, joint]]
        beside = np.stack(columns, axis=1)[rows]
        pair = np.stack([few.effort[rows, joint], few.modelled[rows, joint]], axis=1)
        pair = pair - beside @ np.linalg.lstsq(beside, pair, rcond=None)[0]
        each = np.stack([pair[:, 0] ** 2, pair[:, 0] * pair[:, 1], pair[:, 1] ** 2], axis=1)
        np.add.at(result[:, joint], span[rows], each)
    return result


def _clipped(few: MeasuredMotion, usable: Mask) -> Mask:
    """Return (n,) joints whose efforts are the model's, clipped, as well as at another scale."""
    read, modelled = (np.where(usable, torque, 0.0) for torque in (few.effort, few.modelled))
    level = np.abs(read).max(axis=0)
    size = np.maximum((modelled**2).sum(axis=0), 1e-300)
    scaled = read - (read * modelled).sum(axis=0) / size * modelled
    clipped = read - np.clip(modelled, -level, level)
    left = _LEVEL * (clipped**2).sum(axis=0)
    return np.asarray((scaled**2).sum(axis=0) > left)


def _estimated_scale(products: Array, count: NDArray[np.int_], least: Array) -> Estimate:
    """Return the common scale of some joints' efforts, most likely: (S, m, 3), (m,), (m,)."""
    from scipy.optimize import minimize_scalar

    # Efforts may be predicted to a hundredth; less is the noise of few joints.
    least = least + 1e-4 * products[..., 2].sum(axis=0) / count

    def best(kept: Mask) -> float:
        read, both, modelled = products[kept].sum(axis=0).T / count

        def misfit(log: float) -> float:
            part = np.exp(-log)
            error = part**2 * read - 2.0 * part * both + modelled
            return float((0.5 * np.log(np.maximum(error, 0.0) + least) + log).sum())

        least_log, most_log = np.log(_SCALES).tolist()
        grid = np.linspace(least_log, most_log, _SCALE_GRID)
        middle = grid[int(np.argmin([misfit(log) for log in grid]))]
        step = grid[1] - grid[0]
        bounds = middle - step, middle + step
        options = {"xatol": 1e-5}
        found = minimize_scalar(misfit, bounds=bounds, method="bounded", options=options)
        return float(found.x)

    spans = np.arange(_SCALE_SPANS)
    whole = best(spans >= 0)
    # Efron and Tibshirani (1993), An Introduction to the Bootstrap, chapter 11: the jackknife.
    without = np.array([best(spans != number) for number in spans])
    error = np.sqrt((_SCALE_SPANS - 1) * np.mean((without - without.mean()) ** 2))
    low, value, high = (float(np.exp(whole + z * NORMAL_95 * error)) for z in (-1.0, 0.0, 1.0))
    return Estimate(value, low, high, "")
