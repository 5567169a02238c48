"""Dry friction that grows with the torque that a gear transmits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_array, as_value, diagonal_columns, joint_array
from dvrk_gravity.effects.base.dry_friction import TRANSITION
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.term import Evaluator, Term
from dvrk_gravity.effects.coulomb_friction import CoulombFriction
from dvrk_gravity.effects.rotor_inertia import RotorInertia
from dvrk_gravity.parameters import Parameter, Value

# Of the load: of harmonic drives up to so much is measured, of spur gears a fifth of it.
_PART = 0.1


@dataclass(frozen=True, eq=False)
class LoadFriction(LinearTerm):
    """tau = part |load| sign(qd): what a gear's teeth rub by the torque that they transmit.

    The load is the torque of the model's other terms, friction and rotors left out: what is behind
    the gear (Hamon, Gautier and Garrec 2010, Dynamic identification of robots with a dry friction
    model depending on load and velocity; Bittencourt and Gunnarsson 2012, Static friction in a
    robot joint). Beside it ``coulomb_friction`` is that of the gear without load: after a reversal
    both build up over the same displacement.

    Attributes:
        arm: The arm.
        part: (n,) of the load.
        carried: The terms whose torque is the load.
        gear: Coulomb friction of the same gears; ``None``: there is none.
    """

    NAME = "load_friction"
    FRICTION = True
    COEFFICIENTS = ("part",)
    BY_MOTION = True
    OF_OTHERS = True

    arm: Arm
    part: Array
    carried: tuple[Term, ...] = ()
    gear: CoulombFriction | None = None

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (joint_array(arm, cls.NAME, "1", "dry friction, part of the joint's load", 0.0),)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> LoadFriction | None:
        part = as_array(values.get(cls.NAME), arm.n, 0.0)
        return cls(arm, part) if part.any() else None

    def parameters(self) -> dict[str, Value]:
        return {self.NAME: as_value(self.part)}

    def with_terms(self, terms: Sequence[Term]) -> LoadFriction:
        behind = (t for t in terms if not (t.FRICTION or isinstance(t, RotorInertia)))
        gear = next((t for t in terms if isinstance(t, CoulombFriction)), None)
        return replace(self, carried=tuple(behind), gear=gear)

    @cached_property
    def _direction_model(self) -> CoulombFriction:
        """Whose directions are those of this friction: at once where there is no other."""
        nothing = np.zeros(self.arm.n)
        longest = nothing if self.gear is None else self.gear.displacement.max(axis=0)
        return CoulombFriction(
            self.arm, *(nothing,) * 4, transition_velocity=self.full_speed,
            joint_displacement=longest, motor_displacement=nothing,
        )  # fmt: skip

    def memory(self, state: State, before: Array | None = None) -> Array:
        return self._direction_model.memory(state, before)

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where no motion is known."""
        return self.torque_given(state, {})

    def torque_given(self, state: State, others: Mapping[int, Array]) -> Array:
        return self.part * self._unit_torque(state, self._direction_model.past(state), others)

    def _unit_torque(
        self, state: State, memory: Array | None, others: Mapping[int, Array] | None = None
    ) -> Array:
        ways = self._direction_model.ways(state, memory)
        if ways is None:
            return np.zeros(state.q.shape)
        known, load = others or {}, np.zeros(state.q.shape)
        for term in self.carried:
            load += known[id(term)] if id(term) in known else term.torque(state)
        return np.asarray(ways[0] * np.abs(load))

    @property
    def full_speed(self) -> Array:
        return TRANSITION * self.arm.scale

    def prepare(self) -> Evaluator:
        carried, part, slope = [t.prepare() for t in self.carried], self.part, 1.0 / self.full_speed

        def evaluate(q: Array, qd: Array | None) -> Array:
            if qd is None:
                return np.zeros(len(part))
            load = sum((each(q, qd) for each in carried), np.zeros(len(part)))
            return part * np.abs(load) * np.minimum(np.maximum(slope * qd, -1.0), 1.0)

        return evaluate

    def scaled(self, part: Array) -> LoadFriction:
        return replace(self, part=part * self.part)

    @classmethod
    def plausible(cls, arm: Arm, valid: Range) -> LoadFriction:
        return cls(arm, np.full(arm.n, _PART))

    def regressor(self, state: State) -> Array:
        return diagonal_columns(self._unit_torque(state, self._direction_model.past(state)))

    def columns(self, state: State, memory: Array) -> Array:
        return diagonal_columns(self._unit_torque(state, memory))
