"""Any torque model as the dVRK console's calibration file: what it costs, and what is refused.

A model in the console's form (:mod:`.document`) goes into the file number by number, any
other by least squares (:mod:`.projection`). Either way the file is read again and compared
with what the compensator would command.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.arrays import Array
from dvrk_gravity.console.check import ConsoleFinding, Severity, check
from dvrk_gravity.console.document import Export, FormError, export, require_arm
from dvrk_gravity.console.file import N_POLYNOMIALS, ConsoleFile
from dvrk_gravity.console.projection import (
    calibrated_range,
    commanded_torque,
    project,
    uniform_poses,
    unsupported_parts,
    within_limits,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.units import quantity


@dataclass(frozen=True)
class CostSettings:
    """What the console's file may cost.

    Attributes:
        poses: At which it is judged: so many over the range, and as many with about half of the
            joints at its edges. Chosen: largest errors are then found to a few per cent.
        largest_share: At rest a file may be off by this part of what the joint needs (RMS)…
            Chosen.
        held_by_friction: … or by this part of its largest torque: dry friction holds so much
            anyway. A real MTM's, from 30 s of motion, is 1.8 % (shoulder_pitch) to 16 %
            (wrist_platform) of a joint's largest torque.
        nonsense: Times a joint's largest torque: no model of the arm asks for so much.
        overshoot: Deg beyond the arm's limits; zeros of encoders are off by less.
    """

    poses: int = 20_000
    largest_share: float = 0.25
    held_by_friction: float = 0.02
    nonsense: float = 10.0
    overshoot: float = 20.0


SETTINGS = CostSettings()


@dataclass(frozen=True)
class JointCost:
    """What the console's file costs on one joint, N·m.

    Attributes:
        torque: RMS of what the compensator commands at rest.
        rest_rms: RMS difference at rest.
        rest_max: Largest difference at rest.
        moving_rms: RMS difference at the speed at which the console's blend is full.
        moving_max: Largest difference there.
    """

    torque: float
    rest_rms: float
    rest_max: float
    moving_rms: float
    moving_max: float


@dataclass(frozen=True, eq=False)
class Conversion:
    """A model as a console file.

    Attributes:
        file: Content of the file, and what it does not say as the model does.
        exact: The model was in the console's form already.
        joints: What the file costs, by joint.
        lower: (7,) lower edge of the range over which that holds, rad.
        upper: (7,) upper edge.
        findings: What the check finds serious in the file.
    """

    file: Export
    exact: bool
    joints: Mapping[str, JointCost]
    lower: Array
    upper: Array
    findings: tuple[ConsoleFinding, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the content of ``convert --json``."""
        return {
            "exact": self.exact,
            "joints": {name: asdict(joint_cost) for name, joint_cost in self.joints.items()},
            "unit": "N·m",
            "range_rad": {
                name: [float(low), float(high)]
                for name, low, high in zip(JOINT_NAMES, self.lower, self.upper, strict=True)
            },
            "notes": list(self.file.notes),
            "findings": [asdict(finding) for finding in self.findings],
        }


def convert_model(model: TorqueModel, serial: str = "") -> Conversion:
    """Return the console file that commands what the compensator would with a model.

    Args:
        model: The model.
        serial: Serial number of an arm whose model carries no console file.

    Raises:
        ConfigError: The file would not be safe, by the rule that is named, or has no words for
            the model at all.
    """
    require_arm(model.arm)
    _refuse_nonsense(model)
    compensated = tuple(term for term in model.terms if term.COMPENSATED)
    notes: tuple[str, ...] = ()
    form, exact = replace(model, terms=compensated), True
    try:
        file = export(form, serial)
    except FormError:
        form, notes = project(model)
        file, exact = export(form, serial), False
    file = replace(file, notes=(*unsupported_parts(model), *notes, *file.notes))
    lower, upper = within_limits(model, calibrated_range(form))
    if model.reading_errors.any:
        note = _cost_of_wrong_readings(model, lower, upper)
        file = replace(file, notes=(*file.notes, note))
    joints = cost(model, ConsoleFile.from_document(file.document), lower, upper)
    _refuse_what_costs_too_much(model, joints)
    serious = tuple(
        finding for finding in check(file.document) if finding.severity is Severity.SERIOUS
    )
    if not model.document:
        _refuse_the_wrong_arm(model, serious)
    return Conversion(file, exact, joints, lower, upper, serious)


def cost(
    model: TorqueModel, console: ConsoleFile, lower: Array, upper: Array
) -> dict[str, JointCost]:
    """Compare what the compensator commands with a model and with a console file's model.

    Args:
        model: The model.
        console: The console's file.
        lower: (7,) lower edge of the range over which they are compared, rad.
        upper: (7,) upper edge.
    """
    random = np.random.default_rng(2)
    uniform = uniform_poses(lower, upper, SETTINGS.poses, 2)
    # What is largest tends to lie where some joints are at an edge.
    index = random.integers(0, 4, uniform.shape)
    edges = np.choose(index, [lower, upper, uniform, uniform])
    form = console.model()
    speed = console.blend.saturation_velocity * random.choice([-1.0, 1.0], uniform.shape)
    torque = np.sqrt(np.mean(commanded_torque(model, uniform) ** 2, axis=0))
    found = []
    for motion in (None, speed):
        inside, outermost = (
            np.abs(commanded_torque(form, q, motion) - commanded_torque(model, q, motion))
            for q in (uniform, edges)
        )
        found.append(np.sqrt(np.mean(inside**2, axis=0)))
        found.append(np.maximum(inside.max(axis=0), outermost.max(axis=0)))
    rows = np.stack([torque, *found], axis=1).tolist()
    return {name: JointCost(*row) for name, row in zip(JOINT_NAMES, rows, strict=True)}


def _cost_of_wrong_readings(model: TorqueModel, lower: Array, upper: Array) -> str:
    """Return a note on the torque error of a console, which does not correct readings.

    Drives are taken to apply efforts at the scale at which they are read.
    """
    errors, q = model.reading_errors, uniform_poses(lower, upper, SETTINGS.poses, 2)
    applied = commanded_torque(model, q @ errors.position.T) @ np.linalg.inv(errors.effort).T
    off = np.sqrt(np.mean((applied - commanded_torque(model, q)) ** 2, axis=0))
    worst = int(np.argmax(off))
    return (
        f"left out, known errors of readings: {', '.join(model.of_readings())} (the console takes "
        f"readings as they are: torque at rest is off by {quantity(off[worst], 'N·m')} RMS at "
        f"{JOINT_NAMES[worst]} if its drives take efforts at the scale that they are read at)"
    )


def _refuse_nonsense(model: TorqueModel) -> None:
    lower, upper = within_limits(model, calibrated_range(model))
    with np.errstate(over="ignore", invalid="ignore"):
        most = np.abs(commanded_torque(model, uniform_poses(lower, upper, 200, 3))).max(axis=0)
    able = model.arm.effort_limit.tolist()
    for name, value, largest in zip(JOINT_NAMES, most.tolist(), able, strict=True):
        if not value <= SETTINGS.nonsense * largest:
            raise ConfigError(
                name,
                f"{value:.3g} N·m within its range",
                f"at most {SETTINGS.nonsense * largest:.3g}",
            )


def _refuse_what_costs_too_much(model: TorqueModel, joints: Mapping[str, JointCost]) -> None:
    """Refuse a file that is off by a good part of what a joint needs and of what it can give.

    Joint 7 is left alone by every console file, good ones as well.
    """
    able = model.arm.effort_limit[:N_POLYNOMIALS].tolist()
    for (name, joint_cost), largest in zip(joints.items(), able, strict=False):
        most = max(SETTINGS.largest_share * joint_cost.torque, SETTINGS.held_by_friction * largest)
        if joint_cost.rest_rms > most:
            raise ConfigError(
                name,
                f"{quantity(joint_cost.rest_rms, 'N·m')} (RMS) at rest that the console cannot "
                "command",
                f"at most {quantity(most, 'N·m')}: {SETTINGS.largest_share:.0%} of what the joint "
                f"needs or {SETTINGS.held_by_friction:.0%} of its largest torque (identify --for "
                "console fits a model of the console's form)",
            )


def _refuse_the_wrong_arm(model: TorqueModel, serious: tuple[ConsoleFinding, ...]) -> None:
    limits = dict(zip(JOINT_NAMES, np.degrees([model.arm.lower, model.arm.upper]).T, strict=True))
    for finding in serious:
        if finding.code == "range":
            low, high = limits[finding.subject]
            beyond = max(low - finding.numbers["lower_deg"], finding.numbers["upper_deg"] - high)
            wrong = beyond > SETTINGS.overshoot
        else:
            wrong = finding.code == "other_hand"
        if wrong:
            raise ConfigError(
                finding.subject, finding.text, "a model of the arm that the file is for"
            )
