"""JointStates as bytes: what our own packing and unpacking makes of them is what ROS makes."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from dvrk_gravity.compensate import DroppedSampleError
from dvrk_gravity.recording import encode_joint_state
from dvrk_gravity.ros import CommandWriter, JointStateReader

NAMES = st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9),
                 max_size=9)  # fmt: skip
NUMBERS = st.lists(st.floats(allow_nan=False), max_size=9)


@given(frame=st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=40),
       names=NAMES.filter(len), sec=st.integers(0, 2**31 - 1), nanosec=st.integers(0, 10**9 - 1),
       data=st.data())  # fmt: skip
def test_ros_reads_what_is_written(frame, names, sec, nanosec, data):
    effort = data.draw(st.lists(st.floats(), min_size=len(names), max_size=len(names)))
    raw = CommandWriter(names, frame).write((sec, nanosec), np.array(effort))
    message = deserialize_message(raw, JointState)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (sec, nanosec)
    assert message.header.frame_id == frame
    assert list(message.name) == names
    np.testing.assert_array_equal(message.effort, effort)
    assert len(message.position) == len(message.velocity) == 0


@given(st.lists(st.tuples(NAMES, NUMBERS, NUMBERS, NUMBERS, st.booleans()), min_size=2, max_size=6))
def test_what_ros_or_a_bag_writes_is_read(messages):
    """One reader for all: each message may have another layout than the last, or the same."""
    reader = JointStateReader()
    for stamp, (names, position, velocity, effort, by_ros) in enumerate(messages * 2, start=1):
        if by_ros:
            message = JointState(name=names, position=position, velocity=velocity, effort=effort)
            message.header.stamp.nanosec = stamp
            raw = bytes(serialize_message(message))
        else:
            raw = encode_joint_state(stamp, names, position, velocity, effort)
        fields = reader.read(raw)
        assert fields.stamp_ns == stamp
        assert fields.names == tuple(names)
        np.testing.assert_array_equal(fields.position, position)
        np.testing.assert_array_equal(fields.velocity, velocity)
        np.testing.assert_array_equal(fields.effort, effort)


def big_endian(raw: bytes, names: int) -> bytes:
    """Turn the numbers of a message with names of four bytes each around."""
    words = bytearray(raw)
    words[1] = 0
    at = 4
    spans = [4, 4, 4, None]  # stamp, length of the frame, the frame itself
    spans += [4] + [4, None] * names
    for span in spans:
        words[at : at + 4] = words[at : at + 4] if span is None else words[at : at + 4][::-1]
        at += 4
    for _ in range(3):
        words[at : at + 4] = words[at : at + 4][::-1]
        at += 4
        if (at - 4) % 8:
            at += 4
        for _ in range(names):
            words[at : at + 8] = words[at : at + 8][::-1]
            at += 8
    return bytes(words)


def test_either_order_of_bytes_is_read():
    numbers = [1.5, -2.0], [3.0, 4.0], [5.0, 6.25]
    raw = encode_joint_state(7_000_000_005, ["abc", "xyz"], *numbers)
    fields = JointStateReader().read(big_endian(raw, 2))
    assert fields.stamp_ns == 7_000_000_005
    assert fields.names == ("abc", "xyz")
    np.testing.assert_array_equal([fields.position, fields.velocity, fields.effort], numbers)


@given(st.binary(max_size=300), st.integers(0, 300))
def test_bytes_that_are_no_message_are_told_and_forgotten(junk, cut):
    reader = JointStateReader()
    good = encode_joint_state(5, ["a"], [1.0], [2.0], [3.0])
    assert reader.read(good).position == [1.0]
    for bad in (junk, good[: cut % len(good)]):
        with contextlib.suppress(DroppedSampleError):
            reader.read(bad)
    assert reader.read(good).position == [1.0]


def test_a_message_cut_short_is_malformed():
    good = encode_joint_state(5, ["a"], [1.0], [2.0], [3.0])
    with pytest.raises(DroppedSampleError, match="no JointState"):
        JointStateReader().read(good[:-9])
