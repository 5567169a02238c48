"""The arm that a model file names: its file, the unit of its efforts, and a check of its geometry.

Identified parameters belong to the geometry that they were identified with. A file with
another one is detected by a few numbers: the torques that hold given masses on its links.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import as_array, as_value
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value, check_all
from dvrk_gravity.validation import is_urdf, split_link

ARM_PARAMETER = Parameter(
    "arm",
    "mtmr",
    "",
    "arm: mtml, mtmr, psm, ecm, or the path of an arm's .yaml or .urdf file, from the model file's "
    "folder",
    read_only=True,
    adjustable=True,
)
_UNIT = Parameter(
    "effort_unit", "", "",
    "unit of the arm's efforts, and of the model's torques, if it is not N·m",
    read_only=True, adjustable=True,
)  # fmt: skip
_HELD = Parameter(
    "held_joints", "", "",
    "joints of the arm's file that are held still, and not in the model: JOINT=POSITION,… (rad, "
    "m)", read_only=True,
)  # fmt: skip
_GAINS, _GAIN_ERROR, _EFFORT_SIZE = "drive_gains", "drive_gain_error", "effort_size"
_GEOMETRY = "arm_geometry"
_READ, _COMMAND = "effort_has_gravity.read", "effort_has_gravity.command"

_SAME = 1e-6  # of the largest number: a hundredth of a millimetre on an arm of a metre is 1e-5
_GRAVITY = np.array([3.0, 2.0, -6.0])  # no axis of an arm, and no plane of one, is along it


def arm_parameters(arm: Arm) -> tuple[Parameter, ...]:
    """Return the declarations of what a model file says of its arm."""
    gains = Parameter(
        _GAINS, (), "N·m/A", "N·m (or N) per A, of an arm whose efforts are currents",
        lower=0.0, lengths=(arm.n,), read_only=True,
    )  # fmt: skip
    gain_error = Parameter(
        _GAIN_ERROR, (), "1", "relative standard errors of drive_gains",
        lower=0.0, lengths=(arm.n,), read_only=True,
    )  # fmt: skip
    size = Parameter(
        _EFFORT_SIZE, 1.0, "1/(N·m)",
        "approximate size of 1 N·m in effort_unit, to scale the arm's limits",
        lower=0.0, read_only=True,
    )  # fmt: skip
    read = Parameter(
        _READ, arm.gravity_in_reading, "", "measured efforts include the arm's weight",
        read_only=True, adjustable=True,
    )  # fmt: skip
    command = Parameter(
        _COMMAND, arm.gravity_in_command, "",
        "commanded efforts must include the arm's weight; false: the arm adds it",
        read_only=True, adjustable=True,
    )  # fmt: skip
    geometry = Parameter(
        _GEOMETRY, (), "N·m",
        "fingerprint of the arm's geometry: torques that hold given masses on its links",
        lengths=(arm.n,), read_only=True, adjustable=True,
    )  # fmt: skip
    return (ARM_PARAMETER, gains, gain_error, _UNIT, _HELD, size, geometry, read, command)


def arm_of(values: Mapping[str, Any]) -> Arm:
    """Return the arm that a model's parameters name.

    Raises:
        ConfigError: An arm that there is not, something else than a name, or a file whose geometry
            is not the one that the model was made with.
    """
    arm = Arm.load(str(ARM_PARAMETER.check(values.get(ARM_PARAMETER.name, ARM_PARAMETER.default))))
    arm = arm.with_held_joints(_held(values.get(_HELD.name, "")))
    declared = {entry.name: entry for entry in arm_parameters(arm) if entry is not ARM_PARAMETER}
    given = {
        name: values[name] for name in declared if values.get(name) or values.get(name) is False
    }
    joints = given.get(_GEOMETRY, ())
    if isinstance(joints, list | tuple) and joints and len(joints) != arm.n:
        raise ConfigError(
            ARM_PARAMETER.name, values.get(ARM_PARAMETER.name, f"nothing, which is {arm.name}"),
            f"an arm of {len(joints)} joints, as {_GEOMETRY} has it",
        )  # fmt: skip
    checked = check_all(declared, given)
    if known := checked.get(_GEOMETRY):
        _require_geometry(arm, as_array(known, arm.n, 0.0))
    if _READ in checked or _COMMAND in checked:
        read, command = (
            bool(checked.get(name, declared[name].default)) for name in (_READ, _COMMAND)
        )
        arm = replace(arm, gravity_in_reading=read, gravity_in_command=command)
    if gains := checked.get(_GAINS):
        error = checked.get(_GAIN_ERROR)
        spread = as_array(error, arm.n, 0.0) if error else None
        return arm.with_drive_gains(as_array(gains, arm.n, 0.0), spread)
    if unit := checked.get(_UNIT.name):
        size = checked.get(_EFFORT_SIZE, 1.0)
        assert isinstance(size, float)
        return arm.with_effort_unit(str(unit), size)
    return arm


def values_of(arm: Arm) -> dict[str, Value]:
    """Return the values from which :func:`arm_of` makes the arm again."""
    values: dict[str, Value] = {ARM_PARAMETER.name: arm.source or arm.name}
    if arm.drive_gains is not None and arm.drive_gain_error is not None:
        values[_GAINS] = as_value(arm.drive_gains)
        values[_GAIN_ERROR] = as_value(arm.drive_gain_error)
    if arm.held:
        held = ",".join(f"{name}={position:.17g}" for name, position in arm.held.items())
        values[_HELD.name] = held
    if not (arm.gravity_in_reading and arm.gravity_in_command):
        values |= {_READ: arm.gravity_in_reading, _COMMAND: arm.gravity_in_command}
    if arm.read_in:
        values |= {_UNIT.name: arm.read_in, _EFFORT_SIZE: arm.effort_size}
    if _is_file(arm.source):
        values[_GEOMETRY] = as_value(_geometry(arm))
    return values


def resolve_arm_path(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a model's parameters with the path of its arm's file as seen from here.

    A relative path is meant from the folder of the model's file; if there is no such file, from
    the working directory.
    """
    arm = values.get(ARM_PARAMETER.name)
    if isinstance(arm, str) and _is_relative(arm):
        there = str(folder / arm)
        if Arm.file(there).is_file():
            return {**values, ARM_PARAMETER.name: there}
    return dict(values)


def relative_arm_path(arm: str, folder: Path) -> str:
    """Return the arm as a file in a folder names it: the inverse of :func:`resolve_arm_path`."""
    if not _is_relative(arm) or not Arm.file(arm).is_file():
        return arm
    path = os.path.relpath(Arm.file(arm).resolve(), folder.resolve())
    link = split_link(arm)[1]
    return f"{path}#{link}" if link else path


def parts(arm: Arm, joints: Collection[str]) -> list[str]:
    """Return what names the parts of a branching URDF that some joints are of: robot.urdf#LINK.

    Each ends at the last link that one of these joints moves. None of a file without branches, for
    all of that is one part.

    Args:
        arm: The arm.
        joints: Names, of which some may be no joints of it.
    """
    path, link = split_link(arm.source)
    parents = [body.parent for body in arm.bodies]
    tips = [index for index in range(len(parents)) if index not in parents]
    if link or not is_urdf(path) or len(tips) < 2:
        return []
    known = np.array([name in joints for name in arm.joint_names])
    ends = []
    for index in tips:
        while index >= 0 and not known[arm.bodies[index].row != 0.0].any():
            index = parents[index]
        if index >= 0:
            ends.append(arm.bodies[index].name)
    return [f"{path}#{name}" for name in dict.fromkeys(ends)]


def _is_file(arm: str) -> bool:
    return is_urdf(arm) or arm.lower().endswith((".yaml", ".yml"))


def _is_relative(arm: str) -> bool:
    """Return whether an arm is given by a relative path."""
    return _is_file(arm) and not Path(arm).is_absolute()


def _held(text: Any) -> dict[str, float]:
    """Return positions by joint from ``JOINT=POSITION,…``."""
    found = {}
    for entry in filter(None, str(_HELD.check(text)).split(",")):
        name, _, position = entry.rpartition("=")
        try:
            found[name.strip()] = float(position)
        except ValueError as error:
            raise ConfigError(_HELD.name, entry, "JOINT=POSITION, rad or m") from error
    return found


@lru_cache(maxsize=8)
def _geometry(arm: Arm) -> Array:
    """Return the (n,) torques of 1 kg on each link, off its frame, at a pose like no other."""
    body = np.zeros(rigid_body.PER_LINK)
    body[:4] = 1.0, 0.1, -0.2, 0.3
    pose = arm.scale * np.linspace(0.3, 0.9, arm.n)
    torque = rigid_body.torque(
        arm, np.tile(body, len(arm.bodies)), pose[None], None, None, _GRAVITY
    )
    return np.asarray(torque[0])


def _require_geometry(arm: Arm, known: Array) -> None:
    now = _geometry(arm)
    if np.abs(now - known).max() > _SAME * np.abs(known).max():
        raise ConfigError(
            ARM_PARAMETER.name, arm.source, "the file as it was when the model was made: its "
            "geometry has changed, and the parameters no longer fit it; identify again"
        )  # fmt: skip
