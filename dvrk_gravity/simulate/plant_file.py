"""A plant's truth as a YAML file: torques, inertia and sensors of one simulated arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import LARGEST, PLANTS, Arm, mtm, plausible_plant
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import assumed_inertias, assumed_rotors, stated_terms, terms
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import entries, yaml_file
from dvrk_gravity.files.resources import config_path, shipped
from dvrk_gravity.model import TorqueModel, resolve_arm_path
from dvrk_gravity.parameters import flatten
from dvrk_gravity.simulate.plant import Plant
from dvrk_gravity.simulate.sensors import Sensors
from dvrk_gravity.validation import is_urdf

_SECTIONS = ("parameters", "links", "rotor_inertia", "sensors")
_number = partial(entries.number, least=-LARGEST, most=LARGEST)
_numbers = partial(entries.numbers, least=-LARGEST, most=LARGEST)
_STEPS = ("position_step", "velocity_noise", "effort_step", "effort_noise")


@dataclass(frozen=True, eq=False)
class PlantFile:
    """What a plant file holds.

    Attributes:
        model: The true terms.
        links: Inertia of the bodies in their link frames (distal DH, URDF).
        rotor_inertia: (n,) reflected inertia at the actuators, kg·m^2.
        sensors: The sensors; perfect ones if the file has none.
        source: Where inertia and sensors are from, in words.
    """

    model: TorqueModel
    links: Mapping[str, pin.Inertia]
    rotor_inertia: Array
    sensors: Sensors
    source: str = ""

    @classmethod
    def load(cls, name_or_path: str | Path) -> PlantFile:
        """Load a plant by name (``mtmr_28002``), from a YAML file, or that of a URDF.

        Of a model file, the terms move with the inertia and sensors of its arm's plant
        (:meth:`of`), and with its friction where the model has none.

        Raises:
            ConfigError: Unknown name, or a file with a wrong, missing or unknown field.
        """
        text = str(name_or_path)
        if is_urdf(text):
            return cls.of(Arm.load(text))
        path = Path(text)
        if not text.endswith((".yaml", ".yml")):
            try:
                path = config_path(f"{PLANTS}/{text}.yaml")
            except FileNotFoundError as error:
                raise ConfigError(
                    "plant", text,
                    f"{', '.join(shipped(PLANTS))}, or the path of a plant's or a model's .yaml "
                    "file, or of a .urdf",
                ) from error  # fmt: skip
        content = yaml_file.load(path)
        if any(
            isinstance(node, Mapping) and "ros__parameters" in node for node in content.values()
        ):
            model = TorqueModel.load(path)
            known = cls.of(model.arm)
            friction = tuple(term for term in known.model.terms if term.FRICTION)
            if not any(term.FRICTION for term in model.terms):
                model = replace(model, terms=(*model.terms, *friction))
            return replace(known, model=model)
        try:
            return replace(_parse(content, path.parent), source=f"the plant {path.stem}")
        except ConfigError as error:
            raise error if error.source else error.in_file(path) from None

    @classmethod
    def of(cls, arm: Arm) -> PlantFile:
        """Return the plant of an arm of which no other is given.

        It is the first of those that come with the package whose name begins with the arm's, of any
        MTM ``mtmr_28002`` on its own geometry. Of another arm, and of one with joints that are
        held, which those plants have, the plant has the inertia of its file, or spheres if it has
        none, and rotors; the weight that goes with it (``Term.nominal``); the friction that its
        file states, or a usual one if it states none; and perfect sensors.

        Raises:
            ConfigError: A file of the package that cannot be read.
        """
        if name := plausible_plant(arm):
            plant = cls.load(name)
            values = {**plant.model.parameters(), "arm": arm.source or arm.name}
            return replace(plant, model=TorqueModel.from_parameters(values, arm))
        stated = [term for term in stated_terms(arm) if term.FRICTION]
        nominal = [each for term in terms() if (each := term.nominal(arm))]
        usual = (term for term in nominal if not (stated and term.FRICTION))
        model = TorqueModel(arm, (*usual, *stated))
        source = f"{arm.name}'s file" if arm.inertial_parameters is not None else "spheres"
        return cls(model, assumed_inertias(arm), assumed_rotors(arm), Sensors(), source)

    def plant(self, friction_scale: float = 1.0) -> Plant:
        """Build the plant.

        Raises:
            ConfigError: Inertias without a positive mass matrix.
        """
        return Plant(self.model, self.links, self.rotor_inertia, friction_scale)


def initial_position(arm: Arm) -> tuple[float, ...]:
    """Return the default (n,) initial position of a simulated arm, rad or m."""
    if mtm.is_mtm(arm):
        return mtm.defaults.INITIAL_POSITION
    return tuple(np.clip(np.zeros(arm.n), arm.lower, arm.upper).tolist())


def _parse(content: Mapping[str, Any], folder: Path) -> PlantFile:
    _check_keys("", content, _SECTIONS, _SECTIONS[:3])
    values = flatten(entries.mapping("parameters", content["parameters"]))
    model = TorqueModel.from_parameters(resolve_arm_path(values, folder))
    links = {
        str(name): _inertia(f"links.{name}", row)
        for name, row in entries.mapping("links", content["links"]).items()
    }
    _check_keys("links", links, model.arm.body_names)
    n = len(model.arm.joints)
    rotors = np.array(_numbers("rotor_inertia", content["rotor_inertia"], n, least=0.0))
    return PlantFile(model, links, rotors, _sensors(content.get("sensors", {}), n))


def _inertia(where: str, row: Any) -> pin.Inertia:
    fields = ("mass", "com", "inertia")
    _check_keys(where, row, fields, fields)
    mass = _number(f"{where}.mass", row["mass"], least=0.0)
    com = np.array(_numbers(f"{where}.com", row["com"], 3))
    xx, yy, zz, xy, xz, yz = _numbers(f"{where}.inertia", row["inertia"], 6)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least, middle, most = np.linalg.eigvalsh(tensor)
    # Pinocchio takes any numbers; a body's principal moments obey the triangle inequality.
    if least < 0 or least + middle < most * (1 - 1e-9):
        raise ConfigError(f"{where}.inertia", row["inertia"], "an inertia that a body can have")
    return pin.Inertia(mass, com, tensor)


def _sensors(content: Any, n: int) -> Sensors:
    _check_keys("sensors", content, (*_STEPS, "effort_delay"))
    arrays = {
        key: np.array(_numbers(f"sensors.{key}", content[key], n, least=0.0))
        for key in _STEPS
        if key in content
    }
    delay = _number("sensors.effort_delay", content.get("effort_delay", 0.0), least=0.0)
    return Sensors(**arrays, effort_delay=delay)


def _check_keys(where: str, value: Any, known: Sequence[str], required: Sequence[str] = ()) -> None:
    """Refuse what is no mapping of these keys; an unknown one by its own name."""
    for key in entries.mapping(where, value):
        if key not in known:
            name = f"{where}.{key}" if where else str(key)
            raise ConfigError(name, key, f"one of {', '.join(known)}")
    entries.mapping(where, value, required=required)
