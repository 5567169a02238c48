"""What may happen to an arm while a process moves it along a plan, and to that process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from arm_side import TIMEOUT
from test_excite import ASLEEP, POSE, FakeArm

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.planning import Basis, FourierMotion, Plan, PlanLimits, load_limits, slacks
from dvrk_gravity.recording import Recording
from dvrk_gravity.ros import PRIVATE, processes

DURATION = 2.4  # s
PERIOD = 0.02  # s; a late set point is no further along a motion than one in time
# As `python -m dvrk_gravity` in a folder, but that a busy machine may suspend it for a while, and
# that its files may be limited; what it says of errors is in a file.
PATIENTLY = f"""
import os, resource, sys
folder, size = sys.argv[1], int(sys.argv[2])
del sys.argv[1:3]
os.chdir(folder)
os.dup2(os.open("errors.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
if size:
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
from dvrk_gravity.ros import mover
mover.ASLEEP = {ASLEEP}
from dvrk_gravity.__main__ import main
sys.exit(main())
"""
SMALL_DISK = 60_000  # bytes of a file: some of the motion, and less than all of it


@pytest.fixture
def fake(domain: int) -> Iterator[FakeArm]:
    pytest.importorskip("rclpy")
    with FakeArm() as arm:
        arm.effort = [0.0] * 7
        yield arm


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """A small motion around POSE, also as a file."""
    return planned(tmp_path)


def planned(folder: Path, ramp: float = 0.8, duration: float = DURATION, roll: float = 3.0) -> Plan:
    """Plan a motion, and write it: slow, for a stalled arm that lags far behind counts as stuck."""
    arm, basis = Arm.load("mtmr"), Basis(np.array([0.6]), ramp, duration)
    wave = np.radians(np.array([[0.0] * 7, [3.0, 1.0, 1.0, 3.0, 3.0, 3.0, roll]]))
    motion, limits = FourierMotion(basis, POSE, wave), PlanLimits.of(arm)
    most = max(slack.used for slack in slacks(motion, limits, arm))
    motion = replace(motion, coefficients=0.99 / max(most, 1.0) * wave)
    made = Plan(arm, motion, limits)
    made.save(folder / "plan.yaml")
    return made


class Collector:
    """A process that collects, forked as nodes are, and what it prints."""

    def __init__(self, folder: Path, *words: str, largest: int = 0) -> None:
        command = [sys.executable, "-c", PATIENTLY, str(folder), str(largest)]
        command += ["collect", "plan.yaml", "--out", "bag", "--namespace", PRIVATE, "--yes"]
        command += ["--timeout", str(TIMEOUT), "--rate", f"{1.0 / PERIOD:g}", *words]
        self.process = processes.subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace", start_new_session=True, preexec_fn=None,
        )  # fmt: skip
        self.errors, self.said = folder / "errors.txt", ""

    def __enter__(self) -> Collector:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(10.0)
        self.process.stdout.close()

    def until(self, begin: str) -> None:
        """Wait for a line that begins so."""
        while True:
            line = self.process.stdout.readline()
            assert line, (self.said, self.errors.read_text())
            self.said += line
            if line.startswith(begin):
                return

    def further(self, fake: FakeArm, seconds: float) -> None:
        """Wait until the arm is so much further along its way, or nothing moves it."""
        goal = len(fake.told) + seconds / PERIOD
        while len(fake.told) < goal and self.process.poll() is None:
            time.sleep(0.002)

    def end(self) -> tuple[int, str]:
        """Return its status, and its errors."""
        status = self.process.wait(90.0)
        self.said += self.process.stdout.read()
        return status, self.errors.read_text()


def require_whole(folder: Path, plan: Plan) -> None:
    """Every point of the motion was recorded: the arm was where it was commanded to be."""
    recording = Recording.load(folder / "bag")
    path = plan.at(np.linspace(0.0, plan.duration, 101))[0]
    away = np.abs(recording.position[:, None] - path[None]).max(axis=2)
    assert away.min(axis=0).max() < np.radians(0.7)
    assert not (folder / "bag.unfinished").exists()


def vanish(fake: FakeArm) -> None:
    fake.speaks = False


def stick(fake: FakeArm) -> None:
    def follow(message) -> None:
        fake.told.append(np.array(message.position))
        fake.position = np.where(np.arange(7) == 6, fake.position, fake.told[-1])

    fake.on_servo_jp = follow


def grab(fake: FakeArm) -> None:
    fake.effort = [0.0, 1.8, 0.0, 0.0, 0.0, 0.0, 0.0]


def command(fake: FakeArm) -> None:
    fake.servo_jf.publish(fake.message(effort=[0.0] * 7))


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (vanish, f"for {TIMEOUT:g} s; if this computer is busy, raise --timeout"),
        (stick, "wrist_roll is "),
        (grab, "shoulder_pitch's motor has 1.8 N·m"),
        (command, f"another node ({PRIVATE}/fake_arm) commands {PRIVATE}/servo_jf"),
    ],
    ids=["the arm vanishes", "a joint sticks", "a hand holds it", "another node commands it"],
)  # fmt: skip
def test_what_happens_to_the_arm_holds_it_is_reported_and_resumed(
    fake: FakeArm, plan: Plan, tmp_path: Path, fault: Callable[[FakeArm], None], says: str
) -> None:
    if fault is stick:
        planned(tmp_path, roll=15.0)
    with Collector(tmp_path, "--no-rehearsal") as collector:
        collector.until("motion")
        collector.further(fake, 0.6)
        fault(fake)
        status, error = collector.end()
    assert status == 2
    assert error.count("\n") == 1, error
    assert "stopped in its motion, " in error
    assert says in error
    assert "--resume goes on" in error
    if fault is not command:
        assert fake.held()
    if fault is not vanish:  # which shows that it goes on once it is mended
        return
    fake.speaks = True
    with Collector(tmp_path, "--no-rehearsal", "--resume") as collector:
        status, error = collector.end()
    assert status == 0, error
    assert "going on with bag, which stopped in its motion" in collector.said
    require_whole(tmp_path, plan)


def test_a_network_that_stutters_loses_nothing_of_the_motion(
    fake: FakeArm, plan: Plan, tmp_path: Path
) -> None:
    waiting: list = []
    speak, spoken = fake.measured.publish, [time.monotonic()]

    def stutter(message) -> None:
        waiting.append(message)
        if time.monotonic() - spoken[0] > 0.4 * TIMEOUT:  # by now some forty of them, at once
            for each in waiting:
                speak(each)
            waiting.clear()
            spoken[0] = time.monotonic()

    with Collector(tmp_path, "--no-rehearsal") as collector:
        collector.until("motion")
        fake.measured = SimpleNamespace(publish=stutter)
        status, error = collector.end()
    assert status == 0, error
    require_whole(tmp_path, plan)


def test_a_full_disk_holds_the_arm_and_what_was_recorded_is_resumed(
    fake: FakeArm, plan: Plan, tmp_path: Path
) -> None:
    with Collector(tmp_path, "--no-rehearsal", largest=SMALL_DISK) as collector:
        status, error = collector.end()
    assert status == 2
    assert "stopped in its motion, " in error
    assert "cannot be written" in error
    assert fake.held()
    with Collector(tmp_path, "--no-rehearsal", "--resume") as collector:
        status, error = collector.end()
    assert status == 0, error
    require_whole(tmp_path, plan)


def test_a_limit_that_is_tightened_meanwhile_ends_it_before_the_next_phase(
    fake: FakeArm, plan: Plan, tmp_path: Path
) -> None:
    path = tmp_path / "limits.yaml"
    path.write_text(yaml.safe_dump({"joints": {"outer_yaw": {"position": [-20.0, 20.0]}}}))
    load_limits(path, plan.arm)
    short = Basis(np.array([2.0]), 0.25, 0.5)
    motion = replace(plan.motion, basis=short, coefficients=0.02 * plan.motion.coefficients)
    replace(plan, motion=motion).save(tmp_path / "plan.yaml")
    with Collector(tmp_path, "--limits", "limits.yaml") as collector:
        collector.until("rehearsal")
        path.write_text(yaml.safe_dump({"joints": {"outer_yaw": {"position": [-0.001, 0.001]}}}))
        status, error = collector.end()
    assert status == 2
    assert "the plan exceeds the limit of position of outer_yaw by" in error
    assert "approach to the motion" in error
    assert fake.held()
    assert "motion" not in collector.said.replace("rehearsal", "").split("\n")[-1]


def test_a_process_that_is_killed_in_any_phase_is_resumed_and_loses_nothing(
    fake: FakeArm, tmp_path: Path
) -> None:
    plan = planned(tmp_path, 0.6, DURATION / 2)
    fake.position = POSE + np.radians(8.0)
    said = []
    for phase, after in (("approach", 0.2), ("rehearsal", 3.0), ("motion", 0.6)):
        with Collector(tmp_path, *(["--resume"] if said else [])) as collector:
            collector.until(phase)
            collector.further(fake, after)
            collector.process.send_signal(signal.SIGKILL)
            collector.end()
        said.append(collector.said)
        assert (tmp_path / "bag.unfinished" / "state.json").exists()
        assert not (tmp_path / "bag").exists()
    with Collector(tmp_path) as collector:  # without --resume: where it is, and the way out
        status, error = collector.end()
    assert status == 2
    assert "an earlier collection stopped in its motion, " in error
    assert "--resume goes on" in error
    with Collector(tmp_path, "--resume") as collector:
        status, error = collector.end()
    assert status == 0, error
    assert "which stopped in its approach to the rehearsal: its process was ended" in said[1]
    assert "which stopped in its rehearsal, " in said[2]
    assert "rehearsal:" not in collector.said
    require_whole(tmp_path, plan)


def test_a_person_s_corners_are_taught_through_ros(fake: FakeArm, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "dvrk_gravity", "collect", "--teach", "limits.yaml", "--arm"]
    corner = np.radians(20.0) * np.eye(7)[0]
    fake.position = POSE + corner
    process = subprocess.Popen(
        [*command, "mtmr", "--namespace", PRIVATE], cwd=tmp_path, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    assert "until Ctrl-C" in process.stdout.readline()
    shown = (line for line in process.stderr if line.startswith("shown: outer_yaw"))  # meanwhile
    assert "outer_yaw 0 %" in next(shown)
    for part in np.linspace(1.0, -1.0, 20):  # no encoder's slip: within half a second
        fake.position = POSE + part * corner
        time.sleep(0.02)
    assert any("outer_yaw 0 %" not in line for line in shown)
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=20.0)
    assert process.returncode == 0, error
    assert "shown: outer_yaw" in out
    assert not fake.told
    limits = load_limits(tmp_path / "limits.yaml", Arm.load("mtmr"))
    yaw = np.degrees([limits.lower[0], limits.upper[0]])
    np.testing.assert_allclose(yaw, [-18.0, 18.0], atol=0.7)
    assert JOINT_NAMES[0] == "outer_yaw"
