"""`collect` and `excite` on the command line: what they ask, refuse, leave and read again."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from path_driver import plan_of

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.cli import calibrate, collect, excite, options
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.planning import Basis, FourierMotion, load_limits
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile

ACTION = "/joint_trajectory_controller/follow_joint_trajectory"


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return the one line with which a command ends, having left nothing."""
    before = set(Path().iterdir())
    assert main(list(words)) == 2, words
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    assert set(Path().iterdir()) == before
    return error


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


# --- consent -------------------------------------------------------------------------------


class Terminal:
    """A person at a terminal, who answers when asked; also the driver, whose signals count."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.person, terminal = os.openpty()
        self.stdin = os.fdopen(terminal)
        monkeypatch.setattr("sys.stdin", self.stdin)
        self.waits: Callable[[], bool] = lambda: False

    @property
    def interrupted(self) -> bool:
        return self.waits()

    def answer(self, text: bytes | None) -> bool:
        """Return whether the question that is asked is consented to with a text; ``None``: gone."""
        left = [text]

        def types() -> bool:
            if left and left.pop() is None:
                os.close(self.person)
            elif text is not None:
                os.write(self.person, text)
            return False

        self.waits = types
        return collect.terminal_consent(self)("free?")

    def close(self) -> None:
        self.stdin.close()
        with suppress(OSError):
            os.close(self.person)


def test_only_y_and_yes_consent_and_what_was_typed_before_a_question_is_no_answer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for text, consents in (
        (b"y\n", True), (b"YES\n", True), (b"n\n", False), (b"\n", False), (b"\x04", False),
        (b"yesterday\n", False), (None, False),
    ):  # fmt: skip
        terminal = Terminal(monkeypatch)
        os.write(terminal.person, b"y\n")  # twice, at the question before
        assert terminal.answer(text) == consents, text
        terminal.close()
    assert "[y/N]" in capsys.readouterr().out
    terminal = Terminal(monkeypatch)
    terminal.waits = lambda: True
    with pytest.raises(KeyboardInterrupt):  # a signal while it waits
        collect.terminal_consent(terminal)("free?")
    terminal.close()


def test_where_nobody_can_be_asked_consent_is_needed_beforehand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for stdin in (StringIO("y\n"), None):  # a file; closed
        monkeypatch.setattr("sys.stdin", stdin)
        with pytest.raises(DvrkGravityError, match="--yes"):
            collect.terminal_consent(None)


def test_a_simulated_arm_is_rehearsed_only_where_that_is_asked_for() -> None:
    for words, wants_rehearsal in (
        ([], True),
        (["--no-rehearsal"], False),
        (["--simulated"], False),
        (["--simulated", "--rehearsal"], True),
        (["--simulated", "plant.yaml", "--no-rehearsal"], False),
    ):
        for verb in (collect, excite, calibrate):
            parser = argparse.ArgumentParser()
            verb.add_arguments(parser)
            asked = [] if verb is collect else ["--arm", "ecm", "--out", "bag"]
            found = options.wants_rehearsal(parser.parse_args([*words, *asked]))
            assert found == wants_rehearsal, (verb.NAME, words)


# --- what they do --------------------------------------------------------------------------


def test_a_plan_is_collected_and_a_room_is_taught_from_what_was_recorded(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan_of("ecm", size=0.9).save("plan.yaml")
    assert main(["collect", "plan.yaml", "--out", "bag", "--simulated"]) == 0
    said = capsys.readouterr().out
    assert "Next: identify bag --arm ecm --out model.yaml" in said
    assert "rehearsal" not in said  # an arm in this process has nothing to meet
    teach = ["--teach", "limits.yaml", "--arm", "ecm", "--from", "bag"]
    assert main(["collect", *teach]) == 0
    assert "plan --arm ecm --limits limits.yaml" in capsys.readouterr().out
    limits = load_limits("limits.yaml", Arm.load("ecm"))
    shown = Recording.load("bag").position
    assert (limits.lower >= shown.min(axis=0) - 1e-3).all()
    assert (limits.upper <= shown.max(axis=0) + 1e-3).all()


def test_excite_records_a_motion_and_the_next_step_of_a_further_one_is_to_evaluate_it(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--arm", "ecm", "--out", "bag", "--simulated", "--duration", "8", "--seed", "2"]
    assert main(["excite", *words]) == 0
    assert "evaluate bag --model MODEL" in capsys.readouterr().out
    recording = Recording.load("bag")
    assert len(recording) == pytest.approx(1600, abs=2)
    assert (np.ptp(recording.position, axis=0) > 0.05 * Arm.load("ecm").scale).all()


def test_a_plan_that_is_replaced_after_its_rehearsal_is_one_line_and_no_motion(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = plan_of("ecm")
    short = FourierMotion(Basis(np.array([2.0]), 0.2, 0.5), plan.motion.middle, np.zeros((2, 4)))
    replace(plan, motion=short).save("plan.yaml")

    class Person(StringIO):
        def write(self, text: str) -> int:
            if text.startswith("rehearsal"):
                plan_of("ecm", seed=2).save("plan.yaml")
            return super().write(text)

    with redirect_stdout(Person()) as said:
        assert main(["collect", "plan.yaml", "--out", "bag", "--simulated", "--rehearsal"]) == 2
    error = capsys.readouterr().err
    assert "plan.yaml: got " in error
    assert error.strip().count("\n") == 0
    assert "motion, recorded" not in said.getvalue()
    assert not Path("bag").exists()


# --- what they refuse ----------------------------------------------------------------------


def test_a_wrong_argument_is_one_line_and_status_2(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan_of("mtmr").save("plan.yaml")
    PlantFile.of(Arm.load("mtml")).model.save("mtml.yaml")
    Path("ecm.csv").write_text("time,yaw.position,yaw.effort\n0.0,0.1,0\n0.1,0.2,0\n")
    Path("link").symlink_to("nowhere")
    excites, plans = ["excite", "--arm", "mtmr", "--out", "bag"], ["collect", "plan.yaml"]
    collects = [*plans, "--out", "bag", "--yes"]
    goals = [*collects, "--action", ACTION]
    for words, says in (
        ([*excites, "--duration", "3"], "--duration: got 3.0, expected 8 to 600"),
        ([*excites, "--rate", "nan"], "--rate: got nan, expected 50 to 500"),
        ([*excites, "--motions", "0"], "--motions: got 0, expected 1 to 20"),
        ([*excites, "--namespace", "a b"], "--namespace: got '/a b'"),
        ([*excites, "--namespace", "/left/PSM2"], "namespace: got '/left/PSM2'"),
        ([*excites, "--ros-args", "-r", "__ns:=/MTML"], "--ros-args: got '--ros-args -r"),
        ([*excites, "--out", "no/such/bag"], "no/such"),
        (["collect"], "PLAN: got nothing"),
        (plans, "--out: got nothing"),
        ([*collects, "--arm", "ecm"], "--arm: got 'ecm', expected --teach"),
        ([*collects, "--simulated", "psm"], "a plant of mtmr"),
        ([*collects, "--simulated", "--model", "mtml.yaml"],
         "mtml.yaml: --model: got 'mtml', expected a model of mtmr"),
        ([*plans, "--out", "link", "--yes", "--simulated"], "link"),
        ([*collects, "--action", "a b"], "--action: got 'a b'"),
        ([*goals, "--measured", "states!"], "--measured: got 'states!'"),
        ([*goals, "--namespace", "/MTML"], "got '/MTML'"),
        (["collect", "--teach", "l.yaml"], "--arm: got nothing"),
        (["collect", "--teach", "l.yaml", "--arm", "mtmr", "--margin", "-1"], "--margin: got -1"),
        (["collect", "--teach", "l.yaml", "--arm", "mtmr", "--from", "ecm.csv"], "ecm.csv: "),
    ):  # fmt: skip
        assert says in refused(capsys, *words), words


def of(*keys: str, value: object) -> Callable[[Any], None]:
    """Return what edits an entry of a file."""

    def edit(content: Any) -> None:
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = value

    return edit


def faster(content: Any) -> None:
    content["motion"]["sine"]["pitch"][1] += 1.0


@pytest.mark.filterwarnings("error")
def test_a_plan_edited_beyond_its_limits_is_one_line_and_nothing_moves(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pitch = ("limits", "joints", "pitch", "velocity")
    plan_of("ecm").save("plan.yaml")
    written = Path("plan.yaml").read_text()
    for edit, says in (
        (faster, "the plan exceeds the limit of"),
        (of("limits", "joints", "yaw", "position", value=[-1.0, 1.0]), "position of yaw"),
        (of(*pitch, value=1e300), "pitch.velocity: got 1e+300"),
        (of("motion", "duration", value=1e5), "motion: got '1e+05 s'"),
        (of("motion", "frequency", value=[0.5, 1e300]), "motion.frequency: got "),
        (of("motion", "ramp", value=1e-300), "motion.ramp: got 1e-300"),
    ):
        content = yaml.safe_load(written)
        edit(content)
        Path("plan.yaml").write_text(yaml.safe_dump(content))
        words = ("plan.yaml", "--out", "bag", "--simulated", "--yes")
        assert says in refused(capsys, "collect", *words), says
