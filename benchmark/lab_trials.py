"""Hide and find as in a laboratory: nobody has an exact model, it is identified first.

    python benchmark/lab_trials.py --seeds 0 5 --engine both --jobs 2 --json lab.json

Every seed draws an arm, records a calibration motion, identifies, and then records other motions
with one effect, or none, hidden in each; the diagnosis has the identified model. Arms are ours
(testing/world.py, always an MTMR, where the model's terms are the arm's) or MuJoCo's
(testing/mujoco_world.py, in turn those of --arms), where friction, cables and sensors are not.

How large it is, is told in units of what the model leaves of that very motion without it, below
8 Hz, at the joint where it is largest. In MuJoCo's arms it is hidden in such sizes. A motion that
goes beyond the calibration's has more left than that had, at times many times as much.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial

import numpy as np

from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing import hide as ours
from testing import lab_effects
from testing.hidden_parts import Hidden
from testing.jobs import run_all
from testing.lab_effects import left_by
from testing.lab_motion import draw_calibration, draw_other
from testing.lab_outside import OUTSIDE
from testing.mujoco_world import MujocoWorld
from testing.session import Laboratory, Session, Trial, hold, save, table
from testing.trial_arguments import parsed, trial_parser
from testing.world import World

ENGINES = ("ours", "mujoco")
ARM_SEED = 7000  # apart from those of benchmark/trials.py
Sizes = tuple[float, float]


def run(
    engine: str, arm: str, seed: int, effects: Sequence[str], sizes: Sizes, through_file: bool
) -> Session:
    """Calibrate one arm and try every effect in it."""
    prepare = partial(our_laboratory, seed, effects) if engine == "ours" else partial(
        mujoco_laboratory, arm, seed, effects, sizes
    )  # fmt: skip
    return hold(Session(engine, arm, seed), lambda: prepare(through_file))


def mujoco_laboratory(
    name: str, seed: int, effects: Sequence[str], sizes: Sizes, through_file: bool
) -> Laboratory:
    """Return one of MuJoCo's arms with effects to be hidden in it."""
    world = MujocoWorld.draw(name, seed)
    calibration = draw_calibration(world.arm, seed)

    def trials(model: TorqueModel) -> Iterator[Trial]:
        def make(effect: str, random: np.random.Generator) -> tuple[Recording, Hidden, float]:
            motion, noise = (int(value) for value in random.integers(1 << 30, size=2))
            truth = world.truth(draw_other(world.arm, motion, calibration))
            left = left_by(model, world.record(truth, noise))
            hiding = lab_effects.hide(
                world.setting(truth, left), effect, random, sizes=sizes,
                shapers={**lab_effects.HIDERS, **OUTSIDE},
            )  # fmt: skip
            return world.record(hiding.truth, noise), hiding.hidden, hiding.ratio

        return _each(seed, effects, make)

    recording = world.record(world.truth(calibration), seed)
    return Laboratory(world.arm, recording, trials, through_file=through_file)


def our_laboratory(seed: int, effects: Sequence[str], through_file: bool) -> Laboratory:
    """Return an MTM of our simulator with effects to be hidden in it."""
    world = World.draw(ARM_SEED + seed)
    exact = world.model()

    def trials(model: TorqueModel) -> Iterator[Trial]:
        def make(effect: str, random: np.random.Generator) -> tuple[Recording, Hidden, float]:
            changed, hidden = ours.hide(world, effect, random)
            motion, noise = (int(value) for value in random.integers(1 << 30, size=2))
            recording = changed.record(motion, noise)
            if effect == "nothing":
                return recording, hidden, 0.0
            # What the exact model cannot tell of it is what was hidden, and noise.
            without = world.record(motion, noise)
            noise_only = left_by(exact, without)
            size = np.sqrt(np.maximum(left_by(exact, recording) ** 2 - noise_only**2, 0.0))
            return recording, hidden, float(np.max(size / left_by(model, without)))

        return _each(seed, effects, make)

    calibration = world.record(2 * seed, 2 * seed)
    return Laboratory(world.arm, calibration, trials, through_file=through_file)


def _each(
    seed: int,
    effects: Sequence[str],
    make: Callable[[str, np.random.Generator], tuple[Recording, Hidden, float]],
) -> Iterator[Trial]:
    """Yield a trial for every effect, each with random numbers of its own."""
    for number, effect in enumerate(effects):
        yield effect, seed, partial(make, effect, np.random.default_rng([seed, number]))


def main() -> int:
    """Run the trials."""
    parser = trial_parser(
        __doc__, (0, 5), lab_effects.SIZES, "what the model leaves of that motion without it"
    )
    parser.add_argument("--engine", choices=(*ENGINES, "both"), default="both")
    parser.add_argument(
        "--through-file",
        action="store_true",
        help="save every model and load it again before it diagnoses",
    )
    parser.add_argument(
        "--outside",
        action="store_true",
        help="hide what no effect of the vocabulary is, in MuJoCo's arms only",
    )
    args, arms = parsed(parser)
    todo = []
    for seed in range(*args.seeds):
        for engine in ENGINES if args.engine == "both" else (args.engine,):
            known: Collection[str] = ours.HIDERS if engine == "ours" else lab_effects.HIDERS
            if args.outside:
                known = () if engine == "ours" else OUTSIDE
            wanted = known if args.effects is None else args.effects
            hidden = [
                effect
                for effect in wanted
                if effect in known and effect not in ("nothing", "outside")
            ]
            effects = ["nothing"] * args.clean + hidden
            arm = "mtmr" if engine == "ours" else arms[seed % len(arms)]
            todo.append((engine, arm, seed, effects, tuple(args.sizes), args.through_file))
    sessions = run_all(run, todo, args.jobs)
    if args.json:
        save(sessions, args.json)
    for engine in ENGINES:
        these = [session for session in sessions if session.engine == engine]
        if these:
            print(table(engine, these))
    return 0


if __name__ == "__main__":
    sys.exit(main())
