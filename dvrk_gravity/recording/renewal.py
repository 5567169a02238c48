"""Readings that are renewed more slowly than they are recorded: each value is held for a while.

A driver that publishes efforts of 20 Hz beside positions of 100 Hz, or a recorder that merges two
topics, repeats each value until the next one. Held for T, it is late by T / 2 in the mean: efforts
of a moving arm then show friction and damping that it does not have.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.recording.notes import merged, note
from dvrk_gravity.recording.quantization import quantum
from dvrk_gravity.recording.samples import QUANTITIES, Samples
from dvrk_gravity.recording.timing import moving, speed

# Hz, of renewals. Twice the cut-off of the motion's filter (MOTION_BAND, DEFAULT_CUTOFF): a
# recording of a lower rate cannot be used.
LEAST_RATE = 22.6
_HELD = 1.5  # samples that a value lasts in the mean. Chosen: late reads of real arms make 1.2
_SAMPLES, _RENEWALS = 300, 30  # while the joint moves, from which on it is judged. Chosen
# Part of a hold, or one sample, by which its length may vary, and part of the holds that must vary
# by no more. Chosen: readings in steps stay the same for any time.
_VARIES, _MOSTLY = 0.25, 0.8
# Part of a joint's RMS speed, and rad/s (a tenth in m/s), from which on it moves. Chosen: friction
# and weight then take another effort each time.
_MOVES, _SPEED = 0.1, 0.02
# Samples below which a hold may be a late read of any length, ten of which a clock makes as long as
# their mean within a sample, in most cases. Chosen: of those of a real MTM half are.
_SHORT, _TEN = 3.0, 0.7
_TOGETHER = 0.95  # part of the joints that a renewal changes, of all together. Chosen: a few repeat
_STEPS = 2.0  # of a quantised reading, that a renewal changes it by. Chosen likewise
# Holds of a quantity in those of whole samples, beyond which it has its own. Chosen.
OWN = 1.3


@dataclass(frozen=True)
class Hold:
    """A quantity that is renewed more slowly than it is recorded.

    Attributes:
        joints: (n,) those whose readings are held.
        samples: For which a value lasts, in the mean.
    """

    joints: Mask
    samples: float


def holds(recording: Samples) -> dict[str, Hold | None]:
    """Return by quantity what is held; ``None``: nothing, absent: too little motion to judge by.

    Readings are held if they stay the same for several samples while their joint moves, then change
    by more than their steps, and do so regularly or at all joints together. Velocities are compared
    with positions instead, and differentiated from these where they are late
    (``compare_velocity``).
    """
    if recording.time is None or len(recording) < _SAMPLES:
        return {}
    found: dict[str, Hold | None] = {}
    for quantity in ("position", "effort"):
        values = getattr(recording, quantity)
        if values is None:
            continue
        changed = np.diff(values, axis=0, prepend=np.nan) != 0.0
        counts = changed.sum(axis=0)
        if ((counts * _HELD > len(values)) | (counts == 1)).all():  # whether it moves or not
            found[quantity] = None
            continue
        goes = moving(recording) if quantity == "position" else _fast(recording)
        live = changed[:, counts > 1]
        together = live.shape[1] > 1 and live[live.any(axis=1)].mean() > _TOGETHER
        columns = zip(values.T, changed.T, goes.T, strict=True)
        lengths = [_lengths(*column, together) for column in columns]
        known = np.array([length is not None for length in lengths])
        if not known.any():
            continue
        mean = np.array([length or 0.0 for length in lengths])
        held = np.array([length >= _HELD for length in mean.tolist()])
        found[quantity] = None
        if held.any():
            joints = np.ones_like(held) if held[known].all() else held
            found[quantity] = Hold(joints, float(np.median(mean[held])))
    return found


def _fast(recording: Samples) -> Mask:
    """Return (N, n) where a joint moves, whatever the steps of its encoder."""
    rough = np.abs(speed(recording))
    typical = np.sqrt(np.mean(rough**2, axis=0))
    return np.asarray(rough > np.maximum(_MOVES * typical, _SPEED * recording.scale))


def _lengths(values: Array, changed: Mask, goes: Mask, together: bool) -> float | None:
    """Return the mean samples for which one joint's values are held; 0: none; ``None``: unknown.

    Args:
        values: (N,).
        changed: (N,) where they are new.
        goes: (N,) where the joint moves.
        together: Whether those of all joints are new at once.
    """
    rows = np.flatnonzero(changed)
    rests = np.append(0, np.cumsum(~goes))
    inside = rests[rows[1:]] == rests[rows[:-1]]
    lengths = np.diff(rows)[inside]
    if len(lengths) < _RENEWALS:
        return None
    mean = float(np.mean(lengths))
    regular = together or np.mean(np.abs(lengths - mean) <= max(1.0, _VARIES * mean)) >= _MOSTLY
    if mean < _SHORT and not together:
        ten = np.convolve(lengths, np.ones(10), "valid")
        regular &= np.mean(np.abs(ten - 10.0 * mean) <= 1.0) >= _TEN
    steps = np.abs(values[rows[1:]] - values[rows[:-1]])
    coarse = np.median(steps[inside]) < _STEPS * quantum(values)
    return mean if regular and not coarse else 0.0


def common(recording: Samples) -> float:
    """Return for how many samples all readings together stay the same while the arm moves."""
    some = moving(recording)[1:].any(axis=1)
    if not some.any():
        return 1.0
    changed = np.zeros(len(recording) - 1, dtype=bool)
    for quantity in QUANTITIES:
        values = getattr(recording, quantity)
        if values is not None:
            changed |= (np.diff(values, axis=0) != 0.0).any(axis=1)
    return float(some.sum() / max(int((changed & some).sum()), 1))


def renewed(samples: Samples) -> Samples:
    """Return a recording with held quantities interpolated between their renewals.

    Each value is taken for a reading at the first sample that has it. Quantities that are held
    together with all others are left as they are (``stale``), and those that are renewed more
    slowly than ``LEAST_RATE`` (``held``).
    """
    rate = samples.rate or 0.0
    found = {quantity: hold for quantity, hold in holds(samples).items() if hold is not None}
    if found and max(hold.samples for hold in found.values()) < OWN * common(samples):
        return samples
    known = {q: hold for q, hold in found.items() if rate >= LEAST_RATE * hold.samples}
    if not known:
        return samples
    notes = (
        note("held_readings", f"{in_words(samples, q, hold)}; interpolated between renewals")
        for q, hold in known.items()
    )
    return replace(_interpolated(samples, known), notes=merged((*samples.notes, *notes)))


def in_words(recording: Samples, quantity: str, hold: Hold) -> str:
    """Return what is held, and for how long."""
    rate = recording.rate or 0.0
    named = ", ".join(compress(recording.joints, hold.joints.tolist()))
    whose = "all joints" if hold.joints.all() else named
    return (
        f"{quantity} of {whose} is renewed at {rate / hold.samples:.3g} Hz, and recorded at "
        f"{rate:.3g} Hz: values are held for {1e3 * hold.samples / rate:.3g} ms"
    )


def _renewals(values: Array) -> NDArray[np.intp]:
    """Return the rows at which (N,) values change, the first one too."""
    return np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)


def _interpolated(block: Samples, known: dict[str, Hold]) -> Samples:
    """Return samples with their held quantities interpolated in time between renewals."""
    arrays: dict[str, Any] = {}
    assert block.time is not None
    for quantity, hold in known.items():
        values = getattr(block, quantity).copy()
        for joint in np.flatnonzero(hold.joints).tolist():
            rows = _knots(values[:, joint], hold.samples)
            values[:, joint] = np.interp(block.time, block.time[rows], values[rows, joint])
        values.flags.writeable = False
        arrays[quantity] = values
    return replace(block, **arrays)


def _knots(values: Array, samples: float) -> NDArray[np.intp]:
    """Return the rows of renewals of (N,) values, also of one that changed nothing."""
    rows = _renewals(values)
    following = np.append(rows[1:], len(values))
    late = following[following - rows > 2.0 * samples] - round(samples)
    return np.union1d(rows, late)
