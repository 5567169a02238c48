"""The history of a fleet: a page with small multiples, worst first, and a summary of what changed.

The page needs no network, and draws what is looked at: it holds the arms' numbers, and shows a few
dozen arms at a time. Of thousands of arms only the series that moved most are in it; each arm that
changed has a page of its own with all of them.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.fleet import ArmChange, ArmHistory, Change, Series, date
from dvrk_gravity.report.arm_drawing import Level
from dvrk_gravity.report.html import escape
from dvrk_gravity.report.page import page
from dvrk_gravity.units import quantity, suited

FEW_ARMS = 200
"""Arms of which the page has every series, and each arm a page. Chosen: some megabytes."""
MOST_ON_PAGE = 5000
"""Arms on the page, the most urgent ones; 20 MB. The summaries have all."""
_SHOWN = 3  # series of an arm on a page of more arms
_MONTH = "%Y-%m"


def sentence(found: ArmChange) -> str:
    """Return a change in a sentence: what, by how much, since when, what is due."""
    series, change = found.series, found.change
    # A name each: a tilt has two angles.
    names = dict.fromkeys(title_of(effect, joint) for effect, joint, _ in found.rivals)
    what = title_of(series.effect, series.joint)
    others = " or ".join(name for name in names if name != what)
    text = f"{what}{f' (or {others})' if others else ''}: {_size(series, change)}"
    if found.due is not None and found.severity < 1.0:
        low, high = found.due_interval
        until = "later" if high is None else f"{date(high):{_MONTH}}"
        span = "" if low is None else f" ({date(low):{_MONTH}} to {until})"
        text += f"; beyond what is usable in {date(found.due):{_MONTH}}{span}"
    elif found.severity >= 1.0:
        text += f"; its torque is {found.severity:.1f} times the joint's friction"
    return text


def title_of(effect: str, joint: str) -> str:
    """Return what is followed, in words: ``coulomb friction of pitch``."""
    title = effects.named(effect).title()
    return f"{title} of {joint}" if joint else title


def _size(series: Series, change: Change) -> str:
    """Return how a series changed, by how much and when."""
    half = NORMAL_95 * change.error
    amount = _amount(series, change.size, half)
    first, last = (f"{date(day):%Y-%m-%d}" for day in change.since)
    if change.shape == "break":
        return f"{amount} at once, between {first} and {last}"
    if change.shape == "drift":
        return f"{amount} a month, from before {first} on"
    return f"{amount} a month, from {date(change.at):{_MONTH}} on ({first} to {last})"


def _amount(series: Series, value: float, half: float) -> str:
    """Return a change with its interval: of friction in percent of it, of factors in percent."""
    sign = "+" if value > 0.0 else ""
    if effects.is_friction(series.effect) and np.isfinite(series.torque_ratio):
        factor = 100.0 * series.torque_ratio
        return f"{sign}{quantity(factor * value, '%', factor * half)} of its friction"
    if effects.named(series.effect).meaning(series.parameter).percent:
        return sign + quantity(100.0 * value, "%", 100.0 * half)
    return sign + quantity(value, series.unit, half)


def history_json(arms: Sequence[ArmHistory], rate: float) -> str:
    """Return history.json: every arm, and what changed, the most urgent first; SI units."""
    content = {
        "format": 1,
        "false_discovery_rate": rate,
        "arms": [
            {
                "serial": arm.serial, "arm": arm.arm, "recordings": len(arm.visits),
                "first": _iso(arm.visits[0].day) if arm.visits else None,
                "last": _iso(arm.visits[-1].day) if arm.visits else None,
                "failed": sum(visit.verdict == "failed" for visit in arm.visits),
                "p_value": arm.p_value, "urgency": arm.urgency,
                "changes": [_as_json(found) for found in arm.changes],
            }
            for arm in arms
        ],
    }  # fmt: skip
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _as_json(found: ArmChange) -> dict[str, Any]:
    series, change = found.series, found.change
    due = [found.due, *found.due_interval]
    return {
        "effect": series.effect, "joint": series.joint, "parameter": series.parameter,
        "unit": series.unit, "shape": change.shape, "since": [_iso(day) for day in change.since],
        "at": _iso(change.at), "size": change.size, "standard_error": change.error,
        "per": "month" if change.shape != "break" else None,
        "p_value": change.p_value, "q_value": found.q_value,
        "severity": found.severity if np.isfinite(found.severity) else None,
        "due": None if found.due is None else [day and _iso(day) for day in due],
        "by_findings": found.by_findings,
        "or": [{"effect": e, "joint": j, "parameter": p} for e, j, p in found.rivals],
        "also": [{"effect": e, "joint": j, "parameter": p} for e, j, p in found.also],
        "sentence": sentence(found),
    }  # fmt: skip


def history_csv(arms: Sequence[ArmHistory]) -> str:
    """Return history.csv: one row a change, the most urgent arm first; SI units."""
    stream = io.StringIO()
    names = (
        "serial", "arm", "effect", "joint", "parameter", "shape", "since_low", "since_high", "size",
        "standard_error", "unit", "per", "q_value", "severity", "due", "sentence",
    )  # fmt: skip
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    for arm in arms:
        for found in arm.changes:
            its = _as_json(found)
            low, high = its["since"]
            row = {"serial": arm.serial, "arm": arm.arm, "since_low": low, "since_high": high,
                   **its, "due": (its["due"] or [None])[0]}  # fmt: skip
            writer.writerow({name: row[name] for name in names})
    return stream.getvalue()


def history_text(arms: Sequence[ArmHistory], most: int = 20) -> list[str]:
    """Return what changed in lines for a terminal, the most urgent arm first."""
    changed = [arm for arm in arms if arm.changes]
    lines = [_headline(arms) + "."]
    for arm in changed[:most]:
        lines += [f"  {arm.serial} ({arm.arm}): {sentence(found)}" for found in arm.changes]
    if len(changed) > most:
        lines.append(f"  {len(changed) - most} more: history.html, history.csv")
    return lines


def history_page(arms: Sequence[ArmHistory], rate: float, pages: Mapping[str, str]) -> str:
    """Return the page of a fleet.

    Args:
        arms: The arms, the most urgent first.
        rate: At which false discoveries are held.
        pages: Addresses of arms' own pages, by serial number, as seen from this one.
    """
    most = None if len(arms) <= FEW_ARMS else _SHOWN
    data = [_data(arm, most, "", pages.get(arm.serial, "")) for arm in arms[:MOST_ON_PAGE]]
    left_out = len(arms) - len(data)
    facts = (
        f"{f'The {left_out} least urgent arms are left out. ' if left_out else ''}"
        f"{sum(len(arm.visits) for arm in arms)} recordings; of the arms that are reported, at "
        f"most {100 * rate:g} % are expected to be unchanged. Values: by how much a quantity "
        "differs from the arm's model, each fitted alone, with its 95 % interval; a point leads "
        "to its recording's report."
    )  # fmt: skip
    level: Level = "poor" if any(arm.urgency >= 1.0 for arm in arms) else ""
    return page("History of a fleet", _headline(arms), facts, [_application(data)], level)


def arm_page(arm: ArmHistory, rate: float) -> str:
    """Return the page of one arm, with all of its series and recordings; it lies in ``arms/``."""
    visits = [
        (f"{date(visit.day):%Y-%m-%d}", visit.verdict.replace("_", " "), visit.text,
         visit.recording, f"../{visit.report}" if visit.report else "")
        for visit in reversed(arm.visits)
    ]  # fmt: skip
    rows = "\n".join(
        f"<tr><td>{escape(day)}</td><td>{escape(verdict)}</td><td>{escape(text)}</td><td>"
        + (f'<a href="{escape(report)}">{escape(name)}</a>' if report else escape(name))
        + "</td></tr>"
        for day, verdict, text, name, report in visits
    )
    table = f'<h2>Recordings</h2><div class="table"><table>{rows}</table></div>'
    changes_text = "; ".join(map(sentence, arm.changes)) or "no change that holds"
    facts = f"{len(arm.visits)} recordings. Values as in the history of the fleet."
    data = [_data(arm, None, "../", "")]
    return page(
        f"History of {arm.arm} {arm.serial}", changes_text, facts, [_application(data), table]
    )


def _headline(arms: Sequence[ArmHistory]) -> str:
    changed = sum(bool(arm.changes) for arm in arms)
    urgent = sum(arm.urgency >= 1.0 for arm in arms)
    text = f"{changed} of {len(arms)} arms changed"
    need = "needs" if urgent == 1 else "need"
    return text + (f", {urgent} {need} a hand within three months" if urgent else "")


def _data(arm: ArmHistory, most: int | None, up: str, address: str) -> dict[str, Any]:
    """Return what a page draws of an arm; ``most`` series, the changed ones first."""
    names = {found.series.name: found for found in arm.changes}

    def moved(series: Series) -> tuple[bool, float]:
        p_value = 1.0 if series.fitted is None else series.fitted.p_value
        return series.name not in names, p_value

    shown = sorted(arm.series, key=moved)
    reports = {visit.day: visit.report for visit in arm.visits}
    return {
        "s": arm.serial, "k": arm.arm, "u": round(arm.urgency, 3), "a": address,
        "n": len(arm.visits), "f": sum(visit.verdict == "failed" for visit in arm.visits),
        "c": [sentence(found) for found in arm.changes],
        "q": [_draw_series(each, names.get(each.name), reports, up) for each in shown[:most]],
    }  # fmt: skip


def _draw_series(
    series: Series, found: ArmChange | None, reports: Mapping[float, str], up: str
) -> dict[str, Any]:
    percent = effects.named(series.effect).meaning(series.parameter).percent
    size = float(np.max(np.abs(series.value) + NORMAL_95 * series.error))
    factor, unit = (100.0, "%") if percent else suited(size, series.unit)
    title = title_of(series.effect, series.joint)
    if not percent and series.parameter in ("roll", "pitch"):
        title = f"{title}, {series.parameter}"

    def numbers(values: Any) -> list[float]:
        return [float(f"{factor * each:.4g}") for each in values]

    drawn: dict[str, Any] = {
        "t": title, "u": unit, "d": [round(each, 1) for each in series.day.tolist()],
        "v": numbers(series.value), "e": numbers(NORMAL_95 * series.error),
        "l": [up + reports[day] if reports.get(day) else "" for day in series.day.tolist()],
    }  # fmt: skip
    if found is not None and series.fitted is not None:
        drawn["x"] = [round(float(each), 1) for each in series.daily[0]]
        drawn["y"] = numbers(series.fitted.curve)
        drawn["b"] = [round(each, 1) for each in found.change.since]
    return drawn


def _iso(day: float) -> str:
    return date(day).isoformat(timespec="seconds")


def _application(data: Sequence[Mapping[str, Any]]) -> str:
    """Return what shows the arms: their numbers, and the program that draws them."""
    # No text of the numbers ends the script that they stand in.
    numbers = json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("</", "<\\/")
    return (
        f"<style>{_STYLE}</style>{_CONTROLS if len(data) > 1 else ''}"
        '<div id="arms"></div><p id="pager"></p>\n'
        f'<script type="application/json" id="data">{numbers}</script>\n<script>{_SCRIPT}</script>'
    )


_CONTROLS = """<p><input id="search" type="search" placeholder="serial, arm, joint or effect"
aria-label="Search"> <label><input id="changed" type="checkbox"> changed only</label>
<span class="small" id="count" aria-live="polite"></span></p>"""

_STYLE = """
#search{font:inherit;padding:.3rem .6rem;width:min(100%,22rem);border:1px solid var(--line);
border-radius:.4rem;background:var(--card);color:var(--ink)}
.unit{border-top:1px solid var(--line);padding:.8rem 0}.unit h2{margin:0}
.unit ul{margin:.3rem 0;padding-left:1.2rem}
.multiples{display:grid;grid-template-columns:repeat(auto-fill,minmax(15rem,1fr));gap:.5rem 1rem}
.multiples figcaption{font-weight:400;font-size:.8rem}
.multiples svg{display:block;width:100%;height:auto}
.multiples .axis{stroke:var(--line)}.multiples text{font:10px system-ui,sans-serif;fill:var(--dim)}
.multiples .bar{stroke:var(--dim);stroke-width:1}.multiples circle{fill:var(--ink)}
.multiples .fit{fill:none;stroke:var(--poor);stroke-width:1.5}
.multiples .since{fill:var(--fair);opacity:.25}
.changed figcaption{font-weight:600;color:var(--poor)}
#pager button{font:inherit;margin-right:.5rem}
"""

# Text goes into the page as text nodes only. Arms are drawn when their part of the list is shown.
_SCRIPT = r"""
'use strict';
const arms = JSON.parse(document.getElementById('data').textContent);
const SIZE = 30, W = 260, H = 96, L = 34, R = 4, T = 6, B = 16, DAY = 864e5;
const box = document.getElementById('arms'), pager = document.getElementById('pager');
const search = document.getElementById('search'), only = document.getElementById('changed');
const svg = (name, attributes, parent) => {
  const e = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const k in attributes) e.setAttribute(k, attributes[k]);
  if (parent) parent.appendChild(e);
  return e;
};
const html = (name, text, parent, kind) => {
  const e = document.createElement(name);
  if (text) e.textContent = text;
  if (kind) e.className = kind;
  if (parent) parent.appendChild(e);
  return e;
};
const day = d => new Date(d * DAY).toISOString().slice(0, 10);
function drawn(q, first, last) {
  const low = Math.min(0, ...q.v.map((v, i) => v - q.e[i]));
  const high = Math.max(0, ...q.v.map((v, i) => v + q.e[i]));
  const x = d => L + (W - L - R) * (d - first) / Math.max(last - first, 1);
  const y = v => T + (H - T - B) * (high - v) / Math.max(high - low, 1e-12);
  const s = svg('svg', {viewBox: `0 0 ${W} ${H}`, role: 'img', 'aria-label': q.t});
  if (q.b) svg('rect', {class: 'since', x: x(q.b[0]) - 1, y: T, height: H - T - B,
    width: Math.max(x(q.b[1]) - x(q.b[0]), 0) + 2}, s);
  svg('line', {class: 'axis', x1: L, x2: W - R, y1: y(0), y2: y(0)}, s);
  const mark = (v, at) => svg('text', {x: L - 3, y: at, 'text-anchor': 'end'}, s).textContent =
    Number(v.toPrecision(2)).toString();
  mark(high, T + 8); mark(low, H - B);
  svg('text', {x: L, y: H - 3}, s).textContent = day(first);
  svg('text', {x: W - R, y: H - 3, 'text-anchor': 'end'}, s).textContent = day(last);
  const points = q.x ? q.x.map((d, i) => x(d) + ',' + y(q.y[i])).join(' ') : '';
  if (q.x) svg('polyline', {class: 'fit', points}, s);
  q.d.forEach((d, i) => {
    const ends = {y1: y(q.v[i] - q.e[i]), y2: y(q.v[i] + q.e[i])};
    svg('line', {class: 'bar', x1: x(d), x2: x(d), ...ends}, s);
    let parent = s;
    if (q.l[i]) parent = svg('a', {href: q.l[i]}, s);
    const c = svg('circle', {cx: x(d), cy: y(q.v[i]), r: 2.2}, parent);
    svg('title', {}, c).textContent = `${day(d)}: ${q.v[i]} ± ${q.e[i]} ${q.u}`;
  });
  return s;
}
function card(arm) {
  const unit = html('section', '', box, 'unit'), head = html('h2', '', unit);
  if (arm.a) html('a', arm.s, head).href = arm.a; else head.textContent = arm.s;
  const failed = arm.f ? `, ${arm.f} failed` : '';
  html('span', ` ${arm.k}, ${arm.n} recordings${failed}`, head, 'small');
  if (arm.c.length) {
    const list = html('ul', '', unit);
    arm.c.forEach(c => html('li', c, list));
  }
  const grid = html('div', '', unit, 'multiples');
  const days = arm.q.flatMap(q => q.d);
  const first = days.reduce((a, b) => Math.min(a, b), Infinity);
  const last = days.reduce((a, b) => Math.max(a, b), -Infinity);
  for (const q of arm.q) {
    const figure = html('figure', '', grid, q.x ? 'changed' : '');
    html('figcaption', q.u ? `${q.t} [${q.u}]` : q.t, figure);
    figure.appendChild(drawn(q, first, last));
  }
}
const texts = arms.map(a => [a.s, a.k, ...a.c, ...a.q.map(q => q.t)].join(' ').toLowerCase());
let found = arms.map((_, i) => i), at = 0;
function show() {
  box.textContent = ''; pager.textContent = '';
  found.slice(at, at + SIZE).forEach(i => card(arms[i]));
  if (found.length <= SIZE) return;
  const step = (text, to) => {
    const b = html('button', text, pager);
    b.disabled = to < 0 || to >= found.length;
    b.onclick = () => { at = to; show(); window.scrollTo(0, 0); };
  };
  step('Worse', at - SIZE); step('Next', at + SIZE);
  const last = Math.min(at + SIZE, found.length);
  html('span', `${at + 1} to ${last} of ${found.length}`, pager, 'small');
}
function filter() {
  const words = search ? search.value.toLowerCase().split(/\s+/).filter(Boolean) : [];
  found = arms.map((_, i) => i).filter(i => words.every(w => texts[i].includes(w))
    && !(only && only.checked && !arms[i].c.length));
  at = 0;
  const count = document.getElementById('count');
  if (count) count.textContent = `${found.length} of ${arms.length} arms`;
  show();
}
if (search) search.oninput = filter;
if (only) only.onchange = filter;
filter();
"""
