"""A made-up arm falls, floats, is pushed, and is held when its compensator is killed."""

from __future__ import annotations

import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_arm import made_up_arm

from dvrk_gravity.cli.demo import draw
from dvrk_gravity.recording import BagReader
from dvrk_gravity.ros import PRIVATE, Scenario, Schedule, Stage, private_domain


@pytest.mark.parametrize("output", ["servo_jf", "array"])
def test_a_demonstration_of_a_made_up_arm(output: str, tmp_path: Path) -> None:
    arm = made_up_arm(tmp_path)
    stage = Stage.of(arm, "", None, tmp_path)
    stage = replace(stage, poses=stage.poses[:1])
    schedule = Schedule(fall=0.7, floating=1.0, rest=0.5)
    with (
        private_domain(),
        Scenario(stage, tmp_path / "bag", output=output, schedule=schedule) as scenario,
    ):
        fall = scenario.fall()
        floats = list(scenario.floats())
        pushed, rest = scenario.push()
        # The arm stands still for longer than the compensator waits: it gives up, unheard yet.
        scenario.simulator.signal(signal.SIGSTOP)
        time.sleep(0.3)
        scenario.simulator.signal(signal.SIGCONT)
        kill = scenario.kill()
    ways = [float((each.drift / arm.scale).max()) for each in (fall, pushed, rest, kill.after)]
    assert ways[0] > 0.5
    assert ways[1] > 0.1
    assert max(ways[2:]) < np.radians(0.5)
    assert kill.hold_after > 0.0
    assert any(reason.startswith("fault") for reason in scenario.interruptions)
    namespace = f"{PRIVATE}/MADE_UP"
    command = {"servo_jf": "servo_jf", "array": "commands"}[output]
    topics = {f"{namespace}/{name}" for name in (command, "measured_js", "hold")}
    with BagReader(tmp_path / "bag") as bag:
        assert {topic for topic, _, _ in bag.raw(*topics)} == topics
    draw(tmp_path / "demo.png", arm, fall, floats, pushed, rest, kill)
    assert (tmp_path / "demo.png").stat().st_size > 10_000
