"""Columns of a CSV file: the meaning of their names, as programs write or users map them."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.recording.notes import Note

DEGREE = np.pi / 180.0
# Factors to rad, m, N·m, N, A and s; by what they are units of.
UNITS: dict[str, dict[str, float]] = {
    "position": {"rad": 1.0, "deg": DEGREE, "°": DEGREE, "m": 1.0, "mm": 1e-3},
    "velocity": {"rad/s": 1.0, "deg/s": DEGREE, "°/s": DEGREE, "m/s": 1.0, "mm/s": 1e-3},
    "effort": {
        "nm": 1.0, "n·m": 1.0, "n.m": 1.0, "n*m": 1.0, "n m": 1.0, "n": 1.0, "a": 1.0, "ma": 1e-3,
        "mnm": 1e-3, "ncm": 1e-2, "nmm": 1e-3, "knm": 1e3, "kn": 1e3,
    },
    "time": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "direction": {},
}  # fmt: skip
Quantity = Literal["time", "position", "velocity", "effort", "direction", "name", "nothing"]
Columns = Mapping[str, str] | str | Path
EXPECTED = "time, direction or <joint>.position/velocity/effort/direction"
WAY_OUT = "; or --columns 'NAME=time,NAME=<joint>.position,…'"
OF_READINGS: tuple[Quantity, ...] = ("position", "velocity", "effort", "direction")
# One maker's spelling a line: of position, velocity and effort; "": as another line has it.
_SPELLINGS: tuple[tuple[str, str, str], ...] = (
    ("position", "velocity", "effort"),
    ("positions", "velocities", "efforts"),
    ("pos", "vel", "eff"),
    ("q", "qd", "tau"),
    ("angle", "speed", "torque"),
    ("angles", "", "torques"),
    ("", "dq", "tau_j"),
    ("", "qdot", "current"),
    ("", "q_dot", "currents"),
    ("", "", "moment"),
    ("jpos", "jvel", ""),
    ("joint_pos", "joint_vel", ""),
    ("joint_position", "joint_velocity", "joint_torque"),
    ("joint_positions", "joint_velocities", "joint_torques"),
    ("", "", "joint_effort"),
    ("jointposition", "jointvelocity", "jointtorque"),
    ("", "", "jointeffort"),
    ("actual_q", "actual_qd", "actual_current"),
    ("actual_position", "actual_velocity", "actual_moment"),
    ("measured_q", "measured_dq", ""),
    ("q_measured", "", ""),
    ("state_q", "state_dq", "state_tau_j"),
)
_SPELLED: tuple[Quantity, ...] = ("position", "velocity", "effort")
_QUANTITY: dict[str, Quantity] = {
    "name": "name",
    **{word: quantity for line in _SPELLINGS
       for quantity, word in zip(_SPELLED, line, strict=True) if word},
}  # fmt: skip
# The best first: where a file has several, the first of these is its time.
TIMES = ("time", "__time", "%time", "timestamp", "time_stamp", "stamp", "rosbagtimestamp",
         "receive time", "elapsed time", "elapsed", "duration", "seconds", "t")  # fmt: skip
_SECONDS, _NANOSECONDS = {"sec", "secs"}, {"nanosec", "nsec", "nsecs", "nanosecs"}
# Words of commands, which are no readings.
_COMMANDS = ("target", "desired", "setpoint", "command", "cmd", "goal", "reference")
_INDEXES = {"", "index", "unnamed: 0", "#", "row"}  # of rows, that pandas and others write first

_SUFFIX = re.compile(r"^(time|timestamp|stamp|t|position|pos|angle)_(ns|us|ms|s|sec|deg|rad)$")
_NUMBERED = re.compile(r"^(.*?)_?v?(\d+)$")
_JOINT_NUMBER = re.compile(r"^(?:joint|axis|motor|j|a|q)_?(\d+)$")


@dataclass(frozen=True)
class ColumnName:
    """Meaning of a column's name.

    Attributes:
        quantity: Quantity of the column; ``nothing``: an index of rows, which is not read.
        joint: Name of the joint, ``""`` where a number stands for it.
        number: Number of the joint in the file's own count; -1 where its name is given.
        unit: As written; ``""`` where it is not.
        prefix: Text before it, such as a topic: columns of one prefix belong together.
        part: Of a time: ``stamp`` of a header, its ``sec`` or ``nanosec``, or ``plain``.
        command: Whether it is a command to the arm.
        native: Whether it is named as this package names columns.
    """

    quantity: Quantity
    joint: str = ""
    number: int = -1
    unit: str = ""
    prefix: str = ""
    part: str = "plain"
    command: bool = False
    native: bool = False


def recognised(text: str, known: Collection[str] = ()) -> ColumnName | None:
    """Return the meaning of a header's text, ``None`` if unknown; ``known``: an arm's joints."""
    if text.lower() in _INDEXES:
        return ColumnName("nothing")
    text, unit = _without_unit(text)
    if not unit and (found := _SUFFIX.match(text.lower())):
        text, unit = found[1], found[2]
    if text in ("time", "direction"):
        return ColumnName("time" if text == "time" else "direction", unit=unit, native=True)
    joint, _, quantity = text.rpartition(".")
    if joint and quantity in ("position", "velocity", "effort", "direction"):
        path, _, own = joint.rpartition("/")
        of: Quantity = quantity  # type: ignore[assignment]
        name, prefix = (joint, "") if joint in known else (own, path)
        return ColumnName(
            of, name, unit=unit, prefix=prefix, command=commanded(path), native=not prefix
        )
    time = _time(text)
    if time is not None:
        return ColumnName("time", unit=unit, prefix=time[0], part=time[1])
    column = _of_joint(text, known)
    if column is None:
        return None
    made, prefix = column
    command = commanded(text.replace(made.joint, ""))
    return ColumnName(made.quantity, made.joint, made.number, unit, prefix, command=command)


def _without_unit(text: str) -> tuple[str, str]:
    """Return a text without the unit in brackets at its end, and that; ``""``: it has none.

    A number in brackets is an index.
    """
    begin = max(text.rfind("["), text.rfind("("))
    unit = text[begin + 1 : -1].strip()
    if begin < 0 or text[-1] not in "])" or not unit or unit[0].isdigit():
        return text, ""
    if any(mark in unit for mark in "])"):
        return text, ""
    return text[:begin].rstrip(), unit


def commanded(text: str) -> bool:
    """Return whether a name is that of commands, which are no readings."""
    lower = text.lower()
    return any(word in lower for word in _COMMANDS)


def _time(text: str) -> tuple[str, str] | None:
    """Return the prefix of a time's name, and which part of a time it is."""
    lower = text.lower().strip()
    if lower in TIMES:
        return "", "plain"
    *before, last = re.split(r"[./\-]", lower)
    prefix = "/".join(part for part in before if part not in ("header", "stamp", "field", ""))
    if last in _SECONDS | _NANOSECONDS:
        return prefix, "sec" if last in _SECONDS else "nanosec"
    if last == "stamp" and before and before[-1] == "header":
        return prefix, "stamp"
    if last == "timestamp" and before:  # as cisst's collector writes it
        return prefix, "stamp"
    return None


def _of_joint(text: str, known: Collection[str]) -> tuple[ColumnName, str] | None:
    """Return quantity and joint of a column, by name or number, and their prefix."""
    parts = [part for part in re.split(r"[\s./\-\[\]()]+", text) if part]
    if not parts:
        return None
    lower = [part.lower() for part in parts]
    if lower[-1] in _QUANTITY and len(parts) > 1:  # …/joint/position, joint.pos
        quantity, joint = _QUANTITY[lower[-1]], parts[-2]
        number = _JOINT_NUMBER.match(lower[-2])
        made = ColumnName(quantity, joint)
        if number and joint not in known:
            made = ColumnName(quantity, number=int(number[1]))
        return made, "/".join(parts[:-2])
    if len(parts) > 1 and lower[-2] in _QUANTITY:  # position[0], position/joint
        if lower[-1].lstrip("v").isdigit():
            return ColumnName(
                _QUANTITY[lower[-2]], number=int(lower[-1].lstrip("v"))
            ), "/".join(parts[:-2])  # fmt: skip
        if parts[-1] in known:
            return ColumnName(_QUANTITY[lower[-2]], parts[-1]), "/".join(parts[:-2])
    for joint in sorted(known, key=len, reverse=True):  # joint_pos, position_joint
        for rest in (parts[-1].removeprefix(f"{joint}_"), parts[-1].removesuffix(f"_{joint}")):
            if rest != parts[-1] and rest.lower() in _QUANTITY:
                return ColumnName(_QUANTITY[rest.lower()], joint), "/".join(parts[:-1])
    numbered = _NUMBERED.match(lower[-1])  # q1, position0, actual_q_0
    if numbered and numbered[1] in _QUANTITY:
        return ColumnName(_QUANTITY[numbered[1]], number=int(numbered[2])), "/".join(parts[:-1])
    return None


class Mapped(NamedTuple):
    """What a user maps: targets by the names of columns, and joints by their recorded names."""

    columns: dict[str, str]
    joints: dict[str, str]

    def of_bag(self, arm: Arm | None) -> Mapping[str, str]:
        """Return the joints; raise ``ConfigError`` for columns, or joints that are not an arm's."""
        for name, target in self.columns.items():
            raise ConfigError("--columns", f"{name}={target}", "NAME=<joint> for a bag")
        for name, joint in self.joints.items():
            if arm is not None and joint not in arm.joint_names:
                known = ", ".join(arm.joint_names)
                raise ConfigError("--columns", f"{name}={joint}", f"a joint of {arm.name}: {known}")
        return self.joints


def read_columns(given: Columns | None) -> Mapped:
    """Return a user's mapping of columns and joints.

    Args:
        given: ``NAME=TARGET,…``, the path of a YAML file with ``NAME: TARGET``, or such a mapping.
            A target is ``time``, ``direction`` or ``<joint>.position``, ``.velocity``, ``.effort``,
            followed by its unit where it is not the SI one: ``time[ms]``, ``elbow.position[deg]``.
            Columns of a file without a header are called 1, 2, 3, …. Or it is a joint alone, which
            is recorded under the name, in a bag, too.

    Raises:
        ConfigError: Something else.
    """
    if given is None:
        return Mapped({}, {})
    text = str(given)
    expected = "NAME=time,NAME=<joint>.position,… or a .yaml file with NAME: <joint>.position"
    if isinstance(given, Mapping):
        found = dict(given)
    elif text.lower().endswith((".yaml", ".yml")) and "=" not in text:
        found = yaml_file.load(text)
        if not isinstance(found, dict):
            raise ConfigError("", found, "NAME: <joint>.position in each line", text)
    else:
        entries = [entry.rpartition("=") for entry in text.split(",") if entry.strip()]
        if not entries or not all(equals for _, equals, _ in entries):
            raise ConfigError("--columns", text, expected)
        found = {name.strip(): target.strip() for name, _, target in entries}
    result = Mapped({}, {})
    for name, target in ((str(name), str(target).strip()) for name, target in found.items()):
        column = recognised(target)
        if column is None or column.number >= 0:
            if not re.fullmatch(r"[^\s.\[\]()]+", target):
                raise ConfigError("--columns", f"{name}={target}", f"a target: {EXPECTED}")
            result.joints[name] = target
        elif column.quantity in ("time", *OF_READINGS):
            result.columns[name] = target
        else:
            raise ConfigError("--columns", f"{name}={target}", f"a target: {EXPECTED}")
    return result


@dataclass(frozen=True)
class TimeColumns:
    """Place of a file's times: one column, or one of seconds and one of nanoseconds.

    Attributes:
        columns: Its, or their, numbers in the file.
        factor: To seconds; ``None``: its unit is not stated.
        text: Whether it holds dates.
    """

    columns: tuple[int, ...]
    factor: float | None = None
    text: bool = False


@dataclass(frozen=True)
class Header:
    """Places of a file's columns.

    Attributes:
        names: Of all its columns.
        joints: Those that are read, in the arm's order.
        time: Place of the times; ``None``: static poses.
        quantities: Number in the file of each joint's column; -1 of a joint that has none.
        factors: (n,) by which a quantity's columns are multiplied.
        same: Pairs of columns of one name, which must hold the same.
        notes: Which columns were read as what.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    time: TimeColumns | None
    quantities: dict[str, list[int]]
    factors: dict[str, Array]
    same: tuple[tuple[int, int], ...] = ()
    notes: tuple[Note, ...] = ()

    @property
    def used(self) -> list[int]:
        """Numbers of all columns that are read."""
        found = set(self.time.columns if self.time else ())
        found.update(column for columns in self.quantities.values() for column in columns)
        found.update(column for pair in self.same for column in pair)
        return sorted(found - {-1})
