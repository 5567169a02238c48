"""The monitor as a node: what it publishes, what it never does, what it saves."""

from __future__ import annotations

from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from released import ARM, MODEL, NAMESPACE
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from dvrk_gravity import Recording
from dvrk_gravity.ros import COMMANDS, UNHEARD, Client, NodeProcess

SIMULATOR = ("-p", "arm:=ecm", "-p", "rate:=100.0")


class Listening:
    """What a client hears of a monitor."""

    def __init__(self, client: Client) -> None:
        self.client, node = client, client.node
        self.torques: dict[str, list[JointState]] = {}
        self.wrenches: list[WrenchStamped] = []
        self.said: dict[str, str] = {}
        for name in ("expected_js", "external_js", "external_js_std"):
            heard = self.torques.setdefault(name, [])
            node.create_subscription(JointState, f"monitor/{name}", heard.append, 100)
        node.create_subscription(
            WrenchStamped, "monitor/external_wrench", self.wrenches.append, 100
        )
        node.create_subscription(DiagnosticArray, "/diagnostics", self._note, 100)

    def _note(self, message: DiagnosticArray) -> None:
        (status,) = message.status
        self.said = {entry.key: entry.value for entry in status.values}

    def until(self, key: str, *values: str, timeout: float = 60.0) -> None:
        """Wait for diagnostics with one of some values."""
        words = f"{key}: {' or '.join(values)}"
        self.client.wait(
            lambda: any(value in self.said.get(key, "") for value in values), words, timeout
        )


def test_torques_wrench_and_a_diagnosed_bag_and_never_a_command(domain, tmp_path):
    MODEL.save(tmp_path / "model.yaml")
    words = ("--params-file", f"{tmp_path / 'model.yaml'}", "-p", f"save_folder:={tmp_path}")
    with (
        Client(NAMESPACE) as client,
        NodeProcess("monitor", *words, namespace=NAMESPACE) as monitor,
    ):
        heard = Listening(client)
        heard.until("state", "silent")
        with NodeProcess("simulator", *SIMULATOR, namespace=NAMESPACE):
            heard.until("state", "as expected", "held by friction")
            client.wait(lambda: bool(heard.wrenches), "a wrench")
            for name, messages in heard.torques.items():
                assert tuple(messages[-1].name) == ARM.joint_names, name
                assert len(messages[-1].effort) == ARM.n
            assert heard.wrenches[-1].header.frame_id == "link4"
            assert "force" in heard.said["wrench unobservable"]
            published = {
                name.rsplit("/", 1)[-1]
                for name, _ in client.node.get_publisher_names_and_types_by_node(
                    "monitor", NAMESPACE
                )
            }
            assert {"expected_js", "external_wrench_std", "events"} <= published
            commands = {name.rsplit("/", 1)[-1] for name, _ in COMMANDS} | {*UNHEARD}
            assert not published & (commands | {"hold", "servo_jf", "use_gravity_compensation"})
        heard.until("state", "silent")
        # The arm's publisher begins anew.
        with NodeProcess("simulator", *SIMULATOR, namespace=NAMESPACE):
            heard.until("state", "as expected", "held by friction")
        answer = client.call(Trigger, "monitor/save")
        assert answer.success
        bag, diagnosis = answer.message.split("; its diagnosis, when ready: ")
        assert Path(diagnosis).parent == Path(bag).parent
        client.wait(
            lambda: (
                heard.said["saved"].startswith(str(tmp_path))
                and not heard.said["saved"].endswith(("being written", "on its way"))
            ),
            "the diagnosis",
            120.0,
        )
        recording = Recording.load(bag)
        assert recording.joints == ARM.joint_names
        assert len(recording) > 100
        assert monitor.stop() == 0
        assert "Traceback" not in monitor.output
