"""When the compensator commands, what with, and how every end of it asks for a hold."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS
from dvrk_gravity.compensate.sample import DroppedSampleError, SampleReader
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.compensate.supervisor import Status, Supervisor

Q = np.array([0.05, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2])
HELD = np.array([0.1, 0.3, -0.2, 0.05, 0.02, -0.01, 0.0])  # what the arm holds itself with
MS = 1_000_000
OFF = {"slew_limit": [0.0] * 7}
AT_ONCE = OFF | {"ramp_time": 0.0}
BASE = TorqueModel.load(MODEL_FILE).parameters()


def settings_of(**values) -> Settings:
    """Settings of the shipped model."""
    return Settings.from_parameters(BASE | values)


class Bench:
    """A supervisor, a clock, and an arm that publishes every 2 ms."""

    def __init__(self, **values) -> None:
        self.supervisor = Supervisor(settings_of(**values))
        self.reader = SampleReader(JOINT_NAMES)
        self.now = 100.0
        self.stamp = 5_000_000 * MS
        self.clock = 0
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
                fields.get("effort", HELD),
            )
            command = self.supervisor.command(sample, self.now, self.clock)
        except DroppedSampleError as error:
            self.cause = error.cause
            self.supervisor.drop(error)
        self.settle()
        return command

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


def target(bench: Bench, velocity=None) -> np.ndarray:
    """The model's torque at Q within the arm's limits."""
    settings = bench.supervisor.settings
    return settings.limits.clip(settings.torque(Q, np.zeros(7) if velocity is None else velocity))


# --- start and ramp --------------------------------------------------------------------------


def test_the_first_message_is_answered_with_the_effort_that_holds_the_arm():
    bench = Bench()
    assert bench.status is Status.WAITING
    np.testing.assert_allclose(bench.send(), HELD)
    assert bench.status is Status.RAMPING


@pytest.mark.parametrize(
    "effort", [[], [np.nan] * 7, [0.1] * 6, [np.inf] + [0.0] * 6], ids=["none", "nan", "six", "inf"]
)
def test_without_a_usable_effort_the_ramp_starts_from_zero(effort):
    bench = Bench()
    np.testing.assert_array_equal(bench.send(effort=effort), np.zeros(7))
    assert bench.cause == ""


def test_an_effort_beyond_the_limits_starts_the_ramp_at_the_limits():
    bench = Bench()
    command = bench.send(effort=[1e300, 0, 0, 0, 0, 0, -1e300])
    np.testing.assert_allclose(command, [1.861, 0, 0, 0, 0, 0, -0.023])


def test_the_ramp_goes_straight_to_the_model_s_torque_in_its_time():
    bench = Bench(ramp_time=0.2, **OFF)
    bench.send()
    begin, end = bench.now, target(bench)
    assert np.abs(end - HELD).max() > 0.1
    for _ in range(99):
        command = bench.send()
        part = (bench.now - begin) / 0.2
        np.testing.assert_allclose(command, (1 - part) * HELD + part * end, atol=1e-12)
    assert bench.status is Status.RAMPING
    bench.send()
    np.testing.assert_array_equal(bench.send(), end)
    assert (bench.status, bench.reason) == (Status.COMMANDING, "compensating")


def test_an_arm_that_is_moved_during_the_ramp_feels_the_torque_of_where_it_is():
    bench = Bench(ramp_time=0.2, **OFF)
    bench.send()
    begin, difference = bench.now, HELD - target(bench)
    moved = Q + 0.5 * np.eye(7)[2]
    settings = bench.supervisor.settings
    there = settings.limits.clip(settings.torque(moved, np.zeros(7)))
    assert np.abs(there - target(bench)).max() > 0.05
    command = bench.send(after=0.01, position=moved)
    part = (bench.now - begin) / 0.2
    np.testing.assert_allclose(command, there + (1 - part) * difference, atol=1e-12)


def test_a_change_that_leaves_the_torque_alone_starts_no_ramp():
    bench = Bench(**AT_ONCE)
    bench.send()
    bench.configure(**AT_ONCE, timeout=0.05)
    bench.configure(**OFF, ramp_time=5.0)
    np.testing.assert_array_equal(bench.send(), target(bench))
    assert bench.status is Status.COMMANDING


def test_without_ramp_and_slew_limit_the_model_s_torque_comes_at_once():
    bench = Bench(**AT_ONCE)
    np.testing.assert_array_equal(bench.send(), target(bench))
    assert bench.status is Status.COMMANDING


def test_the_slew_limit_holds_from_the_first_command_on():
    bench = Bench(ramp_time=0.0, slew_limit=[1.0] * 7)
    previous = HELD
    first = bench.send()
    assert np.abs(first - previous).max() <= 0.02 + 1e-12  # nothing is known of the time before
    for _ in range(50):
        previous, first = first, bench.send()
        assert np.abs(first - previous).max() <= 1.0 * 0.002 + 1e-12


def test_a_hiccup_of_the_input_is_not_time_for_the_torque_to_run_on():
    bench = Bench(ramp_time=0.0, slew_limit=[1.0] * 7)
    before = bench.send()
    after = bench.send(after=0.09)
    assert np.abs(after - before).max() == pytest.approx(0.02)


def test_two_messages_at_one_time_are_two_good_commands():
    for options in (OFF, {"slew_limit": [1.0] * 7}):
        bench = Bench(ramp_time=0.0, **options)
        bench.send()
        bench.stamp += 1
        assert np.isfinite(bench.send(after=0.0)).all()


def test_what_the_limits_cut_is_told_joint_by_joint():
    bench = Bench(effort_limit=[5, 5, 5, 5, 1e-4, 5, 5], actuator_effort_limit=[5.0] * 7, **AT_ONCE)
    bench.send()
    assert bench.supervisor.saturated.tolist() == [False] * 4 + [True] + [False] * 2


def test_a_shoulder_at_its_limit_does_not_count_the_elbow_as_cut():
    bench = Bench(actuator_effort_limit=[5, 1e-3, 5, 5, 5, 5, 5], effort_limit=[5.0] * 7, **AT_ONCE)
    bench.send()
    assert bench.supervisor.saturated.tolist() == [False, True] + [False] * 5


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


@pytest.mark.parametrize("case", BAD)
def test_a_bad_message_gives_no_command_and_is_counted_and_the_next_is_answered(case):
    fields, cause = BAD[case]
    bench = Bench(**AT_ONCE)
    assert bench.send() is not None
    assert bench.send(**fields) is None
    assert bench.cause == cause
    assert bench.supervisor.dropped[cause] == 1
    assert sum(bench.supervisor.dropped.values()) == 1
    np.testing.assert_array_equal(bench.send(), target(bench))
    assert bench.holds == 0


@pytest.mark.parametrize("case", [case for case in BAD if "before" not in case])
def test_bad_messages_only_are_as_good_as_none(case):
    fields, _ = BAD[case]
    bench = Bench(**AT_ONCE)
    bench.send()
    commands = []
    for _ in range(60):
        commands.append(bench.send(**fields))
        bench.supervisor.check_input(bench.now)
        bench.settle()
    assert commands == [None] * 60
    assert bench.status is Status.FAULT
    assert bench.holds == 1


@pytest.mark.parametrize("field", ["velocity", "effort"])
def test_a_message_without_velocity_or_effort_is_answered(field):
    bench = Bench(**AT_ONCE)
    bench.send()
    np.testing.assert_array_equal(bench.send(**{field: []}), target(bench))


def test_nan_in_the_effort_is_tolerated():
    bench = Bench(**AT_ONCE)
    for _ in range(5):
        np.testing.assert_array_equal(bench.send(effort=[np.nan] * 7), target(bench))


def test_joints_are_found_by_name_in_any_order_among_any_others():
    expected = target(Bench(**AT_ONCE))
    rng = np.random.default_rng(0)
    bench = Bench(**AT_ONCE)
    for _ in range(20):
        order = rng.permutation(N_JOINTS + 2)
        names = np.array([*JOINT_NAMES, "gripper", "gripper"])[order]
        position = np.array([*Q, np.nan, 7.0])[order]  # what the others read is no concern
        effort = np.array([*HELD, np.nan, 7.0])[order]
        zeros = np.zeros(N_JOINTS + 2)
        command = bench.send(name=names, position=position, velocity=zeros, effort=effort)
        np.testing.assert_array_equal(command, expected)
    bench = Bench()
    np.testing.assert_allclose(
        bench.send(name=names, position=position, velocity=zeros, effort=effort), HELD
    )


def test_a_message_with_bad_names_does_not_change_how_good_ones_are_read():
    bench = Bench(**AT_ONCE)
    bench.send(name=JOINT_NAMES[::-1], position=Q[::-1])
    assert bench.send(name=["a"] * 7) is None
    np.testing.assert_array_equal(
        bench.send(name=JOINT_NAMES[::-1], position=Q[::-1]), target(bench)
    )
    np.testing.assert_array_equal(bench.send(), target(bench))


def test_a_stamp_too_old_by_the_node_s_clock_is_refused_if_asked_for():
    bench = Bench(max_stamp_age=0.05, **AT_ONCE)
    bench.clock = bench.stamp + 52 * MS
    assert bench.send() is not None  # 50 ms old
    bench.clock = bench.stamp + 53 * MS
    assert bench.send() is None
    assert bench.cause == "stamp_too_old"
    unasked = Bench(**AT_ONCE)
    unasked.clock = unasked.stamp + 10_000 * MS
    assert unasked.send() is not None


# --- input that stops ------------------------------------------------------------------------


def test_input_that_stops_ends_in_one_hold_within_the_timeout_and_a_quarter():
    bench = Bench(timeout=0.1, **AT_ONCE)
    bench.run(0.1)
    begin = bench.now
    while not bench.holds:
        bench.wait(0.025)
    assert 0.1 < bench.now - begin <= 0.1251
    bench.wait(5.0)
    assert bench.holds == 1
    assert bench.status is Status.FAULT
    assert "no valid measured_js for 0.1 s" in bench.reason


def test_input_within_the_timeout_is_good_enough():
    bench = Bench(timeout=0.1, **AT_ONCE)
    bench.send()
    for _ in range(20):
        bench.wait(0.05)
        assert bench.send(after=0.04) is not None
    assert bench.holds == 0


def test_a_message_after_a_gap_that_no_timer_has_seen_is_not_answered_either():
    """The process itself stood still: the message may have waited in a queue."""
    bench = Bench(timeout=0.1, **AT_ONCE)
    bench.run(0.1)
    assert bench.send(after=0.2) is None
    assert bench.cause == "after_gap"
    assert (bench.status, bench.holds) == (Status.FAULT, 1)


def test_after_a_fault_nothing_is_commanded_until_enabled():
    bench = Bench(timeout=0.1, **AT_ONCE)
    bench.run(0.1)
    bench.wait(0.2)
    assert bench.run(1.0) == [None] * 500
    bench.supervisor.enable()
    np.testing.assert_array_equal(bench.send(), target(bench))


def test_after_a_fault_the_ramp_starts_anew_from_what_holds_the_arm():
    bench = Bench(timeout=0.1, ramp_time=0.5, **OFF)
    bench.run(1.0)
    bench.wait(0.2)
    bench.supervisor.enable()
    np.testing.assert_allclose(bench.send(effort=-HELD), -HELD)
    assert bench.status is Status.RAMPING


def test_automatic_resumes_with_good_input_but_not_on_its_first_message():
    bench = Bench(timeout=0.1, resume="automatic", **AT_ONCE)
    bench.run(0.1)
    bench.wait(0.5)
    assert bench.holds == 1
    assert bench.send() is None
    assert bench.cause == "after_gap"
    assert bench.send() is not None
    assert bench.holds == 1


def test_automatic_does_not_resume_on_messages_that_come_slower_than_the_timeout():
    bench = Bench(timeout=0.1, resume="automatic", **AT_ONCE)
    bench.run(0.1)
    bench.wait(0.5)
    for _ in range(10):
        assert bench.send(after=0.15) is None
    assert bench.holds == 1


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_stamp_that_stands_still_counts_as_no_input(resume):
    bench = Bench(timeout=0.1, resume=resume, **AT_ONCE)
    bench.send()
    frozen, begin = bench.stamp, bench.now
    while not bench.holds:
        command = bench.send(stamp=frozen)
        assert command is not None or bench.holds
    assert bench.now - begin == pytest.approx(0.1, abs=0.003)
    assert "has not moved" in bench.reason
    assert bench.run(1.0, stamp=frozen) == [None] * 500
    assert bench.cause == "stamp_repeated"
    assert bench.holds == 1


def test_enabling_does_not_make_a_stamp_that_stands_still_good():
    bench = Bench(timeout=0.1, **AT_ONCE)
    frozen = bench.stamp
    bench.run(0.5, stamp=frozen)
    bench.supervisor.enable()
    assert bench.run(0.5, stamp=frozen) == [None] * 250
    assert (bench.status, bench.holds) == (Status.WAITING, 1)
    assert bench.send() is not None


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_stamp_that_steps_back_and_then_stands_still_is_never_answered(resume):
    bench = Bench(timeout=0.1, resume=resume, **AT_ONCE)
    bench.run(0.1)
    frozen = bench.stamp - 1000 * MS
    assert bench.run(0.5, stamp=frozen) == [None] * 250
    bench.supervisor.enable()
    assert bench.run(0.5, stamp=frozen) == [None] * 250
    assert bench.holds == 1


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_stamp_that_moves_on_after_standing_still_ends_in_a_hold_all_the_same(resume):
    """A fault found by the very message that would end it: it gets no command."""
    bench = Bench(timeout=0.1, resume=resume, **AT_ONCE)
    bench.send()
    bench.run(0.099, stamp=bench.stamp)
    assert bench.holds == 0
    assert bench.send(after=0.01) is None
    assert (bench.cause, bench.holds) == ("after_gap", 1)
    assert (bench.send() is not None) == (resume == "automatic")


@pytest.mark.parametrize("step", [-3600.0, 3600.0])
@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_a_step_of_the_arm_s_clock_is_survived(step, resume):
    bench = Bench(timeout=0.1, resume=resume, **AT_ONCE)
    bench.run(0.1)
    bench.stamp += int(step * 1e9)
    bench.run(0.5)
    if step < 0:  # a hold, for until then they might be old messages
        assert bench.holds == 1
        if resume == "explicit":
            assert bench.status is Status.FAULT
            bench.supervisor.enable()
    assert bench.send() is not None
    assert bench.status is Status.COMMANDING


def test_one_stamp_out_of_order_after_resuming_is_refused():
    bench = Bench(timeout=0.1, resume="automatic", **AT_ONCE)
    bench.run(0.1)
    bench.wait(0.3)
    bench.send()
    assert bench.send() is not None
    assert bench.send(stamp=bench.stamp - 100 * MS) is None
    assert bench.cause == "stamp_backwards"


# --- on and off ------------------------------------------------------------------------------


def test_not_enabled_nothing_is_commanded_and_nothing_held():
    bench = Bench(enabled=False, **AT_ONCE)
    assert bench.run(0.5) == [None] * 250
    bench.supervisor.disable()
    bench.settle()
    assert (bench.status, bench.holds) == (Status.DISABLED, 0)
    bench.supervisor.enable()
    assert bench.send() is not None


def test_disabling_holds_the_arm_once_and_stops_commanding():
    bench = Bench(**AT_ONCE)
    bench.send()
    for _ in range(3):
        bench.supervisor.disable()
        bench.settle()
    assert bench.run(0.5) == [None] * 250
    bench.wait(1.0)
    assert (bench.status, bench.holds) == (Status.DISABLED, 1)


def test_disabling_while_waiting_holds_nothing():
    bench = Bench(**AT_ONCE)
    bench.supervisor.disable()
    bench.settle()
    assert bench.holds == 0
    assert bench.send() is None


def test_the_parameter_switches_on_and_off_too():
    bench = Bench(**AT_ONCE)
    bench.send()
    bench.configure(enabled=False, **AT_ONCE)
    assert (bench.status, bench.holds, bench.send()) == (Status.DISABLED, 1, None)
    bench.configure(enabled=True, **AT_ONCE)
    assert bench.send() is not None


def test_switching_off_and_on_leads_out_of_a_fault():
    bench = Bench(**AT_ONCE)
    bench.send()
    bench.supervisor.fail("broken")
    bench.configure(enabled=False, **AT_ONCE)
    assert bench.status is Status.DISABLED
    bench.configure(enabled=True, **AT_ONCE)
    assert bench.send() is not None


def test_enabling_what_is_running_changes_nothing():
    bench = Bench(ramp_time=0.5, **OFF)
    bench.run(1.0)
    bench.supervisor.enable()
    assert bench.status is Status.COMMANDING
    np.testing.assert_array_equal(bench.send(), target(bench))


# --- errors of our own -----------------------------------------------------------------------


@pytest.mark.parametrize("resume", ["explicit", "automatic"])
def test_an_error_of_our_own_holds_and_only_enabling_leads_out(resume):
    bench = Bench(resume=resume, **AT_ONCE)
    bench.send()
    bench.supervisor.fail("broken")
    bench.settle()
    assert (bench.status, bench.reason, bench.holds) == (Status.FAULT, "broken", 1)
    assert bench.run(0.5) == [None] * 250
    bench.wait(1.0)
    assert bench.run(0.5)[1:] == [None] * 249
    bench.supervisor.enable()
    assert bench.send() is not None


def test_a_torque_that_is_not_finite_is_an_error_that_names_the_joint():
    cable = {"elastic_cable.wrist_yaw": [0.0, 0.0, 0.0, 1.0]}
    bench = Bench(**cable, **AT_ONCE)
    bench.send()
    far = Q.copy()
    far[5] = 1e200
    assert bench.send(position=far) is None
    assert (bench.status, bench.holds) == (Status.FAULT, 1)
    assert "wrist_yaw is not a finite number" in bench.reason
    assert bench.send() is None


def test_an_exception_in_the_model_is_an_error_of_our_own(monkeypatch):
    bench = Bench(**AT_ONCE)
    bench.send()

    def broken(*_):
        raise ValueError("shapes do not fit")

    monkeypatch.setattr(Settings, "torque", broken)
    assert bench.send() is None
    assert (bench.status, bench.holds) == (Status.FAULT, 1)
    assert "shapes do not fit" in bench.reason


# --- the arm's own compensation --------------------------------------------------------------


@pytest.mark.parametrize("effort", [[0.1] + [0.0] * 6, [np.nan] * 7, [0.0] * 6 + [-1e-9]])
def test_while_the_builtin_compensation_is_on_nothing_is_commanded(effort):
    bench = Bench(**AT_ONCE)
    bench.builtin(*effort)
    assert bench.run(0.2) == [None] * 100
    assert bench.status is Status.WAITING
    assert "use_gravity_compensation" in bench.reason
    assert bench.holds == 0
    bench.builtin(*[0.0] * 7)
    assert "builtin" not in bench.reason
    assert bench.send() is not None


def test_a_builtin_compensation_that_is_switched_on_while_commanding_ends_in_a_fault():
    bench = Bench(resume="automatic", **AT_ONCE)
    bench.send()
    bench.builtin(*[0.1] * 7)
    assert (bench.status, bench.holds) == (Status.FAULT, 1)
    assert "use_gravity_compensation" in bench.reason
    bench.builtin(*[0.1] * 7)
    bench.builtin(*[0.0] * 7)
    assert bench.run(0.2) == [None] * 100
    assert bench.holds == 1
    bench.supervisor.enable()
    assert bench.send() is not None


def test_the_builtin_compensation_s_fault_is_not_one_of_the_input_even_after_such_a_one():
    bench = Bench(resume="automatic", timeout=0.1, **AT_ONCE)
    bench.run(0.1)
    bench.wait(0.2)
    assert bench.run(0.1)[-1] is not None
    bench.builtin(*[0.1] * 7)
    bench.builtin(*[0.0] * 7)
    assert bench.run(0.5) == [None] * 250
    assert bench.holds == 2


def test_one_that_we_may_switch_off_is_waited_for():
    bench = Bench(disable_builtin=True, **AT_ONCE)
    bench.send()
    bench.builtin(*[0.1] * 7)
    assert (bench.status, bench.holds) == (Status.WAITING, 1)
    assert bench.run(0.2) == [None] * 100
    bench.builtin(*[0.0] * 7)
    assert bench.send() is not None


def test_enabling_does_not_overrule_the_builtin_compensation():
    bench = Bench(**AT_ONCE)
    bench.send()
    bench.builtin(*[0.1] * 7)
    bench.supervisor.enable()
    assert bench.run(0.2) == [None] * 100
    assert "use_gravity_compensation" in bench.reason


# --- parameters that change ------------------------------------------------------------------

CHANGES = {
    "gravity off": {"gravity_enabled": False},
    "gravity turned": {"gravity_vector": [0.0, 9.81, 0.0]},
    "beta": {"beta": [1.0] * 10},
    "friction": {"coulomb_friction.joint_positive": [0.1] * 7},
    "ramp time": {"ramp_time": 0.8},
    "slew limit on": {"slew_limit": [50.0] * 7},
}


@pytest.mark.parametrize("case", CHANGES)
def test_a_change_of_parameters_never_makes_the_torque_jump(case):
    moving = np.full(7, 0.3)
    options = {"ramp_time": 0.5, "effort_limit": [9.0] * 7, "actuator_effort_limit": [9.0] * 7}
    options |= OFF
    bench = Bench(**options)
    bench.run(0.7, velocity=moving)
    before = bench.send(velocity=moving)
    bench.configure(**(options | CHANGES[case]))
    assert (bench.status, "blending" in bench.reason) == (Status.RAMPING, True)
    largest = np.abs(target(bench, moving) - before).max()
    for _ in range(450):
        after = bench.send(velocity=moving)
        assert np.abs(after - before).max() <= largest * 0.002 / 0.5 + 1e-12
        before = after
    np.testing.assert_allclose(after, target(bench, moving), atol=1e-12)
    assert bench.holds == 0


def test_a_change_in_the_middle_of_a_ramp_goes_on_from_there():
    bench = Bench(ramp_time=1.0, **OFF)
    bench.run(0.5)
    before = bench.send()
    bench.configure(ramp_time=1.0, gravity_enabled=False, **OFF)
    assert np.abs(bench.send() - before).max() < 0.01


def test_lowered_limits_are_approached_at_slew_rate_and_then_kept():
    """The torque under a person's hand does not jump, not even into its limits."""
    options = {"ramp_time": 0.0, "slew_limit": [2.0] * 7}
    bench = Bench(**options)
    bench.run(1.0)
    before = bench.send()
    low = 0.25 * np.abs(before)
    bench.configure(effort_limit=low.tolist(), **options)
    excess = np.maximum(np.abs(before) - low, 0).max()
    for _ in range(round(excess / (2.0 * 0.002)) + 1):
        after = bench.send()
        assert np.abs(after - before).max() <= 2.0 * 0.002 + 1e-12
        now = np.maximum(np.abs(after) - low, 0).max()
        assert now < excess or now < 1e-9
        before, excess = after, now
    assert excess < 1e-9


def test_the_timeout_is_that_of_the_last_settings():
    bench = Bench(timeout=0.1, **AT_ONCE)
    bench.run(0.1)
    bench.configure(timeout=1.0, **AT_ONCE)
    bench.wait(0.5)
    assert bench.status is not Status.FAULT
    bench.configure(timeout=0.1, **AT_ONCE)
    bench.wait(0.02)
    assert (bench.status, bench.holds) == (Status.FAULT, 1)


def test_settings_that_arrive_while_nothing_is_commanded_start_nothing():
    bench = Bench(timeout=0.1, **AT_ONCE)
    bench.send()
    bench.wait(0.2)
    bench.configure(timeout=0.2, **AT_ONCE)
    assert bench.status is Status.FAULT
    assert bench.run(0.1) == [None] * 50
