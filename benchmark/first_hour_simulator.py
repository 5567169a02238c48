"""A model identified through the simulator's topics against one identified in the library.

README's steps on the simulator: `excite` drives and records it, `identify` fits, `evaluate` judges
on another motion. The same motions recorded without ROS, with the same sensors, give the yardstick:
a joint's error through ROS may be twice that. Status 1 if one is greater, or if `identify` warns of
ripple.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.files import text_file
from dvrk_gravity.planning import PlanLimits, exciting_motion
from dvrk_gravity.ros import PRIVATE, NodeProcess, private_domain
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion

ARM = "mtmr"
ALLOWED = 2.0  # times the library's error
SEEDS = (1, 2)  # of the motion that is fitted and of the one that is held out
CASES = ((200.0, 100.0), (200.0, 200.0), (1000.0, 200.0))  # Hz, of measured_js and of commands
TIMEOUT = "1.0"  # s; the machine may be shared


def verb(*words: object) -> str:
    """Run a verb as a user would, and return what it prints."""
    command = [sys.executable, "-m", "dvrk_gravity", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command[2:])}: status {done.returncode}: {done.stderr}")
    return done.stdout


def through_ros(folder: Path, rate: float, commands: float, durations: Sequence[float]) -> None:
    """Record both motions of a simulator of its own."""
    with private_domain(), NodeProcess("simulator", "-p", f"rate:={rate}") as simulator:
        for seed, duration in zip(SEEDS, durations, strict=True):
            verb("excite", "--arm", ARM, "--out", folder / f"motion_{seed}", "--seed", seed,
                 "--duration", duration, "--rate", commands, "--timeout", TIMEOUT,
                 "--no-rehearsal", "--namespace", PRIVATE)  # fmt: skip
        late = [line for line in simulator.lines if "behind real time" in line]
    if late:
        print(f"  the simulator left time out: {len(late)} lines of its log", flush=True)


def in_library(folder: Path, rate: float, durations: Sequence[float]) -> None:
    """Record the same motions without ROS."""
    truth = PlantFile.load("mtmr_28002")
    for seed, duration in zip(SEEDS, durations, strict=True):
        motion = exciting_motion(PlanLimits.of(truth.model.arm), duration, seed)
        arm = SimulatedArm(truth.plant(), truth.sensors, seed)
        recording = record_motion(arm, motion, duration - motion.ramp, rate)
        recording.save(folder / f"motion_{seed}")


def errors(folder: Path) -> tuple[list[float], bool]:
    """Return |e|/|tau| by joint on the held-out motion, and whether identify warned of ripple."""
    fitted, held_out = (folder / f"motion_{seed}" for seed in SEEDS)
    model, answer = folder / "model.yaml", folder / "answer.json"
    said = verb("identify", fitted, "--arm", ARM, "--out", model)
    verb("evaluate", held_out, "--model", model, "--json", answer)
    joints = json.loads(answer.read_text())["joints"]
    return [joints[name]["nrmse"] for name in JOINT_NAMES], "ripple" in said


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; status 1 if a joint misses the target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=60.0, help="of the fitted motion, s")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    args = parser.parse_args(argv)
    durations = (args.duration, max(20.0, args.duration / 2.0))
    passed, content = True, []
    print(f"{'held-out |e|/|tau|':<34}" + "".join(f"{name:>16}" for name in JOINT_NAMES))
    with tempfile.TemporaryDirectory() as name:
        library: dict[float, list[float]] = {}
        for rate, commands in CASES:
            if rate not in library:
                folder = Path(name) / f"library_{rate:g}"
                folder.mkdir()
                in_library(folder, rate, durations)
                library[rate], _ = errors(folder)
                show(f"library, {rate:g} Hz", library[rate])
            folder = Path(name) / f"ros_{rate:g}_{commands:g}"
            folder.mkdir()
            through_ros(folder, rate, commands, durations)
            found, ripple = errors(folder)
            show(f"topics, {rate:g} Hz, {commands:g} commands/s", found)
            good = [a <= ALLOWED * b for a, b in zip(found, library[rate], strict=True)]
            missed = [joint for joint, fine in zip(JOINT_NAMES, good, strict=True) if not fine]
            if missed or ripple:
                print(f"  MISSED: {', '.join(missed)}{' ripple' if ripple else ''}", flush=True)
            passed &= not missed and not ripple
            content.append({"rate": rate, "commands": commands, "topics": found,
                            "library": library[rate], "ripple": ripple})  # fmt: skip
    print(f"target: at most {ALLOWED:g} times the library's: {'reached' if passed else 'MISSED'}")
    if args.json is not None:
        text_file.write(args.json, json.dumps(content, indent=1) + "\n")
    return 0 if passed else 1


def show(title: str, values: Sequence[float]) -> None:
    """Print one line of the table."""
    print(f"{title:<34}" + "".join(f"{value:>16.3f}" for value in values), flush=True)


if __name__ == "__main__":
    sys.exit(main())
