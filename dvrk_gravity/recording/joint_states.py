"""JointStates of a bag: one by one as sent, or as recordings."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.bag import BagReader
from dvrk_gravity.recording.cdr import CdrError, JointStateLayout
from dvrk_gravity.recording.data import CHUNK, QUANTITIES, Array, Coordinates, Recording, TimeBase

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
    """Messages of one layout out of a chunk: their places, names, stamps and numbers."""

    places: NDArray[np.intp]
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
                for row, i in enumerate(batch.places):
                    samples[i] = JointStateSample(
                        part[i][1], stamps[row], batch.names, *(v[row] for v in batch.values)
                    )
            first += len(part)
            yield from samples


def _columns(source: str, number: int, batch: _Batch) -> tuple[tuple[str, ...], list[int]]:
    """Return the known joints of a message in the arm's order, and where they are in it."""
    names = batch.names
    joints = tuple(joint for joint in JOINT_NAMES if joint in names)
    if not joints:
        raise RecordingError(
            source,
            f"message {number} names joints {', '.join(names)[:200] or '(none)'}, "
            f"expected some of: {', '.join(JOINT_NAMES)}",
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
) -> Iterator[Recording]:
    """Yield a bag's JointStates as recordings of at most ``chunk`` samples.

    Joints are matched by name, in any order; names that are not the arm's (a gripper) are left
    out. Times are relative to the first sample. Messages with stamp 0 are left out and counted
    (``invalid``), and so are those with the time of the message before (``repeated``).

    Raises:
        RecordingError: If the bag cannot be read, or joints, lengths or times do not fit together.
    """
    source = str(path)
    shape: tuple[tuple[str, ...], tuple[bool, ...]] | None = None
    start: int | None = None
    previous: int | None = None
    invalid, first = 0, 0
    with BagReader(path) as bag:
        messages = bag.raw(bag.joint_state_topic(topic))
        while part := list(islice(messages, chunk)):
            stamps = np.empty(len(part), np.int64)
            table: list[Array] = []
            for batch in _decode(source, first, [data for _, _, data in part]):
                number = first + int(batch.places[0])
                joints, places = _columns(source, number, batch)
                here = (joints, tuple(v.shape[1] > 0 for v in batch.values))
                if shape is None:
                    shape = here
                elif here != shape:
                    raise RecordingError(
                        source,
                        f"message {number} holds other joints or fields than the ones before: "
                        f"{', '.join(joints)}",
                    )
                if not table:
                    table = [np.empty((len(part), len(joints))) for has in here[1] if has]
                filled = (v for v in batch.values if v.shape[1])
                for target, values in zip(table, filled, strict=True):
                    target[batch.places] = values[:, places]
                stamps[batch.places] = batch.stamps
            keep = stamps != 0
            invalid += int(np.count_nonzero(~keep))
            numbers = first + np.flatnonzero(keep)
            if time_base == "receive":
                stamps = np.array([receive_ns for _, receive_ns, _ in part], np.int64)
            first += len(part)
            stamps = stamps[keep]
            if not len(stamps):
                continue
            start = int(stamps[0]) if start is None else start
            steps = np.diff(stamps, prepend=stamps[0] - 1 if previous is None else previous)
            previous = int(stamps[-1])
            back = np.flatnonzero(steps < 0)
            if len(back):
                raise RecordingError(
                    source,
                    f"message {numbers[back[0]]}: {time_base} time goes back by "
                    f"{-steps[back[0]] / 1e9:g} s, expected increasing times",
                )
            new = steps > 0
            if not new.any():
                continue
            assert shape is not None
            arrays = iter([values[keep][new] for values in table])
            fields = {q: next(arrays) for q, has in zip(QUANTITIES, shape[1], strict=True) if has}
            for array in fields.values():
                array.flags.writeable = False
            yield Recording(
                shape[0],
                (stamps[new] - start) / 1e9,
                coordinates=coordinates,
                source=source,
                start_ns=start,
                invalid=invalid,
                repeated=int(np.count_nonzero(~new)),
                **fields,
            )
            invalid = 0
    if start is None:
        counted = f" but {invalid} with stamp 0 (invalid)" if invalid else ""
        raise RecordingError(source, f"holds no JointState messages{counted}")
