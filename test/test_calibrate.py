"""From an arm to a certificate: the steps, what interrupts them, what a certificate requires."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support import REPOSITORY
from test_collect import PathDriver, plan_of

from dvrk_gravity import __version__
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import (
    CERTIFICATE,
    CalibrationSettings,
    CheckedDriver,
    Logbook,
    MotionTally,
    Pages,
    SimulatedRig,
    Work,
    all_steps,
    calibrate,
    certify,
    drawn_arm,
    file_hash,
    holding,
    largest_drift,
    release_poses,
    shown_drift,
)
from dvrk_gravity.cli import calibrate as calibrate_command
from dvrk_gravity.collecting import SimulatedDriver, collect
from dvrk_gravity.command_line import ProgressBySteps
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file
from dvrk_gravity.files.lock import alone_in
from dvrk_gravity.identification import POOR, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Plan, PlanLimits, Straight
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import (
    certificate_page,
    diagnosis_page,
    identification_page,
    plan_picture,
)
from dvrk_gravity.simulate import PlantFile
from testing.world import COARSE

pytestmark = pytest.mark.usefixtures("four_folds", "blank_pictures", "coarse_steps")

ARM = Arm.load("ecm")
BRIEF = CalibrationSettings(
    motion=10.0, check=9.0, further=9.0, rounds=1, search=2, poses=3, seconds=0.5,
    rehearsal=False,
)  # fmt: skip
ASKED = {"--arm": "ecm", "--seed": "1"}


@pytest.fixture(scope="module")
def coarse_steps() -> Iterator[None]:
    """Simulate in steps of half a set point's time: what a calibration does is the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dvrk_gravity.collecting.simulated.STEP", COARSE)
        yield


class KilledError(Exception):
    """What ends a process here."""


def work_in(folder: Path, lines: list[str], **other) -> Work:
    """Return a brief calibration of a simulated endoscope arm."""
    pages = Pages(
        plan_picture, identification_page, diagnosis_page,
        lambda certificate, evaluation: certificate_page(certificate, evaluation, ARM),
    )  # fmt: skip
    rig = SimulatedRig(drawn_arm(PlantFile.of(ARM), 1), 1, BRIEF.friction)
    how = {"settings": BRIEF, "report": lines.append, **other}
    return Work(folder, dict(ASKED), ARM, PlanLimits.of(ARM), rig, pages, "/ECM", 1, **how)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory) -> tuple[Path, list[list[str]]]:
    """Return the folder of a calibration that was killed in every step, and what each run said.

    It is killed after a step's files were written: recordings before the step is noted, and other
    steps after it. A file that is half written stays.
    """
    folder = tmp_path_factory.mktemp("calibration")
    runs: list[list[str]] = []
    add = Logbook.add
    killed: set[str] = set()

    def dies(book, step, said, paths, motion):
        if step not in killed and step.startswith("collect"):
            killed.add(step)
            raise KilledError
        entry = add(book, step, said, paths, motion)
        if step not in killed:
            killed.add(step)
            (folder / ".model.yaml.x1y2z3_4").write_text("half")
            raise KilledError
        return entry

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Logbook, "add", dies)
        for _ in range(40):
            runs.append([])
            try:
                calibrate(work_in(folder, runs[-1]))
            except KilledError:
                continue
            break
    return folder, runs


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory) -> tuple[Path, list[str]]:
    """Return the folder of the same calibration in one go, and its lines."""
    folder, lines = tmp_path_factory.mktemp("uninterrupted"), list[str]()
    calibrate(work_in(folder, lines))
    return folder, lines


def content(calibrated) -> dict:
    return json_file.load(calibrated[0] / CERTIFICATE)


def as_before(step: str, uninterrupted, folder: Path) -> Path:
    """Return a copy of the calibration in which a step, and those after it, are not done."""
    shutil.copytree(uninterrupted[0], folder)
    book = json_file.load(folder / "calibration.json")
    done = [entry["step"] for entry in book["steps"]].index(step)
    (folder / "calibration.json").write_text(json.dumps(book | {"steps": book["steps"][:done]}))
    return folder


def test_limits_that_change_between_two_releases_end_them(uninterrupted, tmp_path, monkeypatch):
    folder, released = as_before("release", uninterrupted, tmp_path / "again"), []

    def limits_now():
        if released:
            raise MotionError("the limits have changed")
        return PlanLimits.of(ARM)

    def release(rig, model, pose, seconds):
        released.append(pose)
        return np.zeros(ARM.n)

    monkeypatch.setattr(SimulatedRig, "release", release)
    with pytest.raises(MotionError, match="have changed"):
        calibrate(work_in(folder, [], limits_now=limits_now))
    assert len(released) == 1


@pytest.mark.parametrize("name", ["model.yaml", "second.yaml"])
def test_a_file_that_changes_between_two_releases_ends_them(
    uninterrupted, tmp_path, monkeypatch, name
):
    """The certificate has the hash of the model that was checked: another one is not released."""
    folder, released = as_before("release", uninterrupted, tmp_path / "again"), []

    def release(rig, model, pose, seconds):
        released.append(pose)
        with (folder / name).open("a") as file:
            file.write("# another\n")
        return np.zeros(ARM.n)

    monkeypatch.setattr(SimulatedRig, "release", release)
    with pytest.raises(ConfigError, match="changed since"):
        calibrate(work_in(folder, []))
    assert len(released) == 1


def test_a_recording_of_another_motion_is_not_taken_for_the_one_held_out(uninterrupted, tmp_path):
    folder = as_before("collect second", uninterrupted, tmp_path / "again")
    shutil.rmtree(folder / "second")
    shutil.copytree(folder / "motion", folder / "second")
    with pytest.raises(ConfigError, match=r"a recording of another motion.* one of second\.yaml"):
        calibrate(work_in(folder, []))


def test_steps_of_another_version_are_on_the_certificate(uninterrupted, tmp_path):
    folder = as_before("certify", uninterrupted, tmp_path / "again")
    book = json_file.load(folder / "calibration.json")
    book["steps"][0]["version"] = "0.0.1"
    (folder / "calibration.json").write_text(json.dumps(book))
    made = calibrate(work_in(folder, []))["versions"]["dvrk_gravity"]
    assert made == f"0.0.1, {__version__}"
    assert made in (folder / "certificate.html").read_text()


# Interrupted.
def test_what_is_killed_in_every_step_goes_on_from_the_last_one(calibrated):
    folder, runs = calibrated
    names = [step.name for step in all_steps(BRIEF)]
    assert len(runs) == len(names) + 1
    taken = [line for run in runs for line in run if not line.endswith("(done before)")]
    assert len(taken) == len({line.split(":")[0] for line in taken})
    assert len(runs[-1]) == len([line for line in runs[-1] if line.endswith("(done before)")])
    entries = Logbook.open(folder, ASKED).entries
    assert [entry.step for entry in entries] == names


def test_a_recording_that_was_whole_is_not_made_again(calibrated):
    _, runs = calibrated
    said = [line for run in runs for line in run if line.startswith("collect motion")]
    assert "recorded before" in said[0]


def test_interrupted_or_not_what_is_found_is_the_same_to_the_last_bit(calibrated, uninterrupted):
    names = ("*.yaml", "model*.npz", "model_*.json", "check.json", "release.json")
    once = sorted(path for name in names for path in uninterrupted[0].glob(name))
    assert len(once) > 8
    for path in once:
        assert path.read_bytes() == (calibrated[0] / path.name).read_bytes(), path.name


def test_a_simulated_motion_that_was_killed_is_made_again_the_same(calibrated, uninterrupted):
    """Its first second is recorded when it is killed."""
    folder = calibrated[0].parent / "killed"
    shutil.copytree(uninterrupted[0], folder)
    shutil.rmtree(folder / "second")
    entries = Logbook.open(uninterrupted[0], ASKED).entries
    book = Logbook(folder, ASKED, entries[: [e.step for e in entries].index("collect second")])
    (step,) = (step for step in all_steps(BRIEF) if step.name == "collect second")

    def dies(name: str, part: float, stage: str = "") -> None:
        if part > 0.2 and name.endswith("motion, recorded"):
            raise KilledError

    with pytest.raises(KilledError):
        step.run(work_in(folder, [], progress=dies), book, step.name)
    assert (folder / "second.unfinished").exists()
    step.run(work_in(folder, []), book, step.name)
    again, once = (Recording.load(each / "second") for each in (folder, uninterrupted[0]))
    assert np.array_equal(again.position, once.position)
    assert np.array_equal(again.effort, once.effort)


def test_commands_and_seconds_of_all_goes_are_counted(tmp_path):
    book = Logbook.open(tmp_path, ASKED)
    book.note_motion(MotionTally(2.0, 5.0, 100, 0.9, "velocity of yaw"))
    book.note_motion(MotionTally(3.0, 5.0, 150, 0.9, "velocity of yaw"))  # the same go
    again = Logbook.open(tmp_path, ASKED)
    again.note_motion(MotionTally(1.0, 0.0, 50, 0.5, "position of yaw"))
    last = Logbook.open(tmp_path, ASKED)
    motion = {"seconds": 9.0, "rehearsed": 0.0, "commands": 7, "used": 0.2, "most": ""}
    last.add("collect motion", "", (), motion)
    last.add("collect second", "", (), motion)
    total = Logbook.open(tmp_path, ASKED).total
    assert total == MotionTally(3.0 + 1.0 + 18.0, 5.0, 150 + 50 + 7 + 7, 0.9, "velocity of yaw")


def test_a_killed_calibration_counts_no_less_motion_than_an_uninterrupted_one(
    calibrated, uninterrupted
):
    whole = content(uninterrupted)["motion"]
    assert content(calibrated)["motion"]["seconds"] == pytest.approx(whole["seconds"])
    assert content(calibrated)["motion"]["commands"] >= whole["commands"]
    assert content(calibrated)["motion"]["used"] == whole["used"]


@pytest.mark.parametrize("ended", [KeyboardInterrupt(), SystemExit(143)])
@pytest.mark.parametrize("steps", [[], ["plan motion"], ["plan motion", "collect motion"]])
def test_what_ends_it_leaves_a_line_on_what_is_kept(tmp_path, capsys, monkeypatch, ended, steps):
    def dies(work):
        book = Logbook.open(work.folder, work.asked)
        for step in steps:
            book.add(step, "", (), {})
        raise ended

    monkeypatch.setattr("dvrk_gravity.calibration.calibrate", dies)
    words = ["calibrate", "--arm", "ecm", "--simulated", "--out", str(tmp_path / "out")]
    if isinstance(ended, KeyboardInterrupt):
        assert main(words) == 130
    else:
        with pytest.raises(SystemExit):
            main(words)
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("dvrk_gravity calibrate: interrupted: ")
    assert f"kept in {tmp_path / 'out'}" in line or not steps
    assert "the same command" in line
    assert all(repr(step) in line for step in steps[-1:])


def test_what_was_half_written_is_removed(calibrated):
    folder, _ = calibrated
    assert not list(folder.glob(".*"))


def test_another_arm_seed_or_limit_is_named(calibrated):
    folder, _ = calibrated
    for option, value in (("--arm", "psm"), ("--seed", "2"), ("--limits", "narrow.yaml (12ab)")):
        with pytest.raises(ConfigError, match=option) as raised:
            Logbook.open(folder, {**ASKED, option: value})
        assert "with which" in str(raised.value)
        assert "None" not in str(raised.value)
        assert value in str(raised.value)


@pytest.mark.parametrize("name", ["motion.yaml", "model_0.json", "motion/metadata.yaml"])
def test_a_file_that_was_changed_or_removed_is_named(calibrated, name):
    folder, _ = calibrated
    before = (folder / name).read_bytes()
    try:
        (folder / name).write_bytes(before + b"\n")
        with pytest.raises(ConfigError, match="changed since") as raised:
            Logbook.open(folder, ASKED)
        assert name in str(raised.value)
        (folder / name).unlink()
        with pytest.raises(ConfigError, match="no file"):
            Logbook.open(folder, ASKED)
    finally:
        (folder / name).write_bytes(before)


@pytest.mark.parametrize(
    "name", [".pre-commit-config.yaml", ".zshrc.local", ".model.yaml.x1y2z3_4"]
)
def test_hidden_files_of_another_folder_stay(tmp_path, name):
    (tmp_path / name).write_text("mine")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match="a new folder"):
        Logbook.open(tmp_path, ASKED)
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize("changed", ["--limits", "--seed", "--arm"])
def test_what_is_asked_for_may_change_until_a_step_is_done(tmp_path, changed):
    Logbook.open(tmp_path, ASKED | {"--limits": "none can be kept"})
    other = ASKED | {"--limits": "wider"} | {changed: "another"}
    book = Logbook.open(tmp_path, other)
    book.add("plan motion", "", (), {})
    assert Logbook.open(tmp_path, other).asked == other
    with pytest.raises(ConfigError, match=f"{changed}: .* was begun"):
        Logbook.open(tmp_path, other | {changed: "a third"})


def test_two_at_once_in_one_folder_are_refused(tmp_path):
    with alone_in(tmp_path, "--out"), pytest.raises(ConfigError, match="no other process"):
        calibrate(work_in(tmp_path, []))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "step",
    [
        "plan motion", {"step": "plan motion"},
        {"step": "plan motion", "said": "", "files": "x", "motion": {}},
        {"step": "plan motion", "said": "", "files": {}, "motion": {"seconds": 1.0}},
        {"step": "plan motion", "said": "", "files": {}, "motion": [1]},
    ],
)  # fmt: skip
def test_a_damaged_logbook_is_one_line(tmp_path, step):
    content = {"format": 1, "asked": ASKED, "steps": [step]}
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=r"a file as `calibrate` writes it") as caught:
        Logbook.open(tmp_path, ASKED)
    assert "\n" not in str(caught.value)


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match=r"notes\.txt"):
        Logbook.open(tmp_path, ASKED)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


# Certified.
def test_the_certificate_says_what_was_found(calibrated):
    found = content(calibrated)
    assert found["certified"] == (not found["reasons"])
    assert found["verdict"].startswith("simulated ECM ")
    assert [joint["name"] for joint in found["joints"]] == list(ARM.joint_names)
    assert found["poses"] == BRIEF.poses
    assert found["motion"]["used"] <= 1.0 + 1e-9
    assert found["motion"]["commands"] > 1000.0 * BRIEF.check
    page = (calibrated[0] / "certificate.html").read_text()
    assert escape(found["verdict"][1:]) in page


def test_the_certificate_has_the_hash_of_every_file(calibrated):
    folder, _ = calibrated
    files = content(calibrated)["files"]
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert there - set(files) == {"calibration.json", "certificate.json", "certificate.html"}
    for name, known in files.items():
        assert file_hash(folder / name) == known


def certified_with(folder: Path, **changed) -> tuple[str, ...]:
    """Return why a calibration is not certified with other values in one of its files."""
    fit, check, release = (
        json_file.load(folder / name) for name in ("model_0.json", "check.json", "release.json")
    )
    motion = changed.pop("motion", MotionTally(60.0, 0.0, 60_000, 0.9, "velocity of yaw"))
    release |= {"poses": release["poses"], **changed.pop("release", {})}
    check["levels"] |= changed.pop("levels", {})
    fit["verdict"] |= changed.pop("verdict", {})
    assert not changed
    none = {"findings": [], "ambiguities": []}
    return certify(
        ARM, BRIEF, fit, check, release, none, motion, namespace="/ECM", simulated="", date="",
        versions={}, files={}, model="model.yaml",
    ).reasons  # fmt: skip


def test_what_there_is_no_sign_of_was_not_found_but_stays_unknown(calibrated):
    folder, _ = calibrated
    fit, check, release = (
        json_file.load(folder / name) for name in ("model_0.json", "check.json", "release.json")
    )
    pairs = [
        {"sentence": "a zero and a tilt, no sign of either", "suspected": False},
        {"sentence": "a zero or another, 0.2 deg", "suspected": True},
    ]
    motion = MotionTally(60.0, 0.0, 60_000, 0.9, "velocity of yaw")
    found = certify(
        ARM, BRIEF, fit, check, release, {"findings": [], "ambiguities": pairs}, motion,
        namespace="/ECM", simulated="", date="", versions={}, files={}, model="model.yaml",
    )  # fmt: skip
    assert found.findings == ("a zero or another, 0.2 deg",)
    assert "a zero and a tilt, no sign of either" in found.unknown
    assert "a zero or another, 0.2 deg" not in found.unknown


def test_a_certificate_is_refused_for_each_of_its_reasons(calibrated):
    folder, _ = calibrated
    good = {
        "levels": dict.fromkeys(ARM.joint_names, "good"),
        "verdict": {"overall": "good"},
        "release": {"drift": [[0.0] * ARM.n] * 3},
    }
    assert certified_with(folder, **good) == ()
    away = [[0.0, np.radians(3.0), 0.0, 0.0], *[[0.0] * ARM.n] * 2]
    unknown = [[0.0, np.nan, 0.0, 0.0], *[[0.0] * ARM.n] * 2]
    for changed, reason in (
        (
            {"release": {"drift": away}},
            "1 of 3 poses it drifted by more than 0.5 deg, at most 3",
        ),
        ({"levels": good["levels"] | {"pitch": POOR}}, "held-out motion are too large"),
        ({"verdict": {"overall": POOR, "reason": "noise"}}, "unfit to compensate with"),
        ({"motion": MotionTally(700.0, 0.0, 1, 0.5, "")}, "it moved for 11.7 min"),
        ({"release": {"drift": [], "why": ""}}, "it was released at 0 of 3 poses"),
        ({"release": {"drift": unknown}}, "1 of 3 poses it drifted by more than 0.5 deg"),
    ):
        (said,) = certified_with(folder, **{**good, **changed})
        assert reason in said


def test_a_diagnosis_says_once_that_there_is_nothing(uninterrupted):
    (line,) = (line for line in uninterrupted[1] if line.startswith("diagnose diagnosis_0"))
    assert line.lower().count("nothing") <= 1


@pytest.mark.parametrize(
    ("drift", "unit", "text"),
    [
        (0.0, "rad", "0.00 deg"), (8e-5, "rad", "< 0.01 deg"), (2e-4, "rad", "0.01 deg"),
        (np.radians(14.44), "rad", "14.44 deg"), (1e-6, "m", "< 0.01 mm"), (9e-4, "m", "0.90 mm"),
    ],
)  # fmt: skip
def test_a_drift_is_no_more_exact_than_it_is(drift, unit, text):
    assert shown_drift(drift, unit) == text


def test_of_an_arm_that_did_not_move_no_drift_of_zero_is_claimed():
    assert largest_drift(0.0) == "< 0.01 deg"
    assert largest_drift(2e-4) == "at most 0.01 deg"


def test_progress_of_a_step_never_decreases(monkeypatch):
    shown: list[tuple[str, float]] = []

    def update(progress, done):
        shown.append((progress._what, done))

    monkeypatch.setattr("dvrk_gravity.command_line.Progress.update", update)
    show = ProgressBySteps(calibrate_command._STAGES)
    for stage, part in (("reading", 0.0), ("regressor", 1.0), ("choice of terms", 0.0),
                        ("choice of terms", 1.0), ("zeros and tilt", 0.0)):  # fmt: skip
        show("identify model_0", part, stage)
    show("diagnose diagnosis_0", None, "reading")
    show("diagnose diagnosis_0", None, "comparing hypotheses")
    show("release", 0.5)
    identified = [done for what, done in shown if what == "identify model_0"]
    assert identified == sorted(identified)
    assert identified[-1] < 1.0
    assert [done for what, done in shown if what != "identify model_0"] == [0.0, 0.1, 0.5]


# What the model lacks.
def test_the_band_of_what_holds_a_joint_counts_what_the_model_lacks(uninterrupted):
    """A cable that the fit may not have: its own columns do not show it, omitted ones do."""
    bag = uninterrupted[0] / "motion"
    whole, plain = (identify(str(bag), ARM, effects=of) for of in (None, ["coulomb_friction"]))
    poses = np.random.default_rng(0).uniform(*ARM.range, (200, ARM.n))
    for fit in (whole, plain):
        error = np.sqrt(np.mean(fit.rest_error(poses) ** 2, axis=0))
        known = [fit.holding[name].error_anywhere for name in ARM.joint_names]
        np.testing.assert_allclose(error, known)  # the same poses, and the same function
        ratio = holding(fit, poses, 0.1)
        friction = np.array([fit.holding[name].friction for name in ARM.joint_names])
        np.testing.assert_allclose(ratio * 0.1 * friction, 1.96 * fit.rest_error(poses))


def test_the_certificate_has_where_less_friction_is_sure_to_hold(uninterrupted):
    """By the band that a further motion is decided with, whichever friction the arm has."""
    fit = json_file.load(uninterrupted[0] / "model_1.json", finite=False)
    found = content(uninterrupted)
    assert {joint["name"]: joint["sure"] for joint in found["joints"]} == fit["held"]["joints"]
    assert fit["held"]["part"] <= min(fit["held"]["joints"].values())
    for joint in found["joints"]:
        said = any(
            line.startswith(f"{joint['name']}: with 10 % of its friction it is not sure to stay")
            for line in found["unknown"]
        )
        assert said == (joint["sure"] < 1.0)


def test_less_gain_is_asked_of_a_term_the_more_terms_there_are(uninterrupted):
    bag = str(uninterrupted[0] / "motion")
    few, more = (identify(bag, ARM, least_gain=least) for least in (0.05, 0.0))
    kept = [sum(each.kept for each in fit.choices) for fit in (few, more)]
    assert kept[0] < kept[1]


@pytest.mark.parametrize(("part", "moves"), [(0.98, True), (1.0, False)])
def test_a_joint_that_friction_may_not_hold_is_measured_further(
    uninterrupted, tmp_path, part, moves
):
    folder = tmp_path / "copy"
    shutil.copytree(uninterrupted[0], folder)
    findings = json_file.load(folder / "diagnosis_0.json")
    clear = {"next": None, "unseparated": {"pairs": []}}
    (folder / "diagnosis_0.json").write_text(json.dumps({**findings, **clear}))
    known = json_file.load(folder / "model_0.json", finite=False)
    held = {"part": part, "least": "pitch"}
    (folder / "model_0.json").write_text(json.dumps({**known, "held": held}))
    (step,) = (step for step in all_steps(BRIEF) if step.name == "plan further_1")
    entries = Logbook.open(uninterrupted[0], ASKED).entries
    book = Logbook(folder, ASKED, [e for e in entries if not e.step.endswith("_1")])
    outcome = step.run(work_in(folder, []), book, step.name)
    assert ("pitch is not sure to stay at 2 % of poses" in outcome.said) == moves
    assert bool(outcome.paths) == moves


# Further motions.
def test_no_search_is_begun_for_causes_that_no_motion_separates(calibrated, tmp_path, monkeypatch):
    folder = tmp_path / "copy"
    shutil.copytree(calibrated[0], folder)
    findings = folder / "diagnosis_0.json"
    found = json_file.load(findings)
    pairs = [{"between": [{"effect": "payload"}, {"effect": "link_com"}]}]
    findings.write_text(
        json.dumps({**found, "next": None, "unseparated": {"pairs": pairs}}, allow_nan=False)
    )
    known = json_file.load(folder / "model_0.json", finite=False)
    (folder / "model_0.json").write_text(
        json.dumps({**known, "held": {"part": 1.0, "least": ARM.joint_names[0]}})
    )
    (step,) = (step for step in all_steps(BRIEF) if step.name == "plan further_1")
    entries = Logbook.open(calibrated[0], ASKED).entries
    book = Logbook(folder, ASKED, [e for e in entries if not e.step.endswith("_1")])
    outcome = step.run(work_in(folder, []), book, step.name)
    assert outcome.said == "no motion within the limits is expected to separate what was found"
    assert outcome.paths == ()
    findings.write_text(json.dumps({**found, "next": None, "unseparated": {"pairs": []}}))
    work = work_in(folder, [])
    short = replace(work, settings=replace(BRIEF, longest=1.0))
    assert step.run(short, book, step.name).said == ""  # no want, of which time would be none


@pytest.mark.parametrize("separates", [True, False])
def test_an_ambiguous_diagnosis_is_followed_by_the_motion_that_separates(
    calibrated, separates, tmp_path, monkeypatch
):
    folder = tmp_path / "copy"
    shutil.copytree(calibrated[0], folder)
    findings = folder / "diagnosis_0.json"
    found = json_file.load(findings)
    task = {"next": "plan --separate", "unseparated": {"pairs": [{}]}}
    findings.write_text(json.dumps({**found, **task}))
    known = json_file.load(folder / "model_0.json", finite=False)
    held = {"part": 1.0, "least": ARM.joint_names[0]}
    (folder / "model_0.json").write_text(json.dumps({**known, "held": held}))
    planned = SimpleNamespace(
        plan=Plan.load(folder / "motion.yaml"), separates=separates,
        expected=[SimpleNamespace(words="a spring and a cable", separates=separates)],
    )  # fmt: skip
    steps = "dvrk_gravity.calibration.motion_steps"
    monkeypatch.setattr(f"{steps}.load_unseparated", lambda path, model: path)
    monkeypatch.setattr(f"{steps}.design_separation", lambda of, *rest, **how: planned)
    (step,) = (step for step in all_steps(BRIEF) if step.name == "plan further_1")
    entries = Logbook.open(calibrated[0], ASKED).entries
    known = [entry for entry in entries if not entry.step.endswith("_1")]
    outcome = step.run(work_in(folder, []), Logbook(folder, ASKED, known), step.name)
    if separates:
        assert outcome.said.endswith("to separate a spring and a cable")
        assert [path.name for path in outcome.paths] == ["further_1.yaml", "further_1.png"]
    else:  # and what holds the arm is known
        assert outcome.said == "no further motion is sure to separate a spring and a cable"
        assert outcome.paths == ()


# Released.
def test_poses_are_reached_within_limits_and_away_from_what_was_fitted(calibrated):
    folder, _ = calibrated
    model, limits = TorqueModel.load(folder / "model.yaml"), PlanLimits.of(ARM)
    fitted = Recording.load(folder / "motion").position[::10]
    start = fitted[0]
    poses, apart = release_poses(ARM, limits, model, fitted, BRIEF, 5, start)
    away = np.abs((poses[:, None] - fitted) / ARM.scale).max(axis=2).min(axis=1)
    assert away.min() == pytest.approx(apart)
    assert apart >= BRIEF.apart
    assert ((poses >= limits.lower) & (poses <= limits.upper)).all()


# Limits.
def test_a_command_beyond_a_limit_is_refused_before_the_arm_moves():
    limits = PlanLimits.of(ARM)
    narrow = replace(limits, velocity=0.1 * limits.velocity)
    driver = SimulatedDriver(PlantFile.of(ARM))
    kept = CheckedDriver(driver, narrow, ARM)
    where = kept.connect()
    way = Straight.within(where, where + 0.2 * ARM.scale, limits, 1.0)
    with pytest.raises(MotionError, match="of the limit of velocity"):
        kept.follow(way.at, way.duration)
    assert np.abs(driver.connect() - where).max() < 1e-3
    assert kept.seconds == 0.0
    slowly = Straight.within(where, where + 0.01 * ARM.scale, narrow, 0.5)
    kept.follow(slowly.at, slowly.duration)
    assert kept.check.samples >= 1000.0 * slowly.duration
    assert 0.0 < kept.check.used <= 1.0


@pytest.mark.parametrize("rehearse", [False, True])
def test_nothing_that_takes_long_is_done_between_an_approach_and_its_motion(tmp_path, rehearse):
    plan = plan_of("ecm")
    driver = PathDriver(plan, plan.at(0.0)[0] + 0.1 * ARM.scale)
    kept, done = CheckedDriver(driver, plan.limits, ARM), []
    look, follow = kept.check.look, driver.follow

    def looks(path, duration):
        done.append("look")
        look(path, duration)

    def follows(*given, **how):
        done.append("follow")
        return follow(*given, **how)

    kept.check.look, driver.follow = looks, follows
    collect(plan, kept, tmp_path / "bag", rehearse=rehearse, look=kept.look, report=driver.report)
    assert done == ["look", "look", "follow", "follow"] * (1 + rehearse)


@pytest.mark.parametrize("rehearsing", [False, True])
def test_of_a_path_that_is_stopped_the_time_up_to_there_counts(rehearsing):
    driver, notes = SimulatedDriver(PlantFile.of(ARM)), list[MotionTally]()
    kept = CheckedDriver(driver, PlanLimits.of(ARM), ARM, notes.append)
    kept.rehearsing = rehearsing
    where = kept.connect()
    way = Straight.within(where, where + 0.2 * ARM.scale, PlanLimits.of(ARM), 0.1)

    def stops(part: float) -> None:
        if part > 0.5:
            raise KilledError

    with pytest.raises(KilledError):
        kept.follow(way.at, way.duration, progress=stops)

    def seconds(motion: MotionTally) -> float:
        other, own = (motion.seconds, motion.rehearsed)[:: 1 if rehearsing else -1]
        assert other == 0.0
        return own

    assert seconds(notes[0]) == way.duration  # were it killed: all of it
    assert seconds(notes[-1]) == pytest.approx(0.5 * way.duration, abs=0.02)
    assert kept.motion() == notes[-1]


# Drawn arms.
def test_a_command_that_is_no_number_is_refused_before_the_arm_moves():
    driver = SimulatedDriver(PlantFile.of(ARM))
    kept = CheckedDriver(driver, PlanLimits.of(ARM), ARM)
    where = kept.connect()

    def lost(time):
        states = np.zeros((3, *np.shape(time), ARM.n))
        states[0] = where
        states[0, ..., 2] = np.where(np.asarray(time) > 0.5, np.nan, where[2])
        return tuple(states)

    with pytest.raises(MotionError, match="not be a finite number: not moved"):
        kept.follow(lost, 1.0)
    assert kept.seconds == 0.0


def test_arms_of_one_seed_are_the_same_and_of_two_are_not():
    plant = PlantFile.of(ARM)
    first, again, other = (drawn_arm(plant, seed) for seed in (3, 3, 4))
    q = np.random.default_rng(0).uniform(*ARM.range, (5, ARM.n))
    state = State(q, 0.3 * ARM.scale + 0.0 * q)
    torques = [each.model.torque_at(state) for each in (first, again, other)]
    assert np.array_equal(torques[0], torques[1])
    assert (np.abs(torques[0] - torques[2]).max(axis=0) > 0.0).all()
    assert first.model.joint_offset.any()
    assert not np.allclose(first.model.gravity, ARM.gravity)


# Its command line.
def test_nobody_who_can_be_asked_is_one_line(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["calibrate", "--arm", "ecm", "--out", str(out)]) == 2
    assert "--yes" in capsys.readouterr().err
    assert not out.exists()


def test_killed_in_its_motion_it_goes_on_there(tmp_path):
    out = tmp_path / "out"
    words = [
        sys.executable, "-m", "dvrk_gravity", "calibrate", "--arm", "ecm", "--simulated",
        "--out", str(out), "--no-rehearsal", "--time", "1", "--duration", "20",
    ]  # fmt: skip

    def run_until(there) -> str:
        process = subprocess.Popen(
            words, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        end = time.monotonic() + 300.0
        while not there() and process.poll() is None and time.monotonic() < end:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        return process.communicate()[0]

    state, book = out / "motion.unfinished" / "state.json", out / "calibration.json"

    def moving() -> bool:
        return state.exists() and json.loads(state.read_text())["moment"] > 1.0

    def noted() -> bool:
        return book.exists() and "collect motion" in book.read_text()

    first = run_until(moving)  # a busy machine may kill it after its motion
    assert "plan motion" in first
    assert not noted()
    second = run_until(noted)
    assert "(done before)" in second
    assert noted()
    assert (out / "motion").exists()
    assert not state.exists()


@pytest.mark.parametrize("words", [[], ["--rehearsal"], ["--no-rehearsal"]])
@pytest.mark.parametrize("noted", [None, "False", "True"])
def test_a_folder_is_gone_on_with_whether_or_not_it_was_rehearsed(
    tmp_path, monkeypatch, words, noted
):
    """Earlier versions noted it, and rehearsed simulated arms, too."""
    given = ["--arm", "ecm", "--simulated", "--out", str(tmp_path)]
    parser = ArgumentParser()
    calibrate_command.add_arguments(parser)
    asked = calibrate_command._asked(parser.parse_args(given))
    Logbook.open(tmp_path, asked if noted is None else {**asked, "--no-rehearsal": noted})
    opened = []

    def goes_on(work):
        opened.append(Logbook.open(work.folder, work.asked))
        return {"certified": True}

    monkeypatch.setattr("dvrk_gravity.calibration.calibrate", goes_on)
    assert main(["calibrate", *given, *words]) == 0
    assert len(opened) == 1


def test_another_arm_than_the_folder_s_is_one_line(tmp_path, capsys):
    Logbook.open(tmp_path, {"--arm": "psm"}).add("plan motion", "", (), {})
    before = (tmp_path / "calibration.json").read_bytes()
    assert main(["calibrate", "--arm", "ecm", "--simulated", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("dvrk_gravity calibrate: --arm: got 'ecm")
    assert "psm, with which" in line
    assert [path.name for path in tmp_path.iterdir()] == ["calibration.json"]
    assert (tmp_path / "calibration.json").read_bytes() == before
