"""Errors of a model by joint, as reports show them: in a sentence, on the arm, in a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification import GOOD, POOR, JointError, JointVerdict, good_to, in_words
from dvrk_gravity.report import html
from dvrk_gravity.report.arm_drawing import Level, Remark
from dvrk_gravity.report.units import effort_in_table
from dvrk_gravity.units import percent, quantity


def level_of_verdict(verdict: str) -> Level:
    """Return the colour of one of ``model.VERDICTS``."""
    return "good" if verdict == GOOD else "poor" if verdict == POOR else "fair"


def verdict_in_short(level: str, verdicts: Mapping[str, JointVerdict]) -> str:
    """Return a verdict in words, with the joints that have it where it is not good.

    Args:
        level: One of ``model.VERDICTS``.
        verdicts: By joint.
    """
    named = [name for name, verdict in verdicts.items() if verdict.level == level != GOOD]
    return in_words(level) + (f" ({', '.join(named)})" if named else "")


def errors_in_short(errors: Mapping[str, JointError], arm: Arm) -> str:
    """Return the size of errors by joint in a clause: least to most of the torque, and where most.

    Args:
        errors: By joint, at least one.
        arm: The arm.
    """
    worst = max(errors, key=lambda name: errors[name].nrmse)
    least = min(error.nrmse for error in errors.values())
    most = errors[worst].nrmse
    unit = dict(zip(arm.joint_names, arm.effort_units, strict=True))[worst]
    size = f"{quantity(errors[worst].rmse, unit)} RMS"
    if len(errors) == 1:
        return f"{_percent(most)} % of the torque at {worst} ({size})"
    return f"{_percent(least)} to {_percent(most)} % of the torque, most at {worst} ({size})"


def _percent(part: float) -> str:
    """Return two digits, and all of those before the point."""
    return f"{100 * part:.2g}" if part < 0.995 else f"{100 * part:.0f}"


def error_remarks(
    errors: Mapping[str, JointError], verdicts: Mapping[str, JointVerdict]
) -> Iterator[Remark]:
    """Yield verdict and error of each joint, for the drawing of the arm."""
    for name, error in errors.items():
        verdict = verdicts[name]
        text = f"{verdict.words}, error {percent(error.nrmse)} of the torque"
        yield Remark(name, text, level_of_verdict(verdict.level))


def error_rows(
    errors: Mapping[str, JointError],
    arm: Arm,
    verdicts: Mapping[str, JointVerdict],
    more: Mapping[str, Mapping[str, str]] | None = None,
) -> str:
    """Return the table of errors by joint, with verdicts and what each is judged by.

    Args:
        errors: By joint.
        arm: The arm.
        verdicts: By joint.
        more: Further columns by their heading, each by joint; what is missing is left blank.
    """
    joints = {joint.name: joint for joint in arm.joints}
    effort, factor, decimals = effort_in_table(arm, [error.rmse for error in errors.values()])
    floors = {
        name: f"{factor * error.floor:.{decimals}f} ({error.over_floor:.1f} times)"
        for name, error in errors.items()
        if isfinite(error.floor)
    }
    more = {**({"noise alone": floors} if floors else {}), **(more or {})}
    head = ("joint", f"RMSE, {effort}", "|e|/|τ|", "R²", *more, "good to", "verdict")
    rows = [
        (
            name,
            f"{factor * error.rmse:.{decimals}f}",
            f"{error.nrmse:.3f}",
            f"{error.r2:.3f}",
            *(column.get(name, "") for column in more.values()),
            f"{good_to(joints[name]):.3f}",
            ": ".join(filter(None, (verdicts[name].words, verdicts[name].reason))),
        )
        for name, error in errors.items()
    ]
    return html.table(head, rows)
