"""Causes of which recordings say different things: what all show on average is true of none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.diagnosis.candidate import Candidate, split
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.held_out import estimates
from dvrk_gravity.diagnosis.selection import SelectionSettings
from dvrk_gravity.estimation import squared_distance
from dvrk_gravity.recording import labels

REMEDY = "diagnose each recording alone"


@dataclass(frozen=True)
class DifferenceSettings:
    """When recordings differ about a cause.

    Attributes:
        alpha: Of the test that they do not: one in a thousand diagnoses of recordings that agree.
            Chosen.
        missed: Part of what one recording shows that the common value may be off by. Chosen: what
            is asked of a value that is told.
    """

    alpha: float = 1e-3
    missed: float = 0.2


@dataclass(frozen=True)
class Difference:
    """What each recording says of a cause about which they differ.

    Attributes:
        sentence: It in words.
        shown: Whether any of them shows it by itself.
    """

    sentence: str
    shown: bool


def difference(
    validation: CrossValidation, named: Sequence[Candidate], i: int, sources: Sequence[str]
) -> Difference | None:
    """Return what each recording says of a cause, ``None`` where they agree about it.

    They differ where one parameter for each explains it significantly otherwise (Wald's test of
    homogeneity), and a common one misses at some joint over a fifth of the torque that one of them
    shows, more than the model is known to miss, and more than stays unexplained.

    Args:
        validation: What compared hypotheses.
        named: The causes that were found.
        i: Which of them.
        sources: Of the recordings, by number.
    """
    from scipy.stats import chi2

    cause, data = named[i], validation.data
    seen = data.fold >= 0
    shown = [
        number
        for number in range(len(sources))
        if cause.values[(data.recording == number) & seen].any()
    ]
    # Of the model itself one recording may tell little; of what comes once, there is one.
    if len(shown) < 2 or cause.hypothesis.transient or cause.hypothesis.refits_model:
        return None
    divided = _divided(cause, data.recording, shown)
    candidates = [*named[:i], divided, *named[i + 1 :]]
    theta, covariance = validation.fit(candidates)
    first = sum(candidate.size for candidate in named[:i])
    rows = slice(first, first + divided.size)
    theta, covariance = theta[rows], covariance[rows, rows]
    count, size = len(shown), cause.size
    contrast = np.kron(np.eye(count)[1:] - np.eye(count)[0], np.eye(size))
    change = contrast @ theta
    settings = DifferenceSettings()
    apart = squared_distance(change, contrast @ covariance @ contrast.T)
    if chi2.sf(apart, len(change)) > settings.alpha:
        return None
    common = np.tile(split(named, validation.parameters(named))[i][1], count)
    known_error = SelectionSettings().least(validation)
    least = np.maximum(known_error, validation.score(candidates).rms)
    of_recording = [np.kron(unit, np.ones(size)) for unit in np.eye(count)]
    part = np.array([[np.mean(data.recording[seen] == number)] for number in shown])
    missed, each = (
        np.stack([validation.size(divided, mine * values) for mine in of_recording]) / np.sqrt(part)
        for values in (theta - common, theta)
    )
    if not np.any((missed > least) & (missed > settings.missed * each)):
        return None
    told, shows = [], False
    for number, mine in zip(shown, of_recording, strict=True):
        own = mine > 0.0
        values, spread = theta[own], covariance[np.ix_(own, own)]
        nothing = chi2.sf(squared_distance(values, spread), size) > settings.alpha
        shows |= not nothing
        claim = cause.hypothesis.claim(estimates(cause.hypothesis, values, spread, {}))
        told.append(f"{labels(sources)[number]}: {'nothing of it' if nothing else claim}")
    sentence = f"recordings differ about {cause.hypothesis.subject}: {'; '.join(told)}"
    return Difference(sentence, shows)


def _divided(cause: Candidate, recording: NDArray[np.int64], shown: Sequence[int]) -> Candidate:
    """Return a cause with parameters of its own in each recording."""
    values = [np.where((recording == n)[:, None, None], cause.values, 0.0) for n in shown]
    plausible = tuple(cause.hypothesis.prior_std) * len(shown)
    return replace(
        cause,
        hypothesis=replace(cause.hypothesis, prior_std=plausible),
        values=np.concatenate(values, axis=2),
    )
