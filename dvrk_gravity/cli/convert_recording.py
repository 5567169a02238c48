"""Recordings from one kind of file to another: CSV, rosbag2, ROS 1."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

from dvrk_gravity.cli import arm_options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs
from dvrk_gravity.recording import (
    Note,
    Recording,
    check_counts,
    is_bag,
    iterate_recording,
    save_recording,
)

DEFAULT_TOPIC = "/measured_js"


def convert(arguments: argparse.Namespace) -> int:
    """Convert a recording, and print what was read and left out; return 0.

    Args:
        arguments: Of ``convert``.

    Raises:
        ConfigError: A report that no recording has.
        RecordingError: One that cannot be read or written.
    """
    if arguments.json is not None:
        raise ConfigError("--json", str(arguments.json), "--check or a model beside it")
    outputs.check({}, [arguments.input], {"OUT": arguments.output})
    samples = 0
    joints: tuple[str, ...] = ()
    notes: list[Note] = []

    def counted() -> Iterator[Recording]:
        nonlocal samples, joints
        given = arm_options.reading(arguments)
        if not is_bag(arguments.input):
            given["topic"] = None  # of the bag that is written
        for part in iterate_recording(arguments.input, **given):
            samples += len(part)
            notes.extend(part.found)
            joints = part.joints
            yield part

    topic = arguments.topic or DEFAULT_TOPIC
    save_recording(counted(), arguments.output, arguments.storage, topic)
    for warning in check_counts(samples, notes):
        print(f"data: {warning}", file=sys.stderr)
    left_out = sum(note.count for note in notes)
    rest = f", {left_out} left out" if left_out else ""
    print(f"{arguments.output}: {samples} samples of {', '.join(joints)}{rest}")
    return 0
