"""Whether a diagnosis finds what it says that it would have found.

    PYTHONPATH=. python benchmark/detectable.py [--arms 10] [--first 0] [--jobs 2] [--json FILE]

Small arms with physics of their own (testing/mujoco_world.py) are drawn and identified. Another
motion of each, in which nothing is hidden, is diagnosed: it says which Coulomb friction it would
have found at each joint with 95 %. Then so much, and half as much, is hidden at one of them, with
other noise. It fails unless at least eight of ten are found at that size, and fewer at half of it.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace

import numpy as np

from dvrk_gravity.diagnosis import Diagnosis, diagnose
from dvrk_gravity.files import text_file
from dvrk_gravity.identification import identify
from testing.jobs import run_all
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

ARM = "chain"
EFFECT = "coulomb_friction"
FOUND = 0.8  # of the arms, at least: 95 % but for chance, of ten
PARTS = (1.0, 0.5)  # of the size that is stated


def is_found(diagnosis: Diagnosis, joint: str) -> bool:
    """Return whether friction at a joint is a finding, or an alternative of one."""
    named = [(finding.effect, finding.joints) for finding in diagnosis.findings]
    for finding in diagnosis.findings:
        named += [(other.effect, other.joints) for other in finding.alternatives]
    return (EFFECT, (joint,)) in named


def trial(seed: int) -> dict:
    """Draw an arm and return what is stated of one of its joints, and what is found there."""
    world = MujocoWorld.draw(ARM, seed)
    names = world.arm.joint_names
    calibration = draw_calibration(world.arm, seed)
    model = identify(world.record(world.truth(calibration), seed), world.arm).model
    truth = world.truth(draw_other(world.arm, seed, calibration))
    clean = diagnose(world.record(truth, seed + 1), model)
    stated = {each.joint: each.size for each in clean.detectable if each.effect == EFFECT}
    index = seed % len(names)
    joint = names[index]
    result = {"seed": seed, "joint": joint, "size": stated[joint], "clean": clean.verdict}
    for number, part in enumerate(PARTS, start=2):
        effort = truth.effort.copy()
        effort[:, index] += part * stated[joint] * np.sign(truth.qd[:, index])
        worn = replace(truth, effort=effort)
        found = diagnose(world.record(worn, seed + number), model)
        result[str(part)] = is_found(found, joint)
        result[f"said {part}"] = repr(found)
    print(json.dumps(result, ensure_ascii=False), flush=True)
    return result


def main() -> int:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json")
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.arms)
    results = run_all(trial, [(seed,) for seed in seeds], args.jobs)
    if args.json:
        text_file.write(args.json, json.dumps(results, indent=1) + "\n")
    whole, half = (sum(each[str(part)] for each in results) for part in PARTS)
    print(f"found at the stated size {whole} of {len(results)}, at half of it {half}")
    return int(not (whole >= FOUND * len(results) and half < len(results)))


if __name__ == "__main__":
    sys.exit(main())
