"""Time of one torque from Python, and torques a second when asked for many at once.

    PYTHONPATH=. python benchmark/torque.py [--json FILE]

One sample goes the way that the compensator takes: torque, limits in joint and actuator space, slew
limit, state machine (`Supervisor.command`); the rows show where its time goes. Samples lie on a
smooth motion, as an arm's do. Two models: the shipped one of a real arm (gravity, directional
cables), and one as `identify` writes it (gravity, elastic cables, Coulomb and viscous friction at
joints and motors). Times are the best of many short runs, and numpy's addition of seven numbers
tells what the machine is like.
"""

from __future__ import annotations

import argparse
import json
import sys
import timeit
from array import array
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import beta_tree
from dvrk_gravity.compensate import Sample, SampleReader, Settings, Status, Supervisor, slew
from dvrk_gravity.files import text_file
from dvrk_gravity.model import TorqueModel

MODEL = TorqueModel.load(Path(__file__).resolve().parents[1] / "config" / "mtmr_28002.yaml")
IDENTIFIED = {
    "elastic_cable.wrist_pitch": [0.0, 0.01, 0.002],
    "coulomb_friction.joint_positive": [0.01] * 7,
    "coulomb_friction.motor_positive": [0.01] * 7,
    "viscous_friction.joint": [0.01] * 7,
    "viscous_friction.motor": [0.01] * 7,
}
REST = 500  # samples
SAMPLE_TARGET, BATCH_TARGET = 15e-6, 2e6


def motion(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 7) positions and velocities of a slow swing at 1 kHz."""
    phase = np.arange(samples)[:, None] * 1e-3 + np.arange(7)
    amplitude = np.array([0.1, 0.1, 0.1, 0.3, 0.3, 0.2, 0.5])
    middle = np.array([-0.2, 0.2, 0.0, 0.8, 0.8, 0.0, 0.0])
    return middle + amplitude * np.sin(phase), amplitude * np.cos(phase)


def best(call: Callable[[], object], number: int = 200, repeat: int = 150) -> float:
    """Return the least time of a call, s."""
    return min(timeit.repeat(call, number=number, repeat=repeat)) / number


def one_sample(values: dict[str, object]) -> dict[str, float]:
    """Return the times of one answer and of its parts, s."""
    settings = Settings.from_parameters(values | {"ramp_time": 0.0})
    supervisor = Supervisor(settings)
    q, qd = motion(70_000)
    # At rest at first: an arm that moves is not started.
    index = np.maximum(np.arange(len(q)) - REST, 0)
    moves = np.arange(len(q)) > REST
    samples = [
        Sample(1_000_000 * (k + 1), q[index[k]], qd[index[k]] * moves[k], None)
        for k in range(len(q))
    ]
    coming, unused = iter(samples), iter(samples)
    now, then = count(100.0, 1e-3), count(100.0, 1e-3)

    def spare() -> None:
        next(unused), next(then)

    def command() -> None:
        sample = next(coming)
        supervisor.command(sample, next(now), sample.stamp)

    for _ in range(3000):
        command()
    rows = {"Supervisor.command": best(command) - best(spare)}
    assert supervisor.status is Status.COMMANDING
    rows["  torque"] = best(lambda: settings.torque(q[0], qd[0]))
    for term in settings.model.terms:
        evaluate = term.prepare()
        rows[f"    {term.NAME}"] = best(lambda evaluate=evaluate: evaluate(q[0], qd[0]))
    torque = settings.torque(q[0], qd[0])
    largest = settings.slew_limit * 1e-3
    rows["  limits in both spaces"] = best(lambda: settings.limits.clip(torque))
    rows["  slew"] = best(lambda: slew(torque, torque, largest, settings.limits))
    return rows


def rest() -> dict[str, float]:
    """Return the times of what is not the torque, and of what nothing here can shorten, s."""
    arm = MODEL.arm
    q = motion(1)[0][0]
    tree = beta_tree(arm, np.array(MODEL.parameters()["beta"]), arm.gravity)
    expanded = tree.expand @ q
    names, numbers = list(arm.joint_names), array("d", q)
    reader = SampleReader(names, arm.lower, arm.upper)
    return {
        "reading and checking a message": best(
            lambda: reader.read(1, names, numbers, numbers, numbers)
        ),
        "Pinocchio's gravity alone": best(
            lambda: pin.computeGeneralizedGravity(tree.model, tree.data, expanded)
        ),
        "numpy: seven plus seven numbers": best(lambda: q + q),
    }


def batch(samples: int = 200_000) -> dict[str, float]:
    """Return torques a second of the full model and of its terms, and of writing the array."""
    q, qd = motion(samples)
    ways: dict[str, Callable[[], object]] = {
        "full model": lambda: MODEL.torque(q, qd),
        "only writing the result": lambda: np.full_like(q, 1.0),
    }
    times = dict.fromkeys(ways, np.inf)
    for _ in range(15):
        for name, way in ways.items():
            times[name] = min(times[name], timeit.timeit(way, number=1))
    return {name: samples / seconds for name, seconds in times.items()}


def main() -> int:
    """Print the tables; status 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    values = MODEL.parameters()
    of_gravity = {name: value for name, value in values.items() if "cable" not in name}
    models = {
        "shipped": one_sample(values),
        "identified": one_sample(of_gravity | IDENTIFIED),
    }
    other = rest()
    for title, rows in (
        *((f"one sample, {name} model", rows) for name, rows in models.items()),
        ("beside it", other),
    ):
        print(f"{title:<36}{'µs':>8}")
        for name, seconds in rows.items():
            print(f"  {name:<34}{seconds * 1e6:>8.2f}")
    rates = batch()
    print(f"{'many samples':<36}{'M/s':>8}")
    for name, rate in rates.items():
        print(f"  {name:<34}{rate * 1e-6:>8.2f}")
    slowest = max(rows["  torque"] + rows["  limits in both spaces"] for rows in models.values())
    reached = {
        "15 µs for torque and limits": slowest <= SAMPLE_TARGET,
        "2 M samples/s": rates["full model"] >= BATCH_TARGET,
    }
    for target, yes in reached.items():
        print(f"target {target}: {'reached' if yes else 'MISSED'}")
    if arguments.json is not None:
        content = {"one_sample_s": models, "rest_s": other, "batch_per_s": rates,
                   "reached": reached}  # fmt: skip
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if all(reached.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
