"""Time and memory of an identification against the length of the recording.

    PYTHONPATH=. python benchmark/identify.py [--minutes 10 60] [--json FILE]

It writes synthetic recordings of 4 and 10 minutes at 1 kHz as CSV, identifies each in a
process of its own, and prints time and peak memory against length, and the shares of the parts.
Ten minutes are identified once more with a zero off: the kinematics is then searched for too.
Processor time is judged a sample, in numpy additions that are timed meanwhile (`units.py`); memory
in GiB, since bytes are the same on every machine.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from units import ADDITIONS, Target, add, as_json, in_turn, judge

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import State, base_directions
from dvrk_gravity.estimation import NormalEquations
from dvrk_gravity.files import text_file
from dvrk_gravity.identification import identify
from dvrk_gravity.model import Columns, TorqueModel
from dvrk_gravity.observation import build_design, observe
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording, load_excerpt, save_recording
from testing.world import World

TEN = 10.0  # minutes at 1 kHz that the target is about
# Additions a sample: 60 s for 10 minutes where an addition takes 0.4 µs; GiB.
TIME_TARGET, MEMORY_TARGET = 250.0, 1.5
LINEAR = 1.3  # growth of the time a sample that is still a machine's whim
LOOK = 0.2  # s between two looks at the unit
JOINT, ZERO = 3, 0.1  # a zero that is off, rad
SHARED = 10.0  # minutes up to which the parts are timed too


def along(motion: Multisine, time_: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (N, 7) positions, velocities and accelerations of a sum of sines."""
    rate = 2.0 * np.pi * motion.frequency
    angle = time_[:, None, None] * rate + motion.phase
    q = motion.middle + (motion.amplitude * np.sin(angle)).sum(axis=1)
    qd = (motion.amplitude * rate * np.cos(angle)).sum(axis=1)
    qdd = -(motion.amplitude * rate**2 * np.sin(angle)).sum(axis=1)
    return q, qd, qdd


def write(path: Path, minutes: float, rate: float, zero: float = 0.0) -> None:
    """Write a synthetic recording of some minutes, minute by minute, one zero off by some rad."""
    arm, motion, model = drawn()
    noise = np.random.default_rng(0)

    def parts() -> Iterator[Recording]:
        samples = round(60 * minutes * rate)
        for numbers in np.array_split(np.arange(samples), 1 + samples // 20_000):
            time_ = numbers / rate
            q, qd, qdd = along(motion, time_)
            torque = model.torque(q, qd, qdd)
            torque += noise.normal(size=torque.shape) * 0.05 * torque.std(axis=0)
            q[:, JOINT] += zero
            yield Recording(arm.joint_names, time_, q, qd, torque)

    save_recording(parts(), path, "sqlite3", "/measured_js")


def measured(path: Path, samples: float, zero: float = 0.0) -> dict[str, float]:
    """Return time, peak memory and additions a sample of a process that identifies a recording."""
    start = time.perf_counter()
    command = [sys.executable, __file__, "--child", str(path), "--zero", str(zero)]
    process = subprocess.Popen(command)
    units = []
    while not (ended := os.wait4(process.pid, os.WNOHANG))[0]:
        units.append(in_turn({"": add}, 1)[""][0] / ADDITIONS)
        time.sleep(LOOK)
    _, status, usage = ended
    if status:
        raise SystemExit(f"identification of {path} failed")
    seconds, cpu = time.perf_counter() - start, usage.ru_utime + usage.ru_stime
    addition = float(np.median(units))
    return {
        "seconds": seconds, "cpu_s": cpu, "gib": usage.ru_maxrss / 2**20,
        "addition_us": addition * 1e6, "additions": cpu / samples / addition,
    }  # fmt: skip


def shares(path: Path) -> dict[str, float]:
    """Return the times of the parts of an identification, s."""
    arm = drawn()[0]
    times = {}
    start = time.perf_counter()
    (observed,) = observe([load_excerpt(path)], arm)
    times["reading, checks, filters"] = time.perf_counter() - start
    motions, q = list(observed.split()), observed.q
    start = time.perf_counter()
    base_directions.__wrapped__(arm)
    times["base parameters: QR"] = time.perf_counter() - start
    columns = Columns(arm, q.min(axis=0), q.max(axis=0))
    start = time.perf_counter()
    for motion in motions:
        history = columns.history(motion.state)
        for first in range(0, len(motion), 2000):
            rows = slice(first, first + 2000)
            state = State(*(getattr(motion.state, name)[rows] for name in ("q", "qd", "qdd")))
            columns.regressor(state, history[rows])
    times["regressor, bare"] = time.perf_counter() - start
    start = time.perf_counter()
    design = build_design(columns, motions)
    times["regressor, filtered"] = time.perf_counter() - start
    start = time.perf_counter()
    NormalEquations.of(design.x, design.y)
    times["Gram matrices, once"] = time.perf_counter() - start
    return times


def drawn() -> tuple[Arm, Multisine, TorqueModel]:
    """Return a drawn arm, a motion and the truth."""
    world = World.draw(1)
    return world.arm, Multisine.draw(world.arm, 1), world.model()


def speed(lengths: Sequence[float], rate: float, report: Path | None) -> bool:
    """Print time and memory against length, and shares; return whether the targets are met."""
    runs: dict[float, dict[str, float]] = {}
    zero_off: dict[str, float] | None = None
    with TemporaryDirectory() as folder:
        for minutes in sorted(lengths):
            path = Path(folder) / f"{minutes:g}_min.csv"
            write(path, minutes, rate)
            figures = runs[minutes] = measured(path, 60.0 * minutes * rate)
            print(f"{minutes:g} min at {rate:g} Hz: {told(figures)}, {figures['gib']:.2f} GiB")
            if minutes < max(lengths):
                path.unlink()
            if minutes == TEN:
                off = Path(folder) / "zero_off.csv"
                write(off, minutes, rate, ZERO)
                zero_off = measured(off, 60.0 * minutes * rate, ZERO)
                off.unlink()
                print(
                    f"the same with a zero off by {ZERO:g} rad: {told(zero_off)}, "
                    f"{zero_off['gib']:.2f} GiB"
                )
        parts = shares(path) if minutes <= SHARED else {}
    for name, seconds in parts.items():
        share = seconds / runs[minutes]["seconds"]
        print(f"  {name:<26}{seconds:6.1f} s {100 * share:4.0f} %")
    first, last = min(runs), max(runs)
    slope = (runs[last]["gib"] - runs[first]["gib"]) / (last - first) if last > first else 0.0
    hour = runs[last]["gib"] + max(slope, 0.0) * max(60.0 - last, 0.0)
    print(f"an hour takes {hour:.2f} GiB" + ("" if last >= 60.0 else ", if memory goes on so"))
    targets = [Target("memory of an hour", hour, MEMORY_TARGET, "GiB")]
    for name, one_run in (("ten minutes", runs.get(TEN)), ("a zero off", zero_off)):
        if one_run is not None and rate == 1000.0:
            targets += [
                Target(f"a sample of {name}", one_run["additions"], TIME_TARGET, "additions",
                       told(one_run)),
                Target(f"memory, {name}", one_run["gib"], MEMORY_TARGET, "GiB"),
            ]  # fmt: skip
    if last > first:
        growth = runs[last]["additions"] / runs[first]["additions"]
        compared = f"times a sample of {first:g} min"
        targets.append(Target(f"a sample of {last:g} min", growth, LINEAR, compared))
    met = judge(targets)
    if report is not None:
        content = {
            "minutes": runs, "zero_off": zero_off, "shares_s": parts, "hour_gib": hour,
            "targets": as_json(targets),
        }  # fmt: skip
        text_file.write(report, json.dumps(content, indent=1) + "\n")
    return met


def told(run: dict[str, float]) -> str:
    """Return the times of a run, in words."""
    return f"{run['seconds']:.1f} s ({run['cpu_s']:.1f} s of a core)"


def main() -> int:
    """Run what was asked for; status 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, nargs="+", default=[4.0, 10.0])
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--zero", type=float, default=0.0, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child is not None:
        fit = identify(arguments.child, drawn()[0])
        # A model that does not fit would be no use, however quickly found.
        poor = max(error.nrmse for error in fit.training.values()) > 0.2
        return int(poor or abs(fit.model.joint_offset[JOINT] - arguments.zero) > 1e-2)
    return 0 if speed(arguments.minutes, arguments.rate, arguments.json) else 1


if __name__ == "__main__":
    sys.exit(main())
