"""What can be used of a recording is used, and what was left out is counted and reported once."""

import bz2
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_samples import ARM, START, TOPIC, joint_state, same, wave, write_messages
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.command_line import run
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.recording import (
    JOINT_STATE,
    BagReader,
    BagWriter,
    Recording,
    RecordingFile,
    check,
    encode_joint_state,
    prepare,
    read_trajectory,
)

CLEAN = wave(1200)


def messages(recording, stamps=None, names=None, **columns):
    """Return a recording's messages, with other stamps, names or numbers."""
    fields = {q: getattr(recording, q) for q in ("position", "velocity", "effort")} | columns
    received = START + np.round(recording.time * 1e9).astype(np.int64)
    stamps = received if stamps is None else stamps
    return [
        (
            int(at) + 300_000,
            encode_joint_state(
                int(stamp),
                names or recording.joints,
                *(() if values is None else values[k].tolist() for values in fields.values()),
            ),
        )
        for k, (at, stamp) in enumerate(zip(received, stamps, strict=True))
    ]


def kinds(recording):
    return {(note.kind, note.joint, note.count) for note in recording.found}


def said(recording):
    return " ".join(str(warning) for warning in check(recording))


def loaded(tmp_path, sent, storage="sqlite3", **options):
    write_messages(tmp_path / "bag", sent, storage)
    return Recording.load(tmp_path / "bag", **({"arm": ARM} | options))


# Values that are missing


@pytest.mark.parametrize("empty", [np.nan, np.inf, 1e300])
def test_velocities_that_are_no_numbers_are_as_if_not_sent(tmp_path, empty):
    found = loaded(tmp_path, messages(CLEAN, velocity=np.full((1200, 7), empty)))
    assert found.velocity is None
    assert said(found).count("velocity of all joints was not recorded") == 1
    np.testing.assert_array_equal(found.position, CLEAN.position)


def test_a_joint_s_missing_velocity_is_differentiated_and_the_others_are_kept(tmp_path):
    velocity = CLEAN.velocity.copy()
    velocity[:, 2] = np.nan
    found = loaded(tmp_path, messages(CLEAN, velocity=velocity))
    assert np.isnan(found.velocity[:, 2]).all()
    assert said(found).count("velocity of elbow_pitch was not recorded") == 1
    ready = prepare(found)
    assert "velocity differentiated from position: elbow_pitch" in ready.handling
    (segment,) = ready.segments
    exact = prepare(CLEAN).segments[0].recording.velocity
    np.testing.assert_allclose(segment.recording.velocity, exact, atol=5e-3)
    streamed, clean = (read_trajectory(given.parts(500)) for given in (found, CLEAN))
    np.testing.assert_allclose(
        streamed.stretches[0].velocity, clean.stretches[0].velocity, atol=2e-2
    )
    found.save(tmp_path / "a.csv")
    same(found.of(ARM), Recording.load(tmp_path / "a.csv", arm=ARM))


@pytest.mark.parametrize("quantity", ["position", "velocity", "effort"])
def test_a_sample_with_a_number_missing_is_left_out(tmp_path, quantity):
    values = getattr(CLEAN, quantity).copy()
    values[[500, 800], [1, 6]] = np.nan, -np.inf
    found = loaded(tmp_path, messages(CLEAN, **{quantity: values}))
    assert ("not_finite", None, 2) in kinds(found)
    assert len(found) == 1198
    assert "2 of 1200 samples with a value missing or not finite, left out" in said(found)


def with_wheel(recording, **of_wheel):
    fields = {}
    for quantity in ("position", "velocity", "effort"):
        column = np.full((len(recording), 1), of_wheel.get(quantity, 0.5))
        fields[quantity] = np.hstack([column, getattr(recording, quantity)])
    return messages(recording, names=("wheel", *recording.joints), **fields)


@pytest.mark.parametrize("missing", ["velocity", "effort", "position"])
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_joints_that_are_not_the_arm_s_are_ignored_by_every_verb(
    tmp_path, capsys, missing, storage
):
    write_messages(tmp_path / "bag", with_wheel(CLEAN, **{missing: np.nan}), storage)
    bag = str(tmp_path / "bag")
    found = Recording.load(bag, arm=ARM)
    np.testing.assert_array_equal(found.effort, CLEAN.effort)
    assert found.notes == ()
    model = str(Path(__file__).parents[1] / "config/mtmr_28002.yaml")
    # Read; that this model is not to be compensated with is the answer.
    assert run("dvrk_gravity.cli.evaluate", [bag, "--model", model]) == 1
    assert run("dvrk_gravity.cli.convert", [bag, str(tmp_path / "a.csv")]) == 0
    assert "1200 samples" in capsys.readouterr().out
    same(replace(Recording.load(tmp_path / "a.csv", arm=ARM), start_ns=START), found)


def test_an_arm_s_joint_without_efforts_is_as_if_not_recorded(tmp_path):
    effort = CLEAN.effort.copy()
    effort[:, 6] = np.nan
    write_messages(tmp_path / "bag", messages(CLEAN, effort=effort))
    found = Recording.load(tmp_path / "bag", arm=ARM)
    assert found.joints == JOINT_NAMES[:6]
    assert "wrist_roll: not read: no effort was recorded" in said(found)
    assert Recording.load(tmp_path / "bag").of(ARM).joints == JOINT_NAMES[:6]


def test_messages_of_another_publisher_on_the_topic_are_left_out(tmp_path):
    sent = messages(CLEAN)
    others = [joint_state(5 * k + 2, ("finger",)) for k in range(1200)]
    mixed = [message for pair in zip(others, sent, strict=True) for message in pair]
    found = loaded(tmp_path, mixed)
    np.testing.assert_array_equal(found.position, CLEAN.position)
    assert ("other_messages", None, 1200) in kinds(found)


# Topics


def two_arms(path, topics, joints=(JOINT_NAMES, JOINT_NAMES)):
    with BagWriter(path) as bag:
        for k in range(300):
            for number, topic in enumerate(topics):
                size = len(joints[number])
                at, data = joint_state(k, joints[number], position=[number + 0.01 * k] * size)
                bag.write(topic, JOINT_STATE, data, at)


@pytest.mark.parametrize(
    "topics",
    [("/MTML/measured_js", "/MTMR/measured_js"), ("/dvrk/MTML/state_joint_current",
     "/dvrk/MTMR/state_joint_current"), ("/MTML/joint_states", "/lab/mtmr/joint_states")],
)  # fmt: skip
def test_of_two_arms_in_a_bag_the_one_that_is_named_is_read_and_said(tmp_path, topics):
    two_arms(tmp_path / "bag", topics)
    found = Recording.load(tmp_path / "bag", arm="mtmr")
    assert found.position[0, 0] == 1.0
    assert f"read {topics[1]}, the one of arm mtmr, and not {topics[0]}" in said(found)
    assert Recording.load(tmp_path / "bag", arm="mtmr", topic=topics[0]).position[0, 0] == 0.0


def test_what_draws_all_arms_together_is_not_an_arm_s_readings(tmp_path):
    two_arms(tmp_path / "bag", ("/joint_states", "/MTMR/measured_js"))
    found = Recording.load(tmp_path / "bag", arm="mtmr")
    assert (found.position[0, 0], found.notes) == (1.0, ())


def test_of_two_topics_the_one_with_the_arm_s_joints_is_read(tmp_path):
    two_arms(tmp_path / "bag", ("/a", "/b"), (("x", "y"), JOINT_NAMES))
    assert Recording.load(tmp_path / "bag", arm="mtmr").joints == JOINT_NAMES


def test_of_several_arms_alike_one_is_to_be_named(tmp_path, capsys):
    psm = Arm.load("psm").joint_names
    two_arms(tmp_path / "bag", ("/PSM1/measured_js", "/PSM2/measured_js"), (psm, psm))
    words = [str(tmp_path / "bag"), "--arm", "psm", "--out", str(tmp_path / "m.yaml")]
    assert run("dvrk_gravity.cli.identify", words) == 2
    told = capsys.readouterr().err
    assert "/PSM1/measured_js, /PSM2/measured_js" in told
    assert "(--topic)" in told
    two_arms(tmp_path / "other", ("/PSM1/measured_js", "/ECM/measured_js"), (psm, psm[:4]))
    assert Recording.load(tmp_path / "other", arm="psm").joints == psm


# Times


@pytest.mark.parametrize("stamp", [0, START])
def test_times_that_stand_still_are_refused_with_the_way_out_which_every_verb_has(
    tmp_path, capsys, stamp
):
    write_messages(tmp_path / "bag", messages(CLEAN, stamps=np.full(1200, stamp)))
    bag = str(tmp_path / "bag")
    with pytest.raises(RecordingError, match="--time-base receive"):
        Recording.load(bag)
    found = Recording.load(bag, time_base="receive")
    np.testing.assert_allclose(found.time, CLEAN.time, atol=1e-9)
    receive = ["--time-base", "receive"]
    model = ["--model", str(Path(__file__).parents[1] / "config/mtmr_28002.yaml")]
    assert run("dvrk_gravity.cli.convert", [bag, str(tmp_path / "a.csv"), *receive]) == 0
    # Read; that this model is not to be compensated with is the answer.
    assert run("dvrk_gravity.cli.evaluate", [bag, *model, *receive]) == 1
    for verb, words in (("identify", ["--arm", "mtmr"]), ("diagnose", model), ("evaluate", model)):
        assert run(f"dvrk_gravity.cli.{verb}", [bag, *words, *(
            [] if verb == "evaluate" else ["--out", str(tmp_path / "x.yaml")])]) == 2  # fmt: skip
        assert "--time-base receive" in capsys.readouterr().err


def test_single_samples_without_a_stamp_are_invalid_by_either_time(tmp_path):
    stamps = START + np.round(CLEAN.time * 1e9).astype(np.int64)
    stamps[[0, 7, 300]] = 0
    write_messages(tmp_path / "bag", messages(CLEAN, stamps=stamps))
    for base in ("stamp", "receive"):
        found = Recording.load(tmp_path / "bag", time_base=base)
        assert (found.invalid, len(found)) == (3, 1197)


def shifted(rows, seconds):
    time = START + np.round(CLEAN.time * 1e9).astype(np.int64)
    time[rows] += round(seconds * 1e9)
    return time


@pytest.mark.parametrize(
    ("stamps", "left"),
    [
        (shifted(slice(600, 605), -2.0), 5),  # late for a moment
        (shifted(slice(600, 605), 100.0), 5),  # ahead for one
        (shifted(slice(1199, 1200), -1.0), 1),
        (shifted(slice(0, 2), 50.0), 2),
        (shifted(slice(3950, 3951), 0.0), 0),
    ],
)
def test_stamps_out_of_order_for_a_moment_are_left_out(tmp_path, stamps, left):
    found = loaded(tmp_path, messages(CLEAN, stamps=stamps))
    assert len(found) == 1200 - left
    assert found.time[-1] - found.time[0] < 6.1
    assert not left or ("stamps_back", None, left) in kinds(found)


def test_a_clock_that_was_set_back_is_refused_with_the_way_out(tmp_path):
    write_messages(tmp_path / "bag", messages(CLEAN, stamps=shifted(slice(600, None), -3600.0)))
    with pytest.raises(RecordingError, match=r"message 600: time goes back by .* and stays there"):
        Recording.load(tmp_path / "bag")
    assert len(Recording.load(tmp_path / "bag", time_base="receive")) == 1200


# Readings that no joint can have had


def moved(column, change):
    position = CLEAN.position.copy()
    position[:, column] = change(position[:, column].copy())
    return replace(CLEAN, position=position)


def stalls(values, first=600, count=6):
    values[first : first + count] = values[first]
    return values


def fast(values):
    return 6.0 * values  # up to 9 rad/s


def away(values, rows, to):
    values[rows] = to
    return values


def files_of(recording, tmp_path):
    recording.save(tmp_path / "a.csv")
    recording.save(tmp_path / "b", "mcap")
    return [Recording.load(tmp_path / name, arm=ARM) for name in ("a.csv", "b")]


def test_a_channel_that_stalls_and_then_is_where_the_joint_is_loses_the_stall(tmp_path):
    position, velocity = CLEAN.position.copy(), CLEAN.velocity.copy()
    position[:, 6], velocity[:, 6] = fast(position[:, 6]), fast(velocity[:, 6])
    start = int(np.argmax(np.abs(velocity[:600, 6])))
    position[:, 6] = stalls(position[:, 6], start, 7)
    given = replace(CLEAN, position=position, velocity=velocity)
    assert abs(position[start + 7, 6] - position[start, 6]) > 0.3
    with pytest.raises(RecordingError, match="position goes from"):
        prepare(given)
    for found in files_of(given, tmp_path):
        assert len(found) == 1194
        assert ("impossible_readings", "wrist_roll", 6) in kinds(found)
        assert "stands still and then catches up, left out" in said(found)
        assert not any(warning.unusable for warning in check(found))
        assert len(prepare(found).segments) >= 1


@pytest.mark.parametrize(
    ("rows", "to"),
    [([600], 3.0), (range(600, 612), 0.9), ([0, 1], -4.0), ([1199], 100.0), ([600, 640], 5.0),
     ([3], 1e6)],
)  # fmt: skip
def test_readings_that_jump_away_and_back_are_left_out(tmp_path, rows, to):
    given = moved(2, lambda values: away(values, list(rows), to))
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


@pytest.mark.parametrize("way", [0.4, -1.0])
def test_a_jump_that_stays_is_refused_still(tmp_path, way):
    given = moved(2, lambda values: values + way * (np.arange(1200) >= 600))
    for found in files_of(given, tmp_path):
        assert [warning.kind for warning in check(found) if warning.unusable] == ["position_jump"]


def test_what_is_left_out_does_not_depend_on_how_a_file_is_cut_into_parts(tmp_path):
    long = wave(9000)
    position = long.position.copy()
    for row in range(50, 9000, 173):
        position[row : row + 1 + row % 12, 2] += 2.0
    replace(long, position=position).save(tmp_path / "a.csv")
    whole = Recording.load(tmp_path / "a.csv")
    parts = list(RecordingFile(tmp_path / "a.csv").parts())
    assert len(parts) > 1
    assert sum(len(part) for part in parts) == len(whole)
    lost = sum(1 + row % 12 for row in range(50, 9000, 173))
    assert len(whole) == 9000 - lost


def wrapped(values, low=-np.pi):
    return (values - low) % (2.0 * np.pi) + low


@pytest.mark.parametrize("low", [-np.pi, 0.0])
@pytest.mark.parametrize("parts", [1200, 9000])
def test_an_angle_that_wraps_at_a_turn_is_read_as_going_on(tmp_path, low, parts):
    clean = wave(parts)
    position, velocity = clean.position.copy(), clean.velocity.copy()
    position[:, 6], velocity[:, 6] = 6.0 * position[:, 6], 6.0 * velocity[:, 6]
    turned = position.copy()
    turned[:, 6] = wrapped(turned[:, 6], low)
    found = files_of(replace(clean, position=turned, velocity=velocity), tmp_path)
    for recording in found:
        off = recording.position[:, 6] - position[:, 6]
        np.testing.assert_allclose(off, off[0], atol=1e-9)
        assert said(recording).count("wrist_roll: its position wraps at a turn") == 1
        assert len(recording) == parts


def test_a_turn_that_is_none_is_not_unwrapped(tmp_path):
    steps = 1.9 * np.pi * (np.arange(1200) >= 600)
    given = replace(moved(6, lambda values: values - 3.0 + steps), velocity=None)
    for found in files_of(given, tmp_path):  # not at the ends of a range of one turn
        assert any(warning.kind == "position_jump" for warning in check(found))
    (tmp_path / "c").mkdir()
    elbow = moved(2, lambda values: wrapped(values + np.pi))  # of which the elbow can do none
    for found in files_of(elbow, tmp_path / "c"):
        assert any(warning.unusable for warning in check(found))


# Bags as a crash leaves them


def record(kind, content):
    return bytes([kind]) + len(content).to_bytes(8, "little") + content


def chunk(size, compression, data):
    name = compression.encode()
    head = bytes(16) + size.to_bytes(8, "little") + bytes(4)
    head += len(name).to_bytes(4, "little") + name + len(data).to_bytes(8, "little")
    return record(6, head + data)


def records(whole):
    """Yield the beginning and the records of an MCAP file, of chunks what they hold."""
    yield False, whole[:8]
    at = 8
    while at + 9 <= len(whole):
        end = at + 9 + int.from_bytes(whole[at + 1 : at + 9], "little")
        is_chunk = whole[at] == 6
        yield is_chunk, whole[at + 9 + 40 : end] if is_chunk else whole[at:end]
        at = end


def zstd_of(data):
    from backports import zstd

    return zstd.compress(data)


def lz4_of(data):
    from lz4 import frame

    return frame.compress(data)


@pytest.fixture
def long_bag(tmp_path):
    def written(storage):
        recording = wave(6000)
        recording.save(tmp_path / storage, storage, TOPIC)
        (file,) = (path for path in (tmp_path / storage).iterdir() if path.suffix != ".yaml")
        return recording, tmp_path / storage, file

    return written


@pytest.mark.parametrize("share", [0.4, 0.7, 0.97])
@pytest.mark.parametrize("bare", [False, True])
@pytest.mark.parametrize("kind", ["", "zstd", "lz4"])
def test_an_mcap_that_was_cut_off_is_read_as_far_as_it_goes(long_bag, share, bare, kind):
    recording, folder, file = long_bag("mcap")
    whole = file.read_bytes()
    if kind:
        pack = {"zstd": zstd_of, "lz4": lz4_of}[kind]
        whole = b"".join(
            chunk(len(data), kind, pack(data)) if is_chunk else data
            for is_chunk, data in records(whole)
        )
    file.write_bytes(whole[: int(share * len(whole))])
    found = Recording.load(file if bare else folder)
    assert 0.5 * share * 6000 < len(found) < 6000
    same(found, recording.rows(slice(0, len(found))))
    (note,) = found.notes
    assert note.kind == "cut_off"
    assert f"{len(found)} messages read" in note.text


def test_an_sqlite3_file_that_was_cut_off_is_refused_with_the_way_out(long_bag):
    _, folder, file = long_bag("sqlite3")
    file.write_bytes(file.read_bytes()[: int(0.7 * file.stat().st_size)])
    with pytest.raises(RecordingError, match=r"cut off or damaged.* \.recover"):
        Recording.load(folder)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_folder_without_a_description_is_read(long_bag, storage):
    recording, folder, file = long_bag(storage)
    (folder / "metadata.yaml").unlink()
    found = Recording.load(folder)
    same(found, recording)
    assert "no metadata.yaml" in said(found)
    same(Recording.load(file), recording)
    assert Recording.load(file).notes == ()


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_split_bag_is_read_without_a_part_that_is_missing(tmp_path, storage):
    suffix = "db3" if storage == "sqlite3" else "mcap"
    whole = wave(3000, start_ns=START)
    folder = tmp_path / "split"
    folder.mkdir()
    for part in range(12):  # by number: 10 comes after 9
        rows = whole.rows(slice(250 * part, 250 * part + 250))
        write_messages(tmp_path / f"p{part}", messages(rows), storage)
        shutil.move(tmp_path / f"p{part}/p{part}.{suffix}", folder / f"split_{part}.{suffix}")
    same(Recording.load(folder), whole)
    described = yaml_file.load(tmp_path / "p0/metadata.yaml")
    names = [f"split_{part}.{suffix}" for part in range(12)]
    described["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (folder / "metadata.yaml").write_text(yaml_file.dump(described))
    same(Recording.load(folder), whole)
    (folder / f"split_4.{suffix}").unlink()
    found = Recording.load(folder)
    assert len(found) == 2750
    assert f"split_4.{suffix} is missing" in said(found)


def test_changes_that_sqlite_keeps_beside_a_file_are_read_and_left_there(tmp_path):
    recording = wave(2000)
    recording.save(tmp_path / "bag")
    file = tmp_path / "bag/bag.db3"
    writer = sqlite3.connect(file)
    writer.execute("PRAGMA journal_mode=WAL")
    writer.execute("PRAGMA wal_autocheckpoint=0")
    writer.execute("DELETE FROM messages WHERE id > 1500")
    writer.commit()
    crashed = tmp_path / "crashed"
    crashed.mkdir()
    for path in (tmp_path / "bag").iterdir():
        shutil.copy(path, crashed)  # as if its recorder had been killed
    writer.close()
    before = {path.name: path.read_bytes() for path in crashed.iterdir()}
    assert "bag.db3-wal" in before
    assert len(Recording.load(crashed)) == 1500
    assert {path.name: path.read_bytes() for path in crashed.iterdir()} == before


def packed(file):
    from backports import zstd

    target = file.with_name(file.name + ".zstd")
    target.write_bytes(zstd.compress(file.read_bytes()))
    file.unlink()
    return target


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_bags_compressed_by_file_are_read(long_bag, storage):
    recording, folder, file = long_bag(storage)
    path = packed(file)
    same(Recording.load(path), recording)
    (folder / "metadata.yaml").unlink()
    same(Recording.load(folder), recording)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    if storage == "mcap":
        assert "breaks off" in said(Recording.load(path))
    else:
        with pytest.raises(RecordingError, match="breaks off"):
            Recording.load(path)


def test_bags_compressed_by_message_are_read(tmp_path):
    from backports import zstd

    sent = [(at, zstd.compress(data)) for at, data in messages(CLEAN)]
    np.testing.assert_array_equal(loaded(tmp_path, sent).effort, CLEAN.effort)


# ROS 1


def ros1_bag(path, recording, compression=None, topic="/dvrk/MTMR/state_joint_current"):
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    writer = Ros1Writer(path)
    if compression:
        writer.set_compression(compression)
    with writer:
        connection = writer.add_connection(topic, JOINT_STATE, typestore=store)
        for k, at in enumerate((START + np.round(recording.time * 1e9).astype(np.int64)).tolist()):
            stamp = types["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9)
            header = types["std_msgs/msg/Header"](k, stamp, "base")
            arrays = (recording.position[k], recording.velocity[k], recording.effort[k])
            sent = types[JOINT_STATE](header, list(recording.joints), *arrays)
            writer.write(connection, at + 1000, store.serialize_ros1(sent, JOINT_STATE))


@pytest.mark.parametrize(
    "compression", [None, Ros1Writer.CompressionFormat.BZ2, Ros1Writer.CompressionFormat.LZ4]
)
def test_ros1_bags_are_read(tmp_path, compression):
    ros1_bag(tmp_path / "a.bag", CLEAN, compression)
    found = Recording.load(tmp_path / "a.bag", arm=ARM)
    same(found, CLEAN)
    assert found.start_ns == START
    assert found.notes == ()
    with BagReader(tmp_path / "a.bag") as bag:
        assert bag.topics == {"/dvrk/MTMR/state_joint_current": JOINT_STATE}
    words = [str(tmp_path / "a.bag"), str(tmp_path / "b")]
    assert run("dvrk_gravity.cli.convert", words) == 0
    same(Recording.load(tmp_path / "b", arm=ARM), CLEAN)


def test_a_ros1_bag_that_was_not_closed_is_read(tmp_path):
    ros1_bag(tmp_path / "a.bag", wave(4000))
    data = (tmp_path / "a.bag").read_bytes()
    (tmp_path / "a.bag.active").write_bytes(data[: int(0.7 * len(data))])
    found = Recording.load(tmp_path / "a.bag.active")
    assert 1000 < len(found) < 4000
    assert "has no index" in said(found)
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(RecordingError, match=r"expected a ROS 1 bag of version 2\.0"):
        Recording.load(tmp_path / "old.bag")


# Sizes


MEGABYTES = 480
HUGE = bytes(MEGABYTES * 1_000_000)


@pytest.mark.parametrize("declared", [MEGABYTES * 1_000_000, 1000])
@pytest.mark.parametrize("pack", [zstd_of, lz4_of])
def test_what_unpacks_to_hundreds_of_megabytes_is_refused_in_little_memory(
    tmp_path, declared, pack
):
    import tracemalloc

    kind = pack.__name__.removesuffix("_of")
    wave(50).save(tmp_path / "bag", "mcap")
    file = tmp_path / "bag/bag.mcap"
    whole = file.read_bytes()
    after = 8 + 9 + int.from_bytes(whole[9:17], "little")  # magic and header
    bomb = chunk(declared, kind, pack(HUGE))
    file.write_bytes(whole[:after] + bomb + whole[after:])
    tracemalloc.start()
    found = Recording.load(file)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found) == 50
    assert "left out 1 × chunk that" in said(found)
    assert peak < 100e6
    file.write_bytes(whole[:after] + bomb)
    with pytest.raises(RecordingError, match=r"cannot be read as a bag|no sensor_msgs"):
        Recording.load(file)


def test_a_message_of_hundreds_of_megabytes_is_left_out_unread(tmp_path):
    sent = messages(CLEAN.rows(slice(0, 50)))
    large = b"\0\1\0\0" + bytes(2_000_000)
    for storage in ("sqlite3", "mcap"):
        write_messages(tmp_path / storage, [*sent, (sent[-1][0] + 1, large)], storage)
        found = Recording.load(tmp_path / storage)
        assert len(found) == 50
        assert "message of more than 1000000 bytes" in said(found)
    bombs = [(at, zstd_of(data)) for at, data in sent]
    write_messages(tmp_path / "packed", [*bombs, (sent[-1][0] + 1, zstd_of(HUGE))])
    found = Recording.load(tmp_path / "packed")
    assert len(found) == 50
    assert "message that unpacks to more than" in said(found)


def test_bz2_of_a_ros1_bag_unpacks_no_further_than_declared(tmp_path):
    from dvrk_gravity.recording import Allowance, UnpackError, unpacked

    with pytest.raises(UnpackError, match="another size than the 1000 bytes"):
        unpacked(bz2.compress(bytes(50_000_000)), "bz2", 1000, Allowance(100))
