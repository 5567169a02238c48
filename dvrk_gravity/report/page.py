"""The layout that all reports share: verdict, arm, pictures, folded tables; one file, no network.

Dark and light by what the reader's system prefers, light in print; as wide as a phone or a screen.
"""

from __future__ import annotations

from collections.abc import Iterable

from dvrk_gravity.report.arm_drawing import Level
from dvrk_gravity.report.html import escape

# Text on its ground has a contrast of 4.5 or more in either scheme (WCAG 2.2, 1.4.3). Pictures are
# drawn dark on transparent; inverted, with their hues turned back, they are light on dark.
_STYLE = """
:root{color-scheme:light dark;--paper:#fff;--card:#f5f7f9;--ink:#1c2024;--dim:#59626e;
--line:#d5dae1;--good:#1a6b3c;--fair:#835400;--poor:#b3261e}
@media screen and (prefers-color-scheme:dark){:root{--paper:#14171b;--card:#1d2228;--ink:#e6e9ee;
--dim:#a3adb9;--line:#3a424c;--good:#6cc894;--fair:#e0b050;--poor:#ff8f85}
figure img{filter:invert(1) hue-rotate(180deg)}}
*{box-sizing:border-box}
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;padding:1.5rem 1rem;max-width:66rem;
color:var(--ink);background:var(--paper);overflow-wrap:break-word}
h1{font-size:1.5rem;line-height:1.3;margin:.2rem 0 .6rem}h2{font-size:1.15rem;margin:2.2rem 0 .6rem}
h3{font-size:1rem;margin:1.6rem 0 .4rem}
.small,.of{color:var(--dim);font-size:.9rem}.of{margin:0}
.good{color:var(--good)}.fair{color:var(--fair)}.poor{color:var(--poor)}
.arm{display:flex;flex-wrap:wrap;gap:1rem 2rem;align-items:center;background:var(--card);
border:1px solid var(--line);border-radius:.6rem;padding:1rem}
.arm svg{flex:1 1 14rem;max-width:26rem;min-width:0}.arm div{flex:2 1 18rem;min-width:0}
.arm ol{margin:0;padding-left:1.8rem}.arm p{margin:.2rem 0}
.arm li{margin:.25rem 0;color:var(--dim)}
.arm li.good,.arm li.good::marker{color:var(--good)}.arm li.fair{color:var(--fair)}
.arm li.poor{color:var(--poor)}
svg .link{stroke:var(--dim);stroke-width:5;stroke-linecap:round}
svg .base{fill:var(--dim)}svg .lead{stroke:var(--dim)}
svg .joint>*:first-child{fill:var(--card);stroke:var(--dim);stroke-width:1.5}
svg .joint text{font:600 11px system-ui,sans-serif;text-anchor:middle;fill:var(--ink)}
svg .good>*:first-child{stroke:var(--good)}svg .good text{fill:var(--good)}
svg .fair>*:first-child{fill:var(--fair);stroke:var(--fair)}svg .fair text{fill:var(--card)}
svg .poor>*:first-child{fill:var(--poor);stroke:var(--poor)}svg .poor text{fill:var(--card)}
svg path.fair{fill:var(--fair)}svg path.poor{fill:var(--poor)}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,18rem),1fr));
gap:.6rem 1rem;margin:.6rem 0}
figure{margin:0}figure img{display:block;width:100%;max-width:34rem}
figcaption{font-size:.9rem;font-weight:600}
.table{overflow-x:auto;margin:.6rem 0}table{border-collapse:collapse}
td,th{padding:.25rem .8rem .25rem 0;text-align:left;border-bottom:1px solid var(--line);
vertical-align:top}td.n+td:last-child:not(.n){min-width:7rem}
.n+:not(.n){padding-left:.6rem}.n{text-align:right;font-variant-numeric:tabular-nums}
td.n{white-space:nowrap}
details{border-bottom:1px solid var(--line);padding:.5rem 0}
summary{cursor:pointer;font-weight:600}
@media print{body{max-width:none;padding:0}table{font-size:.68rem}
td,th{padding-right:.4rem}td:first-child{overflow-wrap:anywhere;min-width:8em}
figure,.arm,tr{break-inside:avoid}h2,h3{break-after:avoid}
details::details-content{content-visibility:visible;display:block}}
"""


def page(
    kind: str,
    headline: str,
    facts: str,
    parts: Iterable[str],
    level: Level = "",
    contradiction: str = "",
) -> str:
    """Return a report's HTML, complete in itself.

    Args:
        kind: What it is of: ``Identification of mtmr``.
        headline: The verdict in a sentence, with its size.
        facts: From which data, in a line.
        parts: HTML of what follows: the arm (:func:`arm_figure`), pictures, folded tables.
        level: Colours the headline.
        contradiction: Why the recordings say nothing of this arm, which comes before all else;
            ``""``: nothing does.
    """
    headline_html = f"<p>{escape(headline)}</p>\n" if contradiction else ""
    if contradiction:
        headline, level = contradiction, "poor"
    colour = f' class="{level}"' if level else ""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(kind)}: {escape(headline)}</title>"
        f"<style>{_STYLE}</style></head><body>\n"
        f'<p class="of">{escape(kind)}</p>\n<h1{colour}>{escape(headline)}</h1>\n'
        f'{headline_html}<p class="small">{escape(facts)}</p>\n'
        + "\n".join(parts)
        + "\n</body></html>\n"
    )
