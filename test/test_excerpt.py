"""Of a recording too long to be analysed whole, stretches that are spread evenly are looked at."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.diagnosis import LoadSettings, load
from dvrk_gravity.effects import push_window
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import Recording, check, excerpt, load_excerpt
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


def starts(recording: Recording) -> list[int]:
    """Return when the stretches of a recording begin, s."""
    gaps = np.flatnonzero(np.diff(recording.time) > 0.1) + 1
    return [round(recording.time[row]) for row in (0, *gaps)]


def test_stretches_of_a_long_recording_are_spread_over_all_of_it():
    recording = moving(100.0)
    found = excerpt(recording, 30.0, 5.0)
    assert starts(found) == [5, 25, 40, 55, 75, 90]
    assert len(found) == 3000
    rows = np.searchsorted(recording.time, found.time)
    assert np.array_equal(found.position, recording.position[rows])
    assert starts(excerpt(found, 15.0, 5.0)) == [25, 55, 90]
    assert excerpt(recording, 100.0, 5.0) is recording


def test_of_a_long_file_stretches_of_a_minute_are_read_and_their_gaps_are_its_own(
    tmp_path, monkeypatch
):
    recording = moving(400.0, 20.0, pause=(70.0, 71.0))
    recording.save(tmp_path / "r.csv")
    monkeypatch.setattr("dvrk_gravity.recording.stream.MOST_SAMPLES", 3 * 60 * 20)
    found = load_excerpt(tmp_path / "r.csv")
    assert len(found) == pytest.approx(3600, rel=0.06)
    assert starts(found) == [57, 70, 172, 287] or len(starts(found)) in (3, 4)
    kinds = {warning.kind: warning for warning in check(found)}
    assert kinds["excerpt"].numbers["share"] == pytest.approx(0.57, abs=0.02)
    assert "gaps" not in kinds or kinds["gaps"].numbers["count"] == 1
    assert len(Recording.load(tmp_path / "r.csv")) == len(recording)


def test_static_poses_are_never_cut():
    random = np.random.default_rng(0)
    poses = Recording(JOINT_NAMES, None, random.normal(size=(50, 7)))
    assert excerpt(poses, 1.0, 1.0) is poses


def test_recordings_share_the_time_that_is_looked_at():
    settings = LoadSettings(longest=40.0, stretch=10.0)
    both = load([moving(60.0), moving(60.0, 90.0)], MODEL, settings=settings)
    assert len(both.parts) == 4
    assert len(both) / both.rate == pytest.approx(38.0, abs=1.5)
    assert [warning.kind for warning in both.warnings].count("excerpt") == 2


def test_what_lies_between_gaps_that_are_too_close_is_left_out():
    whole = moving(100.0)
    # Readings that come in bursts with gaps between them, in one of the stretches.
    kept = (whole.time < 40.0) | (whole.time > 45.0) | (whole.time % 0.4 < 0.2)
    loaded = load([whole.rows(kept)], MODEL, settings=LoadSettings(longest=30.0, stretch=5.0))
    assert not np.any((loaded.time > 40.4) & (loaded.time < 44.8))
    assert any("of short ones left out" in line for line in loaded.processing_log)


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
