"""What a step of the simulated arm takes, in numpy additions of seven numbers, at 1 kHz.

Steps and additions take turns (`units.py`). It is one thread, whose processor time is counted.

Every situation runs with all terms of the plant (gravity, directional cables, Coulomb friction
at joints and motors, viscous friction), sensors read at every step, and the recording kept.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from units import Target, as_json, in_additions, judge

from dvrk_gravity.files import text_file
from dvrk_gravity.simulate import Measurement, PlantFile, SimulatedArm, simulate

POSE = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])
STEPS = 100  # a turn
TARGET = 85.0  # additions a step: 20 times real time where an addition takes 0.6 µs

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


def measure(turns: int) -> dict[str, tuple[float, float]]:
    """Return what a step takes in each situation: numpy additions, and seconds."""
    truth = PlantFile.load("mtmr_28002")

    def situation(drive: Drive) -> Callable[[], object]:
        plant = truth.plant()
        plant.reset(POSE)
        arm = SimulatedArm(plant, truth.sensors)
        return lambda: simulate(arm, drive, STEPS * arm.dt)

    ways = {name: situation(drive) for name, drive in SITUATIONS.items()}
    return in_additions(ways, STEPS, turns)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; status 1 if a situation misses the target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=80, help=f"of {STEPS} steps each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    args = parser.parse_args(argv)
    targets = [
        Target(f"a step: {name}", additions, TARGET, "additions",
               f"{step * 1e6:.0f} µs, {1e-3 / step:.1f} times real time")
        for name, (additions, step) in measure(args.turns).items()
    ]  # fmt: skip
    met = judge(targets)
    if args.json is not None:
        text_file.write(args.json, json.dumps(as_json(targets), indent=1) + "\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
