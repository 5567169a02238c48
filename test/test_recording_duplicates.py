"""Several recordings: the same data counts once, and no two overlap in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_mtm import ARM, truth

from dvrk_gravity import TorqueModel
from dvrk_gravity.diagnosis import load
from dvrk_gravity.observation import observe
from dvrk_gravity.recording import Recording, duplicate_samples, without_duplicates

MODEL = TorqueModel.from_parameters({"arm": "mtmr", "beta": (0.1,) * 10})


@pytest.fixture(scope="module")
def measured() -> Recording:
    """12 s of a simulated motion with noise."""
    return replace(truth(1, 12.0), source="one.csv")


@pytest.fixture(scope="module")
def other() -> Recording:
    """Another 12 s."""
    return truth(2, 12.0)


def appended(*recordings: Recording) -> Recording:
    """Return recordings one after the other as one, as if they had been taken so."""
    time, last = [], -0.01
    for recording in recordings:
        assert recording.time is not None
        time.append(recording.time - recording.time[0] + last + 0.01)
        last = time[-1][-1]
    columns = {
        name: np.concatenate([getattr(recording, name) for recording in recordings])
        for name in ("position", "velocity", "effort")
    }
    return replace(recordings[0], time=np.concatenate(time), **columns)


def remaining(recordings: list[Recording]) -> list[int]:
    """Return how many samples of each remain."""
    left = (~duplicate_samples(each, recordings[:k]) for k, each in enumerate(recordings))
    return [int(mask.sum()) for mask in left]


def test_what_was_read_before_is_left_out(measured, other):
    assert remaining([measured, other, measured]) == [1200, 1200, 0]
    assert remaining([appended(measured, measured)]) == [1200]
    assert remaining([appended(measured, other, measured)]) == [2400]
    assert remaining([measured.between(0.0, 8.0), measured.between(5.0, 12.0)]) == [800, 400]
    assert remaining([appended(other.between(0.0, 3.0), measured), measured]) == [1500, 0]


def test_what_is_left_is_what_was_not_read_before_in_order(measured, other):
    whole = appended(measured, other)
    again = duplicate_samples(whole, [measured.between(2.0, 6.0)])
    np.testing.assert_array_equal(np.flatnonzero(again), np.arange(200, 600))


def test_less_than_a_second_is_no_repetition(measured, other):
    for until, left in ((3.9, 1290), (4.1, 1200)):
        again = appended(other, measured.between(3.0, until))
        assert remaining([measured, again])[1] == left


def test_stale_samples_and_rest_are_no_duplicates(measured):
    """The same where nothing moves, and readings that were renewed every fifth time only."""

    def again(rows: np.ndarray) -> Recording:
        return replace(replace(measured, time=None).rows(rows), time=np.arange(len(rows)) / 100.0)

    hold = again(np.repeat([50], 400))
    rest = appended(hold, measured, hold)
    assert remaining([rest]) == [2000]
    stale = again(np.repeat(np.arange(0, 1200, 5), 5))
    assert remaining([stale]) == [1200]
    assert remaining([rest, rest]) == [2000, 0]  # with what moves on either side they were
    assert remaining([stale, stale]) == [1200, 0]


def test_a_motion_that_repeats_with_noise_loses_no_sample(measured):
    random = np.random.default_rng(0)

    def noisy(values: np.ndarray) -> np.ndarray:
        return np.round(values + 1e-3 * random.normal(size=values.shape), 4)

    again = [
        replace(measured, position=noisy(measured.position), effort=noisy(measured.effort))
        for _ in range(2)
    ]
    assert remaining([appended(*again)]) == [2400]


def test_what_is_left_of_a_recording_is_used_and_what_is_left_out_is_said(measured, other):
    first, more = appended(measured, other), appended(truth(3, 12.0), measured)
    kept, warnings = without_duplicates([first, replace(first, source="copy.csv"), more])
    assert [each and len(each) for each in kept] == [2400, None, 1200]
    assert [warning.numbers["samples"] for warning in warnings] == [2400, 1200]
    assert "copy.csv: 2400 of 2400 samples" in str(warnings[0])


def test_poses_that_repeat_exactly_count_once():
    random = np.random.default_rng(0)
    poses, more = (
        Recording(ARM.joint_names, None, random.normal(size=(40, 7)), None,
                  random.normal(size=(40, 7)), np.ones((40, 7)))
        for _ in range(2)
    )  # fmt: skip
    shuffled = poses.rows(random.permutation(40))
    kept, warnings = without_duplicates([poses, shuffled, more])
    assert kept == [poses, None, more]
    assert [warning.numbers["samples"] for warning in warnings] == [40]
    # From the other direction it is another pose.
    turned = replace(poses, direction=-poses.direction)
    assert remaining([poses, turned]) == [40, 40]
    assert remaining([poses.rows([0, 1, 1, 2, 0])]) == [3]


def test_a_motion_given_twice_or_appended_to_itself_is_observed_once(measured, other):
    (once,) = observe([measured], ARM)
    assert "duplicate_samples" not in {warning.kind for warning in once.warnings}
    for given in ([measured, measured], [appended(measured, measured)]):
        (again,) = observe(given, ARM)
        assert [warning.kind for warning in again.warnings].count("duplicate_samples") == 1
        np.testing.assert_allclose(again.effort, once.effort, atol=1e-9)
        np.testing.assert_allclose(again.q, once.q, atol=1e-9)
    # The rest is too short for the filter.
    (alone,) = observe([measured, appended(measured, other.between(0.0, 0.3))], ARM)
    assert any("1200 of 1230 samples" in str(warning) for warning in alone.warnings)


def test_a_diagnosis_reads_a_recording_once(measured):
    once = load([measured], MODEL)
    for given in ([measured, measured], [appended(measured, measured)]):
        again = load(given, MODEL)
        assert len(again) == len(once)
        assert [warning.kind for warning in again.warnings].count("duplicate_samples") == 1


@pytest.mark.parametrize("later", [20, 5, -20])
def test_recordings_are_read_in_one_time_in_which_none_overlaps(measured, other, later):
    second = replace(other, start_ns=measured.start_ns + later * 10**9)
    motion = load([measured, second], MODEL)
    first, begin = motion.time[0], motion.time[motion.parts[1].start]
    if later == 5:
        assert begin > motion.time[motion.parts[0].stop - 1]
    else:
        assert begin - first == pytest.approx(later)
