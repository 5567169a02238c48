"""Trajectories prepared for a fit: gaps, what is kept, what is lost."""

from __future__ import annotations

import numpy as np
import pytest
from recording_samples import through

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.recording import Recording, prepare

SAME = 1e-9  # of a signal's largest value


def swing(samples: int = 6000, rate: float = 200.0, jitter: float = 0.0) -> Recording:
    """Return all joints on two sines each, stamps off by ``jitter`` s, coarse encoders."""
    random = np.random.default_rng(3)
    # One stamp in five is off: the median interval is what it would be without.
    off = jitter * random.uniform(-0.5, 0.5, samples) * (np.arange(samples) % 5 == 3)
    time = np.arange(samples) / rate + off
    rates = 2.0 * np.pi * random.uniform(0.2, 1.0, (2, 7))
    angle = time[:, None, None] * rates + random.uniform(0.0, 6.0, (2, 7))
    position = 0.2 * np.sin(angle).sum(axis=1)
    velocity = 0.2 * (rates * np.cos(angle)).sum(axis=1)
    effort = np.array([0.5, 0.5, 0.5, 0.1, 0.02, 0.02, 0.005]) * np.sin(3.0 * angle[:, 0])
    effort += 1e-3 * random.normal(size=effort.shape)
    return Recording(
        JOINT_NAMES, time, np.round(position / 1e-4) * 1e-4, velocity, effort, arm=Arm.load("mtmr")
    )


def interrupted(recording: Recording, longest: int, every: int) -> Recording:
    """Return a recording with up to ``longest`` samples missing about every ``every``."""
    random = np.random.default_rng(4)
    kept = np.ones(len(recording), dtype=bool)
    for first in range(every, len(recording) - every, every):
        kept[first : first + random.integers(3, longest)] = False
    return recording.rows(kept)


def test_gaps_that_are_short_for_the_filter_cost_no_samples():
    """Gaps of up to 16 ms at 1 kHz, in front of a filter of 5.65 Hz."""
    recording = swing(8000, 1000.0)
    gappy = interrupted(recording, 16, 200)
    assert 0.008 < np.diff(gappy.time).max() < 0.0165
    found, clean = (prepare(given) for given in (gappy, recording))
    assert found.parts == clean.parts
    assert any("16 ms" in line for line in found.processing_log)
    assert "samples_discarded" not in {warning.kind for warning in found.warnings}
    actual, expected = found.filtered, clean.filtered
    inner = slice(clean.filter.edge, -clean.filter.edge)
    for name, same in {"position": 1e-3, "velocity": 0.01, "effort": 0.01}.items():
        first, second = getattr(actual, name)[inner], getattr(expected, name)[inner]
        assert np.abs(first - second).max() < same * np.abs(second).max(), name


def test_the_longest_gap_that_is_bridged_is_the_filters_time_constant():
    recording = swing(8000, 1000.0)
    for missing, parts in ((27, 1), (30, 2)):  # 1 / (2 pi 5.65 Hz) is 28.2 ms
        gappy = recording.rows(np.delete(np.arange(8000), np.r_[4000 : 4000 + missing]))
        assert len(prepare(gappy).parts) == parts
        assert len(through(gappy).parts) == parts
    slower = through(gappy, 20.0, used=4.0)  # what is used below 4 Hz only
    assert len(slower.parts) == 1
    assert len(through(gappy, 20.0).parts) == 2


def test_more_than_a_tenth_of_the_samples_discarded_is_a_warning():
    recording = swing(8000, 1000.0)
    few = recording.rows(np.delete(np.arange(8000), np.r_[4000:4050]))
    many = recording.rows(np.delete(np.arange(8000), np.r_[1000:1050, 2000:2050, 3000:3050]))
    for prepared in (prepare, through):
        assert "samples_discarded" not in {warning.kind for warning in prepared(few).warnings}
        (found,) = (
            warning for warning in prepared(many).warnings if warning.kind == "samples_discarded"
        )
        # Three parts of a second are too short for the filter, which needs 1.1 s.
        assert found.numbers == {"samples": 2900, "share": 2900 / 7850, "gaps": 3}


def test_what_is_kept_is_what_prepare_gives_one_in_five_at_1_khz():
    recording = swing(8000, 1000.0)
    prepared = prepare(recording)
    kept = prepared.filtered
    motion, effort = (through(recording, cutoff).filtered for cutoff in (11.3, 5.65))
    rows = slice(None, None, 5)
    for ours, theirs in (
        (kept.position, motion.position),
        (kept.velocity, motion.velocity),
        (kept.effort, effort.effort),
    ):
        assert np.abs(ours - theirs[rows]).max() < SAME * np.abs(theirs).max()
    assert prepared.filter.rate == pytest.approx(200.0)
