"""Hide and find beside a reference: the same motion twice, and what changed, without a model.

    python benchmark/reference_trials.py --seeds 0 8 --json reference.json

Every seed draws one of MuJoCo's arms, and for each effect, or none, a motion; it is recorded twice,
the second time with the effect hidden in it. How large it is, is told in units of what two
recordings without it differ by, below 8 Hz, at the joint where it is largest.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.recording import LowPass, Recording
from testing import lab_effects
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import NAMES, MujocoWorld
from testing.score import Outcome, compare
from testing.session import Session, hold_all, save, table

# Zeros, the tilt and masses of links cannot be told from a difference (docs/diagnosis.md).
EFFECTS = (
    "payload", "torque_scale", "torque_offset", "coulomb_friction", "viscous_friction",
    "elastic_cable", "time_delay", "effort_saturation", "thermal_drift", "cogging", "contact",
)  # fmt: skip
SIZES = (3.0, 12.0)
CLEAN = 3  # recordings with nothing hidden, a seed


def run(name: str, seed: int, effects: Sequence[str], sizes: tuple[float, float]) -> Session:
    """Try every effect in one arm."""
    world, session = MujocoWorld.draw(name, seed), Session("mujoco", name, seed)
    calibration = draw_calibration(world.arm, seed)
    for number, effect in enumerate(effects):
        random = np.random.default_rng([seed, number])
        motion, *noises = (int(value) for value in random.integers(1 << 30, size=4))
        truth = world.truth(draw_other(world.arm, motion, calibration))
        reference, again = (world.record(truth, noise) for noise in noises[:2])
        # Sensors that are late are so both times.
        setting = replace(world.setting(truth, _differ(reference, again)), delay=0.0)
        hiding = lab_effects.hide(setting, effect, random, sizes=sizes)
        outcome = Outcome("mujoco", name, seed, effect, ratio=hiding.ratio)
        start = time.monotonic()
        told = diagnose(world.record(hiding.truth, noises[2]), arm=world.arm, reference=reference)
        outcome.seconds = time.monotonic() - start
        compare(outcome, hiding.hidden, told, world.arm)
        session.outcomes.append(outcome)
        print(outcome, file=sys.stderr, flush=True)
    return session


def _differ(first: Recording, second: Recording) -> np.ndarray:
    """Return (n,) by what two recordings of one motion differ, RMS below the band, N·m or N."""
    assert first.time is not None
    low = LowPass(lab_effects.BAND, 1.0 / float(np.median(np.diff(first.time))))
    difference = low(first.effort - second.effort)
    return np.asarray(np.sqrt(np.mean(difference**2, axis=0)))


def main() -> int:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    # fmt: off
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 8), metavar=("FIRST", "END"))
    parser.add_argument("--arms", default=",".join(NAMES),
                        help="one a seed in turn (default: %(default)s)")
    parser.add_argument("--effects", nargs="*", default=EFFECTS, choices=EFFECTS,
                        help="only these, one named twice twice a seed (default: all once)")
    parser.add_argument("--sizes", type=float, nargs=2, default=SIZES,
                        metavar=("LEAST", "GREATEST"), help="(default: %(default)s)")
    parser.add_argument("--clean", type=int, default=CLEAN, metavar="N",
                        help="recordings with nothing hidden, a seed (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", help="write every trial here")
    # fmt: on
    args = parser.parse_args()
    arms = args.arms.split(",")
    effects = ["nothing"] * args.clean + list(args.effects)
    todo = [
        (arms[seed % len(arms)], seed, effects, tuple(args.sizes)) for seed in range(*args.seeds)
    ]
    sessions = hold_all(run, todo, args.jobs)
    if args.json:
        save(sessions, args.json)
    print(table("beside a reference", sessions))
    return 0


if __name__ == "__main__":
    sys.exit(main())
