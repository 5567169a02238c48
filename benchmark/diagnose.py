"""Time and memory of a diagnosis against the length of the recording.

    PYTHONPATH=. python benchmark/diagnose.py [--minutes 10 60] [--json FILE]

It writes synthetic recordings at 1 kHz as CSV, of an arm with Coulomb friction that the model
lacks at one joint. The command diagnoses each in a process of its own, and has to find that
friction. Time and peak memory are printed against length.
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
from identify import along, drawn

from dvrk_gravity.files import text_file
from dvrk_gravity.recording import Recording, save_recording

MEMORY_TARGET = 2.0  # GiB, whatever the length
JOINT, FRICTION = 2, 0.05  # what is hidden: N·m at the elbow


def write(path: Path, minutes: float, rate: float) -> None:
    """Write a synthetic recording of some minutes with friction that the model lacks."""
    arm, motion, model = drawn()
    noise = np.random.default_rng(0)

    def parts() -> Iterator[Recording]:
        samples = round(60 * minutes * rate)
        for numbers in np.array_split(np.arange(samples), 1 + samples // 20_000):
            time_ = numbers / rate
            q, qd, qdd = along(motion, time_)
            torque = model.torque(q, qd, qdd)
            torque += noise.normal(size=torque.shape) * 0.05 * torque.std(axis=0)
            torque[:, JOINT] += FRICTION * np.sign(qd[:, JOINT])
            yield Recording(arm.joint_names, time_, q, qd, torque)

    save_recording(parts(), path, "sqlite3", "/measured_js")


def measured(recording: Path, folder: Path) -> dict[str, float]:
    """Return time and peak memory of the command; raise unless it finds what is hidden."""
    arm, _, model = drawn()
    model.save(folder / "model.yaml", "The truth without the friction that is hidden")
    command = [sys.executable, "-m", "dvrk_gravity", "diagnose", str(recording)]
    command += ["--model", str(folder / "model.yaml"), "--out", str(folder / "out")]
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    seconds, cpu = time.perf_counter() - start, usage.ru_utime + usage.ru_stime
    if status:
        raise SystemExit(f"diagnosis of {recording} failed")
    findings = json.loads((folder / "out" / "findings.json").read_text())["findings"]
    named = [(finding["effect"], finding["joints"]) for finding in findings]
    if named != [("coulomb_friction", [arm.joint_names[JOINT]])]:
        raise SystemExit(f"{recording}: found {named}")
    return {"seconds": seconds, "cpu_s": cpu, "gib": usage.ru_maxrss / 2**20}


def run(lengths: Sequence[float], rate: float, report: Path | None) -> bool:
    """Print time and memory against length; return whether the target is met."""
    runs: dict[float, dict[str, float]] = {}
    with TemporaryDirectory() as folder:
        for minutes in sorted(lengths):
            path = Path(folder) / "recording.csv"
            write(path, minutes, rate)
            figures = runs[minutes] = measured(path, Path(folder))
            path.unlink()
            spent = f"{figures['seconds']:6.1f} s ({figures['cpu_s']:.1f} s of a core)"
            print(f"{minutes:g} min at {rate:g} Hz: {spent}, {figures['gib']:.2f} GiB", flush=True)
    reached = max(figures["gib"] for figures in runs.values()) <= MEMORY_TARGET
    print(f"target {MEMORY_TARGET:g} GiB: {'reached' if reached else 'MISSED'}")
    if report is not None:
        content = {"minutes": runs, "reached": reached}
        text_file.write(report, json.dumps(content, indent=1) + "\n")
    return reached


def main() -> int:
    """Run what was asked for; status 1 if the target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, nargs="+", default=[2.0, 10.0])
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    return 0 if run(arguments.minutes, arguments.rate, arguments.json) else 1


if __name__ == "__main__":
    sys.exit(main())
