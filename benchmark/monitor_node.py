"""Clean motion through the monitor's node as it was recorded: what it reports, and what it costs.

    PYTHONPATH=. python benchmark/monitor_node.py --minutes 60 --json node.json

Arms are drawn, identified and recorded as in benchmark/monitor.py, ten minutes each, and sent as
``measured_js`` at the rate of the recording. Nothing happens to them: every event is a false alarm.
Rows that the node did not test, where the machine was too slow for it, are counted.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from array import array
from collections import Counter
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from units import Target, as_json, judge, processor_time

from dvrk_gravity.files import text_file
from dvrk_gravity.monitoring import Sampling
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, private_domain
from testing.flights import ARMS, BLOCK, Flight, laboratory
from testing.monitor_judge import most_an_hour

UNTESTED_TARGET = 0.01  # of a monitor's rows


class _Heard:
    """What a monitor said.

    Attributes:
        events: As it published them.
        diagnostics: The last values by name.
    """

    def __init__(self, client: Client) -> None:
        self.events: list[dict[str, Any]] = []
        self.diagnostics: dict[str, str] = {}
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        client.node.create_subscription(String, "monitor/events", self._on_event, latched)
        client.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_event(self, message: String) -> None:
        self.events.append(json.loads(message.data))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith("/monitor"):
                self.diagnostics = {pair.key: pair.value for pair in status.values}


def listen(flight: Flight, seconds: float, folder: Path) -> dict[str, Any]:
    """Send a flight to a monitor, and return what came of it."""
    model = folder / "model.yaml"
    flight.model.save(model)
    recording, names = flight.recording, flight.model.arm.joint_names
    assert recording.time is not None
    assert recording.effort is not None
    measured = {"position": recording.position, "effort": recording.effort}
    if recording.velocity is not None:
        measured["velocity"] = recording.velocity
    with (
        private_domain(), Client() as client,
        NodeProcess("monitor", "--params-file", str(model), namespace=PRIVATE) as node,
    ):  # fmt: skip
        heard = _Heard(client)
        publisher = client.node.create_publisher(JointState, "measured_js", 100)
        client.wait(lambda: client.connected(publisher), "the monitor")
        begin, used = time.monotonic(), processor_time(node.process.pid)
        first = time.time_ns()
        for sample, at in enumerate(recording.time.tolist()):
            if at > seconds:
                break
            while (remaining := begin + at - time.monotonic()) > 0.0:
                client.spin_once(remaining)
            fields = {
                name: array("d", values[sample].tobytes()) for name, values in measured.items()
            }
            message = JointState(name=names, **fields)
            # When it was read, not when it is sent: positions alone are differentiated by stamps.
            second, nanosecond = divmod(first + round(at * 1e9), 1_000_000_000)
            message.header.stamp.sec, message.header.stamp.nanosec = second, nanosecond
            publisher.publish(message)
        client.spin(5.0)  # the last look, and diagnostics after it
        took = time.monotonic() - begin
        used = processor_time(node.process.pid) - used
    dropped = {name: count for name, count in heard.diagnostics.items() if name.startswith("drop")}
    return {
        "arm": flight.arm, "seed": flight.seed, "seconds": seconds, "events": heard.events,
        "rows_not_tested": int(heard.diagnostics["rows not tested"]), "dropped": dropped,
        "core": used / took,
    }  # fmt: skip


def main() -> int:
    """Print what was heard; status 1 if there was an event, or too much was not tested."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="(default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the arms (default: %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    found, left, number = list[dict[str, Any]](), 60.0 * arguments.minutes, 0
    while left > 0.0:
        arm = ARMS[number % len(ARMS)]
        flight = laboratory(arm, arguments.seed + number // len(ARMS)).fly("clean")
        with tempfile.TemporaryDirectory() as folder:
            found.append(listen(flight, min(left, BLOCK), Path(folder)))
        left, number = left - BLOCK, number + 1
        last = found[-1]
        said = [f"{each['kind']} {each.get('effect', '')}".strip() for each in last["events"]]
        words = ", ".join(said) or "nothing"
        print(f"{arm} {last['seconds'] / 60:.0f} min, {last['core']:.0%} of a core: {words}")
    hours = sum(each["seconds"] for each in found) / 3600.0
    alarms = sum(len(each["events"]) for each in found)
    rows = sum(each["rows_not_tested"] for each in found)
    dropped = Counter[str]()
    for each in found:
        dropped.update({name: int(count) for name, count in each["dropped"].items()})
    most = most_an_hour(alarms, hours)
    print(f"{alarms} events in {hours:.2f} h: at most {most:.1f} an hour at 95 %")
    print("; ".join(f"{name}: {count}" for name, count in dropped.items()) or "nothing dropped")
    made = Sampling().row_rate * 3600.0 * hours
    targets = [
        Target("events of clean motion", float(alarms), 0.0, ""),
        Target("rows not tested", rows / made, UNTESTED_TARGET, "of them"),
    ]
    met = judge(targets)
    if arguments.json is not None:
        content = {"flights": found, "targets": as_json(targets)}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
