"""An identification as one HTML file: verdict, arm, pictures, parameters, what is not known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from dvrk_gravity.identification import POOR, RULE, Choice, Fit
from dvrk_gravity.observation import contradiction
from dvrk_gravity.report import html
from dvrk_gravity.report.arm_drawing import arm_figure
from dvrk_gravity.report.fit_in_terminal import constant_lines, weight_line
from dvrk_gravity.report.fit_pictures import pictures_by_joint
from dvrk_gravity.report.fit_tables import (
    error_remarks,
    error_rows,
    errors_in_short,
    level_of_verdict,
    verdict_in_short,
)
from dvrk_gravity.report.html import prose
from dvrk_gravity.report.page import page


def identification_page(fit: Fit, sources: str) -> str:
    """Return the report's HTML, complete in itself; every text in it is escaped.

    Args:
        fit: The result.
        sources: Names of the recordings.
    """
    arm, verdict = fit.model.arm, fit.verdict
    found = [error.r2 for error in fit.held_out.values()]
    headline = (
        f"{arm.name}, {verdict_in_short(verdict.level, verdict.joints)}: "
        f"errs by {errors_in_short(fit.held_out, arm)}"
    )
    if verdict.level != POOR:  # a high R² would only mislead
        headline += f"; R² {min(found):.2f} to {max(found):.2f} on torque that it had not seen"
    facts = (
        f"{sources}; {fit.samples} samples; errors and pictures in {fit.coordinates} coordinates. "
        f"Held out: {fit.validation}."
    )
    return page(
        f"Identification of {arm.name}", headline, facts, _parts(fit),
        level_of_verdict(verdict.level), contradiction(fit.warnings),
    )  # fmt: skip


def _parts(fit: Fit) -> Iterator[str]:
    arm = fit.model.arm
    if fit.verdict.record:
        record = prose(fit.verdict.record)
        yield f"<p>Record instead: {record}.</p>"
    if fit.verdict.level == POOR:
        yield (
            "<p>The compensator refuses this model unless <code>allow_poor_model</code> is true."
            "</p>"
        )
    for line in (*constant_lines(fit), weight_line(fit)):
        yield f"<p>{prose(line[:1].upper() + line[1:])}.</p>" if line else ""
    yield arm_figure(arm, error_remarks(fit.held_out, fit.verdict.joints))
    yield "<h2>Joint by joint</h2>"
    yield from pictures_by_joint(fit.traces, arm)
    yield "<h2>Tables</h2>"
    fitted = {name: f"{error.nrmse:.3f}" for name, error in fit.training.items()}
    yield html.collapsible(
        "Held-out error by joint",
        error_rows(fit.held_out, arm, fit.verdict.joints, {"|e|/|τ| on the data fitted": fitted}),
        f'<p class="small">{prose(RULE)}. A joint\'s verdict is the worst of that of its error, '
        "of what is not known of its gravity torque, and of how far it moved.</p>",
    )
    yield html.collapsible("Terms", *_terms(fit.choices))
    yield html.collapsible("What these data do not determine", *_open(fit))
    yield html.collapsible(f"Parameters ({len(fit.parameters)})", *_parameters(fit))
    yield html.collapsible(
        "Data",
        html.item_list(fit.warnings, "no warnings"),
        html.item_list(fit.handling),
    )


def _terms(choices: Iterable[Choice]) -> Iterator[str]:
    choices = list(choices)
    for title, rows in (
        ("Added", [choice for choice in choices if choice.added]),
        ("Taken out again", [choice for choice in choices if choice.kept and not choice.added]),
        (
            "Tried, and does not improve the cross-validated error by enough",
            [choice for choice in choices if not choice.kept],
        ),
    ):
        if rows:
            yield f'<p class="small">{title} ({len(rows)}):</p>'
            yield html.table(("change", "why"), [(row.term, row.reason) for row in rows])


def _open(fit: Fit) -> Iterator[str]:
    found = fit.identifiability
    yield f"<p>{prose(found.sentence.capitalize())}.</p>"
    yield html.item_list(found.statements, "nothing that was asked for")
    if fit.physical:
        each = ", ".join(f"{link} {value:.2g}" for link, value in fit.physical.items())
        yield (
            "<p>Every link is a body that can exist: least eigenvalue of its pseudo-inertia over "
            f"the greatest, {prose(each)}.</p>"
        )


def _parameters(fit: Fit) -> Iterator[str]:
    yield ('<p class="small">With 95 % intervals that respect the residual\'s autocorrelation.</p>')
    yield html.table(
        ("parameter", "value", "95 % interval", "unit", "determined by"),
        [
            (
                each.name,
                f"{each.value:.4g}",
                f"{each.ci95[0]:.4g} … {each.ci95[1]:.4g}",
                each.unit,
                "the data" if each.identifiable else "a prior too",
            )
            for each in fit.parameters
        ],
    )
