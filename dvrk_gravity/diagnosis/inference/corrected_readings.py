"""A recording that is read wrongly is read rightly before any physics is blamed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.diagnosis.data.candidate import Candidate, Score
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.loading import Loaded
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.inference.pool import prepared
from dvrk_gravity.diagnosis.inference.readings import (
    ReadingScore,
    ReadingSettings,
    WrongReading,
    in_true_time,
    read_as,
    try_readings,
)
from dvrk_gravity.diagnosis.inference.selection import Selection
from dvrk_gravity.diagnosis.inference.unstated import unstated
from dvrk_gravity.diagnosis.results.other_findings import as_read_before, reading_gain
from dvrk_gravity.estimation import bonferroni, likelihood_ratio


@dataclass(frozen=True)
class ReadRightlySettings:
    """When a recording is read in another way than it was given.

    Attributes:
        share: Part of the best hypothesis' gain that another reading of the recording must reach.
            Chosen: a wrong reading explains nearly all, a cause beside it some.
        alternative: ... and of its gain, that yet another must reach to be told beside it. Chosen.
        compared: Readings that are compared with the model's parameters moving: a bound on time.
        most: Wrong readings found one after the other: a bound on time.
    """

    share: float = 0.7
    alternative: float = 0.97
    compared: int = 4
    most: int = 3


_SETTINGS = ReadRightlySettings()


@dataclass(frozen=True, eq=False)
class ReadRightly:
    """A recording as it is to be read, and how it is not.

    Attributes:
        loaded: The motion.
        wrong: Wrong readings, in the order in which they were put right.
        validation: What compares hypotheses about the motion.
        pool: Hypotheses that need no search.
    """

    loaded: Loaded
    wrong: tuple[WrongReading, ...]
    validation: CrossValidation
    pool: list[Candidate]


def read_rightly(loaded: Loaded, say: Callable[[str], None]) -> ReadRightly:
    """Return the motion as it is to be read.

    Another reading must be significant by a rough measure, and by that of the hypotheses, by which
    it must do about as well as the best of them: the model's parameters move beside all of them, as
    far as it leaves them open. It must gain on the held-out blocks what a hypothesis must, with
    certainty.
    """
    say("building hypotheses")
    wrong: list[WrongReading] = []
    validation, pool = prepared(loaded.motion)
    # Of two recordings of one motion both are read alike.
    while loaded.motion.reference is None and len(wrong) < _SETTINGS.most:
        tried = try_readings(loaded.motion)
        passing = [score for score in tried if score.passes]
        if not passing:
            break
        beside = unstated(validation, pool)
        as_it_is = validation.score(beside)
        best = Selection(validation, pool, say).best(beside, as_it_is)
        possible = (trial.gain for trial in best if trial.plausible)
        least = _SETTINGS.share * max(possible, default=0.0)
        of_file = loaded.motion.model.of_file
        before = HeldOut(validation).error(beside) if of_file else None
        validation.release()
        del validation, pool, best  # of a long recording there is no room for two
        scores = _compared(loaded.motion, passing[: _SETTINGS.compared], as_it_is)
        say("building hypotheses")
        motion = read_as(loaded.motion, scores[0].reading)
        validation, pool = prepared(motion)
        beside = unstated(validation, pool)
        read = validation.score(beside)
        gain = _gain(scores[0], validation, as_it_is, read)
        held_out = HeldOut(validation)
        # What friction hides tells no reading from another, where a model says little of it.
        after = held_out.as_read() if before is None else held_out.error(beside)
        if before is None:
            before = as_read_before(loaded.motion, validation.data, held_out)
        _, gained = reading_gain(scores[0], before, after, held_out)
        # All that follows stands on it.
        certain = gained.low > 0.0 and gained.relative > held_out.settings.least_removed
        if gain <= least or not certain or not _significant(validation, as_it_is, read, len(tried)):
            del validation, pool
            validation, pool = prepared(loaded.motion)
            break
        say(f"wrong reading: {scores[0].reading.words}")
        limit = _SETTINGS.alternative * scores[0].gain
        alternatives = tuple(score for score in scores[1:] if score.gain > limit)
        wrong.append(WrongReading(scores[0], loaded.motion, alternatives))
        loaded = replace(loaded, motion=motion)
        if scores[0].reading.scale is not None:  # noise is scaled as all else is
            loaded = replace(loaded, floor=loaded.floor * np.diag(scores[0].reading.effort))
        if scores[0].reading.clock is not None:
            del validation, pool
            loaded = in_true_time(loaded, scores[0].reading)
            validation, pool = prepared(loaded.motion)
    return ReadRightly(loaded, tuple(wrong), validation, pool)


def _compared(
    motion: MeasuredMotion, scores: Sequence[ReadingScore], as_it_is: Score
) -> list[ReadingScore]:
    """Return readings by what they gain where the model's parameters move along, best first.

    With the model as it is, one that takes an arm to where the model was identified does better
    than one that is right, and leaves it where the model is extrapolated.
    """
    if len(scores) == 1:
        return list(scores)
    found = []
    for score in scores:
        read = read_as(motion, score.reading)
        if motion.model.of_file:
            validation, pool = prepared(read)
            beside = unstated(validation, pool)
        else:
            validation, beside = CrossValidation(FilteredData.of(read)), []
        gain = _gain(score, validation, as_it_is, validation.score(beside))
        found.append(replace(score, gain=gain))
    return sorted(found, key=lambda score: -score.gain)


def _gain(score: ReadingScore, validation: CrossValidation, as_it_is: Score, read: Score) -> float:
    """Return what a reading gains in log-likelihood, of the efforts that were read."""
    scaled = float((validation.samples * (validation.weight > 0.0)) @ score.reading.density)
    return read.likelihood - as_it_is.likelihood - scaled


def _significant(validation: CrossValidation, before: Score, after: Score, tried: int) -> bool:
    """Tell whether the best of some readings is more than chance."""
    inflation = validation.inflation(after.error, before.error - after.error)
    p_value = likelihood_ratio(validation.gain(before, after, inflation), 1)
    return bonferroni(p_value, tried) < ReadingSettings().alpha
