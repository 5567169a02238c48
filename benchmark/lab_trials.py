"""Hide and find as in a laboratory: nobody has an exact model, it is identified first.

    python benchmark/lab_trials.py --seeds 0 5 --engine both --jobs 2 --json lab.json

Every seed draws an arm, records a calibration motion, identifies, and then records other motions
with one effect, or none, hidden in each; the diagnosis has the identified model. Arms are ours
(testing/world.py, always an MTMR, where the model's terms are the arm's) or MuJoCo's
(testing/mujoco_world.py, in turn those of --arms), where friction, cables and sensors are not.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing import hide as ours
from testing import lab_effects
from testing.hidden_parts import Hidden
from testing.lab_effects import Setting
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import NAMES, MujocoWorld
from testing.score import Outcome, report, tried
from testing.world import World

ENGINES = ("ours", "mujoco")
CLEAN = 3  # recordings with nothing hidden, a seed
ARM_SEED = 7000  # apart from those of benchmark/trials.py


@dataclass
class Session:
    """What came of one seed.

    Attributes:
        engine: ``ours`` or ``mujoco``.
        arm: Which arm.
        seed: Its seed.
        identify: Seconds of the identification.
        residual: What the model leaves of each joint on held-out parts of the calibration, RMS.
        share: The same as a part of the joint's torque.
        outcomes: Of the trials.
        failure: Why there are none.
    """

    engine: str
    arm: str
    seed: int
    identify: float = 0.0
    residual: list[float] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    failure: str = ""


def run(
    engine: str, arm: str, seed: int, effects: Sequence[str], clean: int, through_file: bool
) -> Session:
    """Calibrate one arm and try every effect in it."""
    session = Session(engine, arm, seed)
    trials = _ours if engine == "ours" else _mujoco
    try:
        for outcome in trials(session, [*["nothing"] * clean, *effects], through_file):
            session.outcomes.append(outcome)
            print(outcome, file=sys.stderr, flush=True)
    except Exception:
        session.failure = traceback.format_exc(limit=4)
        print(session.failure, file=sys.stderr, flush=True)
    return session


def _identified(
    session: Session, recording: Recording, arm: Arm, through_file: bool
) -> TorqueModel:
    start = time.monotonic()
    fit = identify(recording, arm)
    session.identify = time.monotonic() - start
    session.residual = [one.rmse for one in fit.held_out.values()]
    session.share = [one.nrmse for one in fit.held_out.values()]
    shares = " ".join(f"{100 * share:.1f}" for share in session.share)
    print(
        f"{session.engine} {session.arm} {session.seed}: identified in {session.identify:.1f} s, "
        f"{fit.verdict.words}; leaves {shares} % of the joints' torques",
        file=sys.stderr, flush=True,
    )  # fmt: skip
    if not through_file:
        return fit.model
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.yaml"
        fit.model.save(path)
        return TorqueModel.load(path)


def _mujoco(session: Session, effects: Sequence[str], through_file: bool) -> Iterator[Outcome]:
    name, seed = session.arm, session.seed
    world = MujocoWorld.draw(name, seed)
    calibration = draw_calibration(world.arm, seed)
    recording = world.record(world.truth(calibration), seed)
    model = _identified(session, recording, world.arm, through_file)
    residual = np.array(session.residual)
    for number, effect in enumerate(effects):
        random = np.random.default_rng([seed, number])

        def make(effect: str = effect, random: np.random.Generator = random) -> tuple[
            Recording, Hidden, float
        ]:  # fmt: skip
            motion, noise = (int(one) for one in random.integers(1 << 30, size=2))
            truth = world.truth(draw_other(world.arm, motion, calibration))
            setting = Setting(truth, world.engine, residual, world.sizes.payload, world.sizes.reach)
            hiding = lab_effects.hide(setting, effect, random)
            return world.record(hiding.truth, noise), hiding.hidden, hiding.ratio

        yield tried(Outcome("mujoco", name, seed, effect), make, model)


def _ours(session: Session, effects: Sequence[str], through_file: bool) -> Iterator[Outcome]:
    seed = session.seed
    world = World.draw(ARM_SEED + seed)
    calibration = world.record(2 * seed, 2 * seed)
    model = _identified(session, calibration, world.arm, through_file)
    exact = world.model()
    residual = np.array(session.residual)
    for number, effect in enumerate(effects):
        random = np.random.default_rng([seed, number])

        def make(effect: str = effect, random: np.random.Generator = random) -> tuple[
            Recording, Hidden, float
        ]:  # fmt: skip
            changed, hidden = ours.hide(world, effect, random)
            motion, noise = (int(one) for one in random.integers(1 << 30, size=2))
            recording = changed.record(motion, noise)
            if effect == "nothing":
                return recording, hidden, 0.0
            # What the exact model cannot tell of it is what was hidden, and noise.
            noise_only = _left(exact, world.record(motion, noise))
            size = np.sqrt(np.maximum(_left(exact, recording) ** 2 - noise_only**2, 0.0))
            return recording, hidden, float(np.max(size / residual))

        yield tried(Outcome("ours", "mtmr", seed, effect), make, model)


def _left(model: TorqueModel, recording: Recording) -> np.ndarray:
    return np.array([one.rmse for one in evaluate(model, [recording], "joint").joints.values()])


def main() -> int:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    # fmt: off
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 5), metavar=("FIRST", "END"))
    parser.add_argument("--engine", choices=(*ENGINES, "both"), default="both")
    parser.add_argument("--arms", default=",".join(NAMES),
                        help="of MuJoCo's, one a seed in turn (default: %(default)s)")
    parser.add_argument("--effects", nargs="*", help="only these (default: all)")
    parser.add_argument("--clean", type=int, default=CLEAN, metavar="N",
                        help="recordings with nothing hidden, a seed (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--through-file", action="store_true",
                        help="save every model and load it again before it diagnoses")
    parser.add_argument("--json", help="write every trial here")
    # fmt: on
    args = parser.parse_args()
    arms = args.arms.split(",")
    unknown = set(arms) - set(NAMES)
    if unknown:
        parser.error(f"--arms: got {', '.join(sorted(unknown))}, expected some of {NAMES}")
    todo = []
    for seed in range(*args.seeds):
        for engine in ENGINES if args.engine == "both" else (args.engine,):
            known = ours.HIDERS if engine == "ours" else lab_effects.HIDERS
            wanted = known if args.effects is None else args.effects
            effects = [one for one in wanted if one in known and one not in ("nothing", "outside")]
            arm = "mtmr" if engine == "ours" else arms[seed % len(arms)]
            todo.append((engine, arm, seed, effects, args.clean, args.through_file))
    if args.jobs > 1:
        with ProcessPoolExecutor(args.jobs) as pool:
            sessions = list(pool.map(run, *zip(*todo, strict=True)))
    else:
        sessions = [run(*one) for one in todo]
    if args.json:
        with open(args.json, "w", encoding="utf-8") as stream:
            json.dump([asdict(one) for one in sessions], stream, indent=1, default=float)
    for engine in ENGINES:
        these = [one for one in sessions if one.engine == engine]
        if these:
            outcomes = [outcome for one in these for outcome in one.outcomes]
            seconds = {f"{one.arm} {one.seed}": one.identify for one in these if one.identify}
            print(report(engine, outcomes, seconds))
            print(*(one.failure for one in these if one.failure), sep="\n", end="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
