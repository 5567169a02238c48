"""Round trip measured_js -> servo_jf at 1 kHz: the compensator beside a bare relay.

    PYTHONPATH=. python benchmark/latency.py [--blocks N] [--seconds S] [--json FILE]

Both run as processes of their own, in a ROS domain of their own, from beginning to end; blocks of
messages go to the one and to the other in turn, so that whatever else the machine does meets both.
The ratios are the result, the median of those of the blocks; the times depend on the machine. Where
the relay cannot follow 1 kHz, on a slow or busy machine, the rate is halved until it can.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from round_trip import RoundTrip
from units import Target, as_json, judge, processor_time

from dvrk_gravity.files import text_file
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, private_domain

HERE = Path(__file__).resolve().parent
MODEL = HERE.parent / "config" / "mtmr_28002.yaml"
PERCENTILES = {"median": 50.0, "p90": 90.0, "p99": 99.0, "p99.9": 99.9}
TARGETS = {"median": 1.15, "p90": 1.15, "p99": 1.3, "processor": 1.15}  # times the relay's
LOST_TARGET = 0.005  # of the messages, more than the relay loses
WARM_UP = 0.5  # s: a start takes a tenth
RATE, SLOWEST, FOLLOWED = 1000.0, 125.0, 0.01  # Hz; lost by a relay that follows
Row = dict[str, float]


def measure(blocks: int, seconds: float) -> tuple[float, dict[str, list[Row]]]:
    """Return the rate, Hz, and for relay and compensator a row of figures a block."""
    namespaces = {name: f"{PRIVATE}/{name}" for name in ("relay", "compensator")}
    # Between two runs nothing is sent for 0.1 s: that is no silence to stop for.
    waits = ("-p", "resume:=automatic", "-p", "timeout:=0.3", "-p", "await_watchdog:=0.0")
    arguments = ("--params-file", str(MODEL), *waits)
    with (
        private_domain(),
        Client() as client,
        NodeProcess(None, namespace=namespaces["relay"],
                    program=(str(HERE / "relay.py"),)) as relay,
        NodeProcess("compensator", *arguments, namespace=namespaces["compensator"]) as ours,
    ):  # fmt: skip
        trips = {name: RoundTrip(client, namespace) for name, namespace in namespaces.items()}
        pids = {"relay": relay.process.pid, "compensator": ours.process.pid}
        for trip in trips.values():
            trip.connect()
            trip.run(1.5)  # past the ramp
            trip.take()
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


def _block(trip: RoundTrip, pid: int, seconds: float, rate: float) -> Row:
    """Return percentiles of the round trip and processor time a message, µs, and what is lost."""
    # The compensator's input stopped while the other had its turn: it starts anew.
    trip.run(WARM_UP, rate)
    trip.take()
    before = processor_time(pid)
    trip.run(seconds, rate)
    used = processor_time(pid) - before
    found, lost = trip.take()
    sent = len(found) + lost
    if not len(found):
        return dict.fromkeys((*PERCENTILES, "processor"), np.nan) | {"sent": sent, "lost": 1.0}
    row = {key: float(np.percentile(found, p)) * 1e6 for key, p in PERCENTILES.items()}
    return row | {"processor": used / len(found) * 1e6, "sent": sent, "lost": lost / sent}


def main() -> int:
    """Print the table; status 1 if a ratio misses its target."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--blocks", type=int, default=10, help="blocks for each of the two")
    parser.add_argument("--seconds", type=float, default=3.0, help="length of a block")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    rate, rows = measure(arguments.blocks, arguments.seconds)
    columns = (*PERCENTILES, "processor")
    median = {
        name: {key: float(np.nanmedian([row[key] for row in found])) for key in (*columns, "lost")}
        for name, found in rows.items()
    }
    pairs = list(zip(rows["compensator"], rows["relay"], strict=True))
    ratio = {key: float(np.nanmedian([a[key] / b[key] for a, b in pairs])) for key in columns}
    print(f"at {rate:g} Hz")
    print(f"{'µs':<14}" + "".join(f"{key:>10}" for key in columns) + f"{'lost':>9}")
    for name, row in median.items():
        figures = "".join(f"{row[key]:>10.0f}" for key in columns)
        print(f"{name:<14}{figures}{row['lost']:>9.2%}")
    print(f"{'ratio':<14}" + "".join(f"{value:>10.2f}" for value in ratio.values()))
    targets = [
        Target(f"round trip, {key}" if key in PERCENTILES else "processor time a message",
               ratio[key], most, "times the relay's", f"{median['compensator'][key]:.0f} µs")
        for key, most in TARGETS.items()
    ]  # fmt: skip
    more = float(np.median([a["lost"] - b["lost"] for a, b in pairs]))
    targets.append(Target("lost, beyond the relay's", more, LOST_TARGET, "of the messages"))
    met = judge(targets)
    if arguments.json is not None:
        content = {"rate_hz": rate, "blocks": rows, "ratio": ratio, "targets": as_json(targets)}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
