"""How fast the arm is held, fault by fault, with the default time-outs (0.1 s).

    PYTHONPATH=. python benchmark/faults.py [--repeats N] [--json FILE]

Compensator and watchdog run as processes of their own; this process is the arm. Measured is the
time from the fault to the arrival of the `hold`, the arm publishing at 200 Hz. A time-out is looked
after four times within itself, so that what is due after 0.1 s comes within 0.125 s. These bounds
are of real time, not ratios to the machine's speed: a computer that misses them is too slow, or too
busy, for an arm.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "live"))

from arm_side import FakeArm
from sensor_msgs.msg import JointState
from support import MODEL_FILE

from dvrk_gravity.files import text_file
from dvrk_gravity.ros import NodeProcess, ProcessError, private_domain

Fault = Callable[[FakeArm, NodeProcess], None]
TIMEOUT = 0.1


def silent(arm: FakeArm, node: NodeProcess) -> None:
    """Publish nothing more."""
    arm.client.wait(lambda: bool(arm.holds), "the hold", 5.0)


def publishing(**fields: object) -> Fault:
    """Return a fault that consists in what the arm publishes."""
    return lambda arm, _: arm.run_until(lambda: bool(arm.holds), "the hold", 5.0, **fields)


def signalled(number: signal.Signals) -> Fault:
    """Return a fault that consists in a signal to the compensator."""

    def fault(arm: FakeArm, node: NodeProcess) -> None:
        node.signal(number)
        arm.run_until(lambda: bool(arm.holds), "the hold", 5.0)

    return fault


def builtin(arm: FakeArm, node: NodeProcess) -> None:
    """Switch the arm's own compensation on."""
    arm.builtin.publish(arm.message(effort=[0.1] * 7))
    arm.run_until(lambda: bool(arm.holds), "the hold", 5.0)


def rival(arm: FakeArm, node: NodeProcess) -> None:
    """Command the arm from somewhere else, whose publisher has been there all along."""
    arm.rival.publish(JointState(effort=[0.0] * 7))
    arm.run_until(lambda: bool(arm.holds), "the hold", 5.0)


# What happens, what holds, and until when, s; what is not a time-out is due in the next message.
FAULTS: dict[str, tuple[Fault, str, float]] = {
    "input stops": (silent, "compensator", 1.25 * TIMEOUT),
    "input is NaN": (publishing(position=[np.nan] * 7), "compensator", 1.25 * TIMEOUT),
    "stamp stands still": (publishing(stamp=1_000_000_001), "compensator", 1.25 * TIMEOUT),
    "out of range": (publishing(position=[9.0] * 7), "compensator", 1.25 * TIMEOUT),
    "built-in switched on": (builtin, "compensator", 0.05),
    "another node commands": (rival, "compensator", 0.05),
    "SIGINT": (signalled(signal.SIGINT), "compensator", 0.05),
    "SIGTERM": (signalled(signal.SIGTERM), "compensator", 0.05),
    "SIGKILL": (signalled(signal.SIGKILL), "watchdog", 1.25 * TIMEOUT),
    "SIGSTOP": (signalled(signal.SIGSTOP), "watchdog", 1.25 * TIMEOUT),
}


def once(fault: Fault) -> float:
    """Return the time from a fault to the hold, s."""
    with private_domain(), FakeArm() as arm:
        arm.rival = arm.client.node.create_publisher(JointState, "servo_jf", 10)
        with (
            NodeProcess("watchdog"),
            NodeProcess("compensator", "--params-file", str(MODEL_FILE), "-p", "input_depth:=10")
            as node,
        ):  # fmt: skip
            arm.await_compensator()
            arm.run_until(
                lambda: (
                    arm.client.state("watchdog") == "the arm is commanded"
                    and len(arm.commands) > 20
                ),
                "commands",
            )
            arm.run(0.2)
            if arm.holds:
                raise ProcessError("a hold before the fault: the machine is too busy")
            begin = time.monotonic()
            fault(arm, node)
            return arm.holds[0] - begin


def main() -> int:
    """Print the table; status 1 if a median comes later than is due."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    rows = {}
    print(f"{'hold after, ms':<24}{'median':>8}{'worst':>8}{'due':>8}  sent by (real time)")
    for name, (fault, sender, due) in FAULTS.items():
        times, attempts = [], 0
        while len(times) < arguments.repeats and attempts < 3 * arguments.repeats:
            attempts += 1
            try:
                times.append(once(fault))
            except (ProcessError, AssertionError) as error:  # the machine stalled before the fault
                print(f"{name}: {error}; tried again", file=sys.stderr)
        median = float(np.median(times)) if times else np.inf
        worst = max(times, default=np.inf)
        rows[name] = {"median": median, "worst": worst, "due": due, "by": sender}
        late = "" if median <= due + 0.01 else "  LATE"
        figures = "".join(f"{1e3 * value:>8.0f}" for value in (median, worst, due))
        print(f"{name:<24}{figures}  {sender}{late}", flush=True)
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(rows, indent=1) + "\n")
    return 0 if all(row["median"] <= row["due"] + 0.01 for row in rows.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
