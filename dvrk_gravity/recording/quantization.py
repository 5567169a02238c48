"""Quantised readings, such as an encoder's: their step, and the errors that it causes."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.filters import LowPass

QUANTUM_SAMPLES = 20_000  # looked at, at most: enough to see neighbouring steps
# Percentile of the distances between distinct values that is taken for one step. Chosen: the least
# ones may be rounding.
_PERCENTILE = 5.0
# Steps by which a distance may differ from a whole number, and part of the distances that must be
# whole. Chosen.
_WHOLE, _MOST = 0.1, 0.9
# Of an acceleration's variance, the part that may be steps: inertia that is fitted to it is too
# small by as much (Fuller 1987, Measurement Error Models, section 1.1). Chosen: a torque constant
# is known to two per cent.
_SHARE = 0.02
_SLOWEST = 1.0  # Hz; no lower cut-off. Chosen: as fast as arms swing at their usual speeds
_CUTOFFS = 12  # between that and the band
# Times the variance expected of steps, that a low-pass may remove: more is motion. Chosen.
_REMOVED = 2.0


def velocity_error(step: float, band: float, rate: float) -> float:
    """Return the RMS error that steps of a position give its derivative below a band.

    Rounding is white noise of variance step^2/12 (Bennett 1948), here through an ideal low-pass and
    a derivative.

    Args:
        step: Of the position.
        band: Hz.
        rate: Of independent errors, Hz: that of the samples, or of the steps if they are rarer.
    """
    return float(step / np.sqrt(12.0) * 2.0 * np.pi * band * np.sqrt(2.0 * band / rate / 3.0))


def acceleration_error(step: float, cutoff: float, rate: float) -> float:
    """Return the RMS error that steps of a position give its second derivative below a cut-off.

    As for :func:`velocity_error`, but behind two runs of a second-order Butterworth low-pass: the
    integral of x^4 / (1 + x^4)^2 over all x above zero is sqrt(2) pi / 16.

    Args:
        step: Of the position.
        cutoff: Of one run, Hz.
        rate: Of the samples, Hz.
    """
    density = step**2 / 12.0 / (rate / 2.0)
    passed = np.sqrt(2.0) * np.pi / 16.0
    return float((2.0 * np.pi) ** 2 * np.sqrt(density * passed * cutoff**5))


def quantum(values: Array) -> float:
    """Return the step of quantised values ``(N,)``, or 0 if they are not multiples of a step.

    The distances between neighbouring distinct values must all but a tenth be whole multiples of
    a small one of them. Of a long signal, samples spread over its length are looked at.
    """
    distinct = np.unique(values[:: 1 + len(values) // QUANTUM_SAMPLES])
    if len(distinct) < 3:
        return 0.0
    gaps = np.diff(distinct)
    # Distances of rounding size come from arithmetic on quantised values.
    gaps = gaps[gaps > 1e-9 * max(abs(distinct[0]), abs(distinct[-1]))]
    if not len(gaps):
        return 0.0
    step = float(np.percentile(gaps, _PERCENTILE))
    multiples = gaps / step
    whole = np.abs(multiples - np.round(multiples)) < _WHOLE
    return step if np.mean(whole) > _MOST else 0.0


def known_acceleration(acceleration: Array, step: Array, rate: float, band: float) -> Array:
    """Return (N, n) accelerations low-passed until little of them is the steps of positions.

    Steps are white noise of step / sqrt(12) up to half the rate (Bennett 1948); differentiated
    twice, its power grows with the fourth power of the frequency. Where that is too much of the
    acceleration below a band, it is low-passed as far as necessary, and no further than what is
    removed can be steps.

    Args:
        acceleration: (N, n) rad/s^2 or m/s^2.
        step: (n,) of the positions, rad or m; 0 of those that have none.
        rate: Hz.
        band: Hz; accelerations are used below this.
    """
    result = acceleration.copy()
    for joint in np.flatnonzero(step).tolist():
        result[:, joint] = _quiet(acceleration[:, joint], float(step[joint]), rate, band)
    return result


def _quiet(values: Array, step: float, rate: float, band: float) -> Array:
    """Return (N,) accelerations of one joint, low-passed as far as necessary."""
    cutoffs = np.geomspace(band, min(_SLOWEST, band), _CUTOFFS).tolist()
    quiet, seen = values, np.inf
    noisiest = acceleration_error(step, band, rate) ** 2
    for cutoff in cutoffs:
        low = LowPass(cutoff, rate)
        if len(values) <= low.edge:
            break
        slow = low(values)
        variance, noise = float(np.var(slow)), acceleration_error(step, cutoff, rate) ** 2
        if cutoff == band:  # the band that is used: not filtered further
            seen = variance
        elif seen - variance > _REMOVED * (noisiest - noise):
            break
        else:
            quiet = slow
        if noise <= _SHARE * max(variance - noise, 0.0):
            break
    return quiet
