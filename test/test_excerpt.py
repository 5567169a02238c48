"""Of a recording too long to be diagnosed whole, stretches that are spread evenly are looked at."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.diagnosis import LoadSettings, load
from dvrk_gravity.effects import push_window
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import Recording, RecordingFile, excerpt
from testing.world import World

MODEL = World.draw(1).model()


def moving(duration: float, rate: float = 100.0, pause: tuple[float, float] = (0.0, 0.0)):
    """Return a recording of a motion that does not repeat, with a gap if there is a pause."""
    time = np.arange(0.0, duration, 1.0 / rate)
    time = time[(time < pause[0]) | (time >= pause[1])]
    angle = time[:, None] * (0.5 + 0.37 * np.arange(7)) + 0.01 * time[:, None] ** 1.3
    q = 0.3 * np.sin(angle) + 0.2
    qd = np.gradient(q, time, axis=0)
    return Recording(JOINT_NAMES, time, q, qd, MODEL.torque(q, qd), invalid=3)


def test_stretches_of_a_long_recording_are_spread_over_all_of_it(tmp_path):
    recording = moving(100.0)
    recording.save(tmp_path / "r.csv")
    for source in (recording, RecordingFile(tmp_path / "r.csv")):
        found = excerpt(source, 30.0, 5.0)
        parts = list(found.stretches)
        assert [round(part.time[0]) for part in parts] == [5, 25, 40, 55, 75, 90]
        for part in parts:
            first = np.searchsorted(recording.time, part.time[0])
            rows = slice(first, first + len(part))
            assert len(part) == pytest.approx(500, abs=1)
            assert np.array_equal(part.position, recording.position[rows])


def test_an_excerpt_says_what_it_is_of_and_what_the_checks_find_in_the_whole():
    warnings = excerpt(moving(100.0, pause=(13.0, 14.0)), 30.0, 5.0).warnings
    kinds = {warning.kind: warning for warning in warnings}
    assert kinds["excerpt"].numbers["used_s"] == pytest.approx(30.0, abs=0.1)
    assert kinds["excerpt"].numbers["duration_s"] == pytest.approx(100.0, abs=0.1)
    assert kinds["gaps"].numbers["count"] == 1  # not within what is looked at
    assert kinds["invalid_stamps"].numbers["samples"] == 3


def test_static_poses_are_never_cut():
    random = np.random.default_rng(0)
    poses = Recording(JOINT_NAMES, None, random.normal(size=(50, 7)))
    (whole,) = excerpt(poses, 1.0, 1.0).stretches
    assert whole is poses


def test_recordings_share_the_time_that_is_looked_at():
    settings = LoadSettings(longest=40.0, stretch=10.0)
    both = load([moving(60.0), moving(60.0)], MODEL, settings=settings)
    assert len(both.motion.parts) == 4
    assert len(both.motion.q) / both.motion.rate == pytest.approx(38.0, abs=1.5)
    assert [warning.kind for warning in both.warnings].count("excerpt") == 1  # alike, so told once


def test_a_stretch_of_gaps_is_left_out_and_named():
    whole = moving(100.0)
    # Readings that come in bursts with gaps between them, in one of the stretches.
    kept = (whole.time < 40.0) | (whole.time > 45.0) | (whole.time % 0.4 < 0.2)
    loaded = load([whole.rows(kept)], MODEL, settings=LoadSettings(longest=30.0, stretch=5.0))
    assert len(loaded.motion.parts) == 5
    assert any("40.01 s" in line for line in loaded.handling)


def test_a_long_recording_of_nothing_but_gaps_is_refused():
    whole = moving(30.0)
    with pytest.raises(RecordingError, match="without a gap"):
        load([whole.rows(whole.time % 0.4 < 0.2)], MODEL, settings=LoadSettings(longest=10.0))


def test_a_push_is_looked_for_in_samples_and_not_in_the_time_between_them():
    """Two recordings of a minute, a day apart: every pair of 350,000 bins would be tried."""
    time = np.concatenate([np.arange(0.0, 60.0, 0.025), 86400.0 + np.arange(0.0, 60.0, 0.025)])
    residual = 0.1 * np.random.default_rng(0).normal(size=len(time))
    residual[(time > 86420.0) & (time < 86425.0)] += 1.0
    begin, end = push_window(time, residual)
    assert (begin, end) == (pytest.approx(86420.0, abs=0.25), pytest.approx(86425.0, abs=0.25))
