"""Bags as crashes, other versions of ROS and compression leave them, read as far as they go."""

import shutil
import sqlite3
import struct
from contextlib import closing

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from recording_samples import ARM, START, TOPIC, messages, same, wave, write_messages
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from dvrk_gravity.errors import RecordingError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.recording import JOINT_STATE, BagReader, Recording

CLEAN = wave(300)


def zstd_of(data):
    return zstandard.compress(data)


@pytest.fixture
def long_bag(tmp_path):
    def written(storage, samples=3000):
        recording = wave(samples)
        recording.save(tmp_path / storage, storage, TOPIC)
        (file,) = (path for path in (tmp_path / storage).iterdir() if path.suffix != ".yaml")
        return recording, tmp_path / storage, file

    return written


def test_an_mcap_that_was_cut_off_is_read_as_far_as_it_goes(long_bag):
    recording, folder, file = long_bag("mcap")
    whole = file.read_bytes()
    for share in (0.97, 0.4):
        file.write_bytes(whole[: int(share * len(whole))])
        for path in (file, folder):
            found = Recording.load(path)
            assert 0.5 * share * 3000 < len(found) < 3000
            same(found, recording.rows(slice(0, len(found))))
            assert [note.kind for note in found.notes] == ["cut_off"]


def test_an_sqlite3_file_that_was_cut_off_is_refused(long_bag):
    _, folder, file = long_bag("sqlite3", 6000)
    file.write_bytes(file.read_bytes()[: int(0.7 * file.stat().st_size)])
    with pytest.raises(RecordingError, match=f"{file.name}.*malformed"):
        Recording.load(folder)


def test_what_a_killed_recorder_left_beside_an_sqlite3_file_is_read_and_left_as_it_is(long_bag):
    recording, folder, file = long_bag("sqlite3", 500)
    with closing(sqlite3.connect(file)) as recorder:
        recorder.execute("PRAGMA journal_mode=WAL")
        recorder.execute("DELETE FROM messages WHERE id > 300")
        recorder.commit()
        killed = folder.with_name("killed")
        shutil.copytree(folder, killed)
    before = {path: path.read_bytes() for path in killed.iterdir()}
    assert any(path.name.endswith("-wal") and content for path, content in before.items())
    same(Recording.load(killed), recording.rows(slice(300)))
    assert before == {path: path.read_bytes() for path in killed.iterdir()}


def test_a_split_bag_is_read_without_a_part_that_is_missing(tmp_path):
    whole = wave(240, start_ns=START)
    folder = tmp_path / "split"
    folder.mkdir()
    for part in range(12):  # by number: 10 comes after 9
        write_messages(
            tmp_path / f"p{part}", messages(whole.rows(slice(20 * part, 20 * part + 20)))
        )
        shutil.move(tmp_path / f"p{part}/p{part}.db3", folder / f"split_{part}.db3")
    same(Recording.load(folder), whole)
    described = yaml_file.load(tmp_path / "p0/metadata.yaml")
    names = [f"split_{part}.db3" for part in range(12)]
    described["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (folder / "metadata.yaml").write_text(yaml_file.dump(described))
    same(Recording.load(folder), whole)
    (folder / "split_4.db3").unlink()
    found = Recording.load(folder)
    assert len(found) == 220
    assert "split_4.db3" in found.notes[0].text


def packed(file):
    target = file.with_name(file.name + ".zstd")
    target.write_bytes(zstd_of(file.read_bytes()))
    file.unlink()
    return target


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_bags_compressed_by_file_are_read(long_bag, storage):
    recording, folder, file = long_bag(storage, 6000)
    path = packed(file)
    same(Recording.load(path), recording)
    (folder / "metadata.yaml").unlink()
    same(Recording.load(folder), recording)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    if storage == "mcap":
        assert {note.kind for note in Recording.load(path).notes} == {"cut_off"}
    else:
        with pytest.raises(RecordingError, match=path.name):
            Recording.load(path)


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


def test_ros1_bags_are_read_compressed_or_not(tmp_path):
    given = CLEAN
    kinds = (None, Ros1Writer.CompressionFormat.BZ2, Ros1Writer.CompressionFormat.LZ4)
    for number, compression in enumerate(kinds):
        path = tmp_path / f"{number}.bag"
        ros1_bag(path, given, compression)
        found = Recording.load(path, arm=ARM)
        same(found, given)
        assert (found.start_ns, found.notes) == (START, ())
    with BagReader(path) as bag:
        assert bag.topics == {"/dvrk/MTMR/state_joint_current": JOINT_STATE}


def test_a_ros1_bag_that_was_not_closed_is_refused_with_what_mends_it(tmp_path):
    ros1_bag(tmp_path / "a.bag", wave(1500))
    data = (tmp_path / "a.bag").read_bytes()
    at = data.index(b"index_pos=") + 10
    for content in (data[: int(0.7 * len(data))], data[:at] + bytes(8) + data[at + 8 :]):
        (tmp_path / "a.bag.active").write_bytes(content)
        with pytest.raises(RecordingError, match=r"active: .*`rosbag reindex a\.bag\.active`$"):
            Recording.load(tmp_path / "a.bag.active")
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(RecordingError, match=r"old\.bag.*2\.0"):
        Recording.load(tmp_path / "old.bag")


def test_messages_may_be_compressed_and_one_of_megabytes_is_left_out_and_named(tmp_path):
    sent = messages(CLEAN)
    large = b"\0\1\0\0" + bytes(2_000_000)
    for name, pack in (("plain", bytes), ("packed", zstd_of)):
        content = [(at, pack(data)) for at, data in [*sent, (sent[-1][0] + 1, large)]]
        write_messages(tmp_path / name, content)
        found = Recording.load(tmp_path / name, arm=ARM)
        np.testing.assert_array_equal(found.effort, CLEAN.effort)
        assert "1000000 bytes" in found.notes[0].text


def test_damaged_and_absurd_chunks_are_left_out_and_counted(long_bag):
    _, _, file = long_bag("mcap", 9000)
    whole = file.read_bytes()
    with file.open("rb") as stream:
        first, *others = make_reader(stream).get_summary().chunk_indexes
    assert others
    at = first.chunk_start_offset + 25  # of its unpacked size
    for size, said in ((5, "1 × chunk that cannot be"), (10**9, "1 × chunk or message that")):
        file.write_bytes(whole[:at] + struct.pack("<Q", size) + whole[at + 8 :])
        found = Recording.load(file)
        assert said in found.notes[0].text
        assert 1000 < len(found) < 8000
