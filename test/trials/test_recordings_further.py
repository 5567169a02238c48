"""Second publishers, readings that jump, and angles that wrap, of many kinds."""

from dataclasses import replace

import numpy as np
import pytest
from recording_samples import ARM, START, kinds, loaded, messages, warned, wave, write_messages
from support import MODEL_FILE

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.command_line import run
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import Recording, check

CLEAN = wave(1200)


# Publishers


def second(rate, seconds=0.0, old=0.0, names=None, **columns):
    """Return messages of another node at a rate, with positions some seconds old."""
    at = np.arange(0.0221, 5.9, 1.0 / rate)
    rows = np.round((at - old) * 200.0).astype(int)
    given = replace(CLEAN, time=None).rows(rows)
    stamps = START + np.round((at + seconds) * 1e9).astype(np.int64)
    return messages(replace(given, time=at), stamps, names, **columns)


@pytest.mark.parametrize("other", [
    second(190, effort=np.zeros((1200, 7))), second(20, effort=np.zeros((1200, 7))),
    second(100, velocity=np.zeros((1200, 7))), second(100, velocity=None, effort=None),
    second(400, effort=None), second(20, old=0.01), second(187, old=0.005),
    second(200, seconds=-47.7), second(30, seconds=1.5),
    second(130, names=JOINT_NAMES[::-1]), second(100, effort=0.5 * CLEAN.effort),
])  # fmt: skip
def test_the_messages_of_a_second_publisher_are_left_out_and_counted(tmp_path, other):
    found = loaded(tmp_path, sorted(messages(CLEAN) + other))
    np.testing.assert_array_equal(found.effort, CLEAN.effort)
    np.testing.assert_array_equal(found.position, CLEAN.position)
    assert sum(note.left_out for note in found.notes) == len(other)
    assert {note.kind for note in found.notes} <= {"second_publisher", "other_messages"}


@pytest.mark.parametrize("late", [0.0, 1e-3, 2.5e-3])
def test_two_publishers_in_step_with_efforts_of_their_own_are_refused_not_averaged(tmp_path, late):
    other = messages(replace(CLEAN, time=CLEAN.time + late), effort=0.5 * CLEAN.effort)
    with pytest.raises(RecordingError, match=r"efforts of .* differ between two publishers"):
        loaded(tmp_path, sorted(messages(CLEAN) + other))


def test_late_messages_pairs_and_jitter_are_one_publisher_s(tmp_path):
    rng = np.random.default_rng(0)
    late = [(at + 12_000_000 * int(rng.random() < 0.1), data) for at, data in messages(CLEAN)]
    pairs = [(at - 5_000_000 * (k % 2), data) for k, (at, data) in enumerate(messages(CLEAN))]
    jitter = START + np.round(1e9 * CLEAN.time + 1e6 * rng.normal(size=1200)).astype(np.int64)
    for number, sent in enumerate((sorted(late), sorted(pairs), messages(CLEAN, stamps=jitter))):
        write_messages(tmp_path / f"{number}", sent)
        for base in ("stamp", "receive"):
            found = Recording.load(tmp_path / f"{number}", arm=ARM, time_base=base)
            assert "second_publisher" not in {note.kind for note in found.notes}


# Times


def test_times_that_stand_still_are_refused_with_the_option_that_every_verb_has(tmp_path, capsys):
    write_messages(tmp_path / "bag", messages(CLEAN, stamps=np.full(1200, START)))
    bag, out = str(tmp_path / "bag"), ["--out", str(tmp_path / "x.yaml")]
    model = ["--model", str(MODEL_FILE)]
    for verb, words in (
        ("identify", ["--arm", "mtmr", *out]), ("diagnose", model + out), ("evaluate", model)
    ):  # fmt: skip
        assert run(f"dvrk_gravity.cli.{verb}", [bag, *words]) == 2
        assert "--time-base receive" in capsys.readouterr().err
    found = Recording.load(bag, time_base="receive")
    np.testing.assert_allclose(found.time, CLEAN.time, atol=1e-9)


def shifted(rows, seconds):
    time = START + np.round(CLEAN.time * 1e9).astype(np.int64)
    time[rows] += round(seconds * 1e9)
    return time


@pytest.mark.parametrize(
    ("rows", "seconds"),
    [((600, 605), -2.0), ((600, 605), 100.0), ((1199, 1200), -1.0), ((0, 2), 50.0)],
)
def test_stamps_out_of_order_for_a_moment_are_left_out(tmp_path, rows, seconds):
    found = loaded(tmp_path, messages(CLEAN, stamps=shifted(slice(*rows), seconds)))
    left = rows[1] - rows[0]
    assert len(found) == 1200 - left
    assert found.time[-1] - found.time[0] < 6.1
    assert ("stamps_back", None, left) in kinds(found)


# Readings that no joint can have had


def moved(column, change):
    position = CLEAN.position.copy()
    position[:, column] = change(position[:, column].copy())
    return replace(CLEAN, position=position)


def files_of(recording, tmp_path):
    recording.save(tmp_path / "a.csv")
    recording.save(tmp_path / "b", "mcap")
    return [Recording.load(tmp_path / name, arm=ARM) for name in ("a.csv", "b")]


@pytest.mark.parametrize(
    ("rows", "to"),
    [([600], 3.0), (range(600, 612), 0.9), ([0, 1], -4.0), ([1199], 100.0), ([600, 640], 5.0)],
)
def test_readings_that_jump_away_and_back_are_left_out(tmp_path, rows, to):
    given = moved(2, lambda values: np.where(np.isin(np.arange(1200), rows), to, values))
    for found in files_of(given, tmp_path):
        assert len(found) == 1200 - len(rows)
        assert ("impossible_readings", "elbow_pitch", len(rows)) in kinds(found)
        assert not any(warning.unusable for warning in check(found))


def test_an_effort_far_beyond_the_motor_s_for_a_moment_is_left_out(tmp_path):
    effort = CLEAN.effort.copy()
    effort[700:703, 0] = 5e5
    for found in files_of(replace(CLEAN, effort=effort), tmp_path):
        assert ("impossible_readings", "outer_yaw", 3) in kinds(found)
        assert check(found)[-1].kind != "effort_unit"
    (tmp_path / "unit").mkdir()
    wrong = replace(CLEAN, effort=1e6 * CLEAN.effort)  # for long, it is another unit
    for found in files_of(wrong, tmp_path / "unit"):
        assert any(warning.kind == "effort_unit" for warning in check(found))


@pytest.mark.parametrize("row", [30, 600, 1177])
def test_a_jump_that_stays_is_unusable(tmp_path, row):
    """Also near an end: what is on either side lasts longer than readings may be away."""
    given = moved(2, lambda values: values - 0.4 * (np.arange(1200) >= row))
    for found in files_of(given, tmp_path):
        assert [warning.kind for warning in check(found) if warning.unusable] == ["position_jump"]


def wrapped(values, low=-np.pi):
    return (values - low) % (2.0 * np.pi) + low


@pytest.mark.parametrize(("low", "samples"), [(-np.pi, 1200), (0.0, 4500)])
def test_an_angle_that_wraps_at_a_turn_is_read_as_going_on(tmp_path, low, samples):
    clean = wave(samples)
    position, velocity = clean.position.copy(), clean.velocity.copy()
    position[:, 6], velocity[:, 6] = 6.0 * position[:, 6], 6.0 * velocity[:, 6]
    turned = position.copy()
    turned[:, 6] = wrapped(turned[:, 6], low)
    found = files_of(replace(clean, position=turned, velocity=velocity), tmp_path)
    for recording in found:
        off = recording.position[:, 6] - position[:, 6]
        np.testing.assert_allclose(off, off[0], atol=1e-9)
        assert ("wrapped", "wrist_roll") in warned(recording)
        assert len(recording) == samples


def test_a_turn_that_is_none_is_not_unwrapped(tmp_path):
    steps = 1.9 * np.pi * (np.arange(1200) >= 600)
    given = replace(moved(6, lambda values: values - 3.0 + steps), velocity=None)
    for found in files_of(given, tmp_path):  # not at the ends of a range of one turn
        assert any(warning.kind == "position_jump" for warning in check(found))
    (tmp_path / "c").mkdir()
    elbow = moved(2, lambda values: wrapped(values + np.pi))  # of which the elbow can do none
    for found in files_of(elbow, tmp_path / "c"):
        assert any(warning.unusable for warning in check(found))
