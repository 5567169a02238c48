"""The compensator's settings, checked as a whole, and the torque that they ask for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.limits import EffortLimits
from dvrk_gravity.effects import Evaluator, State, Term, sensor_effects, terms
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import (
    BY_EFFECTS,
    VERDICT_PARAMETER,
    VERDICTS,
    TorqueModel,
    all_parameters,
    arm_of,
    model_parameters,
)
from dvrk_gravity.parameters import ACCEPT_READING_ERRORS, Value, check_all

Parts = Callable[[Array, "Array | None", "Array | None"], tuple[Array, Array]]
"""Torque without friction and friction, (n,) each, from positions, velocities, and the velocities
at which friction is taken."""

# From zero to its effort limit a joint's command takes at least so long, s: the longest step that a
# command answers (see the supervisor), so that no parameter makes it jump in one sample.
FULL_SCALE_TIME = 0.02


@dataclass(frozen=True, eq=False)
class Settings:
    """One complete and consistent set of the compensator's parameters (``parameters/nodes.py``).

    Attributes:
        model: The torque model.
        limits: Effort limits in both spaces, never above the arm's own.
        slew_limit: (n,) N·m/s, ``FULL_SCALE_TIME`` considered.
        friction_ratio, friction_dead_band, allowance, speed_limit: (n,) rad/s, or a part.
    """

    model: TorqueModel
    limits: EffortLimits
    slew_limit: Array
    ramp_time: float
    timeout: float
    position_margin: float
    start_tolerance: float
    max_stamp_age: float
    friction_ratio: Array
    friction_dead_band: Array
    allowance: Array
    speed_limit: Array
    enabled: bool
    resume_automatically: bool
    disable_builtin: bool
    _model_values: Mapping[str, Value] = field(default_factory=dict)  # the model's parameters

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], before: Settings | None = None) -> Settings:
        """Build settings from parameter names and values; absent ones take their defaults.

        The arm of settings ``before``, which these replace, stays, whatever has become of its file,
        and so does their model where no parameter of it changes.

        Raises:
            ConfigError: An unknown name, a value that fails its check, no weight (an arm without
                torque falls), a model found unfit to compensate with, or readings that it knows to
                be wrong.
        """
        arm = arm_of(values) if before is None else before.model.arm
        declared = all_parameters(arm)
        checked = check_all(declared, values, BY_EFFECTS)
        defaults = {name: entry.default for name, entry in declared.items()}
        value: dict[str, Any] = defaults | checked
        arm = _with_limits(arm, value["effort_limit"])
        of_model = {name: checked[name] for name in model_parameters(arm) if name in checked}
        if before is not None and of_model == before._model_values:
            model = before.model
        else:
            model = TorqueModel.from_parameters(checked, arm)
        if model.foreign:
            raise ConfigError(
                model.foreign[0], "parameters of another model, or changed ones",
                "those of the model whose identification.identity is given: start with the file of "
                "one model alone; whoever has changed it by hand removes that entry from it",
            )  # fmt: skip
        if model.verdict == VERDICTS[-1] and not value["allow_poor_model"]:
            first, *more = model.reason.split("; ")  # joint by joint
            why = f"{first}; …" if more else first
            expected = f"a model fit for compensation, or allow_poor_model: true ({why})"
            raise ConfigError(VERDICT_PARAMETER.name, model.verdict, expected)
        if not value[ACCEPT_READING_ERRORS]:
            _require_readings(model)
        _require_weight(arm, value)
        limits = EffortLimits(
            arm,
            np.minimum(value["effort_limit"] or np.inf, arm.effort_limit),
            np.minimum(value["actuator_effort_limit"] or np.inf, arm.actuator_effort_limit),
        )
        fastest = arm.effort_limit / FULL_SCALE_TIME
        slew_limit = np.array(value["slew_limit"])
        ratio, dead_band, allowance = (
            np.array(value[f"friction_compensation.{name}"])
            for name in ("ratio", "dead_band", "allowance")
        )
        unchanged = (
            "ramp_time", "timeout", "position_margin", "start_tolerance", "max_stamp_age",
            "enabled", "disable_builtin",
        )  # fmt: skip
        return cls(
            model=model,
            limits=limits,
            slew_limit=np.minimum(np.where(slew_limit > 0.0, slew_limit, np.inf), fastest),
            friction_ratio=ratio,
            friction_dead_band=dead_band,
            allowance=allowance,
            speed_limit=np.array(value["speed_limit"]),
            resume_automatically=value["resume"] == "automatic",
            _model_values=of_model,
            **{name: value[name] for name in unchanged},
        )

    @cached_property
    def weightless(self) -> bool:
        """Whether gravity is left out on purpose, by its flag; weights of zero are a mistake."""
        carried = any(term.carries_arm for term in self.model.terms)
        return not carried and not self.model.parameters().get("gravity_enabled", False)

    def torque(self, q: Array, qd: Array | None) -> Array:
        """Return the (n,) torque to apply at (n,) positions and velocities, before limits, N·m.

        Of the model's friction only ``friction_ratio`` is compensated: with the whole of it an arm
        runs away on its own.
        """
        conservative, friction = self.parts(q, qd)
        return conservative + friction

    def finite(self, torque: Array) -> Array:
        """Return (n,) torques, N·m, or raise ArithmeticError."""
        finite = np.isfinite(torque)
        if not finite.all():
            joint = self.model.arm.joint_names[int(np.argmin(finite))]
            raise ArithmeticError(f"the model's torque on {joint} is not a finite number")
        return torque

    def static_torque(self, q: Array) -> Array:
        """Return the (n,) torque within the limits that holds the arm at (n,) positions, N·m."""
        return self.limits.clip(self.torque(q, None))

    def clipped_share(self, q: Array) -> Array:
        """Return (n,) what the limits clip from the static torque, over the arm's effort limits."""
        torque = self.torque(q, None)
        return np.abs(self.limits.clip(torque) - torque) / self.model.arm.effort_limit

    def commands_like(self, other: Settings) -> bool:
        """Return whether other settings command the same torque at every state of the arm."""
        return self is other or (
            self.model is other.model
            and np.array_equal(self.friction_ratio, other.friction_ratio)
            and np.array_equal(self.friction_dead_band, other.friction_dead_band)
            and np.array_equal(self.limits.joint, other.limits.joint)
            and np.array_equal(self.limits.actuator, other.limits.actuator)
        )

    def parts(self, q: Array, qd: Array | None) -> tuple[Array, Array]:
        """Return :meth:`torque` as its two parts, (n,) each: without friction, and friction."""
        if self._offset is not None:
            q = q - self._offset  # the terms are functions of true positions
        moving = None if qd is None else qd * (np.abs(qd) >= self.friction_dead_band)
        return self._parts(q, qd, moving)

    @cached_property
    def friction_part(self) -> Array:
        """(n,) largest part of any friction that is compensated at a joint, 0 to 1."""
        part = np.zeros(len(self.friction_ratio))
        for term in self.model.terms:
            if term.COMPENSATED:
                part = np.maximum(part, term.friction_part(self.friction_ratio))
        # A motor's friction acts at each joint that it moves.
        coupled = self.limits.coupled
        return np.where(coupled, part[coupled].max(initial=0.0), part)

    @cached_property
    def _offset(self) -> Array | None:
        return self.model.joint_offset if self.model.joint_offset.any() else None

    @cached_property
    def _parts(self) -> Parts:
        terms = (
            term for term in self.model.terms if term.COMPENSATED and not self._held_by_arm(term)
        )
        return prepare_parts(terms, self.friction_ratio)

    def _held_by_arm(self, term: Term) -> bool:
        """Return whether the arm itself compensates a term: its own weight."""
        return term.WEIGHT_OF_ARM and not self.model.arm.gravity_in_command

    def weight(self, q: Array) -> Array:
        """Return the (n,) efforts that hold the arm's own weight by the model, N·m."""
        return self._static_torque(q, (term for term in self.model.terms if term.WEIGHT_OF_ARM))

    def holding_effort(self, q: Array) -> Array:
        """Return the (n,) efforts that hold the arm still, with the arm's own share, N·m."""
        torque = self.torque(q, None)
        return torque if self.model.arm.gravity_in_command else torque + self.weight(q)

    def own_holding_effort(self, q: Array) -> Array:
        """Return the (n,) efforts that hold the arm itself still by the model, no payload, N·m."""
        terms = (term for term in self.model.terms if term.COMPENSATED)
        own = (term for term in terms if term.WEIGHT_OF_ARM or term.gravity_vector is None)
        return self._static_torque(q, own)

    def _static_torque(self, q: Array, terms: Iterable[Term]) -> Array:
        state = State.of(q - self.model.joint_offset)
        return np.asarray(sum((term.torque(state) for term in terms), np.zeros(q.shape)))


def _with_limits(arm: Arm, given: tuple[float, ...]) -> Arm:
    """Return the arm with effort limits of its file or of the parameter, or refuse it."""
    missing = [joint for joint in arm.joints if not joint.effort_stated]
    if not missing:
        return arm
    limits = np.broadcast_to(np.array(given or 0.0), arm.n)
    for joint, limit in zip(arm.joints, limits.tolist(), strict=True):
        if joint in missing and limit <= 0.0:
            raise ConfigError(
                "effort_limit", f"none of {', '.join(joint.name for joint in missing)}",
                f"a largest effort of each joint, {joint.effort_unit}: <limit effort=\"…\"/> in "
                "the URDF, actuator_effort_limit in a YAML that names it, or the parameter "
                "effort_limit", arm.source,
            )  # fmt: skip
    return arm.limited_to(limits)


def _require_readings(model: TorqueModel) -> None:
    """Refuse to command by readings that the model knows to be wrong."""
    arm, errors = model.arm, model.reading_errors
    wrong = {
        name: value
        for effect in sensor_effects()
        if effect.invalidates_commands(arm, errors)
        for name, value in effect.written(arm, errors).items()
    }
    if wrong:
        name, *more = wrong
        also = f" ({', '.join(more)}, too)" if more else ""
        expected = (
            f"right readings: this one is wrong by the model{also}, and so would be commands; put "
            f"it right and remove the parameter, or {ACCEPT_READING_ERRORS}: true"
        )
        value = wrong[name]
        raise ConfigError(name, list(value) if isinstance(value, tuple) else value, expected)


def _require_weight(arm: Arm, value: Mapping[str, Any]) -> None:
    """Refuse a model without the arm's weight, unless the arm holds that itself."""
    if not arm.gravity_in_command:
        return
    weights = [
        entry
        for term in terms()
        if term.WEIGHT_OF_ARM
        for entry in term.schema(arm)
        if entry.default == ()
    ]
    if not any(value[entry.name] for entry in weights):
        field, *more = (entry.name for entry in weights)
        if more:
            field = f"{field.split('.')[0]}.*"
        expected = f"{weights[0].meaning}, from --params-file for instance"
        raise ConfigError(field, [], expected)


def prepare_parts(terms: Iterable[Term], part: Array) -> Parts:
    """Return the evaluator of a sum of terms for one sample, with friction apart.

    A term's own ``torque`` takes any number of samples. For one, nearly all of its time goes into
    calls of numpy: ``prepare`` computes beforehand all that does not depend on the sample.

    Args:
        terms: The terms, with their whole friction.
        part: (n,) part of friction to take, at each joint and motor.
    """
    # Friction is scaled where it acts: parts of a motor's friction that differ by joint would put
    # more power into the arm than the friction dissipates.
    fused: list[Evaluator] = []
    smooth: list[Evaluator] = []
    rubbing: list[Evaluator] = []
    for term in terms:
        together = term.prepare_parts(part)
        if together is not None:
            fused.append(together)
            continue
        for found, kind in zip(term.split(part), (smooth, rubbing), strict=True):
            if found is not None:
                kind.append(found.prepare())
    conservative, friction = _sum(smooth), _sum(rubbing)
    if not fused:
        return lambda q, qd, moving: (conservative(q, qd), friction(q, moving))
    both = _sum(fused)
    if not rubbing:

        def without(q: Array, qd: Array | None, moving: Array | None) -> tuple[Array, Array]:
            elastic, alone = both(q, moving)
            return conservative(q, qd) + elastic, alone

        return without

    def evaluate(q: Array, qd: Array | None, moving: Array | None) -> tuple[Array, Array]:
        elastic, more = both(q, moving)
        return conservative(q, qd) + elastic, friction(q, moving) + more

    return evaluate


def _sum(evaluators: list[Evaluator]) -> Evaluator:
    return reduce(_add, evaluators) if evaluators else _zeros


def _add(first: Evaluator, second: Evaluator) -> Evaluator:
    return lambda q, qd: first(q, qd) + second(q, qd)


def _zeros(q: Array, qd: Array | None) -> Array:
    return np.zeros(q.shape)
