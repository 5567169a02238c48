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
_BLOCK = 32  # samples whose recursion is one product. Chosen for time


@dataclass(frozen=True)
class LowPass:
    """A Butterworth low-pass run forward and backward.

    No phase shift; the amplitude at ``cutoff`` is one half (-6 dB), for either run takes
    1/sqrt(2). Ends are extended by ``edge`` samples, reflected about the end point.

    Attributes:
        cutoff: Cut-off frequency of one run, Hz.
        rate: Sampling rate, Hz.
        order: Order of one run.

    Raises:
        RecordingError: If the cut-off is not between 0 and half the rate.
    """

    cutoff: float
    rate: float
    order: int = ORDER

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
        return _design(self.cutoff, self.rate, self.order)[1]

    def __call__(self, array: Array) -> Array:
        """Return the filtered array; raise ``ShapeError`` for ``edge`` samples or fewer."""
        sections, edge = _design(self.cutoff, self.rate, self.order)
        array = np.asarray(array, dtype=np.float64)
        if array.ndim == 0 or len(array) <= edge:
            raise ShapeError("array", array.shape, f"more than {edge} samples to filter")
        before = 2.0 * array[0] - array[edge:0:-1]
        after = 2.0 * array[-1] - array[-2 : -edge - 2 : -1]
        whole = np.concatenate([before, array, after]).reshape(len(array) + 2 * edge, -1)
        blocks = np.empty((-(-len(whole) // _BLOCK), _BLOCK, whole.shape[1]))
        rows = blocks.reshape(len(blocks) * _BLOCK, -1)
        rows[: len(whole)] = whole
        for ahead in (True, False):
            rows[len(whole) :] = rows[len(whole) - 1]  # the way back begins at rest
            for section in sections:
                blocks = section(blocks, ahead)
            rows = blocks.reshape(rows.shape)
        return rows[edge : edge + len(array)].reshape(array.shape)

    def __str__(self) -> str:
        """Describe the filter, for reports."""
        return (
            f"zero-phase low-pass: Butterworth of order {self.order}, {self.cutoff:g} Hz, forward "
            f"and backward (half amplitude there); {self.edge} samples "
            f"({self.edge / self.rate:.2g} s) affected at either end"
        )


@dataclass(frozen=True)
class _Section:
    """One or two poles: y[n] = gain (1 + 1/z)^zeros x[n] - a1 y[n-1] - a2 y[n-2].

    SciPy has it, but loads for half a second. A block of samples is a product with the response,
    and goes on from the last two samples of the block before.

    Attributes:
        radius: Largest absolute value of a pole.
        own: (block, block) response to the samples of a block.
        carried: (block, 4) response to the last but one and the last sample before it, and to what
            they became.
    """

    radius: float
    own: Array
    carried: Array

    @classmethod
    def of(cls, a1: float, a2: float) -> _Section:
        """Return the section of two coefficients; it has one pole if ``a2`` is zero."""
        zeros = np.array([1.0, 2.0, 1.0] if a2 else [1.0, 1.0, 0.0])
        zeros *= (1.0 + a1 + a2) / zeros.sum()  # constants pass
        impulse = [0.0, 1.0]  # from the sample before on
        for _ in range(_BLOCK):
            impulse.append(-a1 * impulse[-1] - a2 * impulse[-2])
        alone = np.array(impulse[1:])
        response = np.convolve(alone[:-1], zeros)[:_BLOCK]
        lag = np.subtract.outer(np.arange(_BLOCK), np.arange(_BLOCK))
        last = zeros[1] * alone[:-1] + zeros[2] * np.append(0.0, alone[:-2])
        return cls(
            radius=float(np.sqrt(a2)) if a2 else abs(a1),
            own=np.where(lag >= 0, response[lag], 0.0),
            carried=np.stack([zeros[2] * alone[:-1], last, -a2 * alone[:-1], alone[1:]], axis=1),
        )

    def __call__(self, blocks: Array, ahead: bool) -> Array:
        """Return (B, block, k) samples filtered forward or backward, at rest before the first."""
        own, carried, last = self.own, self.carried, slice(-2, None)
        order = range(len(blocks))
        if not ahead:
            own, carried, last, order = own.T, carried[::-1], slice(1, None, -1), order[::-1]
        result = np.asarray(own @ blocks)
        before = np.stack([blocks[0, 0] if ahead else blocks[-1, -1]] * 4)
        for k in order:
            result[k] += carried @ before
            before[:2], before[2:] = blocks[k, last], result[k, last]
        return result


@cache
def _design(cutoff: float, rate: float, order: int) -> tuple[tuple[_Section, ...], int]:
    """Return Butterworth's sections and the length of the transient at an end, in samples.

    By the bilinear transform of the poles at angles of pi / order on a half circle, in pairs
    (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1).
    """
    warped = np.tan(np.pi * cutoff / rate)
    damping = 2.0 * np.sin(np.pi * np.arange(1, order, 2) / (2 * order))
    norm = 1.0 + damping * warped + warped**2
    sections = [
        _Section.of(a1, a2)
        for a1, a2 in zip(
            (2.0 * (warped**2 - 1.0) / norm).tolist(),
            ((1.0 - damping * warped + warped**2) / norm).tolist(),
            strict=True,
        )
    ]
    if order % 2:
        sections.append(_Section.of(float((warped - 1.0) / (warped + 1.0)), 0.0))
    radius = max(section.radius for section in sections)
    return tuple(sections), int(np.ceil(np.log(EDGE_LEVEL) / np.log(radius)))


def lowpass(array: Array, rate: float, cutoff: float, order: int = ORDER) -> Array:
    """Return ``LowPass(cutoff, rate, order)(array)``."""
    return LowPass(cutoff, rate, order)(array)


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
