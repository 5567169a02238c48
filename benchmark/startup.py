"""How long until the compensator commands, and until every verb has shown its help.

    PYTHONPATH=. python benchmark/startup.py [--repeats N] [--json FILE]

From the start of the process to the first command, the arm publishing at 200 Hz all the while;
0.3 s of it are spent listening for others that command the arm. A bare relay, started in turn with
it, tells what ROS takes for itself: DDS repeats what a busy machine lost of its first greetings
only 3 s later. Median and worst of some starts.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from round_trip import RoundTrip

from dvrk_gravity.command_line import VERBS
from dvrk_gravity.files import text_file
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, private_domain

HERE = Path(__file__).resolve().parent
RELAY = HERE / "relay.py"
MODEL = HERE.parent / "config" / "mtmr_28002.yaml"
READY_TARGET, HELP_TARGET = 1.5, 0.3


def relay() -> NodeProcess:
    """Start a node that does nothing but answer: what ROS and DDS need for themselves."""
    return NodeProcess(None, program=(str(RELAY),))


def compensator() -> NodeProcess:
    """Start the compensator."""
    return NodeProcess("compensator", "--params-file", str(MODEL))


def ready(start: Callable[[], NodeProcess]) -> float:
    """Return the time from the start of a process to its first answer, s."""
    with private_domain(), Client() as client:
        trip = RoundTrip(client, PRIVATE)
        begin = time.monotonic()
        with start():
            while not trip.answered and time.monotonic() - begin < 20.0:
                trip.send()
                client.spin(0.005)
        return min(trip.answered.values(), default=np.inf) - begin


def help_of(verb: str, repeats: int) -> list[float]:
    """Return the times of ``VERB --help``, s."""
    times = []
    for _ in range(repeats):
        begin = time.monotonic()
        subprocess.run(
            [sys.executable, "-m", "dvrk_gravity", verb, "--help"],
            stdout=subprocess.DEVNULL,
            check=True,
        )
        times.append(time.monotonic() - begin)
    return times


def main() -> int:
    """Print the table; status 1 if a median misses its target."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    rows = {}
    print(f"{'s':<24}{'median':>8}{'worst':>8}{'target':>8}")
    starts: list[list[float]] = [[], []]
    for _ in range(arguments.repeats):
        for times, start in zip(starts, (relay, compensator), strict=True):
            times.append(ready(start))
    measured = {"relay ready": (starts[0], np.inf), "compensator ready": (starts[1], READY_TARGET)}
    for verb in VERBS:
        measured[f"{verb} --help"] = (help_of(verb, arguments.repeats), HELP_TARGET)
    for name, (times, target) in measured.items():
        median = float(np.median(times))
        rows[name] = {"median": median, "worst": max(times)}
        if np.isfinite(target):
            rows[name]["target"] = target
        verdict = "" if median <= target else "  MISSED"
        print(f"{name:<24}{median:>8.2f}{max(times):>8.2f}{target:>8.2f}{verdict}")
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(rows, indent=1) + "\n")
    return 0 if all(row["median"] <= row.get("target", np.inf) for row in rows.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
