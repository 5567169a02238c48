"""An arm that another one stands in for, whose clock steps, or that is disabled, is held."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from test_excite import POSE, FakeArm, mover, to


@pytest.fixture
def fake(domain: int) -> Iterator[FakeArm]:
    pytest.importorskip("rclpy")
    with FakeArm() as arm:
        yield arm


def soon(fake: FakeArm, change) -> None:
    """Call ``change`` once, in the arm's own thread, when the motion is under way."""

    def once() -> None:
        timer.cancel()
        change()

    timer = fake.client.node.create_timer(0.3, once)


@pytest.mark.parametrize("known", [True, False])
def test_an_arm_in_whose_place_another_one_measures_is_held(fake: FakeArm, known: bool) -> None:
    """Also one that continues the count of messages, as one that began long before would."""
    from dvrk_gravity.ros import MotionError

    node = fake.client.node
    other = node.create_publisher(fake.message, "measured_js", 100)
    for _ in range(2000 if known else 0):
        other.publish(fake.message())

    def replace() -> None:
        first, fake.measured = fake.measured, other
        node.destroy_publisher(first)

    with mover(fake) as moving:
        moving.connect()
        soon(fake, replace)
        with pytest.raises(MotionError, match=r"another node than before .*is it another arm\?"):
            moving.follow(to(POSE + 0.1, 3.0), 3.0)
    assert fake.held()


def test_an_arm_whose_joints_change_their_order_on_the_way_is_held_and_told_nothing_wrong(
    fake: FakeArm,
) -> None:
    from dvrk_gravity.ros import MotionError

    fake.position = POSE + np.radians([20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    begin, goal = fake.position.copy(), fake.position + 0.02
    with mover(fake) as moving:
        moving.connect()
        soon(fake, lambda: setattr(fake, "order", [2, 1, 0, 3, 4, 5, 6]))
        with pytest.raises(MotionError, match=r": joints elbow_pitch, .*another arm\?"):
            moving.follow(lambda t: (begin + min(t / 3.0, 1.0) * (goal - begin), begin * 0.0), 3.0)
    assert fake.held()
    assert np.abs(np.array(fake.told) - begin).max() < 0.03


def test_a_clock_that_steps_forwards_on_the_way_holds_the_arm(fake: FakeArm) -> None:
    from dvrk_gravity.ros import MotionError

    def step() -> None:
        fake.stamp = lambda: fake.time(nanoseconds=time.time_ns() + 5 * 10**9).to_msg()

    with mover(fake) as moving:
        moving.connect()
        soon(fake, step)
        with pytest.raises(
            MotionError, match=r"its clock has stepped (4\.9\d?|5(\.0\d?)?) s forwards"
        ):
            moving.follow(to(POSE + 0.1, 3.0), 3.0)
    assert fake.held()


def test_an_arm_that_leaves_its_operating_state_on_the_way_is_held(
    fake: FakeArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """crtk_msgs is not everywhere: any message with two texts serves in its stead."""
    from diagnostic_msgs.msg import KeyValue

    from dvrk_gravity.ros import MotionError

    for name, value in (
        ("state", property(lambda message: message.key)),
        ("is_homed", property(lambda message: message.value == "homed")),
        ("is_busy", False),
    ):
        monkeypatch.setattr(KeyValue, name, value, raising=False)
    monkeypatch.setattr("dvrk_gravity.ros.presence.OperatingState", KeyValue)
    said = fake.client.node.create_publisher(KeyValue, "operating_state", 1)
    with mover(fake) as moving:
        moving.connect()
        soon(fake, lambda: said.publish(KeyValue(key="DISABLED", value="homed")))
        with pytest.raises(MotionError, match="the arm is DISABLED, expected ENABLED; sent hold"):
            moving.follow(to(POSE + 0.1, 3.0), 3.0)
    assert fake.held()
