"""What may happen to a process that moves an arm along a plan, or is taught by a person."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from arm_side import TIMEOUT
from driven_arm import POSE, DrivenArm
from path_driver import plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.planning import Basis, FourierMotion, Plan, PlanLimits, load_limits
from dvrk_gravity.recording import Recording
from dvrk_gravity.ros import PRIVATE

PERIOD = 0.02  # s; a late set point is no further along a motion than one in time
# As `python -m dvrk_gravity`, but that a busy machine may suspend it for a while.
PATIENTLY = """
import sys
from dvrk_gravity.ros import mover
mover.ASLEEP = 2.0
from dvrk_gravity.__main__ import main
sys.exit(main())
"""


class Collector:
    """A process that collects, and what it prints."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.errors, self.said = folder / "errors.txt", ""
        with open(self.errors, "w") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-c", PATIENTLY, "collect", "plan.yaml", "--out", "bag", "--yes",
                 "--no-rehearsal", "--namespace", PRIVATE, "--timeout", str(TIMEOUT),
                 "--rate", f"{1.0 / PERIOD:g}", *words],
                cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors,
                text=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            )  # fmt: skip

    def __enter__(self) -> Collector:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(10.0)
        self.process.stdout.close()

    def until(self, begin: str) -> None:
        """Wait for a line that begins so."""
        while not self.said.splitlines()[-1:] or not self.said.splitlines()[-1].startswith(begin):
            line = self.process.stdout.readline()
            assert line, (self.said, self.errors.read_text())
            self.said += line

    def end(self) -> tuple[int, str]:
        """Return its status, and its errors."""
        status = self.process.wait(90.0)
        self.said += self.process.stdout.read()
        return status, self.errors.read_text()


def test_a_motion_whose_arm_vanished_and_whose_process_was_killed_is_resumed_and_whole(
    driven: DrivenArm, tmp_path: Path
) -> None:
    arm, basis = Arm.load("mtmr"), Basis(np.array([0.6]), 0.8, 2.4)
    wave = np.radians([[0.0] * 7, [2.0, 0.5, 0.5, 2.0, 2.0, 2.0, 2.0]])
    plan = Plan(arm, FourierMotion(basis, POSE, wave), PlanLimits.of(arm))
    plan.save(tmp_path / "plan.yaml")

    def further(points: int) -> None:
        """Wait until the arm is so much further along its way."""
        goal = len(driven.told) + points
        assert driven.wait_for(lambda: len(driven.told) >= goal)

    with Collector(tmp_path) as collector:
        collector.until("motion")
        further(30)
        driven.speaks = False
        status, error = collector.end()
    assert status == 2
    assert error.count("\n") == 1, error
    assert f"for {TIMEOUT:g} s" in error
    assert "--resume" in error
    assert driven.held()
    driven.speaks = True
    with Collector(tmp_path, "--resume") as collector:
        collector.until("motion")
        further(30)
        collector.process.send_signal(signal.SIGKILL)
        collector.end()
    assert (tmp_path / "bag.unfinished" / "state.json").exists()
    assert not (tmp_path / "bag").exists()
    with Collector(tmp_path, "--resume") as collector:
        status, error = collector.end()
    assert status == 0, error
    assert "its process was ended" in collector.said
    # Every point of the motion was recorded: the arm was where it was commanded to be.
    recording = Recording.load(tmp_path / "bag")
    path = plan.at(np.linspace(0.0, plan.duration, 101))[0]
    away = np.abs(recording.position[:, None] - path[None]).max(axis=2)
    assert away.min(axis=0).max() < np.radians(0.7)
    assert not (tmp_path / "bag.unfinished").exists()


def test_a_process_whose_output_nobody_reads_any_more_holds_the_arm(
    driven: DrivenArm, tmp_path: Path
) -> None:
    """A `| head -1` ends when the next part is announced."""
    plan = plan_of("mtmr", size=0.3)
    plan.save(tmp_path / "plan.yaml")
    driven.position = plan.at(0.0)[0] + 0.05
    with Collector(tmp_path) as collector:
        collector.until("approach")
        process = collector.process
        process.stdout.close()
        assert driven.wait_for(lambda: process.poll() is not None, 60.0)
    assert driven.held()
    assert process.returncode == 128 + signal.SIGPIPE, collector.errors.read_text()
    assert driven.told
    told = len(driven.told)
    driven.wait_for(lambda: len(driven.told) > told, 0.3)
    assert len(driven.told) == told  # nothing moves it any more


def test_a_person_s_corners_are_taught_through_ros_until_ctrl_c(
    driven: DrivenArm, tmp_path: Path
) -> None:
    corner = np.radians(20.0) * np.eye(7)[0]
    driven.position = POSE + corner
    process = subprocess.Popen(
        [sys.executable, "-m", "dvrk_gravity", "collect", "--teach", "limits.yaml", "--arm",
         "mtmr", "--namespace", PRIVATE],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    assert "until Ctrl-C" in process.stdout.readline()
    shown = (line for line in process.stderr if line.startswith("shown: outer_yaw"))  # meanwhile
    assert "outer_yaw 0 %" in next(shown)
    for part in np.linspace(1.0, -1.0, 20):  # no encoder's slip: step by step
        driven.position = POSE + part * corner
        time.sleep(0.02)
    assert any("outer_yaw 0 %" not in line for line in shown)
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=60.0)
    assert process.returncode == 0, error
    assert "shown: outer_yaw" in out
    assert not driven.told
    limits = load_limits(tmp_path / "limits.yaml", Arm.load("mtmr"))
    yaw = np.degrees([limits.lower[0], limits.upper[0]])
    np.testing.assert_allclose(yaw, [-18.0, 18.0], atol=0.7)
