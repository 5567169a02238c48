"""What a client hears of a monitor beside a simulated endoscope arm."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from released import MODEL, NAMESPACE
from sensor_msgs.msg import JointState

from dvrk_gravity.ros import Client, NodeProcess

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

    def until_saved(self, *still: str) -> None:
        """Wait for a bag that was asked for, and while what is said of it ends with some words."""
        busy = ("nothing", "being written", *still)
        self.client.wait(
            lambda: not self.said.get("saved", "nothing").endswith(busy), "a bag", 120.0
        )


@contextmanager
def monitored(folder: Path) -> Iterator[tuple[Listening, NodeProcess]]:
    """Start a monitor that saves to a folder; yield what is heard of it, and its process."""
    MODEL.save(folder / "model.yaml")
    words = ("--params-file", f"{folder / 'model.yaml'}", "-p", f"save_folder:={folder}")
    with (
        Client(NAMESPACE) as client,
        NodeProcess("monitor", *words, namespace=NAMESPACE) as monitor,
    ):
        yield Listening(client), monitor
