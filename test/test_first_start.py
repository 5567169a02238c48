"""The first start of a model with a constant torque in doubt: what the arm does not feel moves it.

A simulated arm in a closed loop, with a clock of its own: nothing in it takes time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.compensate import (
    HANDS_OFF,
    ConstantCheck,
    Sample,
    Settings,
    Status,
    Supervisor,
)
from dvrk_gravity.effects import ElasticCable
from dvrk_gravity.simulate import PlantFile, SimulatedArm

STEP, EACH = 1e-3, 5  # s; a message each five steps, at 200 Hz
POSE = np.radians([0.0, 15.0, 5.0, 30.0, 80.0, 10.0, 0.0])
NAMES = ("outer_yaw", "shoulder_pitch", "elbow_pitch")
FASTEST, FARTHEST = 30.0, 3.0  # deg/s and deg, within which a joint is held
SHIPPED = TorqueModel.load(MODEL_FILE)
LIMIT = SHIPPED.arm.effort_limit.tolist()


class Loop:
    """An arm under a compensator whose model has a constant torque at a joint.

    Attributes:
        supervisor: The compensator.
        fastest: Largest speed of the joint, rad/s.
        farthest: Largest way of it since the first message, rad.
        holds: Number of holds.
    """

    def __init__(
        self, joint: int, torque: float, feels: bool, reads: bool, known: bool = True,
        slow: int = 1, **settings: object,
    ):  # fmt: skip
        """Build it at rest.

        Args:
            joint: Number of the joint.
            torque: The constant of the model, N·m.
            feels: The arm has a spring of that torque.
            reads: Efforts are read with it.
            known: The model's file has it as a constant in doubt.
            slow: How much more time passes for the compensator than for the arm.
            settings: Parameters of the compensator.
        """
        truth = PlantFile.load("mtmr_28002")
        constant = torque * np.eye(7)[joint]
        pull = ElasticCable.constant(SHIPPED.arm, constant)
        model = replace(SHIPPED, terms=(*SHIPPED.terms, pull))
        if feels:
            terms = (*truth.model.terms, ElasticCable.constant(SHIPPED.arm, constant))
            truth = replace(truth, model=replace(truth.model, terms=terms))
        if known:
            model = replace(model, constant=constant)
        self._plant = truth.plant()
        self._plant.reset(POSE)
        self._arm = SimulatedArm(self._plant, truth.sensors, 1, builtin_compensation=False, dt=STEP)
        self._joint, self._bias = joint, constant * reads
        self._slow = slow
        self.supervisor = Supervisor(Settings.from_parameters(model.parameters() | settings))
        self.fastest = self.farthest = 0.0
        self.holds, self._steps = 0, 0
        self._run(0.6, answers=False)
        self._start = self._plant.q[joint]

    def run(self, seconds: float) -> Loop:
        """Go on for so long."""
        return self._run(seconds, answers=True)

    def configure(self, **settings: object) -> None:
        """Change parameters of the compensator."""
        given = self.supervisor.settings.model.parameters() | settings
        changed = Settings.from_parameters(given, self.supervisor.settings)
        self.supervisor.configure(changed, self._now)

    @property
    def _now(self) -> float:
        return self._steps * self._slow * STEP

    def push(self, torque: float, seconds: float) -> None:
        """Push the joint by hand."""
        self._arm.push(torque * np.eye(7)[self._joint], seconds)

    def _run(self, seconds: float, answers: bool) -> Loop:
        for _ in range(round(seconds / STEP)):
            self._arm.step()
            self._steps += 1
            if not answers:
                continue
            self.fastest = max(self.fastest, abs(float(self._plant.v[self._joint])))
            way = abs(float(self._plant.q[self._joint] - self._start))
            self.farthest = max(self.farthest, way)
            if self._steps % EACH == 0:
                self._answer()
        return self

    def _answer(self) -> None:
        read, now = self._arm.measure(), self._now
        stamp = round(self._steps * STEP * 1e9)
        effort = np.array(read.effort) + self._bias
        sample = Sample(stamp, np.array(read.position), np.array(read.velocity), effort)
        command = self.supervisor.command(sample, now, stamp)
        if self.supervisor.hold_due:
            self._arm.hold()
            self.supervisor.hold_due, self.holds = False, self.holds + 1
        elif command is not None:
            self._arm.servo_jf(command)


@pytest.mark.parametrize("reads", [True, False], ids=["a bias", "a steady push"])
@pytest.mark.parametrize("part", [0.09, -0.09, 0.2])
@pytest.mark.parametrize("joint", range(3), ids=NAMES)
def test_a_constant_that_the_arm_does_not_feel_is_held_before_it_moves_the_joint(
    joint, part, reads
):
    loop = Loop(joint, part * SHIPPED.arm.effort_limit[joint], feels=False, reads=reads).run(3.0)

    assert np.degrees(loop.fastest) < FASTEST
    assert np.degrees(loop.farthest) < FARTHEST
    assert loop.supervisor.status is Status.FAULT
    assert loop.holds == 1
    for token in (NAMES[joint], "calibrate", "--bias-is"):
        assert token in loop.supervisor.reason


def test_a_constant_that_hardly_exceeds_friction_is_held_as_slowly_as_it_moves():
    loop = Loop(2, 0.032, feels=False, reads=True).run(5.0)

    assert loop.supervisor.status is Status.FAULT
    assert np.degrees(loop.farthest) < FARTHEST


@pytest.mark.parametrize("part", [0.09, -0.2])
@pytest.mark.parametrize("joint", range(3), ids=NAMES)
def test_a_spring_is_compensated_once_it_was_seen_to_move_nothing(joint, part):
    loop = Loop(joint, part * SHIPPED.arm.effort_limit[joint], feels=True, reads=False).run(1.5)
    assert HANDS_OFF in loop.supervisor.reason

    loop.run(1.5)

    assert loop.supervisor.status is Status.COMMANDING
    assert HANDS_OFF not in loop.supervisor.reason
    assert np.degrees(loop.farthest) < 0.5

    loop.push(0.3, 0.3)
    loop.run(1.0)
    assert np.degrees(loop.farthest) > 1.0, "a hand moves it"
    assert loop.supervisor.status is Status.COMMANDING

    loop.supervisor.disable()
    loop.run(0.5)
    loop.supervisor.enable()
    loop.run(0.5)
    assert loop.supervisor.active
    assert HANDS_OFF not in loop.supervisor.reason, "of the same model only the first start"


def test_a_hand_during_the_first_start_ends_in_a_hold_and_the_next_start_checks_again():
    loop = Loop(1, 0.3, feels=True, reads=False).run(0.4)
    loop.push(0.4, 0.3)
    loop.run(1.0)
    assert loop.supervisor.status is Status.FAULT

    loop.supervisor.enable()
    loop.run(0.5)
    assert HANDS_OFF in loop.supervisor.reason
    loop.run(3.0)
    assert loop.supervisor.status is Status.COMMANDING


def test_an_arm_whose_clock_is_slow_is_watched_for_as_long_as_it_takes_to_move():
    loop = Loop(2, 0.032, feels=False, reads=True, slow=8, max_stamp_age=0.0, timeout=1.0)
    loop.run(5.0)

    assert loop.supervisor.status is Status.FAULT
    assert np.degrees(loop.farthest) < FARTHEST


def test_a_joint_is_watched_until_it_has_all_of_the_torque():
    """A limit cuts the constant, and is raised."""
    lowered = [LIMIT[0], 0.58, *LIMIT[2:]]
    loop = Loop(1, 0.2, feels=False, reads=False, effort_limit=lowered).run(2.5)
    assert loop.supervisor.active
    loop.configure(effort_limit=LIMIT)
    loop.run(4.0)

    assert loop.supervisor.status is Status.FAULT
    assert "pushes shoulder_pitch" in loop.supervisor.reason
    assert np.degrees(loop.fastest) < FASTEST
    assert np.degrees(loop.farthest) < FARTHEST


def test_a_model_without_that_parameter_starts_as_before():
    loop = Loop(1, 0.3, feels=True, reads=False, known=False).run(0.5)

    assert loop.supervisor.active
    assert HANDS_OFF not in loop.supervisor.reason


def read(check: ConstantCheck, position: np.ndarray, now: float, whole: bool = True) -> str:
    sample = Sample(round(now * 1e9), position, None, None)
    return check.check(sample, np.zeros(7), now, np.full(7, whole))


def test_a_joint_at_its_stop_is_watched_until_it_has_left_it():
    arm = SHIPPED.arm
    at = 0.5 * (arm.lower + arm.upper)
    at[1] = arm.upper[1] - 0.01
    check = ConstantCheck(arm, 0.3 * np.eye(7)[1], at)
    for now in np.arange(0.0, 20.0, 0.1):
        assert not read(check, at, now)
        assert not check.over
    assert "shoulder_pitch" in read(check, at - 0.04 * np.eye(7)[1], 20.0)


def test_a_ramp_and_a_slew_limit_do_not_count():
    at = POSE
    check = ConstantCheck(SHIPPED.arm, 0.3 * np.eye(7)[1], at)
    for now in np.arange(0.0, 20.0, 0.1):
        assert not read(check, at, now, whole=False)
        assert not check.over
    for now in np.arange(20.0, 21.5, 0.1):
        assert not read(check, at, now)
    assert check.over
