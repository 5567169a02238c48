"""Ripple of a motor's torque, periodic in its angle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value, check_count, numbers, position_offset
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Filtered, Motion, Residual, State
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.effects.base.term import Term
from dvrk_gravity.parameters import Parameter, Value

_FIELDS = (
    ("amplitude", "N·m", "amplitude of each ripple"),
    ("cycles_per_revolution", "1/rev", "ripples in a turn of the motor's shaft after the gear"),
    ("phase", "rad", "phase of each ripple at zero"),
)
MOST_RIPPLES = 8  # of one motor
_FREQUENCIES = 240
_TOGETHER = 24  # frequencies that are built at a time
_LEAST_CYCLES = 1.7  # in the joint's whole way: less is a cable's smooth torque


@dataclass(frozen=True, eq=False)
class Cogging(Term):
    """tau = amplitude cos(cycles_per_revolution x + phase), at the motors, x the motor's angle.

    Attributes:
        arm: The arm, for its transmission.
        motor: (K,) index of the motor of each ripple.
        amplitude: (K,) N·m.
        cycles: (K,) in a revolution.
        phase: (K,) rad.
    """

    NAME = "cogging"
    REMEDY = "look at {joint}'s motor, gear and coupling"
    NOT_FITTED = "`diagnose` finds it and extends the model"
    MEANINGS = meanings(
        amplitude=Meaning("N·m"),
        cycles_per_revolution=Meaning("1/rev", least=0.0),
        phase=Meaning("rad"),
    )

    arm: Arm
    motor: Array
    amplitude: Array
    cycles: Array
    phase: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(
                f"cogging.{field}.{joint}", (), unit, f"{meaning}, {joint}",
                lengths=tuple(range(1, MOST_RIPPLES + 1)),
            )
            for field, unit, meaning in _FIELDS
            for joint in arm.joint_names
        )  # fmt: skip

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Cogging | None:
        motors: list[int] = []
        ripples: dict[str, list[float]] = {field: [] for field, _, _ in _FIELDS}
        for motor, joint in enumerate(arm.joint_names):
            names = [f"{cls.NAME}.{field}.{joint}" for field in ripples]
            given = [numbers(values, name) for name in names]
            count = max(map(len, given))
            expected = f"{count}: amplitude, cycles_per_revolution, phase of each ripple"
            for total, name, more in zip(ripples.values(), names, given, strict=True):
                check_count(name, more, count, expected)
                total.extend(more)
            motors += [motor] * count
        if not motors:
            return None
        return cls(arm, np.array(motors), *(np.array(each) for each in ripples.values()))

    def parameters(self) -> dict[str, Value]:
        numbers = (self.amplitude, self.cycles, self.phase)
        return {
            f"{self.NAME}.{field}.{joint}": as_value(array[self.motor == motor])
            for (field, _, _), array in zip(_FIELDS, numbers, strict=True)
            for motor, joint in enumerate(self.arm.joint_names)
            if (self.motor == motor).any()
        }

    def torque(self, state: State) -> Array:
        ripple = self.amplitude * np.cos(state.q @ self._turns.T + self.phase)
        return ripple @ self.arm.joint_to_actuator[self.motor]

    @classmethod
    def search_basis(cls, data: Filtered) -> list[_Waves]:
        """Return the sines for every motor that moves."""
        motion = data.motion
        bases: list[_Waves] = []
        if motion.static:
            return bases
        for motor, row in enumerate(motion.arm.joint_to_actuator):
            if not motion.moves[row != 0].all():
                continue
            angle = motion.q @ row
            steps = 2.0 * _LEAST_CYCLES + 0.5 * np.arange(_FREQUENCIES)
            grid = steps * np.pi / np.ptp(angle)
            waves: list[NDArray[np.float32]] = []
            for batch in np.split(grid, _FREQUENCIES // _TOGETHER):
                reduced = data.reduce(_rotating(angle, batch).view(float))
                waves.append(reduced.astype(np.float32))
            cosine, sine = (np.hstack([wave[:, first::2] for wave in waves]) for first in (0, 1))
            bases.append(_Waves(motor, row, grid, cosine, sine))
        return bases

    @classmethod
    def search(cls, basis: Any, residual: Residual) -> Iterator[Hypothesis]:
        """Yield the best ripple of every motor in a residual."""
        for waves in basis:
            # What each unit of motor torque would explain.
            target = (residual.torque * residual.weight) @ waves.row
            scale = residual.weight @ waves.row**2
            power = np.zeros(len(waves.grid))
            for wave in (waves.cosine, waves.sine):
                power += (target @ wave) ** 2 / np.maximum(scale @ wave**2, 1e-30)
            cycles = float(waves.grid[np.argmax(power)])
            yield RippleHypothesis(
                arm=residual.data.motion.arm, site=Site.motor(waves.motor),
                setting={"cycles_per_revolution": cycles},
            )  # fmt: skip

    @cached_property
    def _turns(self) -> Array:
        """(K, n) rad of each ripple's phase per rad of the joints."""
        return self.cycles[:, None] * self.arm.joint_to_actuator[self.motor]


def _rotating(angle: Array, cycles: Array) -> NDArray[np.complex128]:
    """Return (N, k) exp(i cycles angle) of (N,) angles for evenly spaced (k,) cycles.

    Each from the one before, by a turn that is the same for all: exponentials take longest.
    """
    turns = np.empty((len(angle), len(cycles)), dtype=np.complex128)
    turns[:, 0] = np.exp(1j * cycles[0] * angle)
    turns[:, 1:] = np.exp(1j * (cycles[1] - cycles[0]) * angle)[:, None]
    return np.cumprod(turns, axis=1, out=turns)


@dataclass(frozen=True, eq=False, kw_only=True)
class RippleHypothesis(Hypothesis):
    """A ripple of one motor's torque at one frequency, as cosine and sine."""

    EFFECT = Cogging
    CLAIM = "{where} has a torque ripple of {amplitude} at {cycles_per_revolution}"

    refine = ("cycles_per_revolution",)
    n_comparisons = _FREQUENCIES

    def regressor(self, motion: Motion) -> Array:
        row = self.site.row(self.arm)
        angle = self.setting["cycles_per_revolution"] * (motion.q @ row)
        return spread(row, np.cos(angle), np.sin(angle))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {
            "amplitude": float(np.hypot(*theta)),
            "cycles_per_revolution": self.setting["cycles_per_revolution"],
            "phase": float(np.arctan2(-theta[1], theta[0])),
        }

    def search_range(self, name: str, motion: Motion) -> tuple[float, float]:
        """Return the bounds up to the next frequencies of the grid."""
        way = float(np.max(motion.travel[1]))
        return self.setting[name] - 0.5 / way, self.setting[name] + 0.5 / way

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """Append a ripple, its phase corrected by the encoders' zeros."""
        motor = self.site.index
        ripple = self.parameters(theta)
        # The motor's angle is read off as far as the joints' are.
        angle = self.site.row(self.arm) @ position_offset(self.arm, values)
        ripple["phase"] += ripple["cycles_per_revolution"] * float(angle)
        names = {field: f"{self.effect}.{field}.{self.arm.joint_names[motor]}" for field in ripple}
        if len(values.get(names["phase"]) or ()) >= MOST_RIPPLES:
            return None
        new = {name: (*(values.get(name) or ()), ripple[field]) for field, name in names.items()}
        return {**values, **new}


@dataclass(frozen=True, eq=False)
class _Waves:
    """Sines of one motor's angle at every frequency that is looked at.

    Attributes:
        motor: Index of the motor.
        row: (n,) joint velocities -> the motor's.
        grid: (K,) rad of phase per rad.
        cosine: (T, K) as torques are compared, in single precision: they only show where to look.
        sine: (T, K).
    """

    motor: int
    row: Array
    grid: Array
    cosine: NDArray[np.float32]
    sine: NDArray[np.float32]
