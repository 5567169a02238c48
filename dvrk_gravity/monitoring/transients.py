"""Torque of any origin that acts for a moment: its gain at each joint, and at the tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.monitoring.change_test import ChangeTest
from dvrk_gravity.monitoring.limits import freedom
from dvrk_gravity.monitoring.window import Window
from dvrk_gravity.monitoring.wrench import Tip

# Samples, of moments at which any torque may act: a third of a second to two.
_LENGTHS = (4, 8, 16, 25)
LONGEST_TRANSIENT = max(_LENGTHS)
_APART = 3  # samples between two such moments
# Of the mean square of errors as they are known, below which none is believed. Beside the uncertain
# directions, flights of eight simulated arms show .05 to .3 of it (benchmark/monitor.py, seeds 110
# to 112), since a known error is that of motions to which nothing was fitted. Chosen.
_LEAST = 1.0 / 12.0
_BEFORE = 12.0  # moments of a length, of gain one, that count as known before any. Chosen: 3 s
_FLAT = 1e-9  # of the largest information on a force, that is rounding: no joint feels that way
_AT_REST = 8  # samples of the longest moment in which friction may hold a joint. Chosen
_SAYS = 0.75  # part of a moment's samples that has to say something. Chosen


@dataclass(frozen=True, eq=False)
class TransientTorques:
    """Torque of any origin that acts for a moment: at one joint, or of a force at the tip.

    Attributes:
        begin: (p,) index of each moment's first sample.
        end: (p,) of the one after its last.
        gain: (p, n + 1) of torque at each joint alone, then of a force; 0 where it is not known.
        torque: (p, n) torque at each joint alone, N·m; 0 where it is not known.
    """

    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    gain: Array
    torque: Array


@dataclass(frozen=True, eq=False)
class TypicalGains:
    """Mean gains of moments in which nothing happens, which are one where errors are as known.

    A model's error may last longer than it knows: the longer a moment, the larger its gain then.

    Attributes:
        total: (lengths, n + 1) sums of gains.
        count: (lengths, n + 1) how many that are known.
        largest: (n + 1,) the largest one, which is forgotten as the others are.
    """

    total: Array
    count: Array
    largest: Array

    @classmethod
    def begin(cls, n: int) -> TypicalGains:
        """Return the prior of n joints: as if some moments of gain one had been seen."""
        count = np.full((len(_LENGTHS), n + 1), _BEFORE)
        return cls(count * freedom(n), count, np.zeros(n + 1))

    def updated(self, found: TransientTorques, limit: Array, kept: float) -> TypicalGains:
        """Return the means with p further moments, up to their (p, n + 1) limits; old ones fade."""
        length = _length_of(found)
        total, count = kept * self.total, kept * self.count
        gain = np.minimum(found.gain, limit)
        np.add.at(total, length, gain)
        np.add.at(count, length, gain > 0.0)
        return TypicalGains(
            total, count, np.maximum(kept * self.largest, gain.max(axis=0, initial=0.0))
        )

    @property
    def level(self) -> Array:
        """(n,) mean square of each joint's errors over that of errors as they are known.

        By the moments whose gains are largest; between a twelfth and one.
        """
        usual = np.max(self.total / self.count, axis=0)[:-1]
        return np.asarray(np.clip(usual, _LEAST, 1.0))

    def for_transients(self, found: TransientTorques) -> Array:
        """Return (p, n + 1) mean gains of moments of these lengths, over the degrees of freedom.

        At least one: where it is less, rare errors (after reversals) are as large all the same.
        """
        usual = self.total / self.count / freedom(self.total.shape[1] - 1)
        return np.maximum(usual, 1.0)[_length_of(found)]


def _length_of(found: TransientTorques) -> NDArray[np.int64]:
    """Return (p,) the indices of moments' lengths."""
    return np.searchsorted(_LENGTHS, found.end - found.begin)


def transient_torques(
    window: Window, known: ChangeTest, since: int, tip: Tip | None, blind: Sequence[int] = ()
) -> TransientTorques:
    """Return gains and torques of moments that end after a sample.

    Args:
        window: The samples.
        known: The uncertain directions as samples before the moments determine them.
        since: Index of the sample.
        tip: Where a force may act; ``None``: nowhere.
        blind: Indices of joints that are not looked at.
    """
    m, n = window.usable.shape
    parts = [
        slice(start, start + length)
        for length in _LENGTHS
        for start in range(max(since - length + 1, 0), m - length + 1, _APART)
    ]
    at_joints = np.ones((m, n, 1))
    by_force = np.zeros((m, n, 3))
    if tip is not None:
        recent = slice(max(since - LONGEST_TRANSIENT, 0), m)
        jacobians = tip.velocity_jacobian(window.motion.true_q[recent])
        by_force[recent] = jacobians.transpose(0, 2, 1)
    columns = np.concatenate([at_joints, by_force], axis=2)
    columns[:, list(blind)] = 0.0
    uncertain = window.uncertain
    unexpected = window.residual - uncertain @ known.directions
    gain, torque = np.zeros((len(parts), n + 1)), np.zeros((len(parts), n))
    for index, part in enumerate(parts):
        # Samples beside many that say nothing say little; what friction holds, at several joints
        # at once, lasts.
        rests = np.mean(window.motion.stuck[part], axis=0) > 0.5
        usable = np.mean(window.usable[part], axis=0) >= _SAYS
        if part.stop - part.start > _AT_REST:
            usable &= ~rests
        # What comes after may go on.
        white = np.where(usable[:, None], window.whiten(columns[part], part), 0.0)
        joint, force = white[:, :, 0], white[:, :, 1:]
        directions, rest = uncertain[part], unexpected[part]
        held = np.einsum("mn,mnd->nd", joint, directions)
        power, score = np.sum(joint**2, axis=0), np.sum(joint * rest, axis=0)
        power = np.where(power > 0.0, power, 1.0)
        gain[index, :n] = score**2 / (power + known.deviation_of(held) ** 2)
        torque[index] = score / power
        if tip is None:
            continue
        force = np.where(rests[:, None], 0.0, force)
        square = np.einsum("mnk,mnl->kl", force, force)
        shared = np.einsum("mnk,mnd->kd", force, directions)
        pull = np.einsum("mnk,mn->k", force, rest)
        spread = np.linalg.pinv(square + known.covariance_of(shared), _FLAT, hermitian=True)
        gain[index, n] = pull @ spread @ pull
    begin, end = (np.array([getattr(part, side) for part in parts], dtype=np.int64)
                  for side in ("start", "stop"))  # fmt: skip
    return TransientTorques(begin, end, gain, torque)
