"""A certificate as one HTML page, for a lab's log."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import Certificate, JointCertificate, MotionTally, format_drift
from dvrk_gravity.identification import Evaluation, in_words
from dvrk_gravity.report import html
from dvrk_gravity.report.arm_drawing import Remark, arm_figure
from dvrk_gravity.report.fit_pictures import torque_pictures
from dvrk_gravity.report.fit_tables import level_of_verdict
from dvrk_gravity.report.html import prose
from dvrk_gravity.report.page import page
from dvrk_gravity.report.units import effort_in_table
from dvrk_gravity.units import fixed, interval

_MOST = 7  # sentences of a list; the others are in the files


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
            f'<p class="poor">Simulated: {prose(certificate.simulated)}. This is not the '
            "certificate of an arm.</p>"
        )
    yield arm_figure(arm, [_remark(joint) for joint in certificate.joints])
    yield "<h2>The second motion</h2>"
    yield html.side_by_side(*_pictures(evaluation, arm))
    yield "<h2>By joint</h2>"
    yield _by_joint(certificate, arm)
    yield "<h2>What stays unknown</h2>"
    yield html.item_list(_list_or_none(certificate.unknown), "nothing that was looked for")
    yield "<h2>What the diagnosis found beside the first model</h2>"
    yield html.item_list(_list_or_none(certificate.findings), "nothing")
    yield "<h2>Motion and limits</h2>"
    yield f"<p>{prose(_motion_sentence(certificate.motion))}</p>"
    yield html.collapsible(
        "Files (SHA-256) and versions",
        html.table((), list(certificate.files.items())),
        html.item_list(f"{name} {version}" for name, version in certificate.versions.items()),
    )


def _remark(joint: JointCertificate) -> Remark:
    drift = f", drifts {_drift(joint.drift, joint)}" if joint.drift is not None else ""
    return Remark(joint.name, f"{in_words(joint.level)}{drift}", level_of_verdict(joint.level))


def _by_joint(certificate: Certificate, arm: Arm) -> str:
    """Return the table of the joints, and what its columns are."""
    effort, factor, decimals = effort_in_table(arm, [each.rmse for each in certificate.joints])
    head = [
        "joint", "held-out |e|/|τ|", f"RMSE, {effort}", "expected (95 %)",
        f"gravity torque ±, {effort}", "dry friction (95 %)", "identified range", "drift",
        f"sure to stay at {100 * certificate.reduced:g} % friction", "verdict",
    ]  # fmt: skip
    rows = [_row(joint, factor, decimals) for joint in certificate.joints]
    notes = [
        "Errors are those of a second motion that nothing was fitted on. Expected: 95 % band of "
        "that RMSE by the model itself. Gravity torque: its standard error at the recorded poses.",
        _drift_sentence(certificate),
        "Sure to stay: part of random poses at which so little friction covers the 95 % band of "
        "the gravity torque, what the model lacks included.",
    ]
    return html.table(head, rows) + f'<p class="small">{prose(" ".join(notes))}</p>'


def _drift_sentence(certificate: Certificate) -> str:
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


def _motion_sentence(motion: MotionTally) -> str:
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


def _list_or_none(lines: tuple[str, ...]) -> list[str]:
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
        "" if joint.holding is None else shown(joint.holding),
        friction or "not determined",
        f"{low} to {high}",
        _drift(joint.drift, joint),
        "" if joint.sure is None else f"{100 * joint.sure:.1f} %",
        in_words(joint.level),
    ]


def _drift(value: float | None, joint: JointCertificate) -> str:
    return "" if value is None else format_drift(value, joint.position_unit)


def _position(value: float, joint: JointCertificate, decimals: int) -> str:
    turns = joint.position_unit == "rad"
    shown = math.degrees(value) if turns else 1e3 * value
    # A drift is a size; an end of the range may be negative.
    text = f"{shown:.{decimals}f}" if shown < 0.0 else fixed(shown, decimals)
    return f"{text} {'deg' if turns else 'mm'}"


def _pictures(evaluation: Evaluation, arm: Arm) -> Iterator[str]:
    """Yield a picture of each joint's measured and predicted effort over time."""
    trace = max(evaluation.traces, key=lambda each: len(each.measured))
    joints = [arm.joints[arm.joint_names.index(name)] for name in trace.joints]
    for name, address in zip(trace.joints, torque_pictures(trace, joints), strict=True):
        yield html.picture(address, f"measured and predicted effort of {name}", name)
