"""JointStates of a bag: one by one as sent, or as recordings."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.bag import BagReader
from dvrk_gravity.recording.cdr import CdrError, JointStateLayout
from dvrk_gravity.recording.samples import (
    CHUNK,
    QUANTITIES,
    Array,
    Coordinates,
    Samples,
    TimeBase,
    check_joints,
)
from dvrk_gravity.recording.timeline import Timeline, with_counts

# Layouts tried on all of a chunk's messages; a stranger stream than that is decoded singly.
SHARED_LAYOUTS = 8


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


def _decode(source: str, first: int, raws: list[bytes]) -> list[_Batch]:
    """Decode a chunk; ``first`` is the number of its first message, for errors."""
    batches: list[_Batch] = []
    pending = np.arange(len(raws))
    while len(pending):
        try:
            layout = JointStateLayout.parse(raws[pending[0]])
        except CdrError as error:
            raise RecordingError(
                source, f"message {first + pending[0]} is not a JointState: {error}"
            ) from error
        if len(batches) < SHARED_LAYOUTS:
            match = layout.match([raws[i] for i in pending])
        else:
            match = np.arange(len(pending)) == 0
        index = pending[match]
        stamps, values = layout.decode([raws[i] for i in index])
        batches.append(_Batch(index, layout.names, stamps, values))
        pending = pending[~match]
    return batches


def read_joint_states(
    path: str | Path, topic: str | None = None, chunk: int = 1000
) -> Iterator[JointStateSample]:
    """Yield every JointState of a topic as it was sent, invalid ones included, in receive order.

    Raises:
        RecordingError: If the bag or a message cannot be read.
    """
    with BagReader(path) as bag:
        messages = bag.raw(bag.joint_state_topic(topic))
        first = 0
        while part := list(islice(messages, chunk)):
            samples: list[Any] = [None] * len(part)
            for batch in _decode(str(path), first, [data for _, _, data in part]):
                stamps = batch.stamps.tolist()
                for row, i in enumerate(batch.indices):
                    samples[i] = JointStateSample(
                        part[i][1], stamps[row], batch.names, *(v[row] for v in batch.values)
                    )
            first += len(part)
            yield from samples


def _columns(
    source: str, number: int, batch: _Batch, known: tuple[str, ...]
) -> tuple[tuple[str, ...], list[int]]:
    """Return the known joints of a message in their order, and where they are in it.

    Where none are known, they are those that the message names.
    """
    names = batch.names
    joints = tuple(joint for joint in known or names if joint in names)
    if not joints:
        expected = f"some of: {', '.join(known)}" if known else "names of joints"
        raise RecordingError(
            source,
            f"message {number} names joints {', '.join(names)[:200] or '(none)'}, "
            f"expected {expected}",
        )
    for joint in joints:
        if names.count(joint) > 1:
            raise RecordingError(source, f"message {number} names {joint} twice")
    for quantity, values in zip(QUANTITIES, batch.values, strict=True):
        count = values.shape[1]
        if count != len(names) and (count or quantity == "position"):
            raise RecordingError(
                source, f"message {number} has {count} {quantity} values for {len(names)} names"
            )
    return joints, [names.index(joint) for joint in joints]


def iterate_bag(
    path: str | Path,
    topic: str | None = None,
    coordinates: Coordinates = "joint",
    time_base: TimeBase = "stamp",
    chunk: int = CHUNK,
    arm: Arm | None = None,
) -> Iterator[Samples]:
    """Yield a bag's JointStates as recordings of at most ``chunk`` samples.

    Joints are matched by name, in any order; names that are not the arm's (a gripper) are left
    out. Without an arm, they are those of the first message. Times are relative to the first
    sample. Messages with stamp 0 are left out and counted
    (``invalid``), and so are those with the time of the message before (``repeated``).

    Raises:
        RecordingError: If the bag cannot be read, or joints, lengths or times do not fit together.
    """
    return with_counts(_iterate(Path(path), topic, coordinates, time_base, chunk, arm))


def _iterate(
    path: Path,
    topic: str | None,
    coordinates: Coordinates,
    time_base: TimeBase,
    chunk: int,
    arm: Arm | None,
) -> Iterator[tuple[Samples | None, int, int]]:
    source = str(path)
    table = _Table(source, arm)
    timeline = Timeline()
    first = 0
    with BagReader(path) as bag:
        messages = bag.raw(bag.joint_state_topic(topic))
        while part := list(islice(messages, chunk)):
            stamps, arrays = table.read(first, [data for _, _, data in part])
            valid = stamps != 0
            numbers = (first + np.flatnonzero(valid)).tolist()
            first += len(part)
            if time_base == "receive":
                stamps = np.array([receive_ns for _, receive_ns, _ in part], np.int64)
            later, time = timeline.advance(
                stamps[valid], numbers, f"{source}: {time_base} of message"
            )
            invalid, repeated = len(part) - len(later), len(later) - len(time)
            if not len(time):
                yield None, invalid, repeated
                continue
            fields = {quantity: values[valid][later] for quantity, values in arrays.items()}
            for array in (*fields.values(), time):
                array.flags.writeable = False
            samples = Samples(
                table.joints,
                time,
                coordinates=coordinates,
                source=source,
                start_ns=timeline.start_ns or 0,
                arm=arm,
                **fields,
            )
            yield samples, invalid, repeated
    if timeline.start_ns is None:
        counted = f" but {first} with stamp 0 (invalid)" if first else ""
        raise RecordingError(source, f"holds no JointState messages{counted}")


class _Table:
    """Puts the numbers of JointStates into arrays of the arm's joints, or of the first message's.

    Attributes:
        joints: Known joints of the messages, in the arm's order; empty before the first message.
    """

    def __init__(self, source: str, arm: Arm | None) -> None:
        self.joints: tuple[str, ...] = ()
        self._arm = arm
        self._known = arm.joint_names if arm else ()
        self._source = source
        self._quantities: tuple[str, ...] = ()

    def read(self, first: int, raws: list[bytes]) -> tuple[NDArray[np.int64], dict[str, Array]]:
        """Return stamps ``(N,)`` ns and arrays ``(N, n)`` of the quantities that are sent.

        Raises:
            RecordingError: If a message does not fit the ones before.
        """
        stamps = np.empty(len(raws), np.int64)
        arrays: dict[str, Array] = {}
        for batch in _decode(self._source, first, raws):
            number = first + int(batch.indices[0])
            joints, columns = _columns(self._source, number, batch, self._known or self.joints)
            sent = {q: v for q, v in zip(QUANTITIES, batch.values, strict=True) if v.shape[1]}
            if not self.joints:
                check_joints(self._source, batch.names, self._arm)
                self.joints, self._quantities = joints, tuple(sent)
            elif (joints, tuple(sent)) != (self.joints, self._quantities) or (
                not self._known and len(batch.names) != len(joints)
            ):
                raise RecordingError(
                    self._source,
                    f"message {number} holds other joints or fields than the ones before: "
                    f"{', '.join(joints)}",
                )
            for quantity, values in sent.items():
                target = arrays.setdefault(quantity, np.empty((len(raws), len(joints))))
                target[batch.indices] = values[:, columns]
            stamps[batch.indices] = batch.stamps
        return stamps, arrays
