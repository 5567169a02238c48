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
from test_console import synthetic, write
from test_processes import runs

from dvrk_gravity.command_line import VERBS
from dvrk_gravity.ros import PRIVATE
from testing.world import COARSE, World

EXECUTABLES = executables()
NODES = sorted(verb for verb, (name, _) in VERBS.items() if name.startswith("dvrk_gravity.ros."))
# These drive an arm for minutes; the demonstration is started in a test of its own.
DRIVE_AN_ARM = {"calibrate", "collect", "demo", "excite"}
# What keeps an example short: the search among all effects takes most of an identification.
QUICK = {
    "identify": ["--terms", "coulomb_friction,viscous_friction"],
    "plan": ["--time", "1", "--duration", "8"],
}


def of_the_readme() -> dict[str, list[str]]:
    """Return the README's lines that run an executable, by verb; comments are left out."""
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    lines = re.findall(r"^ +ros2 run dvrk_gravity (\S+) ?(.*)$", text, re.MULTILINE)
    found: dict[str, list[str]] = {}
    for verb, words in lines:
        found.setdefault(verb, []).append(words.split(" # ")[0].strip())
    return found


def of_its_help(verb: str) -> str:
    """Return the words after the verb in the example that its help shows."""
    return pkgutil.resolve_name(VERBS[verb][0]).EXAMPLE.splitlines()[0].split(f"{verb} ", 1)[1]


def examples(verbs: list[str]) -> list[tuple[str, str]]:
    """Return (verb, words): the README's examples, of a verb that it shows none of the help's."""
    shown = of_the_readme()
    return [(verb, words) for verb in verbs for words in shown.get(verb) or [of_its_help(verb)]]


@dataclass(frozen=True)
class Installed:
    """An install space, and a folder with the files that the examples name; each gets a copy."""

    prefix: Path
    folder: Path

    def copied(self, folder: Path) -> Installed:
        """Return the same with files of one's own: what one example writes, no other reads."""
        return replace(self, folder=shutil.copytree(self.folder, folder / "work", symlinks=True))

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
        output, _ = process.communicate(timeout=120)
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
    folder.mkdir()
    world = World.draw(5, step=COARSE)
    for name, seed in (("my_bag", 3), ("another_bag", 4), ("a_third_bag", 5)):
        world.record(seed, 1, duration=9.0).save(folder / name)
    (folder / "out" / "why").mkdir(parents=True)
    for name in ("my_arm.yaml", "identified.yaml", "out/why/extended_model.yaml"):
        world.model().save(folder / name)
    write(folder, synthetic())
    (folder / "config").symlink_to(CONFIG)
    return Installed(workspace / "install" / "dvrk_gravity", folder)


def test_all_and_only_the_declared_executables_are_installed(installed):
    found = {path.name for path in (installed.prefix / "lib" / "dvrk_gravity").iterdir()}
    assert found == set(EXECUTABLES)


def test_nothing_but_the_package_is_importable_from_the_installation(installed):
    (site,) = installed.prefix.glob("lib/python3*/site-packages")
    names = {path.name for path in site.iterdir() if path.suffix != ".egg-info"}
    assert names == {"dvrk_gravity"}


@pytest.mark.parametrize("verb", EXECUTABLES)
def test_help_of_an_executable_shows_an_example(verb, installed):
    status, output = installed.call(verb, "--help")
    assert status == 0, output
    assert "example:" in output


@pytest.mark.parametrize(
    ("verb", "words"), examples(sorted(set(EXECUTABLES) - {*NODES, *DRIVE_AN_ARM})), ids=str
)
def test_the_example_of_an_executable_runs(verb, words, installed, domain, tmp_path):
    status, output = installed.copied(tmp_path).call(
        verb, *shlex.split(words), *QUICK.get(verb, [])
    )
    assert status == 0, output


@pytest.mark.parametrize(("verb", "words"), examples(NODES), ids=str)
def test_the_example_of_a_node_starts_and_ends_with_ctrl_c(verb, words, installed, domain):
    from dvrk_gravity.ros import Client

    # The help's example names a model as a launch file finds it; here it lies in config/.
    words = words.replace("--params-file mtmr", "--params-file config/mtmr")
    words = words.replace("/MTMR", PRIVATE)  # which an arm may have
    process = installed.start(verb, *shlex.split(words))
    try:
        with Client() as client:
            client.wait(
                lambda: process.poll() is not None or verb in client.node.get_node_names(),
                f"the node {verb}",
            )
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=20)
    assert process.returncode == 0, output


# SIGTERM's 143 test_processes says of what they share.
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_the_demonstration_starts_its_nodes_and_ends_with_them(installed, number, status):
    (words,) = (words for _, words in examples(["demo"]))
    process = installed.start("demo", *shlex.split(words))
    assert process.stdout is not None
    try:
        began = any("three processes" in line for line in process.stdout)
        started = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    finally:
        process.send_signal(number)
        output, _ = process.communicate(timeout=60)
    assert began, output
    assert process.returncode == status, output
    assert len(started) == 3
    ended = time.monotonic()
    while left := [child for child in started if runs(int(child))]:
        assert number == signal.SIGKILL, left  # of all else nothing is left
        assert time.monotonic() < ended + 10.0, left
        time.sleep(0.01)


@pytest.mark.slow  # test_processes and test_command_line say it of what they share
def test_the_demonstration_ends_with_whoever_reads_its_output(installed):
    (words,) = (words for _, words in examples(["demo"]))
    process = installed.start("demo", *shlex.split(words))
    assert process.stdout is not None
    with process:
        assert any("three processes" in line for line in process.stdout)
        started = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.stdout.close()
        assert process.wait(60) == 128 + signal.SIGPIPE
    assert len(started) == 3
    assert not [child for child in started if runs(int(child))]
