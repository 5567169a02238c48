"""Accelerations no faster than an encoder's steps let them be known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.recording.data import Array
from dvrk_gravity.recording.filters import LowPass


@dataclass(frozen=True)
class AccelerationSettings:
    """How much of an acceleration may be an encoder's steps.

    Attributes:
        share: Of its variance: inertia that is fitted to it comes out too small by as much (Fuller
            1987, Measurement Error Models, section 1.1). Chosen: a torque constant is known to two
            per cent.
        slowest: Hz; no lower cut-off. Chosen: as fast as arms swing at their usual speeds.
        tried: Cut-offs between that and the band.
        taken: Times what steps would be of it, that a low-pass may take: more is motion. Chosen.
    """

    share: float = 0.02
    slowest: float = 1.0
    tried: int = 12
    taken: float = 2.0


# Of a fourth-power spectrum behind two runs of a second-order Butterworth low-pass:
# the integral of x^4 / (1 + x^4)^2 over all x above zero.
_PASSED = np.sqrt(2.0) * np.pi / 16.0


def known_acceleration(
    acceleration: Array, step: Array, rate: float, band: float,
    settings: AccelerationSettings | None = None,
) -> Array:  # fmt: skip
    """Return (N, n) accelerations in which no more than a little is the steps of positions.

    Steps are noise of step / sqrt(12), evenly over all frequencies up to half the rate (Bennett
    1948); differentiated twice it grows with the fourth power of the frequency. Where that is too
    much of what is seen below a band, the acceleration is low-passed as far as it takes, and no
    further than steps are what that takes away.

    Args:
        acceleration: (N, n) rad/s^2 or m/s^2.
        step: (n,) of the positions, rad or m; 0 of those that have none.
        rate: Hz.
        band: Hz; accelerations are used below this.
        settings: How much may be steps.
    """
    settings = settings or AccelerationSettings()
    slowest = min(settings.slowest, band)
    result = acceleration.copy()
    for joint in np.flatnonzero(step).tolist():
        density = step[joint] ** 2 / 12.0 / (rate / 2.0)
        fastest, noisiest = 0.0, 0.0
        for cutoff in np.geomspace(band, slowest, settings.tried).tolist():
            low = LowPass(cutoff, rate)
            if len(acceleration) <= low.edge:
                break
            slow = low(acceleration[:, joint])
            variance = float(np.var(slow))
            noise = (2.0 * np.pi) ** 4 * density * _PASSED * cutoff**5
            if cutoff == band:
                fastest, noisiest = variance, noise
            elif fastest - variance > settings.taken * (noisiest - noise):
                break
            else:
                result[:, joint] = slow
            if noise <= settings.share * max(variance - noise, 0.0):
                break
    return result
