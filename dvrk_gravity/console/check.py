"""What is wrong with a dVRK console's calibration file, before it meets an arm."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import GRAVITY, JOINT_NAMES, Arm
from dvrk_gravity.console.answer import Answer, answer
from dvrk_gravity.console.file import (
    FILE_NAME,
    SECTION,
    ConsoleFile,
    field_problems,
    with_arm,
)
from dvrk_gravity.console.finding import ConsoleFinding, Severity
from dvrk_gravity.console.model_check import check_model
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file

# beta6, the platform's moment across the arm: +0.020 on right arms, -0.020 on left ones, kg·m.
BETA6 = 0.020
_BETA6 = 5
_DATA_OF = re.compile(r"(MTM[LR])[_-](\d+)")
_OTHER = {"mtml": "mtmr", "mtmr": "mtml"}


@dataclass(frozen=True)
class Checked:
    """A checked file.

    Attributes:
        findings: What is wrong with it, the serious findings first.
        answer: Whether it can be used.
    """

    findings: tuple[ConsoleFinding, ...]
    answer: Answer


def check_file(path: str | Path) -> Checked:
    """Return what is wrong with a console file, and whether it can be used.

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
                continue  # that file's own check tells what is wrong with it
    findings = [
        *(_text(oddity) for oddity in oddities),
        *_name(document, Path(path).name), *check(document), *_copies(document, others),
    ]  # fmt: skip
    order = list(Severity)
    found = tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))
    return Checked(found, answer(found, document, path))


def check(document: Mapping[str, Any]) -> Iterator[ConsoleFinding]:
    """Yield what is wrong with a file's content, taken by itself."""
    problems = list(field_problems(document))
    for problem in problems:
        yield ConsoleFinding("field", Severity.SERIOUS, problem.field, str(problem))
    if problems:
        return
    console = ConsoleFile.from_document(document)
    arm = Arm.load(console.arm)
    yield from _console_quirks(console)
    yield from _hand(console, arm)
    yield from _limits(console, arm)
    try:
        model = console.model()
    except ConfigError as error:
        yield ConsoleFinding("gravity_differs", Severity.SERIOUS, error.field, str(error))
        return
    yield from check_model(console, model)


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
            "its blend follows the sine on instead of staying full"
        )
        yield ConsoleFinding("version_1", Severity.WARNING, "version", text)
    if console.lower is None:
        text = "no joint_position_lower/upper_limit: the calibrated range is not known"
        yield ConsoleFinding("no_range", Severity.WARNING, SECTION, text)


def _hand(console: ConsoleFile, arm: Arm) -> Iterator[ConsoleFinding]:
    """Yield signs and ranges that belong to the arm of the other hand."""
    expected = BETA6 if console.arm == "mtmr" else -BETA6
    beta6 = float(console.positive[_BETA6])
    if beta6 * expected < 0 and abs(beta6) > 0.5 * BETA6:
        text = f"beta6 is {beta6:+.4f} kg·m, about {expected:+.3f} on an {console.arm.upper()}"
        yield ConsoleFinding("other_hand", Severity.SERIOUS, "beta6", text, {"beta6_kg_m": beta6})
    if console.lower is None or console.upper is None:
        return
    slack = np.radians(1.0)
    mirror = Arm.load(_OTHER[console.arm])
    for i, joint in enumerate(JOINT_NAMES):
        low, high = console.lower[i], console.upper[i]
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
