"""Halve and double every threshold of estimation, and tell what moves.

    python benchmark/sensitivity.py --jobs 2
    python benchmark/sensitivity.py --settings SelectionSettings JudgementSettings

A fixed set of problems is solved with each threshold at half and at twice its value: effects hidden
in simulated arms and diagnosed, a simulated trajectory and simulated poses identified and evaluated
on others. What stays within a per cent of where it was is not shown; a threshold to which nothing
reacts is needless, or a bound that these problems do not reach.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from trials import trial

from dvrk_gravity.diagnosis.cross_validation import CrossValidationSettings
from dvrk_gravity.diagnosis.filtered_data import FilterSettings
from dvrk_gravity.diagnosis.held_out import JudgementSettings
from dvrk_gravity.diagnosis.selection import SelectionSettings as EffectSelectionSettings
from dvrk_gravity.estimation.covariance import CovarianceSettings
from dvrk_gravity.estimation.evidence import EvidenceSettings
from dvrk_gravity.estimation.noise import NoiseSettings
from dvrk_gravity.estimation.repetition import RepetitionSettings
from dvrk_gravity.estimation.robust import RobustSettings
from dvrk_gravity.estimation.splits import BlockSettings, FoldSettings, GridSettings
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.identification.design import DesignSettings
from dvrk_gravity.identification.hand import HandSettings
from dvrk_gravity.identification.holding import HoldingSettings
from dvrk_gravity.identification.identifiability import IdentifiabilitySettings
from dvrk_gravity.identification.kinematic_calibration import KinematicSettings
from dvrk_gravity.identification.kinematic_search import KinematicSearchSettings
from dvrk_gravity.identification.kinematic_statements import KinematicStatementSettings
from dvrk_gravity.identification.problem import WeightSettings
from dvrk_gravity.identification.selection import SelectionSettings as TermSelectionSettings
from dvrk_gravity.identification.static_columns import PoseColumnSettings
from dvrk_gravity.identification.static_poses import PosedSettings
from dvrk_gravity.identification.static_report import PoseReportSettings
from dvrk_gravity.identification.static_selection import PoseSelectionSettings
from dvrk_gravity.identification.static_solver import PoseSettings
from dvrk_gravity.identification.verdict import VerdictSettings
from dvrk_gravity.recording.checks import CheckSettings
from dvrk_gravity.recording.gaps import LossSettings
from dvrk_gravity.recording.grid import TimingSettings
from dvrk_gravity.recording.quantization import QuantumSettings
from dvrk_gravity.recording.sample_times import RetimingSettings
from dvrk_gravity.recording.signal_checks import SignalSettings
from dvrk_gravity.recording.velocity import ComparisonSettings
from testing.world import World

# (seed, what is hidden) of benchmark/trials.py
HIDDEN = (
    (0, ("nothing",)),
    (1, ("rotor_inertia",)),
    (2, ("contact",)),
    (3, ("presliding_hysteresis", "base_tilt")),
)
ARM = 7  # seed of the arm that is identified
MOVES = 0.01  # of a figure: less is not shown
Figures = dict[str, Any]


def diagnosed() -> Figures:
    """Return what is found of what was hidden."""
    found: Figures = {}
    for seed, effects in HIDDEN:
        outcome = trial(seed, effects)
        name = "+".join(effects)
        joints = (" ".join(one) for one in outcome.found_joints)
        pairs = zip(outcome.found, joints, strict=True)
        found[f"{name}: findings"] = sorted(f"{effect} {joint}" for effect, joint in pairs)
        if outcome.failure:
            found[f"{name}: failure"] = outcome.failure.strip().splitlines()[-1]
        for parameter, inside in outcome.inside.items():
            found[f"{name}: {parameter} within 10 % or its interval"] = inside
    return found


def identified() -> Figures:
    """Return the errors of a model of a trajectory, on what it saw not and on another motion."""
    world = World.draw(ARM)
    fit = identify(world.record(1, 2), world.arm)
    return _errors(fit, evaluate(fit.model, world.record(3, 4)))


def posed() -> Figures:
    """Return the same of static poses."""
    world = World.draw(ARM)
    fit = identify(world.record_poses(1, 2), world.arm)
    return _errors(fit, evaluate(fit.model, world.record_poses(3, 4)))


def _errors(fit: Any, other: Any) -> Figures:
    mean = {
        name: float(np.mean([error.nrmse for error in joints.values()]))
        for name, joints in (("held-out", fit.held_out), ("another recording", other.joints))
    }
    wide = [0.5 * (p.ci95[1] - p.ci95[0]) for p in fit.parameters if p.identifiable]
    return {
        **{f"|e|/|tau|, {name}": value for name, value in mean.items()},
        "terms kept": sum(choice.kept for choice in fit.choices),
        "verdict": fit.verdict.level,
        "statements": len(fit.identifiability.statements),
        "warnings": sorted(str(warning) for warning in fit.warnings),
        "parameters called identifiable": len(wide),
        "mean logarithm of interval widths": float(np.mean(np.log(wide))),
    }


DIAGNOSIS, TRAJECTORY, POSES = (diagnosed,), (identified,), (posed,)
CLASSES: tuple[tuple[type, tuple[Callable[[], Figures], ...]], ...] = (
    (EffectSelectionSettings, DIAGNOSIS),
    (JudgementSettings, DIAGNOSIS),
    (CrossValidationSettings, DIAGNOSIS),
    (FilterSettings, DIAGNOSIS),
    (BlockSettings, DIAGNOSIS),
    (EvidenceSettings, DIAGNOSIS),
    (RepetitionSettings, DIAGNOSIS + TRAJECTORY),
    (NoiseSettings, DIAGNOSIS + TRAJECTORY),
    (FoldSettings, TRAJECTORY),
    (CovarianceSettings, TRAJECTORY),
    (TermSelectionSettings, TRAJECTORY),
    (DesignSettings, TRAJECTORY),
    (WeightSettings, TRAJECTORY),
    (KinematicSettings, TRAJECTORY),
    (KinematicSearchSettings, TRAJECTORY),
    (KinematicStatementSettings, TRAJECTORY),
    (IdentifiabilitySettings, TRAJECTORY),
    (TimingSettings, TRAJECTORY),
    (RetimingSettings, TRAJECTORY),
    (ComparisonSettings, TRAJECTORY),
    (LossSettings, TRAJECTORY),
    (CheckSettings, TRAJECTORY + POSES),
    (SignalSettings, TRAJECTORY + POSES),
    (QuantumSettings, TRAJECTORY + POSES),
    (RobustSettings, TRAJECTORY + POSES),
    (HoldingSettings, TRAJECTORY + POSES),
    (HandSettings, TRAJECTORY + POSES),
    (VerdictSettings, TRAJECTORY + POSES),
    (PoseSettings, POSES),
    (PosedSettings, POSES),
    (PoseColumnSettings, POSES),
    (PoseReportSettings, POSES),
    (PoseSelectionSettings, POSES),
    (GridSettings, POSES),
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
    place = [one.name for one in fields(settings)].index(first)

    def init(self: Any, *given: Any, **named: Any) -> None:
        original(self, *given, **named)
        if len(given) <= place and first not in named:
            object.__setattr__(self, first, value)

    settings.__init__ = init  # type: ignore[misc]
    try:
        yield f"{getattr(value, second) if second else value}"
    finally:
        settings.__init__ = original  # type: ignore[misc]


def scaled(value: Any, factor: float) -> Any:
    """Return a threshold times a factor, a number of things at least one."""
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


def thresholds(chosen: list[str] | None) -> list[tuple[int, str]]:
    """Return the index of the class and the name of every threshold that is a finite number."""
    known = {settings for settings, _ in CLASSES}
    found = []
    for number, (settings, _) in enumerate(CLASSES):
        if chosen and settings.__name__ not in chosen:
            continue
        for one in fields(settings):
            value = getattr(settings(), one.name)
            if is_number(value):
                found.append((number, one.name))
            elif is_dataclass(value) and (type(value) not in known or value != type(value)()):
                inner = [part.name for part in fields(value)]
                found += [
                    (number, f"{one.name}.{n}") for n in inner if is_number(getattr(value, n))
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
    with ProcessPoolExecutor(given.jobs) as pool:
        groups = {CLASSES[number][1]: number for number, _ in wanted}
        plain = {group: pool.submit(solve, number, None, 1.0) for group, number in groups.items()}
        runs = [
            (number, name, [pool.submit(solve, number, name, factor) for factor in (0.5, 2.0)])
            for number, name in wanted
        ]
        for number, name, halves in runs:
            settings, problems = CLASSES[number]
            _, before = plain[problems].result()
            where = f"{settings.__module__.split('.', 1)[1]}.{settings.__name__}.{name}"
            anything = False
            for half in halves:
                value, after = half.result()
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
