"""Torque of any origin that acts for a moment: its gain at each joint, and at the tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.monitoring.change_test import ChangeTest
from dvrk_gravity.monitoring.limits import freedom
from dvrk_gravity.monitoring.observer import white_noise
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
_BESIDE = 4  # samples before and after a moment at rest: a third of a second. Chosen
_ROUNDING = 1e-9  # rad (Arm.scale), by which a position that does not change may differ
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

        By the moments whose gains are largest, between a twelfth and one; of that the geometric
        mean with one, since a cause lasts longer than a moment, and so do some errors: a simulated
        arm with .3 in its moments had 1.4 times that limit of friction for half a minute.
        """
        usual = np.max(self.total / self.count, axis=0)[:-1]
        return np.asarray(np.sqrt(np.clip(usual, _LEAST, 1.0)))

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

    At rest friction may hold a joint, and hides any torque up to its level; but what appears and is
    gone while the joint stands, but for yielding to it, comes from outside.

    Args:
        window: The samples.
        known: The uncertain directions as samples before the moments determine them.
        since: Index of the sample.
        tip: Where a force may act; ``None``: nowhere.
        blind: Indices of joints that are not looked at.
    """
    m, n = window.usable.shape
    # At rest what comes after a moment counts, and is waited for.
    moments = [
        slice(start, start + length)
        for length in _LENGTHS
        for start in range(max(since - _BESIDE - length + 1, 0), m - length + 1, _APART)
    ]
    columns = np.zeros((m, n, 1 if tip is None else 4))
    columns[:, :, 0] = 1.0
    if tip is not None:
        recent = slice(max(since - LONGEST_TRANSIENT, 0), m)
        jacobians = tip.velocity_jacobian(window.motion.true_q[recent])
        columns[recent, :, 1:] = jacobians.transpose(0, 2, 1)
    columns[:, list(blind)] = 0.0
    resting = window.with_rests()
    unexpected = resting.residual - resting.uncertain @ known.directions
    gain, torque = np.zeros((len(moments), n + 1)), np.zeros((len(moments), n))
    for index, moment in enumerate(moments):
        if moment.stop > since:
            found = _gains_of(moment, resting, known, columns[moment], unexpected[moment])
            gain[index], torque[index] = found
    at_rest, change = _gains_at_rest(moments, window)
    clearer = (at_rest > gain[:, :n]) & (columns[0, :, 0] > 0.0)
    gain[:, :n] = np.where(clearer, at_rest, gain[:, :n])
    torque = np.where(clearer, change, torque)
    begin, end = (np.array([getattr(moment, side) for moment in moments], dtype=np.int64)
                  for side in ("start", "stop"))  # fmt: skip
    return TransientTorques(begin, end, gain, torque)


def _gains_of(
    moment: slice, window: Window, known: ChangeTest, columns: Array, unexpected: Array
) -> tuple[Array, Array]:
    """Return (n + 1,) gains and (n,) torques of a moment, beside what is uncertain.

    Args:
        moment: Its samples.
        window: All, those of resting joints among them.
        known: The uncertain directions.
        columns: (s, n, 1 or 4) torque per unit of that at a joint, and of a force at the tip.
        unexpected: (s, n) whitened residual without the uncertain directions.
    """
    n = columns.shape[1]
    # Samples beside many that say nothing say little; what friction holds, at several joints at
    # once, lasts.
    rests = np.mean(window.motion.stuck[moment], axis=0) > 0.5
    usable = np.mean(window.usable[moment], axis=0) >= _SAYS
    if moment.stop - moment.start > _AT_REST:
        usable &= ~rests
    # What comes after may go on.
    white = np.where(usable[:, None], window.whiten(columns, moment), 0.0)
    joint, force = white[:, :, 0], np.where(rests[:, None], 0.0, white[:, :, 1:])
    directions = window.uncertain[moment]
    held = np.einsum("mn,mnd->nd", joint, directions)
    power, score = np.sum(joint**2, axis=0), np.sum(joint * unexpected, axis=0)
    power = np.where(power > 0.0, power, 1.0)
    gain = np.zeros(n + 1)
    gain[:n] = score**2 / (power + known.deviation_of(held) ** 2)
    if force.shape[2]:
        square = np.einsum("mnk,mnl->kl", force, force)
        shared = np.einsum("mnk,mnd->kd", force, directions)
        pull = np.einsum("mnk,mn->k", force, unexpected)
        spread = np.linalg.pinv(square + known.covariance_of(shared), _FLAT, hermitian=True)
        gain[n] = pull @ spread @ pull
    return gain, score / power


def _gains_at_rest(moments: Sequence[slice], window: Window) -> tuple[Array, Array]:
    """Return (p, n) gains and torques of what is there for a moment while a joint stands still.

    Compared with the torque before and after, measured and unexpected torque both differ by it: of
    a joint that friction holds, other joints' motion changes only one of these. And the joint
    yields against its motor: behind friction, a motor feels a push only by that. A torque that
    changes while the position does not is the controller's, or an error of its reading, and a joint
    that turns round slowly goes where its motor drives it.
    """
    m, n = window.usable.shape
    gain, torque = np.zeros((2, len(moments), n))
    known = replace(window, usable=window.available, error_factor=np.ones((m, n)))
    signals = np.stack([window.torque, window.measured_torque, window.motion.q])
    standing, rounding = window.motion.stuck & window.available, _ROUNDING * window.motion.arm.scale
    for index, moment in enumerate(moments):
        whole = slice(moment.start - _BESIDE, moment.stop + _BESIDE)
        if whole.start < 0 or whole.stop > m:
            continue
        time, count = window.time[whole], whole.stop - whole.start
        stands = standing[whole].all(axis=0)
        if not stands.any() or time[-1] - time[0] > count * window.step:
            continue
        own = signals[:, whole]
        beside = np.stack([own[:, :_BESIDE], own[:, -_BESIDE:]]).mean(axis=2)
        more = own[:, _BESIDE:-_BESIDE].mean(axis=1) - beside
        torques, moved = more[:, :2].reshape(4, n), more[:, 2]
        sign = np.sign(torques[0])
        noise = white_noise(own[2]) * np.sqrt(1.0 / _BESIDE + 1.0 / (count - 2 * _BESIDE))
        pushed = stands & (np.sign(torques) == sign).all(axis=0)
        pushed &= (-sign * moved > NORMAL_95 * noise + rounding).all(axis=0)
        torque[index] = np.where(pushed, sign * np.abs(torques).min(axis=0), 0.0)
        pulse = np.zeros((count, n))
        pulse[_BESIDE:-_BESIDE] = 1.0
        gain[index] = torque[index] ** 2 * np.sum(known.whiten(pulse, whole) ** 2, axis=0)
    return gain, torque
