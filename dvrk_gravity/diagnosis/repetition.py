"""Motion that repeats: its phase, and what differs between one period and the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.estimation.splits import RepetitionSettings, find_period

Array = NDArray[np.float64]

_LEAST_PAIRS = 2.0  # s of motion seen twice, below which nothing is said


@dataclass(frozen=True)
class Repetition:
    """A motion that comes back to itself.

    Attributes:
        period: s.
        copies: How often a phase is seen, in the mean.
    """

    period: float
    copies: float

    def phase(self, time: Array) -> Array:
        """Return (T,) phases in [0, 1) of times in s."""
        return np.asarray(time % self.period / self.period)

    def noise(self, time: Array, residual: Array, usable: NDArray[np.bool_]) -> Array:
        """Return (7,) root mean square of what does not come back after a period, N·m.

        Whatever a torque owes to the motion comes back with it. The difference of two copies holds
        the noise of both, hence the square root of two. NaN where too little is seen twice.

        Args:
            time: (T,) s.
            residual: (T, 7) N·m.
            usable: (T, 7) samples that say something.
        """
        from scipy.interpolate import CubicSpline

        step = float(np.median(np.diff(time)))
        later = time + self.period
        after = np.clip(np.searchsorted(time, later), 1, len(time) - 1)
        # Both neighbours of the moment a period later, and no gap between them.
        near = time[after] - time[after - 1] < 1.5 * step
        pair = usable & (usable[after] & usable[after - 1])
        pair &= (near & (later <= time[-1]))[:, None]
        difference = np.where(pair, CubicSpline(time, residual)(later) - residual, 0.0)
        count = pair.sum(axis=0)
        enough = count * step >= _LEAST_PAIRS
        square = 0.5 * (difference**2).sum(axis=0) / np.maximum(count, 1)
        return np.where(enough, np.sqrt(square), np.nan)


def find_repetition(
    q: Array, time: Array, parts: Sequence[slice], rate: float
) -> Repetition | None:
    """Return how a motion repeats; ``None`` if it does not.

    Parts share their phase, as those of one recording with gaps do; recordings that begin at
    different phases of one motion do not repeat in this sense.

    Args:
        q: (N, 7) positions, rad.
        time: (N,) s.
        parts: Contiguous parts, uniformly sampled.
        rate: Hz.
    """
    from scipy.interpolate import CubicSpline

    longest = max(parts, key=lambda part: part.stop - part.start)
    period = find_period(q[longest], rate)
    if period is None:
        return None
    start = time[longest][0]
    first = CubicSpline(time[longest], q[longest])(start + (time - start) % period)
    apart = (q - first) / np.maximum(q.std(axis=0), 1e-3)
    if np.sqrt(np.mean(apart**2)) > np.sqrt(2.0) * RepetitionSettings().tolerance:
        return None
    return Repetition(period, max(1.0, len(q) / rate / period))
