"""Recordings come back from CSV and rosbag2 files as they were written."""

import contextlib

import numpy as np
import pytest
from made_up_arm import made_up_arm
from recording_samples import ARM, START, TOPIC, joint_state, same, wave, write_messages

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.command_line import run
from dvrk_gravity.errors import RecordingError, ShapeError
from dvrk_gravity.recording import (
    JOINT_STATE,
    BagWriter,
    Recording,
    iterate_recording,
    read_joint_states,
    save_recording,
    typestore,
)

STORAGES = ("sqlite3", "mcap")


def convert(*arguments):
    return run("dvrk_gravity.cli.convert", [str(argument) for argument in arguments])


@pytest.mark.parametrize("missing", [None, "velocity", "effort"])
def test_csv_and_both_bag_storages_round_trip_without_loss(tmp_path, missing):
    rng = np.random.default_rng(1)
    fields = {"position": rng.normal(size=(50, 7)), "effort": 1e-300 + rng.random((50, 7))}
    original = wave(50, **(fields | ({missing: None} if missing else {})))
    names = ("a.csv", "b", "c", "d.csv")
    for name, before in zip(names, (None, *names), strict=False):
        given = Recording.load(tmp_path / before) if before else original
        same(original, given)
        given.save(tmp_path / name, "mcap" if name == "c" else "sqlite3")
    same(original, Recording.load(tmp_path / "d.csv"))
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "d.csv").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "b", "c", "d.csv"]


def test_columns_may_come_in_any_order_with_spaces_and_a_byte_order_mark(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(
        b"\xef\xbb\xbfwrist_roll.position, time ,outer_yaw.position\r\n1,0.5,2\r\n\r\n3,0.75,4\r\n"
    )
    assert Recording.load(path).joints == ("wrist_roll", "outer_yaw")  # in the file's order
    loaded = Recording.load(path, arm=ARM)
    assert loaded.position.tolist() == [[2, 1], [4, 3]]
    assert (loaded.time.tolist(), loaded.start_ns) == ([0.0, 0.25], 500_000_000)


@pytest.mark.parametrize("storage", STORAGES)
def test_bag_samples_are_matched_by_name_and_gripper_and_invalid_ones_left_out(tmp_path, storage):
    shuffled = ("gripper", *reversed(JOINT_NAMES))
    messages = [
        joint_state(0),
        joint_state(1, shuffled, position=[99, 6, 5, 4, 3, 2, 1, 0]),
        joint_state(2, stamp_ns=0),
        joint_state(3),
        (START + 3_600_000, joint_state(3)[1]),
        joint_state(4),
    ]
    write_messages(tmp_path / "bag", messages, storage)
    assert Recording.load(tmp_path / "bag").notes[0].left_out == 1  # with a gripper, unlike most
    loaded = Recording.load(tmp_path / "bag", arm=ARM)
    assert loaded.joints == JOINT_NAMES
    assert loaded.position[1].tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert (loaded.invalid, loaded.repeated, len(loaded)) == (1, 1, 4)
    assert loaded.start_ns == START
    assert loaded.time.tolist() == [0.0, 0.001, 0.003, 0.004]


def test_a_recording_of_another_arm_names_both(tmp_path):
    """That of a PSM is not taken for an ECM's, whose joints it has."""
    for recorded, stated in (("psm", "ecm"), ("psm", "mtmr"), ("mtmr", "ecm")):
        arm = Arm.load(recorded)
        path = tmp_path / f"{recorded}_{stated}.csv"
        header = ",".join(f"{name}.position" for name in arm.joint_names)
        path.write_text(header + "\n" + ",".join("0" * arm.n))
        write_messages(path.with_suffix(""), [joint_state(0, arm.joint_names)])
        for source in (path, path.with_suffix("")):
            with pytest.raises(RecordingError, match=rf"{recorded}.*{stated}.*--arm"):
                Recording.load(source, arm=Arm.load(stated))


@pytest.mark.parametrize("chunk", [1, 3, 100])
def test_parts_of_a_bag_join_without_seams(tmp_path, chunk):
    messages = [joint_state(k // 2, stamp_ns=0 if k == 3 else START + k // 2) for k in range(12)]
    messages = [(START + k, data) for k, (_, data) in enumerate(messages)]
    write_messages(tmp_path / "bag", messages)
    parts = list(iterate_recording(tmp_path / "bag", chunk=chunk))
    time = np.concatenate([part.time for part in parts])
    assert (time * 1e9).round().tolist() == [0, 1, 2, 3, 4, 5]
    assert sum(part.invalid for part in parts) == 1
    assert sum(part.repeated for part in parts) == 5


@pytest.mark.parametrize("storage", STORAGES)
def test_messages_are_yielded_as_sent_and_agree_with_the_library(tmp_path, storage):
    messages = [joint_state(1, ("a",)), joint_state(2, effort=()), joint_state(3, stamp_ns=0)]
    messages += [joint_state(k, ("j",) * (k % 20)) for k in range(4, 60)]
    messages = [(START + k, data) for k, (_, data) in enumerate(messages)]
    write_messages(tmp_path / "bag", messages, storage)
    samples = list(read_joint_states(tmp_path / "bag", chunk=17))
    assert [sample.receive_ns for sample in samples] == [ns for ns, _ in messages]
    for sample, (_, data) in zip(samples, messages, strict=True):
        expected = typestore().deserialize_cdr(data, JOINT_STATE)
        stamp = expected.header.stamp
        assert sample.stamp_ns == stamp.sec * 10**9 + stamp.nanosec
        assert list(sample.names) == expected.name
        for field in ("position", "velocity", "effort"):
            assert getattr(sample, field).tolist() == getattr(expected, field).tolist()


@pytest.mark.parametrize("storage", STORAGES)
def test_a_writer_that_fails_leaves_a_usable_bag_and_says_where_or_nothing(
    tmp_path, storage, caplog
):
    def interrupted(keep: bool) -> BagWriter:
        bag = BagWriter(tmp_path / "b", storage, keep)
        with contextlib.suppress(ZeroDivisionError), bag:
            bag.write(TOPIC, JOINT_STATE, joint_state(0)[1], START)
            raise ZeroDivisionError
        return bag

    interrupted(keep=False)
    assert list(tmp_path.iterdir()) == []
    partial = interrupted(keep=True).partial
    assert not (tmp_path / "b").exists()
    assert str(partial) in caplog.text
    assert len(Recording.load(partial)) == 1


def test_what_cannot_be_written_is_refused_and_nothing_left_or_touched(tmp_path, capsys):
    for static in (wave(9, time=None), wave(9, direction=np.ones((9, 7)))):
        with pytest.raises(RecordingError, match="CSV"):
            static.save(tmp_path / "bag")
    for name in ("a.csv", "bag"):
        with pytest.raises(RecordingError, match=f"absent/{name}.*No such file"):
            wave(9).save(tmp_path / "absent" / name)
    parts = [wave(5), wave(5, effort=None)]
    with pytest.raises(RecordingError, match="columns change"):
        save_recording(parts, tmp_path / "a.csv", "mcap", TOPIC)
    late = "".join(f"{k},1\n" for k in range(30_000)) + 9000 * "1,x\n"
    (tmp_path / "late.csv").write_text("time,outer_yaw.position\n" + late)
    for name in ("out", "out.csv"):
        assert convert(tmp_path / "late.csv", tmp_path / name) == 2
        assert "line 30002: outer_yaw.position is 'x'" in capsys.readouterr().err
    for name in ("late.csv", "bag"):
        (tmp_path / name).write_text("precious")
        with pytest.raises(RecordingError, match=name):
            wave(10).save(tmp_path / name)
        assert (tmp_path / name).read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "late.csv"]


def test_parts_selected_from_a_recording():
    recording = wave(1000, start_ns=START)
    assert recording.rate == pytest.approx(200.0)
    assert recording.joint("wrist_pitch") == 4
    with pytest.raises(RecordingError, match="no joint 'elbow'"):
        recording.joint("elbow")
    part = recording.between(1.0, 2.0)
    assert (part.time[0], part.time[-1], len(part)) == (1.0, 1.995, 200)
    assert part.start_ns == START
    with pytest.raises(RecordingError, match="no sample between 9 and 10 s"):
        recording.between(9.0, 10.0)
    assert len(recording.rows(recording.position[:, 0] > 0)) < 1000


REFUSED = [
    ({"velocity": np.zeros((4, 7))}, ShapeError, r"velocity.*\(4, 7\)"),
    ({"effort": np.diag([np.nan] * 7)[:5]}, RecordingError, "sample 0: outer_yaw.effort is nan"),
    ({"time": np.array([0, 1, 1, 2, 3.0])}, RecordingError, "sample 2: time 1 s after 1 s"),
    ({"time": np.array([0, 1, 2, 3, np.inf])}, RecordingError, "sample 4: time is inf"),
    ({"time": np.arange(4.0)}, ShapeError, r"time.*\(4,\)"),
    ({"direction": np.zeros((5, 7))}, RecordingError, "direction is 0"),
    ({"joints": JOINT_NAMES[::-1], "arm": ARM}, RecordingError, "order"),
    ({"joints": ("a",) * 7}, RecordingError, "each once"),
    ({"joints": ("a", "b", "c", "d", "e", "f", 7)}, RecordingError, "names"),
    ({"joints": ()}, RecordingError, "joints"),
    ({"coordinates": "motor"}, RecordingError, "'motor'"),
    ({"position": np.zeros((0, 7))}, RecordingError, "no samples"),
]


def test_inconsistent_recordings_are_refused_by_what_is_wrong():
    fields = {"joints": JOINT_NAMES, "time": None, "position": np.zeros((5, 7))}
    Recording(**fields)
    for changes, error, tokens in REFUSED:
        with pytest.raises(error, match=tokens):
            Recording(**(fields | changes))


def test_a_recording_names_its_own_joints_and_an_arm_takes_its_own_from_it(tmp_path):
    names = ("insertion", "gripper", "yaw")
    messages = [joint_state(0, names), joint_state(1, names[::-1]), joint_state(2, names)]
    write_messages(tmp_path / "bag", messages)
    loaded = Recording.load(tmp_path / "bag")
    assert loaded.joints == names
    assert loaded.position[1].tolist() == [0.201, 0.101, 0.001]
    arm = made_up_arm(tmp_path)
    own = loaded.of(arm)
    assert own.joints == ("yaw", "insertion")
    np.testing.assert_array_equal(own.effort, loaded.effort[:, [2, 0]])
    np.testing.assert_array_equal(own.scale, [1.0, 0.1])
    assert own.of(arm) is own
    same(own, Recording.load(tmp_path / "bag", arm=arm))
    with pytest.raises(RecordingError, match="insertion, gripper, yaw"):
        loaded.of(ARM)
