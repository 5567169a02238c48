"""From an arm to a certificate: the steps, what interrupts them, and the limits that they keep."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from finished_calibration import (
    ASKED,
    BRIEF,
    Finished,
    KilledError,
    PathRig,
    finished_calibration,
    work_in,
)
from path_driver import PathDriver

from dvrk_gravity import __version__
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import (
    CheckedDriver,
    Logbook,
    MotionTally,
    all_steps,
    calibrate,
    draw_arm,
    file_hash,
    release_poses,
)
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file
from dvrk_gravity.files.lock import lock_folder
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import PlanLimits, Straight
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile

ECM = Arm.load("ecm")


@pytest.fixture(scope="session")
def finished() -> Finished:
    return finished_calibration()


def test_what_is_killed_after_every_step_goes_on_from_the_last_one(finished):
    names = [step.name for step in all_steps(BRIEF)]
    assert [entry.step for entry in Logbook.open(finished.folder, ASKED).entries] == names
    taken = [[line.split(":")[0] for line in run if "(done before)" not in line]
             for run in finished.runs]  # fmt: skip
    assert [len(run) for run in taken] == [1] * (len(taken) - 1) + [0]
    assert len(set(map(tuple, taken))) == len(taken)
    assert len(finished.runs[-1]) == len(taken) - 1  # each is said once more
    assert not list(finished.folder.glob(".*"))  # what was half written is removed


@pytest.mark.parametrize("resumes", [True, False], ids=["an arm", "simulated"])
def test_a_motion_that_was_interrupted_becomes_one_whole_recording(finished, tmp_path, resumes):
    folder = finished.before("collect second", tmp_path / "again")
    shutil.rmtree(folder / "second")
    rig = PathRig(finished.arm, resumes)

    def dies(name: str, part: float | None, stage: str = "") -> None:
        if (part or 0.0) > 0.5 and name.endswith("motion, recorded"):
            raise KilledError

    with pytest.raises(KilledError):
        finished.take("collect second", folder, progress=dies, rig=rig)
    assert (folder / "second.unfinished").exists()
    begun = Logbook.open(folder, ASKED).begun
    outcome = finished.take("collect second", folder, rig=rig)
    assert not (folder / "second.unfinished").exists()
    again, once = (Recording.load(each / "second") for each in (folder, finished.folder))
    assert len(again) == pytest.approx(len(once), abs=3)
    if not resumes:  # it is made again the same, to the last bit
        assert np.array_equal(again.position, once.position)
        assert np.array_equal(again.effort, once.effort)
    assert (np.diff(again.time).max() > 0.1) == resumes  # where it was cut
    whole = BRIEF.check_duration
    assert 0.5 * whole < begun["seconds"]  # of the process that died: they count
    assert outcome.motion.seconds >= 0.5 * whole if resumes else outcome.motion.seconds >= whole


def test_a_recording_that_was_whole_when_it_was_killed_is_not_made_again(finished, tmp_path):
    folder = finished.before("collect second", tmp_path / "again")
    before = (folder / "second" / "metadata.yaml").read_bytes()
    outcome = finished.take("collect second", folder)
    assert (outcome.motion, outcome.paths) == (MotionTally(0.0, 0.0), (folder / "second",))
    assert (folder / "second" / "metadata.yaml").read_bytes() == before


def test_a_recording_of_another_motion_is_not_taken_for_the_one_held_out(finished, tmp_path):
    folder = finished.before("collect second", tmp_path / "again")
    shutil.rmtree(folder / "second")
    shutil.copytree(folder / "motion", folder / "second")
    with pytest.raises(ConfigError, match=r"second: .*another motion"):
        finished.take("collect second", folder)


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


def test_another_arm_seed_or_limit_is_named_once_a_step_is_done(finished, tmp_path):
    for option, value in (("--arm", "psm"), ("--seed", "2"), ("--limits", "narrow.yaml (12ab)")):
        with pytest.raises(ConfigError, match=option) as raised:
            Logbook.open(finished.folder, {**ASKED, option: value})
        assert value in str(raised.value)
        assert "None" not in str(raised.value)
    Logbook.open(tmp_path, ASKED | {"--limits": "none can be kept"})  # and no step
    book = Logbook.open(tmp_path, ASKED | {"--limits": "wider"})
    book.add("plan motion", "", (), {})
    with pytest.raises(ConfigError, match="--limits: got 'narrow', expected wider"):
        Logbook.open(tmp_path, ASKED | {"--limits": "narrow"})


def test_a_file_that_was_changed_or_removed_is_named(finished, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(finished.folder, folder)
    for name in ("motion.yaml", "model_0.json", "motion/metadata.yaml"):
        before = (folder / name).read_bytes()
        (folder / name).write_bytes(before + b"\n")
        with pytest.raises(ConfigError, match=rf"{name}: got '.*changed"):
            Logbook.open(folder, ASKED)
        (folder / name).unlink()
        with pytest.raises(ConfigError, match=rf"{name}: got 'no file'"):
            Logbook.open(folder, ASKED)
        (folder / name).write_bytes(before)
    Logbook.open(folder, ASKED)


def test_a_folder_of_something_else_is_refused_and_kept(tmp_path):
    for name in ("notes.txt", ".pre-commit-config.yaml", ".zshrc.local"):
        folder = tmp_path / name.strip(".")
        folder.mkdir()
        (folder / name).write_text("mine")
        (folder / ".model.yaml.x1y2z3_4").write_text("theirs")
        with pytest.raises(ConfigError, match=name):
            Logbook.open(folder, ASKED)
        assert len(list(folder.iterdir())) == 2


def test_two_at_once_in_one_folder_are_refused(finished, tmp_path):
    with lock_folder(tmp_path, "--out"), pytest.raises(ConfigError, match="--out"):
        calibrate(work_in(tmp_path, finished.arm))
    assert not list(tmp_path.iterdir())


def test_a_damaged_logbook_is_one_line(tmp_path):
    step = {"step": "plan motion", "said": "", "files": {}, "motion": {}}
    for steps in (
        ["plan motion"], [{"step": "plan motion"}], [step | {"files": "x"}],
        [step | {"motion": {"seconds": 1.0}}], [step | {"motion": [1]}], 1,
    ):  # fmt: skip
        content = {"format": 1, "asked": ASKED, "steps": steps}
        (tmp_path / "calibration.json").write_text(json.dumps(content))
        with pytest.raises(ConfigError, match=r"calibration\.json: ") as caught:
            Logbook.open(tmp_path, ASKED)
        assert "\n" not in str(caught.value)


def test_a_folder_of_another_arm_is_refused_and_kept_as_it_is(tmp_path, capsys):
    Logbook.open(tmp_path, ASKED | {"--arm": "psm"}).add("plan motion", "", (), {})
    before = (tmp_path / "calibration.json").read_bytes()
    assert main(["calibrate", "--arm", "ecm", "--simulated", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "--arm: got 'ecm" in line
    assert "psm" in line
    assert [path.name for path in tmp_path.iterdir()] == ["calibration.json"]
    assert (tmp_path / "calibration.json").read_bytes() == before


# --- released ------------------------------------------------------------------------------


def test_limits_or_files_that_change_between_two_releases_end_them(finished, tmp_path):
    """The certificate has the hash of the model that was checked: another one is not released."""
    for name in ("", "checked.yaml", "second.yaml"):
        folder, rig = finished.before("release", tmp_path / f"again{name}"), PathRig(finished.arm)

        def change(folder=folder, name=name) -> None:
            if name:
                with (folder / name).open("a") as file:
                    file.write("# another\n")

        def limits_now(rig=rig, name=name):
            if rig.released and not name:
                raise MotionError("the limits have changed")
            return PlanLimits.of(finished.arm)

        rig.on_release = change
        with pytest.raises(ConfigError if name else MotionError, match=name or "have changed"):
            calibrate(finished.work(folder, rig=rig, limits_now=limits_now))
        assert len(rig.released) == 1, name


def test_no_step_writes_over_what_an_earlier_one_has_left(finished):
    """A process may be killed between the file and the logbook's entry: it would look changed."""
    entries = Logbook.open(finished.folder, ASKED).entries
    names = [name for entry in entries for name in entry.files]
    assert sorted(names) == sorted(set(names))
    (released,) = (entry for entry in entries if entry.step == "release")
    assert "model.yaml" in released.files


def test_an_arm_is_released_with_consent_at_poses_away_from_what_was_fitted(finished, tmp_path):
    folder, rig = finished.before("release", tmp_path / "again"), PathRig(finished.arm)
    with pytest.raises(MotionError, match="consent"):
        finished.take("release", folder, rig=rig, consent=lambda question: False)
    assert not rig.released
    finished.take("release", folder, rig=rig)
    model, limits = TorqueModel.load(folder / "checked.yaml"), PlanLimits.of(finished.arm)
    fitted = Recording.load(folder / "motion").position[::10]
    poses, apart = release_poses(finished.arm, limits, model, fitted, BRIEF, 5, fitted[0])
    away = np.abs((poses[:, None] - fitted) / finished.arm.scale).max(axis=2).min(axis=1)
    assert away.min() == pytest.approx(apart)
    assert apart >= BRIEF.min_distance
    for each in (poses, np.array(rig.released)):
        assert len(each) == BRIEF.poses
        assert ((each >= limits.lower) & (each <= limits.upper)).all()
    rig.drift = np.full(finished.arm.n, np.nan)
    with pytest.raises(MotionError, match="finite"):
        finished.take("release", folder, rig=rig)


def test_arms_of_one_seed_are_the_same_and_of_two_are_not():
    plant = PlantFile.of(ECM)
    first, again, other = (draw_arm(plant, seed) for seed in (3, 3, 4))
    q = np.random.default_rng(0).uniform(*ECM.range, (5, ECM.n))
    state = State(q, 0.3 * ECM.scale + 0.0 * q)
    torques = [each.model.torque_at(state) for each in (first, again, other)]
    assert np.array_equal(torques[0], torques[1])
    assert (np.abs(torques[0] - torques[2]).max(axis=0) > 0.0).all()
    assert first.model.joint_offset.any()
    assert not np.allclose(first.model.gravity, ECM.gravity)


# --- limits --------------------------------------------------------------------------------


def test_a_command_beyond_a_limit_or_no_number_is_refused_before_the_arm_moves():
    limits = PlanLimits.of(ECM)
    where = 0.5 * (ECM.lower + ECM.upper)
    way = Straight.within(where, where + 0.2 * ECM.scale, limits, 1.0)
    for change, match in (
        ({"velocity": 0.1 * limits.velocity}, "velocity"),
        ({"acceleration": 0.9 * limits.acceleration}, "acceleration"),
        ({"upper": where + 0.19 * ECM.scale}, "position"),
    ):
        driver = PathDriver(ECM, where)
        kept = CheckedDriver(driver, replace(limits, **change), ECM)
        with pytest.raises(MotionError, match=match):
            kept.follow(way.at, way.duration)
        assert not driver.commanded
        assert kept.seconds == 0.0

    def lost(time):
        q, qd, qdd = way.at(time)
        return np.where(np.asarray(time)[..., None] > 0.5 * way.duration, np.nan, q), qd, qdd

    driver = PathDriver(ECM, where)
    kept = CheckedDriver(driver, limits, ECM)
    with pytest.raises(MotionError, match="finite number"):
        kept.follow(lost, way.duration)
    assert not driver.commanded
    kept.follow(way.at, way.duration)
    assert kept.check.samples >= 1000.0 * way.duration
    assert 0.99 < kept.check.used <= 1.0 + 1e-9  # as quick as the limits allow


@pytest.mark.parametrize("rehearsing", [False, True])
def test_of_a_path_that_is_stopped_the_time_up_to_there_counts(rehearsing):
    where, notes = 0.5 * (ECM.lower + ECM.upper), list[MotionTally]()
    limits = PlanLimits.of(ECM)
    way = Straight.within(where, where + 0.2 * ECM.scale, limits, 0.1)
    half = 0.5 * way.duration
    driver = PathDriver(ECM, where, lambda phase, time: KilledError() if time > half else None)
    kept = CheckedDriver(driver, limits, ECM, notes.append)
    kept.rehearsing = rehearsing
    with pytest.raises(KilledError):
        kept.follow(way.at, way.duration)

    def seconds(motion: MotionTally) -> float:
        other, own = (motion.seconds, motion.rehearsed)[:: 1 if rehearsing else -1]
        assert other == 0.0
        return own

    assert seconds(notes[0]) == way.duration  # were it killed: all of it
    assert seconds(notes[-1]) == pytest.approx(half, abs=0.02)
    assert kept.motion() == notes[-1]


def test_steps_of_another_version_and_hashes_of_all_files_are_on_the_certificate(
    finished, tmp_path
):
    folder = finished.before("certify", tmp_path / "again")
    book = json_file.load(folder / "calibration.json")
    book["steps"][0]["version"] = "0.0.1"
    (folder / "calibration.json").write_text(json.dumps(book))
    found = calibrate(finished.work(folder))
    made = found["versions"]["dvrk_gravity"]
    assert made == f"0.0.1, {__version__}"
    assert made in (folder / "certificate.html").read_text()
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    own = {"calibration.json", "certificate.json", "certificate.html"}
    assert there - set(found["files"]) == own
    assert all(file_hash(folder / name) == known for name, known in found["files"].items())
