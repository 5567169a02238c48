"""The same motion in two recordings: times at which one shows the states of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation.repetition import TOLERANCE, find_common_time

SAME_STATE = 0.02
"""Part of a motion's spread by which equal positions may differ, RMS over the joints. Chosen: a
controller holds an arm with a load a little lower, a PSM's yaw by 1.5 %; a motion as a whole may
differ by 5 % (``repetition.TOLERANCE``)."""

# s, after which a path has gone on if it is followed the same way. Chosen: where two paths only
# cross, they are far apart then.
_FURTHER = 1.0
# Times as far that the other may have gone meanwhile. Chosen: above the three of a rehearsal
# (``excite``).
_PACE = 4.0


@dataclass(frozen=True, eq=False)
class Track:
    """Gap-free parts of one recording.

    Attributes:
        time: By part, (N,) s, uniformly sampled, on the recording's clock.
        position: By part, (N, m).
    """

    time: Sequence[Array]
    position: Sequence[Array]

    def at(self, when: Array, values: Sequence[Array]) -> Array:
        """Return (n, …) values, given by part, at times within the parts; NaN elsewhere."""
        shape = values[0].shape[1:]
        found = np.full((len(when), *shape), np.nan)
        for time, part_values in zip(self.time, values, strict=True):
            inside = (when >= time[0]) & (when <= time[-1])
            flat = part_values.reshape(len(part_values), -1)
            columns = [np.interp(when[inside], time, column) for column in flat.T]
            found[inside] = np.stack(columns, axis=-1).reshape(-1, *shape)
        return found


def same_motion(track: Track, other: Track, rate: float) -> list[Array]:
    """Return the times at which another recording shows the states of a track.

    Both are brought to a common time (:func:`find_common_time`); if the motion repeats, any of its
    periods serves.

    Returns:
        By part of ``track``, sampled at ``rate`` Hz, (N,) times on the other's clock, or NaN.
    """
    resampled = [_resampled(t, q, rate) for t, q in zip(other.time, other.position, strict=True)]
    resampled = [(t, q) for t, q in resampled if len(t) > 1]
    parts = [*zip(track.time, track.position, strict=True), *resampled]
    numbers = np.repeat(np.arange(len(parts)), [len(time) for time, _ in parts])
    clock = [0] * len(track.time) + [1] * len(resampled)
    time, position = (np.concatenate(list(arrays)) for arrays in zip(*parts, strict=True))
    common = find_common_time(time, numbers, position, rate, clock)
    edges = np.flatnonzero(np.diff(numbers, prepend=-1, append=-1))
    rows = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    track_rows, other_rows = rows[: len(track.time)], rows[len(track.time) :]
    spread = np.maximum(np.std(np.concatenate(list(track.position)), axis=0), 1e-9)
    found = []
    for part, moved in zip(track_rows, track.position, strict=True):
        when = np.full(part.stop - part.start, np.nan)
        here, group = common.time[part], common.group[part][0]
        for other_part in other_rows:
            if common.group[other_part][0] != group:
                continue
            shift = common.time[other_part][0] - time[other_part][0]
            first, last = common.time[other_part][0], common.time[other_part][-1]
            for there in _periods(here, common.periods[group], first, last):
                open_ = np.isnan(when) & (there >= first) & (there <= last)
                when[open_] = there[open_] - shift
        shown = other.at(when, list(other.position))
        off = np.sqrt(np.mean(((moved - shown) / spread) ** 2, axis=1))
        found.append(np.where(off < SAME_STATE, when, np.nan))
    return found


def same_path(track: Track, other: Track) -> list[Mask]:
    """Return, by part of a track, (N,) masks of samples on the other's path, at any pace."""
    from scipy.spatial import KDTree

    position = np.concatenate(list(other.position))
    # So that a distance is the RMS over the joints, in parts of the motion's spread.
    unit = np.maximum(np.std(position, axis=0), 1e-9) * np.sqrt(position.shape[1])
    tree = KDTree(position / unit)
    when = np.append(np.concatenate(list(other.time)), np.nan)  # last: nothing is near
    found = []
    for time, moved in zip(track.time, track.position, strict=True):
        _, nearest = tree.query(moved / unit, distance_upper_bound=TOLERANCE)
        later = np.searchsorted(time, time + _FURTHER)
        inside = later < len(time)
        gone = when[nearest[np.where(inside, later, 0)]] - when[nearest]
        found.append(inside & (gone > 0.0) & (gone < _PACE * _FURTHER))
    return found


def _periods(time: Array, period: float | None, first: float, last: float) -> list[Array]:
    """Return times, and those whole periods away that may lie between two others."""
    if period is None:
        return [time]
    low = int(np.floor((first - time[-1]) / period))
    high = int(np.ceil((last - time[0]) / period))
    return [time + period * k for k in sorted(range(low, high + 1), key=abs)]


def _resampled(time: Array, position: Array, rate: float) -> tuple[Array, Array]:
    """Return a part at another rate."""
    count = int((time[-1] - time[0]) * rate + 1e-6) + 1
    fresh = time[0] + np.arange(count) / rate
    return fresh, np.column_stack([np.interp(fresh, time, column) for column in position.T])
