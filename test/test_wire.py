"""JointStates as bytes: what our own packing and unpacking makes of them is what ROS makes."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from dvrk_gravity.compensate import DroppedSampleError
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.recording import encode_joint_state
from dvrk_gravity.ros import CommandTopic, CommandWriter, JointStateReader


def random_message(rng: np.random.Generator, least: int = 0) -> tuple[list[str], list[list[float]]]:
    """Return names and three lists of numbers, each of a length of its own."""
    letters = np.array(list("aZ_9äé漢😀 "))
    names = ["".join(rng.choice(letters, rng.integers(9))) for _ in range(rng.integers(least, 9))]
    edges = np.array([0.0, -0.0, 1e308, 5e-324, np.inf, -1.5])
    numbers = [rng.choice(edges, rng.integers(9)).tolist() for _ in range(3)]
    return names, numbers


def test_ros_reads_what_is_written():
    rng = np.random.default_rng(0)
    for frame in ["", "a", "base_link", "x" * 40] * 8:
        names, _ = random_message(rng, least=1)
        stamp = int(rng.integers(2**31)), int(rng.integers(10**9))
        if frame == "a":  # no time, but what a node may send
            stamp = 2**31 - 1, 2**32 - 1
        effort = rng.standard_normal(len(names))
        stamp_ns = stamp[0] * 10**9 + stamp[1]
        raw = CommandWriter(names, frame).write(stamp_ns, effort)
        message = deserialize_message(raw, JointState)
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == stamp
        assert message.header.frame_id == frame
        assert list(message.name) == names
        np.testing.assert_array_equal(message.effort, effort)
        assert len(message.position) == len(message.velocity) == 0


def test_what_ros_or_a_bag_writes_is_read():
    """One reader for all: each message may have another layout than the last, or the same."""
    reader, rng = JointStateReader(), np.random.default_rng(1)
    for stamp in range(1, 100):
        if stamp % 3:
            names, numbers = random_message(rng)
        position, velocity, effort = numbers
        if rng.random() < 0.5:
            message = JointState(name=names, position=position, velocity=velocity, effort=effort)
            message.header.stamp.nanosec = stamp
            raw = bytes(serialize_message(message))
        else:
            raw = encode_joint_state(stamp, names, position, velocity, effort)
        fields = reader.read(raw)
        assert (fields.stamp, fields.names) == (stamp, tuple(names))
        for read, written in zip(
            (fields.position, fields.velocity, fields.effort), numbers, strict=True
        ):
            np.testing.assert_array_equal(read, written)


def test_bytes_that_are_no_message_are_refused_and_forgotten():
    reader, rng = JointStateReader(), np.random.default_rng(2)
    good = encode_joint_state(5, ["a"], [1.0], [2.0], [3.0])
    for cut in range(len(good)):
        for bad in (good[:cut], rng.bytes(3 * cut), good[:cut] + rng.bytes(8)):
            with contextlib.suppress(DroppedSampleError):
                reader.read(bad)
        assert reader.read(good).position == [1.0]
    with pytest.raises(DroppedSampleError) as refused:
        reader.read(good[:-9])
    assert refused.value.cause == "malformed"


def test_what_no_topic_can_be_called_is_refused():
    for name in ("a b", "/", "1st"):
        with pytest.raises(ConfigError, match=f"^output_topic: got '{name}', expected"):
            CommandTopic.of({"output": "array", "output_topic": name})
