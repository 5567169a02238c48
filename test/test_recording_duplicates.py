"""The same data given twice counts once: duplicate samples are recognised and left out."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest
from known_mtm import ARM, truth
from recording_samples import shared_data

from dvrk_gravity import TorqueModel, diagnose, identify
from dvrk_gravity.identification import Verdict
from dvrk_gravity.identification.poses import fit as static_fit
from dvrk_gravity.recording import (
    DataWarning,
    Duplicates,
    Recording,
    RecordingFile,
    without_duplicates,
)
from testing.world import COARSE, World

pytestmark = pytest.mark.usefixtures("four_folds")

FEW = ["coulomb_friction", "viscous_friction"]
KNOWN = World.draw(5, step=COARSE)


@pytest.fixture(scope="module")
def measured() -> Recording:
    """12 s of a simulated motion with noise."""
    return replace(truth(1, 12.0), source="one.csv")


def appended(*recordings: Recording) -> Recording:
    """Return recordings one after the other as one, as if they had been taken so."""
    time, last = [], -0.01
    for recording in recordings:
        assert recording.time is not None
        time.append(recording.time - recording.time[0] + last + 0.01)
        last = time[-1][-1]

    def column(name: str) -> np.ndarray:
        return np.concatenate([getattr(recording, name) for recording in recordings])

    return replace(
        recordings[0],
        time=np.concatenate(time),
        position=column("position"),
        velocity=column("velocity"),
        effort=column("effort"),
    )


def remaining(recordings: list[Recording], size: int) -> list[int]:
    """Return how many samples of each remain, read in parts of a size."""
    before = Duplicates()
    return [
        sum(len(part) for part in before.fresh(recording.parts(size))) for recording in recordings
    ]


@pytest.mark.parametrize("size", [70, 333, 1000, 60_000])
def test_what_was_read_before_is_left_out_whatever_the_parts(measured, size):
    other = truth(2, 12.0)
    assert remaining([measured, other, measured], size) == [1200, 1200, 0]
    assert remaining([appended(measured, measured)], size) == [1200]
    assert remaining([appended(measured, other, measured)], size) == [2400]
    assert remaining([measured.between(0.0, 8.0), measured.between(5.0, 12.0)], size) == [800, 400]
    assert remaining([appended(other.between(0.0, 3.0), measured), measured], size) == [1500, 0]


def test_what_is_left_is_what_was_not_read_before_in_order(measured):
    before, other = Duplicates(), truth(2, 12.0)
    list(before.fresh(measured.between(2.0, 6.0).parts(500)))
    parts = list(before.fresh(appended(measured, other).parts(500)))
    position = np.concatenate([part.position for part in parts])
    expected = np.concatenate([measured.position[:200], measured.position[600:], other.position])
    np.testing.assert_array_equal(position, expected)
    assert sum(stop - start for start, stop in before.left_out) == 400


def test_samples_that_were_left_out_in_reading_are_counted_once_still(measured):
    given = replace(measured, invalid=3, repeated=5)
    for size in (70, 1000):
        parts = list(Duplicates().fresh(given.parts(size)))
        assert sum(part.invalid for part in parts) == 3
        assert sum(part.repeated for part in parts) == 5


def test_less_than_a_second_is_no_repetition(measured):
    assert (
        remaining([measured, appended(truth(2, 12.0), measured.between(3.0, 3.9))], 500)[1] == 1290
    )
    assert (
        remaining([measured, appended(truth(2, 12.0), measured.between(3.0, 4.1))], 500)[1] == 1200
    )


def test_stale_samples_and_rest_are_not_read_before(measured):
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


def test_a_measured_motion_that_repeats_loses_no_sample():
    measured = Recording.load(shared_data("mtm_dynamic_30s_200hz.csv"))
    assert remaining([measured], 1000) == [len(measured)]


def test_a_simulated_motion_that_repeats_with_noise_loses_no_sample(measured):
    random = np.random.default_rng(0)

    def noisy(values: np.ndarray) -> np.ndarray:
        return np.round(values + 1e-3 * random.normal(size=values.shape), 4)

    again = [
        replace(measured, position=noisy(measured.position), effort=noisy(measured.effort))
        for _ in range(2)
    ]
    assert remaining([appended(*again)], 500) == [2400]


def test_files_are_recognised_under_any_name_and_read_in_parts(measured, tmp_path):
    first, second = tmp_path / "run.csv", tmp_path / "copy.csv"
    appended(measured, truth(2, 12.0)).save(first)
    shutil.copy(first, second)
    kept, lines, warnings = without_duplicates([RecordingFile(first), RecordingFile(second)])
    assert [len(file.load()) for file in kept] == [2400]
    assert lines == (
        f"{second}: 2400 of 2400 samples are exact duplicates of earlier samples, and count "
        "once; it is skipped",
    )
    assert [(warning.kind, warning.numbers["samples"]) for warning in warnings] == [
        ("duplicate_samples", 2400)
    ]
    more = tmp_path / "more.csv"
    appended(truth(3, 12.0), measured).save(more)
    kept, lines, _ = without_duplicates([RecordingFile(first), RecordingFile(more)])
    assert [len(file.load()) for file in kept] == [2400, 1200]
    assert len(kept[1].head) == 1200
    assert "1200 of 2400 samples are exact duplicates" in lines[0]


def test_identifying_from_the_same_recording_twice_is_identifying_once(measured):
    once, twice = (identify(given, ARM, "joint", FEW) for given in (measured, [measured] * 2))
    assert [p.value for p in twice.parameters] == [p.value for p in once.parameters]
    assert [p.ci95 for p in twice.parameters] == [p.ci95 for p in once.parameters]
    assert twice.held_out == once.held_out
    (line,) = [line for line in twice.handling if "earlier samples" in line]
    assert line.startswith("one.csv: 1200 of 1200 samples are exact duplicates of earlier samples")
    assert [warning.kind for warning in twice.warnings].count("duplicate_samples") == 1
    assert not [warning for warning in once.warnings if warning.kind == "duplicate_samples"]


def test_a_recording_appended_to_itself_is_identified_as_it_is_once(measured, tmp_path):
    appended(measured, measured).save(tmp_path / "double.csv")
    measured.save(tmp_path / "single.csv")
    once, double = (
        identify(tmp_path / f"{name}.csv", ARM, "joint", FEW) for name in ("single", "double")
    )
    values = [[p.value for p in fit.parameters] for fit in (once, double)]
    np.testing.assert_allclose(values[1], values[0], rtol=1e-9, atol=1e-12)


def test_a_rest_too_short_for_the_filter_is_told_and_left_out(measured):
    fit = identify([measured, appended(measured, truth(2, 0.3))], ARM, "joint", FEW)
    (line,) = [line for line in fit.handling if "earlier samples" in line]
    assert "1200 of 1230 samples" in line
    assert "the other 0.3 s are too short to be used" in line


def test_coordinates_stay_with_their_recordings_where_one_is_skipped(measured):
    other = truth(2, 12.0)
    motor = replace(
        other,
        position=ARM.actuator_position(other.position),
        velocity=ARM.actuator_position(other.velocity),
        effort=ARM.actuator_effort(other.effort),
    )
    two = identify([measured, motor], ARM, ["joint", "actuator"], FEW)
    three = identify([measured, measured, motor], ARM, ["joint", "joint", "actuator"], FEW)
    assert two.held_out == three.held_out


def test_poses_that_repeat_exactly_count_once(monkeypatch):
    poses = KNOWN.record_poses(1, 2, 40)
    order = np.random.default_rng(0).permutation(len(poses))
    shuffled = poses.rows(order)
    more = KNOWN.record_poses(3, 4, 40)
    fitted = []

    def fit_static(given, *others):
        fitted.append(given)
        return Stub()

    monkeypatch.setattr(static_fit, "fit_static", fit_static)
    fit = identify([poses, shuffled, more], KNOWN.arm, "joint")
    ((first, second),) = fitted
    np.testing.assert_array_equal(first.position, poses.position)
    np.testing.assert_array_equal(second.position, more.position)
    assert "40 of 40 samples are exact duplicates" in fit.handling[0]
    assert [warning.kind for warning in fit.warnings] == ["duplicate_samples", "other_hand"]
    # From the other direction it is another pose.
    assert poses.direction is not None
    turned = replace(poses, direction=-poses.direction)
    assert remaining([poses, turned], 60_000) == [len(poses), len(poses)]
    assert remaining([poses.rows([0, 1, 1, 2, 0])], 60_000) == [3]


EMPTY = TorqueModel(ARM, ())
EARNED = Verdict("good", "", "", {})


@dataclass(frozen=True)
class Stub:
    """What identification says beside a fit."""

    model: TorqueModel = EMPTY
    handling: tuple[str, ...] = ()
    warnings: tuple[DataWarning, ...] = (DataWarning("other_hand", None, {}, "known already"),)
    verdict: Verdict = EARNED


@pytest.fixture(scope="module")
def motion() -> Recording:
    """10 s of an arm whose model is known."""
    return KNOWN.record(3, 4, 10.0, 100.0)


def test_diagnosing_the_same_twice_or_appended_to_itself_is_diagnosing_once(motion):
    once = diagnose(motion, KNOWN.model())
    late = replace(motion, time=motion.time + motion.time[-1] + 0.01)
    double = replace(
        motion,
        time=np.concatenate([motion.time, late.time]),
        position=np.tile(motion.position, (2, 1)),
        velocity=np.tile(motion.velocity, (2, 1)),
        effort=np.tile(motion.effort, (2, 1)),
    )
    for given in ([motion, motion], double):
        again = diagnose(given, KNOWN.model())
        assert again.verdict == once.verdict
        assert again.floor_from == once.floor_from
        assert again.after == pytest.approx(once.after, rel=1e-9)
        assert again.floor == pytest.approx(once.floor, rel=1e-9)
        assert [warning.kind for warning in again.warnings].count("duplicate_samples") == 1


def test_what_is_left_out_of_what_was_left_out_is_the_same_of_a_file_as_in_memory(
    measured, tmp_path
):
    measured.save(tmp_path / "run.csv")
    in_memory, file = Recording.load(tmp_path / "run.csv"), RecordingFile(tmp_path / "run.csv")
    for spans in ([(0, 100)], [(50, 60), (200, 300)]):
        in_memory, file = in_memory.without(spans), file.without(spans)
    np.testing.assert_array_equal(file.load().time, in_memory.time)
    np.testing.assert_array_equal(file.head.position, in_memory.position)
