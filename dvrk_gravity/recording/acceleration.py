"""Accelerations no faster than an encoder's steps let them be known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.filters import LowPass
from dvrk_gravity.recording.quantization import acceleration_error


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
    result = acceleration.copy()
    for joint in np.flatnonzero(step).tolist():
        result[:, joint] = _quiet(acceleration[:, joint], float(step[joint]), rate, band, settings)
    return result


def _quiet(
    values: Array, step: float, rate: float, band: float, settings: AccelerationSettings
) -> Array:
    """Return (N,) accelerations of one joint, low-passed as far as it takes."""
    cutoffs = np.geomspace(band, min(settings.slowest, band), settings.tried).tolist()
    quiet, seen = values, np.inf
    noisiest = acceleration_error(step, band, rate) ** 2
    for cutoff in cutoffs:
        low = LowPass(cutoff, rate)
        if len(values) <= low.edge:
            break
        slow = low(values)
        variance, noise = float(np.var(slow)), acceleration_error(step, cutoff, rate) ** 2
        if cutoff == band:  # all that is used of it: so much is left as it is
            seen = variance
        elif seen - variance > settings.taken * (noisiest - noise):
            break
        else:
            quiet = slow
        if noise <= settings.share * max(variance - noise, 0.0):
            break
    return quiet
