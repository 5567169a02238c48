"""Write the README's table of alternatives from docs/peers.md, which `make peers` measures.

``python docs/readme_table.py`` prints it; ``--write`` puts it into the README.
"""

from __future__ import annotations

import argparse
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
README = REPOSITORY / "README.md"
BEGIN, END = "<!-- alternatives: begin -->", "<!-- alternatives: end -->"
METHODS = ("dvrk_gravity", "least squares", "figaroh", "mujoco.sysid")
# Row of the page, and what the README calls it.
BY_ARM = (
    ("## Held-out error by joint", "UR10e_real", "error on a real UR10e, of the torque"),
    ("## Held-out error by joint", "MTM_real", "… on a real MTM"),
    ("## Held-out error by joint", "PSM_real", "… on a real PSM, recorded days later"),
)
DIAGNOSIS = (
    ("named first", "hidden effects that the first name got right"),
    ("false alarms", "false alarms, on unchanged recordings"),
)


def table() -> str:
    """Return the table in Markdown."""
    page = (REPOSITORY / "docs" / "peers.md").read_text(encoding="utf-8")
    lines = [("", *METHODS), ("---",) * (1 + len(METHODS))]
    for title, row, name in BY_ARM:
        cells = _table_of(page, title)
        lines.append((name, *(cells[row][method].split(",")[0] for method in METHODS)))
    found = _table_of(page, "## Diagnosis")
    lines += [(name, *(found[m][row].split(",")[0] for m in METHODS)) for row, name in DIAGNOSIS]
    count = _table_of(page, "## At a glance")["lines of the user"]
    lines.append(("lines that a user writes", *(count[method] for method in METHODS)))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _table_of(page: str, title: str) -> dict[str, dict[str, str]]:
    """Return the first table under a title: cells by row and column."""
    part = page.split(f"\n{title}\n")[1]
    rows = [line.strip("|").split("|") for line in part.splitlines() if line.startswith("|")]
    head, *body = [[cell.strip() for cell in row] for row in rows]
    return {row[0]: dict(zip(head[1:], row[1:], strict=False)) for row in reversed(body)}


def written() -> str:
    """Return the README with its table renewed."""
    head, rest = README.read_text(encoding="utf-8").split(BEGIN)
    return f"{head}{BEGIN}\n{table()}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="renew the README")
    if parser.parse_args().write:
        README.write_text(written(), encoding="utf-8")
    else:
        print(table())
