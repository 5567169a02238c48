"""Write the table of parameters in docs/parameters.md from their declarations.

``python docs/parameter_table.py`` prints it; ``--write`` puts it into the page, and writes what the
nodes show as their help: to declare parameters takes longer than a help may.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from pathlib import Path

from dvrk_gravity.arms import Arm
from dvrk_gravity.model import all_parameters
from dvrk_gravity.parameters import Parameter, node_parameters
from dvrk_gravity.ros import parameter_file

PAGE = Path(__file__).resolve().with_name("parameters.md")
ARM = Arm.load("mtmr")  # whose joints stand in the table
BEGIN, END = "<!-- parameters: begin -->", "<!-- parameters: end -->"


def table() -> str:
    """Return the table in Markdown, the joints of one parameter in one row."""
    rows = ["| parameter | type | unit | default | range | meaning |", "|---|---|---|---|---|---|"]
    for name, entry in all_parameters(ARM).items():
        joint = next((joint for joint in ARM.joint_names if name.endswith(f".{joint}")), None)
        if joint == ARM.joint_names[0]:
            rows.append(_row(name.replace(joint, "JOINT"), entry, entry.meaning.split(",")[0]))
        elif joint is None:
            rows.append(_row(name, entry, entry.meaning))
    return "\n".join(rows)


def _row(name: str, entry: Parameter, meaning: str) -> str:
    kind = entry.kind
    if entry.lengths:
        count = entry.lengths if len(entry.lengths) < 4 else (entry.lengths[0], "…")
        kind += f" ({', '.join(map(str, count))})" if count else ""
    default = "" if entry.default in ((), "") else str(entry.default).lower()
    if isinstance(entry.default, tuple) and entry.default:
        default = ", ".join(f"{value:g}" for value in entry.default)
    meaning += " (fixed at start)" if entry.read_only else ""
    meaning += " (adjustable)" if entry.adjustable else ""
    cells = (f"`{name}`", kind, entry.unit_text, default, entry.range_text(), meaning)
    return "| " + " | ".join(cells) + " |"


def helps() -> dict[Path, str]:
    """Return the lists of the nodes' parameters that their help shows, by the files they lie in."""
    from dvrk_gravity.ros import (
        MONITOR_PARAMETERS,
        OWN_PARAMETERS,
        PARAMETERS,
        SIMULATOR_PARAMETERS,
    )

    every, nodes = all_parameters(ARM), node_parameters(ARM)
    arm = {"arm": every["arm"]}
    listed = {
        "compensator": {**arm, **nodes},
        "watchdog": {**arm, **{name: nodes[name] for name in OWN_PARAMETERS}},
        "monitor": {**arm, **MONITOR_PARAMETERS},
        "simulator": {**arm, **{name: nodes[name] for name in PARAMETERS}, **SIMULATOR_PARAMETERS},
    }
    return {parameter_file(node): _lines(table) for node, table in listed.items()}


def _lines(table: Mapping[str, Parameter]) -> str:
    return "".join(f"  {name} ({_short(each)}): {each.meaning}\n" for name, each in table.items())


def _short(entry: Parameter) -> str:
    """Return type, default and unit in as few words as they need."""
    values = entry.default if isinstance(entry.default, tuple) else (entry.default,)
    shown = [f"{value:g}" if isinstance(value, float) else str(value).lower() for value in values]
    same = len(set(shown)) == 1 < len(shown)
    default = f"{shown[0] if same else ', '.join(shown)} {entry.unit}".strip()
    return ", ".join(filter(None, (entry.kind, f"{default} each" if same else default)))


def written() -> str:
    """Return the page with the table put between its marks."""
    pattern = re.compile(f"{re.escape(BEGIN)}.*?{re.escape(END)}", re.DOTALL)
    return pattern.sub(f"{BEGIN}\n{table()}\n{END}", PAGE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put it into docs/parameters.md")
    if parser.parse_args().write:
        PAGE.write_text(written(), encoding="utf-8")
        for path, text in helps().items():
            path.write_text(text, encoding="utf-8")
    else:
        print(table())
