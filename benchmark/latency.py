"""Round trip measured_js -> servo_jf at 1 kHz: the compensator beside a bare relay.

    PYTHONPATH=. python benchmark/latency.py [--blocks N] [--seconds S] [--json FILE]

Both run as processes of their own, in a ROS domain of their own, from beginning to end; blocks of
messages go to the one and to the other in turn, so that whatever else the machine does meets both.
The ratios are the result; the times depend on the machine.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from round_trip import RoundTrip

from dvrk_gravity.files import text_file
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, private_domain

HERE = Path(__file__).resolve().parent
MODEL = HERE.parent / "config" / "mtmr_28002.yaml"
MEDIAN_TARGET, P99_TARGET = 1.15, 1.3
ANSWERED_TARGET = 0.005  # less of the messages than the relay answers, at most
WARM_UP = 0.5  # s: a start takes a tenth
PERCENTILES = {"median": 50.0, "p90": 90.0, "p99": 99.0, "p99.9": 99.9}


def measure(blocks: int, seconds: float) -> dict[str, dict[str, Any]]:
    """Return, for relay and compensator, percentiles of the round trip (µs) and losses."""
    namespaces = {name: f"{PRIVATE}/{name}" for name in ("relay", "compensator")}
    # Between two runs nothing is sent for 0.1 s: that is no silence to stop for.
    waits = ("-p", "resume:=automatic", "-p", "timeout:=0.3")
    arguments = ("--params-file", str(MODEL), *waits)
    with (
        private_domain(),
        Client() as client,
        NodeProcess(None, namespace=namespaces["relay"], program=(str(HERE / "relay.py"),)),
        NodeProcess("compensator", *arguments, namespace=namespaces["compensator"]),
    ):
        trips = {name: RoundTrip(client, namespace) for name, namespace in namespaces.items()}
        return _interleave(trips, blocks, seconds)


def _interleave(
    trips: dict[str, RoundTrip], blocks: int, seconds: float
) -> dict[str, dict[str, Any]]:
    times: dict[str, list[np.ndarray]] = {name: [] for name in trips}
    lost = dict.fromkeys(trips, 0)
    for trip in trips.values():
        trip.connect()
        trip.run(1.5)  # past the ramp
        trip.take()
    for block in range(blocks):
        order = list(trips) if block % 2 == 0 else list(reversed(trips))
        for name in order:
            # The compensator's input stopped while the other had its turn: it starts anew.
            trips[name].run(WARM_UP)
            trips[name].take()
            trips[name].run(seconds)
            found, missing = trips[name].take()
            times[name].append(found)
            lost[name] += missing
    rows = {}
    for name, found in times.items():
        every = np.concatenate(found) * 1e6
        rows[name] = {key: float(np.percentile(every, p)) for key, p in PERCENTILES.items()}
        rows[name] |= {"sent": len(every) + lost[name], "lost": lost[name]}
    return rows


def main() -> int:
    """Print the table; status 1 if a ratio misses its target."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--blocks", type=int, default=10, help="blocks for each of the two")
    parser.add_argument("--seconds", type=float, default=3.0, help="length of a block")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    rows = measure(arguments.blocks, arguments.seconds)
    ratio = {key: rows["compensator"][key] / rows["relay"][key] for key in PERCENTILES}
    print(f"{'µs':<14}" + "".join(f"{key:>10}" for key in PERCENTILES) + f"{'lost':>12}")
    for name, row in rows.items():
        figures = "".join(f"{row[key]:>10.0f}" for key in PERCENTILES)
        print(f"{name:<14}{figures}{row['lost']:>6} of {row['sent']}")
    print(f"{'ratio':<14}" + "".join(f"{value:>10.2f}" for value in ratio.values()))
    answered = {name: 1.0 - row["lost"] / row["sent"] for name, row in rows.items()}
    print("answered      " + ", ".join(f"{name} {part:.1%}" for name, part in answered.items()))
    reached = (
        ratio["median"] <= MEDIAN_TARGET
        and ratio["p99"] <= P99_TARGET
        and answered["compensator"] >= answered["relay"] - ANSWERED_TARGET
    )
    verdict = "reached" if reached else "MISSED"
    print(
        f"targets: median {MEDIAN_TARGET}, p99 {P99_TARGET}, answered the relay's less "
        f"{ANSWERED_TARGET:.1%}: {verdict}"
    )
    if arguments.json is not None:
        content = rows | {"ratio": ratio, "reached": reached}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
