"""What a check of a console's calibration file found, and whether the file is usable."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import GRAVITY
from dvrk_gravity.console.file import ARMS, ConsoleFile, safe_limits


class Severity(StrEnum):
    """How much a finding matters."""

    SERIOUS = "serious"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True)
class ConsoleFinding:
    """One thing that is wrong, or worth knowing, about a console file.

    Attributes:
        code: Kind of the finding, one word.
        severity: How much it matters.
        subject: Joint or field.
        numbers: The numbers behind it, by name; the unit ends the name.
        text: All of it in one line.
    """

    code: str
    severity: Severity
    subject: str
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict)


class Use(StrEnum):
    """What may be done with a file."""

    USABLE = "usable"
    REPAIR = "repair this"
    NOT = "do not use"


@dataclass(frozen=True)
class Answer:
    """The answer of a check.

    Attributes:
        use: What may be done with the file.
        reason: Why, in a line; ``""`` of a usable one.
        todo: What to do, in lines.
        of_model: Whether the reason is in what a model takes over, too; safe limits are not.
    """

    use: Use
    reason: str
    todo: tuple[str, ...]
    of_model: bool = False


_AGAIN = (
    "calibrate this arm: record it, then `identify RECORDING --arm {arm} --for console --out "
    "model.yaml` and `convert model.yaml {file}`"
)
# Parameters that are not this arm's, or that no edit makes right, and why.
_NOT = {
    "other_hand": "parameters of the other arm",
    "copy": "parameters of another arm",
    "file_name": "it may be another arm's",
    "range": "calibrated where the joint cannot go",
    "gravity_differs": "two gravities in one file",
    "pair": "wrong by up to {held_growth_Nm:.2g} N·m beyond shoulder_pitch's calibrated range",
}
_FIND_OUT = "find out which arm the parameters are of, and correct the name that is wrong; or "


def answer(
    findings: Sequence[ConsoleFinding], document: Mapping[str, Any], path: str | Path
) -> Answer:
    """Return whether a file can be used, by what a check has found in it.

    What grows outside the calibrated range keeps no file from being used: in the console the safe
    limits bound it, where they are sound, and the compensator holds it at the edge.

    Args:
        findings: Of the check.
        document: The file's content.
        path: The file.
    """
    serious = [finding for finding in findings if finding.severity is Severity.SERIOUS]
    wrong = [finding for finding in serious if finding.code in _NOT]
    if wrong:
        reasons = (_NOT[finding.code].format(**finding.numbers) for finding in wrong)
        reason = "; ".join(dict.fromkeys(reasons))
        arm = ARMS.get(str(document.get("ARM_NAME")), "ARM")
        again = _AGAIN.format(arm=arm, file=Path(path).name)
        named = any(finding.code == "file_name" for finding in wrong)
        return Answer(Use.NOT, reason, ((_FIND_OUT if named else "") + again,), of_model=True)
    repairs = list(_repairs(serious, document))
    caution = list(_cautions(findings))
    if repairs:
        why = dict.fromkeys(_WHAT[finding.code] for finding in serious if finding.code in _WHAT)
        scaled = any(finding.code == "g_constant" for finding in serious)
        return Answer(Use.REPAIR, "; ".join(why), (*repairs, *caution), of_model=scaled)
    return Answer(Use.USABLE, "", tuple(caution))


_WHAT = {
    "text": "the console does not read it",
    "field": "fields that neither the console nor a model can use",
    "g_constant": "another gravity than the console's",
    "limits_clip": "safe limits clip the model",
    "limits_reversed": "safe limits upside down",
    "limits_beyond_actuator": "safe limits that protect nothing",
}


def _repairs(serious: Sequence[ConsoleFinding], document: Mapping[str, Any]) -> Iterator[str]:
    """Yield what to change in a file, where that is enough."""
    for finding in serious:
        if finding.code == "text":
            yield f"take it out: {finding.text.partition(':')[0]} ({finding.text.split(': ')[1]})"
        elif finding.code == "field":
            yield f"correct {finding.text}"
        elif finding.code == "g_constant":
            factor = finding.numbers["g_m_s2"] / GRAVITY
            yield (
                f"multiply the first ten of gc_dynamic_params_pos and _neg by {factor:.6g}, and "
                f"set lse.g_constant to {GRAVITY}"
            )
    if any(finding.code.startswith("limits_") for finding in serious):
        yield "insert these safe limits (the model's torques within its range, 10 % wider):"
        lower, upper = safe_limits(ConsoleFile.from_document(document).model())
        for name, values, rounded in (("upper", upper, np.ceil), ("lower", lower, np.floor)):
            shown = [float(value) for value in rounded(1e4 * values) / 1e4 + 0.0]
            yield f'   "safe_{name}_torque_limit": {json.dumps(shown)},'
        yield "`convert` to a model ignores safe limits: no repair is needed for it"


def _cautions(findings: Sequence[ConsoleFinding]) -> Iterator[str]:
    """Yield what to mind about a file that can be used."""
    joints = [finding.subject for finding in findings if finding.code == "growth"]
    if joints:
        yield (
            f"keep {', '.join(dict.fromkeys(joints))} within the calibrated range, or use the file "
            "through `convert` and `compensator`, which holds the polynomials at its edge"
        )
    for finding in findings:
        if finding.code == "other_data":
            yield f"make sure that the parameters are this arm's ({finding.text})"
    old = [finding for finding in findings if finding.code in ("version_1", "no_range")]
    if old:
        why = ", ".join(finding.text.partition(":")[0] for finding in old)
        yield f"calibrate again when there is time ({why})"
