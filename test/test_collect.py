"""A plan is carried out whole or not at all: by an arm that is only a path, and by a plant."""

from __future__ import annotations

import argparse
import os
import select
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.cli import calibrate, excite, options
from dvrk_gravity.cli import collect as collect_verb
from dvrk_gravity.collecting import (
    Collected,
    CollectSettings,
    EffortSettings,
    EffortWatch,
    MotionStoppedError,
    SimulatedDriver,
    TaughtLimits,
    collect,
)
from dvrk_gravity.command_line import run
from dvrk_gravity.compensate import MotionError, Sample
from dvrk_gravity.effects import State
from dvrk_gravity.errors import DvrkGravityError, RecordingError
from dvrk_gravity.model import ModelUncertainty, TorqueModel, coefficients_of
from dvrk_gravity.planning import (
    Basis,
    Box,
    FourierMotion,
    Plan,
    PlanLimits,
    PosePath,
    covering_plan,
    load_limits,
    save_limits,
    slacks,
)
from dvrk_gravity.recording import BagReader, BagWriter, Recording, encode_joint_state
from dvrk_gravity.simulate import PlantFile

STEP = 5e-3  # s
FINE = 1e-3  # s: limits are kept at 1 kHz
WHOLE = 801  # samples of a motion of 4 s
BRIEF = CollectSettings(disturbed=0.3, mark=0.2)


def plan_of(name: str, duration: float = 4.0, seed: int = 1, size: float = 1.0) -> Plan:
    """A motion that uses all of its velocities or accelerations."""
    arm = Arm.load(name)
    limits = PlanLimits.of(arm)
    random = np.random.default_rng(seed)
    basis = Basis(np.array([0.5, 1.0]), 0.8, duration)
    middle = 0.5 * (limits.lower + limits.upper)
    coefficients = random.normal(size=(4, arm.n)) * arm.scale
    for _ in range(2):
        motion = FourierMotion(basis, middle, coefficients)
        most = max(slack.used for slack in slacks(motion, limits, arm))
        coefficients = (1.0 - 1e-6) * size * coefficients / most
    return Plan(arm, motion, limits)


@dataclass
class PathDriver:
    """An arm that is where it is commanded to be, until something stops it."""

    plan: Plan
    at: np.ndarray
    stop: Callable[[str, float], BaseException | None] = lambda phase, time: None
    topic: str = "/ARM/measured_js"
    step: float = STEP
    clock: int = 10**18
    phases: list[str] = field(default_factory=list)
    commanded: list[np.ndarray] = field(default_factory=list)
    holds: int = 0

    def connect(self) -> np.ndarray:
        return self.at

    def follow(self, path, duration, record=None, progress=None, watch=None) -> float:
        time = np.append(np.arange(0.0, duration, self.step), duration)
        states = path(time)
        for moment, *each in zip(time.tolist(), *states, strict=True):
            error = self.stop(self.phases[-1], moment)
            if error is not None:
                raise error
            self.commanded.append(np.array(each))
            self.at = each[0]
            if progress is not None:
                progress(moment / duration)
            self.clock += round(self.step * 1e9)
            if record is not None:
                record(encode_joint_state(self.clock, self.plan.arm.joint_names, each[0].tolist()))
        return 0.0

    def hold(self) -> None:
        self.holds += 1

    def report(self, line: str) -> None:
        self.phases.append(line.split(":")[0])


def go(driver: PathDriver, out: Path, plans: Any = None, **how: Any) -> Collected:
    return collect(plans or driver.plan, driver, out, report=driver.report, settings=BRIEF, **how)  # type: ignore[arg-type]


def once(phase: str, moment: float, error: BaseException) -> Callable[..., BaseException | None]:
    """Stop the first time that a phase is so far, s of its own time."""
    left = [error]
    return lambda name, time: left.pop() if left and name == phase and time >= moment else None


def positions(out: Path) -> np.ndarray:
    return Recording.load(out).position


def test_a_plan_is_approached_rehearsed_at_a_tenth_and_recorded_whole(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    driver = PathDriver(plan, plan.at(0.0)[0] + 0.1 * plan.arm.scale)
    found = go(driver, tmp_path / "bag")
    assert driver.phases == ["approach", "rehearsal", "approach", "motion, recorded"]
    assert found.samples == WHOLE
    assert found.parts == 1
    assert driver.holds
    np.testing.assert_allclose(positions(found.bag), plan.at(np.arange(WHOLE) * STEP)[0])
    assert list(tmp_path.iterdir()) == [found.bag]
    slow = np.array(driver.commanded)[:, 1]
    assert np.abs(slow[-1600:-820]).max() <= 0.1 * np.abs(slow[-WHOLE:]).max() + 1e-12


STOPS = [
    ("approach", 0.2, MotionError("a hand")),
    ("rehearsal", 0.0, MotionError("a hand")),
    ("rehearsal", 17.0, KeyboardInterrupt()),
    ("motion, recorded", 0.0, MotionError("a hand")),
    ("motion, recorded", 0.25, OSError(28, "full")),
    ("motion, recorded", 1.7, KeyboardInterrupt()),
    ("motion, recorded", 3.9, MotionError("a hand")),
]


@pytest.mark.parametrize(("phase", "moment", "error"), STOPS)
def test_wherever_it_is_stopped_the_arm_is_held_and_a_resumed_recording_is_the_whole_motion(
    tmp_path: Path, phase: str, moment: float, error: BaseException
) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    start = plan.at(0.0)[0] + 0.1 * plan.arm.scale
    driver = PathDriver(plan, start, once(phase, moment, error))
    expected = KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else MotionStoppedError
    with pytest.raises(expected) as stopped:
        go(driver, out)
    assert not out.exists()
    assert driver.holds
    if expected is MotionStoppedError:
        text = str(stopped.value)
        assert phase.split(",")[0] in text
        assert str(error) in text
        assert "--resume" in text
        assert text.count("\n") == 0
    with pytest.raises(RecordingError, match="an earlier collection stopped in its"):
        go(driver, out)
    driver.phases.clear()
    found = go(driver, out, resume=True)
    shown = positions(found.bag)
    whole = plan.at(np.arange(WHOLE) * STEP)[0]
    # Every point of the path, none of them twice; at the joint, a step of the clock.
    assert abs(len(shown) - len(whole)) <= 2
    nearest = np.array([np.abs(shown - point).max(axis=1).min() for point in whole[::10]])
    assert nearest.max() < 1e-2
    assert np.abs(np.diff(shown, axis=0)).max() < 5 * np.abs(np.diff(whole, axis=0)).max()
    assert list(tmp_path.iterdir()) == [out]
    assert ("rehearsal" in driver.phases) == (phase != "motion, recorded")


@pytest.mark.parametrize("name", ["mtmr", "psm", "ecm"])
def test_no_sample_at_1_khz_is_beyond_a_limit_from_an_approach_to_a_motion_taken_up_again(
    tmp_path: Path, name: str
) -> None:
    plan = plan_of(name, seed=3)
    arm, limits = plan.arm, plan.limits
    outside = limits.upper + 0.02 * arm.scale  # further out than a plan goes: inwards only
    driver = PathDriver(plan, outside, once("motion, recorded", 2.3, MotionError("a hand")))
    driver.step = FINE
    rehearse = name == "ecm"
    with pytest.raises(MotionStoppedError):
        go(driver, tmp_path / "bag", rehearse=rehearse)
    go(driver, tmp_path / "bag", rehearse=rehearse, resume=True)
    position, velocity, acceleration = (
        np.array(driver.commanded)[:, k] @ limits.rows.T for k in range(3)
    )
    low, high = limits.range
    inside = np.minimum(position - low, high - position)
    far = np.flatnonzero((inside < -1e-9).any(axis=1))
    assert (np.diff(inside[: len(far) + 1], axis=0)[inside[:-1][: len(far)] < -1e-9] >= -1e-9).all()
    np.testing.assert_array_equal(far, np.arange(len(far)))  # at the very beginning alone
    assert (np.abs(velocity) <= limits.rates[0] + 1e-9).all()
    assert (np.abs(acceleration) <= limits.rates[1] + 1e-9).all()


@pytest.mark.parametrize("again", [False, True], ids=["rehearsed", "and killed when asked"])
def test_what_was_begun_without_a_rehearsal_is_rehearsed_where_that_is_asked_for(
    tmp_path: Path, again: bool
) -> None:
    """Whoever leaves the rehearsal out for one go has not done so for the next one."""
    plan = plan_of("mtmr")
    driver = PathDriver(plan, plan.at(0.0)[0], once("motion, recorded", 2.0, MotionError("a hand")))
    with pytest.raises(MotionStoppedError):
        go(driver, tmp_path / "bag", rehearse=False)
    asked: list[str] = []

    def consent(question: str) -> bool:
        asked.append(question)
        return "slowly" in question or not again

    driver.phases.clear()
    if again:
        with pytest.raises(MotionStoppedError, match="no consent"):
            go(driver, tmp_path / "bag", resume=True, consent=consent)
        again = False
    go(driver, tmp_path / "bag", resume=True, consent=consent)
    assert "slowly" in asked[0]
    assert driver.phases.count("rehearsal") == 1  # nor once more than needed
    assert driver.phases.index("rehearsal") < driver.phases.index("motion, recorded")
    np.testing.assert_allclose(positions(tmp_path / "bag")[-1], plan.at(plan.duration)[0])
    assert len(positions(tmp_path / "bag")) >= WHOLE  # what was recorded before counts


def test_several_motions_are_one_bag_and_are_resumed_in_the_one_that_was_stopped(
    tmp_path: Path,
) -> None:
    plans, out = [plan_of("ecm", seed=seed) for seed in (1, 2, 3)], tmp_path / "bag"
    stop = once("motion 2 of 3, recorded", 2.0, MotionError("a hand"))
    driver = PathDriver(plans[0], plans[0].at(0.0)[0], stop)
    with pytest.raises(MotionStoppedError, match=r"2\.0 s into it of motion 2"):
        go(driver, out, plans, rehearse=False)
    before = len(driver.phases)
    found = go(driver, out, plans, rehearse=False, resume=True)
    assert "motion 1 of 3, recorded" not in driver.phases[before:]
    assert abs(found.samples - 3 * WHOLE) <= 2
    assert found.parts == 2


def test_stopped_twice_it_still_records_the_whole_motion_and_later_parts_come_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    driver = PathDriver(plan, plan.at(0.0)[0])
    for moment in (2.0, 1.9):
        driver.stop = once("motion, recorded", moment, MotionError("a hand"))
        with pytest.raises(MotionStoppedError):
            go(driver, out, rehearse=False, resume=True)
    now = time.time_ns()  # and this computer's clock is set back
    monkeypatch.setattr("time.time_ns", partial(next, count(now - 10**15, 5_000_000)))
    driver.clock = 10**17  # a simulator that was started again
    found = go(driver, out, rehearse=False, resume=True)
    assert found.parts == 3
    recording = Recording.load(out)
    assert recording.time is not None
    assert abs(len(recording) - WHOLE) <= 3
    assert np.diff(recording.time).min() > 0.0
    assert np.diff(recording.time).max() < 5.0
    with BagReader(out) as bag:  # players and --time-base receive go by it
        received = [each for _, each, _ in bag.raw(driver.topic)]
    assert np.diff(received).min() >= 0
    assert received[0] >= now - 10**11


def test_slow_poses_are_collected_too(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    poses = plan.motion.middle + 0.1 * plan.arm.scale * np.array([[0.0], [1.0]])
    path = PosePath(poses, 0.02 * plan.arm.scale, 0.3, 0.9, plan.limits)
    of_poses = replace(plan, motion=path)
    driver = PathDriver(of_poses, poses[1], once("motion, recorded", 3.0, MotionError("a hand")))
    with pytest.raises(MotionStoppedError):
        go(driver, tmp_path / "bag")
    found = go(driver, tmp_path / "bag", resume=True)
    assert abs(found.samples - path.duration / STEP) <= 3


def test_a_limit_that_is_tightened_meanwhile_stops_what_does_not_keep_it(tmp_path: Path) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    tight = replace(plan.limits, acceleration=0.5 * plan.limits.acceleration)
    driver = PathDriver(plan, plan.at(0.0)[0])
    now = [plan.limits]

    def consent(question: str) -> bool:
        if question.startswith("rehearsed"):
            now[0] = tight
        return True

    says = r"exceeds the limit of acceleration of \w+ by [\d.e-]+ (deg|m)/s².*--resume"
    with pytest.raises(MotionStoppedError, match=says):
        go(driver, out, limits=lambda: now[0], consent=consent)
    assert driver.holds
    assert driver.phases[-1] == "rehearsal"
    with pytest.raises(MotionError, match="exceeds the limit of acceleration"):  # and stays so
        go(driver, out, limits=lambda: now[0], resume=True)
    assert driver.phases[-1].startswith("going on")
    found = go(driver, out, limits=lambda: plan.limits, resume=True)
    assert found.samples >= WHOLE - 2


def test_an_approach_through_a_box_is_refused(tmp_path: Path) -> None:
    plan = plan_of("ecm", size=0.1)
    from dvrk_gravity.planning import link_origins, tip

    arm = plan.arm
    start = plan.at(0.0)[0]
    where = start + np.array([0.8, 0.0, 0.0, 0.0])
    half = link_origins(arm, (tip(arm),), (0.5 * (start + where))[None])[0, 0]
    box = Box("post", tuple(half - 0.01), tuple(half + 0.01), (tip(arm),))
    limits = replace(plan.limits, boxes=(box,))
    driver = PathDriver(plan, where)
    with pytest.raises(MotionStoppedError, match=r"takes .* from post"):
        go(driver, tmp_path / "bag", limits=lambda: limits)
    assert not driver.commanded


def test_without_consent_nothing_moves_and_nothing_is_left(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    driver = PathDriver(plan, plan.at(0.0)[0])
    with pytest.raises(MotionError, match="no consent"):
        go(driver, tmp_path / "bag", consent=lambda question: False)
    assert not driver.commanded
    assert not list(tmp_path.iterdir())


def test_another_plan_or_another_arm_is_not_what_was_begun(tmp_path: Path) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    driver = PathDriver(plan, plan.at(0.0)[0], once("motion, recorded", 2.0, MotionError("hand")))
    with pytest.raises(MotionStoppedError):
        go(driver, out)
    with pytest.raises(DvrkGravityError, match=r"state.json: plan: got 'another plan'"):
        go(driver, out, plan_of("ecm", seed=2), resume=True)
    driver.topic = "/OTHER/measured_js"
    with pytest.raises(DvrkGravityError, match="expected /ARM/measured_js, as it began"):
        go(driver, out, resume=True)


@pytest.mark.parametrize("text", ["{", "{}", '{"format": 1}', '{"format": 1, "parts": 3}'])
def test_a_damaged_state_is_one_line(tmp_path: Path, text: str) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    (tmp_path / "bag.unfinished").mkdir()
    (tmp_path / "bag.unfinished" / "state.json").write_text(text)
    with pytest.raises(DvrkGravityError, match=r"state.json") as error:
        go(PathDriver(plan, plan.at(0.0)[0]), out, resume=True)
    assert "\n" not in str(error.value)


def test_a_disk_without_room_is_refused_before_anything_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of("ecm")
    driver = PathDriver(plan, plan.at(0.0)[0])
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=10**6))
    with pytest.raises(RecordingError, match=r"needs up to 4 MB, .* has 1 MB left"):
        go(driver, tmp_path / "bag")
    assert not driver.commanded


def test_a_disk_that_fills_up_keeps_what_was_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    write = BagWriter.write

    def full(self: BagWriter, *what: Any) -> None:
        if self.count > 500:
            raise RecordingError(self.path, "cannot be written: No space left on device")
        write(self, *what)

    driver = PathDriver(plan, plan.at(0.0)[0])
    with monkeypatch.context() as patched:
        patched.setattr(BagWriter, "write", full)
        with pytest.raises(MotionStoppedError, match=r"2.5 s into it: .*No space left"):
            go(driver, out)
    commanded = len(driver.commanded)
    go(driver, out, resume=True)
    assert len(driver.commanded) - commanded < 800  # not the motion's first seconds again
    assert abs(len(positions(out)) - WHOLE) <= 2


def test_a_process_that_is_killed_while_it_writes_the_bag_moves_nothing_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    driver = PathDriver(plan, plan.at(0.0)[0])

    def killed(*_: Any) -> None:
        raise SystemExit

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", killed)
        with pytest.raises(SystemExit):
            go(driver, out, rehearse=False)
    commanded = len(driver.commanded)
    assert go(driver, out, resume=True).samples == WHOLE
    assert len(driver.commanded) == commanded
    assert list(tmp_path.iterdir()) == [out]


# --- a plant ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ecm() -> PlantFile:
    return PlantFile.of(Arm.load("ecm"))


def driven(plant: PlantFile, out: Path, disturb=None, **how: Any) -> Collected:
    plan = plan_of("ecm", size=0.9)
    with SimulatedDriver(plant, at=plan.at(0.0)[0] - 0.02 * plan.arm.scale) as driver:
        if disturb is not None:
            driver.disturb = disturb
        return collect(
            plan, driver, out, rehearse=False, settings=BRIEF, report=lambda line: None, **how
        )


def test_a_simulated_arm_is_moved_and_recorded_as_planned(tmp_path: Path, ecm: PlantFile) -> None:
    found = driven(ecm, tmp_path / "bag", model=ecm.model)
    recording = Recording.load(found.bag)
    plan = plan_of("ecm", size=0.9)
    assert recording.time is not None
    assert recording.rate == pytest.approx(200.0)
    late = plan.at(np.maximum(recording.time - 0.08, 0.0))[0]  # its servo lags
    assert (np.abs(recording.position - late).max(axis=0) < 0.03 * plan.arm.scale).all()
    assert recording.effort is not None


@pytest.mark.parametrize("gentle", [False, True])
def test_a_hand_on_a_simulated_arm_is_noticed_by_the_effort_that_its_model_does_not_expect(
    tmp_path: Path, ecm: PlantFile, gentle: bool
) -> None:
    """A push that the servo resists, so that the arm does not leave its path."""
    share = 0.02 if gentle else 0.3

    def hand(arm) -> None:
        if arm.plant.time > 4.5:
            arm.push(share * arm.plant.model.arm.effort_limit * np.eye(4)[1], 0.01)

    if gentle:
        driven(ecm, tmp_path / "bag", hand, model=ecm.model)
        return
    with pytest.raises(MotionStoppedError, match=r"pitch's motor has .* is a hand on the arm"):
        driven(ecm, tmp_path / "bag", hand, model=ecm.model)


def test_an_undisturbed_arm_needs_half_of_the_margin(tmp_path: Path) -> None:
    """An MTM needs the most; where its margin is too small, it is stopped."""
    plant, plan = PlantFile.of(Arm.load("mtmr")), covering_plan(Arm.load("mtmr"), 8.0, 3)
    half = EffortSettings(margin=0.5 * EffortSettings().margin)
    watch = EffortWatch(plan.at, plan.arm, plan.limits.effort, plant.model, half)
    none = EffortSettings(margin=1e-3)
    strict = EffortWatch(plan.at, plan.arm, plan.limits.effort, plant.model, none)
    with SimulatedDriver(plant, at=plan.at(0.0)[0]) as driver:
        driver.connect()
        driver.follow(plan.at, 6.0, watch=watch)
    with SimulatedDriver(plant, at=plan.at(0.0)[0]) as driver:
        driver.connect()
        with pytest.raises(MotionError, match="expected by its model and its limits"):
            driver.follow(plan.at, 6.0, watch=strict)


@pytest.mark.parametrize("lacks", ["a weight", "a cable"])
def test_an_undisturbed_arm_is_not_stopped_where_its_model_was_not_identified(
    ecm: PlantFile, lacks: str
) -> None:
    """A weight taken for a cable, or a cable held constant, is right within the range alone."""
    plan, arm, truth = covering_plan(ecm.model.arm, 8.0, 3), ecm.model.arm, ecm.model
    start, near, values = plan.at(0.0)[0], 0.02 * arm.scale, truth.parameters()

    def with_cables(offset: np.ndarray, stiffness: np.ndarray) -> TorqueModel:
        cables = zip(arm.joint_names, offset.tolist(), stiffness.tolist(), strict=True)
        return TorqueModel.from_parameters(
            values | {f"elastic_cable.{name}": (a, k) for name, a, k in cables}, arm
        )

    none = np.zeros(arm.n)
    if lacks == "a cable":
        stiff = 6.0 * EffortSettings().margin * arm.effort_limit / arm.scale
        truth = with_cables(-stiff * start, stiff)
    else:
        values |= {
            name: tuple(8.0 * np.array(value))
            for name, value in values.items()
            if name.startswith("link_weight")
        }
    weak = with_cables(truth.torque(start) - with_cables(none, none).torque(start), none)
    known = ModelUncertainty(
        coefficients_of(weak.terms), {}, np.zeros((4, 0)), np.zeros((3, 0)),
        0.01 * arm.effort_limit, 5.0, np.full(4, 0.1), start - near, start + near,
        plan.limits.velocity,
    )  # fmt: skip
    everywhere = replace(known, lower=plan.limits.lower, upper=plan.limits.upper)

    def go_along(model: TorqueModel, push: float = 0.0) -> None:
        watch = EffortWatch(plan.at, arm, plan.limits.effort, model)
        for moment in np.arange(0.0, plan.duration, 0.02).tolist():
            q, qd, qdd = (each[None] for each in plan.at(moment))
            effort = truth.torque_at(State(q, qd, qdd))[0] + push * arm.effort_limit
            watch(Sample(round(1e9 * moment) + 1, q[0], qd[0], effort), moment)

    go_along(replace(weak, uncertainty=known))
    with pytest.raises(MotionError, match="expected by its model"):
        go_along(replace(weak, uncertainty=everywhere))
    with pytest.raises(MotionError, match="expected by its model"):  # within the range, at first
        go_along(replace(weak, uncertainty=known), push=0.3)


def test_a_simulated_arm_that_vanishes_is_noticed(tmp_path: Path, ecm: PlantFile) -> None:
    plan = plan_of("ecm")
    with SimulatedDriver(ecm, at=plan.at(0.0)[0]) as driver:

        def vanish(arm) -> None:
            driver.heard = arm.plant.time < 3.0

        driver.disturb = vanish
        with pytest.raises(MotionStoppedError, match=r"no valid measured_js for 0.1 s; sent hold"):
            collect(plan, driver, tmp_path / "bag", rehearse=False, report=lambda line: None)


def test_a_simulated_joint_that_sticks_is_noticed(tmp_path: Path, ecm: PlantFile) -> None:
    def stick(arm) -> None:
        if arm.plant.time > 4.5:
            q, v = arm.plant.q.copy(), arm.plant.v.copy()
            q[0], v[0] = stick.at, 0.0  # type: ignore[attr-defined]
            arm.plant.reset(q, v)
        else:
            stick.at = arm.plant.q[0]  # type: ignore[attr-defined]

    with pytest.raises(MotionStoppedError, match=r"yaw('s motor has| is .* from its set point)"):
        driven(ecm, tmp_path / "bag", stick, model=ecm.model)


# --- teaching --------------------------------------------------------------------------------


def test_a_taught_room_is_what_was_shown_less_a_margin_and_a_plan_takes_it(tmp_path: Path) -> None:
    arm = Arm.load("mtmr")
    own, room = PlanLimits.of(arm), TaughtLimits(arm)
    assert set(room.coverage.values()) == {0.0}
    random = np.random.default_rng(1).uniform(0.2, 0.8, (500, arm.n))
    shown = own.lower + random * (own.upper - own.lower)
    room.show(shown)
    assert 0.0 < room.coverage["outer_yaw"] <= 1.0
    margin = np.radians(1.0)
    save_limits(tmp_path / "limits.yaml", room.limits(margin), arm, "shown")
    limits = load_limits(tmp_path / "limits.yaml", arm)
    ways = shown @ own.rows.T
    low, high = limits.range
    assert (low >= ways.min(axis=0)).all()
    assert (high <= ways.max(axis=0)).all()
    np.testing.assert_allclose(low[:7], shown.min(axis=0) + margin, atol=1e-6)
    assert [each.name for each in limits.combinations] == ["shoulder_pitch + elbow_pitch"]


def test_a_joint_that_was_not_moved_keeps_about_where_it_is(tmp_path: Path) -> None:
    arm = Arm.load("ecm")
    room = TaughtLimits(arm)
    middle = 0.5 * (arm.lower + arm.upper)
    room.show(middle)
    limits = room.limits(np.radians(5.0))
    assert (limits.lower < middle).all()
    assert (middle < limits.upper).all()
    assert (limits.upper - limits.lower <= 1.01 * np.radians(1.0) * arm.scale).all()


# --- the command line ------------------------------------------------------------------------


def as_an_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the command take a simulated arm for one that is moved through ROS."""

    @contextmanager
    def driver_of(arm: Arm, *_: object) -> Iterator[SimulatedDriver]:
        with SimulatedDriver(PlantFile.of(arm)) as driver:
            yield driver

    monkeypatch.setattr("dvrk_gravity.cli.collect.driver_of", driver_of)


@pytest.mark.parametrize("stdin", [None, "a file"])
def test_where_nobody_can_be_asked_an_arm_needs_consent_beforehand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], stdin
) -> None:
    monkeypatch.chdir(tmp_path)
    as_an_arm(monkeypatch)
    if stdin is None:  # closed
        monkeypatch.setattr("sys.stdin", None)
    plan_of("ecm").save("plan.yaml")
    words = ["plan.yaml", "--out", "bag", "--no-rehearsal"]
    assert run("dvrk_gravity.cli.collect", words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "--yes" in said
    assert not Path("bag").exists()


@pytest.mark.parametrize("known", [False, True])
def test_that_a_model_states_no_uncertainty_is_said_once_with_the_way_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], known
) -> None:
    monkeypatch.chdir(tmp_path)
    plan = plan_of("ecm", size=0.9)
    plan.save("plan.yaml")
    model = PlantFile.of(plan.arm).model
    if known:
        limits, n = plan.limits, plan.arm.n
        found = coefficients_of(model.terms)
        exact = {name: np.zeros((len(each), 0)) for name, each in found.items()}
        model = replace(model, uncertainty=ModelUncertainty(
            found, exact, np.zeros((n, 0)), np.zeros((3, 0)),
            0.01 * plan.arm.effort_limit, 5.0, np.full(n, 0.1), limits.lower, limits.upper,
            limits.velocity,
        ))  # fmt: skip
    model.save("model.yaml")
    words = ["plan.yaml", "--out", "bag", "--simulated", "--no-rehearsal", "--model", "model.yaml"]
    assert run("dvrk_gravity.cli.collect", words) == 0
    said = capsys.readouterr().out
    assert "Next: evaluate bag --model model.yaml" in said
    notes = [line for line in said.splitlines() if line.startswith("note")]
    assert len(notes) == (not known)
    assert known or ("10 %" in notes[0] and "identify" in notes[0])


@pytest.mark.parametrize(
    ("words", "rehearses"),
    [
        ([], True),
        (["--no-rehearsal"], False),
        (["--simulated"], False),
        (["--simulated", "--rehearsal"], True),
        (["--simulated", "plant.yaml", "--no-rehearsal"], False),
    ],
)
@pytest.mark.parametrize("verb", [collect_verb, excite, calibrate], ids=lambda verb: verb.NAME)
def test_a_simulated_arm_is_rehearsed_only_where_that_is_asked_for(verb, words, rehearses) -> None:
    parser = argparse.ArgumentParser()
    verb.add_arguments(parser)
    asked = [] if verb is collect_verb else ["--arm", "ecm", "--out", "bag"]
    assert options.rehearses(parser.parse_args([*words, *asked])) == rehearses


@pytest.mark.parametrize(
    ("further", "says"),
    [
        (["--seed", "2"], "evaluate bag --model MODEL"),
        (["--seed", "2", "--duration", "9"], "identify bag --arm ecm --out model.yaml; or"),
        ([], "identify bag --arm ecm --out model.yaml\n"),
    ],
)
def test_the_next_step_of_a_further_motion_is_to_evaluate_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    further: list[str], says: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    words = ["--arm", "ecm", "--out", "bag", "--simulated", "--duration", "8", *further]
    assert run("dvrk_gravity.cli.excite", words) == 0
    assert says in capsys.readouterr().out


def test_collect_and_teach_by_their_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    plan_of("ecm", size=0.9).save("plan.yaml")
    words = ["plan.yaml", "--out", "bag", "--simulated"]
    assert run("dvrk_gravity.cli.collect", words) == 0  # nobody is asked: no arm moves
    said = capsys.readouterr().out
    assert "Next: identify bag --arm ecm --out model.yaml" in said
    assert "rehears" not in said  # an arm in this process has nothing to meet
    teach = ["--teach", "limits.yaml", "--arm", "ecm", "--from", "bag"]
    assert run("dvrk_gravity.cli.collect", teach) == 0
    out = capsys.readouterr().out
    assert "shown: yaw" in out
    assert "plan --arm ecm --limits limits.yaml" in out
    limits = load_limits("limits.yaml", Arm.load("ecm"))
    shown = Recording.load("bag").position
    assert (limits.lower >= shown.min(axis=0) - 1e-3).all()


def test_a_recording_in_which_an_encoder_slips_teaches_no_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    plan = plan_of("ecm", size=0.5)
    time = np.arange(WHOLE) * STEP
    path = plan.at(time)[0]
    path[400:, 1] += 0.4
    Recording(plan.arm.joint_names, time, path).save("bag.csv")
    teach = ["--teach", "limits.yaml", "--arm", "ecm", "--from", "bag.csv"]
    assert run("dvrk_gravity.cli.collect", teach) == 2
    assert "bag.csv: pitch: position goes from" in capsys.readouterr().err
    assert not Path("limits.yaml").exists()


def test_a_person_who_teaches_an_arm_that_is_silent_reads_which_topic_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("dvrk_gravity.cli.teach.EVERY", 0.0)
    monkeypatch.setattr("dvrk_gravity.ros.Client", lambda *of: nullcontext())
    monkeypatch.setattr("dvrk_gravity.ros.listen", lambda client, arm: [None])
    assert run("dvrk_gravity.cli.collect", ["--teach", "limits.yaml", "--arm", "ecm"]) == 2
    silent, error = capsys.readouterr().err.splitlines()
    assert silent == "nothing on /ECM/measured_js yet"
    assert "no measurements" in error


@pytest.mark.parametrize(
    ("answers", "status", "asked"),
    [
        ("n", 2, 1),
        ("", 2, 1),
        ("\x04", 2, 1),  # Ctrl-D
        ("y n", 2, 2),
        ("y YES", 0, 2),
        ("y\ny n", 2, 2),  # typed twice: the second question was not read then
        ("y\ny\ny\n \x04", 2, 2),
        ("y hung-up", 2, 2),
        ("hung-up", 2, 1),
    ],
)
def test_a_person_is_asked_before_the_arm_moves_and_before_it_moves_fast(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    answers: str,
    status: int,
    asked: int,
) -> None:
    monkeypatch.chdir(tmp_path)
    as_an_arm(monkeypatch)
    plan = plan_of("ecm")
    short = FourierMotion(Basis(np.array([2.0]), 0.2, 0.5), plan.motion.middle, np.zeros((2, 4)))
    replace(plan, motion=short).save("plan.yaml")
    person, terminal = os.openpty()
    left = answers.split(" ")

    def wait(*of: Any) -> Any:
        answer = left.pop(0)
        if answer == "hung-up":
            os.close(person)
        else:
            os.write(person, answer.encode() + b"\n" * (answer != "\x04"))
        return select.select(*of)

    monkeypatch.setattr("dvrk_gravity.cli.collect.select", SimpleNamespace(select=wait))
    with os.fdopen(terminal) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        words = ["plan.yaml", "--out", "bag"]
        assert run("dvrk_gravity.cli.collect", words) == status
    if "hung-up" not in answers:
        os.close(person)
    said = capsys.readouterr()
    assert said.out.count("[y/N]") == asked
    assert ("no consent" in said.err) == (status == 2)
    assert ("rehearsal: 5 s" in said.out) == (asked == 2)
    assert ("motion, recorded" in said.out) == (status == 0)


@pytest.mark.parametrize("other", ["ecm", "psm", "mtmr", "none"])
def test_a_plan_that_is_replaced_after_its_rehearsal_is_one_line_and_no_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], other: str
) -> None:
    monkeypatch.chdir(tmp_path)
    as_an_arm(monkeypatch)
    plan = plan_of("ecm")
    short = FourierMotion(Basis(np.array([2.0]), 0.2, 0.5), plan.motion.middle, np.zeros((2, 4)))
    replace(plan, motion=short).save("plan.yaml")

    def consent(question: str) -> bool:
        if question.startswith("rehearsed"):
            Path("plan.yaml").unlink()
            if other != "none":
                plan_of(other, seed=2).save("plan.yaml")
        return True

    monkeypatch.setattr("dvrk_gravity.cli.collect.asking", lambda driver: consent)
    assert run("dvrk_gravity.cli.collect", ["plan.yaml", "--out", "bag"]) == 2
    said = capsys.readouterr()
    assert "plan.yaml: got " in said.err
    assert said.err.count("\n") == 1
    assert "motion, recorded" not in said.out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "PLAN: got nothing, expected a plan .yaml"),
        (["plan.yaml"], "--out: got nothing"),
        (["no.yaml", "--out", "bag", "--yes"], "no.yaml: got 'no such file'"),
        (["plan.yaml", "--out", "bag", "--yes", "--rate", "7"], "--rate: got 7.0"),
        (["plan.yaml", "--out", "bag", "--arm", "ecm"], "--arm: got 'ecm', expected --teach"),
        (["--teach", "l.yaml"], "--arm: got nothing"),
        (["--teach", "l.yaml", "--arm", "ecm", "--out", "bag"], "--out: got 'bag', expected"),
        (["--teach", "l.yaml", "--arm", "ecm", "--margin", "-1"], "--margin: got -1.0"),
        (["plan.yaml", "--out", "bag", "--yes", "--simulated", "psm"], "a plant of ecm"),
    ],
)
def test_a_wrong_argument_is_one_line_and_status_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    plan_of("ecm").save("plan.yaml")
    assert run("dvrk_gravity.cli.collect", words) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_excite_s_plan_keeps_the_arm_s_limits_between_grid_points_and_covers_its_range() -> None:
    plan = covering_plan(Arm.load("ecm"), 30.0, 1)
    assert all(slack.left >= 0.0 for slack in slacks(plan.motion, plan.limits, plan.arm))
    q = plan.at(np.linspace(0.0, 30.0, 3000))[0]
    assert (np.ptp(q, axis=0) > 0.6 * (plan.limits.upper - plan.limits.lower)).all()
    for moment in (0.0, 30.0):
        np.testing.assert_allclose(plan.at(moment)[1:], 0.0, atol=1e-12)
