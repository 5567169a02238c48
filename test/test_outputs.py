"""No verb writes over what it reads, over its other outputs, through a link or to a device."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from support import CONFIG, MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.command_line import VERBS
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs
from dvrk_gravity.model import TorqueModel

# Nodes write nothing.
MAKE_FOLDERS = ("calibrate", "demo", "diagnose")  # with theirs
WITHOUT_OUTPUT = {"compensator", "simulator", "watchdog"}


@dataclass(frozen=True)
class Use:
    """How a verb is called, and which of its outputs is in question.

    In ``words``, ``{out}`` is that output, ``{in}`` an input, ``{x.y}`` a file of the folder.

    Attributes:
        verb: The verb.
        words: Its arguments.
        inputs: What it reads.
        others: What it writes besides ``{out}``.
        suffix: How the output's name ends.
        below: The output, where its name is fixed and words name its folder ``d``.
    """

    verb: str
    words: str
    inputs: tuple[str, ...]
    others: tuple[str, ...] = ()
    suffix: str = ""
    below: str = ""


# None of the inputs holds what its name promises: whatever reads one fails with another error.
USES = {
    "convert's recording": Use("convert", "{r.csv} {out}", ("r.csv",), suffix=".csv"),
    "convert's bag": Use("convert", "{bag} {out}", ("bag",)),
    "convert's model": Use("convert", "{c.json} {out}", ("c.json",), suffix=".yaml"),
    "convert's console file": Use("convert", "{m.yaml} {out}", ("m.yaml",), suffix=".json"),
    "convert's findings": Use("convert", "--check {c.json} --json {out}", ("c.json",)),
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
    "identify's report": Use(
        "identify", "{r.csv} --arm {a.yaml} --out {o.yaml} --report {out}",
        ("r.csv", "a.yaml"), ("o.yaml",),
    ),
    "identify's JSON": Use(
        "identify", "{r.csv} --arm {a.yaml} --out {o.yaml} --json {out}",
        ("r.csv", "a.yaml"), ("o.yaml", "o.html"),
    ),
    "evaluate's JSON": Use(
        "evaluate", "{r.csv} {bag} --model {m.yaml} --json {out}", ("r.csv", "bag", "m.yaml")
    ),
    "evaluate's report": Use(
        "evaluate", "{r.csv} --model {m.yaml} --json {o.json} --report {out}",
        ("r.csv", "m.yaml"), ("o.json",),
    ),
    "diagnose's folder": Use(
        "diagnose", "{r.csv} --model {m.yaml} --out {out}", ("r.csv", "m.yaml")
    ),
    "diagnose's findings": Use(
        "diagnose", "{in} --model {m.yaml} --out {d}", ("m.yaml",), below="d/findings.json"
    ),
    "diagnose's model": Use(
        "diagnose", "{r.csv} --model {in} --out {d}", ("r.csv",), below="d/extended_model.yaml"
    ),
    "diagnose's report": Use(
        "diagnose", "{r.csv} --model {in} --out {d}", ("r.csv",), below="d/report.html"
    ),
    "demo's folder": Use("demo", "--model {m.yaml} --out {out}", ("m.yaml",)),
    "demo's picture": Use("demo", "--model {in} --out {d}", (), below="d/demo.png"),
    "demo's bag": Use("demo", "--model {in} --out {d}", (), below="d/bag"),
    "plan's plan": Use(
        "plan", "--arm {a.yaml} --model {m.yaml} --limits {l.yaml} --out {out}",
        ("a.yaml", "m.yaml", "l.yaml"), suffix=".yaml",
    ),
    "plan's motion": Use(
        "plan", "--arm {a.yaml} --out {o.yaml} --csv {out}", ("a.yaml",), ("o.yaml", "o.png")
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


def uses(condition: Callable[[Use], object] = lambda use: True) -> pytest.MarkDecorator:
    """Run a test for some uses."""
    names = [name for name, use in USES.items() if condition(use)]
    return pytest.mark.parametrize("case", names, indirect=True)


@pytest.fixture
def case(request, tmp_path, monkeypatch) -> Folder:
    monkeypatch.chdir(tmp_path)
    folder = Folder(tmp_path, USES[request.param])
    folder.output.parent.mkdir(exist_ok=True)
    return folder


def test_every_verb_is_tried():
    assert {use.verb for use in USES.values()} | WITHOUT_OUTPUT == set(VERBS)


@uses(lambda use: not use.below)
def test_no_output_is_an_input(case, capsys):
    for name in case.use.inputs:
        for spelled in (name, f"../{case.folder.name}/{name}"):
            line = case.refuses(capsys, Path(spelled))
            assert name in line
            assert "is read" in line


@uses(lambda use: use.below)
def test_no_output_of_a_fixed_name_is_an_input(case, capsys):
    if case.output.suffix:
        case.output.write_text("the content of an input")
        assert "is read" in case.refuses(capsys, case.output, case.output)
    else:  # a bag that is replaced
        case.output.mkdir()
        (case.output / "model.yaml").write_text("the content of an input")
        assert "is read" in case.refuses(capsys, case.output, case.output / "model.yaml")


@uses(lambda use: not use.below)
def test_no_output_is_an_input_under_another_name(case, capsys):
    """A hard link is the same file, and so is one reached through a linked folder."""
    (case.folder / "linked").symlink_to(case.folder)
    for name in case.use.inputs:
        assert "is read" in case.refuses(capsys, case.folder / "linked" / name)
        if (case.folder / name).is_file():
            os.link(case.folder / name, case.output)
            assert "is read" in case.refuses(capsys, case.output)
            case.output.unlink()


@uses(lambda use: "bag" in use.inputs)
def test_no_output_goes_into_a_bag_that_is_read(case, capsys):
    for name in ("metadata.yaml", f"new{case.use.suffix}"):
        assert "is read" in case.refuses(capsys, case.folder / "bag" / name)


@uses(lambda use: not use.below)
def test_no_output_is_without_a_name(case, capsys):
    """The words of a script whose variable is empty: not the working directory."""
    assert re.search(r"(OUT|--\w+): got", case.refuses(capsys, ""))


@uses(lambda use: use.others)
def test_no_output_is_another_output(case, capsys):
    for name in case.use.others:
        assert "is written" in case.refuses(capsys, case.folder / name)


@uses()
def test_no_output_is_a_link(case, capsys):
    target = case.folder / f"elsewhere{case.use.suffix}"
    case.output.symlink_to(target)  # to nothing: what is written would appear there
    assert "link" in case.refuses(capsys, case.output)
    target.write_text("what another file holds")
    assert "link" in case.refuses(capsys, case.output)


@uses()
def test_no_output_is_a_device(case, capsys):
    # A pipe stands for all that are neither file nor folder: a test may not risk /dev/null.
    os.mkfifo(case.output)
    assert "a device or pipe" in case.refuses(capsys, case.output)


def test_from_python_neither_is_one(tmp_path):
    os.mkfifo(tmp_path / "model.yaml")
    with pytest.raises(OSError, match="no file"):
        TorqueModel.load(MODEL_FILE).save(tmp_path / "model.yaml")
    assert (tmp_path / "model.yaml").is_fifo()


def test_evaluate_does_not_write_over_how_sure_a_model_is(tmp_path, capsys):
    model, sure = tmp_path / "model.yaml", tmp_path / "model.uncertainty.npz"
    model.write_text("identification:\n  uncertainty: model.uncertainty.npz\n")
    sure.write_bytes(b"how sure")
    words = ["evaluate", tmp_path / "run.csv", "--model", model, "--json", sure]
    assert main([str(word) for word in words]) == 2
    assert "model.uncertainty.npz, which is read" in capsys.readouterr().err
    assert sure.read_bytes() == b"how sure"


@pytest.mark.parametrize(
    "arm",
    [
        "urdf: robot.urdf",
        '"urdf": "robot.urdf"',
        "{urdf: robot.urdf, name: flow}",
        "? urdf\n: robot.urdf",
        "urdf:\n  robot.urdf",
        '"\\x75rdf": "robot\\u002eurdf"',
        "!!str urdf: !!str robot.urdf",
    ],
)
def test_a_urdf_is_not_written_over_however_the_arm_names_it(tmp_path, arm):
    urdf = tmp_path / "robot.urdf"
    urdf.write_text("a robot")
    (tmp_path / "arm.yaml").write_text(arm)
    files = {"--out": tmp_path / "m.yaml", "--report": urdf}
    with pytest.raises(ConfigError, match=r"robot\.urdf, which is read"):
        outputs.check(files, [tmp_path / "arm.yaml"])
    with pytest.raises(ConfigError, match=r"robot\.urdf, which is read"):
        outputs.require_unread("path", urdf, tmp_path / "arm.yaml")


def test_a_model_names_how_sure_it_is_with_points_in_the_key_as_well(tmp_path):
    (tmp_path / "sure.npz").write_bytes(b"how sure")
    text = "/**: {ros__parameters: {identification.uncertainty: sure.npz}}\n"
    (tmp_path / "model.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"sure\.npz, which is read"):
        outputs.check({"--json": tmp_path / "sure.npz"}, [tmp_path / "model.yaml"])


@pytest.mark.parametrize(
    "arm",
    ["urdf: [robot.urdf", "a: &x robot.urdf\nurdf: *x", "<<: {urdf: robot.urdf}", "- urdf"],
)
def test_nothing_is_written_if_it_cannot_be_told_what_an_input_names(tmp_path, arm):
    urdf, file = tmp_path / "robot.urdf", tmp_path / "arm.yaml"
    urdf.write_text("a robot")
    file.write_text(arm)
    with pytest.raises(ConfigError, match=r"arm\.yaml"):
        outputs.check({"--report": urdf}, [file])
    with pytest.raises(ConfigError, match=r"arm\.yaml"):
        outputs.check_folder("--out", tmp_path, ["robot.urdf"], [file])
    with pytest.raises(ConfigError, match=r"arm\.yaml"):
        outputs.require_unread("path", urdf, file)
    outputs.require_unread("path", tmp_path / "new.yaml", file)


@uses(lambda use: not use.below and use.verb not in MAKE_FOLDERS)
def test_an_output_in_no_folder_is_refused_before_the_work(case, capsys):
    line = case.refuses(capsys, case.folder / "none" / f"o{case.use.suffix}")
    assert "an existing folder" in line


def test_the_report_beside_the_model_is_an_output_too(tmp_path, capsys):
    use = Use("identify", "{r.html} --arm {a.yaml} --out {r.yaml}", ("r.html", "a.yaml"))
    assert "r.html" in Folder(tmp_path, use).refuses(capsys, tmp_path / "r.yaml")


def test_an_arm_that_is_shipped_is_not_written_over(tmp_path, capsys):
    arm = CONFIG / "arms" / "mtmr.yaml"
    before = arm.read_bytes()
    (tmp_path / "r.csv").write_text("no recording")
    words = ["identify", str(tmp_path / "r.csv"), "--arm", "mtmr", "--out", str(arm)]
    assert main([*words, "--report", str(tmp_path / "r.html")]) == 2
    assert "is read" in capsys.readouterr().err
    assert arm.read_bytes() == before


def test_a_bag_that_is_read_from_its_file_is_not_written_into(tmp_path):
    bag = tmp_path / "bag"
    bag.mkdir()
    for name in ("metadata.yaml", "bag_0.db3"):
        (bag / name).write_text("a bag")
    with pytest.raises(ConfigError, match="is read"):
        outputs.check({"--json": bag / "metadata.yaml"}, [bag / "bag_0.db3"])
    outputs.check({"--json": bag / "findings.json"}, [bag / "bag_0.db3"])


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda path: None, None),
        (lambda path: path.write_text("an earlier result"), None),
        (lambda path: path.mkdir(), "expected a file"),
    ],
)
def test_an_earlier_result_may_be_replaced(tmp_path, make: Callable[[Path], object], expected):
    make(tmp_path / "out.json")
    if expected is None:
        outputs.check({"--json": tmp_path / "out.json"}, [MODEL_FILE, None])
    else:
        with pytest.raises(ConfigError, match=expected):
            outputs.check({"--json": tmp_path / "out.json"}, [MODEL_FILE])
