"""What a client hears of a monitor beside a simulated endoscope arm."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from dvrk_gravity.ros import Client

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

    def wait_for_bag(self) -> None:
        """Wait until a bag that was asked for is written, diagnosed or not."""
        busy = ("nothing", "being written")
        self.client.wait(lambda: not self.said.get("saved", "nothing").endswith(busy), "a bag")
