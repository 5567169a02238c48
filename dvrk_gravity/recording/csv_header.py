"""The header of a CSV file: which of its columns hold time, positions, velocities and efforts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import RecordingError, printable
from dvrk_gravity.recording.csv_columns import (
    EXPECTED,
    OF_READINGS,
    TIMES,
    UNITS,
    WAY_OUT,
    ColumnName,
    Header,
    Mapped,
    Quantity,
    TimeColumns,
    recognised,
)
from dvrk_gravity.recording.joint_names import arm_names, renaming
from dvrk_gravity.recording.notes import Note, note
from dvrk_gravity.recording.samples import QUANTITIES, TimeBase, check_joints

_SHOWN = 8  # names of columns in one line
# A file of one value a row, whose samples cannot be put together for sure.
_FOXGLOVE = {"elapsed time", "receive time", "topic", "value"}


@dataclass
class HeaderReader:
    """Reads a header.

    Attributes:
        where: File and line, for errors.
        arm: Whose joints are read; ``None``: those that the header names.
        mapped: Columns and joints that a user has mapped.
        time_base: Which of two times is read, where there are two.
        names: Of the columns.
        first: Cells of the first row.
    """

    where: str
    arm: Arm | None
    mapped: Mapped
    time_base: TimeBase
    names: Sequence[str]
    first: Sequence[str]

    @property
    def _known(self) -> tuple[str, ...]:
        return self.arm.joint_names if self.arm else ()

    @property
    def given(self) -> Mapping[str, str]:
        """Targets of columns that a user has mapped."""
        return self.mapped.columns

    def _error(self, problem: str) -> RecordingError:
        return RecordingError(self.where, problem)

    def read(self) -> Header:
        """Return the places of the columns.

        Raises:
            RecordingError: Columns missing, twice, or ambiguous.
        """
        columns, same = self._columns()
        found = self._named(self._of_one_source(columns))
        joints, quantities = self._quantities(found)
        time = self._time(columns, found)
        if time is None:
            self._require_poses(columns)
        factors = {
            quantity: np.array([self._factor(quantity, at) for at in places])
            for quantity, places in quantities.items()
        }
        notes = self._notes(columns, found, quantities, joints, time)
        return Header(tuple(self.names), joints, time, quantities, factors, same, notes)

    def _columns(self) -> tuple[dict[int, ColumnName], tuple[tuple[int, int], ...]]:
        """Return the recognised columns, and pairs of columns that share a name."""
        for name in self.given:
            if name not in self.names:
                shown = ", ".join(self.names)[:200]
                raise self._error(f"no column {name!r} (--columns), it has {shown}")
        if {name.lower() for name in self.names} >= _FOXGLOVE:
            raise self._error("looks like the data of a Foxglove plot, one value a row: expected "
                "one sample a row, or the bag itself"
            )  # fmt: skip
        found: dict[int, ColumnName] = {}
        first: dict[str, int] = {}
        same = []
        for at, name in enumerate(self.names):
            if name in first:
                same.append((first[name], at))
                continue
            first[name] = at
            column = recognised(self.given.get(name, name), (*self._known, *self.mapped.joints))
            if column is not None and not (
                self.given and name not in self.given and self._taken(column)
            ):
                found[at] = replace(column, native=True) if name in self.given else column
        return self._renamed(found), tuple(pair for pair in same if pair[0] in found)

    def _renamed(self, columns: dict[int, ColumnName]) -> dict[int, ColumnName]:
        """Return columns with the arm's names of their joints."""
        joints = {column.joint for column in columns.values() if column.joint}
        names = self.mapped.joints or arm_names(joints, self._known)
        return {
            at: replace(column, joint=names[column.joint], native=False)
            if column.joint in names
            else column
            for at, column in columns.items()
        }

    def _taken(self, column: ColumnName) -> bool:
        """Return whether ``--columns`` maps another column to the same quantity and joint."""
        return any(
            target is not None
            and target.quantity == column.quantity
            and (column.number >= 0 or target.joint == column.joint)
            for target in map(recognised, self.given.values())
        )

    def _of_one_source(self, columns: Mapping[int, ColumnName]) -> dict[int, ColumnName]:
        """Return the columns of joints' readings; of several topics, those of the arm's."""
        found = {
            at: column
            for at, column in columns.items()
            if column.quantity in (*OF_READINGS, "name") and not column.command
        }
        positions = [at for at, column in found.items() if column.quantity == "position"]
        sources = dict.fromkeys(found[at].prefix for at in positions)
        known = set(self._known)
        if len(sources) > 1 and known:
            own = [at for at in positions if found[at].joint in known]
            sources = dict.fromkeys(found[at].prefix for at in own) or sources
            under = [
                source for source in sources
                if self.arm and self.arm.name.lower() in source.lower().split("/")
            ]  # fmt: skip
            sources = dict.fromkeys(under) if len(under) == 1 else sources
        seen: dict[tuple[Quantity, str, int], int] = {}
        result = {}
        for at, column in found.items():
            if column.prefix not in sources and column.quantity != "direction" and sources:
                continue
            key = column.quantity, column.joint, column.number
            if key in seen:
                raise self._error(
                    f"columns {self.names[seen[key]]!r} and {self.names[at]!r} could both be the "
                    f"{column.quantity} of a joint, expected one{WAY_OUT}",
                )
            seen[key] = at
            result[at] = column
        return result

    def _named(self, columns: Mapping[int, ColumnName]) -> dict[int, ColumnName]:
        """Return columns with the joints' names where numbers stand for them."""
        numbered = {at: column for at, column in columns.items() if column.number >= 0}
        if not numbered:
            return {at: column for at, column in columns.items() if column.quantity != "name"}
        numbers = sorted({c.number for c in numbered.values() if c.quantity == "position"})
        joints = {
            column.number: printable(self.first[at].strip().strip('"'))
            for at, column in numbered.items()
            if column.quantity == "name" and at < len(self.first)
        }
        if not joints and numbers and len(numbers) == len(self._known):
            joints = dict(zip(numbers, self._known, strict=True))
        some = next(self.names[at] for at in numbered)
        if numbers and not set(numbers) <= set(joints):
            arm = f", expected {len(self._known)} of arm {self.arm.name}" if self.arm else ""
            raise self._error(
                f"columns such as {some!r} do not name their joints: {len(numbers)} of them{arm}"
                f"{WAY_OUT}",
            )
        result = {}
        for at, column in columns.items():
            if column.quantity == "name":
                continue
            if column.number >= 0 and column.number in joints:
                column = replace(column, joint=joints[column.number])
            if column.joint or column.quantity == "direction":
                result[at] = column
        return result

    def _quantities(
        self, columns: Mapping[int, ColumnName]
    ) -> tuple[tuple[str, ...], dict[str, list[int]]]:
        """Return the joints, and the columns of each quantity."""
        known = self._known
        index: dict[tuple[str, str], int] = {
            (column.joint, column.quantity): at for at, column in columns.items()
        }
        named = tuple(dict.fromkeys(joint for joint, _ in index if joint))
        check_joints(self.where, named, self.arm)
        whole = all((joint, "position") in index for joint in known)
        for at, column in columns.items():
            # Where all of the arm's joints are, others are another arm's or a hand's; else a
            # misprint.
            if known and column.native and column.joint and column.joint not in known and not whole:
                raise self._unknown(at)
            if column.native and not column.joint and column.quantity != "direction":
                raise self._unknown(at)
        joints = tuple(joint for joint in known or named if joint in named)
        if not joints:
            if not columns or not any(column.joint for column in columns.values()):
                for at, name in enumerate(self.names):
                    if not recognised(name, known):
                        raise self._unknown(at)
                raise self._error(f"no <joint>.position column{WAY_OUT}")
            raise self._unknown(next(iter(columns)))
        quantities: dict[str, list[int]] = {}
        for quantity in (*QUANTITIES, "direction"):
            places = [index.get((joint, quantity), -1) for joint in joints]
            missing = [joint for joint, at in zip(joints, places, strict=True) if at < 0]
            if len(missing) == len(joints) and quantity != "position":
                continue
            if missing and quantity != "velocity":
                what, held = "", ""
                if quantity == "effort":
                    what = " (it has positions, but no efforts)"
                    held = "; of a joint that was held, leave these out, and state them: --at"
                raise self._error(
                    f"no column {missing[0]}.{quantity}{what}{self._not_read()}{held}{WAY_OUT}"
                )
            quantities[quantity] = places
        if ("", "direction") in index:
            if "direction" in quantities:
                raise self._error("both direction and <joint>.direction columns")
            quantities["direction"] = [index["", "direction"]] * len(joints)
        return joints, quantities

    def _not_read(self) -> str:
        """Return in words which columns are not known, if there are any."""
        others = [name for name in self.names if recognised(name, self._known) is None]
        return f"; columns not read: {_some(others)}" if others else ""

    def _unknown(self, at: int) -> RecordingError:
        known = f", joints: {', '.join(self._known)}" if self._known else ""
        column = recognised(self.names[at])
        way_out = renaming(column.joint) if column and column.joint and known else WAY_OUT
        return self._error(
            f"column {at + 1} is {self.names[at][:40]!r}, expected {EXPECTED}{known}{way_out}",
        )

    def _time(
        self, columns: Mapping[int, ColumnName], read: Mapping[int, ColumnName]
    ) -> TimeColumns | None:
        """Return the places of the times."""
        prefixes = {column.prefix.lower().strip("/") for column in read.values()}
        times = {at: column for at, column in columns.items() if column.quantity == "time"}
        mapped = [at for at in times if self.names[at] in self.given]
        if mapped:
            return self._one_time(mapped[0], times[mapped[0]])
        stamps: list[tuple[str, tuple[int, ...]]] = []
        below: dict[str, int] = {}  # of nanoseconds, the first by prefix
        for at, column in times.items():
            if column.part == "nanosec":
                below.setdefault(column.prefix, at)
        for at, column in times.items():
            if column.part == "stamp":
                stamps.append((column.prefix, (at,)))
            elif column.part == "sec":
                rest = (below[column.prefix],) if column.prefix in below else ()
                stamps.append((column.prefix, (at, *rest)))
        if len(stamps) > 1:
            stamps = [each for each in stamps if each[0].strip("/").lower() in prefixes]
        plain = sorted(
            (at for at, column in times.items() if column.part == "plain"),
            key=lambda at: _rank(self.names[at]),
        )
        if len(stamps) == 1 and not (self.time_base == "receive" and plain):
            places = stamps[0][1]
            if len(places) == 2:
                return TimeColumns(places, 1.0)
            return self._one_time(places[0], times[places[0]])
        if plain:
            return self._one_time(plain[0], times[plain[0]])
        # pandas writes its index first, without a name: here it is the time.
        if self.names and self.names[0] == "" and self.first and _is_date(self.first[0]):
            return TimeColumns((0,), 1.0, True)
        return None

    def _one_time(self, at: int, column: ColumnName) -> TimeColumns:
        factor = self._unit_factor("time", at, column) if column.unit else None
        date = at < len(self.first) and _is_date(self.first[at])
        return TimeColumns((at,), factor, date)

    def _require_poses(self, columns: Mapping[int, ColumnName]) -> None:
        """Refuse a file without a time if some unknown column may be it."""
        others = [
            name for at, name in enumerate(self.names) if at not in columns and not self.given
        ]
        if others:
            raise self._error(
                f"no column is known as time, and it may be one of {_some(others)}: "
                "--columns NAME=time; or leave them out, if these are static poses",
            )

    def _factor(self, quantity: str, at: int) -> float:
        if at < 0:
            return 1.0
        column = recognised(self.given.get(self.names[at], self.names[at]), self._known)
        return self._unit_factor(quantity, at, column) if column and column.unit else 1.0

    def _unit_factor(self, quantity: str, at: int, column: ColumnName) -> float:
        """Return the factor of a column's unit to the SI one."""
        unit, known = column.unit.lower(), UNITS[quantity]
        if unit not in known:
            raise self._error(
                f"column {self.names[at]!r} is in {unit}, expected one of {', '.join(known)}"
            )
        return known[unit]

    def _notes(
        self, columns: Mapping[int, ColumnName],
        read: Mapping[int, ColumnName], quantities: Mapping[str, list[int]],
        joints: Sequence[str], time: TimeColumns | None,
    ) -> tuple[Note, ...]:  # fmt: skip
        """Return which columns were read as what, and which were not read."""
        taken = []
        for quantity, places in quantities.items():
            for joint, at in zip(joints, places, strict=True):
                if at >= 0 and not read[at].native:
                    taken.append(f"{self.names[at]} as {joint}.{quantity}")
                    break
        if time is not None and self.names[time.columns[0]] not in (*self.given, "time"):
            taken.insert(0, f"{' and '.join(self.names[at] for at in time.columns)} as time")
        used = {at for places in quantities.values() for at in places} | set(
            time.columns if time else ()
        )
        known = {at for at, c in columns.items() if c.quantity in ("nothing", "name", "time")}
        own = {self.names[at] for at in read if read[at].native}
        others = [name for at, name in enumerate(self.names)
                  if at not in used | known and name not in own]  # fmt: skip
        lines = []
        if taken:
            lines.append(f"columns read: {', '.join(taken)}, and so on")
        efforts = quantities.get("effort", [])
        if any("current" in self.names[at].lower() for at in efforts if at >= 0):
            lines.append("efforts are currents (--effort-unit A, or --drive-gains)")
        if others:
            lines.append(f"columns not read: {_some(others)}")
        return (note("columns", "; ".join(lines)),) if lines else ()


def _rank(name: str) -> int:
    lower = name.lower().split("[")[0].split("(")[0].strip()
    return TIMES.index(lower) if lower in TIMES else len(TIMES)


def _some(names: Sequence[str]) -> str:
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def _is_date(cell: str) -> bool:
    """Return whether a cell holds a date and time, not a number."""
    text = cell.strip().strip('"')
    return len(text) >= 10 and text[4] == "-" and text[7] == "-" and text[:4].isdigit()
