"""A plan is carried out whole or not at all, whatever stops it: on an arm that is only a path."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from path_driver import STEP, WHOLE, PathDriver, at_beginning, go, once, plan_of, positions

from dvrk_gravity.collecting import MotionStoppedError
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.errors import ConfigError, DvrkGravityError, RecordingError
from dvrk_gravity.files.lock import lock_folder
from dvrk_gravity.recording import BagReader, Recording


def test_a_plan_is_approached_rehearsed_at_a_tenth_and_recorded_whole(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    driver = at_beginning(plan, away=0.1)
    found = go(driver, tmp_path / "bag", plan)
    assert driver.phases[1:] == ["approach", "rehearsal", "approach", "motion, recorded"]
    assert (found.samples, found.parts, found.seconds) == (WHOLE, 1, plan.duration)
    assert driver.holds
    np.testing.assert_allclose(positions(found.bag), plan.at(np.arange(WHOLE) * STEP)[0])
    assert list(tmp_path.iterdir()) == [found.bag]
    speeds = np.abs(np.array(driver.commanded)[:, 1])
    assert speeds[-1600:-820].max() <= 0.1 * speeds[-WHOLE:].max() + 1e-12


@pytest.mark.parametrize(
    ("phase", "moment", "error"),
    [
        ("approach", 0.2, MotionError("a hand")),
        ("rehearsal", 17.0, KeyboardInterrupt()),
        ("motion, recorded", 0.25, OSError(28, "full")),
        ("motion, recorded", 1.7, SystemExit()),
        ("motion, recorded", 3.9, MotionError("a hand")),
    ],
    ids=["approach", "Ctrl-C in the rehearsal", "a full disk", "killed", "at the end"],
)
def test_wherever_it_is_stopped_the_arm_is_held_and_a_resumed_recording_is_the_whole_motion(
    tmp_path: Path, phase: str, moment: float, error: BaseException
) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    driver = at_beginning(plan, once(phase, moment, error), 0.1)
    expected = MotionStoppedError if isinstance(error, Exception) else type(error)
    with pytest.raises(expected) as stopped:
        go(driver, out, plan)
    assert driver.holds
    assert not out.exists()
    if isinstance(stopped.value, MotionStoppedError):
        assert stopped.value.phase == ("rehearsal" if phase == "approach" else "motion")
        assert str(error) in str(stopped.value)
        assert "--resume" in str(stopped.value)
        assert "\n" not in str(stopped.value)
    with pytest.raises(RecordingError, match="--resume"):  # by name, and nothing is overwritten
        go(driver, out, plan)
    driver.phases[:] = [""]
    shown = positions(go(driver, out, plan, resume=True).bag)
    whole = plan.at(np.arange(WHOLE) * STEP)[0]
    # Every point of the path, none of them twice; at the joint, a step of the clock.
    assert abs(len(shown) - len(whole)) <= 2
    nearest = np.array([np.abs(shown - point).max(axis=1).min() for point in whole[::10]])
    assert nearest.max() < 1e-2
    assert np.abs(np.diff(shown, axis=0)).max() < 5 * np.abs(np.diff(whole, axis=0)).max()
    assert list(tmp_path.iterdir()) == [out]
    assert ("rehearsal" in driver.phases) == (phase != "motion, recorded")


@pytest.mark.parametrize("again", [False, True], ids=["rehearsed", "and refused when asked"])
def test_what_was_begun_without_a_rehearsal_is_rehearsed_where_that_is_asked_for(
    tmp_path: Path, again: bool
) -> None:
    plan = plan_of("ecm")
    driver = at_beginning(plan, once("motion, recorded", 2.0, MotionError("a hand")))
    with pytest.raises(MotionStoppedError):
        go(driver, tmp_path / "bag", plan, rehearse=False)
    asked: list[str] = []

    def consent(question: str) -> bool:
        asked.append(question)
        return "slowly" in question or not again

    driver.phases[:] = [""]
    if again:
        with pytest.raises(MotionStoppedError, match="no consent"):
            go(driver, tmp_path / "bag", plan, resume=True, consent=consent)
        again = False
    go(driver, tmp_path / "bag", plan, resume=True, consent=consent)
    assert "slowly" in asked[0]
    assert driver.phases.count("rehearsal") == 1  # nor once more than needed
    assert driver.phases.index("rehearsal") < driver.phases.index("motion, recorded")
    assert len(positions(tmp_path / "bag")) >= WHOLE  # what was recorded before counts


def test_several_motions_are_one_bag_and_are_resumed_in_the_one_that_was_stopped(
    tmp_path: Path,
) -> None:
    plans, out = [plan_of("ecm", seed=seed) for seed in (1, 2, 3)], tmp_path / "bag"
    driver = at_beginning(plans[0], once("motion 2 of 3, recorded", 2.0, MotionError("a hand")))
    with pytest.raises(MotionStoppedError, match="motion 2") as stopped:
        go(driver, out, plans, rehearse=False)
    assert stopped.value.moment == pytest.approx(2.0, abs=2 * STEP)
    before = len(driver.phases)
    found = go(driver, out, plans, rehearse=False, resume=True)
    assert "motion 1 of 3, recorded" not in driver.phases[before:]
    assert abs(found.samples - 3 * WHOLE) <= 2
    assert found.parts == 2


def test_stopped_twice_it_still_records_the_whole_motion_and_later_parts_come_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    driver = at_beginning(plan)
    for moment in (2.0, 1.9):
        driver.stop = once("motion, recorded", moment, MotionError("a hand"))
        with pytest.raises(MotionStoppedError):
            go(driver, out, plan, rehearse=False, resume=True)
    now = time.time_ns()  # and this computer's clock is set back
    monkeypatch.setattr("time.time_ns", partial(next, count(now - 10**15, 5_000_000)))
    driver.clock = 10**17  # a simulator that was started again
    assert go(driver, out, plan, rehearse=False, resume=True).parts == 3
    recording = Recording.load(out)
    assert recording.time is not None
    assert abs(len(recording) - WHOLE) <= 3
    assert np.diff(recording.time).min() > 0.0
    assert np.diff(recording.time).max() < 5.0
    with BagReader(out) as bag:  # players and --time-base receive go by it
        received = [each for _, each, _ in bag.raw(driver.topic)]
    assert np.diff(received).min() >= 0
    assert received[0] >= now - 10**11


def test_what_is_taken_up_again_is_one_smooth_way_from_rest(tmp_path: Path) -> None:
    plan = plan_of("ecm", seed=3)
    driver = at_beginning(plan, once("motion, recorded", 3.1, MotionError("busy")))
    with pytest.raises(MotionStoppedError):
        go(driver, tmp_path / "bag", plan, rehearse=False)
    driver.commanded.clear()
    driver.step, rest = 1e-3, driver.at.copy()
    go(driver, tmp_path / "bag", plan, rehearse=False, resume=True)
    way = np.vstack([rest, *(each[0] for each in driver.commanded)])
    speed = np.diff(way, axis=0) / driver.step
    assert (np.abs(speed) <= 1.001 * plan.limits.velocity).all()
    assert (np.abs(speed[[0, -1]]) <= 1e-3).all()
    # Between approach and motion a point comes twice: it is at rest there.
    change = np.diff(speed, axis=0) / driver.step
    assert (np.abs(change) <= 1.01 * plan.limits.acceleration + 1e-6).all()


def test_without_consent_nothing_moves_and_nothing_is_left(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    driver = at_beginning(plan)
    with pytest.raises(MotionError, match="no consent"):
        go(driver, tmp_path / "bag", plan, consent=lambda question: False)
    assert not driver.commanded
    assert not list(tmp_path.iterdir())


def test_a_disk_without_room_is_refused_before_anything_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of("ecm")
    driver = at_beginning(plan)
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=10**6))
    with pytest.raises(RecordingError, match=r"4 MB, .* 1 MB"):  # 4 s at 1 kHz, 500 B each, twice
        go(driver, tmp_path / "bag", plan)
    assert not driver.commanded


def test_a_bag_that_could_not_be_written_in_the_end_moves_nothing_again(tmp_path: Path) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"

    def occupy(phase: str, moment: float) -> None:
        if phase.startswith("motion") and not out.exists():
            (out / "somebody's").mkdir(parents=True)

    driver = at_beginning(plan, occupy)
    with pytest.raises((DvrkGravityError, OSError)):
        go(driver, out, plan, rehearse=False)
    shutil.rmtree(out)
    commanded = len(driver.commanded)
    assert go(driver, out, plan, resume=True).samples == WHOLE
    assert len(driver.commanded) == commanded
    assert list(tmp_path.iterdir()) == [out]


@pytest.fixture
def stopped(tmp_path: Path) -> tuple[PathDriver, Callable[..., Any], Path]:
    """Return an arm, what goes on with its motion that was stopped, and the state of that."""
    plan, out = plan_of("ecm"), tmp_path / "bag"
    driver = at_beginning(plan, once("motion, recorded", 2.0, MotionError("hand")))
    with pytest.raises(MotionError):
        go(driver, out, plan, rehearse=False)
    driver.commanded.clear()

    def resume(other=None, **how):
        return go(driver, out, other or plan, resume=True, **how)

    return driver, resume, tmp_path / "bag.unfinished" / "state.json"


def test_a_state_that_nothing_wrote_moves_nothing(stopped) -> None:
    driver, resume, state = stopped
    written = json.loads(state.read_text())
    part = {"name": "part_1", "keep": None, "marks": []}
    wrong: list[dict[str, object]] = [
        {"motion": 1}, {"moment": -1.0}, {"moment": 1e5}, {"moment": True}, {"phase": "resting"},
        {"parts": [part | {"name": "../bag"}]}, {"parts": [part | {"keep": -3}]},
        {"parts": [part | {"marks": [[0, 4.1, 1]]}]}, {"parts": [part | {"marks": [[1, 1.0, 1]]}]},
        {"format": 2}, {"unheard": 1},
    ]  # fmt: skip
    for text in ("{", "{}", *(json.dumps(written | change) for change in wrong)):
        state.write_text(text)
        with pytest.raises(DvrkGravityError, match=r"state\.json: ") as caught:
            resume()
        assert "\n" not in str(caught.value), text
    assert not driver.commanded
    state.write_text(json.dumps(written))
    resume()


def test_what_was_begun_is_not_resumed_with_another_plan_arm_or_topic(stopped) -> None:
    driver, resume, _ = stopped
    plan = plan_of("ecm")
    for other in (plan_of("ecm", seed=2), replace(plan, arm=replace(plan.arm, name="other"))):
        with pytest.raises(ConfigError, match=r"state\.json: plan"):
            resume(other)
    driver.topic = "/OTHER/measured_js"
    with pytest.raises(ConfigError, match=r"/OTHER/measured_js.* /ARM/measured_js"):
        resume()
    assert not driver.commanded


def test_what_is_gone_of_a_motion_is_missed_and_the_bag_is_not_written(stopped) -> None:
    driver, resume, state = stopped
    written = state.read_text()
    bag = state.parents[1] / "bag"
    content = json.loads(written)
    marks = content["parts"][0]["marks"]
    content["parts"][0]["marks"] = [mark for mark in marks if mark[1] > 1.0]
    state.write_text(json.dumps(content))
    with pytest.raises(DvrkGravityError, match=r"motion 1 .* from 0\.0 to 1\.\d s"):
        resume()
    assert not bag.exists()
    driver.commanded.clear()
    content = json.loads(written)
    content["parts"][0]["marks"][-1][2] += 1000
    state.write_text(json.dumps(content | {"phase": "joining"}))
    with pytest.raises(DvrkGravityError, match=r"part_1: has \d+ messages, expected 1\d+"):
        resume()
    shutil.rmtree(state.parent / "part_1")
    with pytest.raises(DvrkGravityError, match="part_1: is gone"):
        resume()
    assert not bag.exists()
    assert not driver.commanded


def test_a_collection_that_another_process_makes_is_left_alone(stopped) -> None:
    driver, resume, state = stopped
    before = state.read_bytes()
    with lock_folder(state.parent, "--out"), pytest.raises(ConfigError, match=r"--out: got "):
        resume()
    assert state.read_bytes() == before
    assert not driver.commanded
