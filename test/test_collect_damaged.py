"""Collecting, from damaged or edited files, and beside another process: one line, nothing moves."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from test_collect import BRIEF, PathDriver, go, once, plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import EffortWatch, SimulatedDriver, collect
from dvrk_gravity.command_line import run
from dvrk_gravity.compensate import MotionError, Sample
from dvrk_gravity.errors import ConfigError, DvrkGravityError
from dvrk_gravity.files.lock import alone_in
from dvrk_gravity.planning import Box, Plan, load_limits
from dvrk_gravity.simulate import PlantFile


def stopped(folder: Path) -> tuple[PathDriver, Path, Path]:
    """Return an arm, the bag that it was to have, and the state that a stopped motion left."""
    plan, out = plan_of("ecm"), folder / "bag"
    driver = PathDriver(plan, plan.at(0.0)[0], once("motion, recorded", 2.0, MotionError("hand")))
    with pytest.raises(MotionError):
        go(driver, out, rehearse=False)
    driver.commanded.clear()
    return driver, out, folder / "bag.unfinished" / "state.json"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("motion", 1), ("motion", -1), ("motion", "0"), ("moment", "2"), ("moment", -1.0),
        ("moment", True), ("phase", "resting"), ("phase", []), ("approaching", "no"), ("why", 1),
        ("parts", [{"name": "../bag", "keep": None, "marks": []}]),
        ("parts", [{"name": "part_1", "keep": -3, "marks": []}]),
        ("parts", [{"name": "part_1", "keep": None, "marks": [[0, "a", 1]]}]),
        ("parts", [{"name": "part_1", "keep": None, "marks": [[0, 1.0]]}]), ("parts", {"a": 1}),
        ("parts", [{"name": "part_1", "keep": None, "marks": [[0, 4.1, 1]]}]), ("moment", 1e5),
        ("parts", [{"name": "part_1", "keep": None, "marks": [[1, 1.0, 1]]}]),
    ],
)  # fmt: skip
def test_a_state_that_nothing_wrote_moves_nothing(tmp_path: Path, name: str, value: object) -> None:
    driver, out, state = stopped(tmp_path)
    state.write_text(json.dumps(json.loads(state.read_text()) | {name: value}))
    with pytest.raises(ConfigError, match=r"state\.json: got .*a state as `collect`") as caught:
        go(driver, out, resume=True)
    assert "\n" not in str(caught.value)
    assert not driver.commanded


def test_a_state_of_another_version_is_named_by_its_format(tmp_path: Path) -> None:
    driver, out, state = stopped(tmp_path)
    state.write_text(json.dumps(json.loads(state.read_text()) | {"format": 2}))
    with pytest.raises(ConfigError, match="format: got 2, expected 1"):
        go(driver, out, resume=True)


def test_what_was_begun_with_one_arm_is_not_resumed_with_another_of_the_same_joints(
    tmp_path: Path,
) -> None:
    driver, out, _ = stopped(tmp_path)
    other = replace(driver.plan, arm=replace(driver.plan.arm, name="other"))
    with pytest.raises(ConfigError, match="another plan"):
        go(driver, out, other, resume=True)
    assert not driver.commanded


def test_a_part_that_is_gone_or_cut_is_missed_and_the_bag_is_not_written(tmp_path: Path) -> None:
    driver, out, state = stopped(tmp_path)
    content = json.loads(state.read_text())
    content["parts"][0]["marks"][-1][2] += 1000
    state.write_text(json.dumps(content | {"phase": "joining"}))
    with pytest.raises(DvrkGravityError, match=r"part_1: has \d+ messages, expected 1\d+"):
        go(driver, out, resume=True)
    assert not out.exists()
    shutil.rmtree(state.parent / "part_1")
    with pytest.raises(DvrkGravityError, match=r"part_1: is gone"):
        go(driver, out, resume=True)
    assert not driver.commanded


def test_what_a_state_lost_of_a_motion_is_missed_and_the_bag_is_not_written(tmp_path: Path) -> None:
    driver, out, state = stopped(tmp_path)
    content = json.loads(state.read_text())
    content["parts"][0]["marks"] = [mark for mark in content["parts"][0]["marks"] if mark[1] > 1.0]
    state.write_text(json.dumps(content))
    with pytest.raises(
        DvrkGravityError, match=r"motion 1 nothing was recorded from 0.0 to 1\.\d s"
    ):
        go(driver, out, resume=True)
    assert not out.exists()


def test_a_collection_that_another_process_makes_is_left_alone(tmp_path: Path) -> None:
    driver, out, state = stopped(tmp_path)
    before = state.read_bytes()
    with (
        alone_in(state.parent, "--out"),
        pytest.raises(ConfigError, match=r"--out: got .* no other process"),
    ):
        go(driver, out, resume=True)
    assert state.read_bytes() == before
    assert not driver.commanded
    go(driver, out, resume=True, rehearse=False)
    assert out.exists()
    assert not state.parent.exists()


def faster(content: Any) -> None:
    content["motion"]["sine"]["pitch"][1] += 1.0


def longer(content: Any) -> None:
    content["motion"]["duration"] = 1e5


def shaken(content: Any) -> None:
    content["motion"]["frequency"][1] = 1e300


def abrupt(content: Any) -> None:
    content["motion"]["ramp"] = 1e-300


def huge(content: Any) -> None:
    content["limits"]["joints"]["pitch"]["velocity"] = 10**400


def tiny(content: Any) -> None:
    content["limits"]["joints"]["pitch"]["velocity"] = 5e-324


def unreachable(content: Any) -> None:
    content["limits"]["joints"]["pitch"]["velocity"] = 1e300


def narrow(content: Any) -> None:
    content["limits"]["joints"]["yaw"]["position"] = [-1.0, 1.0]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (faster, "the plan exceeds the limit of"), (narrow, "the plan exceeds the limit of pos"),
        (tiny, "pitch.velocity: got 5e-324, expected a number above 0"),
        (unreachable, "pitch.velocity: got 1e+300, expected at most the arm's"),
        (longer, "motion: got '1e+05 s', expected at most 10000 s"), (huge, "a finite number"),
        (shaken, "finite numbers up to 1e+06"), (abrupt, "motion.ramp: got 1e-300"),
    ],
)  # fmt: skip
def test_a_plan_edited_beyond_its_limits_is_one_line_and_nothing_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], edit, says
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(SimulatedDriver, "_command", lambda *_: pytest.fail("it moves"))
    plan_of("ecm").save("plan.yaml")
    content = yaml.safe_load(Path("plan.yaml").read_text())
    edit(content)
    Path("plan.yaml").write_text(yaml.safe_dump(content))
    words = ["plan.yaml", "--out", "bag", "--simulated", "--yes"]
    assert run("dvrk_gravity.cli.collect", words) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.yaml"]


def test_a_plan_that_was_cut_anywhere_is_refused(tmp_path: Path) -> None:
    plan, path = plan_of("ecm"), tmp_path / "plan.yaml"
    box = Box("panel", (5.0, 5.0, 5.0), (6.0, 6.0, 6.0), plan.arm.body_names[-1:])
    replace(plan, limits=replace(plan.limits, boxes=(box,))).save(path)
    whole = path.read_bytes()
    for cut in range(0, len(whole) - 1, 13):
        path.write_bytes(whole[:cut])
        with pytest.raises(ConfigError):
            Plan.load(path)


def test_an_integer_beyond_every_double_is_no_limit(tmp_path: Path) -> None:
    (tmp_path / "limits.yaml").write_text(f"joints: {{yaw: {{velocity: {10**400}}}}}")
    with pytest.raises(ConfigError, match="a finite number"):
        load_limits(tmp_path / "limits.yaml", plan_of("ecm").arm)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["plan.yaml", "--out", "bag", "--model", "mtml.yaml", "--simulated", "--yes"],
         "mtml.yaml: --model: got 'mtml', expected a model of mtmr"),
        (["--teach", "limits.yaml", "--arm", "mtmr", "--from", "ecm.csv"], "ecm.csv: lacks outer"),
        (["plan.yaml", "--out", "link", "--simulated", "--yes"], "a new name, not a link"),
        (["plan.yaml", "--out", "bag?x", "--simulated", "--yes"], "bag?x: expected a path without"),
    ],
)  # fmt: skip
def test_another_arm_and_a_link_are_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    plan_of("mtmr").save("plan.yaml")
    PlantFile.of(Arm.load("mtml")).model.save("mtml.yaml")
    Path("ecm.csv").write_text("time,yaw.position,yaw.effort\n0.0,0.1,0\n0.1,0.2,0\n")
    Path("link").symlink_to("nowhere")
    assert run("dvrk_gravity.cli.collect", words) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not list(tmp_path.glob("*.unfinished"))


# --- efforts -----------------------------------------------------------------------------------


def watch_of(plan: Plan, monkeypatch: pytest.MonkeyPatch, half: float) -> EffortWatch:
    """Return a watch by a model whose torque is 0, and whose band has a half width."""

    def band(model: object, state: Any) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(state.q), np.full_like(state.q, half)

    monkeypatch.setattr("dvrk_gravity.collecting.effort_watch.effort_band", band)
    model: Any = SimpleNamespace(uncertainty=None)
    return EffortWatch(plan.at, plan.arm, plan.limits.effort, model)


def sample(plan: Plan, time: float, effort: np.ndarray | None) -> Sample:
    position, velocity, _ = plan.at(time)
    return Sample(round(1e9 * (1.0 + time)), position, velocity, effort)


@pytest.mark.parametrize("half", [np.nan, np.inf])
def test_where_a_model_knows_nothing_the_limits_of_efforts_count(
    monkeypatch: pytest.MonkeyPatch, half: float
) -> None:
    plan = plan_of("ecm")
    watch = watch_of(plan, monkeypatch, half)
    below, above = 0.9 * plan.arm.effort_limit, 1.3 * plan.arm.effort_limit * np.eye(4)[1]
    for time in np.arange(0.0, 1.0, 0.01):
        watch(sample(plan, time, below), time)
    watch(sample(plan, 1.0, above), 1.0)
    with pytest.raises(MotionError, match="pitch's motor has"):
        watch(sample(plan, 1.2, above), 1.2)


def test_after_a_pause_efforts_are_compared_with_where_the_path_is_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = plan_of("ecm")
    watch = watch_of(plan, monkeypatch, 0.0)
    none = np.zeros(plan.arm.n)
    for time in (0.0, 0.9, 3.7):
        watch(sample(plan, time, none), time)


@pytest.mark.parametrize("watched", [True, False])
def test_efforts_that_are_missing_stop_an_arm_with_a_model_and_without_one(
    monkeypatch: pytest.MonkeyPatch, watched: bool
) -> None:
    plan = plan_of("ecm")
    watch = watch_of(plan, monkeypatch, 0.0)
    if not watched:
        watch = EffortWatch(plan.at, plan.arm, plan.limits.effort, None)
    watch(sample(plan, 0.0, None), 0.0)
    watch(sample(plan, 0.05, np.zeros(plan.arm.n)), 0.05)  # one alone may be lost
    watch(sample(plan, 0.1, None), 0.1)
    with pytest.raises(MotionError, match="no finite efforts"):
        watch(sample(plan, 0.3, None), 0.3)


def test_a_plan_whose_efforts_the_model_does_not_know_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of("ecm", size=0.9)
    nothing = np.full((1, plan.arm.n), np.nan)
    monkeypatch.setattr(
        "dvrk_gravity.planning.keeping.efforts",
        lambda model, state: (np.tile(nothing, (len(state.q), 1)),) * 2,
    )
    driver = PathDriver(plan, plan.at(0.0)[0])
    with pytest.raises(MotionError, match=r"the plan exceeds the limit of effort"):
        go(driver, tmp_path / "bag", model=PlantFile.of(plan.arm).model)
    assert not driver.commanded


# --- what a simulated arm is commanded ----------------------------------------------------------


def test_no_command_to_a_simulated_arm_is_beyond_a_limit_wherever_it_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From outside of a limit it comes in; stopped and resumed twice, it is left at rest."""
    plan, random = plan_of("ecm"), np.random.default_rng(1)
    limits = plan.limits
    start = plan.at(0.0)[0].copy()
    start[0] = limits.upper[0] + np.radians(3.0)
    with SimulatedDriver(PlantFile.of(plan.arm), rate=1000.0, at=start) as driver:
        where = driver.connect()
        commanded, servo = [where], driver.arm.servo_jp
        monkeypatch.setattr(
            driver.arm, "servo_jp", lambda q: (commanded.append(np.array(q)), servo(q))[1]
        )
        for moment in (*random.uniform(0.5, 3.5, 2), np.inf):

            def stop(phase: str, part: float, moment: float = moment) -> None:
                if phase.startswith("motion") and part * plan.duration > moment:
                    raise KeyboardInterrupt

            try:
                collect(
                    plan, driver, tmp_path / "bag", rehearse=False, resume=True, settings=BRIEF,
                    report=lambda line: None, progress=stop,
                )  # fmt: skip
            except KeyboardInterrupt:
                assert np.abs(driver.arm.plant.v).max() < 1e-2
            else:
                assert moment == np.inf
    assert (tmp_path / "bag").exists()
    q = np.array(commanded)
    assert (q >= np.minimum(limits.lower, where) - 1e-3).all()
    assert (q <= np.maximum(limits.upper, where) + 1e-3).all()
    steps = np.abs(np.diff(q, axis=0)) * 1000.0
    assert np.mean((steps <= 1.001 * limits.velocity).all(axis=1)) > 0.999  # but for each hold
