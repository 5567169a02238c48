"""Hypotheses searched for in the residual: ripple, contact, and structure without a name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS
from dvrk_gravity.diagnosis.columns_friction import spread
from dvrk_gravity.diagnosis.filtered_data import FilteredData
from dvrk_gravity.diagnosis.hypothesis import Hypothesis
from dvrk_gravity.diagnosis.motion import Motion

Array = NDArray[np.float64]
Setting = Mapping[str, float]

_FREQUENCIES = 240
_TOGETHER = 24  # frequencies that are built at a time
_LEAST_CYCLES = 1.7  # in the joint's whole way: less is a cable's smooth torque
_BIN = 0.25  # s
_SHORTEST, _LONGEST = 0.75, 0.5  # s, and part of the recording
_LONGEST_GAP = 10.0  # s; twice a block that is held out of ten minutes, see data.BLOCKS
_EDGES = (55.0, 62.0, 69.0, 76.0, 83.0, 90.0)  # percentiles of the position
_CENTRES = 7


@dataclass(frozen=True, eq=False)
class RippleBasis:
    """Sines of one motor's angle at every frequency that is looked at.

    Attributes:
        motor: Index of the motor.
        row: (7,) joint velocities -> the motor's.
        grid: (K,) rad of phase per rad.
        cosine: (T, K) as the data compares them, in single precision: they only show where to
            look.
        sine: (T, K).
    """

    motor: int
    row: Array
    grid: Array
    cosine: NDArray[np.float32]
    sine: NDArray[np.float32]


def ripple_bases(data: FilteredData) -> list[RippleBasis]:
    """Return the sines for every motor that moves."""
    motion = data.motion
    bases: list[RippleBasis] = []
    if motion.static:
        return bases
    to_motor = motion.arm.joint_to_actuator
    for motor in range(N_JOINTS):
        row = to_motor[motor]
        if not motion.moves[row != 0].all():
            continue
        angle = motion.q @ row
        grid = (2.0 * _LEAST_CYCLES + 0.5 * np.arange(_FREQUENCIES)) * np.pi / np.ptp(angle)
        waves: list[NDArray[np.float32]] = []
        for some in np.split(grid, _FREQUENCIES // _TOGETHER):
            reduced = data.reduce(np.exp(1j * angle[:, None] * some).view(float))
            waves.append(reduced.astype(np.float32))
        cosine, sine = (np.hstack([wave[:, first::2] for wave in waves]) for first in (0, 1))
        bases.append(RippleBasis(motor, row, grid, cosine, sine))
    return bases


def ripple(bases: Iterable[RippleBasis], residual: Array, weight: Array) -> Iterator[Hypothesis]:
    """Yield the best ripple of every motor in what is left.

    Args:
        bases: From :func:`ripple_bases`.
        residual: (T, 7) what the accepted effects leave, N·m.
        weight: (T, 7) weights; zero where the choice must not look.
    """
    for basis in bases:
        # What each unit of motor torque would explain.
        target = (residual * weight) @ basis.row
        scale = weight @ basis.row**2
        power = np.zeros(len(basis.grid))
        for wave in (basis.cosine, basis.sine):
            power += (target @ wave) ** 2 / np.maximum(scale @ wave**2, 1e-30)
        yield _cogging(basis.motor, basis.row, float(basis.grid[np.argmax(power)]))


def _cogging(motor: int, row: Array, cycles: float) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        angle = setting["cycles_per_revolution"] * (motion.q @ row)
        return spread(row, np.cos(angle), np.sin(angle))

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        return {
            "amplitude": float(np.hypot(*theta)),
            "cycles_per_revolution": setting["cycles_per_revolution"],
            "phase": float(np.arctan2(-theta[1], theta[0])),
        }

    return Hypothesis(
        "cogging", (motor,), "motor", build, describe,
        {"cycles_per_revolution": cycles}, ("cycles_per_revolution",),
        prior_count=_FREQUENCIES,
    )  # fmt: skip


def contact(
    data: FilteredData, residual: Array, allowed: NDArray[np.bool_]
) -> Iterator[Hypothesis]:
    """Yield the window of time in which each joint is pushed most, and walls in positions.

    Args:
        data: The data.
        residual: (T, 7) what the accepted effects leave, N·m.
        allowed: (T,) samples that the choice may look at.
    """
    motion = data.motion
    for joint in np.flatnonzero(motion.moves).tolist():
        for percentile in _EDGES:
            for side, edge in ((1.0, percentile), (-1.0, 100.0 - percentile)):
                position = float(np.percentile(motion.q[:, joint], edge))
                yield _wall(joint, side, position)
    if motion.static:
        return
    for joint in np.flatnonzero(motion.present).tolist():
        window = _window(data.time[allowed], residual[allowed, joint])
        if window is None:
            continue
        begin, end = window
        # What lasts as long as the choice may look is taken to last as long as the recording.
        if end >= data.time[allowed].max() - _BIN:
            end = float(motion.time[-1]) + _BIN
        if begin <= data.time[allowed].min() + _BIN:
            begin = float(motion.time[0])
        yield _push(joint, begin, end)


def _window(time: Array, residual: Array) -> tuple[float, float] | None:
    order = np.argsort(time, kind="stable")
    time, residual = time[order], residual[order]
    # All pairs of bins are tried: of a long time without a sample there are to be few.
    cut = np.cumsum(np.maximum(np.diff(time, prepend=time[0]) - _LONGEST_GAP, 0.0))
    time = time - cut
    start, end = float(time[0]), float(time[-1])
    count = int((end - start) / _BIN)
    if count < 12:
        return None
    index = np.minimum(((time - start) / _BIN).astype(int), count - 1)
    number = np.bincount(index, minlength=count)
    centred = residual - np.median(residual)
    sums = np.concatenate([[0.0], np.cumsum(np.bincount(index, centred, minlength=count))])
    numbers = np.concatenate([[0], np.cumsum(number)])
    first, last = np.triu_indices(count + 1, k=round(_SHORTEST / _BIN))
    inside = numbers[last] - numbers[first]
    usable = (inside > 0) & (last - first < _LONGEST * count)
    power = np.where(usable, (sums[last] - sums[first]) ** 2 / np.maximum(inside, 1), 0.0)
    best = int(np.argmax(power))
    begin, stop = (start + _BIN * float(edge[best]) for edge in (first, last))
    inner = np.searchsorted(time, [begin, stop]) - [0, 1]  # its first and last sample
    begin_cut, stop_cut = cut[np.clip(inner, 0, len(time) - 1)].tolist()
    return begin + begin_cut, stop + stop_cut


def _push(joint: int, start: float, end: float) -> Hypothesis:
    row = np.eye(N_JOINTS)[joint]

    def build(motion: Motion, setting: Setting) -> Array:
        inside = (motion.time >= setting["start"]) & (motion.time < setting["end"])
        return spread(row, inside.astype(float))

    return Hypothesis(
        "contact", (joint,), "for a while", build,
        lambda theta, setting: {"torque": float(theta[0]), **setting},
        {"start": start, "end": end}, ("start", "end"), variable="time", prior_count=200,
    )  # fmt: skip


def _wall(joint: int, side: float, position: float) -> Hypothesis:
    row = np.eye(N_JOINTS)[joint]

    def build(motion: Motion, setting: Setting) -> Array:
        depth = side * (motion.q[:, joint] - setting["position"])
        return spread(row, np.maximum(depth, 0.0))

    return Hypothesis(
        "contact", (joint,), "above a position" if side > 0 else "below a position", build,
        lambda theta, setting: {"stiffness": float(side * theta[0]), **setting},
        {"position": position}, ("position",), prior_count=len(_EDGES),
    )  # fmt: skip


def nameless(motion: Motion, joints: Sequence[int]) -> Iterator[Hypothesis]:
    """Yield smooth functions of every variable on some joints: structure without a name."""
    variables: list[tuple[str, str, Array]] = []
    for other in np.flatnonzero(motion.moves).tolist():
        name = JOINT_NAMES[other]
        variables.append((f"position of {name}", "position", motion.q[:, other]))
        if not motion.static:
            variables.append((f"velocity of {name}", "velocity", motion.qd[:, other]))
            variables.append((f"acceleration of {name}", "acceleration", motion.qdd[:, other]))
    for joint in joints:
        for name, kind, values in variables:
            yield _smooth(joint, name, kind, values)
        if not motion.static:
            yield _smooth(joint, "time", "time", motion.time)
            if motion.moves[joint]:
                for other in np.flatnonzero(motion.moves).tolist():
                    where = motion.q[:, other]
                    yield _modulated(joint, f"its direction and position of {JOINT_NAMES[other]}",
                                     where)  # fmt: skip
        for other in np.flatnonzero(motion.moves).tolist():
            if other != joint and motion.moves[joint]:
                yield _product(joint, other)


def _hats(values: Array, centres: Array) -> Array:
    width = float(np.median(np.diff(centres)))
    return np.exp(-0.5 * ((values[:, None] - centres) / width) ** 2)


def _smooth(joint: int, name: str, kind: str, values: Array) -> Hypothesis:
    row = np.eye(N_JOINTS)[joint]
    low, high = np.percentile(values, [1.0, 99.0])
    count = 12 if kind == "time" else _CENTRES
    centres = np.linspace(low, max(high, low + 1e-6), count)

    def build(motion: Motion, setting: Setting) -> Array:
        del motion, setting
        return spread(row, *_hats(np.clip(values, low, high), centres).T)

    return Hypothesis("unknown", (joint,), name, build, _magnitude, variable=kind)


def _modulated(joint: int, name: str, values: Array) -> Hypothesis:
    row = np.eye(N_JOINTS)[joint]
    low, high = np.percentile(values, [1.0, 99.0])
    centres = np.linspace(low, max(high, low + 1e-6), 5)

    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        hats = _hats(np.clip(values, low, high), centres)
        return spread(row, *(motion.sign(row)[:, None] * hats).T)

    return Hypothesis("unknown", (joint,), name, build, _magnitude, variable="position")


def _product(joint: int, other: int) -> Hypothesis:
    row = np.eye(N_JOINTS)[joint]

    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        middle, half = motion.travel
        x = np.clip((motion.q - middle) / half, -1.1, 1.1)
        mine = np.polynomial.chebyshev.chebvander(x[:, joint], 3)
        theirs = np.polynomial.chebyshev.chebvander(x[:, other], 3)
        columns = [mine[:, i] * theirs[:, j] for i in range(4) for j in range(4) if i + j]
        return spread(row, *columns)

    name = f"positions of {JOINT_NAMES[joint]} and {JOINT_NAMES[other]} together"
    return Hypothesis("unknown", (joint,), name, build, _magnitude)


def _magnitude(theta: Array, setting: Setting) -> dict[str, float]:
    del setting
    return {"rms": float(np.sqrt(np.mean(theta**2)))}
