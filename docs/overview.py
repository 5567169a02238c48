"""Draw docs/overview.png: what the package does to a simulated arm, in one picture.

``python docs/overview.py [--out FILE]``; the recordings are those of ``examples/``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dvrk_gravity import TorqueModel, diagnose, identify
from dvrk_gravity.diagnosis import Diagnosis
from dvrk_gravity.identification import Fit
from dvrk_gravity.report import size_of
from dvrk_gravity.simulate import PlantFile, SimulatedArm, simulate

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent / "examples"))

from simulated_lab import ARM, record  # noqa: E402  # beside the package, not in it

JOINT = "elbow_pitch"
SHOWN = slice(0, 900)
LET_GO = 2.0  # s
BLUE, RED, GREY = "#224488", "#bb3322", "#8a96a6"


def draw(path: Path) -> None:
    """Identify, compensate and diagnose a simulated arm, and draw all three."""
    fit = identify(record(seed=1), ARM)
    worn = record(seed=3, viscous_friction__joint=[0.02, 0.02, 0.1, 0.003, 0.0005, 0.0005, 0.0001])
    figure = Figure(figsize=(12.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 3)
    _identified(axes[0], fit)
    _compensated(axes[1], fit.model)
    _diagnosed(axes[2], diagnose(worn, fit.model))
    for ax in axes:
        ax.grid(alpha=0.25)
    figure.savefig(path, dpi=110)


def _identified(ax: Axes, fit: Fit) -> None:
    (trace,) = fit.traces
    assert trace.time is not None
    k = trace.joints.index(JOINT)
    time, measured, predicted = (
        array[SHOWN] for array in (trace.time, trace.measured[:, k], trace.predicted[:, k])
    )
    ax.plot(time, 1e3 * measured, color=GREY, linewidth=2.5, label="measured")
    ax.plot(time, 1e3 * predicted, color=RED, linewidth=1.0, label="predicted")
    error = fit.held_out[JOINT]
    ax.set_title(f"identify: {JOINT}'s torque,\nto {100 * error.nrmse:.0f} % where it was not seen")
    ax.set(xlabel="time [s]", ylabel="torque [mN·m]")
    ax.legend(frameon=False, fontsize=8)


def _compensated(ax: Axes, model: TorqueModel) -> None:
    pose = 0.5 * (ARM.lower + ARM.upper)
    for name, color, torque in (
        ("without", RED, lambda q: np.zeros(ARM.n)),
        ("with the model", BLUE, model.torque),
    ):
        arm = SimulatedArm(PlantFile.of(ARM).plant(), builtin_compensation=False)
        arm.plant.reset(pose)
        moved = simulate(arm, lambda each, m, of=torque: each.servo_jf(of(m.position)), LET_GO)
        assert moved.time is not None
        way = np.degrees(np.abs(moved.position - pose)).max(axis=1)
        ax.plot(moved.time, way, color=color, linewidth=1.8, label=name)
    ax.set_title("compensate:\nlet go of the arm")
    ax.set(xlabel="time [s]", ylabel="farthest joint's way [deg]")
    ax.legend(frameon=False, fontsize=8)


def _diagnosed(ax: Axes, found: Diagnosis) -> None:
    first = found.findings[0]
    picture = first.picture
    assert picture is not None
    for error, color, name in ((picture.before, RED, "before"), (picture.after, BLUE, "after")):
        ax.plot(picture.x, 1e3 * error, ".", markersize=2.0, color=color, label=name)
    size = size_of(first).removeprefix("coefficient ")
    ax.set_title(f"diagnose, after a change: viscous friction,\n{size}")
    ax.set(xlabel=picture.variable, ylabel=f"{picture.joint}'s error [mN·m]")
    ax.legend(frameon=False, fontsize=8, markerscale=4)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=DOCS / "overview.png", help="picture to write")
    draw(parser.parse_args().out)
