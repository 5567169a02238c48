"""The simulator node over DDS: a process of its own, judged by its topics and exit status."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState
from simulator_user import STATES, User, simulator
from std_msgs.msg import Bool, Empty

from dvrk_gravity.arms import JOINT_NAMES

POSE = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])


def test_it_publishes_and_obeys_as_an_mtm_does(domain):
    commands = dict.fromkeys(("servo_jf", "servo_jp", "simulator/push_jf"), JointState)
    commands |= {"hold": Empty, "free": Empty, "use_gravity_compensation": Bool}
    measured, setpoint, own = STATES
    with simulator(f"initial_position:={POSE.tolist()}"), User(**commands) as user:
        user.connect()
        send = user.send
        assert tuple(user.fresh(measured, 300).name) == JOINT_NAMES
        # Stamps count simulated time: a reader that is late may lose messages, never fractions.
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in user.seen[measured]]
        steps, beside = np.divmod(np.diff(stamps[-300:]), 1_000_000)
        assert not beside.any()
        assert (steps > 0).all()
        assert np.median(steps) == 1
        assert np.abs(user.position - POSE).max() < 0.02
        weight = np.array(user.seen[own][-1].effort)
        assert np.abs(weight[1:3]).min() > 0.1
        # An effort adds to the arm's own compensation, and lasts; what is no effort is ignored.
        send["servo_jf"](JointState(effort=(0.1 * weight).tolist()))
        user.wait(lambda: not user.seen[setpoint][-1].position, "effort mode")
        ratio = np.array(user.fresh(setpoint).effort)[1:3] / weight[1:3]
        np.testing.assert_allclose(ratio, 1.1, atol=0.1)
        send["use_gravity_compensation"](Bool(data=False))
        send["servo_jf"](JointState(name=["whatever"], effort=weight.tolist()))
        user.wait(lambda: not any(user.seen[own][-1].effort), "its own compensation off")
        user.wait(lambda: np.allclose(user.seen[setpoint][-1].effort, weight), "the effort")
        for wrong in ([0.0] * 6, [float("nan")] * 7):
            send["servo_jf"](JointState(effort=wrong))
        user.fresh(measured, 300)
        np.testing.assert_allclose(user.fresh(setpoint).effort, weight)
        # Free, it falls; hold catches it.
        before = user.position
        send["free"](Empty())
        user.wait(lambda: np.abs(user.position - before).max() > 0.15, "falling")
        send["hold"](Empty())
        user.wait(lambda: user.speed() < 0.1, "rest")
        rest = user.position
        user.fresh(measured, 300)
        assert np.abs(user.position - rest)[:4].max() < 0.005
        # It goes where it is sent, and setpoint_js says where.
        goal = rest + 0.01
        send["servo_jp"](JointState(position=goal.tolist()))
        user.wait(
            lambda: np.allclose(user.seen[setpoint][-1].position or [9.0], goal, atol=1e-9), "there"
        )
        user.wait(lambda: user.position[0] - rest[0] > 0.008, "the arm there")
        # Free on its own compensation, a push moves it, and ends.
        send["use_gravity_compensation"](Bool(data=True))
        user.wait(lambda: any(user.seen[own][-1].effort), "its own compensation on")
        send["free"](Empty())
        begin = user.position[0]

        def pushed() -> bool:
            send["simulator/push_jf"](JointState(effort=[0.4] + [0.0] * 6))
            return user.position[0] - begin > 0.05

        user.wait(pushed, "moving")
        user.wait(lambda: user.speed(20) < 0.05, "coming to rest by itself")
