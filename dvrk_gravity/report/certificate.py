"""A certificate as one HTML page, for a lab's log."""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import Certificate, JointCertificate, Moved, shown_drift
from dvrk_gravity.identification import Evaluation, in_words
from dvrk_gravity.report import html
from dvrk_gravity.report.arm_drawing import Remark, drawn_arm
from dvrk_gravity.report.fit_tables import level_of_verdict
from dvrk_gravity.report.page import page
from dvrk_gravity.report.units import effort_in_picture, effort_in_table
from dvrk_gravity.units import interval, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MEASURED, _PREDICTED, _DIFFERENCE = "#7f8fa6", "#c0392b", "#2c3e50"
_SHOWN = 15.0  # s of the held-out motion
_MOST = 7  # sentences of a list; the others are in the files
_COLUMNS = 4


def certificate_page(certificate: Certificate, evaluation: Evaluation, arm: Arm) -> str:
    """Return the certificate's HTML, complete in itself; every text in it is escaped.

    Args:
        certificate: What is certified.
        evaluation: The model on the second motion.
        arm: The arm.
    """
    verdict = certificate.verdict
    facts = (
        f"{certificate.arm} at {certificate.namespace}; {certificate.date}. The compensator's "
        f"model is {certificate.model}."
    )
    return page(
        f"Calibration of {certificate.arm}", verdict[:1].upper() + verdict[1:] + ".", facts,
        _parts(certificate, evaluation, arm), "good" if certificate.certified else "poor",
    )  # fmt: skip


def _parts(certificate: Certificate, evaluation: Evaluation, arm: Arm) -> Iterator[str]:
    if certificate.simulated:
        yield (
            f'<p class="poor">Simulated: {escape(certificate.simulated)}. This is not the '
            "certificate of an arm.</p>"
        )
    yield drawn_arm(arm, [_remark(joint) for joint in certificate.joints])
    yield html.picture(
        html.inline(_picture(evaluation, arm), dpi=100),
        "measured and predicted effort of the second motion",
    )
    yield "<h2>By joint</h2>"
    yield _by_joint(certificate, arm)
    yield "<h2>What stays unknown</h2>"
    yield html.listed(_some(certificate.unknown), "nothing that was looked for")
    yield "<h2>What the diagnosis found beside the first model</h2>"
    yield html.listed(_some(certificate.findings), "nothing")
    yield "<h2>Motion and limits</h2>"
    yield f"<p>{escape(_of_motion(certificate.motion))}</p>"
    yield html.folded(
        "Files (SHA-256) and versions",
        html.table((), list(certificate.files.items())),
        html.listed(f"{name} {version}" for name, version in certificate.versions.items()),
    )


def _remark(joint: JointCertificate) -> Remark:
    drift = f", drifts {_drift(joint.drift, joint)}" if joint.drift is not None else ""
    return Remark(joint.name, f"{in_words(joint.level)}{drift}", level_of_verdict(joint.level))


def _by_joint(certificate: Certificate, arm: Arm) -> str:
    """Return the table of the joints, and what its columns are."""
    effort, factor, decimals = effort_in_table(arm, [each.rmse for each in certificate.joints])
    head = [
        "joint", "held-out |e|/|τ|", f"RMSE, {effort}", "expected (95 %)", "gravity torque ±",
        "dry friction (95 %)", "identified range", "drift", "verdict",
    ]  # fmt: skip
    rows = [_row(joint, factor, decimals) for joint in certificate.joints]
    reduced = certificate.reduced
    if reduced is not None:
        head.insert(-1, f"predicted at {100 * reduced:g} % friction")
        for row, joint in zip(rows, certificate.joints, strict=True):
            row.insert(-1, _drift(joint.predicted, joint))
    notes = [
        "Errors are those of a second motion that nothing was fitted on. Expected: 95 % band of "
        "that RMSE by the model itself. Gravity torque: its standard error at the recorded poses.",
        _of_drift(certificate),
    ]
    if reduced is not None:
        notes.append(
            "Predicted: largest drift of three simulated arms drawn from the model's posterior, "
            "with less friction."
        )
    return html.table(head, rows) + f'<p class="small">{escape(" ".join(notes))}</p>'


def _of_drift(certificate: Certificate) -> str:
    if not certificate.poses:
        return "The arm was not released."
    friction = (
        "the friction that the arm has"
        if certificate.friction == 1
        else f"{100 * certificate.friction:g} % of the arm's friction, so that errors of gravity "
        "show"
    )
    return (
        f"Drift: the largest at {certificate.poses} poses within the identified range, each at "
        f"least {math.degrees(certificate.apart):.0f} deg (10 deg count as 17 mm) from all that "
        f"was fitted, compensated for {certificate.seconds:g} s each, with {friction}; "
        f"{certificate.held} of {certificate.poses} stayed within "
        f"{math.degrees(certificate.allowed):g} deg."
    )


def _of_motion(motion: Moved) -> str:
    rehearsed = (
        f", and {motion.rehearsed / 60:.1f} min of rehearsals at a tenth of the speed"
        if motion.rehearsed
        else ""
    )
    return (
        f"{motion.seconds / 60:.1f} min of motion{rehearsed}. {motion.commands:,} commands, at "
        "1 kHz, were compared with the limits before the arm moved: none is beyond any of them; "
        f"the most that is used is {100 * motion.used:.1f} % ({motion.most})."
    )


def _some(lines: tuple[str, ...]) -> list[str]:
    more = len(lines) - _MOST
    return [*lines[:_MOST], *([f"and {more} more, in certificate.json"] if more > 0 else [])]


def _row(joint: JointCertificate, factor: float, decimals: int) -> list[str]:
    def shown(value: float) -> str:
        return f"{factor * value:.{decimals}f}"

    band = joint.expected
    friction = "" if joint.friction is None else interval(*joint.friction, joint.unit)
    low, high = _position(joint.lower, joint, 0).split(" ")[0], _position(joint.upper, joint, 0)
    return [
        joint.name,
        f"{100 * joint.nrmse:.1f} %",
        shown(joint.rmse),
        "" if band is None else f"{shown(band[0])}–{shown(band[1])}",
        "" if joint.holding is None else quantity(joint.holding, joint.unit),
        friction or "not determined",
        f"{low} to {high}",
        _drift(joint.drift, joint),
        in_words(joint.level),
    ]


def _drift(value: float | None, joint: JointCertificate) -> str:
    return "" if value is None else shown_drift(value, joint.position_unit)


def _position(value: float, joint: JointCertificate, decimals: int) -> str:
    if joint.position_unit == "rad":
        return f"{math.degrees(value):.{decimals}f} deg"
    return f"{1e3 * value:.{decimals}f} mm"


def _picture(evaluation: Evaluation, arm: Arm) -> Figure:
    """Return small pictures, one a joint, of measured and predicted effort over time."""
    from matplotlib.figure import Figure

    trace = max(evaluation.traces, key=lambda each: len(each.measured))
    assert trace.time is not None
    joints = [arm.joints[arm.joint_names.index(name)] for name in trace.joints]
    rows = -(-len(joints) // _COLUMNS)
    figure = Figure(figsize=(11.0, 1.55 * rows + 0.35), layout="constrained")
    grid = figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False).ravel()
    shown = np.flatnonzero(trace.time < trace.time[0] + _SHOWN)
    time = trace.time[shown] - trace.time[0]
    for axes in grid[len(joints) :]:
        axes.set_axis_off()
    for k, (axes, joint) in enumerate(zip(grid, joints, strict=False)):
        measured, predicted = trace.measured[shown, k], trace.predicted[shown, k]
        unit, factor = effort_in_picture(joint, measured, predicted)
        axes.plot(time, factor * measured, color=_MEASURED, linewidth=1.8, label="measured")
        axes.plot(time, factor * predicted, color=_PREDICTED, linewidth=0.9, label="predicted")
        axes.plot(
            time, factor * (measured - predicted), color=_DIFFERENCE, linewidth=0.7,
            label="difference",
        )  # fmt: skip
        axes.set_title(f"{joint.name} [{unit}]", fontsize=8, loc="left", pad=2)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.25)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(
        handles, [*labels[:2], "difference (second motion, time in s)"], loc="outside lower center",
        ncols=3, fontsize=8, frameon=False,
    )  # fmt: skip
    return figure
