"""Several recordings: the same data counts once, and no two overlap in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_mtm import ARM, truth

from dvrk_gravity import TorqueModel
from dvrk_gravity.diagnosis import load
from dvrk_gravity.observation import observe
from dvrk_gravity.recording import Recording, is_duplicate, without_duplicates

MODEL = TorqueModel.from_parameters({"arm": "mtmr", "beta": (0.1,) * 10})


@pytest.fixture(scope="module")
def measured() -> Recording:
    """12 s of a simulated motion with noise."""
    return replace(truth(1, 12.0), source="one.csv")


@pytest.fixture(scope="module")
def other() -> Recording:
    """Another 12 s."""
    return truth(2, 12.0)


def test_a_recording_that_equals_an_earlier_one_is_left_out_and_said(measured, other):
    given = [measured, other, replace(measured, source="copy.csv"), other]
    kept, warnings = without_duplicates(given)
    assert kept == [measured, other, None, None]
    assert [warning.numbers["samples"] for warning in warnings] == [1200, 1200]
    assert str(warnings[0]).startswith("copy.csv: its 1200 samples are")


def test_what_differs_in_one_number_is_no_duplicate(measured):
    """An effort, a time, a sample more; of poses, the direction from which they were reached."""
    effort, time = measured.effort.copy(), measured.time.copy()
    effort[500, 3] += 1e-9
    time[-1] += 1e-9
    poses = replace(measured, time=None, direction=np.ones_like(effort))
    others = [
        replace(measured, effort=effort),
        replace(measured, time=time),
        measured.rows(slice(1199)),
        poses,
        replace(poses, direction=-poses.direction),
    ]
    for number, each in enumerate(others):
        assert not is_duplicate(each, [measured, *others[:number]])
        assert is_duplicate(replace(each, source="again"), others)


def test_a_motion_given_twice_is_observed_once(measured):
    (once,) = observe([measured], ARM)
    assert "duplicate_samples" not in {warning.kind for warning in once.warnings}
    (again,) = observe([measured, measured], ARM)
    assert [warning.kind for warning in again.warnings].count("duplicate_samples") == 1
    np.testing.assert_array_equal(again.effort, once.effort)
    np.testing.assert_array_equal(again.q, once.q)


def test_a_diagnosis_reads_a_recording_once(measured):
    once = load([measured], MODEL)
    again = load([measured, measured], MODEL)
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
