"""What a collection has done so far, in a folder beside its bag: what --resume goes on from.

The folder holds ``state.json`` and a bag for each time that the arm was moved. Its state is written
whole or not at all, before every phase and with every second of a motion, so that a process
that is killed loses no more than that.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.files import json_file, text_file
from dvrk_gravity.files.lock import lock_folder
from dvrk_gravity.planning import Plan
from dvrk_gravity.recording import JOINT_STATE, STAMP, BagReader, BagWriter

FORMAT = 1
SUFFIX = ".unfinished"
REHEARSAL, MOTION, JOINING = PHASES = ("rehearsal", "motion", "joining")
_FINGERPRINT = 200  # moments of a motion that make its fingerprint
# Between two parts of which the later one's clock is behind, s: that of a simulator that was
# started again, for instance.
_APART = 1.0


@dataclass
class RecordedPart:
    """Messages of one go.

    Attributes:
        name: Of its bag.
        keep: So many of its messages count; ``None``: all.
        marks: Number of a motion, s of it, and messages written until then, ascending.
    """

    name: str
    keep: int | None = None
    marks: list[tuple[int, float, int]] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """How many of its messages are known to be on the disk, of those that count."""
        return self.keep or (self.marks[-1][2] if self.marks else 0)


@dataclass
class Journal:
    """How far a collection is.

    Attributes:
        out: The bag that will be.
        plan: Fingerprint of the motions.
        topic: Recorded topic.
        motion: Number of the motion, from 0.
        phase: One of :data:`PHASES`.
        approaching: Whether the arm is on its way to that phase's beginning.
        moment: s of the motion that have passed in that phase.
        rehearsed: Whether that motion was rehearsed.
        why: Why it stopped; ``""``: it did not, or its process was killed.
        parts: What was recorded.
        found: Whether an earlier process began it.
    """

    out: Path
    plan: str
    topic: str
    motion: int = 0
    phase: str = REHEARSAL
    approaching: bool = True
    moment: float = 0.0
    rehearsed: bool = False
    why: str = ""
    parts: list[RecordedPart] = field(default_factory=list)
    found: bool = False

    @classmethod
    @contextmanager
    def begin(cls, out: Path, plans: Sequence[Plan], topic: str, resume: bool) -> Iterator[Journal]:
        """Yield the state of a collection, a new one's or that of an earlier process.

        No other process has it meanwhile.

        Raises:
            RecordingError: The bag exists, or the state is there and is not to be resumed, or what
                was recorded is not.
            ConfigError: The state is of another plan or arm, or cannot be read, or another process
                has it.
        """
        if out.exists():
            raise RecordingError(out, "exists already, expected a new name")
        BagWriter(out)  # refuses a name that no bag can have, before anything is begun
        journal = cls(out, fingerprint(plans), topic)
        journal.folder.mkdir(exist_ok=True)
        try:
            with lock_folder(journal.folder, "--out"):
                if journal.file.exists():
                    journal = cls._resume(journal, plans, resume)
                yield journal
        finally:
            with suppress(OSError):  # something was begun, or all is done
                journal.folder.rmdir()

    @classmethod
    def _resume(cls, journal: Journal, plans: Sequence[Plan], resume: bool) -> Journal:
        """Return the state of an earlier process in a new one's place."""
        out, topic = journal.out, journal.topic
        found = cls._read(journal.file, out, plans)
        if not resume:
            raise RecordingError(
                out, f"an earlier collection {found.place()}: --resume goes on from there, or "
                f"remove {journal.folder}"
            )  # fmt: skip
        if found.plan != journal.plan:
            raise ConfigError("plan", "another plan", "the one that it began with", journal.file)
        if found.topic != topic:
            raise ConfigError("topic", topic, f"{found.topic}, as it began", journal.file)
        return found

    @classmethod
    def _read(cls, path: Path, out: Path, plans: Sequence[Plan]) -> Journal:
        content = json_file.load(path)
        if (written := content.pop("format", None)) != FORMAT:
            raise ConfigError("format", written, f"{FORMAT}, as `collect` writes it", path)
        try:
            parts = [RecordedPart(**part) for part in content.pop("parts")]
            found = cls(out, parts=parts, found=True, **content)
            found._require_possible(plans)
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError("", str(error), "a state as `collect` writes it", path) from error
        for part in parts:
            if part.messages and found._bag(part) is None:
                bag = found.folder / part.name
                raise RecordingError(bag, "is gone, expected what was recorded")
        return found

    def _require_possible(self, plans: Sequence[Plan]) -> None:
        """Raise ValueError, or TypeError, for what `collect` of these plans does not write."""
        for name in ("plan", "topic", "why"):
            if not isinstance(getattr(self, name), str):
                raise ValueError(f"{name}: {getattr(self, name)!r}")
        counts = [self.motion, *(part.keep or 0 for part in self.parts)]
        moments = [(self.motion, self.moment)]
        names = [part.name for part in self.parts]
        for part in self.parts:
            if not re.fullmatch("part_[0-9]+", part.name):
                raise ValueError(f"parts: {part.name!r}")
            if len(names) != len(set(names)):
                raise ValueError(f"parts: {part.name!r} or another one twice")
            part.marks = [(motion, moment, count) for motion, moment, count in part.marks]
            counts += [number for motion, _, count in part.marks for number in (motion, count)]
            moments += [(motion, moment) for motion, moment, _ in part.marks]
        good = (
            self.phase in PHASES
            and isinstance(self.approaching, bool)
            and isinstance(self.rehearsed, bool)
            and all(type(each) is int and each >= 0 for each in counts)
            and all(motion < len(plans) for motion, _ in moments)
            and all(type(each) in (int, float) for _, each in moments)
            and all(0.0 <= each <= plans[motion].duration for motion, each in moments)
        )
        if not good:
            raise ValueError(f"{self.phase!r} of motion {self.motion!r} at {self.moment!r} s")

    @property
    def folder(self) -> Path:
        """Where it lies, beside the bag."""
        return _folder(self.out)

    @property
    def file(self) -> Path:
        """Its state."""
        return self.folder / "state.json"

    def place(self) -> str:
        """Return where it stopped and why, in words."""
        where = f"approach to the {self.phase}" if self.approaching else self.phase
        if self.phase == JOINING:
            where = "writing the bag"
        elif not self.approaching:
            where += f", {self.moment:.1f} s into it"
        of = f" of motion {self.motion + 1}" if self.motion else ""
        return f"stopped in its {where}{of}: {self.why or 'its process was ended'}"

    def enter(self, motion: int, phase: str, moment: float, approaching: bool) -> None:
        """Note the beginning of a phase."""
        self.rehearsed = self.rehearsed and motion == self.motion
        self.motion, self.phase, self.moment = motion, phase, moment
        self.approaching, self.why = approaching, ""
        self.save()

    def save(self) -> None:
        """Write the state, whole or not at all.

        Raises:
            OSError: The disk refuses.
        """
        content: dict[str, Any] = {"format": FORMAT} | {
            name: getattr(self, name)
            for name in (
                "plan", "topic", "motion", "phase", "approaching", "moment", "rehearsed", "why"
            )
        }  # fmt: skip
        content["parts"] = [asdict(part) for part in self.parts]
        self.folder.mkdir(exist_ok=True)
        text_file.write(self.file, json.dumps(content) + "\n", wait=False)

    def new_part(self) -> BagWriter:
        """Add a part, and return the writer of its bag."""
        self.folder.mkdir(exist_ok=True)
        taken = {path.name.partition(".")[0] for path in self.folder.glob("part_*")}
        number = next(k for k in range(1, len(taken) + 2) if f"part_{k}" not in taken)
        part = RecordedPart(f"part_{number}")
        self.parts.append(part)
        return BagWriter(self.folder / part.name)

    def resume_points(self, before: float) -> list[float]:
        """Return moments from which the present motion may go on, s, ascending.

        Args:
            before: So long before it stopped may what was recorded be disturbed, s.
        """
        last = self.moment - before
        return sorted(
            moment
            for part in self.parts
            for motion, moment, _ in part.marks
            if motion == self.motion and moment <= last
        )

    def mark(self, moment: float, bag: BagWriter) -> None:
        """Note that the present phase is so far, s of the motion; what is written is on disk."""
        self.moment = moment
        if self.phase == MOTION:
            bag.flush()
            self.parts[-1].marks.append((self.motion, moment, bag.count))
        self.save()

    def drop_from(self, motion: int, moment: float) -> None:
        """Drop what was recorded of a motion from a moment on, s.

        Of a motion that begins again (0.0), all of it.
        """
        *earlier, present = self.parts
        kept: list[RecordedPart] = []
        for part in earlier:
            marks = [mark for mark in part.marks if mark[:2] <= (motion, moment)]
            if not marks or not marks[-1][2]:
                continue
            kept.append(part)
            if len(marks) < len(part.marks):
                part.marks, part.keep = marks, marks[-1][2]
                break
        self.parts = [*kept, present]

    def _messages(self, part: RecordedPart) -> Iterator[tuple[int, bytes]]:
        """Yield receive time, ns, and bytes of a part's messages, those that count."""
        path, number = self._bag(part), 0
        if path is not None and part.keep != 0:
            with BagReader(path) as bag:
                for _, received, data in islice(bag.raw(self.topic), part.keep):
                    number += 1
                    yield received, data
        if number < part.messages:
            raise RecordingError(
                self.folder / part.name, f"has {number} messages, expected {part.messages}"
            )

    def _bag(self, part: RecordedPart) -> Path | None:
        """Return where a part is, that of a process that was killed included."""
        complete = self.folder / part.name
        partial = sorted(self.folder.glob(f"{part.name}.partial-*/{part.name}"))
        return complete if complete.exists() else partial[-1] if partial else None

    def join(self, plans: Sequence[Plan], apart: float) -> int:
        """Write the bag of all parts, whole or not at all; return the number of its messages.

        Times stay as they are: between two parts is a gap. Only where a later part's clock (the
        arm's, or this computer's) is behind the earlier one's, it is set on.

        Args:
            plans: The motions.
            apart: Marks of a motion are so far from each other at most, s.

        Raises:
            RecordingError: The bag cannot be written, or would lack a part of a motion.
        """
        folder = self.folder / JOINING
        shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed
        folder.mkdir()
        with BagWriter(folder / self.out.name, keep_partial=False) as bag:
            bag.add_topic(self.topic, JOINT_STATE)
            last = last_received = -(2**63)
            for part in self.parts:
                shift = shift_received = None
                for received, data in self._messages(part):
                    stamp = _stamp(data)
                    if shift is None or shift_received is None:
                        shift, shift_received = (
                            _clock_shift(last, stamp),
                            _clock_shift(last_received, received),
                        )
                    if shift:
                        data = _with_stamp(data, stamp + shift)
                    last = max(last, stamp + shift)
                    last_received = max(last_received, received + shift_received)
                    bag.write(self.topic, JOINT_STATE, data, received + shift_received)
            self._require_whole(plans, apart)
        (folder / self.out.name).rename(self.out)
        return bag.count

    def _require_whole(self, plans: Sequence[Plan], apart: float) -> None:
        """Check that marks of what counts follow each other through all of each motion."""
        for number, plan in enumerate(plans):
            moments = {
                moment
                for part in self.parts
                for motion, moment, count in part.marks
                if motion == number and (part.keep is None or count <= part.keep)
            }
            for first, next_one in pairwise(sorted(moments | {0.0, plan.duration})):
                if next_one - first > apart:
                    raise RecordingError(
                        self.out, f"is not whole: of motion {number + 1} nothing was recorded from "
                        f"{first:.1f} to {next_one:.1f} s; remove {self.folder} and collect again"
                    )  # fmt: skip


def _folder(out: Path) -> Path:
    return out.with_name(out.name + SUFFIX)


def discard(out: Path) -> None:
    """Remove what collections of a bag have left beside it, if anything."""
    shutil.rmtree(_folder(out), ignore_errors=True)


def fingerprint(plans: Sequence[Plan]) -> str:
    """Return a hash of the arm and of the motions' positions."""
    of = hashlib.sha256()
    for plan in plans:
        names = (plan.arm.name, *plan.arm.joint_names)
        of.update(" ".join((*names, f"{plan.duration:.6f}")).encode())
        positions = plan.at(np.linspace(0.0, plan.duration, _FINGERPRINT))[0]
        of.update((np.round(positions, 6) + 0.0).tobytes())
    return of.hexdigest()[:16]


def _clock_shift(last: int, first: int) -> int:
    """Return by how much a part that begins at a time is set on, after the last one before, ns."""
    return last + round(_APART * 1e9) - first if first <= last else 0


def _byte_order(data: bytes) -> str:
    return "little" if data[1] else "big"


def _stamp(data: bytes) -> int:
    """Return the stamp of a JointState in CDR bytes, ns."""
    order: Any = _byte_order(data)
    seconds, ns = data[STAMP][:4], data[STAMP][4:]
    return int.from_bytes(seconds, order) * 1_000_000_000 + int.from_bytes(ns, order)


def _with_stamp(data: bytes, stamp: int) -> bytes:
    """Return the JointState with another stamp, ns."""
    order: Any = _byte_order(data)
    seconds, ns = divmod(stamp, 1_000_000_000)
    return (
        data[: STAMP.start]
        + seconds.to_bytes(4, order)
        + ns.to_bytes(4, order)
        + data[STAMP.stop :]
    )
