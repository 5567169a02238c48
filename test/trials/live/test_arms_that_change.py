"""An arm that is driven through ROS and becomes another one on the way, or whose clock steps."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from driven_arm import DrivenArm, hold_for
from sensor_msgs.msg import JointState


def replaced(arm: DrivenArm) -> None:
    """Also by one that continues the count of messages, as one that began long before would."""
    first = arm.measured
    arm.measured = arm.node.create_publisher(JointState, "measured_js", 100)
    for _ in range(2000):
        arm.measured.publish(arm.message_of(arm.position))
    arm.node.destroy_publisher(first)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (DrivenArm.measure_elsewhere, "several nodes "),
        (replaced, "(another node than before|several nodes)"),
        (lambda arm: setattr(arm, "ahead", 5.0), r"clock has stepped [45]"),
    ],
    ids=["two arms", "another arm", "clock"],
)
def test_an_arm_that_changes_on_the_way_is_held(
    driven: DrivenArm, fault: Callable[[DrivenArm], None], says: str, patience: None
) -> None:
    hold_for(driven, fault, says)
