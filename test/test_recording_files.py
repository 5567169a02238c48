"""Recordings come back from CSV and rosbag2 files as they were written."""

import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from made_up_arm import made_up_arm
from recording_samples import (
    ARM,
    START,
    TOPIC,
    joint_state,
    same,
    shared_data,
    wave,
    write_messages,
)

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.errors import RecordingError, ShapeError
from dvrk_gravity.recording import (
    JOINT_STATE,
    BagReader,
    BagWriter,
    Recording,
    iterate_recording,
    read_joint_states,
    save_recording,
    typestore,
)

STORAGES = ("sqlite3", "mcap")


def test_csv_and_both_bag_storages_round_trip_without_loss(tmp_path):
    rng = np.random.default_rng(1)
    original = wave(500, position=rng.normal(size=(500, 7)), effort=1e-300 + rng.random((500, 7)))
    original.save(tmp_path / "a.csv")
    from_csv = Recording.load(tmp_path / "a.csv")
    from_csv.save(tmp_path / "b", "sqlite3")
    from_sqlite3 = Recording.load(tmp_path / "b")
    from_sqlite3.save(tmp_path / "c", "mcap")
    from_mcap = Recording.load(tmp_path / "c")
    from_mcap.save(tmp_path / "d.csv")
    for again in (from_csv, from_sqlite3, from_mcap, Recording.load(tmp_path / "d.csv")):
        same(original, again)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "d.csv").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "b", "c", "d.csv"]


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("drop", [(), ("velocity",), ("effort",), ("velocity", "effort")])
def test_missing_columns_and_joints_stay_missing(tmp_path, storage, drop):
    joints = ("shoulder_pitch", "wrist_roll")
    original = wave(20, joints=joints, start_ns=START, **dict.fromkeys(drop))
    original.save(tmp_path / "bag", storage)
    same(original, Recording.load(tmp_path / "bag"), start=True)
    original.save(tmp_path / "a.csv")
    same(original, Recording.load(tmp_path / "a.csv"))


@pytest.mark.parametrize("per_joint", [False, True])
def test_static_poses_keep_their_direction_in_csv(tmp_path, per_joint):
    direction = np.where(np.arange(30)[:, None] % 3 == 0, 1.0, -1.0) * np.ones((30, 7))
    if per_joint:
        direction[4, 2] *= -1
    original = wave(30, time=None, velocity=None, direction=direction)
    original.save(tmp_path / "a.csv")
    header = (tmp_path / "a.csv").read_text().splitlines()[0].split(",")
    assert ("direction" in header) != per_joint
    assert "time" not in header
    same(original, Recording.load(tmp_path / "a.csv"))


def test_columns_may_come_in_any_order_with_spaces_and_a_byte_order_mark(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(
        b"\xef\xbb\xbfwrist_roll.position, time ,outer_yaw.position\r\n1,0.5,2\r\n\r\n3,0.75,4\r\n"
    )
    loaded = Recording.load(path)
    assert loaded.joints == ("wrist_roll", "outer_yaw")  # in the file's order
    assert loaded.position.tolist() == [[1, 2], [3, 4]]
    loaded = Recording.load(path, arm=ARM)
    assert loaded.joints == ("outer_yaw", "wrist_roll")
    assert loaded.position.tolist() == [[2, 1], [4, 3]]
    assert loaded.time.tolist() == [0.0, 0.25]
    assert loaded.start_ns == 500_000_000


def test_repeated_times_are_left_out_and_counted(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,outer_yaw.position\n0,1\n0,1\n0.1,2\n0.1,2\n0.1,2\n0.2,3\n")
    parts = list(iterate_recording(path, chunk=2))
    assert np.concatenate([part.position[:, 0] for part in parts]).tolist() == [1, 2, 3]
    loaded = Recording.load(path)
    assert (loaded.repeated, loaded.position[:, 0].tolist()) == (3, [1, 2, 3])


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
    assert Recording.load(tmp_path / "bag").notes[0].count == 1  # with a gripper, unlike most
    loaded = Recording.load(tmp_path / "bag", arm=ARM)
    assert loaded.joints == JOINT_NAMES
    assert loaded.position[1].tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert (loaded.invalid, loaded.repeated, len(loaded)) == (1, 1, 4)
    assert loaded.start_ns == START
    assert loaded.time.tolist() == [0.0, 0.001, 0.003, 0.004]


def test_a_recording_of_a_larger_arm_is_not_taken_for_a_smaller_one_s(tmp_path):
    psm, ecm = Arm.load("psm"), Arm.load("ecm")
    assert set(ecm.joint_names) < set(psm.joint_names)
    path = tmp_path / "psm.csv"
    header = ",".join(f"{name}.position" for name in psm.joint_names)
    path.write_text(header + "\n" + ",".join("0" * psm.n))
    write_messages(tmp_path / "bag", [joint_state(0, psm.joint_names)])
    for source in (path, tmp_path / "bag"):
        with pytest.raises(RecordingError, match="the joints of arm psm, expected those of ecm"):
            Recording.load(source, arm=ecm)
        assert Recording.load(source, arm=psm).joints == psm.joint_names


@pytest.mark.parametrize(
    ("recorded", "stated"), [("psm", "mtmr"), ("mtmr", "psm"), ("ecm", "mtml"), ("mtmr", "ecm")]
)
def test_a_recording_of_another_arm_names_both_and_the_option(tmp_path, recorded, stated):
    arm = Arm.load(recorded)
    path = tmp_path / "motion.csv"
    header = ",".join(f"{name}.position" for name in arm.joint_names)
    path.write_text(header + "\n" + ",".join("0" * arm.n))
    write_messages(tmp_path / "bag", [joint_state(0, arm.joint_names)])
    for source in (path, tmp_path / "bag"):
        with pytest.raises(RecordingError) as refused:
            Recording.load(source, arm=Arm.load(stated))
        words = str(refused.value)
        # The joints of both masters have the same names.
        assert f"of arm {'mtml or mtmr' if recorded == 'mtmr' else recorded}" in words
        assert all(word in words for word in (stated, "--arm", "--model")), words


@pytest.mark.parametrize("chunk", [1, 2, 3, 100])
def test_parts_of_a_bag_join_without_seams(tmp_path, chunk):
    messages = [joint_state(k // 2, stamp_ns=0 if k == 3 else START + k // 2) for k in range(12)]
    messages = [(START + k, data) for k, (_, data) in enumerate(messages)]
    write_messages(tmp_path / "bag", messages)
    parts = list(iterate_recording(tmp_path / "bag", chunk=chunk))
    assert (np.concatenate([part.time for part in parts]) * 1e9).round().tolist() == [
        0,
        1,
        2,
        3,
        4,
        5,
    ]
    assert sum(part.invalid for part in parts) == 1
    assert sum(part.repeated for part in parts) == 5


def test_receive_time_may_be_the_time_base(tmp_path):
    messages = [(START + 10 * k, joint_state(300 - k)[1]) for k in range(300)]
    write_messages(tmp_path / "bag", messages)
    loaded = Recording.load(tmp_path / "bag", time_base="receive")
    assert (loaded.time[:3] * 1e9).tolist() == [0.0, 10.0, 20.0]
    with pytest.raises(RecordingError, match=r"299 of 300 .* out of the order of time"):
        Recording.load(tmp_path / "bag")


@pytest.mark.parametrize("storage", STORAGES)
def test_messages_are_yielded_as_sent_and_agree_with_the_library(tmp_path, storage):
    messages = [
        joint_state(0),
        joint_state(1, ("a",)),
        joint_state(2, effort=()),
        joint_state(3, stamp_ns=0),
        joint_state(4, ()),
        *(joint_state(k, ("j",) * (k % 20)) for k in range(5, 60)),
    ]
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
        assert bytes(typestore().serialize_cdr(expected, JOINT_STATE)) == data


def test_big_endian_messages_are_read(tmp_path):
    message = typestore().deserialize_cdr(joint_state(7)[1], JOINT_STATE)
    data = bytes(typestore().serialize_cdr(message, JOINT_STATE, little_endian=False))
    write_messages(tmp_path / "bag", [(START, data)])
    assert Recording.load(tmp_path / "bag").position[0].tolist() == message.position.tolist()


@pytest.mark.parametrize(
    ("topics", "chosen"),
    [
        (["/a"], "/a"),
        (["/MTMR/setpoint_js", "/MTMR/measured_js"], "/MTMR/measured_js"),
        (["/MTMR/gripper/measured_js", "/MTMR/measured_js"], "/MTMR/measured_js"),
        (["/MTML/measured_js", "/MTMR/measured_js"], None),
        (["/a", "/b"], None),
    ],
)
def test_joint_state_topic_is_found_or_must_be_named(tmp_path, topics, chosen):
    with BagWriter(tmp_path / "bag") as bag:
        for topic in topics:
            bag.add_topic(topic, JOINT_STATE)
        bag.add_topic("/other", "std_msgs/msg/Bool")
    with BagReader(tmp_path / "bag") as bag:
        if chosen is None:
            with pytest.raises(RecordingError, match=r"several .*" + topics[0]):
                bag.joint_state_topic()
        else:
            assert bag.joint_state_topic() == chosen
        assert bag.joint_state_topic(topics[0]) == topics[0]
        with pytest.raises(RecordingError, match=r"no JointState topic '/other'"):
            bag.joint_state_topic("/other")


@pytest.mark.parametrize("storage", STORAGES)
def test_writer_takes_any_standard_message_as_object_or_bytes(tmp_path, storage):
    types = typestore().types
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    sent = {
        "/hold": types["std_msgs/msg/Empty"](),
        "/flag": types["std_msgs/msg/Bool"](data=True),
        "/efforts": types["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.arange(3.0)),
    }
    with BagWriter(tmp_path / "bag", storage) as bag:
        for k, (topic, message) in enumerate(sent.items()):
            bag.write(topic, message.__msgtype__, message, START + k)
        bag.write(TOPIC, JOINT_STATE, joint_state(0)[1], START + 9)
        assert not (tmp_path / "bag").exists()
        assert bag.count == 4
    with BagReader(tmp_path / "bag") as bag:
        got = [(t, ns, bag.message(t, data)) for t, ns, data in bag.raw(*bag.topics)]
    assert [(t, ns - START) for t, ns, _ in got] == [*zip(sent, range(3), strict=True), (TOPIC, 9)]
    assert got[1][2].data is True
    assert got[2][2].data.tolist() == [0, 1, 2]


def interrupted(writer, messages):
    with writer as bag:
        for k in range(messages):
            bag.write(TOPIC, JOINT_STATE, joint_state(k)[1], START + k)
        raise ZeroDivisionError


@pytest.mark.parametrize("storage", STORAGES)
def test_writer_ended_by_an_exception_leaves_a_usable_bag_and_says_where(tmp_path, storage, caplog):
    bag = BagWriter(tmp_path / "bag", storage)
    with pytest.raises(ZeroDivisionError):
        interrupted(bag, messages=1)
    assert not (tmp_path / "bag").exists()
    assert str(bag.partial) in caplog.text
    assert len(Recording.load(bag.partial)) == 1


@pytest.mark.parametrize("keep", [True, False])
def test_writer_ended_before_anything_was_kept_leaves_nothing(tmp_path, keep):
    with pytest.raises(ZeroDivisionError):
        interrupted(BagWriter(tmp_path / "bag", keep_partial=keep), messages=0 if keep else 1)
    assert list(tmp_path.iterdir()) == []


def test_killed_writer_has_its_earlier_seconds_on_disk(tmp_path):
    script = """
        import sys, time
        from recording_samples import *
        with BagWriter(sys.argv[1]) as bag:
            for k in range(10**9):
                receive_ns, data = joint_state(k)
                bag.write(TOPIC, JOINT_STATE, data, receive_ns)
                if k == 100:
                    time.sleep(1.1)
                if k == 150:
                    print("written", flush=True)
                    time.sleep(60)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script), tmp_path / "bag"],
        stdout=subprocess.PIPE,
        env={"PYTHONPATH": ":".join(sys.path)},
    )
    assert process.stdout.readline() == b"written\n"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    (file,) = tmp_path.glob("bag.partial-*/bag/bag.db3")
    # Committed with the first message after the pause, number 101.
    assert len(list(read_joint_states(file))) == 102


@pytest.mark.parametrize("storage", STORAGES)
def test_full_disk_is_one_error_and_leaves_no_finished_bag(tmp_path, storage):
    script = """
        import resource, signal, sys
        from recording_samples import *
        from dvrk_gravity.errors import RecordingError
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
        try:
            wave(20_000).save(sys.argv[1], sys.argv[2])
        except RecordingError as error:
            print(error)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), tmp_path / "bag", storage],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": ":".join(sys.path)},
        check=False,
    )
    assert f"{tmp_path}/bag: cannot be written: " in done.stdout
    assert (done.stdout.count("\n"), done.returncode) == (1, 0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.csv", "bag"])
def test_an_existing_target_is_not_touched(tmp_path, name):
    (tmp_path / name).write_text("precious")
    with pytest.raises(RecordingError, match="exists already"):
        wave(10).save(tmp_path / name)
    assert (tmp_path / name).read_text() == "precious"
    assert len(list(tmp_path.iterdir())) == 1


def test_what_a_bag_cannot_carry_is_refused_and_nothing_left(tmp_path):
    for static in (wave(9, time=None), wave(9, direction=np.ones((9, 7)))):
        with pytest.raises(RecordingError, match=r"do not fit in a bag, expected CSV"):
            static.save(tmp_path / "bag")
    with pytest.raises(RecordingError, match="cannot be written: No such file"):
        wave(9).save(tmp_path / "absent" / "a.csv")
    with pytest.raises(RecordingError, match="cannot be written: No such file"):
        wave(9).save(tmp_path / "absent" / "bag")
    assert list(tmp_path.iterdir()) == []


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
    blocks = recording.blocks(3)
    assert [len(block) for block in blocks] == [333, 334, 333]
    assert np.array_equal(np.concatenate([b.effort for b in blocks]), recording.effort)
    with pytest.raises(RecordingError, match="1001 blocks"):
        recording.blocks(1001)
    assert len(recording.rows(recording.position[:, 0] > 0)) < 1000


def test_arrays_are_read_only_and_the_callers_stay_writable():
    position = np.zeros((3, 7))
    recording = Recording(JOINT_NAMES, None, position)
    with pytest.raises(ValueError, match="read-only"):
        recording.position[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        recording.rows(slice(1, 3)).position[0, 0] = 1.0
    position[0, 0] = 1.0
    assert recording.position[0, 0] == 0.0


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"velocity": np.zeros((4, 7))}, ShapeError, r"velocity has shape \(4, 7\)"),
        (
            {"effort": np.diag([np.nan] * 7)[:5]},
            RecordingError,
            "sample 0: outer_yaw.effort is nan",
        ),
        ({"time": np.array([0, 1, 1, 2, 3.0])}, RecordingError, "sample 2: time 1 s after 1 s"),
        ({"time": np.array([0, 1, 2, 3, np.inf])}, RecordingError, "sample 4: time is inf"),
        ({"time": np.arange(4.0)}, ShapeError, r"time has shape \(4,\)"),
        ({"direction": np.zeros((5, 7))}, RecordingError, "direction is 0, expected"),
        ({"joints": JOINT_NAMES[::-1], "arm": ARM}, RecordingError, "in this order"),
        ({"joints": ("a",) * 7}, RecordingError, "expected names, each once"),
        ({"joints": ("a", "b", "c", "d", "e", "f", 7)}, RecordingError, "expected names, each"),
        ({"joints": ()}, RecordingError, "joints are missing"),
        ({"coordinates": "motor"}, RecordingError, "coordinates 'motor'"),
        ({"position": np.zeros((0, 7))}, RecordingError, "no samples"),
    ],
)
def test_inconsistent_recordings_are_refused(changes, error, text):
    fields = {"joints": JOINT_NAMES, "time": None, "position": np.zeros((5, 7))}
    Recording(**fields)
    with pytest.raises(error, match=text):
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
    with pytest.raises(RecordingError, match="joints are insertion, gripper, yaw, expected some"):
        loaded.of(ARM)


def test_long_recordings_stream_through_in_little_memory(tmp_path):
    """Once 20 s at 1 kHz went through, 60 s take no more; whole, those are 10 MB of numbers."""
    script = """
        import resource, sys
        from recording_samples import *
        from dvrk_gravity.recording import iterate_recording, save_recording
        def parts(count):
            for k in range(count):
                time = wave(10_000, rate=1000.0).time + 10 * k
                yield wave(10_000, rate=1000.0, time=time)
        def there_and_back(name, count):
            save_recording(parts(count), name + "3", "sqlite3", TOPIC)
            save_recording(iterate_recording(name + "3"), name + ".csv", "mcap", TOPIC)
            save_recording(iterate_recording(name + ".csv"), name + "m", "mcap", TOPIC)
            assert sum(len(part) for part in iterate_recording(name + "m")) == count * 10_000
            return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        few = there_and_back(sys.argv[1] + "/few", 2)
        print(there_and_back(sys.argv[1] + "/many", 6) - few)
    """
    env = {"PYTHONPATH": ":".join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", textwrap.dedent(script), tmp_path]
    grown = float(subprocess.run(command, capture_output=True, check=True, env=env).stdout)
    assert grown < 5.0


@pytest.mark.parametrize("name", ["bags/mtm_dynamic_sqlite3", "bags/mtm_dynamic_mcap"])
def test_measured_bags_agree_with_the_measured_csv(name):
    bag = Recording.load(shared_data(name))
    csv = Recording.load(shared_data("mtm_dynamic_30s_200hz.csv"), coordinates="actuator")
    assert (len(bag), bag.invalid, bag.repeated) == (5999, 0, 0)
    assert np.array_equal(bag.time, csv.time)
    to_joint = np.eye(7)
    to_joint[2, 1], to_joint[3, 1], to_joint[3, 2] = -1.0, 0.6697, -0.6697
    # The CSV is rounded to nine digits.
    np.testing.assert_allclose(bag.position, csv.position @ to_joint.T, atol=1e-8)
    np.testing.assert_allclose(bag.velocity, csv.velocity @ to_joint.T, atol=1e-7)
    np.testing.assert_allclose(bag.effort @ to_joint, csv.effort, atol=1e-8)


def test_reading_is_quick(tmp_path):
    """Measured: 4 us a message and 7 us a CSV row; the bounds leave room for a busy machine."""
    recording = wave(20_000)
    recording.save(tmp_path / "bag", "mcap")
    recording.save(tmp_path / "a.csv")
    for path, limit in ((tmp_path / "bag", 40e-6), (tmp_path / "a.csv", 70e-6)):
        started = time.process_time()
        Recording.load(path)
        assert (time.process_time() - started) / len(recording) < limit


def test_parts_with_other_columns_are_refused(tmp_path):
    parts = [wave(5), wave(5, effort=None)]
    with pytest.raises(RecordingError, match="columns change"):
        save_recording(parts, tmp_path / "a.csv", "mcap", TOPIC)
    assert list(tmp_path.iterdir()) == []
