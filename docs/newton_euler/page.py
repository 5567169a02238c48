"""Fill the generated parts of docs/newton_euler.md.

    python docs/newton_euler/page.py            writes the page
    python docs/newton_euler/page.py --check    status 1 if a table is not up to date

``--check`` leaves the recovery out: it takes half a minute, and its last digits follow
the machine's arithmetic.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import recover
from printed import EXERCISES, HALF_DECIMAL, NAMES, REACTIONS, reactions
from remarks import remarks

from dvrk_gravity.newton_euler import JointType, inverse_dynamics, read

PAGE = EXERCISES.parents[1] / "docs" / "newton_euler.md"


def exercises() -> str:
    """Return the table of every exercise: our actuation, our reactions, the printed ones."""
    return "\n\n".join(_exercise(name) for name in NAMES)


def _exercise(name: str) -> str:
    mechanism, motion = read(EXERCISES / f"{name}.yaml")
    loads = inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd)
    lines = [
        f"### {mechanism.title}\n",
        "| joint | | actuation | Fx N | Fy N | Fz N | Mx N·m | My N·m | Mz N·m |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for i, joint in enumerate(mechanism.joints):
        unit = "N" if joint.type is JointType.PRISMATIC else "N·m"
        lines.append(_row(str(i + 1), "ours", f"{loads.tau[i]:z.2f} {unit}", loads.reactions[i]))
        if name in REACTIONS:
            lines.append(_row("", "printed", "lost", reactions(name)[i]))
    if name in REACTIONS:
        worst = float(np.max(np.abs(loads.reactions - reactions(name))))
        verdict = "every printed decimal agrees" if worst <= HALF_DECIMAL else "does not agree"
        lines.append(f"\nLargest difference {worst:.4f}: {verdict}.")
    else:
        lines.append("\nThe document's printed reactions are lost.")
    return "\n".join(lines)


def _row(joint: str, whose: str, tau: str, numbers: np.ndarray) -> str:
    cells = " | ".join(f"{value:z.2f}" for value in numbers)
    return f"| {joint} | {whose} | {tau} | {cells} |"


def signs() -> str:
    """Return the table of the document's remarks."""
    lines = ["| exercise | the document says | we find | |", "|---|---|---|---|"]
    for remark in remarks():
        verdict = "holds" if remark.holds else "**does not hold**"
        lines.append(f"| {remark.exercise} | {remark.statement} | {remark.ours} | {verdict} |")
    return "\n".join(lines)


def recovery() -> str:
    """Return what the recovery prints."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        recover.main()
    return f"```\n{output.getvalue().rstrip()}\n```"


BLOCKS = {"exercises": exercises, "remarks": signs, "recovery": recovery}


def outdated(text: str) -> Iterator[str]:
    """Yield the names of the blocks, recovery apart, that are not up to date."""
    for name in ("exercises", "remarks"):
        if _fill(text, name, BLOCKS[name]()) != text:
            yield name


def _fill(text: str, name: str, content: str) -> str:
    """Return the page's text with one generated block replaced."""
    begin, end = f"<!-- {name} -->\n", f"\n<!-- end of {name} -->"
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    filled, count = pattern.subn(lambda _: begin + content + end, text)
    if count != 1:
        raise SystemExit(f"{PAGE}: found {count} blocks named {name}, expected 1")
    return filled


def main(arguments: list[str], page: Path = PAGE) -> int:
    """Write or check the page; return the exit status."""
    text = page.read_text(encoding="utf-8")
    if arguments == ["--check"]:
        names = list(outdated(text))
        print(f"{page}: {'not up to date: ' + ', '.join(names) if names else 'up to date'}")
        return 1 if names else 0
    for name, content in BLOCKS.items():
        text = _fill(text, name, content())
    page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
