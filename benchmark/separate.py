"""How often the motion that `plan --separate` makes separates what a diagnosis could not.

    python benchmark/separate.py --seeds 0 12 --count 30

Arms are an MTM (testing/world.py), a PSM, and arms of URDFs (testing/plain_world.py), each drawn
and identified first. Something is hidden in one, and it is recorded in a short, slow and narrow
motion, in which the diagnosis cannot separate it from others. The motion that is planned from
findings.json is recorded from the same arm, and both recordings are diagnosed together. Separated:
what was hidden is the finding, and no other cause is an alternative to it. What is the same torque
everywhere (testing/score.py) counts as one. The bar is for all of them, whether or not the plan
promises (95 %) to separate what was hidden from all others. Counted apart are only those in which
the diagnosis says of all others that are left that no motion is expected to exclude them.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.diagnosis import Diagnosis, Files, diagnose
from dvrk_gravity.errors import ConfigError, DvrkGravityError
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import (
    FourierMotion,
    Multisine,
    PlanLimits,
    SeparationSettings,
    UnresolvedPairs,
    design_separation,
    load_unresolved,
)
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion
from testing import hide as ours
from testing.followed import Followed
from testing.hidden_parts import Hidden, found, on_joint
from testing.hidden_plant import Dahl
from testing.mujoco_arms import FILES
from testing.plain_world import PlainWorld
from testing.score import fits
from testing.world import COARSE, World

Random = np.random.Generator
Named = tuple[str, tuple[int, ...]]  # effect and joints
Simulated = Callable[[int], SimulatedArm]  # by the seed of its sensors' noise

COUNT, BAR = 30, 0.9
OURS = (
    "payload", "link_com", "base_tilt", "elastic_cable", "coulomb_friction", "joint_spring",
    "joint_offset", "viscous_friction", "stribeck_friction", "rotor_inertia", "torque_offset",
)  # fmt: skip
ARMS = ("mtmr", "psm", "ur5", "mtmr", "kinova", "mtmr")  # by seed, in turn
CALIBRATION, RATE = 40.0, 100.0  # s, Hz
FIRST = (9.0, 13.0)  # s, the motion that is ambiguous
NARROW, SLOW = (0.1, 0.3), (0.3, 0.6)  # of the amplitudes and frequencies of an exciting motion


@dataclass(frozen=True)
class Laboratory:
    """An arm in which something can be hidden.

    Attributes:
        arm: The arm.
        clean: Without it.
        hide: An effect of a name, drawn; and what that is.
        effects: The names.
    """

    arm: Arm
    clean: Simulated
    hide: Callable[[str, Random], tuple[Simulated, Hidden]]
    effects: Sequence[str]


def laboratory(name: str, seed: int) -> Laboratory:
    """Draw an arm."""
    if name == "mtmr":
        world = World.draw(12000 + seed, step=COARSE)

        def hide(effect: str, random: Random) -> tuple[Simulated, Hidden]:
            changed, hidden = ours.hide(world, effect, random)
            return _of_world(changed), hidden

        return Laboratory(world.arm, _of_world(world), hide, OURS)
    arm = Arm.load(FILES.get(name, name))
    random = np.random.default_rng([seed, 1])
    links = PlantFile.load("psm").links if name == "psm" else nominal_inertias(arm)
    drawn = {link: body.__class__(body.mass * factor, body.lever, body.inertia * factor)
             for (link, body), factor in zip(
                 links.items(), random.uniform(0.8, 1.25, len(links)), strict=True)}  # fmt: skip
    plain = PlainWorld.of(arm, drawn)
    return Laboratory(arm, plain.simulated, lambda e, r: _hidden(plain, e, r), tuple(_PLAIN))


def _of_world(world: World) -> Simulated:
    return lambda seed: SimulatedArm(world.plant(), world.sensors, seed, dt=world.step)


def _hidden(world: PlainWorld, effect: str, random: Random) -> tuple[Simulated, Hidden]:
    joint = int(random.integers(min(world.arm.n, 6)))
    size = float(world.arm.effort_limit[joint]) * random.uniform(0.03, 0.12)
    changed, parameters = _PLAIN[effect](world, joint, size, random)
    return changed.simulated, found(world.arm, effect, joint, **parameters)


def _payload(
    world: PlainWorld, joint: int, size: float, random: Random
) -> tuple[PlainWorld, dict[str, float]]:
    mass = 0.01 * float(world.arm.effort_limit[1]) * random.uniform(0.5, 2.0)
    place = tuple(random.uniform(-0.06, 0.06, 3).tolist())
    return world.with_payload(world.arm.body_names[joint], mass, place), {"mass": mass}


def _coulomb(
    world: PlainWorld, joint: int, size: float, random: Random
) -> tuple[PlainWorld, dict[str, float]]:
    return world.with_friction(joint, size), {"positive": size, "negative": size}


def _viscous(
    world: PlainWorld, joint: int, size: float, random: Random
) -> tuple[PlainWorld, dict[str, float]]:
    more = 2.0 * size / float(world.arm.scale[joint]) * np.eye(world.arm.n)[joint]
    return replace(world, viscous=world.viscous + more), {}


def _on(
    shape: Callable[[PlainWorld, int, float, Random], Callable[[float, float, float], float]],
) -> Callable[[PlainWorld, int, float, Random], tuple[PlainWorld, dict[str, float]]]:
    def hide(
        world: PlainWorld, joint: int, size: float, random: Random
    ) -> tuple[PlainWorld, dict[str, float]]:
        torque = on_joint(joint, shape(world, joint, size, random))
        return replace(world, extra=(*world.extra, torque)), {}

    return hide


def _cable(
    world: PlainWorld, joint: int, size: float, random: Random
) -> Callable[[float, float, float], float]:
    lower, upper = (float(np.clip(each[joint], -3.0, 3.0)) for each in world.arm.range)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return lambda time, q, v: size * (q - middle) / half


def _offset(
    world: PlainWorld, joint: int, size: float, random: Random
) -> Callable[[float, float, float], float]:
    return lambda time, q, v: size


def _presliding(
    world: PlainWorld, joint: int, size: float, random: Random
) -> tuple[PlainWorld, dict[str, float]]:
    length = 0.05 * float(world.arm.scale[joint]) * random.uniform(0.5, 2.0)
    return replace(world, extra=(*world.extra, Dahl(joint, size, length))), {}


_PLAIN: dict[str, Callable[..., tuple[PlainWorld, dict[str, float]]]] = {
    "payload": _payload, "coulomb_friction": _coulomb, "viscous_friction": _viscous,
    "elastic_cable": _on(_cable), "torque_offset": _on(_offset),
    "presliding_hysteresis": _presliding,
}  # fmt: skip


def narrow(arm: Arm, random: Random) -> tuple[Multisine, float]:
    """Draw a motion in which little is separated, and how long it is recorded, s."""
    motion = Multisine.draw(arm, int(random.integers(1 << 30)))
    part, slow = random.uniform(*NARROW), random.uniform(*SLOW)
    motion = replace(motion, amplitude=part * motion.amplitude, frequency=slow * motion.frequency)
    return motion, float(random.uniform(*FIRST))


def unresolved(diagnosis: Diagnosis, model: Path) -> UnresolvedPairs | None:
    """Return the pairs of causes that a plan may separate, as `plan --separate` reads them."""
    findings = model.parent / "findings.json"
    findings.write_text(replace(diagnosis, files=Files.of(findings, model)).to_json())
    try:
        return load_unresolved(findings)
    except ConfigError:  # this diagnosis is clear
        return None


def never_shown(pairs: UnresolvedPairs | None, arm: Arm) -> set[tuple[Named, Named]]:
    """Return causes that no motion is expected to show, each with the one that it hides behind."""
    if pairs is None:
        return set()
    none = pairs.hidden(PlanLimits.of(arm))
    return {
        (true.named, other.named)
        for pair, hidden in zip(pairs.pairs, none, strict=True)
        for true, other, behind in (
            (pair.first, pair.second, hidden[0]), (pair.second, pair.first, hidden[1]),
        )
        if behind
    }  # fmt: skip


def explained(
    diagnosis: Diagnosis, hidden: Hidden, arm: Arm, never: set[tuple[Named, Named]]
) -> tuple[bool, bool, bool]:
    """Return whether what was hidden is named at all, and whether nothing else stands beside.

    And whether all that does is what no motion is expected to exclude.
    """
    for finding in diagnosis.findings:
        causes = [(finding.effect, finding.joints)]
        causes += [(other.effect, other.joints) for other in finding.alternatives]
        named = [(effect, tuple(map(arm.joint_names.index, joints))) for effect, joints in causes]
        right = [fits(hidden, effect, joints, arm) for effect, joints in causes]
        true = [each for each, fit in zip(named, right, strict=True) if fit]
        wrong = [each for each, fit in zip(named, right, strict=True) if not fit]
        if true:
            said = all(any((each, other) in never for each in true) for other in wrong)
            return True, not wrong, bool(wrong) and said
    return False, False, False


def trial(
    lab: Laboratory, model: Path, pairs: UnresolvedPairs, first: Recording, simulated: Simulated,
    hidden: Hidden, settings: SeparationSettings, seed: int,
) -> dict[str, object]:  # fmt: skip
    """Plan what separates, record it, and diagnose both recordings."""
    design = design_separation(pairs, PlanLimits.of(lab.arm), seed=seed, settings=settings)
    motion = design.plan.motion
    assert isinstance(motion, FourierMotion)
    # The servo of the simulated arm is given position and velocity, as by `collect`.
    second = record_motion(simulated(seed + 1), Followed(motion), motion.duration, RATE)  # type: ignore[arg-type]
    both = diagnose([first, second], TorqueModel.load(model))
    left = never_shown(unresolved(both, model), lab.arm)
    named, alone, never = explained(both, hidden, lab.arm, left)
    of_hidden = [
        expected
        for pair, expected in zip(pairs.pairs, design.expected, strict=True)
        if len({fits(hidden, each.hypothesis.effect, each.hypothesis.names, lab.arm)
                for each in (pair.first, pair.second)}) == 2
    ]  # fmt: skip
    return {
        "expected": [(each.words, each.planned, each.chance) for each in design.expected],
        "promised": bool(of_hidden) and all(each.separates for each in of_hidden),
        "named": named,
        "separated": alone,
        "never": never,
        "found": [
            f"{each.effect} {' '.join(each.joints)}"
            + "".join(f" | {other.effect} {' '.join(other.joints)}" for other in each.alternatives)
            for each in both.findings
        ],
    }


def main(given: Sequence[str] | None = None) -> int:
    """Print each trial and the count; status 1 if fewer are separated than the bar."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 12), metavar=("FIRST", "END"))
    parser.add_argument("--count", type=int, default=COUNT, help="ambiguous diagnoses")
    parser.add_argument("--time", type=float, default=SeparationSettings().solver.seconds,
                        help="of one core for each plan, s")  # fmt: skip
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args(given)
    usual = SeparationSettings()
    settings = replace(usual, solver=replace(usual.solver, seconds=arguments.time))
    rows: list[dict[str, object]] = []
    tried, said = 0, 0
    for seed in range(*arguments.seeds):
        if len(rows) >= arguments.count:
            break
        name = ARMS[seed % len(ARMS)]
        lab = laboratory(name, seed)
        with TemporaryDirectory() as folder:
            file = Path(folder) / "model.yaml"
            calibration = Multisine.draw(lab.arm, seed)
            recording = record_motion(lab.clean(seed), calibration, CALIBRATION, RATE)
            identify([recording], lab.arm).model.save(file)
            model = TorqueModel.load(file)
            for number, effect in enumerate(lab.effects):
                if len(rows) >= arguments.count:
                    break
                begin, random = time.process_time(), np.random.default_rng([seed, number])
                simulated, hidden = lab.hide(effect, random)
                motion, duration = narrow(lab.arm, random)
                try:
                    first = record_motion(simulated(seed), motion, duration, RATE)
                    diagnosis = diagnose(first, model)
                    tried += 1
                    named, alone, _ = explained(diagnosis, hidden, lab.arm, set())
                    if not named or alone:
                        continue
                    pairs = unresolved(diagnosis, file)
                    left = never_shown(pairs, lab.arm)
                    if pairs is None or explained(diagnosis, hidden, lab.arm, left)[2]:
                        said += 1
                        print(f"{name} {seed} {effect}: no motion is expected to")
                        continue
                    row = trial(lab, file, pairs, first, simulated, hidden, settings, seed)
                except DvrkGravityError as error:
                    print(f"{name} {seed} {effect}: left out: {error}", flush=True)
                    continue
                row |= {"arm": name, "seed": seed, "effect": effect, "joints": hidden.joints}
                rows.append(row)
                print(
                    f"{len(rows)}: {name} {seed} {effect} {' '.join(hidden.joints)}: "
                    f"{'' if row['promised'] else 'not promised; '}{_verdict(row)}: "
                    f"{row['found']}; "
                    f"expected {row['expected']} [{time.process_time() - begin:.0f} s]",
                    flush=True,
                )
    possible = [row for row in rows if not row["never"]]
    kept, promised = (
        f"{sum(bool(row['separated']) for row in some)} of {len(some)}"
        for some in (possible, [row for row in possible if row["promised"]])
    )
    print(
        f"separated {kept} ambiguous diagnoses (of {tried} in all), {promised} of those for which "
        f"the plan promises it; beside these, the diagnosis expects that of no motion: "
        f"{said} before the motion, {len(rows) - len(possible)} after it"
    )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1, default=str) + "\n")
    return int(sum(bool(row["separated"]) for row in possible) < BAR * len(possible))


def _verdict(row: dict[str, object]) -> str:
    if row["separated"]:
        return "separated"
    return "expected of no motion" if row["never"] else "NOT separated"


if __name__ == "__main__":
    sys.exit(main())
