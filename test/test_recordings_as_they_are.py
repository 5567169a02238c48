"""What can be used of a recording is used, and what was left out is counted and reported once."""

from dataclasses import replace

import numpy as np
import pytest
from recording_samples import (
    ARM,
    START,
    joint_state,
    kinds,
    loaded,
    messages,
    same,
    through,
    warned,
    wave,
    write_messages,
)

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import JOINT_STATE, BagWriter, Recording, check, prepare

CLEAN = wave(1200)


# Values that are missing


def test_a_joint_s_missing_velocity_is_differentiated_and_the_others_are_kept(tmp_path):
    velocity = CLEAN.velocity.copy()
    velocity[:, 2] = np.nan
    found = loaded(tmp_path, messages(CLEAN, velocity=velocity))
    assert np.isnan(found.velocity[:, 2]).all()
    assert [warning.kind for warning in check(found)] == ["not_recorded"]
    exact = through(CLEAN).filtered.velocity
    np.testing.assert_allclose(through(found).filtered.velocity, exact, atol=5e-3)
    found.save(tmp_path / "a.csv")
    same(found.of(ARM), Recording.load(tmp_path / "a.csv", arm=ARM))


def test_a_sample_with_a_number_missing_is_left_out(tmp_path):
    values = CLEAN.effort.copy()
    values[[500, 800], [1, 6]] = np.nan, -np.inf
    found = loaded(tmp_path, messages(CLEAN, effort=values))
    assert ("not_finite", None, 2) in kinds(found)
    assert len(found) == 1198


def test_an_arm_s_joint_without_efforts_is_as_if_not_recorded(tmp_path):
    effort = CLEAN.effort.copy()
    effort[:, 6] = np.nan
    write_messages(tmp_path / "bag", messages(CLEAN, effort=effort))
    found = Recording.load(tmp_path / "bag", arm=ARM)
    assert found.joints == JOINT_NAMES[:6]
    assert ("not_recorded", "wrist_roll") in warned(found)
    assert Recording.load(tmp_path / "bag").of(ARM).joints == JOINT_NAMES[:6]


# Topics


def two_arms(path, topics, joints=(JOINT_NAMES, JOINT_NAMES)):
    with BagWriter(path) as bag:
        for k in range(30):
            for number, topic in enumerate(topics):
                size = len(joints[number])
                at, data = joint_state(k, joints[number], position=[number + 0.01 * k] * size)
                bag.write(topic, JOINT_STATE, data, at)


def test_of_the_topics_in_a_bag_the_arm_s_is_read_and_named(tmp_path):
    psm = Arm.load("psm").joint_names
    for number, (topics, joints, noted) in enumerate((
        (("/MTML/measured_js", "/MTMR/measured_js"), (JOINT_NAMES, JOINT_NAMES), 1),
        (("/MTML/joint_states", "/lab/mtmr/joint_states"), (JOINT_NAMES, JOINT_NAMES), 1),
        (("/joint_states", "/MTMR/measured_js"), (JOINT_NAMES, JOINT_NAMES), 0),  # of all arms
        (("/a", "/b"), (("x", "y"), JOINT_NAMES), 1),
    )):  # fmt: skip
        bag = tmp_path / f"{number}"
        two_arms(bag, topics, joints)
        found = Recording.load(bag, arm="mtmr")
        assert found.position[0, 0] == 1.0
        assert [note.kind for note in found.notes] == ["topic"] * noted
        assert Recording.load(bag, topic=topics[0]).position[0, 0] == 0.0
    two_arms(tmp_path / "psms", ("/PSM1/measured_js", "/PSM2/measured_js"), (psm, psm))
    with pytest.raises(RecordingError, match=r"/PSM1/measured_js: .* messages, .*PSM2.*--topic"):
        Recording.load(tmp_path / "psms", arm="psm")


def test_the_topic_whose_joints_move_is_named_where_those_that_were_read_stand_still(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for k in range(400):
            at, data = joint_state(k, position=[0.1] * 7)
            bag.write("/arm/joint_states", JOINT_STATE, data, at)
            bag.write("/arm/feedback", JOINT_STATE, joint_state(k, ("a", "b"))[1], at)
    (note,) = Recording.load(tmp_path / "bag", arm=ARM).notes
    assert note.text.endswith("move (a, b): --topic /arm/feedback")
    found = Recording.load(tmp_path / "bag", arm=ARM)
    assert "--topic /arm/feedback" in next(w.text for w in check(found) if w.unusable)


def test_a_topic_without_messages_is_refused_with_those_that_there_are_and_the_qos(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/joint_states", JOINT_STATE)
        bag.write("/other", "std_msgs/msg/Empty", b"\0\1\0\0", START)
    with pytest.raises(RecordingError, match=r"/joint_states 0, /other 1;.*--qos-profile.*best"):
        Recording.load(tmp_path / "bag", arm=ARM)


# Names


def test_a_common_prefix_of_joints_is_recognised_and_any_other_name_can_be_mapped(tmp_path):
    prefixed = replace(CLEAN, joints=tuple(f"arm_{name}" for name in JOINT_NAMES), arm=None)
    for path in (tmp_path / "a.csv", tmp_path / "bag"):
        prefixed.save(path)
        found = Recording.load(path, arm=ARM)
        assert found.joints == prefixed.of(ARM).joints == JOINT_NAMES
        np.testing.assert_allclose(found.effort, CLEAN.effort)
        assert [note.kind for note in found.notes] == ["columns"]
        given = ",".join(f"arm_{name}=b_{name}" for name in JOINT_NAMES)
        assert Recording.load(path, columns=given).joints[0] == "b_outer_yaw"
    odd = replace(CLEAN, joints=tuple("ABCDEFG"), arm=None)
    both = messages(prefixed) + messages(CLEAN, names=[f"left_{name}" for name in JOINT_NAMES])
    write_messages(tmp_path / "both", sorted(both))
    odd.save(tmp_path / "odd.csv")
    for path, name in ((tmp_path / "both", "arm_outer_yaw"), (tmp_path / "odd.csv", "A")):
        with pytest.raises(RecordingError, match=f"outer_yaw.*--columns '{name}=<joint>"):
            Recording.load(path, arm=ARM)
    mapped = dict(zip("ABCDEFG", JOINT_NAMES, strict=True))
    same(Recording.load(tmp_path / "odd.csv", arm=ARM, columns=mapped), CLEAN)


def test_efforts_that_are_renewed_more_slowly_are_interpolated_between_their_renewals(tmp_path):
    held = replace(CLEAN, effort=CLEAN.effort[np.arange(1200) // 4 * 4])
    for found in files_of(held, tmp_path):
        assert [note.kind for note in found.notes] == ["held_readings"]
        np.testing.assert_array_equal(found.effort[::4], CLEAN.effort[::4])
        assert np.abs(found.effort - CLEAN.effort)[:-3].max() < 5e-4  # of 2e-3


# Readings that no joint can have had


def files_of(recording, tmp_path):
    recording.save(tmp_path / "a.csv")
    recording.save(tmp_path / "b", "mcap")
    return [Recording.load(tmp_path / name, arm=ARM) for name in ("a.csv", "b")]


def test_a_channel_that_stalls_and_then_is_where_the_joint_is_loses_the_stall(tmp_path):
    position, velocity = CLEAN.position.copy(), CLEAN.velocity.copy()
    position[:, 6], velocity[:, 6] = 6.0 * position[:, 6], 6.0 * velocity[:, 6]  # up to 9 rad/s
    start = 300 + int(np.argmax(np.abs(velocity[300:900, 6])))
    position[start : start + 7, 6] = position[start, 6]
    given = replace(CLEAN, position=position, velocity=velocity)
    assert abs(position[start + 7, 6] - position[start, 6]) > 0.3
    with pytest.raises(RecordingError, match="wrist_roll: position goes from"):
        prepare(given)
    for found in files_of(given, tmp_path):
        assert len(found) == 1194
        assert ("impossible_readings", "wrist_roll", 6) in kinds(found)
        assert not any(warning.unusable for warning in check(found))
