"""What an arm did: positions, velocities, accelerations and torques, in joint space."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State
from dvrk_gravity.estimation import band_noise
from dvrk_gravity.recording import Coordinates, LowPass, Note, labels

_BETWEEN = 1.0  # s, between recordings whose clocks started again. Chosen: they were apart


def noise_floor(noise: Sequence[Array], lengths: Sequence[int]) -> Array:
    """Return (n,) RMS noise of all of some motions, by that of each and its number of samples."""
    return np.asarray(np.sqrt(np.average(np.square(noise), axis=0, weights=lengths)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """N samples of an arm, in joint space, in uniformly sampled parts without gaps.

    Attributes:
        q: (N, n) positions, rad; of a joint that was not recorded, where it stood.
        qd: (N, n) velocities, rad/s; zero for static poses.
        qdd: (N, n) accelerations, rad/s^2; zero for static poses.
        effort: (N, n) measured torques, N·m; zero where not recorded.
        direction: (N, n) +1/-1 for static poses whose approach is known.
        time: (N,) s since ``start_ns``; the index for static poses.
        parts: Contiguous parts, uniformly sampled.
        rate: Hz; ``None`` for static poses.
        present: (n,) which joints were recorded.
        measured: (n,) motors whose torque was measured.
        invalid_effort: (N, n) samples whose effort is not a reading.
        invalid_motor_effort: (N, n) samples of motors whose torque is not.
        step: (n,) steps of the positions, rad.
        thinned: Every so-maniest recorded sample was kept.
        rounding: (n,) density of the noise that the steps of the efforts leave, N·m/sqrt(Hz).
        noise: (n,) density of the efforts' noise at high frequencies, N·m/sqrt(Hz); NaN: unknown.
        motor_noise: (n,) the same of the motors' torques.
        timed: Velocities were measured, which checks the clock.
        filter: The low-pass of efforts, at the rate of these samples; ``None`` for static poses.
        clock: Number of the recording that each part is of; default: all of one.
        start_ns: Absolute stamp of time 0, ns; 0 where it is not known.
        sources: Names of the recordings, by the numbers in ``clock``.
        coordinates: In which they were recorded.
        warnings: What the checks of the recordings found.
        processing_log: What was done to the recordings, a sentence each.
    """

    q: Array
    qd: Array
    qdd: Array
    effort: Array
    time: Array
    parts: tuple[slice, ...]
    rate: float | None
    present: Mask
    step: Array
    direction: Array | None = None
    measured: Mask = field(default_factory=lambda: np.full((), True))
    invalid_effort: Mask = field(default_factory=lambda: np.full((), False))
    invalid_motor_effort: Mask = field(default_factory=lambda: np.full((), False))
    thinned: int = 1
    rounding: Array = field(default_factory=lambda: np.full((), 0.0))
    noise: Array = field(default_factory=lambda: np.full((), np.nan))
    motor_noise: Array = field(default_factory=lambda: np.full((), np.nan))
    timed: bool = True
    filter: LowPass | None = None
    clock: tuple[int, ...] = ()
    start_ns: int = 0
    sources: tuple[str, ...] = ()
    coordinates: Coordinates = "joint"
    warnings: tuple[Note, ...] = ()
    processing_log: tuple[str, ...] = ()

    PER_SAMPLE: ClassVar[tuple[str, ...]] = (
        "q", "qd", "qdd", "effort", "direction", "invalid_effort", "invalid_motor_effort",
    )  # fmt: skip

    @classmethod
    def joined(cls, each: Sequence[Self]) -> Self:
        """Return observations of an arm, one after the other, in one time.

        It is that of the first; a clock that started again is shifted, for one arm was in one place
        at a time.
        """
        first = each[0]
        log = list(dict.fromkeys(line for one in each for line in one.processing_log))
        sources = tuple(source for one in each for source in one.sources)
        times = list[Array]()
        for number, one in enumerate(each):
            time = one.time
            if one.rate is not None:
                time = time + (one.start_ns - first.start_ns) * 1e-9
                if any(time[-1] >= other[0] and time[0] <= other[-1] for other in times):
                    later = max(other[-1] for other in times) - time[0] + _BETWEEN
                    time = time + later
                    name = labels(sources)[number]
                    log.append(f"{name}: its times count from {later:.6g} s on")
            times.append(time)
        values: dict[str, Any] = {}
        for name in cls.PER_SAMPLE:
            found = [one.samples(name) for one in each]
            known = [samples for samples in found if samples is not None]
            values[name] = np.vstack(known) if len(known) == len(found) else None
        ends = np.cumsum([0, *(len(one) for one in each)])
        for name in ("rounding", "noise", "motor_noise"):
            squares = np.ma.masked_invalid([getattr(one, name) ** 2 for one in each])
            values[name] = np.sqrt(squares.mean(axis=0).filled(np.nan))
        return replace(
            first,
            time=np.concatenate(times),
            parts=tuple(
                slice(begin + part.start, begin + part.stop)
                for begin, one in zip(ends.tolist(), each, strict=False)
                for part in one.parts
            ),
            clock=tuple(number for number, one in enumerate(each) for _ in one.parts),
            sources=sources,
            warnings=tuple(warning for one in each for warning in one.warnings),
            processing_log=tuple(log),
            **values,
        )

    def __len__(self) -> int:
        """Return the number of samples N."""
        return len(self.time)

    def samples(self, name: str) -> NDArray[Any] | None:
        """Return the (N, n) values of an attribute, if it has any."""
        values = getattr(self, name)
        return None if values is None else np.broadcast_to(values, self.q.shape)

    def at(self, rows: NDArray[np.int_] | slice, parts: tuple[slice, ...] | None = None) -> Self:
        """Return some samples, by default as one part."""
        values: dict[str, Any] = {}
        for name in self.PER_SAMPLE:
            found = self.samples(name)
            values[name] = None if found is None else found[rows]
        time = self.time[rows]
        return replace(self, time=time, parts=parts or (slice(0, len(time)),), **values)

    def split(self) -> Iterator[Self]:
        """Yield each part as an observation."""
        for part, number in zip(self.parts, self.clocks, strict=True):
            yield replace(self.at(part), clock=(number,))

    @property
    def clocks(self) -> tuple[int, ...]:
        """Number of the recording that each part is of."""
        return self.clock or (0,) * len(self.parts)

    @property
    def state(self) -> State:
        """(N, n) positions, velocities, accelerations."""
        return State(self.q, self.qd, self.qdd)

    def motor_effort(self, arm: Arm) -> Array:
        """Return (N, n) torques at the motors, N·m; zero where not measured."""
        return np.where(self.measured, arm.actuator_effort(self.effort), 0.0)

    def noise_left(self, coordinates: Coordinates) -> Array:
        """Return (n,) RMS noise that the filter leaves of efforts at joints or motors, N·m."""
        assert self.filter is not None
        density = self.noise if coordinates == "joint" else self.motor_noise
        return np.broadcast_to(band_noise(density, self.filter.cutoff), self.q.shape[1])
