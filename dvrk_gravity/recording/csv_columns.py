"""What the columns of a CSV file are: as a user says it, and as it is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.recording.column_names import Quantity, recognised
from dvrk_gravity.recording.notes import Note

Columns = Mapping[str, str] | str | Path
EXPECTED = "time, direction or <joint>.position/velocity/effort/direction"
WAY_OUT = "; or --columns 'NAME=time,NAME=<joint>.position,…'"
OF_READINGS: tuple[Quantity, ...] = ("position", "velocity", "effort", "direction")


def read_columns(given: Columns | None) -> dict[str, str]:
    """Return what columns are said to be, by their names.

    Args:
        given: ``NAME=TARGET,…``, the path of a YAML file with ``NAME: TARGET``, or such a mapping.
            A target is ``time``, ``direction`` or ``<joint>.position``, ``.velocity``, ``.effort``,
            with a unit behind it where it is not the SI one: ``time[ms]``, ``elbow.position[deg]``.
            Columns of a file without a header are called 1, 2, 3, ….

    Raises:
        ConfigError: Something else.
    """
    if given is None:
        return {}
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
    for name, target in found.items():
        column = recognised(str(target).strip())
        if column is None or column.quantity not in ("time", *OF_READINGS) or column.number >= 0:
            raise ConfigError("--columns", f"{name}={target}", f"a target: {EXPECTED}")
    return {str(name): str(target).strip() for name, target in found.items()}


@dataclass(frozen=True)
class TimeColumns:
    """Where a file's times are: one column, or one of seconds and one of nanoseconds.

    Attributes:
        columns: Its, or their, numbers in the file.
        factor: To seconds; ``None``: its unit is not said.
        text: Whether it holds dates.
    """

    columns: tuple[int, ...]
    factor: float | None = None
    text: bool = False


@dataclass(frozen=True)
class Header:
    """Where a file's columns are.

    Attributes:
        names: Of all its columns.
        joints: Those that are read, in the arm's order.
        time: Where the times are; ``None``: static poses.
        quantities: Number in the file of each joint's column; -1 of a joint that has none.
        factors: (n,) by which a quantity's columns are multiplied.
        same: Pairs of columns of one name, which must hold the same.
        notes: What was taken for what.
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
        """Numbers of all columns that are looked at."""
        found = set(self.time.columns if self.time else ())
        found.update(column for columns in self.quantities.values() for column in columns)
        found.update(column for pair in self.same for column in pair)
        return sorted(found - {-1})
