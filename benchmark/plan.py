"""What planned motions promise, beside random ones, and whether identification keeps it.

    python benchmark/plan.py                        # everything: some ten minutes of one core
    python benchmark/plan.py --parts condition random --arms mtmr

- ``condition``: condition number of the base parameters' columns, each divided by its range, of a
  Fourier series of six harmonics (base .1 Hz for an MTM, .18 Hz for a PSM) within published limits;
  published motions ended at 247 (MTM) and 355 (PSM).
- ``random``: geometric mean of the variances that a plan expects of the parameters, over the median
  and the least of that of a hundred random multisines of equal length (`excite`'s own), within the
  same limits. Targets: .4 and .6, of the parameters that random motions determine: to half of
  their prior standard deviation in the median. Of others both variances are the prior's.
- ``identified``: a simulated MTM (testing/world.py) moves along the plan, is identified; standard
  errors that `identify` reports over those expected before, with the noise that the identification
  found. Target: within a factor of 1.5 for 90 % of the parameters that data determine.
- ``held-out``: arms in MuJoCo (testing/mujoco_world.py), whose friction and cables no effect has,
  are identified from a planned motion, and from a random one of equal length (`excite`'s own),
  and predict a third motion, drawn as laboratories draw theirs (testing/lab_motion.py): error over
  torque, mean of the joints, planned over random. Target: below 1 for every arm in the geometric
  mean of its seeds. Not run by default: a minute of one core for each arm and seed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.planning import (
    Basis,
    FourierMotion,
    Knowledge,
    Multisine,
    PlanLimits,
    PriorKnowledge,
    SolverSettings,
    covering_motion,
    design_motion,
    noise_of,
    series_basis,
)
from dvrk_gravity.simulate import SimulatedArm, record_motion
from testing.followed import Followed
from testing.lab_motion import draw_other
from testing.mujoco_world import MujocoWorld
from testing.world import World

HELD_OUT = "held-out"
PARTS = ("condition", "random", "identified", HELD_OUT)
KINDS = ("mtmr", "psm", "ecm", "ur5", "ur10", "panda", "kinova", "chain")
PUBLISHED = {"mtmr": (0.1, 247.0), "psm": (0.18, 355.0)}  # base frequency, Hz; condition number
RANDOM = 100
MEDIAN, BEST = 0.4, 0.6
DURATION = 60.0  # s
DETERMINED = 0.5
AGREE, OF = 1.5, 0.9
HELD_OUT_SEED = 9300  # no other trial's
_RATE = 20.0  # samples a second at which information is compared
# deg and m of a published PSM's motion: -83…83, -43…46, 70…235 mm, ±86, ±80, ±86, 8.6…172
_PSM = np.array(
    [[-1.45, 1.45], [-0.75, 0.8], [0.07, 0.235], [-1.5, 1.5], [-1.4, 1.4], [-1.5, 1.5], [0.15, 3.0]]
)
_PSM_SPEED = np.array([1.7, 1.7, 0.35, 2.0, 2.0, 2.0, 3.0])
_MTM = np.radians([[-57, 29], [-10, 60], [-30, 30], [-40, 195], [-87, 180], [-40, 38], [-460, 450]])


def published(name: str) -> PlanLimits:
    """Return published limits of positions, as far as the arm's stops reach, and our rates."""
    arm = Arm.load(name)
    limits, stops = PlanLimits.of(arm), arm.range
    lower, upper = (_PSM if name == "psm" else _MTM).T
    velocity = np.minimum(limits.velocity, _PSM_SPEED) if name == "psm" else limits.velocity
    return replace(
        limits, lower=np.maximum(lower, stops[0]), upper=np.minimum(upper, stops[1]),
        velocity=velocity,
    )  # fmt: skip


def condition(name: str, settings: SolverSettings) -> dict[str, float]:
    """Return the condition number of a plan of six harmonics, and the published one."""
    arm, (base, target) = Arm.load(name), PUBLISHED[name]
    basis = Basis(base * np.arange(1, 7), 3.0, 30.0)
    begin = time.process_time()
    design = design_motion(arm, published(name), basis, settings=settings)
    return {
        "condition": design.condition, "target": target, "seconds": time.process_time() - begin,
    }  # fmt: skip


def random_motions(name: str, count: int, settings: SolverSettings) -> dict[str, float]:
    """Return the variances of a plan over those of random motions."""
    arm = Arm.load(name)
    limits = PlanLimits.of(arm)
    prior, begin = PriorKnowledge(arm, limits.lower, limits.upper), time.process_time()
    design = design_motion(arm, limits, series_basis(DURATION), settings=settings)
    seconds = time.process_time() - begin
    own = errors(prior, *sampled(design.plan.motion))
    others = []
    for seed in range(1, count + 1):
        motion, h = covering_motion(limits, DURATION, seed), 1e-4
        moments, _ = instants()
        (q, qd), (_, ahead), (_, behind) = (motion.at(moments + k * h) for k in (0, 1, -1))
        others.append(errors(prior, q, qd, (ahead - behind) / (2.0 * h)))
    spread = np.array(others)
    determined = np.median(spread, axis=0) < DETERMINED * prior.before
    figures: dict[str, float] = {"determined": int(determined.sum()), "of": len(determined)}
    for name, which in (("", determined), (", all", np.ones_like(determined))):
        mine, theirs = (
            np.exp(2.0 * np.mean(np.log(each[..., which]), axis=-1)) for each in (own, spread)
        )
        figures[f"of the median{name}"] = float(mine / np.median(theirs))
        figures[f"of the best{name}"] = float(mine / theirs.min())
    return figures | {"condition": design.condition, "seconds": seconds}


def instants() -> tuple[Array, Array]:
    """Return (N,) times, and the (N,) seconds that each stands for."""
    count = int(DURATION * _RATE)
    return (np.arange(count) + 0.5) / _RATE, np.full(count, 1.0 / _RATE)


def sampled(motion: FourierMotion) -> tuple[Array, Array, Array]:
    """Return a motion at those times."""
    return motion.at(instants()[0])


def errors(prior: Knowledge, q: Array, qd: Array, qdd: Array) -> Array:
    """Return the standard errors of the parameters expected after a motion."""
    return prior.errors(prior.gram(State(q, qd, qdd), instants()[1]))


def identified(seed: int, settings: SolverSettings) -> dict[str, float]:
    """Return how standard errors that `identify` reports compare with those expected."""
    world = World.draw(seed)
    arm = Arm.load("mtmr")
    limits = PlanLimits.of(arm)
    design = design_motion(arm, limits, series_basis(DURATION), settings=settings)
    simulated = SimulatedArm(world.plant(), world.sensors, seed, dt=world.step)
    recording = record_motion(simulated, Followed(design.plan.motion), DURATION)  # type: ignore[arg-type]
    fit = identify([recording], arm)
    prior = PriorKnowledge(arm, limits.lower, limits.upper, noise_of(arm, fit.model.uncertainty))
    q, qd, qdd = sampled(design.plan.motion)
    expected = dict(zip(prior.names, errors(prior, q, qd, qdd), strict=True))
    ratios = np.array(
        [
            (each.ci95[1] - each.ci95[0]) / (2.0 * 1.96) / expected[each.name]
            for each in fit.parameters
            if each.identifiable and each.name in expected
        ]
    )
    return {
        "parameters": len(ratios),
        "within": float(np.mean(np.abs(np.log(ratios)) <= np.log(AGREE))),
        "median ratio": float(np.median(ratios)),
        "least": float(ratios.min()), "greatest": float(ratios.max()),
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Differentiated:
    """A motion with accelerations, at rest before and after it.

    Attributes:
        motion: What has positions and velocities.
    """

    motion: Multisine | FourierMotion

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Return (N, n) positions, velocities and accelerations."""
        h = 1e-4
        inside = np.clip(time, h, self.motion.duration - h)
        (q, qd, *_), (_, ahead, *_), (_, behind, *_) = (
            self.motion.at(inside + k * h) for k in (0, 1, -1)
        )
        resting = (inside != time)[:, None]
        return q, np.where(resting, 0.0, qd), np.where(resting, 0.0, (ahead - behind) / (2.0 * h))


def held_out(name: str, seed: int, settings: SolverSettings) -> dict[str, float]:
    """Return held-out errors after a planned and after a random motion, and their ratio."""
    world = MujocoWorld.draw(name, HELD_OUT_SEED + seed)
    arm = world.arm
    design = design_motion(arm, PlanLimits.of(arm), series_basis(DURATION), settings=settings)
    random = covering_motion(PlanLimits.of(arm), DURATION, HELD_OUT_SEED + seed)
    unseen = world.record(world.truth(draw_other(arm, HELD_OUT_SEED + seed)), seed)
    errors = []
    for motion in (design.plan.motion, random):
        truth = world.truth(Differentiated(motion), DURATION)  # type: ignore[arg-type]
        fit = identify([world.record(truth, 1 + seed)], arm)
        found = evaluate(fit.model, [unseen], "joint").joints.values()
        errors.append(float(np.mean([error.nrmse for error in found])))
    return {"planned": errors[0], "random": errors[1], "ratio": errors[0] / errors[1]}


def main(given: Sequence[str] | None = None) -> int:
    """Print the figures; status 1 if one misses its target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS[:-1]))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS),
                        help=f"arms of {HELD_OUT}")  # fmt: skip
    parser.add_argument("--seeds", type=int, default=3, help=f"of each arm of {HELD_OUT}")
    parser.add_argument("--arms", nargs="+", choices=list(PUBLISHED), default=list(PUBLISHED))
    parser.add_argument("--random", type=int, default=RANDOM, help="random motions")
    parser.add_argument("--seed", type=int, default=1, help="seed of the simulated arm")
    parser.add_argument("--time", type=float, default=SolverSettings().seconds,
                        help="of one core for each plan, s")  # fmt: skip
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args(given)
    settings = SolverSettings(seconds=arguments.time)
    figures: dict[str, dict[str, float]] = {}
    missed = False

    def found(what: str, values: dict[str, float], good: bool) -> None:
        nonlocal missed
        figures[what] = values
        missed |= not good
        shown = ", ".join(f"{name} {value:.3g}" for name, value in values.items())
        print(f"{what}: {shown}{'' if good else '  MISSED'}", flush=True)

    for name in arguments.arms:
        if "condition" in arguments.parts:
            values = condition(name, settings)
            found(f"condition, {name}", values, values["condition"] < values["target"])
        if "random" in arguments.parts:
            values = random_motions(name, arguments.random, settings)
            good = values["of the median"] <= MEDIAN and values["of the best"] <= BEST
            found(f"variance, {name}", values, good)
    if "identified" in arguments.parts:
        values = identified(arguments.seed, settings)
        found("identified, mtmr", values, values["within"] >= OF)
    if HELD_OUT in arguments.parts:
        for name in arguments.kinds:
            each = [held_out(name, seed, settings) for seed in range(arguments.seeds)]
            values = {what: float(np.exp(np.mean(np.log([drawn[what] for drawn in each]))))
                      for what in each[0]}  # fmt: skip
            found(f"{HELD_OUT}, {name}, {len(each)} seeds", values, values["ratio"] < 1.0)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
