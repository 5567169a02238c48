"""The evaluation of a model as one HTML file: how far it errs, where, and how that looks."""

from __future__ import annotations

from collections.abc import Iterator

from dvrk_gravity.identification import RULE, Evaluation, by_errors
from dvrk_gravity.model import VERDICTS, TorqueModel
from dvrk_gravity.observation import contradiction
from dvrk_gravity.report import html
from dvrk_gravity.report.arm_drawing import arm_figure
from dvrk_gravity.report.fit_in_terminal import expectation, verdict_comparison
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
from dvrk_gravity.report.units import effort_in_table


def evaluation_page(result: Evaluation, model: TorqueModel, sources: str) -> str:
    """Return the report's HTML, complete in itself; every text in it is escaped.

    Args:
        result: The result.
        model: The model that was evaluated.
        sources: Names of the recordings.
    """
    arm = model.arm
    verdicts = by_errors(arm, result.joints, result.coordinates, result.with_friction)
    level = max((verdict.level for verdict in verdicts.values()), key=VERDICTS.index)
    headline = (
        f"{arm.name}, {verdict_in_short(level, verdicts)}: "
        f"errs by {errors_in_short(result.joints, arm)}"
    )
    facts = f"{sources}; {result.samples} samples; errors in {result.coordinates} coordinates."

    def parts() -> Iterator[str]:
        comparison = verdict_comparison(
            model, result.joints, result.coordinates, result.with_friction
        )
        yield f"<p>{prose(comparison[:1].upper() + comparison[1:])}.</p>"
        yield arm_figure(arm, error_remarks(result.joints, verdicts))
        yield "<h2>Joint by joint</h2>"
        yield from pictures_by_joint(result.traces, arm)
        yield "<h2>Tables</h2>"
        _, factor, decimals = effort_in_table(arm, [e.rmse for e in result.joints.values()])
        expected = {
            name: f"{factor * band.low:.{decimals}f} to {factor * band.high:.{decimals}f}"
            for name, band in result.expected.items()
        }
        yield html.collapsible(
            "Error by joint",
            error_rows(
                result.joints, arm, verdicts, {"expected RMSE": expected} if expected else None
            ),
            html.item_list((result.metric, expectation(result, model), f"rule: {RULE}")),
        )
        if len(result.recordings) > 1:
            rows = [
                (label, *(f"{joints[name].nrmse:.3f}" for name in result.joints))
                for label, joints in result.recordings.items()
            ]
            yield html.collapsible("|e|/|τ| by recording", html.table(("", *result.joints), rows))
        if result.outside:
            yield html.collapsible("Outside the identified range", html.item_list(result.outside))
        yield html.collapsible(
            "Data", html.item_list(result.warnings, "no warnings"), html.item_list(result.handling)
        )

    return page(
        f"Evaluation of {arm.name}", headline, facts, parts(), level_of_verdict(level),
        contradiction(result.warnings),
    )  # fmt: skip
