"""A diagnosis as one HTML file: sentence, picture, alternatives, how it was judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

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
from dvrk_gravity.observation import contradiction
from dvrk_gravity.report import html
from dvrk_gravity.report.arm_drawing import Remark, arm_figure, worst_level
from dvrk_gravity.report.findings import (
    BETWEEN,
    BLIND,
    DETECTABLE,
    KNOWN,
    SEPARATE,
    caveat,
    detectable_table,
    effect_title,
    misplaced_load,
    model_verdict,
    parameter_rows,
    size_of,
    what_is_compared,
)
from dvrk_gravity.report.html import escape, prose
from dvrk_gravity.report.in_simulation import section
from dvrk_gravity.report.page import page
from dvrk_gravity.report.units import (
    effort_in_picture,
    effort_in_table,
    errors_of,
    sizes_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WHEN: tuple[Literal["before", "after"], ...] = ("before", "after")
# Parts of a picture around its axes, as in `fit_pictures`.
_ROOM = {"left": 0.09, "right": 0.985, "bottom": 0.155, "top": 0.83, "wspace": 0.05}
_BINS = 24
_LEAST_IN_BIN = 3
_LEAST_P = 0.001  # below, a figure of a p-value says nothing more


def diagnosis_page(diagnosis: Diagnosis, sources: Sequence[str]) -> str:
    """Return the report's HTML, complete in itself.

    Args:
        diagnosis: The result.
        sources: Names of the recordings.
    """
    arm = diagnosis.model.arm
    verdict = diagnosis.verdict.replace("_", " ")
    facts = (
        f"Verdict: {verdict}. {', '.join(sources)}; {diagnosis.samples} "
        f"samples compared; {diagnosis.held_out} of them held out of fit and model selection; all "
        "errors and gains below are of those."
    )
    if diagnosis.misplaced:
        sentence = misplaced_load(diagnosis.misplaced)
        facts = f"{sentence[0].upper()}{sentence[1:]}. {facts}"
    if own := model_verdict(diagnosis.model_verdict):
        facts += f" {own[0].upper()}{own[1:]}."
    level = worst_level(remark.level for remark in _remarks(diagnosis.findings)) or "good"
    if level == "good" and diagnosis.cannot_judge:
        level = "fair"
    return page(
        f"Diagnosis of {arm.name}", diagnosis.sentence, facts, _parts(diagnosis), level,
        contradiction(diagnosis.warnings),
    )  # fmt: skip


def _parts(diagnosis: Diagnosis) -> Iterator[str]:
    arm = diagnosis.model.arm
    if limit := caveat(diagnosis):
        yield f'<p class="small">{prose(limit)}</p>'
    if diagnosis.findings and diagnosis.cannot_judge:
        yield f"<p>{prose(BLIND)}</p>" + html.item_list(diagnosis.cannot_judge)
    yield arm_figure(arm, _remarks(diagnosis.findings))
    if diagnosis.findings:
        yield "<h2>Findings</h2>"
    for number, finding in enumerate(diagnosis.findings, start=1):
        yield from _finding(number, finding, diagnosis)
    if diagnosis.payload_check is not None:
        yield f"<p><b>Known payload:</b> {prose(diagnosis.payload_check.sentence)}.</p>"
    if diagnosis.known:
        yield _known(diagnosis.known, diagnosis.against_reference)
    if diagnosis.in_simulation is not None:
        yield section(diagnosis.in_simulation, arm)
    yield "<h2>Tables</h2>"
    yield _errors(diagnosis)
    if diagnosis.detectable:
        note = f'<p class="small">{prose(DETECTABLE)}</p>'
        table = html.table(*detectable_table(diagnosis.detectable))
        yield html.collapsible("What would have been found", note, table)
    if diagnosis.ambiguities:
        yield _ambiguities(diagnosis.ambiguities)
        yield _separation_command(
            next(filter(None, map(diagnosis.separating, diagnosis.ambiguities)), "")
        )
    warnings = [str(warning) for warning in diagnosis.warnings]
    yield html.collapsible("Data", html.item_list(warnings, "no warnings"))
    yield html.collapsible("How it was judged", html.item_list(diagnosis.notes))


def _remarks(findings: Sequence[Finding]) -> list[Remark]:
    """Return what is found at each joint, and its size."""
    return [
        Remark(
            joint,
            f"{effect_title(finding.effect)}, {size_of(finding)}"
            + (f", removes {100 * finding.gain.relative:.0f} %" if finding.gain.relative else "")
            + ("" if finding.certain else " (not certain)"),
            "poor" if finding.certain else "fair",
        )
        for finding in findings
        for joint in finding.joints or ("",)
    ]


def _finding(number: int, finding: Finding, diagnosis: Diagnosis) -> Iterator[str]:
    arm = diagnosis.model.arm
    where = ", ".join(finding.joints) or "the arm"
    yield f"<h3>{escape(f'{number}. {effect_title(finding.effect)} at {where}')}</h3>"
    yield f"<p>{prose(finding.sentence)}.</p>"
    if finding.remedy:
        yield f"<p><b>What to do:</b> {prose(finding.remedy)}.</p>"
    if finding.picture is not None:
        yield html.side_by_side(*_panels(finding.picture, arm))
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
    yield html.collapsible("Parameters", html.table((), rows))
    if finding.alternatives:
        rejoined = [
            (effect_title(a.effect), ", ".join(a.joints) or "the arm", a.why)
            for a in finding.alternatives
        ]
        causes = "cause" if len(rejoined) == 1 else "causes"
        yield html.collapsible(
            f"These data cannot separate it from {len(rejoined)} other possible {causes}",
            html.table(("effect", "joint", "numbers"), rejoined),
        )
        yield _separation_command(diagnosis.separating(finding))
    if finding.rejected:
        tried = [
            (effect_title(r.effect), ", ".join(r.joints) or "the arm", r.place, f"{r.gain:.0f}",
             f"{r.behind:.0f}")
            for r in finding.rejected
        ]  # fmt: skip
        yield html.collapsible(
            f"Tried in its place, but worse on unseen blocks ({len(tried)})",
            html.table(("effect", "joint", "form", "log-likelihood gain", "behind"), tried),
        )


def _separation_command(command: str) -> str:
    """Return the command that plans what separates causes, if there is one."""
    return f"<p>{SEPARATE}: <code>{escape(command)}</code></p>" if command else ""


def _known(known: Sequence[Known], against_reference: bool) -> str:
    """Return what is expected: minor effects, the model's uncertainty and known error."""
    sentences = (
        f"{entry.sentence}. What to do: {entry.remedy}" if entry.remedy else entry.sentence
        for entry in known
    )
    within = BETWEEN if against_reference else KNOWN
    return (
        f'<h2>Expected, not reported as findings</h2><p class="small">{within}:</p>'
        + html.item_list(sentences)
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
        f'<p class="small">The noise floor is {FLOORS[diagnosis.floor_from]}. Expected: the '
        "model's error at calibration; of a file's model, from its uncertain masses and day-to-day "
        "friction variation.</p>"
    )
    compared = f'<p class="small">Errors {what_is_compared(diagnosis)}.</p>'
    return html.collapsible(f"Held-out error, {unit} RMS", compared, html.table(head, rows), legend)


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
    suspected = any(ambiguity.suspected for ambiguity in ambiguities)
    return html.collapsible(
        f"Causes that this recording cannot separate ({len(ambiguities)})",
        "" if suspected else "<p>There is no sign of any.</p>",
        html.item_list(ambiguity.sentence for ambiguity in ambiguities),
        html.table(head, rows),
    )


def _numbers(effect: str, parameters: Mapping[str, Estimate]) -> str:
    return ", ".join(
        f"{name} {parameter_text(effect, name, estimate)}" for name, estimate in parameters.items()
    )


def png(picture: Picture, arm: Arm) -> bytes:
    """Return a joint's error before and after, against what it depends on, as a PNG.

    Args:
        picture: Errors, N·m or N, and what they depend on.
        arm: The arm.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.4))
    both = figure.subplots(1, 2, sharey=True, gridspec_kw=_ROOM)
    for axes, when in zip(both, _WHEN, strict=True):
        axes.set_title(_draw_error(axes, picture, arm, when))
    both[1].set_ylabel("")
    lines, names = both[1].get_legend_handles_labels()
    figure.legend(lines, names, loc="upper right", ncols=2, frameon=False, fontsize="small")
    return html.png(figure)


def _panels(picture: Picture, arm: Arm) -> Iterator[str]:
    """Yield the error before and the error after, on one scale."""
    panels = [html.panel() for _ in _WHEN]
    titles = [
        _draw_error(axes, picture, arm, when) for (_, axes), when in zip(panels, _WHEN, strict=True)
    ]
    low, high = zip(*(axes.get_ylim() for _, axes in panels), strict=True)
    for (figure, axes), when, title in zip(panels, _WHEN, titles, strict=True):
        axes.set_ylim(min(low), max(high))
        html.legend(figure, axes)
        yield html.picture(html.inline(figure), f"error of {picture.joint} {when}", title)


def _draw_error(axes: Axes, picture: Picture, arm: Arm, when: Literal["before", "after"]) -> str:
    """Draw the error before or after; return the title."""
    joint = arm.joints[arm.joint_names.index(picture.joint)]
    unit, factor = effort_in_picture(joint, picture.before, picture.after)
    error = picture.before if when == "before" else picture.after
    known = np.isfinite(error)
    x, y = picture.x[known], factor * error[known]
    axes.axhline(0.0, color="#888888", linewidth=0.6)
    if picture.forward is None:
        groups = [(np.ones(len(x), dtype=bool), "#99aabb", "#bb3322", "mean")]
    else:
        forward = picture.forward[known]
        groups = [
            (forward, "#e0b0a8", "#bb3322", "moving up"),
            (~forward, "#a8bcd8", "#224488", "moving down"),
        ]
    for rows, pale, strong, label in groups:
        axes.plot(x[rows], y[rows], ".", markersize=2.5, color=pale)
        axes.plot(*_binned_means(x[rows], y[rows]), "-", linewidth=2.0, color=strong, label=label)
    axes.set_xlabel(picture.variable)
    axes.set_ylabel(f"error at {picture.joint} [{unit}]")
    return f"{when}: {np.sqrt(np.mean(y**2)):.3g} {unit} RMS"


def _binned_means(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the means of x and y in equal bins of x, of those that hold enough."""
    if not len(x):
        return x, y
    edges = np.linspace(x.min(), x.max(), _BINS + 1)
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(index, minlength=_BINS)
    enough = count >= _LEAST_IN_BIN
    middle = np.bincount(index, x, minlength=_BINS)[enough] / count[enough]
    return middle, np.bincount(index, y, minlength=_BINS)[enough] / count[enough]
