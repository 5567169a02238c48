"""Do the 95 % intervals of an identification hold what they promise?

Every repetition draws an arm, a motion and sensor noise, simulates a recording, and identifies
it twice: with the terms that the arm really has, and with the terms that the choice by held-out
error picks. Counted are the parameters that are called identifiable. Intervals are conditional
on the terms; so the first count judges them, the second says what the choice costs.

    python benchmark/coverage.py --arms ur5,panda --repetitions 24

takes MuJoCo's arms in turn (testing/mujoco_world.py), whose friction and cables no term represents
exactly, and counts the links' base parameters: weights (masses and first moments) and inertia.
Springs are left out, since one that turns with a link is a weight. Counted apart are the torques
that hold the arm at recorded poses, between minus and plus 1.96 times the standard error that the
verdict judges; the truth is halfway between both ways of slow motion.

Exit status 1 if a pooled coverage is not within 93 to 97 %, of MuJoCo's arms 90 to 99 %.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from dvrk_gravity.arms import JOINT_NAMES, Arm, rigid_body
from dvrk_gravity.effects import LinkInertia, Site, State
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.gravity import BETA_NAMES
from dvrk_gravity.identification import (
    FittedParameter,
    Problem,
    base_parameters,
    build_problem,
    choose,
    estimate,
    identify,
    with_motor_weights,
)
from dvrk_gravity.model import Columns, search_starts
from dvrk_gravity.observation import observe
from testing.jobs import run_all
from testing.lab_motion import draw_calibration
from testing.mujoco_world import NAMES, MujocoWorld
from testing.world import World

LOW, HIGH = 0.93, 0.97
OF_ARMS = 0.90, 0.99  # of MuJoCo's
TINY = 1e-12  # N·m, instead of no standard error
POSES = 50  # at which the holding torque is counted, of each recording
FAMILIES = {
    "beta": "gravity (beta)",
    "elastic_cable": "elastic torque",
    "coulomb_friction": "Coulomb friction",
    "viscous_friction": "viscous friction",
    "rotor_inertia": "rotor inertia",
    "presliding_hysteresis": "presliding",
}
RIGID = "rigid-body combinations"


@dataclass
class Count:
    """Hits of the intervals.

    Attributes:
        hits: By parameter: whether the interval held the truth, in every repetition in which
            the parameter was identifiable.
        errors: By parameter: error over standard error, likewise.
        shares: By family: hits and count of each repetition.
        open: By parameter: repetitions in which it was called not identifiable.
    """

    hits: dict[str, list[bool]] = field(default_factory=dict)
    errors: dict[str, list[float]] = field(default_factory=dict)
    shares: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    open: dict[str, int] = field(default_factory=dict)

    def add(self, parameters: Sequence[FittedParameter], truth: dict[str, float]) -> None:
        """Count one repetition."""
        seen: dict[str, list[bool]] = {}
        for parameter in parameters:
            if not parameter.identifiable:
                self.open[parameter.name] = self.open.get(parameter.name, 0) + 1
                continue
            low, high = parameter.ci95
            value = truth.get(parameter.name, 0.0)
            self.hits.setdefault(parameter.name, []).append(low <= value <= high)
            error = (parameter.value - value) / ((high - low) / 2.0 / 1.959964)
            self.errors.setdefault(parameter.name, []).append(error)
            for group in (family(parameter.name), "all"):
                seen.setdefault(group, []).append(self.hits[parameter.name][-1])
        for group, inside in seen.items():
            self.shares.setdefault(group, []).append((sum(inside), len(inside)))

    def table(self) -> dict[str, dict[str, Any]]:
        """Return coverage by family, with a 95 % interval, and what parameters there are.

        Parameters of one repetition share its noise: the interval is that of a ratio of sums
        over repetitions.
        """
        rows = {}
        for group, shares in self.shares.items():
            hits, counts = np.array(shares, dtype=float).T
            share = hits.sum() / counts.sum()
            spread = np.sqrt(np.sum((hits - share * counts) ** 2)) / counts.sum()
            names = [n for n in self.hits if group in ("all", family(n))]
            rows[group] = {
                "coverage": share,
                "ci95": [share - 1.96 * spread, min(share + 1.96 * spread, 1.0)],
                "parameters": len(names),
                "intervals": int(counts.sum()),
                "worst": min(np.mean(self.hits[name]) for name in names),
            }
        return rows

    def by_parameter(self) -> dict[str, dict[str, Any]]:
        """Return coverage by parameter, with the exact binomial 95 % interval."""
        rows = {}
        for name, hits in self.hits.items():
            interval = binomtest(sum(hits), len(hits)).proportion_ci(0.95)
            rows[name] = {
                "coverage": float(np.mean(hits)),
                "ci95": [float(interval.low), float(interval.high)],
                "identifiable": len(hits),
                "open": self.open.get(name, 0),
                "mean_error": float(np.mean(self.errors[name])),
                "spread_of_error": float(np.std(self.errors[name])),
            }
        return rows


def family(name: str) -> str:
    """Return what kind of parameter a name is."""
    arm, _, parameter = name.rpartition(": ")
    if arm:
        kinds = {"m": "weights", "h": "holding torque"}
        return f"{arm}, {kinds.get(parameter[0], 'inertia')}"
    return FAMILIES.get(name.split("[")[0].split(".")[0], RIGID)


@lru_cache(maxsize=1)
def rotors_as_links(arm: Arm) -> dict[int, np.ndarray]:
    """Return those rotors that torque cannot tell from inertia of links, as such links.

    By motor: (90,) link parameters of a rotor of 1 kg·m^2.
    """
    columns = Columns(arm, *arm.range)
    random = np.random.default_rng(5)
    q = random.uniform(*arm.range, (300, arm.n))
    state = State(q, *random.normal(size=(2, 300, arm.n)))
    x = columns.regressor(state, columns.history(state)).reshape(-1, len(columns.columns))
    rigid, found = columns.select("link_inertia"), {}
    for j in range(arm.n):
        rotor = x[:, columns.select("rotor_inertia", Site.motor(j))[0]]
        theta, *_ = np.linalg.lstsq(x[:, rigid], rotor, rcond=None)
        if np.abs(x[:, rigid] @ theta - rotor).max() < 1e-8:
            found[j] = columns.base @ theta
    return found


def true_columns(columns: Columns, world: World) -> list[int]:
    """Return the columns that the world's torque consists of, each effect once."""
    chosen = columns.select("link_inertia") + columns.select("gravity")
    for j in range(7):
        degree = int(np.max(np.flatnonzero(world.cable[:, j]), initial=0))
        for power in range(degree + 1):
            chosen += columns.select("elastic_cable", Site.joint(j), power)
        for site, level in zip((Site.joint(j), Site.motor(j)), world.coulomb[::2, j], strict=True):
            if level:
                chosen += columns.select("coulomb_friction", site)
        chosen += columns.select("viscous_friction", Site.joint(j))
        if j not in rotors_as_links(world.arm):
            chosen += columns.select("rotor_inertia", Site.motor(j))
    return sorted(chosen)


def true_values(world: World, columns: Columns, chosen: Sequence[int]) -> dict[str, float]:
    """Return the world's parameters by name; what is not listed is zero."""
    inertia = next(term for term in world.model().terms if isinstance(term, LinkInertia))
    links = inertia.theta.copy()
    for j, as_links in rotors_as_links(world.arm).items():
        if columns.select("rotor_inertia", Site.motor(j))[0] not in chosen:
            links += world.rotors[j] * as_links
    truth = {f"beta[{k}] ({BETA_NAMES[k]})": float(world.beta[k]) for k in range(len(BETA_NAMES))}
    truth |= {
        name: float(combination @ links) for name, _, combination in base_parameters(world.arm)
    }
    for j, joint in enumerate(JOINT_NAMES):
        truth |= {f"elastic_cable.{joint}[{k}]": float(v) for k, v in enumerate(world.cable[:, j])}
        truth[f"coulomb_friction.joint[{joint}]"] = float(world.coulomb[0, j])
        truth[f"coulomb_friction.motor[{joint}]"] = float(world.coulomb[2, j])
        truth[f"viscous_friction.joint[{joint}]"] = float(world.viscous[j])
        truth[f"rotor_inertia.motor[{joint}]"] = float(world.rotors[j])
    return truth


def record(seed: int, duration: float) -> tuple[World, Problem]:
    """Return an arm and the least-squares problem of a recording of it."""
    world = World.draw(seed)
    recording = world.record(motion=seed, noise=seed, duration=duration)
    return world, build_problem(observe([recording], world.arm), world.arm)


def repeated(
    seed: int, duration: float, titles: Sequence[str]
) -> list[tuple[tuple[FittedParameter, ...], dict[str, float]]]:
    """Return parameters and truth of one recording, for the true and for the chosen terms."""
    world, problem = record(seed, duration)
    columns = problem.design.columns
    results = []
    for title in titles:
        if title == "true terms":
            chosen = true_columns(columns, world)
            weighted = with_motor_weights(problem, chosen)
        else:
            weighted, chosen = choose(problem, search_starts(columns), lambda share: None)
        truth = true_values(world, columns, chosen)
        results.append((estimate(weighted, chosen).parameters, truth))
    return results


def of_arm(
    name: str, seed: int, duration: float
) -> list[tuple[tuple[FittedParameter, ...], dict[str, float]]]:
    """Return base parameters, and their true values, of one of MuJoCo's arms.

    Then errors of the torque that holds it, whose true value is zero.
    """
    world = MujocoWorld.draw(name, seed)
    world = replace(world, spring=replace(world.spring, torque=0.0))
    arm, engine = world.arm, world.engine
    motion = draw_calibration(arm, seed)
    fit = identify(world.record(world.truth(motion, duration), seed), arm)
    fitted = {parameter.name: parameter for parameter in fit.parameters}
    columns = Columns(arm, *arm.range)
    random = np.random.default_rng(1)
    q = random.uniform(*np.clip(arm.range, -2.0 * np.pi, 2.0 * np.pi), (300, arm.n))
    qd, qdd = random.normal(size=(2, 300, arm.n))
    x = rigid_body.regressor(arm, q, qd, qdd, arm.gravity) @ columns.base
    torque = engine.torque(q, qd, qdd)
    theta, *_ = np.linalg.lstsq(x.reshape(torque.size, -1), torque.ravel(), rcond=None)
    links = columns.base @ theta
    for j, as_links in rotors_as_links(arm).items():
        if f"rotor_inertia.motor[{arm.joint_names[j]}]" not in fitted:
            links += world.rotors[j] * as_links
    truth = {f"{name}: {found}": float(line @ links) for found, _, line in base_parameters(arm)}
    counted = [replace(p, name=f"{name}: {p.name}") for p in fit.parameters]
    at = motion.at(np.random.default_rng(2).uniform(0.0, duration, POSES))[0]
    errors = fit.model.torque(at) - world.at_rest(at)
    held = tuple(
        FittedParameter(
            f"{name}: holding torque of {joint}", value, arm.effort_units[k],
            (value - half, value + half), identifiable=True,
        )
        for k, joint in enumerate(arm.joint_names)
        for half in [max(NORMAL_95 * fit.holding[joint].error, TINY)]
        for value in errors[:, k].tolist()
    )  # fmt: skip
    return [(tuple(p for p in counted if p.name in truth), truth), (held, {})]


def progress(repetitions: int, spent: float, counts: Mapping[str, Count]) -> None:
    """Print a line on the way."""
    shares = ", ".join(
        f"{100 * count.table()['all']['coverage']:.1f} % with {title}"
        for title, count in counts.items()
    )
    print(f"{repetitions:4d} repetitions, {spent:.0f} s: {shares}", flush=True)


def report(title: str, count: Count) -> None:
    """Print coverage by family, and the parameters that are far off."""
    print(f"\n{title}")
    print(f"  {'':26s}coverage      95 % interval  parameters  intervals")
    for group, row in sorted(count.table().items(), key=lambda item: item[0] == "all"):
        low, high = row["ci95"]
        print(
            f"  {group:26s}{100 * row['coverage']:6.1f} %   {100 * low:6.1f} to {100 * high:5.1f} %"
            f"{row['parameters']:10d}{row['intervals']:12d}"
        )
    rows = count.by_parameter()
    off = {n: r for n, r in rows.items() if not r["ci95"][0] <= 0.95 <= r["ci95"][1]}
    print(f"  {len(off)} of {len(rows)} parameters differ from 95 % beyond their binomial interval")
    for name, row in sorted(off.items(), key=lambda item: item[1]["coverage"]):
        print(
            f"  {100 * row['coverage']:6.1f} % of {row['identifiable']:3d}  {name}  (mean error "
            f"{row['mean_error']:+.2f}, spread {row['spread_of_error']:.2f} standard errors)"
        )
    never = [name for name in count.open if name not in count.hits]
    if never:
        print(f"  never identifiable: {'; '.join(never)}")


def main() -> int:
    """Run the repetitions."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repetitions", type=int, default=200)
    parser.add_argument("--arms", help=f"some of {','.join(NAMES)}, a repetition in turn")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first repetition")
    parser.add_argument("--duration", type=float, default=30.0, help="s, of a recording")
    parser.add_argument("--only-true", action="store_true", help="leave the choice of terms out")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    counts = {"chosen terms": Count(), "holding torque": Count()}
    if not arguments.arms:
        chosen = {} if arguments.only_true else {"chosen terms": Count()}
        counts = {"true terms": Count()} | chosen
    start = time.perf_counter()
    seeds = range(arguments.first, arguments.first + arguments.repetitions)
    if arguments.arms:
        arms = arguments.arms.split(",")
        names = [arms[seed % len(arms)] for seed in seeds]
        run = partial(of_arm, duration=arguments.duration)
        given: list[tuple[Any, ...]] = list(zip(names, seeds, strict=True))
    else:
        run = partial(repeated, duration=arguments.duration, titles=tuple(counts))
        given = [(seed,) for seed in seeds]
    repetition = itertools.count(1)

    def take(results: Sequence[Any]) -> None:
        for count, (parameters, truth) in zip(counts.values(), results, strict=True):
            count.add(parameters, truth)
        if (number := next(repetition)) % 20 == 0:
            progress(number, time.perf_counter() - start, counts)

    run_all(run, given, arguments.jobs, take)
    for title, count in counts.items():
        report(title, count)
    if arguments.json:
        content = {
            title: {"families": count.table(), "parameters": count.by_parameter()}
            for title, count in counts.items()
        }
        arguments.json.write_text(json.dumps(content, indent=1))
    pooled = {title: count.table()["all"]["coverage"] for title, count in counts.items()}
    low, high = OF_ARMS if arguments.arms else (LOW, HIGH)
    off = {title: share for title, share in pooled.items() if not low <= share <= high}
    for title, share in off.items():
        print(f"{title}: {100 * share:.1f} %, expected {100 * low:.0f} to {100 * high:.0f} %")
    return int(bool(off))


if __name__ == "__main__":
    sys.exit(main())
