"""The demonstration of an arm: it falls, floats, is pushed and held, beside a console's topics."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from std_msgs.msg import Bool

from dvrk_gravity.arms import Arm
from dvrk_gravity.recording import BagReader
from dvrk_gravity.ros import COMMANDS, PRIVATE, Client, Scenario, Schedule, Stage


def test_an_arm_floats_and_is_held_and_a_console_in_its_domain_gets_nothing_of_it(
    domain: int, tmp_path: Path
) -> None:
    arm = Arm.load("mtmr")
    stage = Stage.of(arm, "", None, tmp_path)
    stage = replace(stage, poses=stage.poses[:1])
    schedule = Schedule(fall=0.1, floating=0.5, push=0.1, coast=0.1, rest=0.1)
    heard: list[str] = []
    with (
        Client("/MTMR", "console") as console,
        Scenario(stage, tmp_path / "bag", schedule=schedule) as scenario,
    ):
        for name, kind in (*COMMANDS, ("use_gravity_compensation", Bool)):
            hear = partial(lambda name, _: heard.append(name), name)
            console.node.create_subscription(kind, name, hear, 100)
        console.wait(lambda: "compensator" in console.node.get_node_names(), "the demonstration")
        scenario.fall()
        (floats,) = scenario.floats()
        scenario.push()
        kill = scenario.kill()
        console.spin(0.2)
    assert not heard
    assert kill.hold_after > 0.0
    assert len(floats.position) > 1
    namespace = f"{PRIVATE}/MTMR"
    topics = [f"{namespace}/{name}" for name in ("servo_jf", "measured_js", "hold")]
    with BagReader(tmp_path / "bag") as bag:
        assert {topic for topic, _, _ in bag.raw(*topics)} == set(topics)
