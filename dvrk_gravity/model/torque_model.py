"""A torque model: the sum of named physical terms for one arm, kept in a ROS 2 parameter file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import (
    ENTRY_POINTS,
    ReadingErrors,
    SensorEffect,
    State,
    Term,
    as_array,
    sensor_effects,
    stated_terms,
    terms,
)
from dvrk_gravity.errors import ArgumentError, ConfigError, EffectError
from dvrk_gravity.files import json_file, outputs, text_file, yaml_file
from dvrk_gravity.model.description_uncertainty import stated_uncertainty
from dvrk_gravity.model.identity import IDENTITY_PARAMETER, foreign_groups, identity_of
from dvrk_gravity.model.named_arm import (
    arm_of,
    arm_parameters,
    relative_arm_path,
    resolve_arm_path,
    values_of,
)
from dvrk_gravity.model.uncertainty import SUFFIX, ModelUncertainty
from dvrk_gravity.parameters import Parameter, Value, check_all, flatten, node_parameters, unflatten
from dvrk_gravity.validation import is_urdf, path_of, refuse_json

LARGEST_TORQUE = 1e12  # N·m; no arm's, and sums of squares stay finite
# What a console file holds beyond the model, so that converting it back loses nothing.
CONSOLE_PARAMETER = Parameter(
    "console.document", "", "", "the dVRK console's file that the model came from, as JSON text",
    read_only=True, adjustable=True,
)  # fmt: skip
VERDICTS = ("good", "usable", "do_not_compensate")  # best first
NO_VERDICT = "unknown"
A_MODEL = "a TorqueModel, or the path of a model's .yaml or an arm's .urdf file"
VERDICT_PARAMETER = Parameter(
    "identification.verdict", NO_VERDICT, "",
    "identify's verdict on the model; the compensator refuses do_not_compensate",
    choices=(NO_VERDICT, *VERDICTS), read_only=True,
)  # fmt: skip
REASON_PARAMETER = Parameter(
    "identification.reason", "", "", "reason of the verdict", read_only=True
)
READING, TORQUE = BIAS_IS = ("reading", "torque")  # what a constant of a recording may be
SETTLED_PARAMETER = Parameter(
    "identification.constant_is", "", "",
    "what constant torques are, a spring's or a reading's, and what settled it", read_only=True,
)  # fmt: skip
UNCERTAINTY_PARAMETER = Parameter(
    "identification.uncertainty", "", "",
    "file beside the model's with its uncertainty: the parameters' covariance, the known error",
    read_only=True, adjustable=True,
)  # fmt: skip
COORDINATES_PARAMETER = Parameter(
    "identification.coordinates", "joint", "",
    "coordinates that identify found its recordings to be in, which a diagnosis expects",
    choices=("joint", "actuator"), read_only=True, adjustable=True,
)  # fmt: skip
OFFSET = "joint_offset"
CONSTANT = "identification.constant"
# What declares the groups of parameters of models.
BY_EFFECTS = f"installed effect (entry points {ENTRY_POINTS})"


def model_parameters(arm: Arm) -> Mapping[str, Parameter]:
    """Return the declarations of all parameters of an arm's models, by name."""
    return _declared(arm, (*terms(), *sensor_effects()))


def all_parameters(arm: Arm) -> Mapping[str, Parameter]:
    """Return the declarations of parameters of an arm's models and of the nodes, by name."""
    return {**model_parameters(arm), **node_parameters(arm)}


@lru_cache(maxsize=8)
def _declared(arm: Arm, effects: tuple[type[Term | SensorEffect], ...]) -> Mapping[str, Parameter]:
    offset = Parameter(
        OFFSET, (), "rad", "error of the encoders: measured minus true position",
        lower=-1.0, upper=1.0, lengths=(arm.n,), units=arm.units,
    )  # fmt: skip
    constant = Parameter(
        CONSTANT, (), "N·m",
        "constant torque that the arm may not feel: of a spring, a bias of the reading, or a hand "
        "in the recording; the compensator's first start checks it",
        lengths=(arm.n,), units=arm.effort_units, read_only=True,
    )  # fmt: skip
    declared = (
        *arm_parameters(arm),
        offset,
        constant,
        SETTLED_PARAMETER,
        CONSOLE_PARAMETER,
        VERDICT_PARAMETER,
        REASON_PARAMETER,
        UNCERTAINTY_PARAMETER,
        COORDINATES_PARAMETER,
        IDENTITY_PARAMETER,
        *(
            # Whoever has put a reading right takes it out of the file.
            replace(entry, adjustable=True) if issubclass(effect, SensorEffect) else entry
            for effect in effects
            for entry in effect.schema(arm)
        ),
    )
    return {entry.name: entry for entry in declared}


@dataclass(frozen=True, eq=False)
class TorqueModel:
    """The sum of the terms of one arm.

    Attributes:
        arm: The arm.
        terms: The terms, each a physical cause of torque.
        node: Settings of the nodes that came in the same file; kept, not used here.
        document: The dVRK console's file that the model came from, as JSON text; ``""`` if none.
        joint_offset: (n,) rad, q_measured = q_true + joint_offset. Positions given to the model
            are measured ones; its terms are functions of the true ones.
        reading_errors: What is known to be wrong with the arm's readings. Recordings are corrected
            for it before they are compared with the model; :meth:`torque` takes positions that are
            right but for ``joint_offset``.
        verdict: What the identification said of it, one of ``VERDICTS``, or ``NO_VERDICT``.
        reason: Why.
        constant: (n,) constant torque that it commands and that the arm may not feel, N·m or N:
            more than dry friction holds, and nothing has settled what it is; zero elsewhere.
        constant_is: What such torques are and what settled it, in words; ``""``: nothing has.
        detected_coordinates: Coordinates that its recordings were found to be in, where they were
            not given.
        uncertainty: Its posterior and known error; ``None``: not identified, or not stored.
        why_no_uncertainty: Why it has none though its file names an uncertainty.
        foreign: Groups of its parameters that do not belong to the model whose identity is among
            them: another model's, or changed by hand.
        of_file: Whether it is what the arm's own file states.
    """

    arm: Arm
    terms: tuple[Term, ...]
    node: Mapping[str, Value] = field(default_factory=dict)
    document: str = ""
    joint_offset: Array = field(default_factory=lambda: np.zeros(0))
    verdict: str = NO_VERDICT
    reason: str = ""
    constant: Array = field(default_factory=lambda: np.zeros(0))
    constant_is: str = ""
    detected_coordinates: str = "joint"
    uncertainty: ModelUncertainty | None = None
    why_no_uncertainty: str = ""
    foreign: tuple[str, ...] = ()
    of_file: bool = False
    reading_errors: ReadingErrors = field(default_factory=lambda: ReadingErrors.none(0))

    def __post_init__(self) -> None:
        """Put zeros where no offset or constant is given, right readings where no errors are.

        Terms that depend on the others' torque get these.
        """
        terms = tuple(term.with_terms(self.terms) for term in self.terms)
        object.__setattr__(self, "terms", terms)
        if not len(self.reading_errors.velocity):
            object.__setattr__(self, "reading_errors", ReadingErrors.none(self.arm.n))
        for name in ("joint_offset", "constant"):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(self.arm.n))

    @classmethod
    def load(cls, path: str | Path) -> TorqueModel:
        """Load a model from a ROS 2 parameter file (``/**: ros__parameters:``).

        Beside it may lie the file of its uncertainty. Without that it has no uncertainty, and
        ``why_no_uncertainty`` gives the reason; another model's is refused.

        A file that mixes two models, or was changed by hand, says so in ``foreign``.

        The file of an arm (a URDF, ``robot.urdf#LINK``, or a YAML that names one) is the model that
        it states; see :meth:`from_arm`.

        Raises:
            ConfigError: Naming the file, the parameter, the value and what was expected.
        """
        file = path_of("model", path, A_MODEL)
        if is_urdf(file):
            return cls.from_arm(Arm.load(file))
        refuse_json("model", path)
        content = yaml_file.load(file)
        if "urdf" in content:
            return cls.from_arm(Arm.load(file))
        try:
            return cls.from_values(flatten(_ros_parameters(content)), Path(path).parent)
        except ConfigError as error:
            raise error if error.source else error.in_file(path) from None

    @classmethod
    def from_values(cls, values: Mapping[str, Any], folder: Path) -> TorqueModel:
        """Return the model of a file's parameters whose further files lie in a folder.

        Args:
            values: Values by parameter name.
            folder: Of the files of its arm and its uncertainty, where they are there.

        Raises:
            ConfigError: As :meth:`load`.
        """
        model = cls.from_parameters(resolve_arm_path(values, folder))
        name = str(values.get(UNCERTAINTY_PARAMETER.name, ""))
        uncertainty_path = folder / Path(name).name
        if not name:
            return model
        if not uncertainty_path.exists():
            return replace(model, why_no_uncertainty=f"{uncertainty_path.name} is not in {folder}")
        uncertainty = ModelUncertainty.load(uncertainty_path)
        others = list(foreign_groups(model.identity, uncertainty.identity))
        if uncertainty.identity and others:
            raise ConfigError(
                UNCERTAINTY_PARAMETER.name, name,
                f"the uncertainty of this model: that is of another {others[0]}; to go on without "
                "it, remove this entry",
            )  # fmt: skip
        if not uncertainty.fits(model.terms):
            return replace(
                model,
                why_no_uncertainty=f"{uncertainty_path.name} is of other coefficients than the "
                "model has",
            )
        return replace(model, uncertainty=uncertainty)

    @classmethod
    def from_arm(cls, arm: Arm | str | Path) -> TorqueModel:
        """Return the model of an arm's own file: its masses, damping and friction.

        Args:
            arm: The arm, its name, or its file.

        Raises:
            ConfigError: A file that says nothing of them, or efforts that are not in N·m.
            ArgumentError: No arm.
        """
        arm = Arm.of(arm)
        if arm.read_in:
            raise ConfigError(
                "model", arm.source, f"drive_gains in it: masses give N·m, not {arm.read_in}"
            )
        if arm.inertial_parameters is None:
            raise ConfigError("model", arm.source or arm.name, "an arm's file that states masses")
        found = stated_terms(arm)
        return cls(arm, found, uncertainty=stated_uncertainty(arm, found), of_file=True)

    @classmethod
    def of(cls, given: TorqueModel | str | Path) -> TorqueModel:
        """Return a model, or the one in a file; see :meth:`load`."""
        return given if isinstance(given, TorqueModel) else cls.load(given)

    def __repr__(self) -> str:
        """Name the arm and the terms, and the verdict if there is one."""
        names = ", ".join(term.NAME for term in self.terms) or "no terms"
        verdict = "" if self.verdict == NO_VERDICT else f"; {self.verdict}"
        return f"<TorqueModel {self.arm.source or self.arm.name}: {names}{verdict}>"

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], arm: Arm | None = None) -> TorqueModel:
        """Build a model from dotted parameter names and their values.

        Args:
            values: Values by parameter name.
            arm: The arm, where it has been loaded before; else the one that they name.

        Raises:
            ConfigError: An unknown name or a value that fails its check.
        """
        if not isinstance(values, Mapping):
            raise ArgumentError("parameters", values, "a mapping from names to values")
        if arm is None:
            arm = arm_of(values)
        checked = check_all(all_parameters(arm), values, BY_EFFECTS)
        built = [effect.from_parameters(arm, checked) for effect in terms()]
        node = {name: checked[name] for name in node_parameters(arm) if name in checked}
        document = str(checked.get(CONSOLE_PARAMETER.name, ""))
        if document:
            try:
                json_file.loads(document)
            except ConfigError as error:
                raise ConfigError(
                    CONSOLE_PARAMETER.name, document, f"JSON text ({error})"
                ) from error
        given = tuple(term for term in built if term is not None)
        offset = as_array(checked.get(OFFSET), arm.n, 0.0)
        verdict, reason, settled, found_in = (
            str(checked.get(entry.name, entry.default))
            for entry in (
                VERDICT_PARAMETER, REASON_PARAMETER, SETTLED_PARAMETER, COORDINATES_PARAMETER
            )
        )  # fmt: skip
        errors = ReadingErrors.none(arm.n)
        for effect in sensor_effects():
            errors = effect.read(arm, checked, errors)
        constant = as_array(checked.get(CONSTANT), arm.n, 0.0)
        model = cls(
            arm, given, node, document, offset, verdict, reason, constant, settled, found_in,
            reading_errors=errors,
        )  # fmt: skip
        identity = str(checked.get(IDENTITY_PARAMETER.name, ""))
        if not identity:
            return model
        return replace(model, foreign=tuple(foreign_groups(model.identity, identity)))

    @property
    def identity(self) -> str:
        """Hashes of its parameters, by group; see :func:`identity_of`."""
        return identity_of(self.parameters(), model_parameters(self.arm))

    def parameters(self) -> dict[str, Value]:
        """Return the values that :meth:`from_parameters` takes."""
        values = values_of(self.arm)
        if self.joint_offset.any():
            values[OFFSET] = tuple(self.joint_offset.tolist())
        values |= self.of_readings()
        for term in self.terms:
            values |= term.parameters()
        if self.document:
            values[CONSOLE_PARAMETER.name] = self.document
        if self.verdict != NO_VERDICT:
            values[VERDICT_PARAMETER.name] = self.verdict
        if self.reason:
            values[REASON_PARAMETER.name] = self.reason
        if self.constant.any():
            values[CONSTANT] = tuple(self.constant.tolist())
        if self.constant_is:
            values[SETTLED_PARAMETER.name] = self.constant_is
        if self.detected_coordinates != COORDINATES_PARAMETER.default:
            values[COORDINATES_PARAMETER.name] = self.detected_coordinates
        # An empty array means "not given", and ROS cannot read one.
        return values | {name: value for name, value in self.node.items() if value != ()}

    def of_readings(self) -> dict[str, Value]:
        """Return the parameters of its known errors of readings, ``reading.*``."""
        values: dict[str, Value] = {}
        for effect in sensor_effects():
            values |= effect.written(self.arm, self.reading_errors)
        return values

    def save(self, path: str | Path, comment: str = "") -> None:
        """Write the model as a ROS 2 parameter file, whole or not at all.

        An arm of a file that was given by a relative path is named as seen from the model file. Its
        uncertainty, if it has one, is written to :func:`uncertainty_file` beside it.

        Args:
            path: File to write; one that exists is replaced.
            comment: Lines put on top, without ``#``.

        Raises:
            OSError: The file cannot be written.
            ArgumentError: A path that is none.
            ConfigError: The path of the arm's own file.
        """
        path = path_of("path", path)
        if self.arm.source:
            outputs.require_unread("path", path, Arm.file(self.arm.source))
        head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
        values = self.parameters()
        values[IDENTITY_PARAMETER.name] = identity = self.identity
        if self.uncertainty is not None:
            uncertainty_path = uncertainty_file(path)
            self.uncertainty.save(uncertainty_path, identity)
            values[UNCERTAINTY_PARAMETER.name] = uncertainty_path.name
        values["arm"] = relative_arm_path(str(values["arm"]), path.parent)
        body = yaml_file.dump({"/**": {"ros__parameters": unflatten(values)}})
        text_file.write(path, head + body)

    def torque(
        self,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        qdd: ArrayLike | None = None,
        direction: ArrayLike | None = None,
    ) -> Array:
        """Return the torque that the actuators apply, in joint space.

        Args:
            q: (…, n) measured joint positions, rad.
            qd: (…, n) velocities, rad/s; without them friction is left out.
            qdd: (…, n) accelerations, rad/s^2; without them zero.
            direction: (…, n) +1/-1 for static poses, the way each was approached.

        Returns:
            (…, n) torques, N·m.

        Raises:
            ShapeError: Arrays that do not fit.
        """
        return self.torque_at(State.of(q, qd, qdd, direction, self.arm.n))

    def torque_at(self, state: State) -> Array:
        """Return (…, n) torques at a state with measured positions, N·m.

        Raises:
            EffectError: A term whose torque is of another shape.
        """
        if self.joint_offset.any():
            state = replace(state, q=state.q - self.joint_offset)
        found: dict[int, Array] = {}
        for term in self.terms_in_order:
            torque = term.torque_given(state, found)
            if torque.shape != state.q.shape:
                raise EffectError(
                    term.NAME, f"`torque` returns shape {torque.shape}, expected {state.q.shape}"
                )
            found[id(term)] = torque
        return sum(found.values(), np.zeros(state.q.shape))

    def positional_torques(self, state: State, ways: Array) -> Array:
        """Return the part of :meth:`torque_at` that depends on where the joints are, elsewhere.

        Args:
            state: (N, n) a motion.
            ways: (K, n) from its positions, rad.

        Returns:
            (K, N, n) torques along the motion moved by each way, N·m.
        """
        q = (state.q + ways[:, None]) - self.joint_offset
        rest = (state.qd, state.qdd, state.direction)
        moved = State(
            q, *(None if each is None else np.broadcast_to(each, q.shape) for each in rest)
        )
        found: dict[int, Array] = {}
        for term in (each for each in self.terms_in_order if each.OF_POSITION):
            if term.OF_OTHERS:  # and maybe on the motion before, which a stack does not show
                each = [
                    term.torque_given(
                        replace(state, q=own), {other: torque[k] for other, torque in found.items()}
                    )
                    for k, own in enumerate(q)
                ]
                found[id(term)] = np.stack(each)
            else:
                found[id(term)] = term.torque(moved)
        return sum(found.values(), np.zeros(q.shape))

    @cached_property
    def terms_in_order(self) -> list[Term]:
        """The terms, those that depend on other terms' torque after these."""
        return sorted(self.terms, key=lambda term: term.OF_OTHERS)

    def prediction(self, state: State) -> Array:
        """Return (N, n) torques as :meth:`torque_at`, N·m, to compare with measured ones.

        Raises:
            ConfigError: A torque that is not finite, or so large that sums of its squares are not.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            torque = self.torque_at(state)
        absurd = ~(np.abs(torque) < LARGEST_TORQUE)
        if absurd.any():
            row, joint = np.argwhere(absurd)[0]
            raise ConfigError(
                f"torque of {self.arm.joint_names[joint]} at a recorded sample",
                float(torque[row, joint]),
                f"parameters by which it is below {LARGEST_TORQUE:g} N·m",
            )
        return torque

    @property
    def gravity(self) -> Array:
        """(3,) gravity in the base frame as its terms have it, m/s^2; the arm's if none weighs."""
        vectors = (term.gravity_vector for term in self.terms)
        return next((vector for vector in vectors if vector is not None), self.arm.gravity)

    def term(self, name: str) -> Term | None:
        """Return the term of that effect name, ``None`` if the model has none."""
        return next((term for term in self.terms if name == term.NAME), None)

    def physical(self) -> TorqueModel:
        """Return the model of the arm itself: friction whole, not by the console's ratio."""
        return replace(self, terms=tuple(term.whole() for term in self.terms))


def uncertainty_file(path: str | Path) -> Path:
    """Return the path of the file, beside a model's, with its uncertainty."""
    return Path(path).with_suffix(SUFFIX)


def _ros_parameters(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the parameters of the one node, or of all nodes, in a ROS 2 parameter file."""
    for key, what in (("joints", "an arm's file"), ("rotor_inertia", "a plant's file")):
        if key in content:
            raise ConfigError("", what, "a model's parameters, under `/**:` or a node's name")
    if len(content) != 1:
        raise ConfigError("", sorted(map(str, content)), "one entry, `/**:` or a node's name")
    ((name, node),) = content.items()
    if not isinstance(node, Mapping) or set(node) != {"ros__parameters"}:
        raise ConfigError(str(name), node, "`ros__parameters:` under it and nothing else")
    parameters = node["ros__parameters"]
    if not isinstance(parameters, Mapping):
        raise ConfigError(f"{name}.ros__parameters", parameters, "a mapping of parameters")
    return parameters
