"""An arm's messages: its command topic, and JointStates unpacked and packed as DDS's bytes.

An arm's messages differ in their stamp and numbers only, which always lie at the same place.
Reading them there is several times faster than rclpy's message object with seven names and thirty
numbers, most of which nobody reads.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rclpy.exceptions import InvalidTopicNameException
from rclpy.serialization import deserialize_message
from rclpy.validate_topic_name import validate_topic_name
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DroppedSampleError
from dvrk_gravity.errors import ConfigError, printable
from dvrk_gravity.recording import ENCAPSULATION, STAMP, CdrError, JointStateLayout

_NOTHING = np.empty(0)
_SECOND = 1_000_000_000  # ns
_LAST = 2**31 - 1  # s that a stamp holds; a message's own may have more nanoseconds than a second

PARAMETERS = ("output", "output_topic")
EFFORT = ("effort",)


@dataclass(frozen=True)
class CommandTopic:
    """Topic of the commands that an arm takes: efforts, or a stream of positions.

    Attributes:
        name: Its name.
        as_array: Messages are Float64MultiArray, for effort controllers of ros2_control, not
            JointState.
        fields: Non-empty fields of a JointState.
    """

    name: str
    as_array: bool
    fields: tuple[str, ...] = EFFORT

    @classmethod
    def positions(cls) -> CommandTopic:
        """Return the topic of a stream of positions."""
        return cls("servo_jp", False, ("position", "velocity"))

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> CommandTopic:
        """Return the topic that checked values of :data:`PARAMETERS` name.

        Raises:
            ConfigError: Not the name of a topic.
        """
        as_array = values["output"] == "array"
        name = values["output_topic"] or ("commands" if as_array else "servo_jf")
        try:
            validate_topic_name(name)
        except InvalidTopicNameException as error:
            raise ConfigError("output_topic", name, "the name of a topic") from error
        return cls(name, as_array)

    @property
    def message_type(self) -> Any:
        """Type of its messages."""
        return Float64MultiArray if self.as_array else JointState

    def effort(self, message: Any) -> Any:
        """Return the efforts in a message, N·m or N."""
        return message.data if self.as_array else message.effort


class Fields(NamedTuple):
    """The fields of a JointState; the stamp in ns."""

    stamp: int
    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array


class JointStateReader:
    """Unpacks JointStates, quickly from the second message of a layout on."""

    def __init__(self) -> None:
        self._size = -1
        self._parts: list[slice] = []  # of a message, that all have in common
        self._constant: list[bytes] = []

    def read(self, raw: bytes) -> Fields:
        """Return the fields of a message.

        Raises:
            DroppedSampleError: The bytes are not a JointState.
        """
        if len(raw) != self._size or [raw[part] for part in self._parts] != self._constant:
            try:
                self._learn(raw)
            except CdrError:
                return _unpack_by_ros(raw)
        # Copied: numbers in a message are not aligned, which slows every use of them.
        position, velocity, effort = [
            np.frombuffer(raw, self._number, count, start).astype(float) if count else _NOTHING
            for start, count in self._fields
        ]
        seconds, nanoseconds = self._stamp.unpack_from(raw, STAMP.start)
        stamp = seconds * _SECOND + nanoseconds
        return Fields(stamp, self._names, position, velocity, effort)

    def _learn(self, raw: bytes) -> None:
        self._size = -1  # if parsing fails, no later message must match the previous layout
        layout = JointStateLayout.parse(raw)
        self._names, self._fields = layout.names, layout.fields
        self._number = np.dtype(f"{layout.order}f8")
        self._stamp = struct.Struct(f"{layout.order}iI")
        # All but stamp and numbers must stay the same: the parts between them.
        ends = np.flatnonzero(np.diff(layout.constant.astype(int), prepend=0, append=0))
        self._parts = [slice(int(a), int(b)) for a, b in ends.reshape(-1, 2)]
        self._constant = [raw[part] for part in self._parts]
        self._size = len(raw)


class CommandWriter:
    """Packs JointStates of commands, all with the same names, frame and fields."""

    def __init__(self, names: Sequence[str], frame: str, fields: Sequence[str] = EFFORT) -> None:
        """Pack one message, whose stamp and numbers are then replaced; other fields are empty."""
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

    def write(self, stamp: int, *values: Array) -> bytes:
        """Return the bytes of a message: its stamp, ns, and (n,) numbers for each of its fields."""
        seconds = min(stamp // _SECOND, _LAST)
        struct.pack_into("<iI", self._raw, STAMP.start, seconds, stamp - seconds * _SECOND)
        for place, numbers in zip(self._places, values, strict=True):
            self._raw[place] = numbers.astype("<f8", copy=False).tobytes()
        return bytes(self._raw)


def _unpack_by_ros(raw: bytes) -> Fields:
    """Return the fields of bytes that our own parser refuses (some padding, say)."""
    try:
        message = deserialize_message(raw, JointState)
    except Exception as error:  # the middleware raises several types for damaged bytes
        raise DroppedSampleError("malformed", f"{len(raw)} bytes, no JointState") from error
    numbers = (np.array(field) for field in (message.position, message.velocity, message.effort))
    stamp = message.header.stamp.sec * _SECOND + message.header.stamp.nanosec
    return Fields(stamp, tuple(map(printable, message.name)), *numbers)
