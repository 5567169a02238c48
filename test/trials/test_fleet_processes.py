"""A fleet on clusters of real processes, some of which are killed in the middle."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from fleet_units import work_for_a_moment
from support import REPOSITORY

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.fleet import (
    ArmEntry,
    EngineLostError,
    FleetPlan,
    Manifest,
    Store,
    Summary,
    client_of,
    run_fleet,
    table,
)

ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": f"{REPOSITORY}{os.pathsep}{Path(__file__).parent}",
    "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
    "DASK_DISTRIBUTED__SCHEDULER__WORKER_SATURATION": "1.0",
}


class Cluster:
    """A scheduler and workers, started as a site starts them."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._folder = stack, folder
        log = folder / "scheduler.log"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0",
                                     "--no-dashboard", log=log)  # fmt: skip
        until(lambda: "Scheduler at" in log.read_text())
        self.address = re.search(r"tcp://127.0.0.1:\d+", log.read_text())[0]
        self.workers: list[subprocess.Popen] = []

    def add_worker(self, *options: str) -> None:
        log = self._folder / f"worker-{len(self.workers)}.log"
        self.workers.append(self._start("worker", self.address, "--nthreads", "1",
                                        "--no-dashboard", *options, log=log))  # fmt: skip

    def _start(self, *words: str, log: Path) -> subprocess.Popen:
        stream = self._stack.enter_context(log.open("w"))
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words], stdout=stream, stderr=stream, env=ENVIRONMENT,
            cwd=self._folder, start_new_session=True,
        )  # fmt: skip
        self._stack.callback(end, process)
        return process


def end(process: subprocess.Popen) -> None:
    """End a process and those that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def until(condition, seconds: float = 60.0) -> None:
    limit = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.05)


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    with ExitStack() as stack:
        yield Cluster(stack, folder)


@pytest.fixture
def fleet(tmp_path: Path) -> Manifest:
    """Ten recordings of an arm that has a model."""
    (tmp_path / "model.yaml").write_text("a model")
    for number in range(10):
        (tmp_path / f"2025-01-{number + 1:02}.csv").write_text("0.4")
    entry = ArmEntry("1", "ecm", (str(tmp_path / "*.csv"),), str(tmp_path / "model.yaml"))
    return Manifest((entry,))


def run(manifest: Manifest, out: Path, address: str, lines: list[str]) -> Summary:
    planned = FleetPlan.of(manifest, Store.open(out))
    with client_of(address, 0) as client:
        return run_fleet(planned, client, lines.append, lambda done: None, work_for_a_moment)


def kill_when(path: Path, count: int, process: subprocess.Popen) -> threading.Thread:
    """Kill a process, and those that it started, when so many results are there."""

    def watch() -> None:
        until(lambda: path.is_dir() and len(list(path.glob("*.parquet"))) >= count)
        end(process)

    thread = threading.Thread(target=watch)
    thread.start()
    return thread


def test_a_worker_that_is_killed_in_the_middle_loses_nothing(fleet, tmp_path):
    out, lines = tmp_path / "out", list[str]()
    with cluster(tmp_path) as its:
        its.add_worker()
        its.add_worker()
        thread = kill_when(out / "results", 2, its.workers[0])
        summary = run(fleet, out, its.address, lines)
        thread.join()
    assert (summary.verdicts, lines) == ({"explained": 10}, [])
    assert table(out, ("recording",)).num_rows == 10


def test_a_scheduler_that_is_killed_loses_nothing_and_nothing_is_done_twice(fleet, tmp_path):
    out = tmp_path / "out"
    with cluster(tmp_path) as its:
        its.add_worker()
        thread = kill_when(out / "results", 3, its.scheduler)
        with pytest.raises(EngineLostError, match="what is done is kept"):
            run(fleet, out, its.address, [])
        thread.join()
    before = table(out, ("recording",)).num_rows
    assert 3 <= before < 10
    done = [path.name for path in tmp_path.glob("*.log") if path.name.startswith("2025")]
    with cluster(tmp_path) as its:
        its.add_worker()
        summary = run(fleet, out, its.address, [])
        again = run(fleet, out, its.address, [])
    assert (summary.skipped, summary.done) == (before, 10 - before)
    assert (again.skipped, again.done) == (10, 0)
    assert table(out, ("recording",)).num_rows == 10
    # Done twice is at most the one that was under way when the scheduler went.
    twice = [path for path in tmp_path.glob("2025*.log") if len(path.read_text().split()) > 1]
    assert len(twice) <= 1
    assert len(done) >= before


def test_what_takes_down_its_workers_or_all_memory_is_reported_and_the_rest_finishes(
    fleet, tmp_path
):
    for day, what in (("01", "crash"), ("04", "memory")):
        (tmp_path / f"2025-01-{day}.csv").write_text(what)
    lines = list[str]()
    with cluster(tmp_path) as its:
        its.add_worker("--memory-limit", "500MB")
        its.add_worker("--memory-limit", "500MB")
        summary = run(fleet, tmp_path / "out", its.address, lines)
    assert summary.verdicts == {"explained": 8, "lost": 2}
    assert sorted(line.partition(": ")[0][-14:] for line in lines) == [
        "2025-01-01.csv",
        "2025-01-04.csv",
    ]
    assert all("its worker died" in line for line in lines)


def test_two_fleets_on_one_machine_are_not_in_each_other_s_way():
    with client_of(None, 1) as first, client_of(None, 1) as second:
        assert first.scheduler_info()["address"] != second.scheduler_info()["address"]


def test_no_scheduler_at_an_address_is_a_line():
    address = "tcp://127.0.0.1:9"
    with pytest.raises(ConfigError, match=r"--scheduler.*dask scheduler"), client_of(address, 0):
        pass
