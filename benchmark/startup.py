"""How long until the compensator commands, and until every verb has shown its help.

    PYTHONPATH=. python benchmark/startup.py [--repeats N] [--json FILE]

From the start of the process to the first command, the arm publishing at 200 Hz all the while.
Judged is the processor time of that, and of every help, by an import of numpy in turn with them:
the least of some. The time on the clock has 0.4 s in which the compensator listens for others that
command the arm and measures the effort that holds it; and DDS repeats what a busy machine lost of
its first greetings only 3 s later, which a bare relay's start shows, too.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
from round_trip import RoundTrip
from units import Target, as_json, import_numpy, judge, process_time, processor_time

from dvrk_gravity.command_line import VERBS
from dvrk_gravity.files import text_file
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, private_domain

HERE = Path(__file__).resolve().parent
RELAY = HERE / "relay.py"
MODEL = HERE.parent / "config" / "mtmr_28002.yaml"
# 1.5 s, 0.4 of them waits, and 0.3 s, where the import takes 0.1 s.
READY_TARGET, HELP_TARGET = 11.0, 3.0


def relay() -> NodeProcess:
    """Start a node that does nothing but answer: what ROS and DDS need for themselves."""
    return NodeProcess(None, program=(str(RELAY),))


def compensator() -> NodeProcess:
    """Start the compensator."""
    return NodeProcess("compensator", "--params-file", str(MODEL), "-p", "await_watchdog:=0.0")


def ready(start: Callable[[], NodeProcess]) -> tuple[float, float]:
    """Return the time from the start of a process to its first answer, and its processor's, s."""
    with private_domain(), Client() as client:
        trip = RoundTrip(client, PRIVATE)
        begin = time.monotonic()
        with start() as node:
            while not trip.answered and time.monotonic() - begin < 20.0:
                trip.send()
                client.spin(0.005)
            used = processor_time(node.process.pid)
        return min(trip.answered.values(), default=np.inf) - begin, used


def main() -> int:
    """Print the table; status 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    rows: dict[str, list[float]] = defaultdict(list)
    for _ in range(arguments.repeats):
        for name, start in (("relay", relay), ("compensator", compensator)):
            elapsed, used = ready(start)
            rows[f"{name} ready"].append(elapsed)
            rows[f"  {name}'s processor"].append(used)
        rows["import numpy"].append(import_numpy())
        for verb in VERBS:
            rows[f"{verb} --help"].append(process_time(("-m", "dvrk_gravity", verb, "--help")))
    print(f"{'s':<26}{'least':>8}{'median':>8}{'worst':>8}")
    for name, times in rows.items():
        print(f"{name:<26}{min(times):>8.2f}{np.median(times):>8.2f}{max(times):>8.2f}")
    least = {name: min(times) for name, times in rows.items()}
    slowest = max((f"{verb} --help" for verb in VERBS), key=lambda name: least[name])
    figures = (
        ("start to first command", "  compensator's processor", READY_TARGET,
         f"{least['compensator ready']:.2f} s on the clock"),
        (f"slowest help: {slowest}", slowest, HELP_TARGET, f"{least[slowest]:.2f} s"),
    )  # fmt: skip
    targets = [
        Target(name, least[row] / least["import numpy"], most, "imports of numpy", here)
        for name, row, most, here in figures
    ]
    met = judge(targets)
    if arguments.json is not None:
        content = {"seconds": rows, "targets": as_json(targets)}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
