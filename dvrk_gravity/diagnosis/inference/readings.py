"""Wrong readings, corrected before effects are considered, and the hypotheses about the motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, Score, split
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.loading import Loaded
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.beside import Beside
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import Gain, HeldOut
from dvrk_gravity.diagnosis.inference.nonlinear import begun
from dvrk_gravity.diagnosis.inference.reading_search import (
    ALPHA,
    ReadingScore,
    read_as,
    try_readings,
)
from dvrk_gravity.diagnosis.inference.selection import Selection
from dvrk_gravity.effects import Hypothesis, Reading
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
    """Return the motion as it is to be read; two recordings of one motion were read equally."""
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
    best = Selection(validation, pool, say).best(Beside(validation, tuple(beside)))
    least = _SHARE * max((trial.gain for trial in best if trial.plausible), default=0.0)
    before = HeldOut(validation).error(beside) if motion.model.of_file else None
    motion.release()
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
    if not (enough and certain and bonferroni(p_value, len(tried)) < ALPHA):
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
            validation, beside = CrossValidation.of(FilteredData.of(read)), []
        gain = _gain(score, validation, present, validation.score(beside))
        found.append(replace(score, gain=gain))
    return sorted(found, key=lambda score: -score.gain)


def _gain(score: ReadingScore, validation: CrossValidation, present: Score, read: Score) -> float:
    """Return the log-likelihood gain of a reading, in the units of the efforts as recorded."""
    scaled = float((validation.samples * (validation.weight > 0.0)) @ score.reading.density)
    return read.likelihood - present.likelihood - scaled


def hypotheses(motion: MeasuredMotion) -> Iterable[Hypothesis]:
    """Yield every hypothesis that needs no search in the residual."""
    for effect in effects.effects():
        yield from effect.hypotheses(motion)


def prepared(motion: MeasuredMotion) -> tuple[CrossValidation, list[Candidate]]:
    """Return the filtered data of a motion, ready for comparisons, and these hypotheses."""
    validation = CrossValidation.of(FilteredData.of(motion))
    pool = [
        candidate
        for candidate in validation.data.candidates(hypotheses(motion))
        if candidate.acts.any()
    ]
    beside = baseline_effects(validation, pool)
    return validation, [begun(validation, candidate, beside) for candidate in pool]


def baseline_effects(validation: CrossValidation, pool: Sequence[Candidate]) -> list[Candidate]:
    """Return the effects that any joint has and an arm's own file states poorly.

    Only those of plausible size. Where an identified model is tested, only a load that is stated.

    Args:
        validation: The samples.
        pool: Hypotheses that need no search.
    """
    names = {term.NAME for term in effects.terms() if term.EVERYWHERE}
    names &= poorly_stated(validation.data.motion)
    found: dict[tuple[str, tuple[int, ...]], Candidate] = {}
    for candidate in pool:
        hypothesis = candidate.hypothesis
        if hypothesis.STATED or (hypothesis.effect in names and candidate.size == 1):
            found.setdefault((hypothesis.effect, hypothesis.joints), candidate)
    expected = list(found.values())
    while expected:
        fitted = split(expected, validation.parameters(expected))
        kept = [each for each, theta in fitted if each.hypothesis.plausible(theta)]
        if len(kept) == len(expected):
            break
        expected = kept
    return expected


def poorly_stated(motion: MeasuredMotion) -> set[str]:
    """Return the effects that an arm's own file states poorly: friction, rotors.

    Its values are often placeholders, such as one damping for all joints.
    """
    if not motion.model.of_file or motion.reference is not None:
        return set()
    return {term.NAME for term in effects.terms() if term.EVERYWHERE or term.FRICTION}
