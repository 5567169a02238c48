"""Blocks that are held out in turn: contiguous in time, and of equal phase where motion repeats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.identification.moments import Design
from dvrk_gravity.recording.data import Array

COUNT = 12
GAP = 0.3  # s on either side of a held-out block that nobody is fitted to
REPEATS = 0.05  # part of its spread by which a motion that repeats may differ from itself
SHORTEST = 2.0  # s, of a period


@dataclass(frozen=True, eq=False)
class Folds:
    """Which samples are held out together.

    Attributes:
        held_out: (n,) number of the fold in which a sample is held out.
        excluded: (folds, n) samples that the fold's fit may not see: those held out, and a gap.
        how: One sentence.
    """

    held_out: NDArray[np.int64]
    excluded: NDArray[np.bool_]
    how: str


def make_folds(design: Design, count: int = COUNT) -> Folds:
    """Cut the samples into folds.

    A motion that repeats with some period shows every fit the same poses again in every
    period; there, samples of the same phase are held out together.
    """
    held_out = np.zeros(len(design.y), dtype=np.int64)
    excluded = np.zeros((count, len(design.y)), dtype=bool)
    periods = []
    for index in np.unique(design.part):
        rows = np.flatnonzero(design.part == index)
        time = design.time[rows] - design.time[rows[0]]
        period = find_period(design.state.q[rows], design.rate)
        length = period or float(time[-1]) + 1.0 / design.rate
        periods.append(period)
        phase = (time % length) / length * count
        held_out[rows] = np.minimum(phase.astype(int), count - 1)
        gap = GAP * count / length
        for fold in range(count):
            distance = np.abs((phase - (fold + 0.5) + count / 2) % count - count / 2)
            if not period:
                distance = np.abs(phase - (fold + 0.5))
            excluded[fold, rows] = distance < 0.5 + gap
    text = (
        f"{count} blocks, each predicted by a fit to the others with a gap of {GAP:g} s; "
        "the choice of terms looked at them"
    )
    found = sorted({round(period, 2) for period in periods if period})
    if found:
        shown = ", ".join(f"{period:g}" for period in found)
        text += f"; the motion repeats every {shown} s, so equal phases are held out together"
    return Folds(held_out, excluded, text)


def find_period(position: Array, rate: float) -> float | None:
    """Return the period of (n, 7) positions, s; ``None`` if they do not repeat.

    The least lag from two seconds to two thirds of the length at which the motion comes back to
    itself, every joint to within 5 % of the spread of the motion.
    """
    spread = np.maximum(position.std(axis=0), 1e-3)
    scaled = (position - position.mean(axis=0)) / spread
    first, last = int(SHORTEST * rate), int(len(position) * 2 / 3)
    if last <= first:
        return None
    # |x(t) - x(t + lag)|^2 over all lags at once, through the autocorrelation.
    size = 2 * len(scaled)
    spectrum = np.fft.rfft(scaled, size, axis=0)
    product = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[: len(scaled)].sum(axis=1)
    power = np.cumsum(np.sum(scaled**2, axis=1))
    lags = np.arange(first, last)
    pairs = len(scaled) - lags
    both = power[pairs - 1] + power[-1] - power[lags - 1]
    difference = np.sqrt(np.maximum(both - 2.0 * product[lags], 0.0) / (pairs * scaled.shape[1]))
    good = difference < REPEATS * np.sqrt(2.0)
    if not good.any():
        return None
    start = int(np.argmax(good))
    stop = start + int(np.argmin(good[start:])) if not good[start:].all() else len(good)
    best = start + int(np.argmin(difference[start:stop]))
    return float(lags[best] / rate)
