"""When the compensator commands, what with, and how every end of it asks for a hold."""

from __future__ import annotations

import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS, Arm
from dvrk_gravity.compensate import (
    CONSIDERABLE,
    DroppedSampleError,
    SampleReader,
    Settings,
    Status,
    Supervisor,
)

Q = np.array([0.05, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2])
HELD = np.array([0.1, 0.3, 0.1, 0.0, 0.02, -0.01, 0.0])  # what the arm holds itself with
MS = 1_000_000
OFF = {"slew_limit": [0.0] * 7}
STICKY = {"coulomb_friction.joint_positive": [1.0, 1.0, 1.0, 0.2, 0.06, 0.06, 0.02]}
AT_ONCE = OFF | {"ramp_time": 0.0}
MODEL = TorqueModel.load(MODEL_FILE)
ARM, BASE = MODEL.arm, MODEL.parameters()


def settings_of(**values) -> Settings:
    """Settings of the shipped model."""
    return Settings.from_parameters(BASE | values)


class SupervisorInLoop:
    """A supervisor, a clock, and an arm that publishes every 2 ms.

    Where no ramp is wanted the arm measures no efforts: commands begin with the model's torque.
    Otherwise the model knows friction that explains what the arm holds itself with.
    """

    def __init__(self, **values) -> None:
        self.ramps = values.get("ramp_time", 1.0) > 0.0
        if self.ramps:
            values = STICKY | values
        self.supervisor = Supervisor(settings_of(**values))
        self.reader = SampleReader(JOINT_NAMES)
        self.now = 100.0
        self.stamp = 5_000_000 * MS
        self.late = 0  # of the stamps against the node's clock, ns
        self.cause = ""  # of the last message that was dropped
        self.holds = 0

    def send(self, after: float = 0.002, **fields) -> np.ndarray | None:
        """Send one message, as the node would; return the command that answers it."""
        self.now += after
        self.stamp += int(after * 1e9)
        names = fields.get("name", JOINT_NAMES)
        self.cause, command = "", None
        try:
            sample = self.reader.read(
                fields.get("stamp", self.stamp),
                names,
                fields.get("position", Q),
                fields.get("velocity", np.zeros(7)),
                fields.get("effort", HELD if self.ramps else []),
            )
            command = self.supervisor.command(sample, self.now, self.stamp + self.late)
        except DroppedSampleError as error:
            self.cause = error.cause
            self.supervisor.drop(error)
        self.settle()
        return command

    def first(self, **fields) -> np.ndarray | None:
        """Send messages until one is answered, for as long as a start takes; return the answer."""
        for _ in range(60):
            command = self.send(**fields)
            if command is not None:
                return command
        return None

    def run(self, duration: float, **fields) -> list[np.ndarray | None]:
        """Send messages for a while."""
        return [self.send(**fields) for _ in range(round(duration / 0.002))]

    def wait(self, duration: float) -> None:
        """Let time pass without messages; the node's timer looks four times in a timeout."""
        end = self.now + duration
        while self.now < end:
            self.now += self.supervisor.settings.timeout / 4
            self.supervisor.check_input(self.now)
            self.settle()
        self.stamp += int(duration * 1e9)

    def settle(self) -> None:
        """Do as the node does: send a hold that is due, once."""
        self.holds += self.supervisor.hold_due
        self.supervisor.hold_due = False

    def configure(self, **values) -> None:
        self.supervisor.configure(settings_of(**values), self.now)
        self.settle()

    def builtin(self, *effort: float) -> None:
        self.supervisor.observe_builtin(np.array(effort))
        self.settle()

    @property
    def status(self) -> Status:
        return self.supervisor.status

    @property
    def reason(self) -> str:
        return self.supervisor.reason


def target(loop: SupervisorInLoop, velocity=None) -> np.ndarray:
    """The model's torque at Q within the arm's limits."""
    settings = loop.supervisor.settings
    return settings.limits.clip(settings.torque(Q, np.zeros(7) if velocity is None else velocity))


# --- start and ramp --------------------------------------------------------------------------


def test_a_tenth_of_a_second_is_measured_and_the_first_command_is_the_mean_effort():
    loop = SupervisorInLoop()
    rng = np.random.default_rng(0)
    efforts, answer = [], None
    begin = loop.now
    assert loop.status is Status.WAITING
    while answer is None:
        efforts.append(HELD + 0.003 * rng.standard_normal(7))
        answer = loop.send(effort=efforts[-1])
        assert answer is not None or loop.status is Status.STARTING
    assert 0.1 <= loop.now - begin <= 0.11
    np.testing.assert_allclose(answer, np.mean(efforts, axis=0), atol=1e-12)
    assert loop.status is Status.RAMPING
    assert loop.supervisor.origin == "the measured effort"


def test_no_more_of_the_measured_effort_is_begun_with_than_friction_can_hold():
    """What is beyond would throw the joint if the model is right."""
    friction = 0.02
    values = {"coulomb_friction.joint_positive": [friction] * 7}
    without = {name: value for name, value in BASE.items() if "cable" not in name}
    loop = SupervisorInLoop()
    loop.supervisor = Supervisor(Settings.from_parameters(without | values))
    model = target(loop)
    first = loop.first(effort=np.add(model, [0.3, -0.3, 0.001, 0.05, 0.0, 0.0, 0.0]))
    part = 0.7 * friction  # what of it is compensated
    np.testing.assert_allclose(first - model, [part, -part, 0.001, part, 0, 0, 0], atol=1e-9)


def test_a_joint_that_reads_nothing_and_samples_that_are_not_numbers_throw_nothing():
    loop = SupervisorInLoop(**AT_ONCE)
    model = target(loop)
    dead = [model * [1, 0, 1, 1, 1, 1, 1], np.full(7, np.nan), np.full(7, np.nan)]
    commands = [loop.send(effort=dead[k % 2]) for k in range(60)]
    first = next(command for command in commands if command is not None)
    held = 0.7 * np.abs(half_the_cables_difference(Q))
    assert (np.abs(first - model) <= held + 1e-9).all()
    loop = SupervisorInLoop(**AT_ONCE)
    units = [1e3 * model] * 8 + [np.full(7, np.nan)] * 2
    assert [loop.send(effort=units[k % 10]) for k in range(60)] == [None] * 60
    assert "as measured" in loop.reason


def test_a_model_that_holds_next_to_nothing_of_the_arm_is_a_refusal():
    loop = SupervisorInLoop(**AT_ONCE)
    weak = 0.05 * np.array(MODEL.parameters()["beta"])
    loop.supervisor = Supervisor(Settings.from_parameters(without_cables() | {"beta": tuple(weak)}))
    assert loop.first(effort=20.0 * target(loop) * np.eye(7)[1]) is None
    assert loop.status is Status.FAULT
    assert "of what the arm is held with as measured (shoulder_pitch: " in loop.reason


def without_cables() -> dict:
    return {
        name: value
        for name, value in MODEL.parameters().items()
        if not name.startswith("directional_cable")
    }


def half_the_cables_difference(q: np.ndarray) -> np.ndarray:
    up, down = (MODEL.torque(q, np.full(7, speed)) for speed in (1.0, -1.0))
    return 0.5 * (up - down)


def test_an_arm_that_moves_is_not_started_until_it_rests():
    loop = SupervisorInLoop(**AT_ONCE)
    for k in range(200):
        moving = Q + 1.0 * k * 0.002 * np.eye(7)[1]
        assert loop.send(position=moving, velocity=np.eye(7)[1]) is None
    assert loop.status is Status.STARTING
    assert loop.first(position=moving) is not None


def test_gravity_that_is_left_out_on_purpose_fades_from_what_holds_the_arm():
    loop = SupervisorInLoop(gravity_enabled=False, ramp_time=0.5, **OFF)
    np.testing.assert_allclose(loop.first(effort=HELD), HELD, atol=1e-12)


def test_at_ten_messages_a_second_a_start_takes_as_many_as_it_needs():
    loop = SupervisorInLoop(timeout=0.5)
    answers = [loop.send(after=0.1) for _ in range(10)]
    assert answers[:9] == [None] * 9
    assert answers[9] is not None


@pytest.mark.parametrize(
    "effort",
    [[], [np.nan] * 7, [0.1] * 6, [np.inf] + [0.0] * 6, [0.0] * 7],
    ids=["none", "nan", "six", "inf", "zeros"],
)
def test_an_arm_without_usable_efforts_starts_with_the_model_s_torque_and_that_is_said(effort):
    loop = SupervisorInLoop()
    np.testing.assert_array_equal(loop.first(effort=effort), target(loop))
    assert "no usable effort" in loop.supervisor.origin
    assert loop.status is Status.COMMANDING


@pytest.mark.parametrize(
    "effort", [1e3 * HELD, [1e300, 0, 0, 0, 0, 0, 0], -5 * HELD], ids=["mN·m", "huge", "sign"]
)
def test_an_effort_that_the_model_contradicts_is_a_refusal_with_both_numbers(effort):
    loop = SupervisorInLoop()
    assert loop.first(effort=effort) is None
    assert (loop.status, loop.holds) == (Status.FAULT, 0)
    assert "as measured" in loop.reason
    assert "by the model" in loop.reason
    loop.supervisor.enable()
    assert loop.first() is not None


def test_what_limits_could_not_hold_is_not_started():
    loop = SupervisorInLoop(effort_limit=[5, 0.01, 5, 5, 5, 5, 5])
    loop.supervisor.settings.torque(Q, None)
    far = np.array([0.0, 0.6, 0.3, 0.3, 1.0, 0.1, 0.2])
    assert loop.first(position=far, effort=[]) is None
    assert loop.status is Status.FAULT
    assert "shoulder_pitch takes" in loop.reason


def test_a_gap_while_the_effort_is_measured_begins_it_anew():
    loop = SupervisorInLoop(timeout=0.1)
    loop.run(0.08)
    loop.wait(0.15)
    assert (loop.status, loop.holds) == (Status.WAITING, 0)
    assert loop.run(0.09) == [None] * 45
    assert loop.run(0.02)[-1] is not None


def test_the_ramp_goes_straight_to_the_model_s_torque_in_its_time():
    loop = SupervisorInLoop(ramp_time=0.3, **OFF)
    loop.first()
    begin, end = loop.now, target(loop)
    assert np.abs(end - HELD).max() > 0.1
    for _ in range(149):
        command = loop.send()
        part = (loop.now - begin) / 0.3
        np.testing.assert_allclose(command, (1 - part) * HELD + part * end, atol=1e-12)
    assert loop.status is Status.RAMPING
    loop.send()
    np.testing.assert_array_equal(loop.send(), end)
    assert (loop.status, loop.reason) == (Status.COMMANDING, "compensating")


def test_an_arm_that_is_moved_during_the_ramp_feels_the_torque_of_where_it_is():
    loop = SupervisorInLoop(ramp_time=0.3, **OFF)
    loop.first()
    begin, difference = loop.now, HELD - target(loop)
    moved = Q + 0.5 * np.eye(7)[2]
    settings = loop.supervisor.settings
    there = settings.limits.clip(settings.torque(moved, np.zeros(7)))
    assert np.abs(there - target(loop)).max() > 0.05
    command = loop.send(after=0.02, position=moved)
    part = (loop.now - begin) / 0.3
    np.testing.assert_allclose(command, there + (1 - part) * difference, atol=1e-12)


def test_a_change_that_leaves_the_torque_alone_starts_no_ramp():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, timeout=0.05)
    loop.configure(**OFF, ramp_time=5.0)
    np.testing.assert_array_equal(loop.send(), target(loop))
    assert loop.status is Status.COMMANDING


def test_without_a_ramp_a_considerable_change_takes_a_fifth_of_a_second_all_the_same():
    loop = SupervisorInLoop(**AT_ONCE, **STICKY)
    first = loop.first(effort=HELD)
    end = target(loop)
    assert (
        np.abs(end - HELD) > CONSIDERABLE * loop.supervisor.settings.model.arm.effort_limit
    ).any()
    np.testing.assert_allclose(first, HELD, atol=1e-12)
    half = loop.run(0.1)[-1]
    np.testing.assert_allclose(half, 0.5 * (HELD + end), atol=1e-9)
    np.testing.assert_array_equal(loop.run(0.11)[-1], end)
    assert loop.status is Status.COMMANDING


def test_the_slew_limit_holds_from_the_first_command_on():
    loop = SupervisorInLoop(ramp_time=0.0, slew_limit=[0.2] * 7, **STICKY)
    near = target(loop) - 0.05 * ARM.effort_limit
    previous = loop.first(effort=near)
    assert np.abs(previous - near).max() <= 0.2 * 0.002 + 1e-9
    for _ in range(50):
        following = loop.send()
        assert np.abs(following - previous).max() <= 0.2 * 0.002 + 1e-12
        previous = following


def test_no_parameter_takes_a_joint_to_its_limit_in_less_than_a_fiftieth_of_a_second():
    for given in ([0.0] * 7, [1e4] * 7):
        settings = settings_of(slew_limit=given)
        np.testing.assert_allclose(settings.slew_limit * 0.02, settings.model.arm.effort_limit)


def test_a_hiccup_of_the_input_is_not_time_for_the_torque_to_run_on():
    loop = SupervisorInLoop(ramp_time=0.0, slew_limit=[0.2] * 7, **STICKY)
    before = loop.first(
        effort=target(loop) - 0.05 * loop.supervisor.settings.model.arm.effort_limit
    )
    after = loop.send(after=0.09)
    assert np.abs(after - before).max() == pytest.approx(0.2 * 0.02)


def test_two_messages_at_one_time_are_two_good_commands():
    for options in (OFF, {"slew_limit": [1.0] * 7}):
        loop = SupervisorInLoop(ramp_time=0.0, **options)
        loop.first()
        loop.stamp += 1
        assert np.isfinite(loop.send(after=0.0)).all()


def test_what_the_limits_cut_is_told_joint_by_joint():
    loop = SupervisorInLoop(effort_limit=[5, 5, 5, 5, 0.02, 5, 5], **AT_ONCE)
    loop.first()
    assert loop.supervisor.saturated.tolist() == [False] * 4 + [True] + [False] * 2


def test_a_shoulder_at_its_limit_does_not_count_the_elbow_as_cut():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(actuator_effort_limit=[5, 0.05, 5, 5, 5, 5, 5], **AT_ONCE)
    loop.run(0.5)
    assert loop.supervisor.saturated.tolist() == [False, True] + [False] * 5


@pytest.mark.parametrize("name", ["effort_limit", "actuator_effort_limit"])
def test_limits_above_the_arm_s_own_are_the_arm_s_own(name):
    raised, given = settings_of(**{name: [10.0] * 7}).limits, settings_of().limits
    np.testing.assert_array_equal(raised.joint, given.joint)
    np.testing.assert_array_equal(raised.actuator, given.actuator)


# --- what disqualifies a message -------------------------------------------------------------

BAD = {
    "no stamp": ({"stamp": 0}, "no_stamp"),
    "joint missing": ({"name": [*JOINT_NAMES[:6], "gripper"]}, "missing_joint"),
    "no names": ({"name": [], "position": [], "velocity": [], "effort": []}, "missing_joint"),
    "names only for six": ({"name": JOINT_NAMES[:6], "position": Q[:6]}, "missing_joint"),
    "joint twice": ({"name": [*JOINT_NAMES, JOINT_NAMES[2]]}, "duplicate_joint"),
    "no position": ({"position": []}, "wrong_length"),
    "six positions": ({"position": Q[:6]}, "wrong_length"),
    "eight positions": ({"position": [*Q, 0.0]}, "wrong_length"),
    "six velocities": ({"velocity": [0.0] * 6}, "wrong_length"),
    "position nan": ({"position": [*Q[:6], np.nan]}, "not_finite"),
    "position inf": ({"position": [np.inf, *Q[1:]]}, "not_finite"),
    "velocity nan": ({"velocity": [0.0, np.nan, 0, 0, 0, 0, 0]}, "not_finite"),
    "velocity inf": ({"velocity": [0.0, -np.inf, 0, 0, 0, 0, 0]}, "not_finite"),
    "stamp before the last": ({"stamp": 4_000 * MS}, "stamp_backwards"),
    "stamp before 1970": ({"stamp": -1}, "stamp_backwards"),
}


def test_joints_of_a_psm_are_not_answered_for_an_ecm_whose_names_they_hold():
    psm, ecm = Arm.load("psm"), Arm.load("ecm")
    reader = SampleReader(ecm.joint_names, arm=ecm.name)
    still = np.zeros(psm.n)
    own = reader.read(1, ecm.joint_names, still[: ecm.n], (), ())
    assert own.position.tolist() == [0.0] * ecm.n
    with pytest.raises(DroppedSampleError, match="the joints of arm psm, expected those of ecm"):
        reader.read(2, psm.joint_names, still, (), ())
    beside = (*ecm.joint_names, "camera_button")
    assert reader.read(3, beside, np.zeros(ecm.n + 1), (), ()).stamp == 3


@pytest.mark.parametrize("case", BAD)
def test_a_bad_message_gives_no_command_and_is_counted_and_the_next_is_answered(case):
    fields, cause = BAD[case]
    loop = SupervisorInLoop(**AT_ONCE)
    assert loop.first() is not None
    assert loop.send(**fields) is None
    assert loop.cause == cause
    assert loop.supervisor.dropped[cause] == 1
    assert sum(loop.supervisor.dropped.values()) == 1
    np.testing.assert_array_equal(loop.send(), target(loop))
    assert loop.holds == 0


@pytest.mark.parametrize("case", [case for case in BAD if "before" not in case])
def test_bad_messages_only_are_as_good_as_none(case):
    fields, _ = BAD[case]
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    commands = []
    for _ in range(60):
        commands.append(loop.send(**fields))
        loop.supervisor.check_input(loop.now)
        loop.settle()
    assert commands == [None] * 60
    assert loop.status is Status.FAULT
    assert loop.holds == 1


@pytest.mark.parametrize("field", ["velocity", "effort"])
def test_a_message_without_velocity_or_effort_is_answered(field):
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    np.testing.assert_array_equal(loop.send(**{field: []}), target(loop))


def test_nan_in_the_effort_is_tolerated():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    for _ in range(5):
        np.testing.assert_array_equal(loop.send(effort=[np.nan] * 7), target(loop))


def test_joints_are_found_by_name_in_any_order_among_any_others():
    expected = target(SupervisorInLoop(**AT_ONCE))
    rng = np.random.default_rng(0)
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    for _ in range(20):
        order = rng.permutation(N_JOINTS + 2)
        names = np.array([*JOINT_NAMES, "gripper", "gripper"])[order]
        position = np.array([*Q, np.nan, 7.0])[order]  # what the others read is no concern
        effort = np.array([*HELD, np.nan, 7.0])[order]
        zeros = np.zeros(N_JOINTS + 2)
        command = loop.send(name=names, position=position, velocity=zeros, effort=effort)
        np.testing.assert_array_equal(command, expected)
    loop = SupervisorInLoop()
    np.testing.assert_allclose(
        loop.first(name=names, position=position, velocity=zeros, effort=effort), HELD, atol=1e-15
    )


def test_a_message_with_bad_names_does_not_change_how_good_ones_are_read():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first(name=JOINT_NAMES[::-1], position=Q[::-1])
    assert loop.send(name=["a"] * 7) is None
    np.testing.assert_array_equal(loop.send(name=JOINT_NAMES[::-1], position=Q[::-1]), target(loop))
    np.testing.assert_array_equal(loop.send(), target(loop))


def test_a_stamp_too_old_by_the_node_s_clock_is_refused_if_asked_for():
    loop = SupervisorInLoop(max_stamp_age=0.05, **AT_ONCE)
    loop.late = 50 * MS
    assert loop.first() is not None
    for late, cause in ((51, "stamp_too_old"), (-51, "stamp_ahead")):
        loop.late = late * MS
        assert loop.send() is None
        assert loop.cause == cause
    unasked = SupervisorInLoop(max_stamp_age=0.0, **AT_ONCE)
    unasked.late = 10_000 * MS
    assert unasked.first() is not None


# --- input that stops ------------------------------------------------------------------------


def test_input_that_stops_ends_in_one_hold_within_the_timeout_and_a_quarter():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    begin = loop.now
    while not loop.holds:
        loop.wait(0.025)
    assert 0.1 < loop.now - begin <= 0.1251
    loop.wait(5.0)
    assert loop.holds == 1
    assert loop.status is Status.FAULT
    assert "no valid measured_js for 0.1 s" in loop.reason


def test_input_within_the_timeout_is_good_enough():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.first()
    for _ in range(20):
        loop.wait(0.05)
        assert loop.send(after=0.04) is not None
    assert loop.holds == 0


def test_a_message_after_a_gap_that_no_timer_has_seen_is_not_answered_either():
    """The process itself stood still: the message may have waited in a queue."""
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    assert loop.send(after=0.2) is None
    assert loop.cause == "after_gap"
    assert (loop.status, loop.holds) == (Status.FAULT, 1)


def test_after_a_fault_nothing_is_commanded_until_enabled():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.2)
    assert loop.run(1.0) == [None] * 500
    loop.supervisor.enable()
    np.testing.assert_array_equal(loop.first(), target(loop))


def test_after_a_fault_the_ramp_starts_anew_from_what_holds_the_arm():
    loop = SupervisorInLoop(timeout=0.1, ramp_time=0.5, **OFF)
    loop.run(1.0)
    loop.wait(0.2)
    loop.supervisor.enable()
    lower = HELD - [0.1, 0.1, 0.1, 0.02, 0.005, 0.0, 0.0]
    np.testing.assert_allclose(loop.first(effort=lower), lower, atol=1e-15)
    assert loop.status is Status.RAMPING


def test_automatic_resumes_with_good_input_but_not_on_its_first_message():
    loop = SupervisorInLoop(timeout=0.1, resume="automatic", **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.5)
    assert loop.holds == 1
    assert loop.send() is None
    assert loop.cause == "after_gap"
    assert loop.first() is not None
    assert loop.holds == 1


def test_automatic_does_not_resume_on_messages_that_come_slower_than_the_timeout():
    loop = SupervisorInLoop(timeout=0.1, resume="automatic", **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.5)
    for _ in range(10):
        assert loop.send(after=0.15) is None
    assert loop.holds == 1


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_stamp_that_stands_still_counts_as_no_input(resume):
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.first()
    frozen, begin = loop.stamp, loop.now
    while not loop.holds:
        command = loop.send(stamp=frozen)
        assert command is not None or loop.holds
    assert loop.now - begin == pytest.approx(0.1, abs=0.003)
    assert "has not advanced" in loop.reason
    assert loop.run(1.0, stamp=frozen) == [None] * 500
    assert loop.cause in ("stamp_repeated", "stamp_too_old")
    assert loop.holds == 1


def test_enabling_does_not_make_a_stamp_that_stands_still_good():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    frozen = loop.stamp
    loop.run(0.5, stamp=frozen)
    loop.supervisor.enable()
    assert loop.run(0.5, stamp=frozen) == [None] * 250
    assert (loop.status, loop.holds) == (Status.WAITING, 0)
    assert loop.first() is not None


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_stamp_that_steps_back_and_then_stands_still_is_never_answered(resume):
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.run(0.3)
    frozen = loop.stamp - 1000 * MS
    assert loop.run(0.5, stamp=frozen) == [None] * 250
    loop.supervisor.enable()
    assert loop.run(0.5, stamp=frozen) == [None] * 250
    assert loop.holds == 1


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_stamp_that_moves_on_after_standing_still_ends_in_a_hold_all_the_same(resume):
    """A fault found by the very message that would end it: it gets no command."""
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.first()
    loop.run(0.099, stamp=loop.stamp)
    assert loop.holds == 0
    assert loop.send(after=0.01) is None
    assert (loop.cause, loop.holds) == ("after_gap", 1)
    assert (loop.first() is not None) == (resume == "automatic")


@pytest.mark.parametrize("step", [-3600.0, 3600.0])
@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_step_of_the_arm_s_clock_is_survived(step, resume):
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.run(0.3)
    loop.stamp += int(step * 1e9)
    loop.run(0.5)
    if step < 0:  # a hold, for until then they might be old messages
        assert loop.holds == 1
        if resume == "explicit":
            assert loop.status is Status.FAULT
            loop.supervisor.enable()
    assert loop.first() is not None
    assert loop.status is Status.COMMANDING


def test_one_stamp_out_of_order_after_resuming_is_refused():
    loop = SupervisorInLoop(timeout=0.1, resume="automatic", **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.3)
    loop.send()
    assert loop.first() is not None
    assert loop.send(stamp=loop.stamp - 100 * MS) is None
    assert loop.cause == "stamp_backwards"


# --- on and off ------------------------------------------------------------------------------


def test_not_enabled_nothing_is_commanded_and_nothing_held():
    loop = SupervisorInLoop(enabled=False, **AT_ONCE)
    assert loop.run(0.5) == [None] * 250
    loop.supervisor.disable()
    loop.settle()
    assert (loop.status, loop.holds) == (Status.DISABLED, 0)
    loop.supervisor.enable()
    assert loop.first() is not None


def test_disabling_holds_the_arm_once_and_stops_commanding():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    for _ in range(3):
        loop.supervisor.disable()
        loop.settle()
    assert loop.run(0.5) == [None] * 250
    loop.wait(1.0)
    assert (loop.status, loop.holds) == (Status.DISABLED, 1)


def test_disabling_while_waiting_holds_nothing():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.supervisor.disable()
    loop.settle()
    assert loop.holds == 0
    assert loop.send() is None


def test_the_parameter_switches_on_and_off_too():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(enabled=False, **AT_ONCE)
    assert (loop.status, loop.holds, loop.send()) == (Status.DISABLED, 1, None)
    loop.configure(enabled=True, **AT_ONCE)
    assert loop.first() is not None


def test_switching_off_and_on_leads_out_of_a_fault():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.supervisor.fail("broken")
    loop.configure(enabled=False, **AT_ONCE)
    assert loop.status is Status.DISABLED
    loop.configure(enabled=True, **AT_ONCE)
    assert loop.first() is not None


def test_enabling_what_is_running_changes_nothing():
    loop = SupervisorInLoop(ramp_time=0.5, **OFF)
    loop.run(1.0)
    loop.supervisor.enable()
    assert loop.status is Status.COMMANDING
    np.testing.assert_array_equal(loop.send(), target(loop))


# --- errors of our own -----------------------------------------------------------------------


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_an_error_of_our_own_holds_and_only_enabling_leads_out(resume):
    loop = SupervisorInLoop(resume=resume, **AT_ONCE)
    loop.first()
    loop.supervisor.fail("broken")
    loop.settle()
    assert (loop.status, loop.reason, loop.holds) == (Status.FAULT, "broken", 1)
    assert loop.run(0.5) == [None] * 250
    loop.wait(1.0)
    assert loop.run(0.5)[1:] == [None] * 249
    loop.supervisor.enable()
    assert loop.first() is not None


def test_a_torque_that_is_not_finite_is_an_error_that_names_the_joint():
    cable = {"elastic_cable.wrist_roll": [0.0, 0.0, 0.0, 1e307]}
    loop = SupervisorInLoop(**cable, **AT_ONCE)
    near, far = Q.copy(), Q.copy()
    near[6], far[6] = 0.0, 3.0
    assert loop.first(position=near) is not None
    assert np.isfinite(loop.send(after=0.09, position=Q)).all()
    assert loop.send(after=0.09, position=far - 0.6 * np.eye(7)[6]) is not None
    assert loop.send(after=0.09, position=far) is None
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert "wrist_roll is not a finite number" in loop.reason
    assert loop.send() is None


def test_an_exception_in_the_model_is_an_error_of_our_own(monkeypatch):
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()

    def broken(*_):
        raise ValueError("shapes do not fit")

    monkeypatch.setattr(Settings, "parts", broken)
    assert loop.send() is None
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert "shapes do not fit" in loop.reason


# --- the arm's own compensation --------------------------------------------------------------


@pytest.mark.parametrize("effort", [[0.1] + [0.0] * 6, [np.nan] * 7, [0.0] * 6 + [-1e-9]])
def test_while_the_builtin_compensation_is_on_nothing_is_commanded(effort):
    loop = SupervisorInLoop(**AT_ONCE)
    loop.builtin(*effort)
    assert loop.run(0.2) == [None] * 100
    assert loop.status is Status.WAITING
    assert "use_gravity_compensation, or set disable_builtin to true" in loop.reason
    assert loop.holds == 0
    loop.builtin(*[0.0] * 7)
    assert "builtin" not in loop.reason
    assert loop.first() is not None


def test_a_builtin_compensation_that_is_switched_on_while_commanding_ends_in_a_fault():
    loop = SupervisorInLoop(resume="automatic", **AT_ONCE)
    loop.first()
    loop.builtin(*[0.1] * 7)
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert "use_gravity_compensation" in loop.reason
    loop.builtin(*[0.1] * 7)
    loop.builtin(*[0.0] * 7)
    assert loop.run(0.2) == [None] * 100
    assert loop.holds == 1
    loop.supervisor.enable()
    assert loop.first() is not None


def test_the_builtin_compensation_s_fault_is_not_one_of_the_input_even_after_such_a_one():
    loop = SupervisorInLoop(resume="automatic", timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.2)
    assert loop.run(0.2)[-1] is not None
    loop.builtin(*[0.1] * 7)
    loop.builtin(*[0.0] * 7)
    assert loop.run(0.5) == [None] * 250
    assert loop.holds == 2


def test_one_that_we_may_switch_off_is_waited_for():
    loop = SupervisorInLoop(disable_builtin=True, **AT_ONCE)
    loop.first()
    loop.builtin(*[0.1] * 7)
    assert (loop.status, loop.holds) == (Status.WAITING, 1)
    assert "disable_builtin" not in loop.reason
    assert loop.run(0.2) == [None] * 100
    loop.builtin(*[0.0] * 7)
    assert loop.first() is not None


def test_whoever_switches_it_on_again_and_again_is_not_fought():
    loop = SupervisorInLoop(disable_builtin=True, **AT_ONCE)
    for expected in (Status.WAITING, Status.WAITING, Status.FAULT):
        assert loop.first() is not None
        loop.builtin(*[0.1] * 7)
        assert loop.status is expected
        loop.builtin(*[0.0] * 7)


def test_enabling_does_not_overrule_the_builtin_compensation():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.builtin(*[0.1] * 7)
    loop.supervisor.enable()
    assert loop.run(0.2) == [None] * 100
    assert "use_gravity_compensation" in loop.reason


# --- parameters that change ------------------------------------------------------------------

TOLERANT = {"start_tolerance": 2.0}  # where it is the ramp that is asked about
CHANGES = {
    "gravity off": {"gravity_enabled": False},
    "gravity turned": {"gravity_vector": [0.0, 9.81, 0.0]},
    "beta": {"beta": [1.0] * 10},
    "friction": {"coulomb_friction.joint_positive": [0.05] * 7},
    "ramp time": {"ramp_time": 0.8},
    "slew limit on": {"slew_limit": [50.0] * 7},
}


@pytest.mark.parametrize("case", CHANGES)
def test_a_change_of_parameters_never_makes_the_torque_jump(case):
    moving = np.full(7, 0.3)
    options = {"ramp_time": 0.5, "effort_limit": [9.0] * 7, "actuator_effort_limit": [9.0] * 7}
    options |= OFF | TOLERANT
    loop = SupervisorInLoop(**options)
    loop.run(0.7, velocity=moving)
    before = loop.send(velocity=moving)
    loop.configure(**(options | CHANGES[case]))
    assert (loop.status, "blending" in loop.reason) == (Status.RAMPING, True)
    largest = np.abs(target(loop, moving) - before).max()
    for _ in range(450):
        after = loop.send(velocity=moving)
        assert np.abs(after - before).max() <= largest * 0.002 / 0.5 + 1e-12
        before = after
    np.testing.assert_allclose(after, target(loop, moving), atol=1e-12)
    assert loop.holds == 0


def test_a_change_in_the_middle_of_a_ramp_goes_on_from_there():
    loop = SupervisorInLoop(ramp_time=1.0, **OFF, **TOLERANT)
    loop.run(0.5)
    before = loop.send()
    loop.configure(ramp_time=1.0, gravity_enabled=False, **OFF, **TOLERANT)
    assert np.abs(loop.send() - before).max() < 0.01


def test_lowered_limits_are_approached_at_slew_rate_and_then_kept():
    """The torque under a person's hand does not jump, not even into its limits."""
    options = {"ramp_time": 0.0, "slew_limit": [2.0] * 7}
    loop = SupervisorInLoop(**options)
    loop.run(1.0)
    before = loop.send()
    low = 0.25 * np.abs(before)
    loop.configure(effort_limit=low.tolist(), **options)
    excess = np.maximum(np.abs(before) - low, 0).max()
    for _ in range(round(excess / (2.0 * 0.002)) + 1):
        after = loop.send()
        assert np.abs(after - before).max() <= 2.0 * 0.002 + 1e-12
        now = np.maximum(np.abs(after) - low, 0).max()
        assert now < excess or now < 1e-9
        before, excess = after, now
    assert excess < 1e-9


def test_the_timeout_is_that_of_the_last_settings():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    loop.configure(timeout=1.0, **AT_ONCE)
    loop.wait(0.5)
    assert loop.status is not Status.FAULT
    loop.configure(timeout=0.1, **AT_ONCE)
    loop.wait(0.02)
    assert (loop.status, loop.holds) == (Status.FAULT, 1)


def test_settings_that_arrive_while_nothing_is_commanded_start_nothing():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.first()
    loop.wait(0.2)
    loop.configure(timeout=0.2, **AT_ONCE)
    assert loop.status is Status.FAULT
    assert loop.run(0.1) == [None] * 50


def test_support_that_a_change_takes_away_or_adds_is_reported_and_ramped():
    options = AT_ONCE | TOLERANT
    loop = SupervisorInLoop(**options)
    loop.first()
    before = loop.send()
    assert loop.supervisor.change == ""
    for values in (
        {"gravity_enabled": False},
        {"beta": [1e-9] * 10},
        {"effort_limit": [0.0] * 7},
        {"payload.mass": 0.2},
    ):
        loop.configure(**options, **values)
        assert "instead of" in loop.supervisor.change
        assert np.abs(loop.send() - before).max() < 0.05 * np.abs(before).max()
        loop.configure(**options)
        loop.run(0.3)
        np.testing.assert_array_equal(loop.send(), target(loop))
    loop.configure(**options)
    assert loop.supervisor.change == ""
    assert loop.supervisor.settings.weightless is False
    for part in np.arange(1.0, 0.0, -0.02):  # little by little is no better
        loop.configure(**options, beta=[part * value for value in BASE["beta"]])
    assert "instead of" in loop.supervisor.change
    assert settings_of(gravity_enabled=False).weightless
    assert not settings_of(beta=[0.0] * 10).weightless  # a mistake, no wish


# What the default start_tolerance refuses at a start, by name of the change.
BEYOND = {
    "a load that is not there": {"payload.mass": 0.25},
    "a base turned round": {"gravity_vector": [0.0, 0.0, 9.81]},
    "another arm's weight": {"beta": [3.0 * value for value in BASE["beta"]]},
    "a wrong zero": {"joint_offset": [0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0]},
    "no weight": {"gravity_enabled": False},
    "limits that let it fall": {"effort_limit": [0.0] * 7},
}


@pytest.mark.parametrize("case", BEYOND)
def test_a_change_that_asks_for_what_no_start_would_accept_holds_the_arm(case):
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, **BEYOND[case])
    assert (loop.status, loop.holds) == (Status.WAITING, 1)
    assert "measured again" in loop.reason
    assert not loop.supervisor.active
    held = {"effort": settings_of().at_rest(Q)}
    assert loop.send(**held) is None
    assert loop.status is Status.STARTING
    answer = loop.first(**held)
    if case == "no weight":  # a wish with a flag of its own: it fades from what holds the arm
        np.testing.assert_allclose(answer, held["effort"], atol=1e-12)
        assert "gravity is not compensated" in loop.supervisor.change
    else:
        assert answer is None
        assert loop.status is Status.FAULT


# Friction that is more than `start_tolerance` of a wrist joint's limit of 0.097 N·m.
RUBS = {
    "dry": {"coulomb_friction.joint_positive": [0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0]},
    "viscous": {"viscous_friction.joint": [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]},
}


@pytest.mark.parametrize("case", ["dry", "viscous"])
def test_friction_that_grows_beyond_what_a_start_may_differ_by_is_confirmed_by_hand(case):
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, **RUBS[case])
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert "of friction at wrist_pitch" in loop.reason
    loop.supervisor.enable()
    assert loop.first() is not None
    loop.configure(**AT_ONCE)  # less of it moves nothing
    assert loop.send() is not None


@pytest.mark.parametrize("pause", ["a gap of the input", "the arm's own compensation"])
def test_what_changes_while_the_arm_is_held_for_another_reason_is_confirmed_too(pause):
    options = AT_ONCE | {"resume": "automatic", "disable_builtin": True}
    loop = SupervisorInLoop(**options)
    loop.first()
    if pause == "a gap of the input":
        loop.wait(0.3)
    else:
        loop.builtin(*[0.1] * 7)
    assert loop.holds == 1
    loop.configure(**options, **BEYOND["a load that is not there"])
    if pause != "a gap of the input":
        loop.builtin(*[0.0] * 7)
    assert loop.first() is None
    assert loop.status is Status.FAULT
    assert "parameters have changed, and measured_js has no usable effort" in loop.reason


def test_small_changes_in_one_pause_after_another_do_not_add_up():
    options = AT_ONCE | {"resume": "automatic"}
    loop = SupervisorInLoop(**options)
    loop.first()
    for mass in (0.08, 0.16, 0.24):
        loop.wait(0.3)
        loop.configure(**options, **{"payload.mass": mass})
        answer = loop.first()
    assert answer is None
    assert "parameters have changed" in loop.reason


def test_to_enable_what_is_commanded_already_confirms_nothing():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.supervisor.enable()
    loop.configure(**AT_ONCE, **BEYOND["a load that is not there"])
    assert loop.first() is None
    assert loop.status is Status.FAULT


def test_a_change_that_what_is_measured_speaks_against_is_not_taken():
    """Within the tolerance, by an arm that is held as before: nobody has mounted anything."""
    loop = SupervisorInLoop(**AT_ONCE, start_tolerance=0.25)
    loop.first()
    loop.configure(**AT_ONCE, start_tolerance=2.0, **{"payload.mass": 0.19})
    assert loop.status is Status.WAITING
    assert loop.first(effort=settings_of().at_rest(Q)) is None
    assert "agrees better with those of the last start" in loop.reason


def test_the_own_compensation_of_an_arm_that_is_not_ours_stays_on():
    loop = SupervisorInLoop(**AT_ONCE, disable_builtin=True, enabled=False)
    on = np.full(7, 0.1)
    assert not loop.supervisor.observe_builtin(on)
    loop.supervisor.enable()
    assert loop.supervisor.observe_builtin(on)


def test_a_command_that_slew_limit_keeps_from_what_is_asked_for_is_a_fault():
    slow = AT_ONCE | {"slew_limit": [1e-3] * 7}
    loop = SupervisorInLoop(**slow)
    loop.first()
    way = np.linspace(Q, Q - np.array([0.0, 0.5, 1.2, 0.0, 0.0, 0.0, 0.0]), 300)
    answers = [loop.send(position=position) for position in way]
    assert answers[-1] is None
    assert loop.status is Status.FAULT
    assert "slew_limit is too small" in loop.reason


def test_a_load_that_is_there_is_taken_over_by_a_new_start():
    """Somebody mounts a tool, and then says so: the arm is held with its weight by then."""
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, **BEYOND["a load that is not there"])
    assert loop.holds == 1
    with_tool = loop.supervisor.settings.at_rest(Q)
    np.testing.assert_allclose(loop.first(effort=with_tool), with_tool, atol=1e-9)
    loop.configure(**AT_ONCE, **BEYOND["a load that is not there"], timeout=0.2)
    assert loop.holds == 1  # this is what the last start accepted


def test_without_measured_efforts_a_change_has_to_be_confirmed():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, **BEYOND["a load that is not there"])
    assert loop.first() is None
    assert loop.status is Status.FAULT
    assert "~/enable accepts them" in loop.reason
    loop.supervisor.enable()
    np.testing.assert_allclose(loop.first(), target(loop))


def test_an_arm_where_this_one_cannot_be_is_not_started():
    """A left master, whose wrist_platform goes where a right one's does not."""
    loop = SupervisorInLoop(**AT_ONCE)
    left = Q.copy()
    left[3] = np.radians(-170.0)
    assert loop.first(position=left) is None
    assert loop.status is Status.FAULT
    assert "wrist_platform is at -170 deg, 75 deg outside the limits of mtmr" in loop.reason


def test_many_small_changes_are_compared_with_the_last_start():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    reached = 0.0
    while not loop.holds:
        reached += 0.01
        loop.configure(**AT_ONCE, **{"payload.mass": reached})
        loop.send()
        assert reached < 0.25
    assert reached > 0.1


def test_what_a_change_asks_for_is_compared_wherever_the_arm_goes():
    """Folded, a load asks for little; stretched out for more than a start would have allowed."""
    loop = SupervisorInLoop(**AT_ONCE)
    folded = Q + np.array([0.0, 0.4, 0.3, 0.0, 0.0, 0.0, 0.0])
    loop.first(position=folded)
    loop.configure(**AT_ONCE, **{"payload.mass": 0.22})
    assert loop.send(position=folded) is not None
    way = np.linspace(folded, Q, 1000)
    answers = [loop.send(position=position) for position in way]
    assert loop.holds == 1
    assert 10 < sum(answer is not None for answer in answers) < 990


def test_a_tolerance_that_is_raised_is_for_the_next_start():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, **TOLERANT)
    assert loop.send() is not None
    loop.configure(**AT_ONCE, **TOLERANT, **BEYOND["a load that is not there"])
    assert (loop.status, loop.holds) == (Status.WAITING, 1)


# --- what others do ----------------------------------------------------------------------------


def test_an_obstacle_keeps_it_from_starting_and_ends_commanding_in_a_fault():
    loop = SupervisorInLoop(resume="automatic", **AT_ONCE)
    loop.supervisor.obstruct("hold", "nobody listens")
    assert loop.run(0.5) == [None] * 250
    assert (loop.status, loop.reason) == (Status.WAITING, "nobody listens")
    loop.supervisor.obstruct("hold", "")
    assert loop.first() is not None
    loop.supervisor.obstruct("others", "somebody moves the arm")
    loop.settle()
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert loop.reason == "somebody moves the arm"
    loop.supervisor.obstruct("others", "")
    assert loop.run(0.5) == [None] * 250
    loop.supervisor.enable()
    assert loop.first() is not None


def test_of_several_obstacles_each_has_to_go():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.supervisor.obstruct("a", "one")
    loop.supervisor.obstruct("b", "two")
    loop.supervisor.obstruct("a", "")
    assert loop.run(0.5) == [None] * 250
    assert loop.reason == "two"
    loop.supervisor.obstruct("b", "")
    assert loop.first() is not None


def test_an_obstacle_in_the_middle_of_a_start_begins_it_anew():
    loop = SupervisorInLoop()
    loop.run(0.05)
    assert loop.status is Status.STARTING
    loop.supervisor.obstruct("others", "somebody moves the arm")
    assert (loop.status, loop.holds) == (Status.WAITING, 0)
    loop.supervisor.obstruct("others", "")
    assert loop.run(0.09) == [None] * 45
    assert loop.first() is not None


# --- settings that are renewed -------------------------------------------------------------------


def test_other_settings_keep_the_arm_and_an_unchanged_model(tmp_path):
    """Whatever becomes of the arm's file."""
    path = tmp_path / "arm.yaml"
    path.write_bytes((MODEL_FILE.parent / "arms" / "mtmr.yaml").read_bytes())
    given = BASE | {"arm": str(path)}
    first = Settings.from_parameters(given)
    path.rename(tmp_path / "elsewhere.yaml")
    second = Settings.from_parameters(given | {"ramp_time": 0.3}, first)
    assert second.model is first.model
    third = Settings.from_parameters(given | {"beta": [0.1] * 10}, second)
    assert third.model is not first.model
    assert third.model.arm is first.model.arm


def test_however_often_parameters_change_the_command_follows_the_arm():
    """Ten messages a second, twice as many changes that mean nothing for the torque."""
    loop = SupervisorInLoop(timeout=0.5)
    loop.run(2.0, effort=[])
    position = Q.copy()
    for k in range(100):
        loop.configure(timeout=0.5, max_stamp_age=1.0 + 0.001 * (k % 2))
        loop.configure(timeout=0.5, max_stamp_age=2.0)
        position[1:3] += 0.003
        command = loop.send(after=0.1, position=position, effort=[])
        assert command is not None
    assert np.allclose(command, MODEL.torque(position), atol=0.01)
