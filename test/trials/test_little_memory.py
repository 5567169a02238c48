"""Files of any size in little memory; disks that fill up, writers that are killed, pipes."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import textwrap
from functools import partial

import pytest
from support import REPOSITORY

from dvrk_gravity import TorqueModel
from dvrk_gravity.console import ConsoleFile
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.recording import Recording, read_joint_states


def ran(script: str, *words: object, **options) -> subprocess.CompletedProcess:
    """Run a script beside the tests' modules."""
    environment = {**os.environ, "PYTHONPATH": ":".join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", textwrap.dedent(script), *map(str, words)]
    return subprocess.run(
        command, capture_output=True, text=True, cwd=REPOSITORY, env=environment, check=False,
        timeout=120, **options,
    )  # fmt: skip


def test_a_killed_writer_has_its_earlier_seconds_on_disk(tmp_path):
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


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_full_disk_is_one_error_and_leaves_no_finished_bag(tmp_path, storage):
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
    done = ran(script, tmp_path / "bag", storage)
    assert f"{tmp_path}/bag: " in done.stdout
    assert (done.stdout.count("\n"), done.returncode) == (1, 0)
    assert list(tmp_path.iterdir()) == []


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
    assert float(ran(script, tmp_path).stdout) < 5.0


LOAD = """
    import sys
    from dvrk_gravity.errors import DvrkGravityError
    from dvrk_gravity.files import json_file, yaml_file
    from dvrk_gravity.recording import Recording
    read = {"csv": Recording.load, "yaml": yaml_file.load, "json": json_file.load}
    try:
        read[sys.argv[1].rpartition(".")[2]](sys.argv[1])
    except DvrkGravityError as error:
        print(error)
"""


@pytest.mark.parametrize(
    ("name", "head", "token"),
    [
        ("r.csv", "time,outer_yaw.position\n0,1\n1,2\n\n", "line 5"),
        ("r.csv", "", "line 1"),
        ("m.yaml", "a: ", "m.yaml"),
        ("m.json", '{"a": ', "m.json"),
    ],
)
def test_a_line_of_a_gigabyte_takes_little_memory(name, head, token, tmp_path):
    path = tmp_path / name
    with path.open("w") as file:
        file.write(head)
        file.truncate(10**9)  # zeros that take no room on the disk
    little = partial(resource.setrlimit, resource.RLIMIT_AS, (2 * 10**9, 2 * 10**9))
    result = ran(LOAD, path, preexec_fn=little)
    assert result.returncode == 0, result.stderr[-500:]
    assert token in result.stdout
    assert len(result.stdout) < 1000


def test_a_pipe_is_refused_unread(tmp_path):
    for name in ("a.csv", "a.db3", "a.mcap", "a.yaml", "a.json"):
        os.mkfifo(tmp_path / name)
        read = {"yaml": TorqueModel.load, "json": ConsoleFile.load}
        with pytest.raises(DvrkGravityError, match="a pipe or device"):
            read.get(name.partition(".")[2], Recording.load)(tmp_path / name)
