"""Time of one torque from Python, and of one of many.

    PYTHONPATH=. python benchmark/torque.py [--json FILE]

One sample goes the way that the compensator takes: torque, limits in joint and actuator space, slew
limit, state machine (`Supervisor.command`); the rows show where its time goes. Samples lie on a
smooth motion, as an arm's do. Two models: the shipped one of a real arm (gravity, directional
cables), and one as `identify` writes it (gravity, elastic cables, Coulomb and viscous friction at
joints and motors). Times are in numpy additions of seven numbers, measured in turn (`units.py`).
"""

from __future__ import annotations

import argparse
import json
import sys
from array import array
from itertools import count
from pathlib import Path

import numpy as np
import pinocchio as pin
from units import Target, Way, as_json, in_additions, in_turn, judge, ratio, repeated

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
NUMBER, REPEATS = 20, 400  # calls a turn, turns
BATCH = 200_000  # samples
# 15 µs and 2 million samples a second on a machine that adds in 0.4 µs.
SAMPLE_TARGET, BATCH_TARGET = 37.0, 1.25


def motion(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 7) positions and velocities of a slow swing at 1 kHz."""
    phase = np.arange(samples)[:, None] * 1e-3 + np.arange(7)
    amplitude = np.array([0.1, 0.1, 0.1, 0.3, 0.3, 0.2, 0.5])
    middle = np.array([-0.2, 0.2, 0.0, 0.8, 0.8, 0.0, 0.0])
    return middle + amplitude * np.sin(phase), amplitude * np.cos(phase)


Figures = dict[str, tuple[float, float]]
"""By name: numpy additions, and seconds."""


def one_sample(values: dict[str, object]) -> Figures:
    """Return the times of one answer and of its parts."""
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
    coming, now = iter(samples), count(100.0, 1e-3)

    def command() -> None:
        sample = next(coming)
        supervisor.command(sample, next(now), sample.stamp)

    for _ in range(3000):
        command()
    torque = settings.torque(q[0], qd[0])
    largest = settings.slew_limit * 1e-3
    ways: dict[str, Way] = {
        "Supervisor.command": command,
        "torque and limits": lambda: settings.limits.clip(settings.torque(q[0], qd[0])),
    }
    for term in settings.model.terms:
        evaluate = term.prepare()
        ways[f"  {term.NAME}"] = lambda evaluate=evaluate: evaluate(q[0], qd[0])
    ways["  limits in both spaces"] = lambda: settings.limits.clip(torque)
    ways["slew"] = lambda: slew(torque, torque, largest, settings.limits)
    figures = measure(ways)
    assert supervisor.status is Status.COMMANDING
    return figures


def measure(ways: dict[str, Way]) -> Figures:
    """Return the times of a call of each."""
    calls = {name: repeated(way, NUMBER) for name, way in ways.items()}
    return in_additions(calls, NUMBER, REPEATS)


def rest() -> Figures:
    """Return the times of what is not the torque, and of what nothing here can shorten."""
    arm = MODEL.arm
    q = motion(1)[0][0]
    tree = beta_tree(arm, np.array(MODEL.parameters()["beta"]), arm.gravity)
    expanded = tree.expand @ q
    names, numbers = list(arm.joint_names), array("d", q)
    reader = SampleReader(arm, 0.0)
    return measure(
        {
            "reading and checking a message": lambda: reader.read(
                1, names, numbers, numbers, numbers
            ),
            "Pinocchio's gravity alone": lambda: pin.computeGeneralizedGravity(
                tree.model, tree.data, expanded
            ),
            "numpy: seven plus seven numbers": lambda: q + q,
        }
    )


def batch() -> tuple[Figures, float]:
    """Return the times of one of many torques, and of the call over a copy of its result."""
    q, qd = motion(BATCH)
    figures = in_additions({"full model": lambda: MODEL.torque(q, qd)}, BATCH, 15)
    times = in_turn({"copy": q.copy, "full model": lambda: MODEL.torque(q, qd)}, 15)
    return figures, ratio(times["full model"], times["copy"])


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
    many, copies = batch()
    tables = {f"one sample, {name} model": figures for name, figures in models.items()}
    for title, figures in (tables | {"beside it": rest(), f"one of {BATCH}": many}).items():
        print(f"{title:<36}{'additions':>10}{'µs':>8}")
        for name, (additions, seconds) in figures.items():
            print(f"  {name:<34}{additions:>10.1f}{seconds * 1e6:>8.2f}")
    print(f"all {BATCH} torques take as long as {copies:.0f} copies of them")
    additions, seconds = max(figures["torque and limits"] for figures in models.values())
    one_of_many, each = many["full model"]
    targets = [
        Target("torque and limits, slower model", additions, SAMPLE_TARGET, "additions",
               f"{seconds * 1e6:.1f} µs"),
        Target("one of many torques", one_of_many, BATCH_TARGET, "additions",
               f"{1e-6 / each:.1f} M/s"),
    ]  # fmt: skip
    met = judge(targets)
    if arguments.json is not None:
        content = {"tables": tables, "batch": many, "copies": copies, "targets": as_json(targets)}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
