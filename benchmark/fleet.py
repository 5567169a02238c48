"""A fleet from a seed: arms over two simulated years, some with a change at a known date, scored.

    python benchmark/fleet.py --out out/fleet --arms 50 --recordings 20 --json out/bench/fleet.json

makes the recordings as files (`make`), works through them (`fleet`), looks for changes (`history`)
and scores them: planted changes found and dated within their intervals, and the part of the arms
that are reported as changed without being so. Whatever is there already is not done again: with
1,000 recordings it is a night's work for two cores.

Every arm is a plant of the package with masses, friction, cables, zeros and mounting of its own.
Its friction varies from day to day, in all joints together and in each. Planted are, in turn,
friction of a joint that grows, a cable that slackens, a base that was remounted, a zero that
slipped, and a torque constant that is another one.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pinocchio as pin

from dvrk_gravity.__main__ import main as command
from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import draw_arm
from dvrk_gravity.effects import ElasticCable, Range
from dvrk_gravity.fleet import ArmEntry, Engine, Manifest, client_of
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion

START = datetime(2024, 1, 1, 9, tzinfo=UTC)
DAYS = 730.0
MONTH = 30.44  # days
# Standard deviations of friction from day to day, as parts of it. Chosen: within the 30 % that a
# diagnosis expects of a joint (diagnosis.data.expectation.FRICTION_PART).
ALL_JOINTS, EACH_JOINT = 0.05, 0.03
MOTIONS = 3  # of an arm, which its recordings have in turn
STEP = 2.5e-3  # s, of the plant
DURATION, RATE = 30.0, 50.0  # s, Hz


@dataclass(frozen=True)
class Planted:
    """A change of one arm.

    Attributes:
        effect: Name in the vocabulary.
        joint: Where; ``""``: the base.
        day: Of its beginning, from the start.
        size: Rate a month, or size, SI or a part.
        gradual: It grows from then on; else it is there at once.
    """

    effect: str
    joint: str
    day: float
    size: float
    gradual: bool

    def at(self, day: float) -> float:
        """Return how much of it is there on a day."""
        if day < self.day:
            return 0.0
        return self.size * ((day - self.day) / MONTH if self.gradual else 1.0)


@dataclass(frozen=True)
class Job:
    """One recording to be made."""

    path: str
    arm: str
    seed: int
    day: float
    number: int
    planted: Planted | None


def draw_change(arm: Arm, kind: int, random: np.random.Generator) -> Planted:
    """Draw a change of one of the five kinds."""
    day = float(random.uniform(0.3, 0.65) * DAYS)
    index = int(random.integers(min(arm.n, 3)))  # later joints of a PSM are its tool's
    joint, scale, sign = arm.joint_names[index], arm.scale[index], random.choice([-1.0, 1.0])
    if kind == 0:
        return Planted("coulomb_friction", joint, day, float(random.uniform(0.04, 0.08)), True)
    if kind == 1:  # in effort limits per unit of travel, a month
        rate = -random.uniform(0.004, 0.008) * arm.effort_limit[index] / scale
        return Planted("elastic_cable", joint, day, float(rate), True)
    if kind == 2:
        return Planted("base_tilt", "", day, float(np.radians(random.uniform(1.0, 2.0))), False)
    if kind == 3:
        # A zero shows by weight: of the joints whose axis gravity turns about.
        return Planted("joint_offset", arm.joint_names[1], day,
                       float(sign * np.radians(random.uniform(0.6, 1.5))), False)  # fmt: skip
    return Planted(
        "torque_scale", arm.joint_names[1 + index % 2], day,
        float(sign * random.uniform(0.05, 0.1)), False,
    )  # fmt: skip


def record(job: Job) -> float:
    """Record an arm on a day, into a file; return the seconds that it took."""
    begun = time.monotonic()
    arm = Arm.load(job.arm)
    plant = draw_arm(PlantFile.of(arm), job.seed)
    random = np.random.default_rng([job.seed, 1, job.number])
    of_day = ALL_JOINTS * random.standard_normal()
    factors = 1.0 + of_day + EACH_JOINT * random.standard_normal(arm.n)
    amount = 0.0 if job.planted is None else job.planted.at(job.day)
    effect = "" if job.planted is None or amount == 0.0 else job.planted.effect
    index = arm.joint_names.index(job.planted.joint) if job.planted and job.planted.joint else 0
    grown = np.ones(arm.n)
    if effect == "coulomb_friction":
        grown[index] += amount
    terms = [
        term.scaled(factors * grown) if term.NAME == "coulomb_friction"
        else term.scaled(factors) if term.FRICTION else term
        for term in plant.model.terms
    ]  # fmt: skip
    if effect == "elastic_cable":
        coefficients = np.zeros((2, arm.n))
        coefficients[:, index] = -amount * 0.5 * (arm.lower + arm.upper)[index], amount
        ends = Range(np.full(arm.n, -np.inf), np.full(arm.n, np.inf))
        terms.append(ElasticCable(arm, coefficients, ends))
    if effect == "base_tilt":
        turned = pin.rpy.rpyToMatrix(amount, 0.5 * amount, 0.0).T
        terms = [term if term.FRICTION else term.with_gravity(turned @ _vector(terms))
                 for term in terms]  # fmt: skip
    offset = plant.model.joint_offset.copy()
    if effect == "joint_offset":
        offset[index] += amount
    model = replace(plant.model, terms=tuple(terms), joint_offset=offset)
    simulated = SimulatedArm(
        replace(plant, model=model).plant(), plant.sensors, 1000 * job.seed + job.number, dt=STEP
    )
    motion = Multisine.draw(arm, MOTIONS * job.seed + job.number % MOTIONS)
    recording = record_motion(simulated, motion, DURATION, RATE)
    if effect == "torque_scale":
        assert recording.effort is not None
        scale = np.ones(arm.n)
        scale[index] += amount
        recording = replace(recording, effort=recording.effort * scale)
    _save(recording, Path(job.path))
    return time.monotonic() - begun


def _vector(terms: list) -> np.ndarray:
    return next(term.vector for term in terms if hasattr(term, "vector"))


def _save(recording: Recording, path: Path) -> None:
    hidden = path.with_name(f"part-{path.name}")
    recording.save(hidden)
    hidden.replace(path)


def planned(
    out: Path, kinds: list[str], arms: int, recordings: int, changed: int, seed: int
) -> tuple[Manifest, dict[str, Planted | None], list[Job]]:
    """Return the manifest, the truth by serial number, and the recordings to be made."""
    random = np.random.default_rng(seed)
    entries, truth, jobs = [], dict[str, Planted | None](), list[Job]()
    for number in range(arms):
        name, serial = kinds[number % len(kinds)], f"{20_000 + 100 * seed + number}"
        arm = Arm.load(name)
        truth[serial] = draw_change(arm, number % 5, random) if number < changed else None
        # One about every so many days, and never two on one.
        days = DAYS / recordings * (np.arange(recordings) + random.uniform(0.1, 0.9, recordings))
        folder = out / "bags" / serial
        folder.mkdir(parents=True, exist_ok=True)
        for count, day in enumerate(days.tolist()):
            stamp = START + timedelta(days=day)
            path = folder / f"{name}_{stamp:%Y-%m-%d_%H-%M-%S}.csv"
            jobs.append(Job(str(path), name, 1000 * seed + number, day, count, truth[serial]))
        entries.append(ArmEntry(serial, name, (f"{serial}/*.csv",)))
    return Manifest(tuple(entries)), truth, jobs


def score(arms: list[dict], truth: dict[str, Planted | None]) -> dict:
    """Return what of the planted changes was found, named and dated, and what was not there.

    Args:
        arms: Of history.json.
        truth: What was planted, by serial number.
    """
    found = {arm["serial"]: arm["changes"] for arm in arms}
    lines, dated, named = [], 0, 0
    for serial, planted in truth.items():
        if planted is None:
            continue
        when = START + timedelta(days=planted.day)
        its = [change for change in found.get(serial, ()) if change["since"]]
        right = [
            change for change in its
            if datetime.fromisoformat(change["since"][0]) <= when
            <= datetime.fromisoformat(change["since"][1])
        ]  # fmt: skip
        same = [
            change
            for change in right
            for name in (change, *change["or"])
            if name["effect"] == planted.effect and name["joint"] == planted.joint
        ]
        dated, named = dated + bool(right), named + bool(same)
        lines.append(f"{serial} {planted.effect} {planted.joint} {when:%Y-%m-%d}: " + ("; ".join(
            f"{c['effect']} {c['joint']} {c['shape']} {c['since'][0][:10]} to {c['since'][1][:10]}"
            for c in its) or "nothing"))  # fmt: skip
    reported = [serial for serial, changes in found.items() if changes]
    false = [serial for serial in reported if truth[serial] is None]
    extra = sum(
        len(changes) - (truth[serial] is not None) for serial, changes in found.items() if changes
    )
    planted_count = sum(each is not None for each in truth.values())
    return {
        "planted": planted_count, "dated": dated, "named": named, "reported": len(reported),
        "false": len(false), "false_discovery_rate": len(false) / max(len(reported), 1),
        "changes_beyond_the_planted": extra, "lines": lines, "false_serials": false,
    }  # fmt: skip


def main() -> int:
    """Make, work, look, score."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/fleet"))
    parser.add_argument("--kinds", default="ecm", help="arms, comma-separated: ecm,psm,mtmr")
    parser.add_argument("--arms", type=int, default=50)
    parser.add_argument("--recordings", type=int, default=20, help="of each arm")
    parser.add_argument("--changed", type=int, default=8, help="arms with a planted change")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scheduler", help="tcp://… of a cluster that is there")
    parser.add_argument("--json", help="file for the figures")
    parser.add_argument("--make-only", action="store_true", help="only make the recordings")
    arguments = parser.parse_args()
    out: Path = arguments.out
    manifest, truth, jobs = planned(
        out, arguments.kinds.split(","), arguments.arms, arguments.recordings, arguments.changed,
        arguments.seed,
    )  # fmt: skip
    (out / "bags").mkdir(parents=True, exist_ok=True)
    manifest.save(out / "bags" / "fleet.yaml")
    (out / "truth.json").write_text(
        json.dumps({key: each and asdict(each) for key, each in truth.items()}, indent=1)
    )
    left = [job for job in jobs if not Path(job.path).exists()]
    times = {"make": _timed(lambda: _make(left, arguments.scheduler, arguments.workers))}
    print(f"made {len(left)} recordings in {times['make']:.0f} s")
    if arguments.make_only:
        return 0
    where = ["--scheduler", arguments.scheduler] if arguments.scheduler else [
        "--workers", str(arguments.workers)]  # fmt: skip
    results = str(out / "results")
    status = list[int]()
    words = ["fleet", str(out / "bags"), "--out", results, *where]
    times["fleet"] = _timed(lambda: status.append(command(words)))
    if status[0] > 1:  # interrupted, or nothing could be done
        return status[0]
    times["history"] = _timed(lambda: command(["history", results]))
    figures = score(json.loads((out / "results" / "history.json").read_text())["arms"], truth)
    figures |= {"seconds": times, "recordings": len(jobs), "arms": len(truth)}
    print(*figures["lines"], sep="\n")
    print(
        f"{figures['dated']} of {figures['planted']} planted changes dated within their intervals, "
        f"{figures['named']} by their name; {figures['false']} of {figures['reported']} arms "
        f"reported falsely; {times['fleet']:.0f} s of work"
    )
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(figures, indent=1))
    missed = figures["dated"] < figures["planted"] * 7 / 8 or figures["false_discovery_rate"] > 0.05
    return int(missed)


def _make(jobs: list[Job], scheduler: str | None, workers: int) -> None:
    if not jobs:
        return
    with client_of(scheduler, workers) as client:
        engine: Engine[Job, float] = Engine(client, record)
        engine.run(jobs, lambda job: f"make-{job.path}", lambda job, _: None, _lost)


def _lost(job: Job, why: str) -> None:
    raise SystemExit(f"{job.path}: {why}")


def _timed(call: Callable[[], object]) -> float:
    begun = time.monotonic()
    call()
    return time.monotonic() - begun


if __name__ == "__main__":
    sys.exit(main())
