"""Zero-phase low-pass filter and derivatives of uniformly sampled (N,) or (N, k) arrays.

The same filter is applied to positions, efforts and columns of a regressor: a linear model stays
true when both of its sides pass the same filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError, ShapeError

ORDER = 2
EDGE_LEVEL = 1e-3  # part of an end transient below which it does not count


@dataclass(frozen=True)
class LowPass:
    """A Butterworth low-pass run forward and backward.

    No phase shift; the amplitude at ``cutoff`` is one half (-6 dB), for either run takes
    1/sqrt(2). Ends are extended by ``edge`` samples, reflected about the end point.

    Attributes:
        cutoff: Cut-off frequency of one run, Hz.
        rate: Sampling rate, Hz.

    Raises:
        RecordingError: If the cut-off is not between 0 and half the rate.
    """

    cutoff: float
    rate: float

    def __post_init__(self) -> None:
        """Check the cut-off against the rate."""
        if not 0.0 < self.cutoff < self.rate / 2.0:
            raise RecordingError(
                "filter",
                f"cut-off {self.cutoff:g} Hz, expected above 0 and below {self.rate / 2:g} Hz, "
                f"half the sampling rate of {self.rate:g} Hz",
            )

    @property
    def edge(self) -> int:
        """Samples at either end within which one run's transient falls below ``EDGE_LEVEL``."""
        return _design(self.cutoff, self.rate)[1]

    def __call__(self, array: Array) -> Array:
        """Return the filtered array; raise ``ShapeError`` for ``edge`` samples or fewer."""
        from scipy.signal import sosfiltfilt

        sections, edge = _design(self.cutoff, self.rate)
        array = np.asarray(array, dtype=np.float64)
        if array.ndim == 0 or len(array) <= edge:
            raise ShapeError("array", array.shape, f"more than {edge} samples to filter")
        return np.asarray(sosfiltfilt(sections, array, axis=0, padlen=edge))

    def __str__(self) -> str:
        """Describe the filter, for reports."""
        return (
            f"zero-phase low-pass: Butterworth of order {ORDER}, {self.cutoff:g} Hz, forward "
            f"and backward (half amplitude there); {self.edge} samples "
            f"({self.edge / self.rate:.2g} s) affected at either end"
        )


@cache
def _design(cutoff: float, rate: float) -> tuple[Array, int]:
    """Return second-order sections and the length of the transient at an end, in samples."""
    from scipy.signal import butter

    sections = butter(ORDER, cutoff, fs=rate, output="sos")
    _, poles, _ = butter(ORDER, cutoff, fs=rate, output="zpk")
    return sections, int(np.ceil(np.log(EDGE_LEVEL) / np.log(np.max(np.abs(poles)))))


def white_density(square: Array, cutoff: float, rate: float) -> Array:
    """Return the density of white noise, in the signal's unit per sqrt(Hz).

    Args:
        square: Mean squares of what a :class:`LowPass` takes away from a signal.
        cutoff: Of that filter, Hz.
        rate: Of the samples, Hz.
    """
    frequency = np.linspace(0.0, rate / 2.0, 2000)
    # Two runs of a second-order Butterworth: amplitude 1 / (1 + (f / fc)^4).
    passed = np.mean((1.0 - 1.0 / (1.0 + (frequency / cutoff) ** 4)) ** 2)
    return np.asarray(np.sqrt(square / passed / (rate / 2.0)))


# Five-point differences: exact for polynomials of degree 4. At a tenth of the sampling rate the
# first derivative is 0.5 % low, where plain central differences would already be 6.5 % low.
_FIRST = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0
_SECOND = np.array([-3.0, -10.0, 18.0, -6.0, 1.0]) / 12.0


def derivative(array: Array, rate: float) -> Array:
    """Return the time derivative by five-point differences, one-sided for two samples at the ends.

    It amplifies noise: filter first. Fewer than five samples raise ``ShapeError``.
    """
    array = np.asarray(array, dtype=np.float64)
    if array.ndim == 0 or len(array) < 5:
        raise ShapeError("array", array.shape, "at least 5 samples to differentiate")
    result = np.empty_like(array)
    result[2:-2] = (array[:-4] - array[4:]) / 12.0 + (array[3:-1] - array[1:-3]) * (8.0 / 12.0)
    for row, weights in ((0, _FIRST), (1, _SECOND)):
        result[row] = np.tensordot(weights, array[:5], 1)
        result[-1 - row] = -np.tensordot(weights, array[:-6:-1], 1)
    return result * rate
