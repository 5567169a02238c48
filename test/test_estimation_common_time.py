"""A motion that comes back in another recording is held out of all of them together."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.estimation import (
    BlockSettings,
    CommonTime,
    FoldSettings,
    Track,
    find_common_time,
    find_repetition,
    make_blocks,
    make_folds,
    same_motion,
    same_path,
)

RATE, PERIOD = 45.0, 11.67


def moving(time: np.ndarray, period: float | None = PERIOD, seed: int = 0) -> np.ndarray:
    """Return positions of seven joints, with a little noise; without a period they never repeat."""
    random = np.random.default_rng(seed)
    q = 1e-3 * random.normal(size=(len(time), 7)) + np.arange(7.0)
    for _ in range(4):
        rate = random.uniform(0.1, 0.6, 7)
        if period is not None:
            rate = np.maximum(np.round(rate * period), 1.0) / period
        q += 0.3 * np.sin(2.0 * np.pi * time[:, None] * rate + random.uniform(0.0, 6.3, 7))
    return q


def recordings(*spans: tuple[float, float], period: float | None = PERIOD):
    """Return (time on its own clock, part, positions, true time) of recordings of one motion."""
    truth = [np.arange(first, last, 1.0 / RATE) for first, last in spans]
    own = [time - time[0] for time in truth]
    part = np.repeat(np.arange(len(spans)), [len(time) for time in truth])
    q = moving(np.concatenate(truth), period)
    return np.concatenate(own), part.astype(np.int64), q, np.concatenate(truth)


def around(phase: np.ndarray) -> np.ndarray:
    """Return phases off zero, in -0.5 to 0.5."""
    return (phase + 0.5) % 1.0 - 0.5


@pytest.mark.parametrize(
    "spans",
    [
        ((0.0, 15.0), (15.0, 30.0)),
        ((4.0, 19.0), (9.3, 24.3)),
        ((20.0, 33.0), (3.0, 18.0)),
        ((0.0, 30.0), (2.0, 8.0), (7.77, 15.0)),
    ],
)
def test_phases_of_recordings_of_one_periodic_motion_agree(spans):
    time, part, q, truth = recordings(*spans)
    seen = find_common_time(time, part, q, RATE)
    (period,) = seen.periods
    assert period == pytest.approx(PERIOD, abs=0.03)
    off = around((seen.time - truth) / PERIOD)
    np.testing.assert_allclose(around(off - off[0]), 0.0, atol=2e-3)


def nearest_states(folds, truth: np.ndarray, period: float | None) -> float:
    """Return the least time, s, by which fitted states are from those that are tested."""
    least = np.inf
    for tested, excluded in zip(folds.tested, folds.excluded, strict=True):
        apart = np.abs(truth[tested][:, None] - truth[~excluded])
        if period is not None:
            apart = period * np.abs(around(apart / period))
        least = min(least, float(apart.min()))
    return least


@pytest.mark.parametrize("spans", [((0.0, 15.0), (15.0, 30.0)), ((4.0, 19.0), (9.3, 24.3))])
def test_no_phase_that_one_file_tests_is_fitted_to_in_another_and_the_gap_is_kept(spans):
    time, part, q, truth = recordings(*spans)
    folds = make_folds(time, part, q, RATE)
    assert (folds.tested.sum(axis=0) == 1).all()
    assert nearest_states(folds, truth, PERIOD) > FoldSettings().gap - 0.05


def test_a_motion_without_a_period_that_was_recorded_twice_is_held_out_in_common_time():
    time, part, q, truth = recordings((0.0, 20.0), (8.0, 28.0), period=None)
    seen = find_common_time(time, part, q, RATE)
    assert seen.periods == (None,)
    np.testing.assert_allclose(np.ptp(seen.time - truth), 0.0, atol=0.01)
    folds = make_folds(time, part, q, RATE)
    assert nearest_states(folds, truth, None) > FoldSettings().gap - 0.05


def test_parts_of_one_recording_with_gaps_show_its_period_together_on_their_clock():
    """None of 9 s shows a period of 11.67 s alone."""
    _, part, q, truth = recordings((0.0, 9.0), (10.0, 19.0), (20.5, 30.0), (31.0, 40.0))
    seen = find_common_time(truth, part, q, RATE, [0] * 4)
    assert seen.periods == pytest.approx((PERIOD,), abs=0.03)
    np.testing.assert_allclose(around((seen.time - truth) / PERIOD), 0.0, atol=5e-3)


def test_motions_that_coincide_with_nothing_keep_their_own_blocks():
    time, part, q, _ = recordings((0.0, 20.0), (100.0, 130.0), (400.0, 412.0), period=None)
    folds = make_folds(time, part, q, RATE)
    assert folds.periods == ()
    for number in range(3):
        rows = np.flatnonzero(part == number)
        alone = make_folds(time[rows], part[rows], q[rows], RATE)
        np.testing.assert_array_equal(folds.tested[:, rows], alone.tested)
        np.testing.assert_array_equal(folds.excluded[:, rows], alone.excluded)
        # Twelve blocks of time, as long as each other.
        length = time[rows][-1] + 1.0 / RATE
        block = (time[rows] / length * 12).astype(int)
        np.testing.assert_array_equal(alone.tested, block == np.arange(12)[:, None])


def test_arms_that_rest_in_one_place_before_and_after_are_not_of_one_motion():
    time = np.arange(0.0, 30.0, 1.0 / RATE)
    window = np.clip((time - 7.0) / 2.0, 0.0, 1.0) * np.clip((23.0 - time) / 2.0, 0.0, 1.0)
    first, second = (moving(time + shift, None) * window[:, None] + 1e-4 for shift in (0.0, 200.0))
    part = np.repeat(np.arange(2), len(time))
    seen = find_common_time(np.tile(time, 2), part, np.concatenate([first, second]), RATE)
    assert seen.periods == (None, None)


def test_blocks_hold_out_the_same_states_of_all_recordings_guard_included():
    time, part, q, truth = recordings((0.0, 20.0), (8.01, 28.0), period=None)
    seen = find_common_time(time, part, q, RATE)
    blocks = make_blocks(seen, RATE)
    apart = np.abs(truth[blocks.held_out][:, None] - truth[blocks.fold >= 0])
    assert apart.min() * RATE > BlockSettings().guard
    assert 0.2 < blocks.held_out.mean() < 0.4


def test_blocks_of_motions_that_share_nothing_follow_each_other_as_samples_do():
    time, part, q, _ = recordings((0.0, 20.0), (100.0, 113.0), period=None)
    blocks = make_blocks(find_common_time(time, part, q, RATE), RATE)
    whole = make_blocks(CommonTime.single_clock(np.arange(len(time)) / RATE), RATE)
    np.testing.assert_array_equal(blocks.label, whole.label)


# --- the same motion in two recordings ---------------------------------------------------


def test_values_between_samples_are_interpolated_and_there_are_none_beyond():
    track = Track([np.array([0.0, 1.0]), np.array([3.0, 4.0])], [])
    values = [np.array([[0.0, 4.0], [2.0, 8.0]]), np.array([[5.0, 5.0], [6.0, 7.0]])]
    found = track.at(np.array([0.25, 2.0, 3.5, 4.0, 4.1]), values)
    none = [np.nan, np.nan]
    np.testing.assert_allclose(found, [[0.5, 5.0], none, [5.5, 6.0], [6.0, 7.0], none])


def test_states_of_one_recording_are_found_on_the_clock_of_another():
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    q, later = moving(time, None), slice(135, None)  # 3 s
    (when,) = same_motion(Track([time], [q]), Track([time[later] + 47.0], [q[later]]), RATE)
    np.testing.assert_allclose(when[135:-2], time[135:-2] + 47.0, atol=0.01)
    assert np.isnan(when[:134]).all()
    lifted = q + 0.03 * q.std(axis=0)  # beyond what counts as the same state
    (when,) = same_motion(Track([time], [lifted]), Track([time + 47.0], [q]), RATE)
    assert np.isnan(when).all()
    # Of a motion that repeats any period serves.
    first, second = np.arange(0.0, 15.0, 1.0 / RATE), np.arange(30.0, 45.0, 1.0 / RATE)
    tracks = (Track([t - t[0]], [moving(t)]) for t in (first, second))
    (when,) = same_motion(*tracks, RATE)
    assert np.isfinite(when).mean() > 0.9
    assert np.nanmax(np.abs(around((when + 30.0 - first) / PERIOD))) < 5e-3


def test_a_path_is_followed_at_another_pace_but_not_backwards():
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    q = moving(time, None)
    track, last = Track([time], [q]), int(RATE)
    (there,) = same_path(track, Track([2.0 * time], [q]))
    assert there[:-last].all()
    assert not there[-last:].any()  # whether it goes on is not seen
    for lifted, near in ((0.03, True), (0.1, False)):  # of the spread, RMS over the joints
        (there,) = same_path(Track([time], [q + lifted * q.std(axis=0)]), Track([time], [q]))
        assert (there[:-last].mean() > 0.9) == near
    for other in (Track([5.0 * time], [q]), Track([time], [q[::-1]])):
        (there,) = same_path(track, other)
        assert not there.any()


def test_a_repeated_motion_has_its_period_copies_and_times_that_go_on():
    time, part, q, truth = recordings((0.0, 15.0), (15.0, 30.0))
    seen = find_common_time(time, part, q, RATE)
    found, times = find_repetition(seen, part, q, RATE)
    assert found.period == pytest.approx(PERIOD, abs=0.03)
    assert found.copies == pytest.approx(30.0 / PERIOD, rel=0.01)
    assert (np.diff(times) > 0.0).all()
    off = around((times - truth) / PERIOD)
    np.testing.assert_allclose(around(off - off[0]), 0.0, atol=2e-3)
    time, part, q, _ = recordings((0.0, 20.0), period=None)
    assert find_repetition(find_common_time(time, part, q, RATE), part, q, RATE) is None
