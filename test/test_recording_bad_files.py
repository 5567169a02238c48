"""Files that cannot be used end in one clear line of the package's own errors."""

import random
import shutil

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recording_samples import ARM, START, TOPIC, joint_state, shared_data, wave, write_messages
from support import examples

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import DvrkGravityError, RecordingError
from dvrk_gravity.recording import (
    JOINT_STATE,
    BagReader,
    BagWriter,
    CdrError,
    JointStateLayout,
    Recording,
    check,
    prepare,
    read_joint_states,
)

HEAD = "time,outer_yaw.position,outer_yaw.effort\n"

TWICE = 2 * "".join(f"{k / 10},1,{k}\n" for k in range(200))

BAD_CSV = {
    "empty": ("", "is empty, expected a CSV header"),
    "blank": ("\n\n", "is empty, expected a CSV header"),
    "header only": (HEAD, "has a header but no rows"),
    "header and blank lines": (HEAD + "\n\n", "has a header but no rows"),
    "no header": ("0,1,2\n1,2,3\n", "line 1: has no header, expected names of columns"),
    "nameless joint": ("time,.position\n0,1\n", "line 1: column 2 is '.position'"),
    "unknown quantity": ("outer_yaw.heat\n0\n", "line 1: column 1 is 'outer_yaw.heat', expected"),
    "twice": ("time,time,outer_yaw.position\n0,1,0\n", "line 2: column 'time' appears twice"),
    "no joint": ("time\n0\n", "line 1: no <joint>.position column"),
    "no position": ("time,outer_yaw.effort\n0,1\n", "line 1: no column outer_yaw.position"),
    "one effort": (
        "outer_yaw.position,wrist_roll.position,wrist_roll.effort\n0,1,2\n",
        "line 1: no column outer_yaw.effort",
    ),
    "two directions": (
        "outer_yaw.position,direction,outer_yaw.direction\n0,1,1\n",
        "line 1: both direction and <joint>.direction",
    ),
    "text": (HEAD + "0,1,2\n1,two,3\n", "line 3: outer_yaw.position is 'two', expected a finite"),
    "nan": (HEAD + "0,nan,2\n\n1,nan,2\n", "no position is a finite number"),
    "infinity": (HEAD + "inf,1,2\n", "1 of 1 samples without a time, left out"),
    "absurd": (HEAD + "0,1e300,2\n", "no position is a finite number"),
    "empty cell": (HEAD + "0,,2\n1,,3\n", "no position is a finite number"),
    "ragged": (HEAD + "0,1,2\n1,2\n2,3,4\n", "line 3: 2 values, expected 3"),
    "all ragged": (HEAD + "0,1\n1,2\n", "line 2: 2 values, expected 3"),
    "cut off": (HEAD + "0,1,2\n1,2", "line 3: 2 values, expected 3"),
    "time goes back": (HEAD + TWICE, "line 202: time goes back by 19.9 s and stays there"),
    "time goes back after a blank": (HEAD + "\n" + TWICE, "line 203: time goes back"),
    "time stands still": (HEAD + 99 * "5,1,2\n", "time stands still: 98 of 99 lines repeat"),
    "nanoseconds": (HEAD + "1530000000000,1,2\n5,1,2\n", "time is 1.53e+12, expected seconds"),
    "direction": ("outer_yaw.position,direction\n0,1\n1,0.5\n", "outer_yaw.direction is 0.5"),
}


@pytest.mark.parametrize("case", BAD_CSV)
def test_bad_csv_is_told_in_one_line_with_its_place(tmp_path, case):
    text, expected = BAD_CSV[case]
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(RecordingError) as caught:
        Recording.load(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert expected in message
    assert "\n" not in message


def test_binary_files_and_other_kinds_are_refused(tmp_path):
    (tmp_path / "junk.csv").write_bytes(bytes(range(256)) * 10)
    with pytest.raises(RecordingError, match="is not a text file"):
        Recording.load(tmp_path / "junk.csv")
    (tmp_path / "model.yaml").write_text("a: 1")
    with pytest.raises(RecordingError, match=r"expected a \.csv file, a rosbag2 folder"):
        Recording.load(tmp_path / "model.yaml")
    with pytest.raises(RecordingError, match="no such file"):
        Recording.load(tmp_path / "absent.csv")


def test_line_numbers_hold_beyond_the_first_part_of_a_file(tmp_path):
    path = tmp_path / "long.csv"
    rows = [f"{k},1,2\n" for k in range(50_000)]
    rows[40_000:] = [f"{k},1,x\n" for k in range(40_000, 50_000)]
    path.write_text(HEAD + "".join(rows))
    with pytest.raises(RecordingError, match=r"line 40002: outer_yaw\.effort is 'x'"):
        Recording.load(path)


def truncate(path, share):
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("share", [0.0, 0.0001])
@pytest.mark.parametrize("bare", [False, True])
def test_bags_of_which_nothing_is_left_are_told_in_one_line(tmp_path, storage, share, bare):
    wave(2000).save(tmp_path / "bag", storage)
    (file,) = (p for p in (tmp_path / "bag").iterdir() if p.suffix != ".yaml")
    truncate(file, share)
    path = file if bare else tmp_path / "bag"
    with pytest.raises(RecordingError) as caught:
        Recording.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    with pytest.raises(RecordingError):
        list(read_joint_states(path))


def test_a_measured_bag_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    shutil.copytree(shared_data("bags/mtm_dynamic_mcap"), tmp_path / "bag")
    (file,) = (p for p in (tmp_path / "bag").iterdir() if p.suffix != ".yaml")
    (tmp_path / "bag").chmod(0o755)
    file.chmod(0o644)
    truncate(file, 0.7)
    found = Recording.load(tmp_path / "bag")
    assert 0.6 * 5999 < len(found) < 5999
    assert f"{len(found)} messages read until there" in found.notes[0].text


def bag_folders(tmp_path):
    """Yield broken folders and what is said of them."""
    folder = tmp_path / "nothing"
    folder.mkdir()
    yield folder, "has no metadata.yaml"
    folder = tmp_path / "several"
    wave(10).save(folder)
    (folder / "metadata.yaml").unlink()
    shutil.copy(folder / "several.db3", folder / "copy.db3")
    yield folder, "files of several bags: copy.db3, several.db3; give one file"
    folder = tmp_path / "fileless"
    wave(10).save(folder)
    (folder / "fileless.db3").unlink()
    yield folder, "none of its files exists"
    (tmp_path / "text.mcap").write_text("hello")
    yield tmp_path / "text.mcap", "cut off or damaged"
    (tmp_path / "text.db3").write_text("hello")
    yield tmp_path / "text.db3", "cut off or damaged"
    yield tmp_path / "absent", "no such file or folder"


def test_broken_bag_folders_are_told(tmp_path):
    for path, expected in bag_folders(tmp_path):
        with pytest.raises(RecordingError) as caught:
            Recording.load(path)
        assert str(path) in str(caught.value)
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["a: [", "rosbag2_bagfile_information: 3\n", ""])
def test_a_bag_whose_description_is_none_is_read_without(tmp_path, content):
    wave(10).save(tmp_path / "bag")
    (tmp_path / "bag/metadata.yaml").write_text(content)
    found = Recording.load(tmp_path / "bag")
    assert len(found) == 10
    assert "a metadata.yaml that cannot be read" in found.notes[0].text


def test_bag_without_joint_states_names_what_it_has(tmp_path):
    write_messages(tmp_path / "bag", [(START, b"\0\1\0\0\1")], "mcap", "/flag", "std_msgs/msg/Bool")
    with pytest.raises(RecordingError, match=r"no sensor_msgs/msg/JointState .*/flag \(std_msgs"):
        Recording.load(tmp_path / "bag")
    with pytest.raises(RecordingError, match=r"no JointState topic '/flag'"):
        Recording.load(tmp_path / "bag", topic="/flag")


BAD_MESSAGES = {
    "none": ([], "holds no JointState messages"),
    "invalid only": (
        [joint_state(0, stamp_ns=0), joint_state(1, stamp_ns=0)],
        "2 of 2 samples with stamp 0 (marked invalid), left out; or --time-base receive",
    ),
    "not CDR": ([(START, b"\xff" * 40)], "message 0 is not a JointState"),
    "empty CDR": ([(START, b"")], "message 0 is not a JointState: 0 bytes"),
    "cut CDR": ([(START, joint_state(0)[1][:-9])], "message 0 is not a JointState: 7 numbers at"),
    "no names": ([joint_state(0, ())], "message 0 names joints (none)"),
    "twice": ([joint_state(0, ("outer_yaw",) * 2)], "message 0 names outer_yaw twice"),
    "no position": (
        [joint_state(0, position=())],
        "message 0 has 0 position values for 7 names",
    ),
    "short effort": ([joint_state(0, effort=[1.0])], "message 0 has 1 effort values for 7 names"),
    "time goes back": (
        [(START + k, joint_state(k % 200)[1]) for k in range(400)],
        "stamp of message 200: time goes back by 0.199 s and stays there",
    ),
    "nan": ([joint_state(0, position=[float("nan")] * 7)], "no position is a finite number"),
}


@pytest.mark.parametrize("case", BAD_MESSAGES)
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_bad_messages_are_told_with_their_number(tmp_path, case, storage):
    messages, expected = BAD_MESSAGES[case]
    write_messages(tmp_path / "bag", messages, storage)
    with pytest.raises(RecordingError) as caught:
        Recording.load(tmp_path / "bag")
    assert str(caught.value).startswith(f"{tmp_path / 'bag'}: ")
    assert expected in str(caught.value)


STRANGE_MESSAGES = {
    "wrong CDR": (START + 10**7, b"\0\1\0\0rubbish"),
    "a joint goes": joint_state(1, JOINT_NAMES[:6]),
    "velocity goes": joint_state(1, velocity=()),
    "time goes back": joint_state(2, stamp_ns=START - 5),
    "nan": joint_state(1, effort=[0, 0, float("nan"), 0, 0, 0, 0]),
}


@pytest.mark.parametrize("case", STRANGE_MESSAGES)
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_strange_message_among_others_is_left_out_and_counted(tmp_path, case, storage):
    sent = [joint_state(0), STRANGE_MESSAGES[case], *(joint_state(k) for k in (2, 3))]
    write_messages(tmp_path / "bag", sent, storage)
    found = Recording.load(tmp_path / "bag")
    assert found.position[:, 0].tolist() == [0.0, 0.002, 0.003]
    assert sum(note.count for note in found.notes) == 1


def test_joints_of_another_arm_are_told(tmp_path):
    write_messages(tmp_path / "bag", [joint_state(0, ("a", "b"))])
    (tmp_path / "bad.csv").write_text("time,elbow.position\n0,1\n")
    with pytest.raises(RecordingError, match="message 0 names joints a, b, expected some of: out"):
        Recording.load(tmp_path / "bag", arm=ARM)
    with pytest.raises(RecordingError, match=r"line 1: column 2 is 'elbow.position'.*outer_yaw"):
        Recording.load(tmp_path / "bad.csv", arm=ARM)


def test_writer_refuses_what_it_cannot_write(tmp_path):
    with pytest.raises(RecordingError, match="storage 'zip'"):
        BagWriter(tmp_path / "bag", "zip")
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(TOPIC, JOINT_STATE)
        with pytest.raises(RecordingError, match="'crtk_msgs/msg/X' of /x is not known"):
            bag.add_topic("/x", "crtk_msgs/msg/X")
        with pytest.raises(RecordingError, match=f"topic {TOPIC} is {JOINT_STATE}"):
            bag.add_topic(TOPIC, "std_msgs/msg/Bool")
        with pytest.raises(RecordingError, match="is not a sensor_msgs"):
            bag.write(TOPIC, JOINT_STATE, object(), START)
    with (
        BagReader(tmp_path / "bag") as bag,
        pytest.raises(RecordingError, match=f"no topic '/y', topics in the bag: {TOPIC}"),
    ):
        list(bag.raw("/y"))
    for name in ("a#b", "a?b", "a%20b"):
        with pytest.raises(RecordingError, match="expected a path without any of"):
            wave(9).save(tmp_path / name)
        wave(9).save(tmp_path / name, "mcap")
        assert len(Recording.load(tmp_path / name)) == 9
    for name in ("a.db3", "a.mcap", "a.yaml"):
        with pytest.raises(RecordingError, match=r"expected a \.csv file or the name of a new"):
            wave(9).save(tmp_path / name)


FAST = settings(
    max_examples=examples(25),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
CELLS = st.sampled_from(
    ["0", "1", "-1.5", "1e999", "nan", "", " ", "x", "1e-320", "0x1", "1_0", '"1"', "\0", "é", "#"]
) | st.floats().map(repr)
NAMES = st.sampled_from(
    ["time", "direction", "outer_yaw.position", "outer_yaw.effort", "wrist_roll.position", "", "."]
)
LINES = st.lists(st.lists(CELLS, max_size=4).map(",".join), max_size=6)


def read_or_refused(path):
    """Load a file: any other error than the package's own fails the test."""
    try:
        recording = Recording.load(path)
    except DvrkGravityError as caught:
        said = str(caught)
    else:
        assert np.isfinite(recording.position).all()
        said = "read"
    assert said
    assert "\n" not in said


@FAST
@given(names=st.lists(NAMES, max_size=4), lines=LINES, end=st.sampled_from(["\n", "\r\n", "\r"]))
def test_any_csv_is_read_or_refused(tmp_path, names, lines, end):
    path = tmp_path / "fuzz.csv"
    path.write_text(end.join([",".join(names), *lines]), encoding="utf-8", newline="")
    read_or_refused(path)


@FAST
@given(data=st.binary(max_size=300))
def test_any_bytes_are_refused(tmp_path, data):
    for suffix in (".csv", ".db3", ".mcap"):
        path = tmp_path / f"fuzz{suffix}"
        path.write_bytes(data)
        with pytest.raises(RecordingError):
            Recording.load(path)


@pytest.fixture(scope="module")
def small_bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    for storage in ("sqlite3", "mcap"):
        write_messages(folder / storage, [joint_state(k) for k in range(20)], storage)
    return [folder / "sqlite3/sqlite3.db3", folder / "mcap/mcap.mcap"]


@FAST
@given(seed=st.integers(0, 2**32), count=st.integers(1, 30))
def test_damaged_bags_are_read_or_refused(tmp_path, small_bags, seed, count):
    draw = random.Random(seed)
    for original in small_bags:
        data = bytearray(original.read_bytes())
        for _ in range(count):
            at = draw.randrange(len(data))
            damage = bytes(draw.choice((0, 1, 255, draw.randrange(256))) for _ in range(4))
            kind = draw.randrange(3)
            data[at : at + (0 if kind == 0 else 4)] = b"" if kind == 1 else damage
        path = tmp_path / f"fuzz{original.suffix}"
        path.write_bytes(data)
        read_or_refused(path)


@FAST
@given(
    data=st.binary(max_size=400)
    | st.builds(
        lambda at, new: joint_state(0)[1][:at] + new + joint_state(0)[1][at + len(new) :],
        st.integers(0, 330),
        st.binary(min_size=1, max_size=8),
    )
)
def test_any_message_is_decoded_or_refused(data):
    try:
        layout = JointStateLayout.parse(data)
    except CdrError:
        return
    stamps, values = layout.decode([data])
    assert layout.match([data]).all()
    assert (len(stamps), len(values)) == (1, 3)


@settings(FAST, max_examples=examples(15))
@given(
    rows=st.integers(1, 400),
    seed=st.integers(0, 2**32),
    scale=st.sampled_from([1e-310, 1e-12, 1e-3, 1.0, 1e3, 9e11]),
    rate=st.sampled_from([1e-3, 1.0, 200.0, 1e6]),
)
def test_any_recording_is_checked_and_prepared_or_refused(rows, seed, scale, rate):
    rng = np.random.default_rng(seed)
    shape = (rows, 2)
    fields = {
        name: rng.choice(
            [rng.uniform(-1, 1, shape), np.zeros(shape), np.round(rng.normal(size=shape))]
        )
        for name in ("position", "velocity", "effort")
    }
    fields = {name: np.clip(scale * values, -9e11, 9e11) for name, values in fields.items()}
    fields["position"] = np.clip(fields["position"], -1.5, 1.5)
    time = np.cumsum(rng.choice([1.0, 1.0, 1.0, 10.0], rows)) / rate
    recording = Recording(("outer_yaw", "wrist_roll"), time, **fields)
    check(recording)
    try:
        prepared = prepare(recording, cutoff=rate / 10)
    except DvrkGravityError:
        return
    for segment in prepared.segments:
        assert np.isfinite(segment.acceleration).all()
