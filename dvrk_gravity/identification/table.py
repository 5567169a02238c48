"""Fits and evaluations as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification.evaluation import Evaluation
from dvrk_gravity.identification.result import Fit, JointError, JointVerdict, Verdict, in_short
from dvrk_gravity.identification.verdict import compared
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import brief


def error_table(
    joints: Mapping[str, JointError], arm: Arm, verdict: Verdict | None = None
) -> Iterator[str]:
    """Yield the lines of a table of errors by joint, with the verdict on each if there is one."""
    width = max(16, 2 + max(map(len, joints)))
    units = dict(zip(arm.joint_names, arm.effort_units, strict=True))
    head = f"RMSE {arm.effort_units[0]}"
    yield f"{'joint':<{width}}{head:>10}{'|e|/|tau|':>11}{'R2':>9}" + "  verdict" * bool(verdict)
    for name, error in joints.items():
        judged = f"  {verdict.joints[name].words}" if verdict else ""
        # Told only where it is not the table's.
        other = f"  (RMSE in {units[name]})" if units[name] != arm.effort_units[0] else ""
        numbers = f"{error.rmse:>10.4f}{error.nrmse:>11.3f}{error.r2:>9.3f}"
        yield f"{name:<{width}}{numbers}{judged}{other}"


def verdict_text(verdict: Verdict) -> Iterator[str]:
    """Yield the lines that tell a verdict: why, and what to record instead."""
    yield f"verdict: {verdict.words}"
    short: dict[JointVerdict, list[str]] = {}
    for name, joint_verdict in verdict.joints.items():
        if joint_verdict.record:
            short.setdefault(joint_verdict, []).append(name)
    for joint_verdict, names in short.items():
        yield f"  {', '.join(names)}: {joint_verdict.words}: {joint_verdict.reason}"
    for record in dict.fromkeys(joint_verdict.record for joint_verdict in short):
        yield f"  record instead: {record}"


def fit_text(fit: Fit) -> Iterator[str]:
    """Yield the lines that a terminal shows after an identification."""
    yield from fit.verdict.findings
    for line in brief(fit.warnings):
        yield f"warning: {line}"
    for line in fit.handling:
        yield f"data: {line}"
    yield ""
    yield f"{fit.samples} samples, errors in {fit.coordinates} coordinates"
    yield f"held out: {fit.validation}"
    yield from error_table(fit.held_out, fit.model.arm, fit.verdict)
    yield from verdict_text(fit.verdict)
    yield ""
    kept = [choice for choice in fit.choices if choice.kept]
    rejected = [choice for choice in fit.choices if not choice.kept]
    added = [choice for choice in kept if choice.added]
    for choice in added:
        yield f"  {choice.term}: {choice.reason}"
    if len(kept) > len(added):
        yield f"  taken out again of what the search started with: {len(kept) - len(added)}"
    if rejected:
        yield f"  {len(rejected)} further changes were tried and do too little (all in the report)"
    found = fit.identifiability
    yield ""
    yield found.sentence
    for statement in found.statements:
        yield f"  {statement}"


def evaluation_text(result: Evaluation, model: TorqueModel) -> Iterator[str]:
    """Yield the lines that a terminal shows after the evaluation of a model."""
    for line in brief(result.warnings):
        yield f"warning: {line}"
    if result.detected:
        yield result.detected
    for line in result.handling:
        yield f"data: {line}"
    for line in result.outside:
        yield f"{line}: extrapolated there"
    yield f"{result.samples} samples, errors in {result.coordinates} coordinates"
    yield from error_table(result.joints, model.arm)
    if len(result.recordings) > 1:
        yield from (
            f"{label}: |e|/|tau| {in_short(joints)}" for label, joints in result.recordings.items()
        )
    yield compared(model, result.joints, result.coordinates, result.with_friction)
    if result.outside:
        yield "outside its range errors say little of a model: identify from recordings there, too"
