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
_BLOCK = 32  # samples; the fastest of 16 to 64 for 32 signals of 6000 samples
_FORGOTTEN = 1e-20  # part of a state, far below round-off
EDGE_LEVEL = 1e-3  # part of an end transient below which it does not count


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
        flat = array.reshape(len(array), -1)
        before, after = 2.0 * flat[0] - flat[edge:0:-1], 2.0 * flat[-1] - flat[-2 : -edge - 2 : -1]
        forward = _run(sections, np.concatenate([before, flat, after]))
        return _run(sections, forward[::-1])[::-1][edge:-edge].reshape(array.shape)

    def __str__(self) -> str:
        """Describe the filter, for reports."""
        return (
            f"zero-phase low-pass: Butterworth of order {self.order}, {self.cutoff:g} Hz, forward "
            f"and backward (half amplitude there); {self.edge} samples "
            f"({self.edge / self.rate:.2g} s) affected at either end"
        )


@dataclass(frozen=True, eq=False)
class _Section:
    """A recursive filter of first or second order, by blocks of samples.

    A block's output is that of its inputs from rest, and that of the s states at its beginning:
    products of matrices, which take no longer than SciPy's recursion and need not load
    ``scipy.signal``, a third of a second.

    Attributes:
        forced: (block + s, block) inputs -> outputs and the states at the end, from rest.
        free: (block, s) states -> outputs.
        step: (s, s) states -> states at the end.
    """

    forced: Array
    free: Array
    step: Array

    @classmethod
    def of(cls, pole: complex, real: bool) -> _Section:
        """Return the low-pass of a pole, and of its conjugate if it is not real, of gain 1."""
        past = np.array([-pole.real] if real else [-2.0 * pole.real, abs(pole) ** 2])
        inputs = np.array([1.0, 1.0] if real else [1.0, 2.0, 1.0])
        inputs *= (1.0 + past.sum()) / inputs.sum()
        # Transposed direct form II: y = inputs[0] u + state[0], state' = once state + into u.
        once = np.column_stack([-past, np.eye(len(past))[:, :-1]])
        into = inputs[1:] - past * inputs[0]
        powers = [np.eye(len(past))]
        for _ in range(_BLOCK):
            powers.append(once @ powers[-1])
        *along, step = powers
        pulse = np.array([inputs[0], *(power[0] @ into for power in along[:-1])])
        lag = np.subtract.outer(np.arange(_BLOCK), np.arange(_BLOCK))
        outputs = np.where(lag >= 0, pulse[np.maximum(lag, 0)], 0.0)
        at_end = np.column_stack([power @ into for power in reversed(along)])
        return cls(np.vstack([outputs, at_end]), np.array(along)[:, 0], step)

    def __call__(self, blocks: Array) -> Array:
        """Return (B, block, k) outputs of (B, block, k) inputs that follow a rest."""
        both = self.forced @ blocks
        states = np.zeros((len(self.step), *blocks.shape[::2]))
        states[:, 1:] = both[:-1, _BLOCK:].transpose(1, 0, 2)
        # What 1, 2, 4 … blocks before add to each, until they are forgotten.
        step, apart = self.step, 1
        while apart < len(blocks) and np.abs(step).max() > _FORGOTTEN:
            states[:, apart:] += np.tensordot(step, states[:, :-apart], 1)
            step, apart = step @ step, 2 * apart
        outputs = self.free @ states.transpose(1, 0, 2)
        outputs += both[:, :_BLOCK]
        return np.asarray(outputs)


def _run(sections: tuple[_Section, ...], array: Array) -> Array:
    """Return (N, k) signals through sections that had the first sample for ever before."""
    blocks = -(-len(array) // _BLOCK)
    padded = np.zeros((blocks * _BLOCK, array.shape[1]))
    np.subtract(array, array[0], out=padded[: len(array)])
    outputs = padded.reshape(blocks, _BLOCK, -1)
    for section in sections:
        outputs = section(outputs)
    return outputs.reshape(padded.shape)[: len(array)] + array[0]


@cache
def _design(cutoff: float, rate: float, order: int) -> tuple[tuple[_Section, ...], int]:
    """Return a Butterworth's sections and the length of the transient at an end, in samples.

    Its poles lie on a circle about zero; the bilinear transform brings them into the unit circle.
    """
    pairs = np.arange((order + 1) // 2)
    angles = 0.5 * np.pi * (1.0 + (2.0 * pairs + 1.0) / order)
    analog = np.tan(np.pi * cutoff / rate) * np.exp(1j * angles)
    poles = (1.0 + analog) / (1.0 - analog)
    sections = tuple(
        _Section.of(complex(pole), bool(2 * pair + 1 == order))
        for pair, pole in zip(pairs, poles, strict=True)
    )
    return sections, int(np.ceil(np.log(EDGE_LEVEL) / np.log(np.max(np.abs(poles)))))


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
