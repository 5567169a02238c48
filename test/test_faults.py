"""What goes wrong around the nodes, with real processes: every fault ends safely and is told."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from arm_side import PATIENT, TIMEOUT, FakeArm
from conftest import LATE
from forking import loading_itself
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.parameters import node_parameters
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess

MODEL = TorqueModel.load(MODEL_FILE)
ARM = MODEL.arm
LONGEST_STEP = 0.02  # s of slew that one command may use
SLEW = np.array(node_parameters(Arm.load("mtmr"))["slew_limit"].default)


@pytest.fixture
def start(arm: FakeArm):
    """Start nodes that end with the test; whatever happened, every command was a safe one."""
    started: list[NodeProcess] = []

    def begin(verb: str, *arguments: str, wait: bool = True, **options) -> NodeProcess:
        given = ("--params-file", str(MODEL_FILE)) if verb == "compensator" else ()
        node = NodeProcess(verb, *given, *arguments, **options)
        started.append(node)
        if wait and verb == "compensator":
            arm.await_compensator()
        elif wait and verb == "watchdog":
            arm.client.wait(lambda: watchdog(arm).startswith("watching"), "the watchdog")
        return node

    yield begin
    for node in started:
        node.stop()
        assert "Traceback" not in node.output
    assert_safe(arm)


def assert_safe(arm: FakeArm) -> None:
    """Every command is finite and within both boxes; between holds it follows the slew limit."""
    if not arm.commands:
        return
    efforts = arm.efforts
    assert np.isfinite(efforts).all()
    assert (np.abs(efforts) <= ARM.effort_limit + 1e-9).all()
    assert (np.abs(ARM.actuator_effort(efforts)) <= ARM.actuator_effort_limit + 1e-9).all()
    senders = [message.header.frame_id for _, message in arm.commands]
    times = np.array([when for when, _ in arm.commands])
    for i, change in enumerate(np.abs(np.diff(efforts, axis=0))):
        held = any(times[i] <= hold <= times[i + 1] for hold in arm.holds)
        if not held and senders[i] == senders[i + 1]:
            assert (change <= SLEW * LONGEST_STEP + 1e-9).all()


def watchdog(arm: FakeArm) -> str:
    return arm.client.state("watchdog")


def commands(arm: FakeArm, more: int = 10):
    """Return a condition: so many more commands have come."""
    goal = len(arm.commands) + more
    return lambda: len(arm.commands) >= goal


def assert_silent(arm: FakeArm, duration: float = 0.3, **fields) -> None:
    """Good input for a while brings no command."""
    arm.client.spin(0.05)  # those on the way
    before = len(arm.commands)
    arm.run(duration, **fields)
    assert len(arm.commands) == before


def assert_enables(arm: FakeArm) -> None:
    """The way out of a fault works, but where a pause of this machine has the arm held anew."""
    states = arm.client.states
    for _ in range(3):
        again, before = commands(arm), {name: len(said) for name, said in states.items()}

        def anew(name: str, begin: str, before: dict[str, int] = before) -> list[str]:
            return [each for each in states[name][before[name] :] if each.startswith(begin)]

        assert arm.client.enable(True).success
        arm.run_until(
            lambda c=again, a=anew: c() or bool(a("compensator", "fault")), "commands again"
        )
        if again():
            return
        paused = "measured_js" in arm.state or anew("watchdog", "hold sent: no command for")
        assert paused, arm.state
    raise AssertionError(f"held each time: {arm.state}")


# --- processes that end or stand still -------------------------------------------------------


def test_a_stopped_compensator_is_held_for_and_does_not_go_on_when_it_wakes(arm, start):
    """Before that: the watchdog is killed, and the next one takes over in mid-flight."""
    first = start("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}")
    compensator = start("compensator", *PATIENT)
    arm.run_until(lambda: watchdog(arm) == "the arm is commanded", "the watchdog's notice")
    first.signal(signal.SIGKILL)
    first.wait()
    arm.run_until(commands(arm), "commands without a watchdog")
    assert not arm.holds
    start("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}", wait=False)
    arm.run_until(
        lambda: arm.client.states["watchdog"].count("the arm is commanded") >= 2, "the next one"
    )
    delays: list[float] = []
    # A machine that stands still delays one of them, not each.
    while len(delays) < 3 and min(delays, default=np.inf) > TIMEOUT * 1.25 + LATE:
        arm.holds.clear()
        compensator.signal(signal.SIGSTOP)
        stopped = time.monotonic()
        arm.run_until(lambda: bool(arm.holds), "the hold")
        delays.append(arm.holds[0] - stopped)
        arm.run(TIMEOUT)
        compensator.signal(signal.SIGCONT)
        arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
        assert_silent(arm)
        assert_enables(arm)
    assert min(delays) < TIMEOUT * 1.25 + LATE


def test_a_compensator_without_memory_holds_ends_and_says_so(arm, start):
    hungry = """
import resource, sys
from dvrk_gravity.__main__ import main
from dvrk_gravity.compensate.settings import Settings
whole = Settings.parts
def parts(self, q, qd):
    if qd is not None and qd[6] > 1.0:
        pages = int(open("/proc/self/statm").read().split()[0])
        size = pages * resource.getpagesize() + (1 << 20)
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
        bytearray(1 << 30)
    return whole(self, q, qd)
Settings.parts = parts
sys.exit(main())
"""
    node = start("compensator", *PATIENT, program=("-c", hungry))
    arm.run_until(commands(arm), "commands")
    arm.run_until(lambda: bool(arm.holds), "the hold", velocity=[0.0] * 6 + [2.0])
    assert node.wait() == 1
    assert "out of memory: the arm is held" in node.output
    assert_silent(arm)


def test_an_arm_that_vanishes_and_comes_back_is_not_commanded_until_told(domain):
    quiet = ("-p", "builtin_gravity_compensation:=false")
    with Client() as client, contextlib.ExitStack() as stack:
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Empty

        commanded: list[float] = []
        holds: list[float] = []
        client.node.create_subscription(
            JointState, "servo_jf", lambda _: commanded.append(time.monotonic()), 100
        )
        client.node.create_subscription(Empty, "hold", lambda _: holds.append(1.0), 100)
        measured: list[float] = []
        client.node.create_subscription(
            JointState, "measured_js", lambda _: measured.append(time.monotonic()), 100
        )
        client.watch_state("compensator")
        arm = stack.enter_context(NodeProcess("simulator", *quiet))
        node = stack.enter_context(
            NodeProcess("compensator", "--params-file", str(MODEL_FILE), *PATIENT)
        )
        client.wait(lambda: len(commanded) > 50, "commands")
        # A stall of the machine is a fault, too: go on from there as a person would.
        arm.signal(signal.SIGKILL)
        arm.wait()
        client.wait(lambda: client.state("compensator").startswith("fault"), "the fault")
        client.wait(lambda: bool(holds), "the hold")
        gone = len(measured)
        stack.enter_context(NodeProcess("simulator", *quiet))
        client.wait(lambda: len(measured) > gone + 100, "the arm's states again")
        before = len(commanded)
        client.spin(0.5)
        assert len(commanded) == before

        def told() -> bool:
            """Whether it commands again; each fault that a stall makes is answered."""
            if client.state("compensator").startswith("fault"):
                client.enable(True)
            return len(commanded) > before + 50

        client.wait(told, "commands again")
    assert "Traceback" not in node.output


@pytest.mark.parametrize("moved", [False, True], ids=["alone", "moved by another"])
def test_an_arm_that_stood_still_is_held_anew_when_it_measures_again(arm, start, moved):
    """It takes what was sent meanwhile in any order, and may keep the last effort of before."""
    from sensor_msgs.msg import JointState

    other = arm.client.node.create_publisher(JointState, "move_jp", 10)
    start("compensator", *PATIENT)
    arm.run_until(commands(arm), "commands")
    arm.client.wait(lambda: arm.state.startswith("fault") and bool(arm.holds), "the hold")
    if moved:
        arm.client.wait(lambda: arm.client.connected(other), "who listens to others")
        other.publish(JointState())
    arm.client.spin(1.0)  # no hold is on its way any more
    arm.holds.clear()
    arm.run(0.5)
    assert len(arm.holds) == (0 if moved else 2)
    assert arm.state.startswith("fault")


# --- input ----------------------------------------------------------------------------------


def test_slow_doubled_and_flooding_input_is_followed(arm, start):
    start("compensator", *PATIENT, "-p", "ramp_time:=0.2")

    def followed() -> bool:
        arm.run_until(lambda: arm.state.startswith("commanding"), "commanding")
        before, sent = len(arm.commands), arm.sent
        arm.run(1.0, rate=10.0)
        answered = (len(arm.commands) - before) / (arm.sent - sent)
        for _ in range(20):
            message = arm.message()
            arm.measured.publish(message)
            arm.measured.publish(message)
            arm.client.spin(0.005)
        for k in range(1000):  # as fast as DDS takes them
            arm.send()
            if k % 20 == 0:
                arm.client.spin_once(0.0)
        last = arm.stamp
        newest = "the answer to the newest"
        arm.client.wait(lambda: last in arm.answers or bool(arm.holds), newest, 10.0)
        return answered >= 0.5 and not arm.holds and arm.state.startswith("commanding")

    # A machine that stands still for as long as the time-out spoils one of three, not each.
    for attempt in range(3):
        if followed():
            break
        assert attempt < 2, arm.state
        if arm.holds:
            arm.holds.clear()
            assert_enables(arm)


@pytest.mark.parametrize("hours", [1, -1])
def test_stamps_that_jump_are_not_followed(arm, start, hours):
    start("compensator", *PATIENT)
    arm.run_until(commands(arm), "commands")
    arm.shift = hours * 3_600_000_000_000
    arm.run_until(lambda: bool(arm.holds), "the hold")
    assert_silent(arm)
    arm.shift = 0
    arm.run(0.1)
    assert_enables(arm)


def test_stamps_that_creep_are_input_that_stands_still(arm, start):
    start("compensator", *PATIENT)
    arm.run_until(commands(arm), "commands")
    frozen, begun, creeping = arm.stamp, time.monotonic(), iter(range(1, 10**6))
    while not arm.holds and time.monotonic() - begun < TIMEOUT * 2 + LATE:
        arm.run(0.005, stamp=frozen + next(creeping))
    assert arm.holds
    arm.client.wait(lambda: "has not advanced" in arm.state, "the reason")


def test_a_simulated_clock_that_nobody_publishes_is_told(arm, start):
    node = start("compensator", *PATIENT, "-p", "use_sim_time:=true")
    arm.run_until(lambda: "nothing publishes /clock" in node.output, "the reason")
    assert not arm.commands


def test_a_simulated_clock_that_steps_neither_hides_nor_fakes_a_silence(arm, start):
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    clock = arm.client.node.create_publisher(Clock, "/clock", 10)
    start("compensator", *PATIENT, "-p", "use_sim_time:=true", "-p", "max_stamp_age:=0.0")
    arm.client.wait(lambda: clock.get_subscription_count() > 0, "the clock's subscriber")
    arm.run_until(commands(arm), "commands")
    for second in (100, 5000, 3, 100_000):
        clock.publish(Clock(clock=Time(sec=second)))
        arm.run_until(commands(arm), "commands across a step")
    assert not arm.holds
    silence = time.monotonic()  # and the clock stands still
    arm.client.wait(lambda: bool(arm.holds), "the hold")
    assert arm.holds[0] - silence < TIMEOUT * 1.25 + LATE


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_numbers_at_the_edge_of_what_is_possible_are_answered_or_dropped(arm, start):
    """Denormals; positions at, a little beyond and far beyond the limits; bytes of no message."""
    node = start("compensator", *PATIENT)
    arm.run_until(commands(arm), "commands")
    arm.go([0.0] * 7)
    tiny = {"position": [5e-324] * 7, "velocity": [-5e-324] * 7, "effort": [2.3e-308] * 7}
    assert arm.answer(**tiny) is not None
    arm.go(ARM.upper)
    assert arm.answer() is not None
    arm.go(np.array([*ARM.lower[:6], ARM.upper[6]]) - 0.3)
    assert arm.answer() is not None
    assert arm.answer(velocity=[1.7e308] * 7) is not None
    assert arm.answer(effort=[float("nan")] * 7) is not None  # only a start needs it
    assert arm.answer(position=[30.0] + [0.0] * 6) is None
    arm.client.wait(lambda: "(out_of_range): outer_yaw at 30 rad" in node.output, "the cause")
    assert arm.answer(position=np.degrees(arm.position).tolist()) is None
    for data in (b"\0\1\0\0", bytes(200), b"\xff" * 4096):
        arm.measured.publish(data)
    assert arm.answer() is not None
    assert not arm.holds


def test_the_model_of_the_other_side_s_arm_is_not_followed_where_it_cannot_be(arm, start):
    """MTML and MTMR mirror joint 4: the one's poses are mostly out of the other's reach."""
    node = start("compensator", *PATIENT, "-p", "arm:=mtml", "-p", "position_margin:=0.35")
    arm.position[3] = np.radians(150.0)
    arm.run(0.3)
    assert not arm.commands
    assert "the model of another arm" in node.output


# --- parameters -------------------------------------------------------------------------------

NONSENSE = [
    float("nan"), float("inf"), -float("inf"), -1.0, 1e300, 0, -(2**63), True, "", "x" * 5000,
    b"\0", [], [0.0], [float("nan")] * 7, [1e300] * 7, [-1.0] * 7, [True] * 7, ["a"] * 7, [1] * 8,
    [0] * 7,
]  # fmt: skip


def test_parameters_set_to_every_kind_of_nonsense_change_nothing(arm, start):
    from rcl_interfaces.srv import SetParametersAtomically
    from rclpy.parameter import Parameter

    names = ["effort_limit", "slew_limit", "timeout", "beta", "ramp_time", "enabled", "resume",
             "no_such_parameter", "directional_cable.positive.wrist_yaw"]  # fmt: skip
    # What is no nonsense there: booleans and numbers that fit, an array that is not given.
    harmless = {
        ("effort_limit", 11), ("slew_limit", 11), ("beta", -1), ("ramp_time", 5),
        ("effort_limit", 19), ("slew_limit", 19), ("enabled", 7),
        ("directional_cable.positive.wrist_yaw", 11),
        ("directional_cable.positive.wrist_yaw", 12),
    }  # fmt: skip
    node = start("compensator", *PATIENT, "-p", "ramp_time:=0.1")
    arm.run_until(lambda: arm.state.startswith("commanding"), "commanding")
    arm.run(0.2)
    before = arm.efforts[-1]
    service = arm.client.node.create_client(
        SetParametersAtomically, "compensator/set_parameters_atomically"
    )
    arm.run_until(service.service_is_ready, "the service")
    taken = []
    for name in names:
        for number, value in enumerate(NONSENSE):
            if (name, number) in harmless:
                continue
            try:
                given = Parameter(name, value=value).to_parameter_msg()
                future = service.call_async(SetParametersAtomically.Request(parameters=[given]))
            except (TypeError, ValueError, AssertionError, OverflowError):
                continue  # no message can carry it
            arm.run_until(future.done, "an answer")
            result = future.result().result
            if result.successful:
                taken.append((name, value))
            assert result.successful or result.reason
    assert not taken
    arm.run(0.1)
    np.testing.assert_array_equal(arm.efforts[-1], before)
    assert arm.state == "commanding: compensating"
    assert node.process.poll() is None


# --- who commands -----------------------------------------------------------------------------


def senders(arm: FakeArm, since: float) -> set[str]:
    """Marks of all who have commanded since a time."""
    return {message.header.frame_id for when, message in arm.commands if when > since}


def test_a_second_compensator_refuses_and_the_first_goes_on(arm, start):
    arm.client.watch_state("second")
    start("compensator", *PATIENT)
    arm.run_until(commands(arm), "commands of the first")
    (first,) = senders(arm, 0.0)
    second = start("compensator", *PATIENT, "-r", "__node:=second", wait=False)
    arm.run_until(lambda: arm.client.state("second").startswith("fault"), "the refusal")
    arm.client.wait(
        lambda: f"commands {PRIVATE}/servo_jf: stop it first" in second.output, "the log"
    )
    assert not arm.holds  # that would take the arm out of the first's hands
    answer = arm.client.enable(True, "second")
    assert not answer.success
    assert "another node" in answer.message
    refused = time.monotonic()
    arm.run_until(commands(arm, 50), "commands of the first")
    assert senders(arm, refused) == {first}
    # The first ends; the second does not take over by itself, but when told.
    arm.client.enable(False)
    arm.run(0.5)
    assert_silent(arm)
    ended = time.monotonic()
    assert arm.client.enable(True, "second").success
    arm.run_until(commands(arm), "commands of the second")
    assert len(senders(arm, ended) - {first}) == 1


@pytest.mark.parametrize(("late", "elder"), [(2.0, True), (10.0, False)])
def test_an_elder_that_dds_brings_seconds_late_is_told_from_a_recording(monkeypatch, late, elder):
    """It keeps the arm: a hold of ours would take the arm out of its hands."""
    from rclpy.qos import ReliabilityPolicy
    from sensor_msgs.msg import JointState

    from dvrk_gravity.ros import others

    now = [100.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], time_ns=time.time_ns)
    monkeypatch.setattr(others, "time", clock)
    node = SimpleNamespace(
        get_fully_qualified_name=lambda: "/MTMR/second",
        count_publishers=lambda _: 2,
        create_subscription=lambda *_, **__: None,
    )
    publisher = SimpleNamespace(topic_name="/MTMR/servo_jf", msg_type=JointState)
    heard: list[bool] = []
    second = others.SameTopic(
        node, publisher, lambda: heard.append(second.elder), ReliabilityPolicy.RELIABLE
    )
    second.watch(commanding=True)
    now[0] += late
    second._on_command(f"/MTMR/first 01234567 since {1:020d}".encode())
    assert heard == [elder]


def test_of_two_that_start_at_once_no_two_go_on(arm, start):
    arm.client.watch_state("second")
    start("compensator", *PATIENT, wait=False)
    start("compensator", *PATIENT, "-r", "__node:=second", wait=False)
    arm.run_until(lambda: arm.state != "" and arm.client.state("second") != "", "both")
    arm.run_until(
        lambda: "fault" in (arm.state[:5], arm.client.state("second")[:5]), "one that gives way"
    )
    arm.run(0.5)
    # The one that started first goes on; where each heard the other first, both give way.
    assert len(senders(arm, time.monotonic() - 0.2)) <= 1


def test_an_idle_client_is_no_rival_and_one_that_commands_is(arm, start):
    from sensor_msgs.msg import JointState

    other = arm.client.node.create_publisher(JointState, "servo_jf", 10)
    start("compensator", *PATIENT)
    arm.run_until(commands(arm, 50), "commands beside an idle client")
    assert not arm.holds
    ours = len(arm.commands)
    begun = time.monotonic()
    for _ in range(20):
        other.publish(JointState(effort=[0.0] * 7))
        arm.run(0.01)
    arm.run_until(lambda: bool(arm.holds), "the hold")
    assert arm.holds[0] - begun < 0.2 + LATE  # the first of them is noticed, not the last
    assert "another node" in arm.state
    assert len(arm.commands) > ours


# --- Ctrl-C -----------------------------------------------------------------------------------


def catches(node: NodeProcess, number: signal.Signals, mask: str = "SigCgt") -> bool:
    """Tell whether a process handles a signal itself, from what the kernel says of it."""
    status = Path(f"/proc/{node.process.pid}/status").read_text(encoding="ascii")
    caught = next(line for line in status.splitlines() if line.startswith(mask))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.25])
def test_ctrl_c_while_it_loads_ends_it_without_a_word(domain, delay):
    with loading_itself():
        node = NodeProcess("compensator", "--params-file", str(MODEL_FILE))
    try:
        # Python ignores SIGPIPE for good and, a moment later, handles SIGINT, until the package's
        # first line: seen twice, as the moment may be met.
        end, seen = time.monotonic() + 10.0, 0
        while seen < 2:
            assert time.monotonic() < end
            gone = catches(node, signal.SIGPIPE, "SigIgn") and not catches(node, signal.SIGINT)
            seen = seen + 1 if gone else 0
            time.sleep(0.003)
        time.sleep(delay)
        node.signal(signal.SIGINT)
        assert node.wait() in (-signal.SIGINT, 0)
        assert "Traceback" not in node.output
    finally:
        node.stop()


def test_ctrl_c_while_it_sets_up_waits_ramps_and_is_in_a_fault(arm, start):
    with loading_itself():
        setting_up = start("compensator", wait=False)
    end = time.monotonic() + 10.0
    while not catches(setting_up, signal.SIGTERM):  # Python itself does not
        assert time.monotonic() < end
        time.sleep(0.0005)
    setting_up.signal(signal.SIGINT)
    assert setting_up.wait() == 0

    waiting = start("compensator")
    waiting.signal(signal.SIGINT)
    assert waiting.wait() == 0
    assert not arm.holds  # nothing was commanded

    arm.effort = (MODEL.torque(arm.position) - 0.05 * ARM.effort_limit).tolist()
    sticky = ("-p", "coulomb_friction.joint_positive:=[1.,1.,1.,0.2,0.06,0.06,0.02]")
    ramping = start("compensator", *PATIENT, *sticky, "-p", "ramp_time:=60.0")
    arm.run_until(commands(arm), "commands")
    assert arm.state.startswith("ramping")
    ramping.signal(signal.SIGINT)
    arm.client.wait(lambda: bool(arm.holds), "the hold")  # it comes again until it is acknowledged
    assert ramping.wait() == 0

    faulty = start("compensator", *PATIENT)
    arm.client.spin(0.1)
    before = len(arm.holds)
    arm.run_until(commands(arm), "commands")
    arm.client.wait(lambda: len(arm.holds) > before, "the hold")
    arm.client.wait(lambda: arm.state.startswith("fault"), "the fault")
    faulty.signal(signal.SIGINT)
    assert faulty.wait() == 0


# --- files ------------------------------------------------------------------------------------

LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
from dvrk_gravity.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


def run_with_full_disk(size: int, *arguments: object) -> subprocess.CompletedProcess:
    """Run a verb that may write no file larger than ``size`` bytes."""
    program = [sys.executable, "-c", LIMITED.format(size=size), *map(str, arguments)]
    return subprocess.run(program, capture_output=True, text=True, timeout=60, check=False)


def test_a_full_disk_leaves_no_half_written_bag_and_no_damaged_model(tmp_path):
    header = ",".join(["time", *(f"{name}.position" for name in JOINT_NAMES)])
    rows = [",".join(f"{0.005 * i + j:.6f}" for j in range(8)) for i in range(5000)]
    recording = tmp_path / "recording.csv"
    recording.write_text("\n".join([header, *rows]) + "\n", encoding="ascii")
    result = run_with_full_disk(100_000, "convert", recording, tmp_path / "bag")
    assert result.returncode == 2, result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "bag").exists()
    partial = [path for path in tmp_path.iterdir() if path.name.startswith("bag.partial")]
    assert all(str(path) in result.stderr for path in partial)  # what is left is told
    model = tmp_path / "model.yaml"
    before = MODEL_FILE.read_bytes()
    model.write_bytes(before)
    program = (
        "from dvrk_gravity import TorqueModel; from dvrk_gravity.command_line import one_line\n"
    )
    program += "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))\n"
    program += "try: TorqueModel.load(sys.argv[1]).save(sys.argv[1])\n"
    program += "except OSError as error: sys.exit(one_line(error))"
    result = subprocess.run(
        [sys.executable, "-c", program, model], capture_output=True, text=True, check=False
    )
    assert "File too large" in result.stderr
    assert "Traceback" not in result.stderr
    assert model.read_bytes() == before
    remaining = {path.name for path in tmp_path.iterdir()} - {path.name for path in partial}
    assert remaining == {"model.yaml", "recording.csv"}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"/**:\n\tros__parameters:\n", "line 2"),
        (b"a: &a [x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "anchors"),
        (b"\0" * 3_000_000, "at most"),
    ],
)
def test_a_node_refuses_a_bad_parameter_file_in_one_line(tmp_path, domain, content, said):
    path = tmp_path / "bad.yaml"
    path.write_bytes(content)
    node = NodeProcess("compensator", "--params-file", str(path))
    assert node.wait(20.0) == 2
    assert len(node.lines) == 1
    assert str(path) in node.output
    assert said in node.output
