"""Whatever verb is asked, no output is an input, another output, a link or a device."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from dvrk_gravity.__main__ import main
from dvrk_gravity.command_line import VERBS

# Nodes write nothing.
MAKE_FOLDERS = ("calibrate", "demo", "diagnose", "fleet")  # with theirs
WITHOUT_OUTPUT = {"compensator", "get", "set", "simulator", "watchdog"}
BESIDE_INPUT = {"history"}  # in the folder that it reads, under names of its own


@dataclass(frozen=True)
class Use:
    """How a verb is called, and which of its outputs is in question.

    In ``words``, ``{out}`` is that output, ``{in}`` an input, ``{x.y}`` a file of the folder.
    """

    verb: str
    words: str
    inputs: tuple[str, ...]  # what it reads
    others: tuple[str, ...] = ()  # what it writes besides {out}
    suffix: str = ""  # how the output's name ends
    below: str = ""  # the output, where its name is fixed and words name its folder ``d``


# None of the inputs holds what its name promises: whatever reads one fails with another error.
USES = {
    "convert's recording": Use("convert", "{r.csv} {out}", ("r.csv",), suffix=".csv"),
    "convert's model": Use("convert", "{c.json} {out}", ("c.json",), suffix=".yaml"),
    "replay's bag": Use("replay", "{bag} --model {m.yaml} --out {out}", ("bag", "m.yaml")),
    "replay's JSON": Use(
        "replay", "{bag} --model {m.yaml} --out {new} --json {out}", ("bag", "m.yaml"), ("new",)
    ),
    "identify's model": Use(
        "identify",
        "{r.csv} {bag} --validate {v.csv} --arm {a.yaml} --report {o.html} --json {o.json} "
        "--out {out}",
        ("r.csv", "bag", "v.csv", "a.yaml"), ("o.html", "o.json"),
    ),
    "identify's JSON": Use(
        "identify", "{r.csv} --arm {a.yaml} --out {o.yaml} --json {out}",
        ("r.csv", "a.yaml"), ("o.yaml", "o.html"),
    ),
    "evaluate's JSON": Use(
        "evaluate", "{r.csv} {bag} --model {m.yaml} --json {out}", ("r.csv", "bag", "m.yaml")
    ),
    "monitor's JSON": Use(
        "monitor", "{r.csv} {bag} --model {m.yaml} --json {out}", ("r.csv", "bag", "m.yaml")
    ),
    "diagnose's folder": Use(
        "diagnose", "{r.csv} --model {m.yaml} --out {out}", ("r.csv", "m.yaml")
    ),
    "diagnose's findings": Use(
        "diagnose", "{in} --model {m.yaml} --out {d}", ("m.yaml",), below="d/findings.json"
    ),
    "diagnose's report": Use(
        "diagnose", "{r.csv} --model {in} --out {d}", ("r.csv",), below="d/report.html"
    ),
    "fleet's folder": Use("fleet", "{m.yaml} --out {out}", ("m.yaml",)),
    "demo's folder": Use("demo", "--model {m.yaml} --out {out}", ("m.yaml",)),
    "demo's bag": Use("demo", "--model {in} --out {d}", (), below="d/bag"),
    "plan's plan": Use(
        "plan", "--arm {a.yaml} --model {m.yaml} --limits {l.yaml} --out {out}",
        ("a.yaml", "m.yaml", "l.yaml"), suffix=".yaml",
    ),
    "collect's bag": Use(
        "collect", "{p.yaml} --model {m.yaml} --limits {l.yaml} --out {out}",
        ("p.yaml", "m.yaml", "l.yaml"),
    ),
    "collect's limits": Use(
        "collect", "--arm {a.yaml} --from {r.csv} --teach {out}", ("a.yaml", "r.csv"),
        suffix=".yaml",
    ),
    "calibrate's folder": Use(
        "calibrate", "--arm {a.yaml} --limits {l.yaml} --simulated --out {out}",
        ("a.yaml", "l.yaml"),
    ),
    "excite's bag": Use("excite", "--arm {a.yaml} --out {out}", ("a.yaml",)),
    "newton-euler's JSON": Use("newton-euler", "{n.yaml} --json {out}", ("n.yaml",)),
}  # fmt: skip


class Folder:
    """A folder of inputs, the calls that are to be refused, and whether all is as it was."""

    def __init__(self, folder: Path, use: Use) -> None:
        """Make the inputs."""
        self.folder, self.use = folder, use
        folder.mkdir(parents=True, exist_ok=True)
        for name in use.inputs:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if name == "bag":
                path.mkdir()
                path /= "metadata.yaml"
            path.write_text(f"the content of {name}")

    def contents(self) -> dict[str, tuple[int, bytes]]:
        return {
            str(path): (path.lstat().st_mode, path.read_bytes() if path.is_file() else b"")
            for path in sorted(self.folder.rglob("*"))
        }

    @property
    def output(self) -> Path:
        """What the output in question may be called."""
        return self.folder / (self.use.below or f"output{self.use.suffix}")

    def refuses(
        self, capsys: pytest.CaptureFixture[str], output: str | Path, read: str | Path = "read.csv"
    ) -> str:
        """Run the verb with an output, and something to read; return its one line."""
        paths = {"{out}": output, "{in}": self.folder / read}
        words = [
            str(paths.get(word, self.folder / word[1:-1])) if word.startswith("{") else word
            for word in self.use.words.split()
        ]
        before = self.contents()
        assert main([self.use.verb, *words]) == 2
        assert self.contents() == before
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1, lines
        return lines[0]


def uses(folder: Path, condition: Callable[[Use], object] = lambda use: True) -> Iterator[Folder]:
    """Yield a folder of inputs for each of some uses, in which its verb runs."""
    here = Path.cwd()
    try:
        for number, use in enumerate(use for use in USES.values() if condition(use)):
            case = Folder(folder / str(number), use)
            case.output.parent.mkdir(parents=True, exist_ok=True)
            os.chdir(case.folder)
            yield case
    finally:
        os.chdir(here)


def test_every_verb_is_tried():
    assert {use.verb for use in USES.values()} | WITHOUT_OUTPUT | BESIDE_INPUT == set(VERBS)


def test_no_output_is_an_input_by_any_name(tmp_path, capsys):
    """A hard link is the same file, and so is one reached through a linked folder."""
    for case in uses(tmp_path, lambda use: not use.below):
        (case.folder / "linked").symlink_to(case.folder)
        for name in case.use.inputs:
            spelled = [Path(name), Path(f"../{case.folder.name}/{name}"), Path(f"linked/{name}")]
            if name == "bag":
                spelled += [Path("bag/metadata.yaml"), Path(f"bag/new{case.use.suffix}")]
            else:
                os.link(case.folder / name, case.output)
                spelled.append(case.output)
            for output in spelled:
                assert "is read" in case.refuses(capsys, output), (case.use, output)
            case.output.unlink(missing_ok=True)
    for case in uses(tmp_path / "below", lambda use: use.below):
        given = case.output
        if not given.suffix:  # a bag that is replaced
            given.mkdir()
            given /= "model.yaml"
        given.write_text("the content of an input")
        assert "is read" in case.refuses(capsys, case.output, given), case.use


def test_no_output_is_another_output_or_none_or_in_no_folder(tmp_path, capsys):
    for case in uses(tmp_path, lambda use: not use.below):
        for name in case.use.others:
            assert "is written" in case.refuses(capsys, case.folder / name), case.use
        # The words of a script whose variable is empty: not the working directory.
        assert re.search(r"(OUT|--\w+): got", case.refuses(capsys, "")), case.use
        if case.use.verb not in MAKE_FOLDERS:
            absent = case.folder / "none" / f"o{case.use.suffix}"
            assert "existing folder" in case.refuses(capsys, absent), case.use


def test_no_output_is_a_link_or_a_device(tmp_path, capsys):
    for case in uses(tmp_path):
        target = case.folder / f"elsewhere{case.use.suffix}"
        case.output.symlink_to(target)  # to nothing: what is written would appear there
        assert "link" in case.refuses(capsys, case.output), case.use
        target.write_text("what another file holds")
        assert "link" in case.refuses(capsys, case.output), case.use
        case.output.unlink()
        # A pipe stands for all that are neither file nor folder: a test may not risk /dev/null.
        os.mkfifo(case.output)
        assert "pipe" in case.refuses(capsys, case.output), case.use
