"""A torque model as a URDF or an MJCF, and what the file costs by cause and joint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.exports import mjcf, urdf, urdf_edit
from dvrk_gravity.exports.form import FileModel, OmittedTorque, calibrated_range, project
from dvrk_gravity.exports.formats import Format
from dvrk_gravity.model import TorqueModel

SUFFIXES: dict[str, Format] = {".urdf": "URDF", ".xml": "MJCF", ".mjcf": "MJCF"}
"""Formats by the end of a file's name."""

_SAMPLES = 2000  # random states; an RMS is then good to two per cent
_SPEED = 1.0  # rad/s (``Arm.scale``) of a hand that guides an arm, at most
_GAIN = 5.0  # rad/s^2, of the same motion at 5 rad/s
_NOTHING = 1e-9  # N·m: rounding


@dataclass(frozen=True, eq=False)
class ExportResult:
    """A model as a file that other programs read.

    Attributes:
        text: Content of the file.
        form: Its format.
        file_model: What it has of the model.
        torque: (n,) RMS torque of the model over the range, N·m or N.
        left_out: What the file does not have, by cause.
        total: (n,) RMS of all of it together.
        lower: (n,) lower edge of the range, rad or m.
        upper: (n,) upper edge.
        notes: What else it does not say as the model does, a line each.
    """

    text: str
    form: Format
    file_model: FileModel
    torque: Array
    left_out: tuple[OmittedTorque, ...]
    total: Array
    lower: Array
    upper: Array
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the content of ``convert --json``."""
        joints = self.file_model.arm.joints

        def by_joint(values: Array) -> dict[str, float]:
            return {joint.name: float(v) for joint, v in zip(joints, values, strict=True)}

        return {
            "format": self.form,
            "unit": {joint.name: joint.effort_unit for joint in joints},
            "torque_rms": by_joint(self.torque),
            "left_out_rms": by_joint(self.total),
            "left_out": [
                {
                    "effect": part.name,
                    "why": part.why,
                    "rms": by_joint(part.rms),
                    "largest": by_joint(part.largest),
                }
                for part in self.left_out
            ],
            "range": {
                joint.name: [float(low), float(high)]
                for joint, low, high in zip(joints, self.lower, self.upper, strict=True)
            },
            "speed_at_most": by_joint(_SPEED * self.file_model.arm.scale),
            "acceleration_at_most": by_joint(_GAIN * self.file_model.arm.scale),
            "notes": list(self.notes),
        }


def export_model(model: TorqueModel, form: Format, folder: Path = Path()) -> ExportResult:
    """Return a model as a URDF or an MJCF.

    Args:
        model: The model.
        form: The format.
        folder: Where the file will be, from which it names meshes.

    Raises:
        ConfigError: A model that no file of that format can hold any part of.
    """
    file_model, parts, notes = project(model, form)
    lower, upper = calibrated_range(model)
    measured = _states(model, lower, upper)
    true = State(measured.q - model.joint_offset, measured.qd, measured.qdd)
    rest = State(true.q)
    left_out, total = list[OmittedTorque](), np.zeros(true.q.shape)
    for part in parts:
        state = true if part.moves else rest
        missed = part.model_torque(state) - part.file_torque(state)
        total += missed
        rms = np.sqrt(np.mean(missed**2, axis=0))
        if rms.max() > _NOTHING:
            left_out.append(OmittedTorque(part.name, part.why, rms, np.abs(missed).max(axis=0)))
    if form == "URDF":
        edit = urdf_edit.is_editable(file_model)
        content = urdf_edit.text(file_model, folder) if edit else urdf.text(file_model)
    else:
        content = mjcf.text(file_model)
        if light := mjcf.massless_links(file_model):
            notes.append(f"no mass or inertia of {', '.join(light)}: 1e-11 kg (kg·m^2) for MuJoCo")
    if not model.arm.direct_drive:
        notes.append("joints without their transmission: efforts and limits are the joints'")
    return ExportResult(
        content, form, file_model, np.sqrt(np.mean(model.torque_at(measured) ** 2, axis=0)),
        tuple(left_out), np.sqrt(np.mean(total**2, axis=0)), lower, upper, tuple(notes),
    )  # fmt: skip


def _states(model: TorqueModel, lower: Array, upper: Array) -> State:
    """Return random states over a range of measured positions."""
    random, scale = np.random.default_rng(1), model.arm.scale
    shape = (_SAMPLES, model.arm.n)
    way, gain = (size * scale * random.uniform(-1.0, 1.0, shape) for size in (_SPEED, _GAIN))
    return State(random.uniform(lower, upper, shape), way, gain)
