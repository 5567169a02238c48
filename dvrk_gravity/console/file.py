"""The dVRK console's calibration files, ``gc-<ARM>-<SN>.json`` versions 1 and 2, as torque models.

The console multiplies a 7 x 40 regressor by one set of parameters for motion up and one
for motion down: ten gravity columns (g is in its regressor, so they are in kg·m), then
q_j^0 … q_j^4 of joints 1 to 6. It blends the two products by velocity and clips the sum to
``safe_lower/upper_torque_limit``. That clipping is the only part that a model does not
take over; ``docs/console_files.md`` lists what else differs.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import GRAVITY, N_JOINTS, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.console.configuration import refuse_configuration
from dvrk_gravity.effects import Blend, DirectionalCable, Gravity, JointPolynomials, Range
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file
from dvrk_gravity.model import TorqueModel

N_PARAMETERS = 40
N_GRAVITY = 10
N_POWERS = 5
LEVEL = (0.0, 0.0, -GRAVITY)  # gravity in the base frame, m/s^2: the console's arm is upright
N_POLYNOMIALS = 6  # the console's regressor has no polynomial for joint 7
SECTION = "GC_controller"
N_POSES = 20_000
FAST = 1e6  # rad/s, beyond any saturation velocity
ARMS = {"MTML": "mtml", "MTMR": "mtmr"}

_LENGTHS = {
    "gc_dynamic_params_pos": N_PARAMETERS,
    "gc_dynamic_params_neg": N_PARAMETERS,
    "safe_upper_torque_limit": N_JOINTS,
    "safe_lower_torque_limit": N_JOINTS,
}
BLEND_FIELDS = {
    1: ("beta_vel_amplitude",),
    2: ("db_vel_vec", "sat_vec_vec", "fric_comp_ratio_vec"),
}
FILE_NAME = re.compile(r"gc-(?P<arm>MTM[LR])-(?P<serial>.+)\.json")
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
RANGE_FIELDS = ("joint_position_lower_limit", "joint_position_upper_limit")


@dataclass(frozen=True, eq=False)
class ConsoleFile:
    """One calibration file of the console, its numbers checked for kind and length.

    Attributes:
        document: The whole file.
        arm: ``mtml`` or ``mtmr``.
        version: 1 or 2.
        positive: (40,) parameters while a joint moves up: kg·m, then N·m/rad^k.
        negative: (40,) parameters while it moves down.
        safe_lower: (7,) the console clips its torques to these, N·m.
        safe_upper: (7,) likewise.
        blend: How it chooses between the two; version 1's has no dead band, and is a sine.
        valid: The calibrated range; early files have none, and this no edges.
    """

    document: Mapping[str, Any]
    arm: str
    version: int
    positive: Array
    negative: Array
    safe_lower: Array
    safe_upper: Array
    blend: Blend
    valid: Range

    @classmethod
    def load(cls, path: str | Path) -> ConsoleFile:
        """Read a console file.

        Raises:
            ConfigError: Naming the file, the field, the value and what was expected.
        """
        document = with_arm(json_file.load(path), path)
        try:
            return cls.from_document(document)
        except ConfigError as error:
            raise error.in_file(path) from None

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> ConsoleFile:
        """Take a file's content.

        Raises:
            ConfigError: The first of :func:`field_problems`.
        """
        for problem in field_problems(document):
            raise problem
        section = document[SECTION]
        version = _version(document) or 0

        def row(name: str) -> Array:
            return np.array(section[name], dtype=float)

        if version == 1:
            zeros, ones = np.zeros(N_JOINTS), np.ones(N_JOINTS)
            blend = Blend(zeros, row("beta_vel_amplitude"), ones, "sine")
        else:
            dead_band, saturation, ratio = (row(name) for name in BLEND_FIELDS[2])
            blend = Blend(dead_band, saturation, ratio)
        lower, upper = (
            np.radians(row(name)) if name in section else np.full(N_JOINTS, none)
            for name, none in zip(RANGE_FIELDS, (-np.inf, np.inf), strict=True)
        )
        return cls(
            document,
            ARMS[document["ARM_NAME"]],
            version,
            row("gc_dynamic_params_pos"),
            row("gc_dynamic_params_neg"),
            row("safe_lower_torque_limit"),
            row("safe_upper_torque_limit"),
            blend,
            Range(lower, upper),
        )

    @property
    def polynomials(self) -> JointPolynomials:
        """Its polynomials, five coefficients for each of seven joints, and the calibrated range."""
        # A column of zeros: none for joint 7.
        positive, negative = (
            np.pad(side[N_GRAVITY:].reshape(N_POLYNOMIALS, N_POWERS), ((0, 1), (0, 0))).T
            for side in (self.positive, self.negative)
        )
        return JointPolynomials(positive, negative, self.valid)

    def model(self) -> TorqueModel:
        """Return the torque model: inside the calibrated range the console's, unclipped.

        Raises:
            ConfigError: The gravity parameters differ between the two directions.
        """
        for index in np.flatnonzero(self.positive[:N_GRAVITY] != self.negative[:N_GRAVITY]):
            # Gravity does not know which way a joint moves; a blend of two gravities has no beta.
            raise ConfigError(
                f"{SECTION}.gc_dynamic_params_neg[{index}]",
                float(self.negative[index]),
                f"{self.positive[index]:.17g}, as in gc_dynamic_params_pos: gravity is one",
            )
        beta = self.positive[:N_GRAVITY] * GRAVITY
        form = form_model(Arm.load(self.arm), beta, self.polynomials, self.blend)
        document = json.dumps(self.document, separators=(",", ":"))
        # By way of its parameters, which are checked.
        values = form.parameters() | {"console.document": document}
        return TorqueModel.from_parameters(values, form.arm)


def form_model(arm: Arm, beta: Array, polynomials: JointPolynomials, blend: Blend) -> TorqueModel:
    """Return the model that the console's numbers are.

    Args:
        arm: The arm.
        beta: (10,) base parameters of gravity, N·m.
        polynomials: Two sets of (5, 7) coefficients, and their range.
        blend: How the console chooses between them.
    """
    cable = DirectionalCable(
        arm, polynomials.positive, polynomials.negative, polynomials.valid, blend
    )
    return TorqueModel(arm, (Gravity(arm, beta, np.array(LEVEL)), cable))


def sample_torques(model: TorqueModel) -> Array:
    """Return what a model asks for over the range on which it was calibrated.

    Args:
        model: A model of gravity and cables.

    Returns:
        (3, N, 7) torques, N·m: moving down, at rest and moving up, at N poses uniform over the
        calibrated range within the arm's limits, the same ones each time.
    """
    lower, upper = model.arm.lower, model.arm.upper
    for term in model.terms:
        if (valid := term.fitted_range) is not None:
            lower, upper = valid.hold(lower), valid.hold(upper)
    q = np.random.default_rng(0).uniform(lower, upper, (N_POSES, N_JOINTS))
    motions = (np.full_like(q, speed) for speed in (-FAST, 0.0, FAST))
    return np.stack([model.torque(q, motion) for motion in motions])


def safe_limits(model: TorqueModel) -> tuple[Array, Array]:
    """Return (7,) lower and (7,) upper safe limits, N·m, that a model keeps over its range.

    They are a tenth beyond what the model asks for, within what the actuators give, and never away
    from zero: a limit on the far side of zero would push the arm.
    """
    torques = sample_torques(model)
    least, most = torques.min(axis=(0, 1)), torques.max(axis=(0, 1))
    margin, able = 0.1 * (most - least), model.arm.effort_limit
    return np.clip(least - margin, -able, 0.0), np.clip(most + margin, 0.0, able)


def with_arm(document: Mapping[str, Any], path: str | Path) -> Mapping[str, Any]:
    """Return a file's content with the arm that its name says, where the content does not.

    The console reads neither: which arm a file is for is said by the arm that names the file.

    Raises:
        ConfigError: The file is one of the console's that names such files, or none.
    """
    if SECTION not in document:
        refuse_configuration(document, Path(path))
    match = FILE_NAME.fullmatch(Path(path).name)
    if match is None or document.get("ARM_NAME") is not None:
        return document
    return {"ARM_NAME": match["arm"], "SN": match["serial"], **document}


def field_problems(document: Mapping[str, Any]) -> Iterator[ConfigError]:
    """Yield what keeps a file from being used: missing fields, wrong kinds and lengths."""
    version = _version(document)
    if version is None:
        yield ConfigError("version", document.get("version"), 'the text "1.0" or "2.0"')
    if document.get("ARM_NAME") not in (*ARMS,):
        expected = "MTML or MTMR, there or in the file's name: gc-<ARM>-<serial number>.json"
        yield ConfigError("ARM_NAME", document.get("ARM_NAME"), expected)
    section = document.get(SECTION)
    if not isinstance(section, dict):
        yield ConfigError(SECTION, section, "an object")
        return
    lengths = dict(_LENGTHS)
    lengths |= dict.fromkeys(BLEND_FIELDS.get(version or 0, ()), N_JOINTS)
    if any(name in section for name in RANGE_FIELDS):
        lengths |= dict.fromkeys(RANGE_FIELDS, N_JOINTS)
    sound = set()
    for name, length in lengths.items():
        problems = list(_array_problems(f"{SECTION}.{name}", section.get(name), length))
        yield from problems
        if not problems:
            sound.add(name)
    yield from _order_problems({name: section[name] for name in sound})


def _version(document: Mapping[str, Any]) -> int | None:
    """Return 1 or 2 as the console reads it: the whole part of the number that a text begins with.

    A number is taken for its text.
    """
    given = document.get("version")
    match = None if isinstance(given, bool) else _NUMBER.match(str(given))
    whole = int(min(float(match[0]), 3.0)) if match else 0
    return whole if whole in BLEND_FIELDS else None


def _array_problems(field: str, value: Any, length: int) -> Iterator[ConfigError]:
    if not isinstance(value, list):
        yield ConfigError(field, value, f"a list of {length} numbers")
    elif len(value) != length:
        yield ConfigError(field, f"{len(value)} entries", f"{length} numbers")
    else:
        for index, item in enumerate(value):
            if not _is_finite_number(item):
                yield ConfigError(f"{field}[{index}]", item, "a finite number")


def _is_finite_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:  # an integer beyond the largest double
        return False


def _order_problems(section: Mapping[str, list[float]]) -> Iterator[ConfigError]:
    """Yield blends and ranges that are upside down."""
    for i in range(N_JOINTS):
        if "beta_vel_amplitude" in section and section["beta_vel_amplitude"][i] <= 0:
            value = section["beta_vel_amplitude"][i]
            yield ConfigError(f"{SECTION}.beta_vel_amplitude[{i}]", value, "more than 0 rad/s")
        if "db_vel_vec" in section and section["db_vel_vec"][i] < 0:
            yield ConfigError(f"{SECTION}.db_vel_vec[{i}]", section["db_vel_vec"][i], "at least 0")
        if {"db_vel_vec", "sat_vec_vec"} <= set(section):
            low, high = section["db_vel_vec"][i], section["sat_vec_vec"][i]
            if high <= low:
                yield ConfigError(
                    f"{SECTION}.sat_vec_vec[{i}]", high, f"more than db_vel_vec, {low:g} rad/s"
                )
        if "fric_comp_ratio_vec" in section and not 0 <= section["fric_comp_ratio_vec"][i] <= 1:
            value = section["fric_comp_ratio_vec"][i]
            yield ConfigError(f"{SECTION}.fric_comp_ratio_vec[{i}]", value, "0 to 1")
        if set(RANGE_FIELDS) <= set(section):
            low, high = (section[name][i] for name in RANGE_FIELDS)
            if low >= high:
                yield ConfigError(
                    f"{SECTION}.{RANGE_FIELDS[0]}[{i}]",
                    low,
                    f"less than the upper limit, {high:g}",
                )
