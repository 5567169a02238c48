"""JointStates as the bytes that DDS carries: unpacked and packed without a message object.

An arm's messages differ in their stamp and their numbers only, and these always lie at the same
place. Taking them from there is several times faster than having rclpy make an object with seven
names and thirty numbers of its own, of which most is never looked at.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DroppedSampleError
from dvrk_gravity.recording import ENCAPSULATION, STAMP, CdrError, JointStateLayout
from dvrk_gravity.ros.command_topic import EFFORT

Stamp = tuple[int, int]
"""Seconds and nanoseconds."""


@dataclass(frozen=True, eq=False)
class Fields:
    """What a JointState says."""

    stamp: Stamp
    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array

    @property
    def stamp_ns(self) -> int:
        """The stamp, ns."""
        return self.stamp[0] * 1_000_000_000 + self.stamp[1]


class JointStateReader:
    """Unpacks JointStates; quick from the second message of a layout on."""

    def __init__(self) -> None:
        """Start without a layout."""
        self._size = -1
        self._fixed: list[tuple[slice, bytes]] = []

    def read(self, raw: bytes) -> Fields:
        """Return the fields of a message.

        Raises:
            DroppedSampleError: The bytes are not a JointState.
        """
        if len(raw) != self._size or any(raw[part] != known for part, known in self._fixed):
            try:
                self._learn(raw)
            except CdrError:
                return _unpacked_by_ros(raw)
        position, velocity, effort = (
            np.frombuffer(raw, self._number, count, start) if count else _NOTHING
            for start, count in self._fields
        )
        stamp = self._stamp.unpack_from(raw, STAMP.start)
        return Fields(stamp, self._names, position, velocity, effort)

    def _learn(self, raw: bytes) -> None:
        """Take the layout of a message for that of those to come."""
        self._size = -1  # should it be none, no later message is to match the last one
        layout = JointStateLayout.parse(raw)
        self._names, self._fields = layout.names, layout.fields
        self._number = np.dtype(f"{layout.order}f8")
        self._stamp = struct.Struct(f"{layout.order}iI")
        # All but stamp and numbers has to stay as it is: the parts between them.
        ends = np.flatnonzero(np.diff(layout.constant.astype(int), prepend=0, append=0))
        parts = [slice(int(a), int(b)) for a, b in ends.reshape(-1, 2)]
        self._fixed = [(part, raw[part]) for part in parts]
        self._size = len(raw)


class CommandWriter:
    """Packs JointStates of commands, all with the same names, frame and fields."""

    def __init__(self, names: Sequence[str], frame: str, fields: Sequence[str] = EFFORT) -> None:
        """Pack one message, of which stamp and numbers are then replaced.

        Args:
            names: The joints.
            frame: What the messages are marked with.
            fields: Those that have a number a joint, in JointState's order; the others are empty.
        """
        raw = bytearray(b"\0\1\0\0" + bytes(8))  # little-endian CDR; a stamp

        def text(value: str) -> None:
            data = value.encode() + b"\0"
            raw.extend(bytes(-len(raw) % 4) + struct.pack("<I", len(data)) + data)

        text(frame)
        raw.extend(bytes(-len(raw) % 4) + struct.pack("<I", len(names)))
        for name in names:
            text(name)
        raw.extend(bytes(-len(raw) % 4))
        self._places: list[slice] = []
        for field in ("position", "velocity", "effort"):
            if field not in fields:
                raw.extend(struct.pack("<I", 0))
                continue
            raw.extend(struct.pack("<I", len(names)))
            raw.extend(bytes(-(len(raw) - ENCAPSULATION) % 8))
            self._places.append(slice(len(raw), len(raw) + 8 * len(names)))
            raw.extend(bytes(8 * len(names)))
        self._raw = raw

    def write(self, stamp: Stamp, *values: Array) -> bytes:
        """Return the bytes of a message: (n,) numbers for each of its fields."""
        struct.pack_into("<iI", self._raw, STAMP.start, *stamp)
        for place, numbers in zip(self._places, values, strict=True):
            self._raw[place] = numbers.astype("<f8", copy=False).tobytes()
        return bytes(self._raw)


def _unpacked_by_ros(raw: bytes) -> Fields:
    """Return the fields of bytes of which our own parser makes nothing (some padding, say)."""
    try:
        message = deserialize_message(raw, JointState)
    except Exception as error:  # whatever the middleware's parser says of damaged bytes
        raise DroppedSampleError("malformed", f"{len(raw)} bytes, no JointState") from error
    numbers = (np.array(field) for field in (message.position, message.velocity, message.effort))
    stamp = message.header.stamp
    return Fields((stamp.sec, stamp.nanosec), tuple(message.name), *numbers)


_NOTHING = np.empty(0)
