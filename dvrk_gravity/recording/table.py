"""From a file's rows or messages to samples with increasing times and finite numbers.

A sample that cannot be used is left out and counted; a fault of the whole file is an error.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.limits import STILL
from dvrk_gravity.recording.notes import Note, merged, note
from dvrk_gravity.recording.samples import LARGEST, Coordinates, Samples
from dvrk_gravity.recording.stamp_order import HELD, increasing

# Times stand still where fewer than this part of more than so many rows have a time of their own.
# Chosen: between a clock of whole seconds at 100 Hz, and readings at 100 Hz published at 1 kHz.
_MOVING, _FROZEN = 0.02, 10
# Part of the rows that may be out of the order of time. Chosen: a quarter of a file is no moment.
_WILD = 0.25
_NOTHING = 1e-30  # N·m; less is memory that was never written. Chosen: its square is no number


@dataclass(frozen=True, eq=False)
class RowTable:
    """Rows of a file as read.

    Attributes:
        joints: Names of the n columns.
        stamps: ``(N,)`` ns; ``None``: static poses.
        numbers: ``(N,)`` of their lines or messages, for errors.
        values: ``(N, n)`` by quantity, ``direction`` among them.
        invalid: Rows that were left out because they carried stamp 0.
        notes: The reader's findings.
        received: ``(N,)`` ns at which a bag received its messages; ``None``: not known.
        other_layout: ``(N,)`` whether they are laid out otherwise than the file's first one.
    """

    joints: tuple[str, ...]
    stamps: NDArray[np.int64] | None
    numbers: NDArray[np.int64]
    values: dict[str, Array]
    invalid: int = 0
    notes: tuple[Note, ...] = ()
    received: NDArray[np.int64] | None = None
    other_layout: Mask | None = None

    def __len__(self) -> int:
        """Return the number of rows N."""
        return len(self.numbers)

    def rows(self, selection: slice | Mask | NDArray[np.intp]) -> RowTable:
        """Return some rows; a slice gives views, which keep all rows in memory."""
        names = ("stamps", "numbers", "received", "other_layout")
        arrays: dict[str, Any] = {name: getattr(self, name) for name in names}
        some: dict[str, Any] = {
            name: None if array is None else array[selection] for name, array in arrays.items()
        }
        values = {name: array[selection] for name, array in self.values.items()}
        return replace(self, values=values, **some)

    def after(self, other: RowTable | None) -> RowTable:
        """Return the rows of another table followed by these, with the findings about these."""
        if other is None:
            return self
        stamps = None
        if self.stamps is not None and other.stamps is not None:
            stamps = np.concatenate([other.stamps, self.stamps])
        values = {name: np.concatenate([other.values[name], a]) for name, a in self.values.items()}
        numbers = np.concatenate([other.numbers, self.numbers])
        return replace(self, stamps=stamps, numbers=numbers, values=values)


@dataclass
class Assembly:
    """Makes samples of a file's tables.

    Attributes:
        source: The file.
        row: Word for a row in errors: a line, a message.
        coordinates: Of the columns.
        arm: Whose joints they are, if it is known.
        way_out: End of errors about times: what a user can do.
    """

    source: str
    row: str
    coordinates: Coordinates
    arm: Arm | None
    way_out: str
    _start_ns: int | None = None
    _previous: int | None = None
    _times: int = 0
    _repeated: int = 0  # of the last rows
    _standing: int = 0  # of all
    _wild: int = 0
    _joints: Mask | None = None  # of a table's, that are read
    _absent: dict[str, Mask] = field(default_factory=dict)  # of these, by quantity

    def samples(self, tables: Iterable[RowTable]) -> Iterator[Samples]:
        """Yield the usable samples of consecutive tables, with notes on the others.

        Raises:
            RecordingError: Times that stand still or go back for long, or nothing of use.
        """
        held: RowTable | None = None
        ready: Samples | None = None
        empty: list[Samples] = []
        for table in chain(tables, (None,)):
            block = held if table is None else table.after(held)
            if block is None:
                continue
            # Whether the last stamps are in order depends on the next ones.
            some = table is not None and block.stamps is not None
            cut = max(len(block) - HELD, 0) if some else len(block)
            rest = block.rows(np.arange(cut, len(block)))
            held = replace(rest, invalid=0, notes=()) if some else None
            found = self._usable(self._in_order(block, cut))
            del table, block, rest  # their memory serves the next read
            if not len(found):
                empty.append(found)
                continue
            if ready is not None:
                yield ready.with_found(empty)
                empty = []
            ready = found
        if ready is None:
            raise self._nothing(empty)
        self._require_progress()
        yield ready.with_found(empty)

    def _in_order(self, table: RowTable, cut: int) -> RowTable:
        """Return those of the first rows of a table whose times increase."""
        if table.stamps is None or not len(table):
            return table
        kept, wild, stuck = increasing(table.stamps, self._previous, cut)
        if stuck is not None:
            before = max(table.stamps[:stuck].tolist(), default=self._previous or 0)
            raise RecordingError(
                f"{self.source}: {self.row} {table.numbers[stuck]}",
                f"time goes back by {(before - int(table.stamps[stuck])) / 1e9:g} s and stays "
                f"there, expected increasing times{self.way_out}",
            )
        wilds = int(wild[:cut].sum())
        self._wild += wilds
        kept = kept[:cut]
        self._repeated = cut - wilds - int(kept.sum())
        self._standing += self._repeated
        notes = table.notes
        if wilds:
            notes += (note("stamps_back", "with times out of order", left_out=wilds),)
        found = replace(table.rows(slice(0, cut)), notes=notes)
        if not kept.all():
            found = found.rows(kept)
        if len(found):
            assert found.stamps is not None
            self._previous = int(found.stamps[-1])
            self._times += len(found)
        return found

    def _usable(self, table: RowTable) -> Samples:
        """Return a table's complete rows; quantities that a joint never has are NaN."""
        notes = table.notes
        if self._joints is None and len(table):
            self._joints, found = self._settled(table)
            notes += found
        joints = self._joints if self._joints is not None else np.ones(len(table.joints), bool)
        names = tuple(compress(table.joints, joints))
        values, usable = {}, np.ones(len(table), dtype=bool)
        for quantity, array in table.values.items():
            absent = self._absent.get(quantity, np.zeros(int(joints.sum()), dtype=bool))
            if absent.all() and len(absent) and quantity != "position":
                continue
            own = array[:, joints]
            if quantity == "effort":
                own = np.where(np.abs(own) < _NOTHING, 0.0, own)
            fine = np.abs(own) < LARGEST
            if absent.any():
                own = np.where(absent, np.nan, own)
                fine |= absent
            usable &= fine.all(axis=1)
            values[quantity] = own
        left = len(table) - int(usable.sum())
        if left:
            notes += (note("not_finite", "with a value missing or not finite", left_out=left),)
            values = {quantity: array[usable] for quantity, array in values.items()}
        time = None
        if table.stamps is not None:
            stamps = table.stamps[usable] if left else table.stamps
            if self._start_ns is None and len(stamps):
                self._start_ns = int(stamps[0])
            time = (stamps - (self._start_ns or 0)) / 1e9
        for made in (*values.values(), time):
            if made is not None:
                made.flags.writeable = False
        return Samples(
            names, time, values["position"], values.get("velocity"), values.get("effort"),
            values.get("direction"), self.coordinates, self.source, self._start_ns or 0,
            table.invalid, self._repeated, self.arm, merged(notes),
        )  # fmt: skip

    def _settled(self, table: RowTable) -> tuple[Mask, tuple[Note, ...]]:
        """Return which joints are read, by a file's first rows, and notes on what is missing."""
        missing: dict[str, Mask] = {
            quantity: np.asarray(~(np.abs(array) < LARGEST).any(axis=0))
            for quantity, array in table.values.items()
        }
        joints = ~missing["position"]
        notes = _left_out(table, missing["position"], "position", "no position was recorded")
        if not joints.any():
            raise RecordingError(self.source, "no position is a finite number")
        effort = missing.get("effort", np.zeros(len(joints), dtype=bool))
        if self.arm is not None and (effort & joints).any() and not effort[joints].all():
            # A joint without a motor that is read, such as a gripper's finger.
            without = effort & joints
            notes += _left_out(table, without, "effort", "no effort was recorded")
            notes += self._moving(table, without)
            joints = joints & ~effort
        for quantity in ("velocity", "effort"):
            if quantity not in missing or not missing[quantity][joints].any():
                continue
            self._absent[quantity] = missing[quantity][joints]
            named = list(compress(table.joints, joints & missing[quantity]))
            every = len(named) == int(joints.sum())
            whose = "of all joints" if every else f"of {', '.join(named)}"
            taken = ": differentiated from positions" if quantity == "velocity" else ""
            text = f"{quantity} {whose} was not recorded (no finite number){taken}"
            notes += (note("not_recorded", text),)
        return joints, notes

    def _moving(self, table: RowTable, without: Mask) -> tuple[Note, ...]:
        """Return notes of joints without efforts that turn: nothing may take them for held."""
        assert self.arm is not None
        turns = {joint.name for joint in self.arm.joints if joint.kind == "revolute"}
        position = np.where(np.abs(table.values["position"]) < LARGEST, table.values["position"], 0)
        moved = np.ptp(position, axis=0) > STILL
        return tuple(
            note(
                "effort_missing",
                "moves, but its efforts are no numbers that an effort can be",
                name,
            )
            for name in compress(table.joints, without & moved)
            if name in turns
        )

    def _require_progress(self) -> None:
        """Refuse a file whose times stand still, or are in no order."""
        total = self._times + self._standing
        if self._wild > _WILD * (total + self._wild):
            raise RecordingError(
                self.source,
                f"{self._wild} of {total + self._wild} {self.row}s are out of the order of time, "
                f"expected increasing times{self.way_out}",
            )
        if total > _FROZEN and self._times < _MOVING * total:
            raise RecordingError(
                self.source,
                f"time stands still: {self._standing} of {total} {self.row}s repeat the one before"
                f"{self.way_out}",
            )

    def _nothing(self, empty: Iterable[Samples]) -> RecordingError:
        """Return the error about a file without a usable sample."""
        found = merged(note for samples in empty for note in samples.found)
        total = sum(each.left_out for each in found)
        why = "; ".join(each.of(total).text for each in found)
        unstamped = any(note.kind == "invalid_stamps" for note in found)
        way_out = self.way_out if unstamped else ""
        return RecordingError(
            self.source, f"holds no usable samples{f': {why}' if why else ''}{way_out}"
        )


def _left_out(table: RowTable, without: Mask, quantity: str, why: str) -> tuple[Note, ...]:
    """Return notes of the joints that are not read, with what stands in place of a reading."""
    return tuple(
        note("not_recorded", f"not read: {why} (the first {quantity} is {value:.3g})", name)
        for name, value in compress(
            zip(table.joints, table.values[quantity][0].tolist(), strict=True), without
        )
    )
