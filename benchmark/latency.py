"""Round trip measured_js -> servo_jf at 1 kHz: the compensator beside a bare relay, and a monitor.

    PYTHONPATH=. python benchmark/latency.py [--blocks N] [--seconds S] [--json FILE]

A second compensator has a monitor that listens to the same messages, of an arm as its model says;
the model is identify_demo_model first, which takes half a minute.

All run as processes of their own, in a ROS domain of their own, from beginning to end; blocks of
messages go to one after the other in turn, so that whatever else the machine does meets both.
The ratios are the result, the median of those of the blocks; the times depend on the machine. Where
the relay cannot follow 1 kHz, on a slow or busy machine, the rate is halved until it can.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from round_trip import RoundTrip
from units import Target, as_json, judge, processor_time

from dvrk_gravity.files import text_file
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, identify_demo_model, private_domain

HERE = Path(__file__).resolve().parent
MODEL = HERE.parent / "config" / "mtmr_28002.yaml"
PERCENTILES = {"median": 50.0, "p90": 90.0, "p99": 99.0, "p99.9": 99.9}
TARGETS = {"median": 1.15, "p90": 1.15, "p99": 1.3, "processor": 1.15}  # times the relay's
WATCHED = {"median": 1.15, "p90": 1.15, "p99": 1.3}  # times those without a monitor
OF_MONITOR = ("monitor", "core")
MONITOR_TARGET = 1.0  # times the relay's processor time
LOST_TARGET = 0.005  # of the messages, more than the relay loses
WARM_UP = 0.5  # s: a start takes a tenth
LEARNED = 12.0  # s, after which a monitor tests
RATE, SLOWEST, FOLLOWED = 1000.0, 125.0, 0.01  # Hz; lost by a relay that follows
Row = dict[str, float]


def measure(blocks: int, seconds: float, folder: Path) -> tuple[float, dict[str, list[Row]]]:
    """Return the rate, Hz, and a row of figures a block for each of relay, compensator, watched.

    Args:
        blocks: For each of them.
        seconds: Length of a block.
        folder: For the monitor's model.
    """
    namespaces = {name: f"{PRIVATE}/{name}" for name in ("relay", "compensator", "watched")}
    # Between two runs nothing is sent for 0.1 s: that is no silence to stop for.
    waits = ("-p", "resume:=automatic", "-p", "timeout:=0.3", "-p", "await_watchdog:=0.0")
    arguments = ("--params-file", str(MODEL), *waits)
    known = identify_demo_model("mtmr", "", 1.0, folder / "model.yaml")
    with ExitStack() as stack:
        stack.enter_context(private_domain())
        client = stack.enter_context(Client())
        nodes = {
            name: stack.enter_context(
                NodeProcess(None, namespace=namespace, program=(str(HERE / "relay.py"),))
                if name == "relay" else NodeProcess("compensator", *arguments, namespace=namespace)
            )
            for name, namespace in namespaces.items()
        }  # fmt: skip
        monitor = stack.enter_context(
            NodeProcess("monitor", "--params-file", str(known), namespace=namespaces["watched"])
        )
        pids = {name: (node.process.pid,) for name, node in nodes.items()}
        pids["watched"] += (monitor.process.pid,)
        model = TorqueModel.load(known)
        trips = {
            name: RoundTrip(client, namespace, model) for name, namespace in namespaces.items()
        }
        for trip in trips.values():
            trip.connect()
            trip.run(1.5)  # past the ramp
            trip.take()
        trips["watched"].run(LEARNED)
        rate = RATE
        while (
            rate > SLOWEST and _block(trips["relay"], pids["relay"], 1.0, rate)["lost"] > FOLLOWED
        ):
            rate /= 2.0
        rows: dict[str, list[Row]] = {name: [] for name in trips}
        for block in range(blocks):
            for name in list(trips) if block % 2 == 0 else list(reversed(trips)):
                rows[name].append(_block(trips[name], pids[name], seconds, rate))
    return rate, rows


def _block(trip: RoundTrip, pids: Sequence[int], seconds: float, rate: float) -> Row:
    """Return percentiles of the round trip and processor time a message, µs, and what is lost.

    Of a second process, the monitor, its processor time a message, µs, and the part of a core.
    """
    # The compensator's input stopped while the other had its turn: it starts anew.
    trip.run(WARM_UP, rate)
    trip.take()
    before = [processor_time(pid) for pid in pids]
    trip.run(seconds, rate)
    used = [processor_time(pid) - was for pid, was in zip(pids, before, strict=True)]
    found, lost = trip.take()
    sent = len(found) + lost
    if not len(found):
        nothing = dict.fromkeys((*PERCENTILES, "processor", *OF_MONITOR), np.nan)
        return nothing | {"sent": sent, "lost": 1.0}
    row = {key: float(np.percentile(found, p)) * 1e6 for key, p in PERCENTILES.items()}
    row |= {"processor": used[0] / len(found) * 1e6, "sent": sent, "lost": lost / sent}
    if len(used) > 1:
        row |= {"monitor": used[1] / sent * 1e6, "core": used[1] / seconds}
    return row


def main() -> int:
    """Print the table; status 1 if a ratio misses its target."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--blocks", type=int, default=10, help="blocks for each of the three")
    parser.add_argument("--seconds", type=float, default=3.0, help="length of a block")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rate, rows = measure(arguments.blocks, arguments.seconds, Path(folder))
    columns = (*PERCENTILES, "processor")
    median = {
        name: {key: float(np.nanmedian([row[key] for row in found])) for key in (*columns, "lost")}
        for name, found in rows.items()
    }
    ratio, beside = (
        {
            key: float(
                np.nanmedian([a[key] / b[key] for a, b in zip(rows[x], rows[y], strict=True)])
            )
            for key in columns
        }
        for x, y in (("compensator", "relay"), ("watched", "compensator"))
    )
    print(f"at {rate:g} Hz")
    print(f"{'µs':<14}" + "".join(f"{key:>10}" for key in columns) + f"{'lost':>9}")
    for name, row in median.items():
        figures = "".join(f"{row[key]:>10.0f}" for key in columns)
        print(f"{name:<14}{figures}{row['lost']:>9.2%}")
    for name, each in (("ratio", ratio), ("with monitor", beside)):
        print(f"{name:<14}" + "".join(f"{value:>10.2f}" for value in each.values()))
    targets = [
        Target(f"round trip, {key}" if key in PERCENTILES else "processor time a message",
               ratio[key], most, "times the relay's", f"{median['compensator'][key]:.0f} µs")
        for key, most in TARGETS.items()
    ]  # fmt: skip
    pairs = zip(rows["compensator"], rows["relay"], strict=True)
    more = float(np.median([a["lost"] - b["lost"] for a, b in pairs]))
    targets.append(Target("lost, beyond the relay's", more, LOST_TARGET, "of the messages"))
    targets += [
        Target(f"round trip beside a monitor, {key}", beside[key], most, "times that without",
               f"{median['watched'][key]:.0f} µs")
        for key, most in WATCHED.items()
    ]  # fmt: skip
    # Its tests come every two seconds: the mean, not the median.
    monitor, core = (float(np.mean([row[key] for row in rows["watched"]])) for key in OF_MONITOR)
    cost = monitor / float(np.mean([row["processor"] for row in rows["relay"]]))
    words = f"{monitor:.0f} µs; {core:.0%} of a core"
    targets.append(
        Target(
            "monitor's processor time a message", cost, MONITOR_TARGET, "times the relay's", words
        )
    )
    met = judge(targets)
    if arguments.json is not None:
        content = {
            "rate_hz": rate, "blocks": rows, "ratio": ratio, "beside_monitor": beside,
            "targets": as_json(targets),
        }  # fmt: skip
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
