"""Samples that a model was identified on: what it leaves of them shows what its error is like."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array

_BY_JOINT = ("q", "qd", "qdd", "effort")


@dataclass(frozen=True)
class KeptSettings:
    """How many samples are kept.

    Attributes:
        longest: s, the first ones. Chosen: some periods of an exciting motion, in a megabyte.
    """

    longest: float = 60.0


@dataclass(frozen=True, eq=False)
class CalibrationSamples:
    """N samples of a motion, and its efforts, in joint space.

    Attributes:
        q: (N, n) measured positions, rad or m.
        qd: (N, n) velocities.
        qdd: (N, n) accelerations.
        effort: (N, n) efforts behind the low-pass of the known error's band, N·m or N.
        part: (N,) number of the gap-free part that a sample is of, from 0 on.
        rate: Hz.
    """

    q: Array
    qd: Array
    qdd: Array
    effort: Array
    part: NDArray[np.int64]
    rate: float

    @classmethod
    def of(
        cls,
        parts: Iterable[tuple[Array, ...]],
        rate: float,
        settings: KeptSettings | None = None,
    ) -> CalibrationSamples | None:
        """Return thinned samples of gap-free parts; ``None`` if there are none.

        Args:
            parts: Positions, velocities, accelerations and efforts of each, (N, n).
            rate: Hz.
            settings: How many samples.
        """
        left = round((settings or KeptSettings()).longest * rate)
        kept: list[list[Array]] = []
        for part in parts:
            kept.append([array[:left] for array in part])
            left -= len(kept[-1][0])
            if left <= 0:
                break
        if not kept:
            return None
        number = np.repeat(np.arange(len(kept)), [len(arrays[0]) for arrays in kept])
        q, qd, qdd, effort = (np.concatenate(arrays) for arrays in zip(*kept, strict=True))
        return cls(q, qd, qdd, effort, number, rate)

    @property
    def parts(self) -> tuple[slice, ...]:
        """The gap-free parts."""
        edges = [0, *(np.flatnonzero(np.diff(self.part)) + 1).tolist(), len(self.part)]
        return tuple(slice(a, b) for a, b in pairwise(edges))

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return what a file holds; seven digits exceed sensors' resolution."""
        by_joint = {name: getattr(self, name).astype(np.float32) for name in _BY_JOINT}
        return {**by_joint, "part": self.part.astype(np.int32), "rate": np.array(self.rate)}

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, Array], joints: int, band: float
    ) -> CalibrationSamples:
        """Return the samples that a file holds.

        Args:
            arrays: By name.
            joints: Number of joints.
            band: Hz, bandwidth of their efforts.

        Raises:
            KeyError: Naming an array that is missing.
            ValueError: Saying what one had to be.
        """
        by_joint = {name: arrays[name] for name in _BY_JOINT}
        part, rate = arrays["part"], arrays["rate"]
        if part.ndim != 1 or not len(part):
            raise ValueError("calibration/part with one number a sample")
        for name, array in by_joint.items():
            if array.shape != (len(part), joints) or not np.isfinite(array).all():
                raise ValueError(f"finite calibration/{name} of shape {(len(part), joints)}")
        if not (np.isin(np.diff(part), (0.0, 1.0)).all() and part[:1] == [0.0]):
            raise ValueError("calibration/part that counts from 0")
        # As Nyquist has it.
        if rate.ndim or not 2.0 * band < rate < np.inf:
            raise ValueError(f"finite calibration/rate above {2.0 * band:g} Hz, twice the band")
        return cls(**by_joint, part=part.astype(np.int64), rate=float(rate))
