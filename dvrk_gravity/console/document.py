"""Write a torque model as version 2 of the dVRK console's calibration file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dvrk_gravity.arms import GRAVITY, JOINT_NAMES, N_JOINTS, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.console.file import (
    ARMS,
    BLEND_FIELDS,
    LEVEL,
    N_GRAVITY,
    N_POLYNOMIALS,
    N_POWERS,
    RANGE_FIELDS,
    SECTION,
    ConsoleFile,
    safe_limits,
)
from dvrk_gravity.effects import Blend, JointPolynomials, Range, evaluate
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file
from dvrk_gravity.model import TorqueModel

# A line from 0 to full blend at this part of the amplitude is as near to the sine as a line
# gets: min over k of max over x of |sin(pi x / 2) - min(x / k, 1)|, 0.0664 at k = 0.7666.
SINE_TO_LINE = 0.7666
SINE_MINUS_LINE = 0.0665

_INITIAL_POSITION = [0, 0, 0, 0, 90, 0, 0]  # degrees; the pose where the console's own files start


class FormError(ConfigError):
    """A model that is not in the console's form, so that not every number has its place."""


@dataclass(frozen=True)
class Export:
    """A model in the console's words.

    Attributes:
        document: Content of the file, version "2.0".
        notes: What the file does not say as the model does, a line each.
    """

    document: dict[str, Any]
    notes: tuple[str, ...]

    def text(self) -> str:
        """Return the file's text; a list of numbers takes one line."""
        return _dump(self.document) + "\n"


def require_arm(arm: Arm) -> str:
    """Return what the console calls an arm.

    Raises:
        ConfigError: It does not know it.
    """
    name = next((name for name, known in ARMS.items() if known == arm.name), None)
    if name is None:
        raise ConfigError("arm", arm.name, "mtml or mtmr: the console knows no other")
    return name


def export(model: TorqueModel, serial: str = "") -> Export:
    """Return the console file of a model.

    A model that came from a console file gives that file back, with only those fields
    rewritten about which the model says something else.

    Args:
        model: The model.
        serial: Serial number of an arm whose model carries no console file.

    Raises:
        FormError: The console has no place for a part of the model; it is named.
        ConfigError: The model cannot become a console file at all.
    """
    name = require_arm(model.arm)
    beta = _beta(model)
    polynomials, blend = _polynomials(model)
    document = json_file.loads(model.document) if model.document else _skeleton(model, serial)
    notes = [f"left out, settings of the nodes: {', '.join(model.node)}"] if model.node else []
    if model.document:
        try:
            version = ConsoleFile.from_document(document).version
        except ConfigError as error:
            raise ConfigError("console.document", str(error), "a console file") from error
        if version == 1:
            document["version"] = "2.0"
    if blend.shape == "sine":
        blend, note = _as_line(model, polynomials, blend)
        notes.append(note)
    document["ARM_NAME"] = name
    _fill(document[SECTION], beta, polynomials, blend)
    return Export(document, tuple(notes))


def _fill(
    section: dict[str, Any], beta: Array, polynomials: JointPolynomials, blend: Blend
) -> None:
    """Write the model's numbers into the controller's section."""
    for side, given in (("pos", polynomials.positive), ("neg", polynomials.negative)):
        field = f"gc_dynamic_params_{side}"
        old = section.get(field, [])
        section[field] = [
            *_updated_numbers(old[:N_GRAVITY], beta, lambda p: p * GRAVITY, lambda b: b / GRAVITY),
            *_updated_numbers(old[N_GRAVITY:], given[:, :N_POLYNOMIALS].T.ravel()),
        ]
    ramp = (blend.dead_band, blend.saturation_velocity, blend.ratio)
    for field, row in zip(BLEND_FIELDS[2], ramp, strict=True):
        section[field] = _updated_numbers(section.get(field, []), row)
    # A range has to have a width: that of a joint that stood still gets a degree.
    valid = polynomials.valid
    still = np.where(valid.lower == valid.upper, np.radians(0.5), 0.0)
    edges = (valid.lower - still, valid.upper + still)
    for field, row in zip(RANGE_FIELDS, edges, strict=True):
        if np.isfinite(row).all():
            section[field] = _updated_numbers(
                section.get(field, []), row, math.radians, math.degrees
            )
        else:
            section.pop(field, None)


def _updated_numbers(
    old: list[Any],
    new: Array,
    to_model: Callable[[float], float] = float,
    from_model: Callable[[float], float] = float,
) -> list[Any]:
    """Return the file's numbers, each rewritten only where the model says something else."""
    values = new.tolist()
    if not old:
        return [from_model(value) for value in values]
    return [
        was if to_model(was) == value else from_model(value)
        for was, value in zip(old, values, strict=True)
    ]


def _beta(model: TorqueModel) -> Array:
    """Return the (10,) gravity parameters, N·m."""
    total = np.zeros(N_GRAVITY)
    for term in model.terms:
        beta = term.gravity_beta
        if beta is None:
            continue
        if beta.any() and not term.carries_arm:
            expected = "true: the console cannot leave gravity out"
            raise ConfigError("gravity_enabled", False, expected)
        if not np.array_equal(model.gravity, LEVEL):
            expected = f"[0, 0, -{GRAVITY}]: the console's arm is level"
            raise FormError("gravity_vector", model.gravity.tolist(), expected)
        for index in np.flatnonzero(beta[N_GRAVITY:]) + N_GRAVITY:
            expected = "0: the console has ten gravity columns"
            raise FormError(f"beta[{index}]", float(beta[index]), expected)
        total += beta[:N_GRAVITY]
    return total


def stated_polynomials(model: TorqueModel) -> list[tuple[str, JointPolynomials]]:
    """Return the polynomials of compensated terms, with these terms' names; zeros if none has any.

    The first has the blend, if there is one.

    Raises:
        ConfigError: Two terms have a blend.
    """
    zeros, everywhere = np.zeros((N_POWERS, N_JOINTS)), np.full(N_JOINTS, np.inf)
    nothing = JointPolynomials(zeros, zeros, Range(-everywhere, everywhere))
    found = [
        (term.NAME, term.polynomials)
        for term in model.terms
        if term.COMPENSATED and term.polynomials is not None
    ]
    found.sort(key=lambda each: each[1].blend is None)
    blended = [name for name, polynomials in found if polynomials.blend is not None]
    if len(blended) > 1:
        expected = f"none but that of {blended[0]}: the console has one"
        raise ConfigError(blended[1], "a blend of two directions", expected)
    return found or [("", nothing)]


def _polynomials(model: TorqueModel) -> tuple[JointPolynomials, Blend]:
    """Return all that depends on a joint's own position, as two sets of quartics, and the blend."""
    if model.joint_offset.any():
        offset = model.joint_offset.tolist()
        raise FormError("joint_offset", offset, "zeros: the console has its own encoder offsets")
    for term in model.terms:
        if term.gravity_beta is None and term.polynomials is None:
            expected = "beta, or polynomials of a joint's own position: the console has no other"
            raise FormError(term.NAME, "a term of the model", expected)
    stated = stated_polynomials(model)
    first, valid = stated[0][0], stated[0][1].valid
    positive, negative = np.zeros((2, N_POWERS, N_JOINTS))
    for name, each in stated:
        edges = ((each.valid.lower, valid.lower), (each.valid.upper, valid.upper))
        if not all(np.array_equal(*pair) for pair in edges):
            expected = f"the range of {first}: the console has one for both"
            raise FormError(f"{name}.valid_lower", each.valid.lower.tolist(), expected)
        up, down = (".positive", ".negative") if each.blend else ("", "")
        positive += _quartic(name + up, each.positive)
        negative += _quartic(name + down, each.negative)
    if np.isfinite(valid.lower).all() != np.isfinite(valid.upper).all():
        raise FormError(f"{first}.valid_lower", None, "both edges of the range, or none")
    # The same set for both directions: any blend does.
    blend = Blend(np.full(N_JOINTS, 0.02), np.full(N_JOINTS, 0.2), np.zeros(N_JOINTS))
    return JointPolynomials(positive, negative, valid), stated[0][1].blend or blend


def _quartic(prefix: str, coefficients: Array) -> Array:
    """Return (5, 7) coefficients of what fits into the console's regressor."""
    for power, column in np.argwhere(coefficients):
        field = f"{prefix}.{JOINT_NAMES[column]}[{power}]"
        value = float(coefficients[power, column])
        if power >= N_POWERS:
            raise FormError(field, value, f"degree {N_POWERS - 1} at most: the console's limit")
        if column >= N_POLYNOMIALS:
            raise FormError(field, value, "0: the console has no polynomial for that joint")
    result = np.zeros((N_POWERS, N_JOINTS))
    rows = min(N_POWERS, len(coefficients))
    result[:rows] = coefficients[:rows]
    return result


def _skeleton(model: TorqueModel, serial: str) -> dict[str, Any]:
    """Return what a console file needs beyond the model."""
    if not serial:
        raise ConfigError(
            "SN", serial, "the arm's serial number in the file's name: gc-MTMR-28002.json"
        )
    lower, upper = safe_limits(model)
    return {
        "ARM_NAME": "",
        "SN": serial,
        "lse": {"g_constant": GRAVITY},
        SECTION: {
            "safe_upper_torque_limit": upper.tolist(),
            "safe_lower_torque_limit": lower.tolist(),
            "GC_init_pos": list(_INITIAL_POSITION),
        },
        "version": "2.0",
    }


def _as_line(model: TorqueModel, polynomials: JointPolynomials, blend: Blend) -> tuple[Blend, str]:
    """Return version 1's blend as version 2's, and what that does to the torque."""
    hold = polynomials.valid.hold
    q = np.linspace(hold(model.arm.lower), hold(model.arm.upper), 1001)
    gap = 0.5 * blend.ratio * np.abs(evaluate(polynomials.positive - polynomials.negative, q))
    worst = (SINE_MINUS_LINE * gap).max(axis=0)
    joint = int(worst.argmax())
    note = (
        f"version 1's sine blend becomes a line, full at {SINE_TO_LINE} of its amplitude: "
        f"torques of moving joints change by up to {worst[joint]:.2g} N·m ({JOINT_NAMES[joint]})"
    )
    rise = blend.saturation_velocity - blend.dead_band
    saturation = blend.dead_band + SINE_TO_LINE * rise
    return replace(blend, saturation_velocity=saturation, shape="linear"), note


def _dump(document: Any, indent: str = "") -> str:
    """Return JSON text, objects over several lines and everything else on one."""
    if not isinstance(document, dict) or not document:
        return json.dumps(document)
    inner = indent + "  "
    items = (f"{inner}{json.dumps(key)}: {_dump(value, inner)}" for key, value in document.items())
    return "{\n" + ",\n".join(items) + f"\n{indent}}}"
