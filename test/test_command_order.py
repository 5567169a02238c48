"""In which order of joints an arm takes commands: by what was measured, stated or answered."""

from __future__ import annotations

import pytest

from dvrk_gravity.compensate import CommandSubscribers, order_mismatch, stated_order
from dvrk_gravity.errors import ConfigError

JOINTS = ("yaw", "pitch", "insertion")
TURNED = ("insertion", "yaw", "pitch")
TOPIC, NODE = "/ARM/commands", "/ARM/effort_controller"
LATE = 10.0  # after the patience with an answer, s


@pytest.mark.parametrize(
    ("names", "wrong"),
    [
        (JOINTS, ()),
        (TURNED, ()),
        ((*JOINTS, "jaw"), ()),
        ((*TURNED, "jaw", "clutch"), ()),
        (("gripper", *JOINTS), ("gripper",)),
        (("yaw", "gripper", "pitch", "insertion"), ("gripper",)),
        (("gripper", *TURNED[:2], "jaw", "pitch", "clutch"), ("gripper", "jaw")),
    ],
)
def test_joints_of_another_device_before_or_between_the_arm_s_shift_its_efforts(names, wrong):
    refused = order_mismatch(JOINTS, names)
    assert bool(refused) == bool(wrong)
    if wrong:
        ours = ",".join(name for name in names if name in JOINTS)
        for token in (",".join(names), ours, ",".join(wrong), f"command_joints:={ours}"):
            assert token in refused


def test_a_stated_order_has_each_joint_once():
    assert stated_order(JOINTS, "") == ()
    assert stated_order(JOINTS, "insertion, yaw,pitch") == TURNED
    for wrong in ("yaw,pitch", "yaw,pitch,insertion,jaw", "yaw,pitch,pitch", "yaw,pitch,jaw", ","):
        with pytest.raises(ConfigError, match=r"command_joints.*yaw,pitch,insertion"):
            stated_order(JOINTS, wrong)


class Asked:
    """Subscribers with a clock of the test's own."""

    def __init__(self, *order: str, stated: bool = False) -> None:
        self.subscribers = CommandSubscribers(TOPIC, order or JOINTS, stated)
        self.now = 5.0
        self.nodes: dict[bytes, str] = {}

    def comes(self, subscriber: bytes, node: str = NODE) -> None:
        self.nodes[subscriber] = node
        self.subscribers.look(self.nodes, self.now)

    def goes(self, subscriber: bytes) -> None:
        del self.nodes[subscriber]
        self.subscribers.look(self.nodes, self.now)

    def obstacle(self, after: float = 0.0, active: bool = False) -> str:
        self.now += after
        return self.subscribers.obstacle(self.now, active)


def test_nothing_is_commanded_before_the_controller_has_answered_with_our_order():
    asked = Asked()
    assert TOPIC in asked.obstacle()
    asked.comes(b"1")
    assert NODE in asked.obstacle()
    asked.subscribers.answer(b"1", JOINTS)
    assert asked.subscribers.unanswered() == {}
    assert asked.obstacle() == ""


def test_one_that_has_just_appeared_is_not_asked_in_case_it_is_a_watchdog():
    asked = Asked()
    asked.comes(b"1")
    asked.comes(b"2", "/watchdog")
    assert asked.subscribers.due_questions(asked.now + 0.1) == {}
    asked.goes(b"2")  # now it is known for one, and not looked at any more
    assert asked.subscribers.due_questions(asked.now + 0.5) == {b"1": NODE}


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("active", [False, True])
def test_a_controller_of_another_order_is_refused_with_both_orders_and_the_way_out(stated, active):
    asked = Asked(stated=stated)
    asked.comes(b"1")
    asked.subscribers.answer(b"1", TURNED)
    refused = asked.obstacle(active=active)
    for token in (NODE, ",".join(TURNED), ",".join(JOINTS), f"command_joints:={','.join(TURNED)}"):
        assert token in refused
    follows = Asked(*TURNED, stated=True)  # that way out
    follows.comes(b"1")
    follows.subscribers.answer(b"1", TURNED)
    assert follows.obstacle(active=active) == ""


@pytest.mark.parametrize("joints", [JOINTS[:2], (*JOINTS, "jaw"), ("jaw", *JOINTS), ("a", "b")])
def test_a_controller_of_other_joints_is_refused_and_no_order_helps(joints):
    asked = Asked(stated=True)
    asked.comes(b"1")
    asked.subscribers.answer(b"1", joints)
    assert ",".join(joints) in asked.obstacle()
    assert "command_joints:=" not in asked.obstacle()


def test_one_that_cannot_be_asked_needs_a_statement():
    for answers in (False, True):  # it has no parameter of joints, or no service
        for stated in (False, True):
            asked = Asked(stated=stated)
            asked.comes(b"1")
            if answers:
                asked.subscribers.answer(b"1", ())
            said = asked.obstacle(after=0.0 if answers else LATE)
            assert bool(said) != stated
            if said:
                assert NODE in said
                assert f"command_joints:={','.join(JOINTS)}" in said
            asked.subscribers.answer(b"1", TURNED)  # late, and different
            assert ",".join(TURNED) in asked.obstacle()


def test_a_recorder_beside_the_controller_changes_nothing_in_flight_nor_later():
    asked = Asked()
    asked.comes(b"1")
    asked.subscribers.answer(b"1", JOINTS)
    asked.comes(b"2", "/recorder")
    assert asked.obstacle(active=True) == ""
    assert "/recorder" in asked.obstacle(active=False)
    assert asked.obstacle(after=LATE) == ""


@pytest.mark.parametrize("lingers", [False, True])
def test_a_controller_that_starts_again_is_asked_again_before_it_gets_another_command(lingers):
    asked = Asked(stated=True)
    asked.comes(b"1")
    asked.subscribers.answer(b"1", JOINTS)
    asked.comes(b"2")
    if not lingers:  # DDS keeps a killed one for 20 s
        asked.goes(b"1")
    assert asked.subscribers.unanswered() == {b"2": NODE}
    assert NODE in asked.obstacle(active=True)
    asked.subscribers.answer(b"2", TURNED)
    assert ",".join(TURNED) in asked.obstacle(active=True)


def test_when_the_controller_is_gone_nothing_is_known():
    asked = Asked()
    asked.comes(b"1")
    asked.subscribers.answer(b"1", JOINTS)
    asked.goes(b"1")
    assert TOPIC in asked.obstacle(active=True)
    asked.subscribers.answer(b"1", JOINTS)  # an answer of one that is gone
    assert TOPIC in asked.obstacle(active=True)
