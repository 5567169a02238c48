"""Positions of a motion on a uniform grid, compared at every shift of one against another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array

Part = tuple[float, Array]  # s at which it begins, (n, m) positions


@dataclass(frozen=True, eq=False)
class Series:
    """Positions on a uniform grid, the mean of all that are there.

    Attributes:
        begin: Time of the first, s.
        rate: Hz.
        position: (n, m); zero where there is none.
        there: (n,) 1 where there is some, else 0.
    """

    begin: float
    rate: float
    position: Array
    there: Array

    @classmethod
    def of(cls, parts: Iterable[Part], rate: float) -> Series:
        """Return parts at common times on one grid."""
        parts = list(parts)
        begin = min(start for start, _ in parts)
        first = [round((start - begin) * rate) for start, _ in parts]
        length = max(at + len(position) for at, (_, position) in zip(first, parts, strict=True))
        total, count = np.zeros((length, parts[0][1].shape[1])), np.zeros(length)
        for at, (_, position) in zip(first, parts, strict=True):
            total[at : at + len(position)] += position
            count[at : at + len(position)] += 1.0
        return cls(begin, rate, total / np.maximum(count, 1.0)[:, None], np.minimum(count, 1.0))

    def scaled(self, middle: Array, spread: Array) -> Series:
        """Return positions in units of a spread about a middle."""
        scaled = (self.position - middle) / spread * self.there[:, None]
        return replace(self, position=scaled)

    def thinned(self, rate: float) -> Series:
        """Return the series at about a rate, no less."""
        step = max(1, int(self.rate / rate))
        return Series(self.begin, self.rate / step, self.position[::step], self.there[::step])

    @property
    def seen(self) -> Array:
        """(k, m) positions that there are."""
        return np.asarray(self.position[self.there > 0.0])


def compare(first: Series, second: Series, shifts: NDArray[np.int64]) -> tuple[Array, ...]:
    """Return what two series differ by with the second so many samples later.

    |x(t) - y(t - shift)|^2 over all shifts at once, through the Fourier transform. Positions must
    be in units of their spread.

    Returns:
        (k,) pairs of samples, (k,) mean square of the difference of a channel, (k,) mean variance
        of a channel of the first within the overlap.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(len(first.there) + len(second.there), real=True)
    there, position = rfft(first.there, size), rfft(first.position, size, axis=0)
    power = rfft((first.position**2).sum(axis=1), size)
    there_2, position_2 = (
        np.conj(rfft(values, size, axis=0)) for values in (second.there, second.position)
    )
    power_2 = np.conj(rfft((second.position**2).sum(axis=1), size))

    def at(spectrum: Array) -> Array:
        return np.asarray(irfft(spectrum, size, axis=0)[shifts])  # from the end, if negative

    pairs = np.round(at(there * there_2))
    count, channels = np.maximum(pairs, 1.0), first.position.shape[1]
    product = (position * position_2).sum(axis=1)
    difference = at(power * there_2 + there * power_2 - 2.0 * product)
    mean = at(position * there_2[:, None]) / count[:, None]
    square = at(power * there_2) / count
    variance = (square - (mean**2).sum(axis=1)) / channels
    return pairs, np.maximum(difference, 0.0) / (count * channels), np.maximum(variance, 0.0)


def spread_of(positions: Array) -> Array:
    """Return (m,) standard deviations of (n, m) positions, rounding's at least."""
    return np.asarray(np.maximum(positions.std(axis=0), 1e-3))


def run_around(good: NDArray[np.bool_], inside: int) -> slice:
    """Return the run of true values around one."""
    wrong = np.flatnonzero(~good)
    index = int(np.searchsorted(wrong, inside))
    start = int(wrong[index - 1]) + 1 if index else 0
    return slice(start, int(wrong[index]) if index < len(wrong) else len(good))
