"""The step of quantised readings, such as an encoder's."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.recording.samples import Array

QUANTUM_SAMPLES = 20_000


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
    step = float(np.percentile(gaps, 5))
    multiples = gaps / step
    whole = np.abs(multiples - np.round(multiples)) < 0.1
    return step if np.mean(whole) > 0.9 else 0.0
