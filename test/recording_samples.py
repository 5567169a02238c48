"""Recordings and files that the tests of recordings share."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.recording import (
    JOINT_STATE,
    BagWriter,
    Bands,
    Recording,
    check,
    encode_joint_state,
    prepare,
)

TOPIC = "/MTMR/measured_js"
ARM = Arm.load("mtmr")
START = 1_530_000_000_000_000_000


def shared_data(name):
    """Return the path of a measured file, or skip."""
    default = Path(__file__).resolve().parents[1] / "../shared/data"
    path = Path(os.environ.get("DVRK_GRAVITY_DATA", default)) / name
    if not path.exists():
        pytest.skip(f"no measured data at {path} (set DVRK_GRAVITY_DATA)")
    return path


def wave(count=2000, rate=200.0, joints=JOINT_NAMES, seed=0, **changes):
    """Return a clean trajectory: sines of 0.3-0.9 Hz, exact velocities, efforts with noise."""
    time = np.arange(count) / rate
    omega = 2 * np.pi * np.linspace(0.3, 0.9, len(joints))
    size = np.linspace(0.4, 0.7, len(joints))
    rng = np.random.default_rng(seed)
    position = size * np.sin(np.outer(time, omega))
    fields = {
        "time": time,
        "position": position,
        "velocity": size * omega * np.cos(np.outer(time, omega)),
        "effort": 0.02 * position + 1e-4 * rng.normal(size=position.shape),
        "source": "wave",
        "arm": ARM,
    }
    return Recording(joints, **(fields | changes))


def write_messages(path, messages, storage="sqlite3", topic=TOPIC, msgtype=JOINT_STATE):
    """Write (receive_ns, CDR bytes) pairs."""
    with BagWriter(path, storage) as bag:
        bag.add_topic(topic, msgtype)
        for receive_ns, data in messages:
            bag.write(topic, msgtype, data, receive_ns)


def joint_state(k, names=JOINT_NAMES, **changes):
    """Return one receive time and message: k ms after START, every number different."""
    n = len(names)
    fields = {
        "stamp_ns": START + k * 1_000_000,
        "position": [0.1 * j + 0.001 * k for j in range(n)],
        "velocity": [0.2 * j + 0.001 * k for j in range(n)],
        "effort": [0.3 * j + 0.001 * k for j in range(n)],
    }
    fields |= changes
    return START + k * 1_000_000 + 500_000, encode_joint_state(names=names, **fields)


def messages(recording, stamps=None, names=None, **columns):
    """Return a recording's (receive_ns, CDR bytes), with other stamps, names or numbers."""
    fields = {q: getattr(recording, q) for q in ("position", "velocity", "effort")} | columns
    received = START + np.round(recording.time * 1e9).astype(np.int64)
    stamps = received if stamps is None else stamps
    return [
        (
            int(at) + 300_000,
            encode_joint_state(
                int(stamp),
                names or recording.joints,
                *(() if values is None else values[k].tolist() for values in fields.values()),
            ),
        )
        for k, (at, stamp) in enumerate(zip(received, stamps, strict=True))
    ]


def same(a, b, start=False):
    """Assert that two recordings hold the same numbers, bit by bit."""
    assert a.joints == b.joints
    for name in ("time", "position", "velocity", "effort", "direction"):
        left, right = getattr(a, name), getattr(b, name)
        assert (left is None) == (right is None), name
        assert left is None or np.array_equal(left, right, equal_nan=True), name
    assert not start or a.start_ns == b.start_ns


def column(recording, quantity, joint, change):
    values = getattr(recording, quantity).copy()
    k = recording.joint(joint)
    values[:, k] = change(values[:, k])
    return replace(recording, **{quantity: values})


def held(recording, rows):
    """Repeat the sample before at each of the rows."""
    source = np.arange(len(recording))
    for row in rows:
        source[row] = source[row - 1]
    pick = replace(recording, time=None).rows(source)
    return replace(pick, time=recording.time)


def with_gap(recording):
    late = recording.time + np.where(np.arange(len(recording)) >= 2500, 0.8, 0.0)
    return replace(recording, time=late)


def kinds(recording):
    return {(note.kind, note.joint, note.left_out) for note in recording.found}


def warned(recording):
    """Return the kinds and joints of what the checks find."""
    return {(warning.kind, warning.joint) for warning in check(recording)}


def through(recording, cutoff=5.65, used=None):
    """Return a recording with all its signals through one low-pass, none left out."""
    bands = Bands(cutoff, cutoff, used or cutoff, np.inf, cutoff, for_fit=True)
    return prepare(recording, bands)


def loaded(tmp_path, sent, storage="sqlite3", **options):
    write_messages(tmp_path / "bag", sent, storage)
    return Recording.load(tmp_path / "bag", **({"arm": ARM} | options))
