"""sensor_msgs/JointState in CDR bytes: many messages of one layout decoded at once.

A driver's JointStates differ only in their stamp and numbers: frame and joint names, hence the
place of every number, stay the same. So the layout of one message is parsed, and all messages that
agree with it byte by byte outside the numbers are read as one array. Byte layout: OMG DDSI-RTPS,
plain CDR (XCDR1).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.errors import printable

JOINT_STATE = "sensor_msgs/msg/JointState"
ENCAPSULATION = 4  # bytes before the data; alignment counts from their end
STAMP = slice(4, 12)  # int32 s, uint32 ns
MAX_PADDING = 3  # some writers pad the data to a multiple of four
MOST_JOINTS = 10_000  # of one message; each name takes a step of Python


class CdrError(ValueError):
    """Bytes that are not a JointState; the text names the place of the first error."""


@cache
def typestore() -> Any:
    """Return the message definitions of ROS 2 Jazzy (a ``rosbags`` type store)."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def from_ros1(raw: bytes) -> bytes:
    """Return a JointState in ROS 1's bytes as CDR bytes, or raise ``CdrError``."""
    from rosbags.serde import SerdeError

    try:
        return bytes(typestore().ros1_to_cdr(raw, JOINT_STATE))
    except SerdeError as error:
        raise CdrError(str(error)) from error


@dataclass(frozen=True, eq=False)
class JointStateLayout:
    """Where the numbers of a JointState lie.

    Attributes:
        names: Joint names.
        fields: Byte offset and count of position, velocity and effort.
        order: ``"<"`` or ``">"``: byte order.
        template: ``(size,)`` the bytes of the message that was parsed.
        constant: ``(size,)`` which of these bytes are neither stamp nor number.
    """

    names: tuple[str, ...]
    fields: tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
    order: str
    template: NDArray[np.uint8]
    constant: NDArray[np.bool_]

    @classmethod
    def parse(cls, raw: bytes) -> JointStateLayout:
        """Parse one message; raise ``CdrError`` if the bytes are not a JointState."""
        if len(raw) < STAMP.stop or raw[0] != 0 or raw[1] not in (0, 1):
            raise CdrError(f"{len(raw)} bytes that do not begin like plain CDR")
        order = "<" if raw[1] else ">"
        at = STAMP.stop

        def count() -> int:
            nonlocal at
            at += -at % 4
            if at + 4 > len(raw):
                raise CdrError(f"message ends after {len(raw)} bytes, inside a length")
            (value,) = struct.unpack_from(order + "I", raw, at)
            at += 4
            return int(value)

        def text() -> str:
            nonlocal at
            size = count()
            if size > len(raw) - at:
                raise CdrError(f"text of {size} bytes at byte {at} of {len(raw)}")
            value = raw[at : at + size].rstrip(b"\0")
            at += size
            try:
                return printable(value.decode())
            except UnicodeDecodeError as error:
                raise CdrError(f"text at byte {at - size} is not UTF-8") from error

        def numbers() -> tuple[int, int]:
            nonlocal at
            size = count()
            if size:
                at += -(at - ENCAPSULATION) % 8
            if 8 * size > len(raw) - at:
                raise CdrError(f"{size} numbers at byte {at} of {len(raw)}")
            start = at
            at += 8 * size
            return start, size

        text()  # frame_id
        if (joints := count()) > MOST_JOINTS:
            raise CdrError(f"names {joints} joints, expected at most {MOST_JOINTS}")
        names = tuple(text() for _ in range(joints))
        fields = (numbers(), numbers(), numbers())
        if len(raw) - at > MAX_PADDING:
            raise CdrError(f"{len(raw) - at} bytes left over after a JointState")
        constant = np.ones(len(raw), dtype=bool)
        constant[STAMP] = False
        for start, size in fields:
            constant[start : start + 8 * size] = False
        return cls(names, fields, order, np.frombuffer(raw, np.uint8), constant)

    def match(self, messages: Sequence[bytes]) -> NDArray[np.bool_]:
        """Return ``(N,)``: which messages have this layout, names and frame."""
        size = len(self.template)
        result = np.fromiter((len(raw) == size for raw in messages), bool, len(messages))
        same_size = [raw for raw in messages if len(raw) == size]
        if same_size:
            table = np.frombuffer(b"".join(same_size), np.uint8).reshape(-1, size)
            result[result] = np.all(table[:, self.constant] == self.template[self.constant], axis=1)
        return result

    def decode(
        self, messages: Sequence[bytes]
    ) -> tuple[NDArray[np.int64], tuple[NDArray[np.float64], ...]]:
        """Return stamps (N,) ns and position, velocity, effort (N, count) of this layout."""
        size = len(self.template)
        table = np.frombuffer(b"".join(messages), np.uint8).reshape(-1, size)

        def view(start: int, count: int, kind: str) -> NDArray[np.generic]:
            width = count * np.dtype(kind).itemsize
            part = np.ascontiguousarray(table[:, start : start + width])
            return part.view(self.order + kind).reshape(len(table), count)

        seconds = view(STAMP.start, 1, "i4")[:, 0].astype(np.int64)
        nanoseconds = view(STAMP.start + 4, 1, "u4")[:, 0].astype(np.int64)
        values = tuple(view(start, count, "f8").astype(np.float64) for start, count in self.fields)
        return seconds * 1_000_000_000 + nanoseconds, values


def encode_joint_state(
    stamp_ns: int,
    names: Sequence[str],
    position: Sequence[float] = (),
    velocity: Sequence[float] = (),
    effort: Sequence[float] = (),
) -> bytes:
    """Return a JointState with an empty frame as little-endian CDR bytes; SI units.

    Raises:
        CdrError: If the stamp's seconds do not fit in 32 bits.
    """
    seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
    if not 0 <= seconds < 2**31:
        raise CdrError(f"stamp {stamp_ns} ns is outside what a message header holds")
    raw = bytearray(b"\0\1\0\0")
    raw += struct.pack("<iII", seconds, nanoseconds, 1) + b"\0"

    def pad(multiple: int) -> None:
        raw.extend(bytes(-(len(raw) - ENCAPSULATION) % multiple))

    pad(4)
    raw += struct.pack("<I", len(names))
    for name in names:
        data = name.encode() + b"\0"
        pad(4)
        raw += struct.pack("<I", len(data)) + data
    for numbers in (position, velocity, effort):
        pad(4)
        raw += struct.pack("<I", len(numbers))
        if len(numbers):
            pad(8)
            raw += struct.pack(f"<{len(numbers)}d", *numbers)
    return bytes(raw)
