"""Noise that is drawn, and fits to it, for what estimation promises of repeated draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.signal import lfilter

from dvrk_gravity.estimation import NormalEquations, fit, omitted_columns, sandwich


def coloured(random: np.random.Generator, shape: tuple[int, ...], a: float) -> np.ndarray:
    """Draw AR(1) noise of variance one along the first axis."""
    noise = random.normal(size=(shape[0] + 200, *shape[1:]))
    return lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], noise, axis=0)[200:]


def band(share: float, count: int) -> tuple[float, float]:
    """Return within which a count's share lies in 99.9 % of all cases."""
    low, high = stats.binom.interval(0.999, count, share)
    return low / count, high / count


def fit_without(
    amplitude: float, random: np.random.Generator
) -> tuple[list[bool], list[bool], float, float, NDArray[np.float64]]:
    """Return whether intervals hold without and with what was omitted, and their mean widths.

    Then (2, 2) squared errors and their second moment with it. Two of forty columns are fitted; the
    others have random amplitudes, and all are correlated.
    """
    time = np.arange(1000) / 50.0
    waves = [f(k * 0.37 * time) for k in range(1, 21) for f in (np.sin, np.cos)]
    mixed = np.stack(waves, axis=1) @ (np.eye(40) + 0.2 * random.normal(size=(40, 40)))
    x, inside, outside = mixed[:, None], np.arange(2), np.arange(2, 40)
    truth = np.concatenate([[1.0, -2.0], amplitude * random.normal(size=38)])
    y = x @ truth + random.normal(size=(1000, 1))
    whole = NormalEquations.of(x, y)
    gram, side = whole.combined(np.ones(1))
    solution = fit(whole.select(inside), np.ones(1), np.full(2, 1e3))
    score = side - gram[:, inside] @ solution.theta
    level = float(np.mean((y - x[..., inside] @ solution.theta) ** 2))
    bare = sandwich(solution, level * gram[:2, :2])
    added = omitted_columns(solution, gram, score, level * gram, inside, outside, np.full(40, 1e3))
    full = replace(bare, omitted=added[:2, :2])
    held, widths = ([], []), ([], [])
    for k, unit in enumerate(np.eye(2)):
        for number, spread in enumerate((bare, full)):
            low, high = spread.interval(solution.theta[k], unit)
            held[number].append(low <= truth[k] <= high)
            widths[number].append(high - low)
    squares = np.array([(solution.theta - truth[:2]) ** 2, np.diag(full.total)])
    return *held, float(np.mean(widths[0])), float(np.mean(widths[1])), squares
