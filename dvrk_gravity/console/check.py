"""What is wrong with a dVRK console's calibration file, before it meets an arm."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import GRAVITY, JOINT_NAMES, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.console.answer import Answer, ConsoleFinding, Severity, answer
from dvrk_gravity.console.file import (
    FILE_NAME,
    SECTION,
    ConsoleFile,
    field_problems,
    sample_torques,
    with_arm,
)
from dvrk_gravity.effects import evaluate
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file
from dvrk_gravity.model import TorqueModel


@dataclass(frozen=True)
class ModelCheckSettings:
    """Thresholds of the model's check. Chosen, but for the last.

    Attributes:
        tolerance: A limit counts as exceeded when the model passes it by more than this, N·m.
        serious_share: Clipping on more than this part of poses is more than a rare corner of the
            range.
        unusual_growth: A polynomial's torque outside its range is reported from this many times its
            torque inside…
        notable_growth: … and from this part of the joint's largest torque on,
        serious_growth: and is serious from this part on.
        wide: A limit that is wider than this many times what the model ever asks for protects
            nothing.
        pair_range: 9.81 beta1 + k2 over sixteen real arms, N·m/rad.
    """

    tolerance: float = 0.001
    serious_share: float = 0.05
    unusual_growth: float = 1.5
    notable_growth: float = 0.05
    serious_growth: float = 0.25
    wide: float = 3.0
    pair_range: tuple[float, float] = (0.30, 0.67)


SETTINGS = ModelCheckSettings()

_K2 = 16  # place of joint 2's linear coefficient among the console's parameters


def _clipping(console: ConsoleFile, model: TorqueModel) -> Iterator[ConsoleFinding]:
    """Yield safe limits that the model passes inside its range, or never comes near."""
    torques = sample_torques(model)
    over = np.maximum(torques - console.safe_upper, console.safe_lower - torques)
    for i, joint in enumerate(JOINT_NAMES):
        share = float((over[..., i] > SETTINGS.tolerance).any(axis=0).mean())
        low, high = float(console.safe_lower[i]), float(console.safe_upper[i])
        least, most = float(torques[..., i].min()), float(torques[..., i].max())
        span = f"safe limits {low:g} … {high:g} N·m"
        numbers = {"share": share, "least_Nm": least, "most_Nm": most}
        if share > 0:
            motion, pose = np.unravel_index(int(over[..., i].argmax()), over.shape[:2])
            worst = float(torques[motion, pose, i])
            text = f"{span} clip the model on {100 * share:.1f} % of poses (worst: {worst:.3f} N·m)"
            severity = Severity.SERIOUS if share > SETTINGS.serious_share else Severity.WARNING
            found = {**numbers, "worst_Nm": worst}
            yield ConsoleFinding("limits_clip", severity, joint, text, found)
        elif (
            SETTINGS.wide * (most - least) + 2 * SETTINGS.tolerance
            < high - low
            <= 2 * model.arm.effort_limit[i]
        ):
            text = f"{span}, but the model asks for {least:.3f} … {most:.3f}"
            yield ConsoleFinding("limits_wide", Severity.WARNING, joint, text, numbers)


def _growth(console: ConsoleFile, model: TorqueModel) -> Iterator[ConsoleFinding]:
    """Yield joints whose polynomials grow outside the calibrated range, as the console has them."""
    arm, polynomials = model.arm, console.polynomials
    q = np.linspace(arm.lower, arm.upper, 2001)
    held = console.valid.hold(q)
    # Joint 2's linear column is only half of a pair; beta1 and beta2 hold the other half.
    growth = np.zeros(len(JOINT_NAMES))
    inside = np.zeros(len(JOINT_NAMES))
    for coefficients in (polynomials.positive, polynomials.negative):
        value, edge = (_own_torque(console, coefficients, x) for x in (q, held))
        growth = np.maximum(growth, np.abs(value - edge).max(axis=0))
        inside = np.maximum(inside, np.ptp(edge, axis=0))
    for i, joint in enumerate(JOINT_NAMES):
        if growth[i] <= max(
            SETTINGS.unusual_growth * inside[i], SETTINGS.notable_growth * arm.effort_limit[i]
        ):
            continue
        severe = growth[i] > SETTINGS.serious_growth * arm.effort_limit[i]
        edges = np.degrees([console.valid.lower[i], console.valid.upper[i]])
        text = (
            f"outside {edges[0]:.0f} … {edges[1]:.0f} deg the torque grows by {growth[i]:.2f} N·m; "
            f"inside, it varies by {inside[i]:.2f}"
        )
        numbers = {"growth_Nm": float(growth[i]), "inside_Nm": float(inside[i])}
        severity = Severity.SERIOUS if severe else Severity.WARNING
        yield ConsoleFinding("growth", severity, joint, text, numbers)


def _own_torque(console: ConsoleFile, coefficients: Array, q: Array) -> Array:
    """Return (N, 7) torques that depend on the joint's own position alone, N·m."""
    torque = evaluate(coefficients, q)
    beta1, beta2 = console.positive[:2] * GRAVITY
    torque[:, 1] += beta1 * np.sin(q[:, 1]) + beta2 * np.cos(q[:, 1])
    return torque


def _pair(console: ConsoleFile, model: TorqueModel) -> Iterator[ConsoleFinding]:
    """Yield what the file knows of beta1 and joint 2's linear column: only their sum."""
    gravity = GRAVITY * float(console.positive[0])
    linear = np.array([console.positive[_K2], console.negative[_K2]])
    if not linear.any():
        return
    sums = gravity + linear
    # Held at the edge, the linear column stops there while beta1's sine goes on.
    q = np.linspace(model.arm.lower, model.arm.upper, 2001)
    held = console.valid.hold(q)
    growth = float(np.abs(gravity * (np.sin(q) - np.sin(held)))[:, 1].max())
    text = (
        f"9.81 beta1 = {gravity:.2f} and k2 = {linear[0]:.2f}/{linear[1]:.2f} (up/down): only "
        f"their sum {sums[0]:.3f}/{sums[1]:.3f} N·m/rad was determined"
    )
    severity = Severity.NOTE
    if min(abs(gravity), np.abs(linear).min()) > 2 * np.abs(sums).max():
        severity = Severity.WARNING
        text += "; the two cancel"
    if growth > SETTINGS.serious_growth * model.arm.effort_limit[1]:
        severity = Severity.SERIOUS
        text += f"; with k2 held at the edge of its range, beta1 alone adds {growth:.2f} N·m"
    numbers = {
        "gravity_Nm": gravity, "positive_Nm_rad": float(sums[0]),
        "negative_Nm_rad": float(sums[1]), "held_growth_Nm": growth,
    }  # fmt: skip
    yield ConsoleFinding("pair", severity, JOINT_NAMES[1], text, numbers)
    low, high = SETTINGS.pair_range
    if not low <= round(sums.min(), 2) or not round(sums.max(), 2) <= high:
        text = (
            f"9.81 beta1 + k2 is {sums[0]:.3f}/{sums[1]:.3f} N·m/rad, {low:.2f} … {high:.2f} usual"
        )
        yield ConsoleFinding("pair_sum", Severity.WARNING, JOINT_NAMES[1], text, numbers)


# beta6, the platform's moment across the arm: +0.020 on right arms, -0.020 on left ones, kg·m.
BETA6 = 0.020
_BETA6 = 5
_DATA_OF = re.compile(r"(MTM[LR])[_-](\d+)")
_OTHER = {"mtml": "mtmr", "mtmr": "mtml"}


@dataclass(frozen=True)
class CheckResult:
    """A checked file.

    Attributes:
        findings: What is wrong with it, the serious findings first.
        answer: Whether it can be used.
    """

    findings: tuple[ConsoleFinding, ...]
    answer: Answer


def check_file(path: str | Path) -> CheckResult:
    """Return the findings on a console file, and whether it can be used.

    Args:
        path: The file; the other ``gc-*.json`` in its folder are read to find copies.

    Raises:
        ConfigError: The file cannot be read as JSON, or is another one of the console's.
    """
    content, oddities = json_file.load_with_oddities(path, finite=False)
    document = with_arm(content, path)
    others = {}
    for other in sorted(Path(path).parent.glob("gc-*.json")):
        if other.name != Path(path).name:
            try:
                others[other.name] = json_file.load(other)
            except ConfigError:
                continue  # that file's own check reports its faults
    findings = [
        *(_text(oddity) for oddity in oddities),
        *_name(document, Path(path).name), *check(document), *_copies(document, others),
    ]  # fmt: skip
    order = list(Severity)
    found = tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))
    return CheckResult(found, answer(found, document, path))


def check(document: Mapping[str, Any]) -> Iterator[ConsoleFinding]:
    """Yield findings on a file's content, taken by itself."""
    problems = list(field_problems(document))
    for problem in problems:
        yield ConsoleFinding("field", Severity.SERIOUS, problem.field, str(problem))
    if problems:
        return
    console = ConsoleFile.from_document(document)
    arm = Arm.load(console.arm)
    yield from _console_quirks(console)
    yield from _wrong_side(console, arm)
    yield from _limits(console, arm)
    try:
        model = console.model()
    except ConfigError as error:
        yield ConsoleFinding("gravity_differs", Severity.SERIOUS, error.field, str(error))
        return
    yield from _clipping(console, model)
    yield from _growth(console, model)
    yield from _pair(console, model)


def _text(oddity: json_file.Oddity) -> ConsoleFinding:
    """Return the finding about text that is no JSON."""
    severity = Severity.SERIOUS if oddity.refused else Severity.WARNING
    why = ": the console does not read such a file" if oddity.refused else ""
    return ConsoleFinding("text", severity, "text", oddity.text + why)


def _name(document: Mapping[str, Any], name: str) -> Iterator[ConsoleFinding]:
    match = FILE_NAME.fullmatch(name)
    if match is None:
        text = f"file name {name}: the console's is gc-<ARM>-<serial number>.json"
        yield ConsoleFinding("file_name", Severity.WARNING, "file name", text)
        return
    for entry, part in (("ARM_NAME", "arm"), ("SN", "serial")):
        if entry in document and str(document[entry]) != match[part]:
            text = f"{entry} is {document[entry]!r}, but the file is named for {match[part]}"
            yield ConsoleFinding("file_name", Severity.SERIOUS, entry, text)
    for entry, value in document.items():
        for arm, serial in _DATA_OF.findall(value) if isinstance(value, str) else ():
            if (arm, serial) != (match["arm"], match["serial"]):
                text = f"{value!r}: the parameters may come from {arm} {serial}'s data"
                yield ConsoleFinding("other_data", Severity.WARNING, entry, text)


def _copies(
    document: Mapping[str, Any], others: Mapping[str, Mapping[str, Any]]
) -> Iterator[ConsoleFinding]:
    def parameters(content: Mapping[str, Any]) -> Any:
        section = content.get(SECTION)
        names = ("gc_dynamic_params_pos", "gc_dynamic_params_neg")
        return [section.get(name) for name in names] if isinstance(section, dict) else None

    own = parameters(document)
    if own is None or None in own:
        return
    for name, other in others.items():
        if parameters(other) == own and other.get("SN") != document.get("SN"):
            text = f"all parameters are those of {name}: one of the two arms was never calibrated"
            yield ConsoleFinding("copy", Severity.SERIOUS, name, text)


def _console_quirks(console: ConsoleFile) -> Iterator[ConsoleFinding]:
    lse = console.document.get("lse")
    g = lse.get("g_constant") if isinstance(lse, dict) else None
    if isinstance(g, int | float) and abs(g - GRAVITY) > 0.005:
        text = f"g_constant {g:g}, but the console always multiplies by {GRAVITY}"
        yield ConsoleFinding("g_constant", Severity.SERIOUS, "lse.g_constant", text, {"g_m_s2": g})
    if console.version == 1:
        text = (
            "version 1.0: the console asks for a new calibration, and above beta_vel_amplitude "
            "its blend falls again with the sine instead of staying full"
        )
        yield ConsoleFinding("version_1", Severity.WARNING, "version", text)
    if np.isinf(console.valid.lower).any():
        text = "no joint_position_lower/upper_limit: the calibrated range is not known"
        yield ConsoleFinding("no_range", Severity.WARNING, SECTION, text)


def _wrong_side(console: ConsoleFile, arm: Arm) -> Iterator[ConsoleFinding]:
    """Yield signs and ranges of the arm of the other side."""
    expected = BETA6 if console.arm == "mtmr" else -BETA6
    beta6 = float(console.positive[_BETA6])
    if beta6 * expected < 0 and abs(beta6) > 0.5 * BETA6:
        name = console.arm.upper()
        text = f"beta6 is {beta6:+.4f} kg·m, expected about {expected:+.3f} on an {name}"
        yield ConsoleFinding("other_hand", Severity.SERIOUS, "beta6", text, {"beta6_kg_m": beta6})
    if np.isinf(console.valid.lower).any():
        return
    slack = np.radians(1.0)
    mirror = Arm.load(_OTHER[console.arm])
    for i, joint in enumerate(JOINT_NAMES):
        low, high = console.valid.lower[i], console.valid.upper[i]
        if arm.lower[i] - slack <= low and high <= arm.upper[i] + slack:
            continue
        fits = mirror.lower[i] - slack <= low and high <= mirror.upper[i] + slack
        hand = f"; it fits an {mirror.name.upper()}" if fits else ""
        edges = np.degrees([low, high, arm.lower[i], arm.upper[i]])
        text = "calibrated from {:.0f} to {:.0f} deg, but the joint goes from {:.0f} to {:.0f}"
        numbers = {"lower_deg": float(edges[0]), "upper_deg": float(edges[1])}
        code = "other_hand" if fits else "range"
        yield ConsoleFinding(code, Severity.SERIOUS, joint, text.format(*edges) + hand, numbers)


def _limits(console: ConsoleFile, arm: Arm) -> Iterator[ConsoleFinding]:
    """Yield safe limits that make no sense whatever the model is."""
    for i, joint in enumerate(JOINT_NAMES):
        low, high = float(console.safe_lower[i]), float(console.safe_upper[i])
        numbers = {"lower_Nm": low, "upper_Nm": high}
        span = f"safe limits {low:g} … {high:g} N·m"
        most = float(arm.effort_limit[i])
        if low > high:
            text = f"{span}: the lower one is above the upper one"
            yield ConsoleFinding("limits_reversed", Severity.SERIOUS, joint, text, numbers)
        elif low > 0 or high < 0:
            text = f"{span} exclude zero: the joint is pushed even where the model asks for nothing"
            yield ConsoleFinding("limits_exclude_zero", Severity.WARNING, joint, text, numbers)
        if max(abs(low), abs(high)) > most:
            text = f"{span}: the actuator gives {most:g} N·m, so they protect nothing"
            yield ConsoleFinding("limits_beyond_actuator", Severity.SERIOUS, joint, text, numbers)
