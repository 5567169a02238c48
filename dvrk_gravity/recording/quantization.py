"""The step of quantised readings, such as an encoder's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array

QUANTUM_SAMPLES = 20_000  # looked at, at most: enough to see neighbouring steps


@dataclass(frozen=True)
class QuantumSettings:
    """When readings count as multiples of a step.

    Attributes:
        percentile: Of the distances between distinct values, which is taken for one step. Chosen:
            the least ones may be rounding.
        whole: Steps by which a distance may differ from a whole number. Chosen.
        most: Part of the distances that must be whole. Chosen.
    """

    percentile: float = 5.0
    whole: float = 0.1
    most: float = 0.9


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
    settings = QuantumSettings()
    step = float(np.percentile(gaps, settings.percentile))
    multiples = gaps / step
    whole = np.abs(multiples - np.round(multiples)) < settings.whole
    return step if np.mean(whole) > settings.most else 0.0
