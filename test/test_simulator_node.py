"""The simulator node over DDS: a process of its own, judged by its topics and exit status."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from made_up_arm import made_up_arm, write
from robots import UR5

rclpy = pytest.importorskip("rclpy")

from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Bool, Empty, Float64MultiArray  # noqa: E402

from dvrk_gravity.arms import JOINT_NAMES, Arm  # noqa: E402
from dvrk_gravity.errors import ConfigError  # noqa: E402
from dvrk_gravity.ros import (  # noqa: E402
    PRIVATE,
    CommandTopic,
    NodeProcess,
    private_domain,
)
from dvrk_gravity.ros import Client as ROSClient  # noqa: E402
from dvrk_gravity.simulate import PlantFile  # noqa: E402

TIMEOUT = 10.0
POSE = [0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0]


NAMESPACE = f"{PRIVATE}/MTMR"


def start(*parameters: str, namespace: str = NAMESPACE) -> NodeProcess:
    arguments = [word for parameter in parameters for word in ("-p", parameter)]
    return NodeProcess("simulator", *arguments, namespace=namespace)


class Client:
    """What a user of the arm sees and does."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context)
        self.node = Node("client", namespace=NAMESPACE, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.measured: list[JointState] = []
        self.setpoint: list[JointState] = []
        self.compensation: list[JointState] = []
        for topic, kept in (
            ("measured_js", self.measured),
            ("setpoint_js", self.setpoint),
            ("gravity_compensation/setpoint_js", self.compensation),
        ):
            self.node.create_subscription(JointState, topic, kept.append, 100)
        self.publishers = {
            topic: self.node.create_publisher(kind, topic, 10)
            for topic, kind in (
                ("servo_jf", JointState), ("servo_jp", JointState), ("move_jp", JointState),
                ("simulator/push_jf", JointState), ("hold", Empty), ("free", Empty),
                ("use_gravity_compensation", Bool),
            )
        }  # fmt: skip

    def wait(self, condition: Callable[[], bool], what: str, timeout: float = TIMEOUT) -> None:
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f"waited {timeout} s for: {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def connect(self) -> None:
        self.wait(
            lambda: all(p.get_subscription_count() for p in self.publishers.values()), "topics"
        )
        self.wait(lambda: bool(self.measured and self.setpoint and self.compensation), "messages")

    def send(self, topic: str, message: object) -> None:
        self.publishers[topic].publish(message)

    def fresh(self, kept: list[JointState], count: int = 1) -> JointState:
        """Return a message that comes after what has been commanded so far."""
        seen = len(kept)
        self.wait(lambda: len(kept) >= seen + count, "fresh messages")
        return kept[-1]

    def commanded(self, goal: np.ndarray) -> bool:
        """Tell whether the set point is a position, and this one."""
        position = np.array(self.setpoint[-1].position)
        return position.shape == goal.shape and bool(np.abs(position - goal).max() < 1e-9)

    @property
    def position(self) -> np.ndarray:
        return np.array(self.measured[-1].position)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture(scope="module", autouse=True)
def own_domain() -> Iterator[None]:
    with private_domain():
        yield


@pytest.fixture(scope="module")
def client(own_domain: None) -> Iterator[Client]:
    client = Client()
    try:
        with start(f"initial_position:={POSE}"):
            client.connect()
            yield client
    finally:
        client.close()


@pytest.fixture
def arm(client: Client) -> Client:
    """The arm as it was started: at rest in the same place, compensation on."""
    client.send("use_gravity_compensation", Bool(data=True))
    # DDS keeps no order among topics: a command still on its way would come after the test's own.
    # It has come when the set point is where the last test cannot have left it, and then there.
    for goal in (np.array(POSE) - 0.005, np.array(POSE)):
        client.send("move_jp", JointState(position=goal.tolist()))
        client.wait(lambda goal=goal: client.commanded(goal), "the end of the motion")
    client.wait(
        lambda: bool(
            np.abs(client.position - POSE).max() < 0.02
            and np.abs(client.measured[-1].velocity).max() < 0.1
        ),
        "the arm in its place",
    )
    # What was sent before the switch may still have been on its way.
    client.wait(lambda: any(client.compensation[-1].effort), "the arm's own compensation")
    return client


def test_publishes_what_an_mtm_publishes(arm: Client) -> None:
    first = arm.fresh(arm.measured, 300)
    assert tuple(first.name) == JOINT_NAMES
    assert len(first.position) == len(first.velocity) == len(first.effort) == 7
    stamps = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in arm.measured])
    assert (np.diff(stamps) > 0).all()
    # They begin with the clock and fall behind by the time that a slow machine leaves out.
    assert 0.0 <= time.time() - stamps[-1] < TIMEOUT
    assert np.median(np.diff(stamps[-200:])) < 0.002
    assert np.abs(np.array(arm.setpoint[-1].position) - POSE).max() < 0.02
    assert np.abs(arm.compensation[-1].effort).max() > 0.1


def test_stamps_count_simulated_time_and_no_sample_is_left_out(arm: Client) -> None:
    arm.fresh(arm.measured, 300)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in arm.measured[-300:]]
    # A reader that is late may lose messages; every interval is a number of steps all the same.
    steps, beside = np.divmod(np.diff(stamps), 1_000_000)
    assert not beside.any()
    assert np.median(steps) == 1


def test_an_effort_lasts_and_a_wrong_length_is_ignored(arm: Client) -> None:
    weight = np.array(arm.compensation[-1].effort)
    arm.send("use_gravity_compensation", Bool(data=False))
    arm.send("servo_jf", JointState(name=["whatever"], effort=weight.tolist()))
    arm.wait(lambda: len(arm.setpoint[-1].position) == 0, "effort mode")
    arm.wait(lambda: not any(arm.compensation[-1].effort), "compensation off")
    arm.send("servo_jf", JointState(effort=[0.0] * 6))
    arm.send("servo_jf", JointState(effort=[float("nan")] * 7))
    arm.fresh(arm.measured, 500)
    np.testing.assert_allclose(arm.fresh(arm.setpoint).effort, weight)
    assert np.abs(arm.position - POSE).max() < 0.02


def test_the_builtin_compensation_adds(arm: Client) -> None:
    weight = np.array(arm.compensation[-1].effort)
    arm.send("servo_jf", JointState(effort=(0.1 * weight).tolist()))
    arm.wait(lambda: len(arm.setpoint[-1].position) == 0, "effort mode")
    for setpoint in (arm.setpoint[-1], arm.fresh(arm.setpoint)):
        ratio = np.array(setpoint.effort)[1:3] / weight[1:3]
        np.testing.assert_allclose(ratio, 1.1, atol=0.1)


def test_falls_when_free_and_is_caught_by_hold(arm: Client) -> None:
    arm.send("use_gravity_compensation", Bool(data=False))
    arm.send("free", Empty())
    arm.wait(lambda: np.abs(arm.position - POSE).max() > 0.15, "falling")
    arm.send("hold", Empty())
    # Not just turning back: at rest for a while.
    arm.wait(lambda: np.abs([m.velocity for m in arm.measured[-100:]]).max() < 0.1, "caught")
    held = arm.position
    arm.fresh(arm.measured, 300)
    assert np.abs(arm.position - held)[:4].max() < 0.005


def test_a_push_moves_it_and_ends(arm: Client) -> None:
    arm.send("free", Empty())  # floats on its own compensation
    end = time.monotonic() + TIMEOUT
    while arm.position[0] - POSE[0] < 0.05:  # however many pushes a late machine loses
        assert time.monotonic() < end
        arm.send("simulator/push_jf", JointState(effort=[0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        arm.fresh(arm.measured, 20)
    arm.wait(lambda: abs(arm.measured[-1].velocity[0]) < 0.01, "coming to rest by itself")


def test_servo_jp_goes_there_and_setpoint_js_says_where(arm: Client) -> None:
    goal = np.array(POSE) + 0.01
    arm.send("servo_jp", JointState(position=goal.tolist()))
    arm.wait(lambda: arm.commanded(goal), "the new set point")
    arm.wait(lambda: arm.position[0] > 0.008, "the arm there")
    assert arm.commanded(goal)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_quietly(number: signal.Signals) -> None:
    with start(namespace=f"{PRIVATE}/OTHER") as process:
        end = time.monotonic() + TIMEOUT
        while "simulating" not in process.output:
            assert time.monotonic() < end
            time.sleep(0.01)
        process.signal(number)
        assert process.wait(TIMEOUT) == 0
    assert "Traceback" not in process.output


@pytest.mark.parametrize(
    ("parameter", "says"),
    [
        ("plant:=nothing", "plant: got 'nothing'"),
        ("friction_scale:=-1.0", "friction_scale: got -1.0"),
        ("friction_scal:=1.0", "did you mean friction_scale?"),
        ("initial_position:=[0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0]", "shoulder_pitch"),
        ("rate:=many", "rate: got 'many'"),
        ("arm:=nothing", "arm: got 'nothing', expected mtml, mtmr, "),
    ],
)
def test_a_wrong_parameter_is_one_line_and_status_2(parameter: str, says: str) -> None:
    process = start(parameter)
    assert process.wait(TIMEOUT) == 2
    assert says in process.output
    assert len(process.lines) == 1


def test_the_pose_used_here_weighs_something() -> None:
    plant = PlantFile.load("mtmr_28002").plant()
    plant.reset(POSE)
    assert np.abs(plant.smooth_torque()[1:3]).min() > 0.1


def test_another_arm_is_simulated_with_its_own_joints_and_obeys_an_array(tmp_path) -> None:
    made_up = made_up_arm(tmp_path)
    measured: list[JointState] = []
    with (
        start(f"arm:={made_up.source}", "output:=array", "initial_position:=[0.1, 0.2, 0.1, 0.3]",
              "builtin_gravity_compensation:=false", namespace=PRIVATE),
        ROSClient() as client,
    ):  # fmt: skip
        client.node.create_subscription(JointState, "measured_js", measured.append, 10)
        commands = client.node.create_publisher(Float64MultiArray, "commands", 1)
        client.wait(lambda: client.connected(commands) and bool(measured), "the arm")
        assert tuple(measured[-1].name) == made_up.joint_names
        held = np.array(measured[-1].position)
        np.testing.assert_allclose(held, [0.1, 0.2, 0.1, 0.3], atol=1e-3)

        def moved(joint: int) -> float:
            return abs(measured[-1].position[joint] - held[joint])

        # No effort: the insertion slides by its weight.
        commands.publish(Float64MultiArray(data=[0.0] * 4))
        client.wait(lambda: moved(2) > 0.01, "sliding")


def test_an_arm_with_drive_gains_tells_its_efforts_in_amperes(tmp_path) -> None:
    gains = np.array([2.0, 4.0, 5.0, 10.0])
    path = write(tmp_path, {"drive_gains": gains.tolist()})
    measured: list[JointState] = []
    with start(f"arm:={path}", namespace=PRIVATE), ROSClient() as client:
        client.node.create_subscription(JointState, "measured_js", measured.append, 10)
        client.wait(lambda: bool(measured), "the arm")
    plant = PlantFile.of(Arm.load(str(path))).plant()
    plant.reset(np.array(measured[-1].position))
    np.testing.assert_allclose(measured[-1].effort, plant.smooth_torque() / gains, atol=1e-3)


@pytest.mark.parametrize("name", ["a b", "/", "1st"])
def test_what_no_topic_can_be_called_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=f"^output_topic: got '{name}', expected"):
        CommandTopic.of({"output": "array", "output_topic": name})


def test_a_plant_of_another_arm_than_was_named_is_refused() -> None:
    process = start("arm:=mtmr", f"plant:={UR5}")
    assert process.wait(TIMEOUT) == 2
    assert "expected one with the joints of mtmr, as `arm` says" in process.output
