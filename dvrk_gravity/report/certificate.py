"""A certificate as one HTML page, for a lab's log."""

from __future__ import annotations

import math

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import Certificate, JointCertificate
from dvrk_gravity.identification import Evaluation, in_words
from dvrk_gravity.report.html import data_url, png
from dvrk_gravity.report.units import effort_in_picture, effort_in_table
from dvrk_gravity.units import interval, quantity

_MEASURED, _PREDICTED, _DIFFERENCE = "#7f8fa6", "#c0392b", "#2c3e50"
_SHOWN = 15.0  # s of the held-out motion
_MOST = 7  # sentences of a list; the others are in the files
_COLUMNS = 4

_TEMPLATE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Certificate: {{ c.arm }}</title>
<style>
body{font:13px/1.4 system-ui,sans-serif;max-width:60rem;margin:1.2rem auto;padding:0 1rem;
color:#222}
h1{font-size:1.25rem;line-height:1.35;margin:.3rem 0;padding:.6rem .9rem;border-left:.4rem solid}
h1.yes{border-color:#1b7f3b;background:#eef7f0}h1.no{border-color:#b00020;background:#fbeef0}
h2{font-size:.95rem;margin:1rem 0 .2rem}
table{border-collapse:collapse;width:100%}
td,th{padding:.12rem .5rem;text-align:left;border-bottom:1px solid #ddd;vertical-align:top}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}
th{font-weight:600;font-size:.85rem}ul{margin:.2rem 0;padding-left:1.1rem}
.small{color:#555;font-size:.85rem}.bad{color:#b00020}
.files{columns:2;column-gap:1rem;font:7.6px/1.45 ui-monospace,monospace}
.files div{display:flex;justify-content:space-between;break-inside:avoid}
.now td,.now th{white-space:nowrap}.now{font-size:.92em}.now th{white-space:normal}
img{max-width:100%;display:block;margin:.3rem 0}
</style></head><body>
<div class="small">Calibration of gravity compensation &middot; {{ c.arm }} at {{ c.namespace }}
&middot; {{ c.date }}</div>
<h1 class="{{ 'yes' if c.certified else 'no' }}">{{ headline }}.</h1>
{% if c.simulated %}<p class="bad">Simulated: {{ c.simulated }}. This is not the certificate of an
arm.</p>{% endif %}
<h2>By joint</h2>
<table class="now"><tr><th>joint</th><th class="n">held-out |e|/|&tau;|</th>
<th class="n">RMSE, {{ effort }}</th><th class="n">expected (95 %)</th>
<th class="n">gravity torque &plusmn;</th><th>dry friction (95 %)</th><th>identified range</th>
<th class="n">drift</th>{% if c.reduced is not none %}
<th class="n">predicted at {{ "%g"|format(100 * c.reduced) }} % friction</th>{% endif %}
<th>verdict</th></tr>
{% for j in rows %}<tr><td>{{ j.name }}</td><td class="n">{{ j.nrmse }}</td>
<td class="n">{{ j.rmse }}</td><td class="n">{{ j.expected }}</td><td class="n">{{ j.holding }}</td>
<td>{{ j.friction }}</td><td>{{ j.range }}</td><td class="n">{{ j.drift }}</td>
{% if c.reduced is not none %}<td class="n">{{ j.predicted }}</td>{% endif %}
<td>{{ j.level }}</td></tr>
{% endfor %}</table>
<p class="small">Errors are those of a second motion that nothing was fitted on. Expected: 95 % band
of that RMSE by the model itself. Gravity torque: its standard error at the recorded poses.
{% if c.poses %}Drift: the largest at {{ c.poses }} poses within the identified range, each at least
{{ "%.0f"|format(degrees(c.apart)) }} deg (10 deg count as 17 mm) from all that was fitted,
compensated for {{ "%g"|format(c.seconds) }} s each,
{% if c.friction == 1 %}with the friction that the arm has{% else %}with
{{ "%g"|format(100 * c.friction) }} % of the arm's friction, so that errors of gravity
show{% endif %}; {{ c.held }} of {{ c.poses }} stayed within
{{ "%g"|format(degrees(c.allowed)) }} deg.{% else %}The arm was not released.{% endif %}
{% if c.reduced is not none %}Predicted: largest drift of three simulated arms drawn from the
model's posterior, with less friction.{% endif %}</p>
<img alt="measured and predicted effort of the second motion" src="{{ picture }}">
<h2>What stays unknown</h2>
<ul>{% for line in unknown %}<li>{{ line }}</li>{% else %}<li>nothing that was looked for</li>
{% endfor %}</ul>
<h2>What the diagnosis found beside the first model</h2>
<ul>{% for line in findings %}<li>{{ line }}</li>{% else %}<li>nothing</li>{% endfor %}</ul>
<h2>Motion and limits</h2>
<p>{{ "%.1f"|format(c.motion.seconds / 60) }} min of motion{% if c.motion.rehearsed %}, and
{{ "%.1f"|format(c.motion.rehearsed / 60) }} min of rehearsals at a tenth of the speed{% endif %}.
{{ "{:,}".format(c.motion.commands) }} commands, at 1 kHz, were compared with the limits before the
arm moved: none is beyond any of them; the most that is used is
{{ "%.1f"|format(100 * c.motion.used) }} % ({{ c.motion.most }}).</p>
<h2>Files (SHA-256) and versions</h2>
<p class="small">The compensator's model is <code>{{ c.model }}</code>.
{% for name, version in c.versions.items() %}{{ name }} {{ version }}{{ ", " if not loop.last }}
{%- endfor %}.</p>
<div class="files">{% for name, hash in c.files.items() %}
<div><span>{{ name }}</span><span>{{ hash }}</span></div>{% endfor %}</div>
</body></html>
"""


def certificate_page(certificate: Certificate, evaluation: Evaluation, arm: Arm) -> str:
    """Return the certificate's HTML, complete in itself; every text in it is escaped.

    Args:
        certificate: What is certified.
        evaluation: The model on the second motion.
        arm: The arm.
    """
    from jinja2 import Environment

    template = Environment(autoescape=True).from_string(_TEMPLATE)
    effort, factor, decimals = effort_in_table(arm, [each.rmse for each in certificate.joints])
    rows = [_row(joint, factor, decimals) for joint in certificate.joints]
    verdict = certificate.verdict
    return template.render(
        c=certificate, headline=verdict[:1].upper() + verdict[1:], rows=rows, effort=effort,
        degrees=math.degrees, unknown=_some(certificate.unknown),
        findings=_some(certificate.findings), picture=data_url(_picture(evaluation, arm)),
    )  # fmt: skip


def _some(lines: tuple[str, ...]) -> list[str]:
    more = len(lines) - _MOST
    return [*lines[:_MOST], *([f"and {more} more, in certificate.json"] if more > 0 else [])]


def _row(joint: JointCertificate, factor: float, decimals: int) -> dict[str, str]:
    def shown(value: float) -> str:
        return f"{factor * value:.{decimals}f}"

    band = joint.expected
    friction = "" if joint.friction is None else interval(*joint.friction, joint.unit)
    low, high = _position(joint.lower, joint, 0).split(" ")[0], _position(joint.upper, joint, 0)
    return {
        "name": joint.name,
        "nrmse": f"{100 * joint.nrmse:.1f} %",
        "rmse": shown(joint.rmse),
        "expected": "" if band is None else f"{shown(band[0])}–{shown(band[1])}",
        "holding": "" if joint.holding is None else quantity(joint.holding, joint.unit),
        "friction": friction or "not determined",
        "range": f"{low} to {high}",
        "drift": "" if joint.drift is None else _position(joint.drift, joint, 2),
        "predicted": "" if joint.predicted is None else _position(joint.predicted, joint, 2),
        "level": in_words(joint.level),
    }


def _position(value: float, joint: JointCertificate, decimals: int) -> str:
    if joint.position_unit == "rad":
        return f"{math.degrees(value):.{decimals}f} deg"
    return f"{1e3 * value:.{decimals}f} mm"


def _picture(evaluation: Evaluation, arm: Arm) -> bytes:
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
    return png(figure, dpi=100)
