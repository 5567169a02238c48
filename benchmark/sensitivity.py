"""Halve and double every threshold of estimation, and tell what moves.

    python benchmark/sensitivity.py --jobs 2
    python benchmark/sensitivity.py --settings SelectionSettings JudgementSettings

A fixed set of problems is solved with each threshold at half and at twice its value. Models are
identified, as a laboratory does, on recordings of another engine's arm (testing/mujoco_world.py);
what is hidden in others, and diagnosed with them, is about as large as what the model leaves, so
that thresholds matter. Weighing against a reference, drive gains by a known load, static poses,
and reading a recording full of faults are problems of their own. What stays within a per cent of
where it was is not shown; a threshold to which nothing reacts is needless, or a bound that these
problems do not reach.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.diagnosis import (
    Diagnosis,
    FilterSettings,
    JudgementSettings,
    LoadSettings,
    SelectionSettings,
    SignificanceSettings,
    diagnose,
)
from dvrk_gravity.estimation import (
    BlockSettings,
    FoldSettings,
    RobustSettings,
)
from dvrk_gravity.identification import (
    Evaluation,
    Fit,
    evaluate,
    identify,
)
from dvrk_gravity.planning import PlanLimits
from dvrk_gravity.recording import (
    Bands,
    Recording,
    TimingSettings,
    prepare,
)
from testing.jobs import run_all
from testing.lab_effects import hide
from testing.lab_motion import draw_calibration, draw_other, fourier
from testing.mujoco_world import MujocoWorld
from testing.world import World

LAB = ("chain", 3)  # arm and seed of testing/mujoco_world.py
HIDDEN = ("nothing", "coulomb_friction", "rotor_inertia", "joint_offset", "cogging", "time_delay")
SIZES = (0.7, 1.4)  # times what the identified model leaves
LOAD = 0.5  # kg, in the largest links' frame
BASE = 0.12  # Hz, of the motion with and without it
GAINS = np.array([14.0, 12.0, 9.0, 11.0])  # N·m/A
POSED = 7  # seed of the arm whose static poses are identified
MOVES = 0.01  # of a figure: less is not shown
Figures = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Lab:
    """An arm of another engine, how it was calibrated, and its model.

    Attributes:
        world: The arm.
        calibration: Its recording.
        fit: What was identified of it.
        hidden: By effect, a recording with it.
        bare: A motion ...
        loaded: ... and the same with a load.
    """

    world: MujocoWorld
    calibration: Recording
    fit: Fit
    hidden: dict[str, Recording]
    bare: Recording
    loaded: Recording

    @classmethod
    @cache
    def set_up(cls) -> Lab:
        """Record, identify and hide, with every threshold as it is."""
        name, seed = LAB
        world = MujocoWorld.draw(name, seed)
        motion = draw_calibration(world.arm, seed)
        calibration = world.record(world.truth(motion), seed)
        fit = identify(calibration, world.arm)
        residual = np.array([error.rmse for error in fit.held_out.values()])
        hidden = {}
        for number, effect in enumerate(HIDDEN):
            random = np.random.default_rng([seed, number])
            drawn, noise = (int(value) for value in random.integers(1 << 30, size=2))
            truth = world.truth(draw_other(world.arm, drawn, motion))
            setting = world.setting(truth, residual)
            hidden[effect] = world.record(hide(setting, effect, random, sizes=SIZES).truth, noise)
        # This one repeats, as a laboratory's exciting motions do.
        again = fourier(PlanLimits.of(world.arm), BASE, np.random.default_rng(seed))
        bare = world.truth(again)
        added = world.engine.added(bare.motion, world.arm.n - 1, LOAD, np.array([0.0, 0.05, 0.05]))
        loaded = replace(bare, effort=bare.effort + added)
        return cls(
            world, calibration, fit, hidden,
            world.record(bare, seed + 1), world.record(loaded, seed + 2),
        )  # fmt: skip


def diagnosed() -> Figures:
    """Return what is found of what was hidden."""
    lab, found = Lab.set_up(), Figures()
    for effect, recording in lab.hidden.items():
        found |= _told(effect, diagnose(recording, lab.fit.model))
    return found


def referenced() -> Figures:
    """Return what the load is weighed as, against the same motion without it."""
    lab = Lab.set_up()
    return _told("reference", diagnose(lab.loaded, arm=lab.world.arm, reference=lab.bare))


def in_amperes() -> Figures:
    """Return the gains of motors that are told in A, by a known load."""
    lab = Lab.set_up()
    currents = [
        replace(recording, effort=recording.effort / GAINS, arm=None)
        for recording in (lab.bare, lab.loaded)
    ]
    fit = identify(currents, lab.world.arm, known_payload=LOAD)
    arm, figures = fit.model.arm, Figures(verdict=fit.verdict.level)
    assert arm.drive_gains is not None
    assert arm.drive_gain_error is not None
    for j, (gain, error) in enumerate(zip(arm.drive_gains, arm.drive_gain_error, strict=True)):
        figures |= {f"gain {j}": float(gain), f"error of gain {j}": float(error)}
    return figures


def _told(name: str, diagnosis: Diagnosis) -> Figures:
    figures: Figures = {
        f"{name}: findings": [
            f"{finding.effect} {' '.join(finding.joints)}" for finding in diagnosis.findings
        ],
        f"{name}: known": [f"{known.effect} {' '.join(known.joints)}" for known in diagnosis.known],
    }
    for joint, floor in diagnosis.floor.items():
        figures[f"{name}: floor of {joint}"] = floor
    for finding in diagnosis.findings[:1]:
        for parameter, estimate in finding.parameters.items():
            figures[f"{name}: {parameter}"] = estimate.value
            figures[f"{name}: {parameter}, width"] = estimate.high - estimate.low
    return figures


def identified() -> Figures:
    """Return the errors of a model of a trajectory, on what it saw not and on another motion."""
    lab = Lab.set_up()
    fit = identify(lab.calibration, lab.world.arm)
    return _errors(fit, evaluate(fit.model, lab.hidden["nothing"]))


def posed() -> Figures:
    """Return the same of static poses."""
    world = World.draw(POSED)
    fit = identify(world.record_poses(1, 2), world.arm)
    return _errors(fit, evaluate(fit.model, world.record_poses(3, 4)))


def read() -> Figures:
    """Return what the checks say of a recording full of faults, and what they make of it."""
    figures: Figures = {}
    lab = Lab.set_up()
    for name, recording in faulty(lab.calibration).items():
        prepared = prepare(recording, Bands(20.0, 20.0, 20.0, np.inf, 20.0, for_fit=True))
        figures[f"{name}: warnings"] = sorted(str(warning) for warning in prepared.warnings)
        figures[f"{name}: handling"] = sorted(prepared.processing_log)
        figures[f"{name}: samples"] = len(prepared.filtered)
    return figures


def faulty(recording: Recording) -> dict[str, Recording]:
    """Return recordings with a fault each, about as large as what the checks let pass."""
    random = np.random.default_rng(0)
    time, q = recording.time, recording.position
    effort, qd = recording.effort, recording.velocity
    assert time is not None
    assert effort is not None
    assert qd is not None
    step = float(np.median(np.diff(time)))
    late = time + step * np.abs(random.normal(0.0, 0.3, len(time)))
    held = np.maximum.accumulate(np.where(random.random(len(time)) < 0.9, np.arange(len(time)), 0))
    lost = np.ones(len(time), dtype=bool)
    for first, count in ((500, 3), (900, 5), (1500, 40)):
        lost[first : first + count] = False
    most = 0.8 * np.abs(effort).max(axis=0)
    coarse = 0.07 * np.std(q, axis=0)
    wave = np.sin(2.0 * np.pi * 30.0 * time)[:, None] * 0.012 * effort.std(axis=0)
    return {
        "late": replace(recording, time=np.maximum.accumulate(late) + 1e-9 * np.arange(len(time))),
        "repeated": replace(recording, position=q[held], velocity=qd[held], effort=effort[held]),
        "lost": replace(
            recording, time=time[lost], position=q[lost], velocity=qd[lost], effort=effort[lost]
        ),
        "clipped": replace(recording, effort=np.clip(effort, -most, most)),
        "coarse": replace(recording, position=np.round(q / coarse) * coarse),
        "ripple": replace(recording, effort=effort + wave),
        "wrong velocity": replace(recording, velocity=1.04 * qd + 0.05 * qd.std(axis=0)),
        "late velocity": replace(recording, velocity=np.roll(qd, 1, axis=0)),
    }


def _errors(fit: Fit, other: Evaluation) -> Figures:
    mean = {
        name: float(np.mean([error.nrmse for error in joints.values()]))
        for name, joints in (("held-out", fit.held_out), ("another recording", other.joints))
    }
    known = fit.model.uncertainty
    assert known is not None
    wide = [0.5 * (p.ci95[1] - p.ci95[0]) for p in fit.parameters if p.identifiable]
    return {
        **{f"|e|/|tau|, {name}": value for name, value in mean.items()},
        "terms kept": sum(choice.kept for choice in fit.choices),
        "verdict": fit.verdict.level,
        "statements": len(fit.identifiability.statements),
        "warnings": sorted(str(warning) for warning in fit.warnings),
        "parameters called identifiable": len(wide),
        "uncertain directions": known.size,
        "known error": float(np.mean(known.error)),
        "mean logarithm of interval widths": float(np.mean(np.log(wide))),
    }


DIAGNOSIS, REFERENCE = (diagnosed,), (referenced,)
TRAJECTORY, POSES, CURRENTS = (identified,), (posed,), (in_amperes,)
READING = (read,)
CLASSES: tuple[tuple[type, tuple[Callable[[], Figures], ...]], ...] = (
    (SelectionSettings, DIAGNOSIS),
    (JudgementSettings, DIAGNOSIS),
    (SignificanceSettings, DIAGNOSIS),
    (FilterSettings, DIAGNOSIS),
    (BlockSettings, DIAGNOSIS),
    (LoadSettings, DIAGNOSIS),
    (FoldSettings, TRAJECTORY),
    (RobustSettings, TRAJECTORY),
    (TimingSettings, READING),
)


@contextmanager
def changed(settings: type, name: str, factor: float) -> Iterator[str]:
    """Multiply a threshold, ``field`` or ``field.field``, wherever its class has its default."""
    original = settings.__init__
    first, _, second = name.partition(".")
    value = getattr(settings(), first)
    value = (
        replace(value, **{second: scaled(getattr(value, second), factor)})
        if second
        else scaled(value, factor)
    )
    index = [field.name for field in fields(settings)].index(first)

    def init(self: Any, *given: Any, **named: Any) -> None:
        original(self, *given, **named)
        if len(given) <= index and first not in named:
            object.__setattr__(self, first, value)

    made = _constants(settings)
    before = [getattr(instance, first) for instance in made]
    settings.__init__ = init  # type: ignore[misc]
    for instance in made:
        object.__setattr__(instance, first, value)
    try:
        yield f"{getattr(value, second) if second else value}"
    finally:
        settings.__init__ = original  # type: ignore[misc]
        for instance, old in zip(made, before, strict=True):
            object.__setattr__(instance, first, old)


def _constants(settings: type) -> list[Any]:
    """Return what modules have made of a class when they were imported."""
    found = [
        value
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] == "dvrk_gravity"
        for value in vars(module).values()
        if type(value) is settings
    ]
    return list({id(value): value for value in found}.values())


def scaled(value: Any, factor: float) -> Any:
    """Return a threshold times a factor, a number of things at least one."""
    if isinstance(value, tuple):
        return tuple(scaled(part, factor) for part in value)
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


def thresholds(chosen: list[str] | None) -> list[tuple[int, str]]:
    """Return the index of the class and the name of every threshold that is a finite number."""
    known = {settings for settings, _ in CLASSES}
    found = []
    for number, (settings, _) in enumerate(CLASSES):
        if chosen and settings.__name__ not in chosen:
            continue
        for field in fields(settings):
            value = getattr(settings(), field.name)
            if is_number(value):
                found.append((number, field.name))
            elif is_dataclass(value) and (type(value) not in known or value != type(value)()):
                inner = [part.name for part in fields(value)]
                found += [
                    (number, f"{field.name}.{n}") for n in inner if is_number(getattr(value, n))
                ]
    return found


def is_number(value: Any) -> bool:
    """Tell whether a value is a finite number, or some."""
    numbers = value if isinstance(value, tuple) else (value,)
    return all(isinstance(x, int | float) and bool(np.isfinite(x)) for x in numbers)


def solve(number: int, name: str | None, factor: float) -> tuple[str, Figures]:
    """Solve the problems of a class of settings, one threshold changed; or none."""
    settings, problems = CLASSES[number]
    figures: Figures = {}
    if name is None:
        for problem in problems:
            figures |= problem()
        return "", figures
    try:
        with changed(settings, name, factor) as value:
            for problem in problems:
                figures |= problem()
    except Exception as error:
        return f"{factor}", {"failure": f"{type(error).__name__}: {error}"}
    return value, figures


def moved(before: Figures, after: Figures) -> list[str]:
    """Return in words what differs."""
    lines = []
    for name in sorted({*before, *after}):
        old, new = before.get(name), after.get(name)
        if isinstance(old, float) and isinstance(new, float):
            size = 1.0 if "logarithm" in name else abs(old)
            if abs(new - old) > MOVES * size:
                lines.append(f"{name} {old:.4g} -> {new:.4g}")
        elif old != new:
            lines.append(f"{name} {old} -> {new}")
    return lines


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--settings", nargs="*", help="only these classes")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    wanted = thresholds(given.settings)
    if not wanted:
        known = ", ".join(dict.fromkeys(settings.__name__ for settings, _ in CLASSES))
        parser.error(f"--settings {' '.join(given.settings)}: expected some of {known}")
    table, silent = [], []
    groups = {CLASSES[number][1]: number for number, _ in wanted}
    todo: list[tuple[int, str | None, float]] = [(n, None, 1.0) for n in groups.values()]
    todo += [(number, name, factor) for number, name in wanted for factor in (0.5, 2.0)]
    solved = dict(zip(todo, run_all(solve, todo, given.jobs), strict=True))
    for number, name in wanted:
        settings, problems = CLASSES[number]
        _, before = solved[groups[problems], None, 1.0]
        where = f"{settings.__module__.split('.', 1)[1]}.{settings.__name__}.{name}"
        anything = False
        for factor in (0.5, 2.0):
            value, after = solved[number, name, factor]
            differs = moved(before, after)
            anything |= bool(differs)
            table.append({"threshold": where, "value": value, "moved": differs})
            print(f"{where} = {value}: {'; '.join(differs) or 'nothing moves'}", flush=True)
        if not anything:
            silent.append(where)
    print(f"\nnothing reacts to: {', '.join(silent) or 'none'}")
    if given.json:
        given.json.write_text(json.dumps({"table": table, "silent": silent}, indent=1), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
