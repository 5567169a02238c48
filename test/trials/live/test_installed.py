"""Every installed executable, in the install space that colcon makes: its help and its example."""

from __future__ import annotations

import os
import pkgutil
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from support import CONFIG, REPOSITORY, executables

from dvrk_gravity.command_line import VERBS
from dvrk_gravity.ros import PRIVATE, Client, private_domain
from testing.world import COARSE, World

EXECUTABLES = executables()
NODES = sorted(verb for verb, (name, _) in VERBS.items() if name.startswith("dvrk_gravity.ros."))
# These drive an arm for minutes; the demonstration is started in a test of its own. `convert` needs
# a console's file, `get` and `set` a node, `fleet` and `history` many recordings.
ELSEWHERE = {
    "calibrate", "collect", "convert", "demo", "excite", "fleet", "get", "history", "set",
}  # fmt: skip
# What keeps an example short: the search among all effects takes most of an identification.
QUICK = {
    "identify": ["--terms", "coulomb_friction,viscous_friction"],
    "plan": ["--time", "1", "--duration", "8"],
}


def examples(verbs: list[str]) -> list[tuple[str, str]]:
    """Return (verb, words): the README's examples, of a verb that it shows none of the help's."""
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    shown: dict[str, list[str]] = {}
    for verb, words in re.findall(r"^ +ros2 run dvrk_gravity (\S+) ?(.*)$", text, re.MULTILINE):
        shown.setdefault(verb, []).append(words.split(" # ")[0].strip())

    def of_its_help(verb: str) -> str:
        example = pkgutil.resolve_name(VERBS[verb][0]).EXAMPLE.splitlines()[0]
        return str(example.split(f"{verb} ", 1)[1])

    return [(verb, words) for verb in verbs for words in shown.get(verb) or [of_its_help(verb)]]


@dataclass(frozen=True)
class Installed:
    """An install space, and a folder with the files that the examples name."""

    prefix: Path
    folder: Path

    def start(self, verb: str, *words: str) -> subprocess.Popen[str]:
        site = next(self.prefix.glob("lib/python3*/site-packages"))
        path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
        return subprocess.Popen(
            [self.prefix / "lib" / "dvrk_gravity" / verb, *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": path, "AMENT_PREFIX_PATH": str(self.prefix)},
            start_new_session=True,
        )

    def call(self, verb: str, *words: str) -> tuple[int, str]:
        process = self.start(verb, *words)
        output, _ = process.communicate(timeout=600)
        return process.returncode, output


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Installed:
    pytest.importorskip("colcon_core")
    workspace = tmp_path_factory.mktemp("workspace")
    built = subprocess.run(
        [sys.executable, "-m", "colcon", "--log-base", workspace / "log", "build",
         "--paths", REPOSITORY, "--packages-select", "dvrk_gravity",
         "--build-base", workspace / "build", "--install-base", workspace / "install"],
        capture_output=True, text=True, check=False, cwd=workspace,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    folder = workspace / "work"
    (folder / "out" / "why").mkdir(parents=True)
    world = World.draw(5, step=COARSE)
    for name, seed in (("my_bag", 3), ("another_bag", 4), ("a_third_bag", 5)):
        world.record(seed, 1, duration=9.0).save(folder / name)
    for name in ("my_arm.yaml", "identified.yaml", "out/why/extended_model.yaml"):
        world.model().save(folder / name)
    (folder / "config").symlink_to(CONFIG)
    return Installed(workspace / "install" / "dvrk_gravity", folder)


def test_the_declared_executables_alone_are_installed_and_their_help_shows_an_example(installed):
    found = {path.name for path in (installed.prefix / "lib" / "dvrk_gravity").iterdir()}
    assert found == set(EXECUTABLES)
    (site,) = installed.prefix.glob("lib/python3*/site-packages")
    names = {path.name for path in site.iterdir() if path.suffix != ".egg-info"}
    assert names == {"dvrk_gravity"}
    for verb in EXECUTABLES:
        status, output = installed.call(verb, "--help")
        assert status == 0, output
        assert "example:" in output, verb


def test_the_example_of_every_executable_runs(installed, tmp_path):
    for number, (verb, words) in enumerate(examples(sorted({*EXECUTABLES} - {*NODES, *ELSEWHERE}))):
        # What one example writes, no other reads.
        folder = shutil.copytree(installed.folder, tmp_path / str(number), symlinks=True)
        own = replace(installed, folder=folder)
        status, output = own.call(verb, *shlex.split(words), *QUICK.get(verb, []))
        assert status == 0, (verb, words, output)


def test_the_example_of_every_node_starts_and_ends_with_ctrl_c(installed):
    for verb, words in examples(NODES):
        # The help's example names a model as a launch file finds it; here it lies in config/.
        words = words.replace("--params-file mtmr", "--params-file config/mtmr")
        words = words.replace("/MTMR", PRIVATE)  # which an arm may have
        with private_domain(), Client() as client:
            process = installed.start(verb, *shlex.split(words))
            try:
                client.wait(
                    lambda verb=verb, process=process: (
                        process.poll() is not None or verb in client.node.get_node_names()
                    ),
                    f"the node {verb}", 60.0,
                )  # fmt: skip
            finally:
                process.send_signal(signal.SIGINT)
                output, _ = process.communicate(timeout=60)
        assert process.returncode == 0, (verb, words, output)


def runs(pid: int) -> bool:
    """Return whether a process has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9), (None, 141)]
)
def test_the_demonstration_starts_its_nodes_and_ends_with_them(installed, number, status):
    """Also with whoever reads its output (``None``)."""
    (words,) = (words for _, words in examples(["demo"]))
    process = installed.start("demo", *shlex.split(words))
    assert process.stdout is not None
    try:
        assert any("three processes" in line for line in process.stdout)
        started = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    finally:
        if number is None:
            process.stdout.close()
        else:
            process.send_signal(number)
            process.stdout.read()
        assert process.wait(60) == status
        process.stdout.close()
    assert len(started) == 3
    end = time.monotonic() + 15.0
    while left := [child for child in started if runs(int(child))]:
        assert number == signal.SIGKILL, left  # of all else nothing is left
        assert time.monotonic() < end, left
        time.sleep(0.01)
