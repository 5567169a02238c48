"""The compensator's settings, checked as a whole, and the torque that they ask for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.compensate.evaluator import Parts, prepare_parts
from dvrk_gravity.compensate.limits import EffortLimits
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import ALL_PARAMETERS, TorqueModel
from dvrk_gravity.parameter import check_all
from dvrk_gravity.terms import DirectionalCable

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Settings:
    """One complete and consistent set of the compensator's parameters.

    Attributes:
        model: The torque model.
        limits: Effort limits in both spaces.
        slew_limit: (7,) fastest change of a joint's command, N·m/s; ``inf`` where off.
        ramp_time: Time of the blend from the effort that is there to the model's, s.
        timeout: Longest time without valid input, s.
        position_margin: Positions further outside the arm's limits than this are refused, rad.
        max_stamp_age: Oldest stamp by the node's clock, s; 0 if not checked.
        friction_ratio: (7,) part of friction that is compensated, at each joint and motor.
        friction_dead_band: (7,) rad/s below which it is not.
        enabled: Whether to command at all.
        resume_automatically: Go on by itself after a fault of the input.
        disable_builtin: Switch the arm's own compensation off when it is on.
    """

    model: TorqueModel
    limits: EffortLimits
    slew_limit: Array
    ramp_time: float
    timeout: float
    position_margin: float
    max_stamp_age: float
    friction_ratio: Array
    friction_dead_band: Array
    enabled: bool
    resume_automatically: bool
    disable_builtin: bool

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Settings:
        """Build settings from parameter names and values; absent ones take their defaults.

        Raises:
            ConfigError: An unknown name, a value that fails its check, or no beta: an
                arm that is commanded zero torque falls.
        """
        model = TorqueModel.from_parameters(values)
        defaults = {name: entry.default for name, entry in ALL_PARAMETERS.items()}
        value: dict[str, Any] = defaults | check_all(ALL_PARAMETERS, values)
        if not value["beta"]:
            raise ConfigError("beta", [], "10 gravity parameters, from --params-file for instance")
        arm = model.arm
        limits = EffortLimits(
            arm,
            np.array(value["effort_limit"] or arm.effort_limit),
            np.array(value["actuator_effort_limit"] or arm.actuator_effort_limit),
        )
        slew_limit = np.array(value["slew_limit"])
        return cls(
            model,
            limits,
            np.where(slew_limit > 0.0, slew_limit, np.inf),
            value["ramp_time"],
            value["timeout"],
            value["position_margin"],
            value["max_stamp_age"],
            np.array(value["friction_compensation.ratio"]),
            np.array(value["friction_compensation.dead_band"]),
            value["enabled"],
            value["resume"] == "automatic",
            value["disable_builtin"],
        )

    def torque(self, q: Array, qd: Array | None) -> Array:
        """Return the (7,) torque to apply at (7,) positions and velocities, before limits, N·m.

        It is the model's torque but for friction, of which only the asked part
        is compensated: pushing the whole of it makes an arm run away on its own.
        """
        conservative, friction = self.parts(q, qd)
        return conservative + friction

    def parts(self, q: Array, qd: Array | None) -> tuple[Array, Array]:
        """Return :meth:`torque` as its two parts, (7,) each: without friction, and friction."""
        if self._offset is not None:
            q = q - self._offset  # what the terms are functions of
        moving = None if qd is None else qd * (np.abs(qd) >= self.friction_dead_band)
        return self._parts(q, qd, moving)

    @cached_property
    def friction_part(self) -> Array:
        """(7,) largest part of any friction that is compensated at a joint, 0 to 1."""
        part = np.zeros(len(self.friction_ratio))
        for term in self.model.terms:
            if isinstance(term, DirectionalCable):
                part = np.maximum(part, term.scaled(self.friction_ratio).ratio)
            elif term.FRICTION and term.COMPENSATED:
                part = np.maximum(part, self.friction_ratio)
        # What rubs at a motor is felt at each joint that it moves.
        coupled = self.limits.coupled
        return np.where(coupled, part[coupled].max(initial=0.0), part)

    @cached_property
    def _offset(self) -> Array | None:
        return self.model.joint_offset if self.model.joint_offset.any() else None

    @cached_property
    def _parts(self) -> Parts:
        terms = (term for term in self.model.terms if term.COMPENSATED)
        return prepare_parts(terms, self.friction_ratio)
