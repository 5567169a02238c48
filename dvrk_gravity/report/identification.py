"""An identification as one HTML file: errors, pictures, parameters, what is not known."""

from __future__ import annotations

from dvrk_gravity.identification import RULE, Fit, good_to
from dvrk_gravity.intake import contradiction
from dvrk_gravity.model import VERDICTS
from dvrk_gravity.report.fit_pictures import residual_pictures, torque_pictures
from dvrk_gravity.report.units import effort_in_table

_TEMPLATE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Identification: {{ arm }}</title>
<style>
body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem;color:#222}
h1{font-size:1.5rem;line-height:1.3}h2{font-size:1.15rem;margin-top:2.2rem}h3{font-size:1rem}
table{border-collapse:collapse;margin:.6rem 0}
td,th{padding:.2rem .8rem;text-align:left;border-bottom:1px solid #ddd;vertical-align:top}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
th.n{white-space:normal}td.why{min-width:20rem}
tr.open td{color:#999}.small{color:#666;font-size:.9rem}.bad{color:#b00020}
img{max-width:100%;display:block}
</style></head><body>
<h1{% if poor %} class="bad"{% endif %}>{{ arm }}: {{ headline }}</h1>
{% if contradiction %}<p class="bad">{{ contradiction }}</p>{% endif %}
{% if fit.verdict.record %}<p>Record instead: {{ fit.verdict.record }}.</p>{% endif %}
{% if poor %}<p>The compensator refuses this model unless <code>allow_poor_model</code> is true.</p>
{% endif %}
<p class="small">{{ sources }}; {{ fit.samples }} samples; errors and pictures in
{{ fit.coordinates }} coordinates. Held out: {{ fit.validation }}.</p>

<h2>Error by joint</h2>
<table><tr><th>joint</th><th class="n">held-out RMSE, {{ effort }}</th>
<th class="n">|e|/|&tau;|</th><th class="n">R&sup2;</th>
<th class="n">|e|/|&tau;| on the data fitted</th><th class="n">good to</th><th>verdict</th>
<th>why</th></tr>
{% for name, error in fit.held_out.items() %}
<tr><td>{{ name }}</td><td class="n">{{ "%.*f"|format(decimals, factor * error.rmse) }}</td>
<td class="n">{{ "%.3f"|format(error.nrmse) }}</td><td class="n">{{ "%.3f"|format(error.r2) }}</td>
<td class="n">{% if name in fit.training %}{{ "%.3f"|format(fit.training[name].nrmse) }}{% endif %}
</td><td class="n">{{ "%.3f"|format(good_to[name]) }}</td>
<td>{{ fit.verdict.joints[name].words }}</td>
<td class="why">{{ fit.verdict.joints[name].reason }}</td></tr>
{% endfor %}</table>
<p class="small">{{ rule }}. A joint's verdict is the worst of that of its error, of what is not
known of its gravity torque, and of how far it moved.</p>

<h2>Joint by joint</h2>
{% for name, torque, residual in pictures %}<h3>{{ name }}</h3>
<img alt="measured and predicted torque of {{ name }}" src="{{ torque }}">
<img alt="difference by position and velocity of {{ name }}" src="{{ residual }}">{% endfor %}

<h2>Terms</h2>
{% macro changes(rows) %}<table><tr><th>change</th><th>why</th></tr>
{% for choice in rows %}<tr><td>{{ choice.term }}</td><td>{{ choice.reason }}</td></tr>{% endfor %}
</table>{% endmacro %}
{{ changes(fit.choices | selectattr("added")) }}
{% for title, rows in others if rows %}<details><summary>{{ title }} ({{ rows|length }})</summary>
{{ changes(rows) }}</details>{% endfor %}

<h2>What these data do not determine</h2>
<p>{{ fit.identifiability.sentence|capitalize }}.</p>
<ul>{% for line in fit.identifiability.statements %}<li>{{ line }}</li>
{% else %}<li>nothing that was asked for</li>{% endfor %}</ul>
{% if fit.physical %}<p>Every link is a body that can exist: least eigenvalue of its
pseudo-inertia over the greatest,
{% for link, value in fit.physical.items() %}{{ link }} {{ "%.2g"|format(value) }}{{
", " if not loop.last }}{% endfor %}.</p>{% endif %}

<h2>Parameters</h2>
<p class="small">With 95 % intervals that respect the residual's autocorrelation. Grey: not
determined by these data alone.</p>
<table><tr><th>parameter</th><th class="n">value</th><th class="n">95 % interval</th>
<th>unit</th></tr>
{% for p in fit.parameters %}<tr{% if not p.identifiable %} class="open"{% endif %}>
<td>{{ p.name }}</td><td class="n">{{ "%.4g"|format(p.value) }}</td>
<td class="n">{{ "%.4g"|format(p.ci95[0]) }} … {{ "%.4g"|format(p.ci95[1]) }}</td>
<td>{{ p.unit }}</td></tr>{% endfor %}</table>

<h2>Data</h2>
<ul>{% for line in fit.warnings %}<li>{{ line }}</li>{% else %}<li>no warnings</li>{% endfor %}</ul>
<ul>{% for line in fit.handling %}<li>{{ line }}</li>{% endfor %}</ul>
</body></html>
"""


def identification_page(fit: Fit, sources: str) -> str:
    """Return the report's HTML, complete in itself; every text in it is escaped.

    Args:
        fit: The result.
        sources: Names of the recordings.
    """
    from jinja2 import Environment

    template = Environment(autoescape=True).from_string(_TEMPLATE)
    # Of several traces, the longest is shown over time; the differences of all are.
    longest = max(fit.traces, key=lambda trace: len(trace.measured))
    joints = {joint.name: joint for joint in fit.model.arm.joints}
    shown = [joints[name] for name in longest.joints]
    over_time, left = torque_pictures(longest, shown), residual_pictures(fit.traces, shown)
    pictures = list(zip(longest.joints, over_time, left, strict=True))
    poor = fit.verdict.level == VERDICTS[-1]
    headline = fit.verdict.words
    if not poor:
        found = [error.r2 for error in fit.held_out.values()]
        headline += f": R² {min(found):.2f} to {max(found):.2f} on torque that it had not seen"
    others = [
        ("Taken out again", [choice for choice in fit.choices if choice.kept and not choice.added]),
        (
            "Tried, and does not improve the cross-validated error by enough",
            [choice for choice in fit.choices if not choice.kept],
        ),
    ]
    effort, factor, decimals = effort_in_table(
        fit.model.arm, [error.rmse for error in fit.held_out.values()]
    )
    return template.render(
        arm=fit.model.arm.name, fit=fit, headline=headline, poor=poor, sources=sources,
        contradiction=contradiction(fit.warnings), rule=RULE,
        good_to={name: good_to(joint) for name, joint in joints.items()},
        pictures=pictures, others=others, effort=effort, factor=factor, decimals=decimals,
    )  # fmt: skip
