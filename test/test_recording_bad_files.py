"""Files that cannot be used are refused in one line: file, place, column, value."""

import shutil

import pytest
from recording_samples import START, joint_state, wave, write_messages

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import Recording, read_joint_states

HEAD = "time,outer_yaw.position,outer_yaw.effort\n"

TWICE = 2 * "".join(f"{k / 10},1,{k}\n" for k in range(200))

# What is wrong: the file, and tokens of the refusal.
BAD_CSV = {
    "empty": ("", "empty"),
    "no header": ("0,1,2\n1,2,3\n", "line 1"),
    "unknown quantity": ("outer_yaw.heat\n0\n", "line 1: column 1 is 'outer_yaw.heat'"),
    "twice": ("time,time,outer_yaw.position\n0,1,0\n", "line 2: column 'time'"),
    "no joint": ("time\n0\n", "line 1"),
    "no position": ("time,outer_yaw.effort\n0,1\n", "line 1: no column outer_yaw.position"),
    "two directions": ("outer_yaw.position,direction,outer_yaw.direction\n0,1,1\n", "line 1"),
    "text": (HEAD + "0,1,2\n1,two,3\n", "line 3: outer_yaw.position is 'two'"),
    "nan": (HEAD + "0,nan,2\n\n1,,2\n2,1e300,2\n", "no position"),
    "infinity": (HEAD + "inf,1,2\n", "1 of 1 samples without a time"),
    "cut off": (HEAD + "0,1,2\n1,2", "line 3: 2 values, expected 3"),
    "time goes back": (HEAD + TWICE, "line 202: time goes back by 19.9 s"),
    "time stands still": (HEAD + 99 * "5,1,2\n", "98 of 99 lines"),
    "nanoseconds": (HEAD + "1530000000000,1,2\n5,1,2\n", "time is 1.53e+12, expected seconds"),
    "direction": ("outer_yaw.position,direction\n0,1\n1,0.5\n", "outer_yaw.direction is 0.5"),
}


def refused(path, expected, case="", **options):
    """Assert that a file is refused in one line that begins with its path and holds a token."""
    with pytest.raises(RecordingError) as caught:
        Recording.load(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: "), case
    assert expected in message, (case, message)
    assert "\n" not in message, case


def test_a_csv_file_that_cannot_be_used_is_refused_with_its_place(tmp_path):
    for case, (text, expected) in BAD_CSV.items():
        path = tmp_path / "bad.csv"
        path.write_text(text)
        refused(path, expected, case)


def test_line_numbers_hold_beyond_the_first_part_of_a_file(tmp_path):
    path = tmp_path / "long.csv"
    rows = [f"{k},1,{'x' if k >= 40_000 else 2}\n" for k in range(50_000)]
    path.write_text(HEAD + "".join(rows))
    refused(path, "line 40002: outer_yaw.effort is 'x'")


def truncate(path, share):
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_bags_of_which_nothing_is_left_are_refused(tmp_path, storage):
    wave(2000).save(tmp_path / "bag", storage)
    (file,) = (p for p in (tmp_path / "bag").iterdir() if p.suffix != ".yaml")
    for share in (0.0001, 0.0):
        truncate(file, share)
        for path in (file, tmp_path / "bag"):
            refused(path, "")
            with pytest.raises(RecordingError):
                list(read_joint_states(path))


def broken(tmp_path):
    """Yield broken files and folders, and tokens of their refusal."""
    for name, content in {"junk.csv": bytes(range(256)), "a.yaml": b"a: 1", "a.db3": b"a"}.items():
        (tmp_path / name).write_bytes(content)
        yield tmp_path / name, ""
    folder = tmp_path / "nothing"
    folder.mkdir()
    yield folder, "metadata.yaml"
    folder = tmp_path / "several"
    wave(10).save(folder)
    (folder / "metadata.yaml").unlink()
    shutil.copy(folder / "several.db3", folder / "copy.db3")
    yield folder, "copy.db3, several.db3"
    folder = tmp_path / "fileless"
    wave(10).save(folder)
    (folder / "fileless.db3").unlink()
    yield folder, "none of its files"
    folder = tmp_path / "flag"
    write_messages(folder, [(START, b"\0\1\0\0\1")], "mcap", "/flag", "std_msgs/msg/Bool")
    yield folder, "/flag (std_msgs"
    for name in ("absent", "absent.csv"):
        yield tmp_path / name, "no such file"


def test_broken_files_and_folders_are_refused(tmp_path):
    for path, expected in broken(tmp_path):
        refused(path, expected)


BAD_MESSAGES = {
    "none": ([], "no JointState messages"),
    "invalid only": (
        [joint_state(0, stamp_ns=0), joint_state(1, stamp_ns=0)],
        "2 of 2 samples with stamp 0",
    ),
    "not CDR": ([(START, b"\xff" * 40)], "message 0 is not a JointState"),
    "cut CDR": ([(START, joint_state(0)[1][:-9])], "message 0 is not a JointState: 7 numbers"),
    "twice": ([joint_state(0, ("outer_yaw",) * 2)], "message 0 names outer_yaw twice"),
    "no position": ([joint_state(0, position=())], "message 0 has 0 position values for 7 names"),
    "time goes back": (
        [(START + k, joint_state(k % 200)[1]) for k in range(400)],
        "message 200: time goes back by 0.199 s",
    ),
    "nan": ([joint_state(0, position=[float("nan")] * 7)], "no position"),
}


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_messages_that_cannot_be_used_are_refused_with_their_number(tmp_path, storage):
    for number, (case, (messages, expected)) in enumerate(BAD_MESSAGES.items()):
        bag = tmp_path / f"bag{number}"
        write_messages(bag, messages, storage)
        refused(bag, expected, case)


STRANGE_MESSAGES = {
    "wrong CDR": (START + 10**7, b"\0\1\0\0rubbish"),
    "a joint goes": joint_state(1, JOINT_NAMES[:6]),
    "velocity goes": joint_state(1, velocity=()),
    "time goes back": joint_state(2, stamp_ns=START - 5),
    "nan": joint_state(1, effort=[0, 0, float("nan"), 0, 0, 0, 0]),
}


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_strange_message_among_others_is_left_out_and_counted(tmp_path, storage):
    for case, message in STRANGE_MESSAGES.items():
        bag = tmp_path / case.replace(" ", "_")
        write_messages(bag, [joint_state(0), message, joint_state(2), joint_state(3)], storage)
        found = Recording.load(bag)
        assert found.position[:, 0].tolist() == [0.0, 0.002, 0.003], case
        assert sum(note.left_out for note in found.notes) == 1, case
