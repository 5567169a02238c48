"""JointStates of a bag: one by one as sent, or as recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm, other_arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.bag import BagReader, SeveralTopicsError
from dvrk_gravity.recording.cdr import JOINT_STATE, STAMP, CdrError, JointStateLayout
from dvrk_gravity.recording.csv_columns import Columns, commanded, read_columns
from dvrk_gravity.recording.joint_names import arm_names, fits, note_on, renaming
from dvrk_gravity.recording.limits import STILL
from dvrk_gravity.recording.notes import Note, note
from dvrk_gravity.recording.publishers import one_publisher
from dvrk_gravity.recording.samples import (
    CHUNK,
    LARGEST,
    QUANTITIES,
    Coordinates,
    Samples,
    TimeBase,
    check_joints,
)
from dvrk_gravity.recording.table import Assembly, RowTable

# Layouts tried on all of a chunk's messages; a more irregular stream is decoded singly.
SHARED_LAYOUTS = 8
# Bytes of messages decoded at a time: so many JointStates of 7 joints have a tenth.
_PART_BYTES = 16_000_000
# Part of the first messages that must have efforts to be preferred. Chosen: less is too little.
_FEW = 0.02
NO_STAMP = bytes(8)  # of data that the dVRK marks as invalid, and of drivers that never stamp


class JointStateSample(NamedTuple):
    """One JointState: receive time and header stamp (ns), names, and arrays as long as sent."""

    receive_ns: int
    stamp_ns: int
    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array


class _Batch(NamedTuple):
    """Messages of one layout out of a chunk: their indices, names, stamps and numbers."""

    indices: NDArray[np.intp]
    names: tuple[str, ...]
    stamps: NDArray[np.int64]
    values: tuple[Array, ...]
    layout: bytes  # all that is neither stamp nor number


_Sent = tuple[_Batch, tuple[str, ...], tuple[str, ...]]  # with its joints and its quantities


def _decode(raws: list[bytes]) -> tuple[list[_Batch], dict[int, str]]:
    """Decode a chunk; return also the errors of messages that are no JointStates, by index."""
    batches: list[_Batch] = []
    wrong: dict[int, str] = {}
    pending = np.arange(len(raws))
    while len(pending):
        try:
            layout = JointStateLayout.parse(raws[pending[0]])
        except CdrError as error:
            wrong[int(pending[0])] = str(error)
            pending = pending[1:]
            continue
        if len(batches) < SHARED_LAYOUTS:
            match = layout.match([raws[i] for i in pending])
        else:
            match = np.arange(len(pending)) == 0
        index = pending[match]
        stamps, values = layout.decode([raws[i] for i in index])
        constant = layout.template[layout.constant].tobytes()
        batches.append(_Batch(index, layout.names, stamps, values, constant))
        pending = pending[~match]
    return batches, wrong


def _parts(
    messages: Iterator[tuple[str, int, bytes]], chunk: int
) -> Iterator[list[tuple[str, int, bytes]]]:
    """Yield consecutive messages, ``chunk`` at a time, or fewer that are large."""
    part: list[tuple[str, int, bytes]] = []
    size = 0
    for message in messages:
        part.append(message)
        size += len(message[2])
        if len(part) == chunk or size > _PART_BYTES:
            yield part
            part, size = [], 0
    if part:
        yield part


def read_joint_states(
    path: str | Path, topic: str | None = None, chunk: int = 1000
) -> Iterator[JointStateSample]:
    """Yield every JointState of a topic as sent, invalid ones included, in receive order.

    Raises:
        RecordingError: If the bag or a message cannot be read.
    """
    with BagReader(path) as bag:
        first = 0
        for part in _parts(bag.raw(_topic(bag, topic)), chunk):
            samples: list[Any] = [None] * len(part)
            batches, wrong = _decode([data for _, _, data in part])
            for i, why in sorted(wrong.items()):
                raise RecordingError(path, f"message {first + i} is not a JointState: {why}")
            for batch in batches:
                stamps = batch.stamps.tolist()
                for row, i in enumerate(batch.indices):
                    samples[i] = JointStateSample(
                        part[i][1], stamps[row], batch.names, *(v[row] for v in batch.values)
                    )
            first += len(part)
            yield from samples


def iterate_bag(
    path: str | Path,
    topic: str | None = None,
    coordinates: Coordinates = "joint",
    time_base: TimeBase = "stamp",
    chunk: int = CHUNK,
    arm: Arm | None = None,
    columns: Columns | None = None,
) -> Iterator[Samples]:
    """Yield a bag's JointStates as samples, about ``chunk`` at a time.

    Joints are matched by name, in any order, or as ``columns`` maps them (``read_columns``); names
    that are not the arm's (a gripper) are left out. Without an arm, they are those of most of the
    first messages. Times are relative to the first sample. Messages are left out and counted with
    stamp 0 (``invalid``), with the time of the message before (``repeated``), or for a reason in
    ``notes``.

    Raises:
        RecordingError: If nothing of the bag can be read, or its times cannot be used.
        ConfigError: ``columns`` that map no joints.
    """
    path = Path(path)
    way_out = "; or --time-base receive: the times at which the bag received them"
    assembly = Assembly(
        str(path), f"{time_base} of message", coordinates, arm,
        way_out if time_base == "stamp" else "",
    )  # fmt: skip
    messages = _Messages(str(path), arm, read_columns(columns).of_bag(arm))
    tables = _tables(path, topic, time_base, chunk, messages)
    return assembly.samples(one_publisher(tables, str(path)))


def _tables(
    path: Path, topic: str | None, time_base: TimeBase, chunk: int, messages_of: _Messages
) -> Iterator[RowTable]:
    arm, moves = messages_of.arm, _Moves()
    first, invalid, table = 0, 0, None
    with BagReader(path) as bag:
        joints = arm.joint_names if arm else ()
        name = _topic(bag, topic, arm)
        # A driver that never stamps: then 0 does not mark what is invalid.
        stamped = time_base == "stamp" or any(
            data[STAMP] != NO_STAMP for _, _, data in bag.raw(name)
        )
        for part in _parts(bag.raw(name), chunk):
            read = messages_of.read(first, [data for _, _, data in part])
            first += len(part)
            valid = read.used & ((read.stamps != 0) | (not stamped))
            left_out = int(read.used.sum()) - int(valid.sum())
            received = np.array([receive_ns for _, receive_ns, _ in part], np.int64)
            stamps = received if time_base == "receive" else read.stamps
            numbers = np.arange(first - len(part), first)
            part.clear()  # its memory serves the next read
            if not messages_of.joints:
                invalid += left_out
                continue
            moves.add(messages_of.joints, read.values["position"][valid])
            table = RowTable(
                messages_of.joints, stamps, numbers, read.values, 0, read.notes, received,
                read.other_layout,
            )  # fmt: skip
            yield replace(table.rows(valid), invalid=invalid + left_out)
            invalid, table = 0, table.rows(np.arange(0))
            del read
        if table is None:
            raise messages_of.nothing(first, bag, name)
        found = (*bag.notes, *messages_of.notes)
        if not moves.joints:
            found += _moving_topic(bag, name, joints)
    yield replace(table, invalid=invalid, notes=found)


class _Read(NamedTuple):
    """Content of N messages: stamps (N,) ns, arrays (N, n), notes, and masks.

    Of the used messages, and of those with another layout than the file's first one.
    """

    stamps: NDArray[np.int64]
    values: dict[str, Array]
    used: NDArray[np.bool_]
    notes: tuple[Note, ...]
    other_layout: NDArray[np.bool_]


class _Messages:
    """Puts the numbers of JointStates into arrays of the arm's joints, or of most messages'.

    Attributes:
        joints: Known joints of the messages, in the arm's order; empty before the first of use.
        notes: On joints that the messages name otherwise than the arm.
        arm: The arm.
    """

    def __init__(self, source: str, arm: Arm | None, given: Mapping[str, str]) -> None:
        self.joints: tuple[str, ...] = ()
        self.notes: tuple[Note, ...] = ()
        self.arm = arm
        self._names = dict(given)  # of joints that have others in the messages
        self._known = arm.joint_names if arm else ()
        self._source = source
        self._quantities: tuple[str, ...] = ()
        self._all: frozenset[str] = frozenset()  # names of the messages that are used
        self._layout = b""  # of the first message that is used
        self._problem = ""

    def read(self, first: int, raws: list[bytes]) -> _Read:
        """Return the content of messages; ``first`` is the number of the first one, for errors.

        Raises:
            RecordingError: If the joints are a larger arm's.
        """
        stamps = np.zeros(len(raws), np.int64)
        used = np.zeros(len(raws), dtype=bool)
        other_layout = np.zeros(len(raws), dtype=bool)
        batches, wrong = _decode(raws)
        for index, why in wrong.items():
            self._problem = self._problem or f"message {first + index} is not a JointState: {why}"
        damaged, others = len(wrong), 0
        batches = self._renamed(batches)
        found: list[_Sent] = []
        for batch in batches:
            sent = tuple(q for q, v in zip(QUANTITIES, batch.values, strict=True) if v.shape[1])
            joints = tuple(joint for joint in self._known or batch.names if joint in batch.names)
            if why := _misfit(batch, joints, self.arm):
                self._problem = self._problem or f"message {first + int(batch.indices[0])} {why}"
                damaged += len(batch.indices) if joints else 0
                others += 0 if joints else len(batch.indices)
            else:
                found.append((batch, joints, sent))
        if not self.joints and found:
            self._choose(found)
        values = {q: np.zeros((len(raws), len(self.joints))) for q in self._quantities}
        for batch, joints, sent in found:
            same = joints == self.joints or (not self._known and set(batch.names) == self._all)
            if not same or sent != self._quantities:
                others += len(batch.indices)
                continue
            columns = [batch.names.index(joint) for joint in self.joints]
            for quantity, numbers in zip(QUANTITIES, batch.values, strict=True):
                if quantity in values:
                    values[quantity][batch.indices] = numbers[:, columns]
            stamps[batch.indices] = batch.stamps
            used[batch.indices] = True
            self._layout = self._layout or batch.layout
            other_layout[batch.indices] = batch.layout != self._layout
        return _Read(stamps, values, used, _notes(damaged, others), other_layout)

    def _renamed(self, batches: list[_Batch]) -> list[_Batch]:
        """Return messages with the arm's names of their joints."""
        if not self.joints and not self._names:
            self._names = arm_names({name for b in batches for name in b.names}, self._known)
            self.notes = note_on(self._names)
        if not self._names:
            return batches
        return [b._replace(names=tuple(self._names.get(n, n) for n in b.names)) for b in batches]

    def _choose(self, found: list[_Sent]) -> None:
        """Choose the joints that most of the first messages have, and the fields, with efforts.

        A second publisher may send the same joints without efforts, and more often.
        """
        joints_of: Counter[frozenset[str]] = Counter()
        fields: Counter[tuple[frozenset[str], tuple[str, ...]]] = Counter()
        for batch, joints, sent in found:
            joints_of[frozenset(joints)] += len(batch.indices)
            fields[frozenset(joints), sent] += len(batch.indices)
        ((names, total),) = joints_of.most_common(1)
        often = {sent: n for (joints, sent), n in fields.items()
                 if joints == names and n > _FEW * total}  # fmt: skip
        self._quantities = max(often, key=lambda sent: ("effort" in sent, often[sent]))
        batch, self.joints = next((b, j) for b, j, _ in found if frozenset(j) == names)
        self._all = names
        check_joints(self._source, batch.names, self.arm)

    def nothing(self, messages: int, bag: BagReader, topic: str) -> RecordingError:
        """Return the error about a topic without a usable message."""
        if self._problem:
            return RecordingError(self._source, self._problem)
        if messages:
            return RecordingError(self._source, "holds no JointState messages")
        counts = Counter(name for name, _, _ in bag.raw(*bag.topics))
        there = ", ".join(f"{name} {counts[name]}" for name in bag.topics)
        return RecordingError(
            self._source,
            f"holds no JointState messages: the recorder subscribed to {topic} and received none "
            f"(nothing published, or with another QoS); messages by topic: {there}; record with "
            f"`ros2 bag record {topic} --qos-profile-overrides-path qos.yaml`, qos.yaml: "
            f"`{topic}: {{history: keep_last, depth: 100, reliability: best_effort, "
            "durability: volatile}`",
        )


class _Moves:
    """Notices which joints move in JointStates.

    Attributes:
        joints: Those that moved by more than ``STILL``.
    """

    def __init__(self) -> None:
        self.joints: tuple[str, ...] = ()
        self._range: dict[str, tuple[float, float]] = {}

    def add(self, names: Sequence[str], position: Array) -> None:
        """Look at (N, n) positions of n joints."""
        for name, column in zip(names, position.T if len(position) else (), strict=False):
            finite = column[np.abs(column) < LARGEST]
            if name in self.joints or not len(finite):
                continue
            low, high = self._range.get(name, (np.inf, -np.inf))
            low, high = min(low, float(finite.min())), max(high, float(finite.max()))
            self._range[name] = low, high
            if high - low > STILL:
                self.joints += (name,)


def _topic(bag: BagReader, topic: str | None, arm: Arm | None = None) -> str:
    """Return the topic to read; of several, the refusal says which of them move."""
    try:
        return bag.joint_state_topic(topic, arm.name if arm else "", arm.joint_names if arm else ())
    except SeveralTopicsError as error:
        shown = []
        for each in error.topics:
            count, moving = _content(bag, each)
            moves = f"{_some(moving)} move" if moving else "no joint moves"
            shown.append(f"{each}: {count} messages, {moves}" if count else f"{each}: no messages")
        raise SeveralTopicsError(bag.path, error.topics, "; ".join(shown)) from None


def _content(bag: BagReader, topic: str) -> tuple[int, tuple[str, ...]]:
    """Return the number of a topic's JointStates, and the joints that move in them."""
    count, moves = 0, _Moves()
    for part in _parts(bag.raw(topic), CHUNK):
        count += len(part)
        for batch in _decode([data for _, _, data in part])[0]:
            if batch.values[0].shape[1] == len(batch.names):
                moves.add(batch.names, batch.values[0])
    return count, moves.joints


def _some(names: Sequence[str]) -> str:
    return f"{', '.join(names[:3])}{', …' if len(names) > 3 else ''}"


def _moving_topic(bag: BagReader, read: str, joints: Sequence[str]) -> tuple[Note, ...]:
    """Return a note on another topic with joints that move, preferably the arm's."""
    found: list[tuple[bool, str, tuple[str, ...]]] = []
    for topic, kind in bag.topics.items():
        if topic == read or kind != JOINT_STATE or commanded(topic):
            continue
        _, moving = _content(bag, topic)
        if moving:
            found.append((not joints or fits(moving, joints), topic, moving))
    if not found:
        return ()
    _, topic, moving = max(found, key=lambda each: each[0])
    text = f"the joints of {read} stand still, those of {topic} move ({_some(moving)})"
    return (note("moving_topic", f"{text}: --topic {topic}"),)


def _misfit(batch: _Batch, joints: tuple[str, ...], arm: Arm | None) -> str:
    """Return why messages cannot be used, or ``""``."""
    names = batch.names
    if not joints:
        expected = f"some of: {', '.join(arm.joint_names)}" if arm else "names of joints"
        other = other_arm(arm.name, names) if arm else ""
        if arm and other:
            expected += f" (they are of arm {other}, not {arm.name}: --arm, --model)"
        way_out = renaming(names[0]) if arm and names and not other else ""
        return f"names joints {', '.join(names)[:200] or '(none)'}, expected {expected}{way_out}"
    for joint in joints:
        if names.count(joint) > 1:
            return f"names {joint} twice"
    for quantity, values in zip(QUANTITIES, batch.values, strict=True):
        count = values.shape[1]
        if count != len(names) and (count or quantity == "position"):
            return f"has {count} {quantity} values for {len(names)} names"
    return ""


def _notes(damaged: int, others: int) -> tuple[Note, ...]:
    found = []
    if damaged:
        found.append(
            note("unreadable", "of messages that are no such JointStates", left_out=damaged)
        )
    if others:
        text = "of messages of other joints or fields (another publisher)"
        found.append(note("other_messages", text, left_out=others))
    return tuple(found)
