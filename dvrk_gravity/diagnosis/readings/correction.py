"""Wrong readings, corrected before effects are considered, and the hypotheses about the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.fit_context import FitContext
from dvrk_gravity.diagnosis.inference.held_out import JUDGEMENT, Gain, HeldOut
from dvrk_gravity.diagnosis.inference.infer import Hypotheses, ordinary_effects
from dvrk_gravity.diagnosis.inference.selection import Selection
from dvrk_gravity.diagnosis.readings.search import (
    ALPHA,
    ReadingScore,
    read_as,
    try_readings,
)
from dvrk_gravity.effects import Reading
from dvrk_gravity.estimation import bonferroni, likelihood_ratio

_SHARE = 0.7  # of the best effect's gain that a reading must reach, which explains most. Chosen
_ALTERNATIVE = 0.97  # of its gain, that another reading must reach to be listed. Chosen
_COMPARED = 4  # readings compared with the model's parameters free: a bound on time
_MOST = 3  # wrong readings found one after the other: a bound on time


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


def correct_readings(
    motion: MeasuredMotion, say: Callable[[str], None]
) -> tuple[list[WrongReading], Hypotheses]:
    """Return wrong readings, in the order of correction, and hypotheses about the motion as read.

    A better reading must gain about as much as the best effect does.
    """
    wrong: list[WrongReading] = []
    while True:
        context = ordinary_effects(motion)
        found = _better_reading(context) if len(wrong) < _MOST else None
        say("building hypotheses")
        about = Hypotheses.of(context)
        selection = Selection(context.validation, about.pool, say)
        if found is None or found.score.gain <= _SHARE * _best_gain(selection, context):
            return wrong, about
        say(f"wrong reading: {found.score.reading.words}")
        wrong.append(found)
        motion.release()
        motion = _corrected(motion, found.score.reading)
        del context, about, selection  # a long recording leaves no room for two


def _best_gain(selection: Selection, context: FitContext) -> float:
    """Return the gain of the best effect."""
    return max((trial.gain for trial in selection.best(context) if trial.plausible), default=0.0)


def _better_reading(present: FitContext) -> WrongReading | None:
    """Return what is wrong with the present reading, if another one is significantly better.

    The better one must pass a rough test, and gain with certainty on held-out blocks, with the
    model's parameters free within its uncertainty: with fixed ones, a wrong reading inside the
    identified range beats a right one outside it.
    """
    motion = present.validation.data.motion
    tried = try_readings(motion)
    scores, read = list[ReadingScore](), present
    for score in [score for score in tried if score.passes][:_COMPARED]:
        other = ordinary_effects(read_as(motion, score.reading))
        gain = _gain(score.reading, other, present)
        if gain > max((each.gain for each in scores), default=-np.inf):
            read = other
        scores.append(replace(score, gain=gain))
    if not scores:
        return None
    scores.sort(key=lambda score: -score.gain)
    held_out = HeldOut(read.validation)
    if motion.model.of_file:
        # What friction hides does not count, where a model states it poorly.
        before = HeldOut(present.validation).error(present.candidates)
        after = held_out.error(read.candidates)
    else:
        before = error_as_read(motion, read.validation.data, held_out)
        after = held_out.as_read()
    _, gained = reading_gain(scores[0], before, after, held_out)
    certain = gained.low > 0.0 and gained.relative > JUDGEMENT.least_removed
    old, new = present.score, read.score
    inflation = read.validation.inflation(new.error, old.error - new.error)
    p_value = likelihood_ratio(read.validation.gain(old, new, inflation), 1)
    if not (certain and bonferroni(p_value, len(tried)) < ALPHA):
        return None
    limit = _ALTERNATIVE * scores[0].gain
    others = tuple(score for score in scores[1:] if score.gain > limit)
    return WrongReading(scores[0], motion, others)


def _corrected(motion: MeasuredMotion, reading: Reading) -> MeasuredMotion:
    """Return a motion in another reading, its noise and its times included."""
    noise, rate = motion.noise, reading.rate
    motion = read_as(motion, reading)
    if reading.scale is not None:
        noise = noise * np.diag(reading.effort)
    if reading.clock is not None and motion.rate is not None:
        noise = noise / np.sqrt(rate)
        motion = replace(
            motion,
            time=motion.time / rate,
            rate=rate * motion.rate,
            rounding=motion.rounding / np.sqrt(rate),
        )
    return replace(motion, noise=noise)


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


def error_beside_ordinary(motion: MeasuredMotion) -> Array:
    """Return (H, n) held-out errors of a motion with the ordinary effects fitted."""
    context = ordinary_effects(motion)
    return HeldOut(context.validation).error(context.candidates)


def _gain(reading: Reading, read: FitContext, present: FitContext) -> float:
    """Return the log-likelihood gain of a reading, in the units of the efforts as recorded."""
    validation = read.validation
    scaled = float((validation.samples * (validation.weight > 0.0)) @ reading.density)
    return read.score.likelihood - present.score.likelihood - scaled
