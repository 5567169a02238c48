"""A diagnosis as one HTML file: sentence, picture, alternatives, how it was judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import (
    FLOORS,
    Ambiguity,
    Diagnosis,
    Finding,
    Known,
    Picture,
    parameter_text,
)
from dvrk_gravity.effects import Estimate
from dvrk_gravity.intake import contradiction
from dvrk_gravity.report import html
from dvrk_gravity.report.charts import Curve, Panel, chart
from dvrk_gravity.report.findings import (
    BETWEEN,
    KNOWN,
    effect_title,
    parameter_rows,
    size_of,
)
from dvrk_gravity.report.in_simulation import section
from dvrk_gravity.report.units import (
    effort_in_picture,
    effort_in_table,
    errors_of,
    sizes_of,
)

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
h1{font-size:1.5rem;line-height:1.3}h3{font-size:1.02rem;margin-top:1.6rem}h2{font-size:1.15rem;margin-top:2.2rem}
table{border-collapse:collapse;margin:.6rem 0}
td,th{padding:.25rem .8rem;text-align:left;border-bottom:1px solid #ddd}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}
.verdict{display:inline-block;padding:.1rem .6rem;border-radius:.6rem;background:#eef;color:#225}
.small{color:#666;font-size:.9rem}img{max-width:100%}
"""
_VERDICTS = {
    "nothing_to_explain": "nothing to explain",
    "explained": "explained",
    "partly_explained": "partly explained",
    "ambiguous": "explained, by more than one possible cause",
    "unexplained": "unexplained",
}
_HEIGHT = 340.0  # of a picture, px
_BINS = 24
_LEAST_IN_BIN = 3
_LEAST_P = 0.001  # below, a figure of a p-value says nothing more


def diagnosis_page(diagnosis: Diagnosis, sources: Sequence[str]) -> str:
    """Return the report's HTML, complete in itself.

    Args:
        diagnosis: The result.
        sources: Names of the recordings.
    """
    why = contradiction(diagnosis.warnings)
    parts = [
        *([f"<p><b>{escape(why)}</b></p>"] if why else []),
        f"<h1>{escape(diagnosis.sentence)}</h1>",
        f'<p><span class="verdict">{_VERDICTS[diagnosis.verdict]}</span> '
        f'<span class="small">{escape(", ".join(sources))}; {diagnosis.samples} samples '
        f"compared; {diagnosis.held_out} of them held out of fit and model selection; all errors "
        "and gains below are of those</span></p>",
    ]
    if diagnosis.findings:
        parts.append(_overview(diagnosis.findings))
    if diagnosis.findings:
        parts.append("<h2>Findings</h2>")
    if diagnosis.caveat:
        parts.append(f"<p class=small>{escape(diagnosis.caveat)}</p>")
    for number, finding in enumerate(diagnosis.findings, start=1):
        parts.append(_finding(number, finding, diagnosis.model.arm))
    if diagnosis.payload_check is not None:
        parts.append(f"<p><b>Known payload:</b> {escape(diagnosis.payload_check.sentence)}.</p>")
    if diagnosis.known:
        parts.append(_known(diagnosis.known, diagnosis.against_reference))
    if diagnosis.ambiguities:
        parts.append(_ambiguities(diagnosis.ambiguities))
    parts.append(_errors(diagnosis))
    if diagnosis.in_simulation is not None:
        parts.append(section(diagnosis.in_simulation, diagnosis.model.arm))
    parts.append(_list("Data", [str(warning) for warning in diagnosis.warnings], "no warnings"))
    parts.append(_list("How it was judged", diagnosis.notes, ""))
    body = "\n".join(parts)
    return (
        "<!doctype html>\n<html lang=en><head><meta charset=utf-8>"
        f"<title>Diagnosis: {escape(_VERDICTS[diagnosis.verdict])}</title>"
        f"<style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )


def _overview(findings: Sequence[Finding]) -> str:
    """Return all findings at a glance."""
    rows = []
    for number, finding in enumerate(findings, start=1):
        gain = finding.gain
        removed = f"{100 * gain.relative:.0f} % ({100 * gain.low:.0f} to {100 * gain.high:.0f})"
        rows.append(
            (
                str(number),
                effect_title(finding.effect),
                ", ".join(finding.joints) or "the arm",
                finding.place,
                size_of(finding),
                removed if gain.relative else "",
                "yes" if finding.certain else "no",
            )
        )
    head = ("", "what", "where", "form", "size", "held-out error removed", "certain")
    return html.table(head, rows)


def _finding(number: int, finding: Finding, arm: Arm) -> str:
    where = ", ".join(finding.joints) or "the arm"
    head = f"{number}. {effect_title(finding.effect)} at {where}"
    parts = [f"<h3>{escape(head)}</h3>", f"<p>{escape(finding.sentence)}.</p>"]
    if finding.remedy:
        parts.append(f"<p><b>What to do:</b> {escape(finding.remedy)}.</p>")
    gain = finding.gain
    rows = parameter_rows(finding)
    rows.append(
        (
            "error removed",
            f"{100 * gain.relative:.0f} % (95 %: {100 * gain.low:.0f} to {100 * gain.high:.0f}; "
            f"{_p_value(gain.p_value)})",
        )
    )
    rows.append(("form", finding.place))
    carried = f"no: {finding.left_out}" if finding.left_out else "yes"
    rows.append(("in the extended model", carried))
    parts.append(html.table((), rows))
    if finding.picture is not None:
        picture = html.data_url(error_picture(finding.picture, arm))
        parts.append(f'<img alt="error before and after" src="{picture}">')
    if finding.alternatives:
        parts.append("<p>This data cannot separate it from:</p>")
        parts.append(
            html.table(
                ("effect", "joint", "numbers"),
                [
                    (effect_title(a.effect), ", ".join(a.joints) or "the arm", a.why)
                    for a in finding.alternatives
                ],
            )
        )
    if finding.rejected:
        parts.append("<p>Tried in its place, but worse on unseen blocks:</p>")
        parts.append(
            html.table(
                ("effect", "joint", "form", "log-likelihood gain", "behind"),
                [
                    (effect_title(r.effect), ", ".join(r.joints) or "the arm", r.place,
                     f"{r.gain:.0f}", f"{r.behind:.0f}")
                    for r in finding.rejected
                ],
            )
        )  # fmt: skip
    return "\n".join(parts)


def _known(known: Sequence[Known], against_reference: bool) -> str:
    """Return what is expected: minor effects, the model's uncertainty and known error."""
    said = (
        f"{entry.sentence}. What to do: {entry.remedy}" if entry.remedy else entry.sentence
        for entry in known
    )
    items = "".join(f"<li>{escape(text)}</li>" for text in said)
    within = BETWEEN if against_reference else KNOWN
    return (
        f"<h2>Expected, not reported as findings</h2><p class=small>{within}:</p><ul>{items}</ul>"
    )


def _p_value(value: float) -> str:
    return f"p = {value:.2g}" if value >= _LEAST_P else f"p < {_LEAST_P:g}"


def _errors(diagnosis: Diagnosis) -> str:
    unit, factor, decimals = effort_in_table(diagnosis.model.arm, sizes_of(diagnosis))
    rows = []

    def shown(value: float) -> str:
        return f"{factor * value:.{decimals}f}" if np.isfinite(value) else "unknown"

    for joint, floor in diagnosis.floor.items():
        after = diagnosis.after[joint]
        rows.append(
            (
                joint,
                *(shown(column[joint]) for column in errors_of(diagnosis)),
                f"{after / floor:.1f}" if floor > 0.0 and np.isfinite(after) else "",
            )
        )
    head = ("joint", "before", "after", "noise floor", "expected", "after / floor")
    legend = (
        f"<p class=small>The noise floor is {FLOORS[diagnosis.floor_from]}. Expected: from the "
        "posterior of the given model's parameters, its error at calibration, and day-to-day "
        "friction variation.</p>"
    )
    title = f"<h2>Held-out error, {unit} RMS</h2><p class=small>Errors {diagnosis.compared}.</p>"
    return title + html.table(head, rows) + legend


def _ambiguities(ambiguities: Sequence[Ambiguity]) -> str:
    """Return the causes, found or not, that the recording cannot separate."""
    rows = []
    for ambiguity in ambiguities:
        for contender in (ambiguity.first, ambiguity.second):
            rows.append(
                (
                    effect_title(contender.effect),
                    ", ".join(contender.joints) or "the arm",
                    _numbers(contender.effect, contender.alone),
                    _numbers(contender.effect, contender.combined),
                    f"{contender.gain:+.0f}",
                    f"{100 * contender.removed:.1f} % at {contender.at}",
                )
            )
    head = (
        "cause", "joint", "fitted alone", "both fitted", "log-likelihood gain", "held-out error",
    )  # fmt: skip
    sentences = "".join(f"<li>{escape(ambiguity.sentence)}</li>" for ambiguity in ambiguities)
    sign = (
        ""
        if any(ambiguity.suspected for ambiguity in ambiguities)
        else "<p>There is no sign of any.</p>"
    )
    return (
        "<h2>Causes that this recording cannot separate</h2>"
        f"{sign}<ul>{sentences}</ul>" + html.table(head, rows)
    )


def _numbers(effect: str, parameters: Mapping[str, Estimate]) -> str:
    return ", ".join(
        f"{name} {parameter_text(effect, name, estimate)}" for name, estimate in parameters.items()
    )


def _list(title: str, items: Sequence[str], nothing: str) -> str:
    inside = "".join(f"<li>{escape(item)}</li>" for item in items) or f"<li>{escape(nothing)}</li>"
    return f"<h2>{escape(title)}</h2><ul>{inside}</ul>"


def error_picture(picture: Picture, arm: Arm) -> bytes:
    """Return a joint's error before and after, against what it depends on, as an SVG image.

    Args:
        picture: Errors, N·m or N, and what they depend on.
        arm: The arm.
    """
    joint = arm.joints[arm.joint_names.index(picture.joint)]
    unit, factor = effort_in_picture(joint, picture.before, picture.after)
    panels = list[Panel]()
    for error, title in ((picture.before, "before"), (picture.after, "after")):
        known = np.isfinite(error)
        x, y = picture.x[known], factor * error[known]
        if picture.forward is None:
            groups = [(np.ones(len(x), dtype=bool), "#99aabb", "#bb3322", "mean")]
        else:
            forward = picture.forward[known]
            groups = [
                (forward, "#e0b0a8", "#bb3322", "moving up"),
                (~forward, "#a8bcd8", "#224488", "moving down"),
            ]
        curves = []
        for rows, pale, strong, label in groups:
            curves.append(Curve(x[rows], y[rows], pale, 2.6, dots=True))
            curves.append(Curve(*_means(x[rows], y[rows]), strong, 2.4, label))
        text = f"{title}: {np.sqrt(np.mean(y**2)):.3g} {unit} RMS"
        label = "" if panels else f"error at {picture.joint} [{unit}]"
        panels.append(Panel(curves, picture.variable, label, (text,), zero=True))
    return chart([panels], _HEIGHT)


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the means of x and y in equal bins of x, of those that hold enough."""
    if not len(x):
        return x, y
    edges = np.linspace(x.min(), x.max(), _BINS + 1)
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(index, minlength=_BINS)
    enough = count >= _LEAST_IN_BIN
    middle = np.bincount(index, x, minlength=_BINS)[enough] / count[enough]
    return middle, np.bincount(index, y, minlength=_BINS)[enough] / count[enough]
