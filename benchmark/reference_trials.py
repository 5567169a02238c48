"""Hide and find beside a reference: the same motion twice, and what changed, without a model.

    python benchmark/reference_trials.py --seeds 0 8 --json reference.json

Every seed draws one of MuJoCo's arms, and for each effect, or none, a motion; it is recorded twice,
the second time with the effect hidden in it. How large it is, is told in units of what two
recordings without it differ by, below 8 Hz, at the joint where it is largest.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import LowPass, Recording
from testing import lab_effects
from testing.jobs import run_all
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld
from testing.score import Outcome, run_trial
from testing.session import Session, tell
from testing.trial_arguments import parsed, trial_parser

# Zeros, the tilt and masses of links cannot be told from a difference (docs/diagnosis.md).
EFFECTS = (
    "payload", "torque_scale", "torque_offset", "coulomb_friction", "viscous_friction",
    "elastic_cable", "time_delay", "effort_saturation", "thermal_drift", "cogging", "contact",
)  # fmt: skip
SIZES = (3.0, 12.0)


def run(name: str, seed: int, effects: Sequence[str], sizes: tuple[float, float]) -> Session:
    """Try every effect in one arm."""
    world, session = MujocoWorld.draw(name, seed), Session("mujoco", name, seed)
    calibration, bare = draw_calibration(world.arm, seed), TorqueModel(world.arm, ())
    for number, effect in enumerate(effects):
        random = np.random.default_rng([seed, number])
        motion, *noises = (int(value) for value in random.integers(1 << 30, size=4))
        truth = world.truth(draw_other(world.arm, motion, calibration))
        reference, again = (world.record(truth, noise) for noise in noises[:2])
        # Sensors that are late are so both times.
        setting = replace(world.setting(truth, _differ(reference, again)), delay=0.0)
        hiding = lab_effects.hide(setting, effect, random, sizes=sizes)
        recording = world.record(hiding.truth, noises[2])
        outcome = Outcome("mujoco", name, seed, effect)
        made = recording, hiding.hidden, hiding.ratio
        session.add(run_trial(outcome, lambda made=made: made, bare, reference))
    return session


def _differ(first: Recording, second: Recording) -> np.ndarray:
    """Return (n,) by what two recordings of one motion differ, RMS below the band, N·m or N."""
    assert first.time is not None
    low = LowPass(lab_effects.BAND, 1.0 / float(np.median(np.diff(first.time))))
    difference = low(first.effort - second.effort)
    return np.asarray(np.sqrt(np.mean(difference**2, axis=0)))


def main() -> int:
    """Run the trials."""
    parser = trial_parser(__doc__, (0, 8), SIZES, "what two recordings without it differ by")
    args, arms = parsed(parser)
    effects = ["nothing"] * args.clean + list(EFFECTS if args.effects is None else args.effects)
    if unknown := set(effects) - {"nothing", *EFFECTS}:
        parser.error(f"--effects: got {', '.join(sorted(unknown))}, expected some of {EFFECTS}")
    todo = [
        (arms[seed % len(arms)], seed, effects, tuple(args.sizes)) for seed in range(*args.seeds)
    ]
    tell("beside a reference", run_all(run, todo, args.jobs), args.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
