"""From which gain on a monitor reports a push, or a cause."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import SignificanceSettings
from dvrk_gravity.effects import Hypothesis
from dvrk_gravity.identification import OTHER_MOTION

Key = tuple[str, tuple[int, ...], str]

# By which gains grow in another motion than the calibration's, as the square of its known error.
_GAIN = OTHER_MOTION**2
# Degrees of freedom from which the errors of moments are known, as those of a motion are in a
# diagnosis: after reversals they are larger than on average.
_DOF = SignificanceSettings.dof
# Times the largest gain of the last minutes, below which another one is no push: of some arms rare
# errors (several joints that turn round at once) are far larger than their mean says. Chosen.
_ABOVE = 2.0


@dataclass(frozen=True, eq=False)
class Limits:
    """What gains a monitor expects without any change.

    Attributes:
        false_alarms: Tests of one second that may pass by chance, by white errors.
        of_causes: The largest gain that the calibration itself shows, by cause.
        of_pushes: (n + 1,) likewise of what acts for a moment, at each joint and at the tip.
        level: (n,) of errors: their mean square over that of errors as they are known.
    """

    false_alarms: float
    of_causes: Mapping[Key, float] = field(default_factory=dict)
    of_pushes: Array = field(default_factory=lambda: np.zeros(1))
    level: Array = field(default_factory=lambda: np.ones(1))

    def typical_gain(self, columns: Array) -> float:
        """Return the mean gain of (m, n, k) whitened columns without a change, over that expected.

        By the joints at which they act: of several parameters the largest.
        """
        power = np.sum(columns**2, axis=0)
        share = power / np.maximum(power.sum(axis=0), 1e-300)
        return float(np.sum(self.level[:, None] * share, axis=0).max())

    def cause_limit(self, hypothesis: Hypothesis, k: int, count: int, usual: float) -> float:
        """Return the gain from which on one of so many causes of k parameters is there.

        Args:
            hypothesis: The cause.
            k: Its parameters.
            count: How many there are.
            usual: Its gain where nothing happens, over that of known errors.
        """
        chance = float(_chi_square(self.false_alarms / count, k))
        return max(chance * usual, _GAIN * self.of_causes.get(hypothesis.key, 0.0))

    def push_limit(self, gain: Array, usual: Array, largest: Array) -> Array:
        """Return (p, n + 1) limits from which on one of as many gains of moments is no chance.

        Args:
            gain: (p, n + 1) gains.
            usual: (p, n + 1) their mean where nothing happens, over the degrees of freedom.
            largest: (n + 1,) the largest of late.
        """
        chance = _of_estimated(self.false_alarms / max(gain.size, 1), freedom(gain.shape[1] - 1))
        return np.maximum(np.maximum(chance * usual, _GAIN * self.of_pushes), _ABOVE * largest)


def freedom(n: int) -> Array:
    """Return (n + 1,) degrees of freedom of a gain at each joint, and of a force's: components."""
    return np.append(np.ones(n), 3.0)


def _of_estimated(chance: float, degrees: Array) -> Array:
    """Return what chi-square exceeds with a probability if its errors' variance is an estimate.

    That of k degrees of freedom is k times Fisher's F of k and ``_DOF``.
    """
    from scipy.special import betaincinv

    return np.asarray(_DOF * (1.0 / betaincinv(0.5 * _DOF, 0.5 * degrees, chance) - 1.0))


def _chi_square(chance: float, degrees: Array | int) -> Array:
    """Return what chi-square of some degrees of freedom exceeds with a probability."""
    from scipy.special import chdtri

    return np.asarray(chdtri(degrees, chance))
