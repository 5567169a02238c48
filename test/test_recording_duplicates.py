"""The same data given twice counts once: duplicate samples are recognised and left out."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from known_mtm import ARM, truth

from dvrk_gravity import TorqueModel
from dvrk_gravity.diagnosis import load
from dvrk_gravity.intake import read_motions
from dvrk_gravity.recording import Duplicates, Recording, RecordingFile, without_duplicates


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


def remaining(recordings: list[Recording], size: int) -> list[int]:
    """Return how many samples of each remain, read in parts of a size."""
    before = Duplicates()
    return [
        sum(len(part) for part in before.fresh(recording.parts(size))) for recording in recordings
    ]


@pytest.mark.parametrize("size", [70, 333, 1000, 60_000])
def test_what_was_read_before_is_left_out_whatever_the_parts(measured, other, size):
    assert remaining([measured, other, measured], size) == [1200, 1200, 0]
    assert remaining([appended(measured, measured)], size) == [1200]
    assert remaining([appended(measured, other, measured)], size) == [2400]
    assert remaining([measured.between(0.0, 8.0), measured.between(5.0, 12.0)], size) == [800, 400]
    assert remaining([appended(other.between(0.0, 3.0), measured), measured], size) == [1500, 0]


def test_what_is_left_is_what_was_not_read_before_in_order(measured, other):
    before = Duplicates()
    list(before.fresh(measured.between(2.0, 6.0).parts(500)))
    parts = list(before.fresh(appended(measured, other).parts(500)))
    position = np.concatenate([part.position for part in parts])
    expected = np.concatenate([measured.position[:200], measured.position[600:], other.position])
    np.testing.assert_array_equal(position, expected)
    assert before.number == 400


def test_less_than_a_second_is_no_repetition(measured, other):
    for until, left in ((3.9, 1290), (4.1, 1200)):
        again = appended(other, measured.between(3.0, until))
        assert remaining([measured, again], 500)[1] == left


def test_stale_samples_and_rest_are_no_duplicates(measured):
    """The same where nothing moves, and readings that were renewed every fifth time only."""

    def again(rows: np.ndarray) -> Recording:
        return replace(replace(measured, time=None).rows(rows), time=np.arange(len(rows)) / 100.0)

    hold = again(np.repeat([50], 400))
    rest = appended(hold, measured, hold)
    assert remaining([rest], 500) == [2000]
    stale = again(np.repeat(np.arange(0, 1200, 5), 5))
    assert remaining([stale], 500) == [1200]
    assert remaining([rest, rest], 60_000) == [2000, 0]  # with what moves on either side they were
    assert remaining([stale, stale], 500) == [1200, 0]


def test_a_motion_that_repeats_with_noise_loses_no_sample(measured):
    random = np.random.default_rng(0)

    def noisy(values: np.ndarray) -> np.ndarray:
        return np.round(values + 1e-3 * random.normal(size=values.shape), 4)

    again = [
        replace(measured, position=noisy(measured.position), effort=noisy(measured.effort))
        for _ in range(2)
    ]
    assert remaining([appended(*again)], 500) == [2400]


def test_files_are_recognised_under_any_name_and_read_in_parts(measured, other, tmp_path):
    first, second, more = (tmp_path / f"{name}.csv" for name in ("run", "copy", "more"))
    appended(measured, other).save(first)
    shutil.copy(first, second)
    kept, lines, warnings = without_duplicates([RecordingFile(first), RecordingFile(second)])
    assert [len(file.load()) for file in kept] == [2400]
    assert len(lines) == 1
    assert lines[0].startswith(f"{second}: 2400 of 2400 samples")
    assert [(warning.kind, warning.numbers["samples"]) for warning in warnings] == [
        ("duplicate_samples", 2400)
    ]
    appended(truth(3, 12.0), measured).save(more)
    kept, lines, _ = without_duplicates([RecordingFile(first), RecordingFile(more)])
    assert [len(file.load()) for file in kept] == [2400, 1200]
    assert len(kept[1].head) == 1200
    assert "1200 of 2400 samples" in lines[0]


def test_poses_that_repeat_exactly_count_once():
    random = np.random.default_rng(0)
    poses, more = (
        Recording(ARM.joint_names, None, random.normal(size=(40, 7)), None,
                  random.normal(size=(40, 7)), np.ones((40, 7)))
        for _ in range(2)
    )  # fmt: skip
    shuffled = poses.rows(random.permutation(40))
    kept, _, warnings = without_duplicates([poses, shuffled, more])
    assert all(kept[k].position is given.position for k, given in enumerate((poses, more)))
    assert [warning.numbers["samples"] for warning in warnings] == [40]
    # From the other direction it is another pose.
    turned = replace(poses, direction=-poses.direction)
    assert remaining([poses, turned], 60_000) == [40, 40]
    assert remaining([poses.rows([0, 1, 1, 2, 0])], 60_000) == [3]


def test_a_motion_given_twice_or_appended_to_itself_is_read_once(measured, other):
    once = read_motions([measured], ARM, "joint")
    for given in ([measured, measured], [appended(measured, measured)]):
        again = read_motions(given, ARM, "joint")
        assert [warning.kind for warning in again.warnings].count("duplicate_samples") == 1
        assert len(again.parts) == len(once.parts) == 1
        np.testing.assert_allclose(again.parts[0].effort, once.parts[0].effort, atol=1e-9)
        np.testing.assert_allclose(again.parts[0].state.q, once.parts[0].state.q, atol=1e-9)
    assert not [warning for warning in once.warnings if warning.kind == "duplicate_samples"]
    # The rest is too short for the filter.
    rest = read_motions([measured, appended(measured, other.between(0.0, 0.3))], ARM, "joint")
    assert len(rest.parts) == 1
    assert any("1200 of 1230 samples" in line for line in rest.handling)


def test_a_diagnosis_reads_a_recording_once(measured):
    model = TorqueModel.from_parameters({"arm": "mtmr", "beta": (0.1,) * 10})
    once = load([measured], model)
    for given in ([measured, measured], [appended(measured, measured)]):
        again = load(given, model)
        assert len(again.motion.q) == len(once.motion.q)
        assert [warning.kind for warning in again.warnings].count("duplicate_samples") == 1
