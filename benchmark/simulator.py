"""How many times faster than real time the simulated arm runs, on one core, at 1 kHz.

It is one thread, whose processor time is counted: what else the machine does is no part of it.

Every situation runs with all terms of the plant (gravity, directional cables, Coulomb friction
at joints and motors, viscous friction), sensors read at every step, and the recording kept.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from dvrk_gravity.files import text_file
from dvrk_gravity.simulate import Measurement, PlantFile, SimulatedArm, simulate

POSE = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])
TARGET = 20.0  # times real time

Drive = Callable[[SimulatedArm, Measurement], None]


def hold(arm: SimulatedArm, measured: Measurement) -> None:
    """Leave the arm in hold, where it started."""


def fall(arm: SimulatedArm, measured: Measurement) -> None:
    """Let go once; start again from above when everything has come to rest."""
    if measured.time < 2 * arm.dt or not np.count_nonzero(arm.plant.v):
        arm.plant.reset(POSE)
        arm.use_gravity_compensation(False)
        arm.free()


def swing(arm: SimulatedArm, measured: Measurement) -> None:
    """Move all joints all the time."""
    t = measured.time
    arm.servo_jp(POSE + 0.2 * np.sin(5 * t))


def effort(arm: SimulatedArm, measured: Measurement) -> None:
    """Command a new effort at every step, as a compensator does, and push now and then."""
    arm.servo_jf(np.zeros(7))
    if round(measured.time / arm.dt) % 500 == 0:
        sign = 1 if measured.time % 1.0 < 0.5 else -1
        arm.push(0.2 * sign * np.array([1, 1, 1, 0.2, 0.05, 0.05, 0.01]), 0.1)


SITUATIONS: dict[str, Drive] = {"hold": hold, "fall": fall, "swing": swing, "effort": effort}


def measure(drive: Drive, duration: float, repeats: int) -> float:
    """Return the best time per step of some runs, s."""
    truth = PlantFile.load("mtmr_28002")
    best = np.inf
    for seed in range(repeats):
        plant = truth.plant()
        plant.reset(POSE)
        arm = SimulatedArm(plant, truth.sensors, seed)
        begin = time.process_time()
        simulate(arm, drive, duration)
        best = min(best, (time.process_time() - begin) / (duration / arm.dt))
    return best


def yardstick() -> float:
    """Return the time of one numpy addition of seven numbers, s: what this machine is like."""
    a, best = np.ones(7), np.inf
    for _ in range(20):
        begin = time.process_time()
        for _ in range(1000):
            a + a
        best = min(best, (time.process_time() - begin) / 1000)
    return best


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; status 1 if a situation misses the target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=3.0, help="simulated s a run")
    parser.add_argument("--repeats", type=int, default=5, help="runs, of which the best counts")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    args = parser.parse_args(argv)
    unit = yardstick()
    rows = {}
    print(f"numpy addition of 7 numbers: {unit * 1e6:.2f} µs")
    print(f"{'situation':<10}{'µs/step':>10}{'additions':>11}{'x real time':>13}")
    for name, drive in SITUATIONS.items():
        step = measure(drive, args.duration, args.repeats)
        factor = 1e-3 / step
        rows[name] = {"step_us": step * 1e6, "additions": step / unit, "real_time_factor": factor}
        print(f"{name:<10}{step * 1e6:>10.1f}{step / unit:>11.0f}{factor:>13.1f}", flush=True)
    reached = all(row["real_time_factor"] >= TARGET for row in rows.values())
    print(f"target {TARGET:g} times real time: {'reached' if reached else 'MISSED'}")
    if args.json is not None:
        content = {"addition_us": unit * 1e6, "target": TARGET, "situations": rows}
        text_file.write(args.json, json.dumps(content, indent=1) + "\n")
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
