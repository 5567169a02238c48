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
    N_GRAVITY,
    N_POLYNOMIALS,
    N_POWERS,
    RANGE_FIELDS,
    SECTION,
    ConsoleFile,
    safe_limits,
)
from dvrk_gravity.effects import DirectionalCable, ElasticCable, Gravity, Range, evaluate
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
    cable = _cable(model)
    document = json_file.loads(model.document) if model.document else _skeleton(model, serial)
    notes = [f"left out, settings of the nodes: {', '.join(model.node)}"] if model.node else []
    if model.document:
        try:
            version = ConsoleFile.from_document(document).version
        except ConfigError as error:
            raise ConfigError("console.document", str(error), "a console file") from error
        if version == 1:
            document["version"] = "2.0"
    if cable.shape == "sine":
        cable, note = _as_line(model, cable)
        notes.append(note)
    document["ARM_NAME"] = name
    _fill(document[SECTION], beta, cable)
    return Export(document, tuple(notes))


def _fill(section: dict[str, Any], beta: Array, cable: DirectionalCable) -> None:
    """Write the model's numbers into the controller's section."""
    for side, given in (("pos", cable.positive), ("neg", cable.negative)):
        field = f"gc_dynamic_params_{side}"
        old = section.get(field, [])
        polynomials = given[:, :N_POLYNOMIALS].T.ravel()
        section[field] = [
            *_kept(old[:N_GRAVITY], beta, lambda p: p * GRAVITY, lambda b: b / GRAVITY),
            *_kept(old[N_GRAVITY:], polynomials),
        ]
    blend = (cable.dead_band, cable.saturation_velocity, cable.ratio)
    for field, row in zip(BLEND_FIELDS[2], blend, strict=True):
        section[field] = _kept(section.get(field, []), row)
    # A range has to have a width: that of a joint that stood still gets a degree.
    still = np.where(cable.valid.lower == cable.valid.upper, np.radians(0.5), 0.0)
    edges = (cable.valid.lower - still, cable.valid.upper + still)
    for field, row in zip(RANGE_FIELDS, edges, strict=True):
        if np.isfinite(row).all():
            section[field] = _kept(section.get(field, []), row, math.radians, math.degrees)
        else:
            section.pop(field, None)


def _kept(
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
    term = model.term(Gravity.NAME)
    if not isinstance(term, Gravity):
        return np.zeros(N_GRAVITY)
    if not term.enabled:
        raise ConfigError("gravity_enabled", False, "true: the console cannot leave gravity out")
    if not np.array_equal(term.vector, [0.0, 0.0, -GRAVITY]):
        raise FormError(
            "gravity_vector",
            term.vector.tolist(),
            f"[0, 0, -{GRAVITY}]: the console's arm is level",
        )
    for index in np.flatnonzero(term.beta[N_GRAVITY:]) + N_GRAVITY:
        raise FormError(
            f"beta[{index}]", float(term.beta[index]), "0: the console has ten gravity columns"
        )
    return term.beta[:N_GRAVITY]


def _cable(model: TorqueModel) -> DirectionalCable:
    """Return all that depends on a joint's own position, as two sets of quartics."""
    if model.joint_offset.any():
        offset = model.joint_offset.tolist()
        raise FormError("joint_offset", offset, "zeros: the console has its own encoder offsets")
    for term in model.terms:
        if not isinstance(term, Gravity | ElasticCable | DirectionalCable):
            raise FormError(
                term.NAME,
                "a term of the model",
                "gravity, elastic_cable and directional_cable only: the console has no other",
            )
    elastic = model.term(ElasticCable.NAME)
    cable = model.term(DirectionalCable.NAME)
    if isinstance(cable, DirectionalCable):
        cable = replace(
            cable,
            positive=_quartic(f"{cable.NAME}.positive", cable.positive),
            negative=_quartic(f"{cable.NAME}.negative", cable.negative),
        )
    else:
        zeros = np.zeros((N_POWERS, N_JOINTS))
        everywhere = np.full(N_JOINTS, np.inf)
        valid = (
            elastic.valid if isinstance(elastic, ElasticCable) else Range(-everywhere, everywhere)
        )
        # The same set for both directions: any blend does.
        blend = (np.full(N_JOINTS, 0.02), np.full(N_JOINTS, 0.2), np.zeros(N_JOINTS))
        cable = DirectionalCable(model.arm, zeros, zeros, valid, *blend)
    if isinstance(elastic, ElasticCable):
        edges = ((elastic.valid.lower, cable.valid.lower), (elastic.valid.upper, cable.valid.upper))
        if not all(np.array_equal(*pair) for pair in edges):
            raise FormError(
                "elastic_cable.valid_lower",
                elastic.valid.lower.tolist(),
                "the range of directional_cable: the console has one for both",
            )
        both = _quartic(elastic.NAME, elastic.coefficients)
        cable = replace(cable, positive=cable.positive + both, negative=cable.negative + both)
    if np.isfinite(cable.valid.lower).all() != np.isfinite(cable.valid.upper).all():
        raise FormError("directional_cable.valid_lower", None, "both edges of the range, or none")
    return cable


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


def _as_line(model: TorqueModel, cable: DirectionalCable) -> tuple[DirectionalCable, str]:
    """Return version 1's blend as version 2's, and what that does to the torque."""
    q = np.linspace(cable.valid.hold(model.arm.lower), cable.valid.hold(model.arm.upper), 1001)
    gap = 0.5 * cable.ratio * np.abs(evaluate(cable.positive - cable.negative, q))
    worst = (SINE_MINUS_LINE * gap).max(axis=0)
    joint = int(worst.argmax())
    note = (
        f"version 1's sine blend becomes a line, full at {SINE_TO_LINE} of its amplitude: "
        f"torques of moving joints change by up to {worst[joint]:.2g} N·m ({JOINT_NAMES[joint]})"
    )
    rise = cable.saturation_velocity - cable.dead_band
    saturation = cable.dead_band + SINE_TO_LINE * rise
    return replace(cable, saturation_velocity=saturation, shape="linear"), note


def _dump(document: Any, indent: str = "") -> str:
    """Return JSON text, objects over several lines and everything else on one."""
    if not isinstance(document, dict) or not document:
        return json.dumps(document)
    inner = indent + "  "
    items = (f"{inner}{json.dumps(key)}: {_dump(value, inner)}" for key, value in document.items())
    return "{\n" + ",\n".join(items) + f"\n{indent}}}"
