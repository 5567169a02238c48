"""Write the pages of the reference that are made from the code.

``python docs/reference_pages.py --write`` writes ``docs/reference/options.md`` from the verbs' own
declarations, ``findings.md`` from the effects, and ``rooms.svg`` from the package's folders.
"""

from __future__ import annotations

import argparse
import inspect
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from html import escape
from pathlib import Path

from dvrk_gravity.command_line import VERBS
from dvrk_gravity.effects import Effect, Hypothesis, effects

FOLDER = Path(__file__).resolve().parent / "reference"
PACKAGE = FOLDER.parents[1] / "dvrk_gravity"
RENEWED = "*Written by `python docs/reference_pages.py --write`.*"


def options_page() -> str:
    """Return a table of options for each verb, as its ``--help`` has them."""
    lines = [
        "# Options of the verbs", "",
        "Each verb is `python -m dvrk_gravity VERB …` and `ros2 run dvrk_gravity VERB …`. Options "
        "of the nodes\nare their [parameters](../parameters.md). Exit statuses, and what the verbs "
        "do: [commands](../commands.md).", "", RENEWED, "",
    ]  # fmt: skip
    for name, (home, summary) in VERBS.items():
        verb = pkgutil.resolve_name(home)
        parser = argparse.ArgumentParser(add_help=False)
        verb.add_arguments(parser)
        lines += [f"## {name}", "", f"{_cell(summary[0].upper() + summary[1:])}.", ""]
        lines += ["```console", *re.sub(r"\n +", "\n", verb.EXAMPLE).splitlines(), "```", ""]
        actions = [action for action in parser._actions if action.help]
        if actions:
            lines += ["| option | meaning |", "|---|---|"]
            lines += [f"| {_option(action)} | {_cell(action.help)} |" for action in actions]
            lines.append("")
    return "\n".join(lines)


def _option(action: argparse.Action) -> str:
    """Return an option as one types it, with its value."""
    value = action.metavar or "|".join(action.choices or ()) or action.dest.upper()
    value = value if isinstance(value, str) else " ".join(value)
    if action.nargs == "+":
        value += " …"
    named = ", ".join(action.option_strings)
    takes_value = action.nargs != 0 and not isinstance(action, argparse.BooleanOptionalAction)
    shown = f"{named} {value}".strip() if takes_value else named
    escaped = shown.replace("|", r"\|")
    return f"`{escaped}`" + (" (required)" if action.required and named else "")


def _cell(text: str | None) -> str:
    return _bars(" ".join((text or "").replace("%%", "%").split()))


def _bars(text: str) -> str:
    return text.replace("|", r"\|").replace("<", "&lt;")


def findings_page() -> str:
    """Return what every effect is, how a finding of it reads, and what to do."""
    found = [effect for effect in effects() if effect.REMEDY]
    others = [effect for effect in effects() if not effect.REMEDY]
    lines = [
        "# What each finding means, and what to do", "",
        "One section for each `effect` of [findings.json](files.md#findings), the commoner ones "
        "first, with the\nsentence of a report (sizes and joints in italics). What the extended "
        "model carries, and what the\ncompensator makes of it: [diagnosis]"
        "(../diagnosis.md#what-the-extended-model-carries).", "", RENEWED, "",
    ]  # fmt: skip
    for effect in found:
        lines += [f"## {effect.NAME}", "", f"{_first_line(effect)}", ""]
        if claim := next((each.CLAIM for each in _hypotheses(effect) if each.CLAIM), ""):
            lines += [*_wrapped(f"> {_in_italics(claim)}", "> "), ""]
        lines += _wrapped(f"- **What to do**: {_in_italics(effect.REMEDY)}.", "  ")
        kind = "a fault of the readings, not of the arm" if effect.READS_WRONGLY else ""
        lines += [f"- **Kind**: {kind}."] if kind else []
        sizes = [
            f"`{name}`" + (f" ({meaning.unit})" if meaning.unit else "")
            for name, meaning in effect.MEANINGS.items()
            if meaning.reported
        ]
        lines += _wrapped(f"- **Sizes**: {', '.join(sizes)}.", "  ") if sizes else []
        lines.append("")
    lines += [
        "## Terms that are no findings", "",
        "A model may have these; a diagnosis does not report them under their names.", "",
        "| term | torque |", "|---|---|",
        *(f"| `{effect.NAME}` | {_bars(_first_line(effect))} |" for effect in others), "",
    ]  # fmt: skip
    return "\n".join(lines)


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, 118, subsequent_indent=indent, break_on_hyphens=False)


def _in_italics(sentence: str) -> str:
    """Return a sentence with its placeholders as words in italics."""
    return re.sub(r"\{(\w+)\}", r"*\1*", sentence.replace("{model}", "the model"))


def _first_line(effect: type[Effect]) -> str:
    return (inspect.getdoc(effect) or "").splitlines()[0]


def _hypotheses(effect: type[Effect]) -> Iterator[type[Hypothesis]]:
    """Yield the hypotheses of an effect that are defined beside it."""
    for each in vars(inspect.getmodule(effect)).values():
        is_one = inspect.isclass(each) and issubclass(each, Hypothesis)
        if is_one and getattr(each, "EFFECT", None) is effect:
            yield each


# From what a user starts down to what everything rests on: a band imports none above it.
BANDS = (
    ("commands and nodes", ("cli", "ros")),
    ("what a user reads", ("report",)),
    ("one arm, certified; many arms", ("calibration", "collecting", "fleet")),
    ("while an arm moves", ("monitoring",)),
    ("what is found, what is commanded", ("diagnosis", "compensate")),
    ("simulated arms, other formats", ("simulate", "exports")),
    ("motions to identify from", ("planning",)),
    ("from recordings to models", ("identification", "observation", "estimation")),
    ("what is read", ("recording", "console")),
    ("torque", ("model", "effects")),
    ("kinematics, parameters", ("arms", "newton_euler", "parameters")),
    ("files", ("files",)),
)
_WIDTH, _BAND, _LABEL = 760, 46, 270


def rooms_picture() -> str:
    """Return the rooms of the package as an SVG, each band above those that it imports.

    Raises:
        ValueError: A room has no place in the picture, or a place has no room.
    """
    there = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    shown = {room for _, rooms in BANDS for room in rooms}
    if there != shown:
        raise ValueError(f"BANDS: {sorted(there ^ shown)}, expected the folders of {PACKAGE.name}")
    height = _BAND * len(BANDS) + 16
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" '
        'font-family="system-ui, sans-serif" font-size="14" role="img">',
        "<title>The rooms of dvrk_gravity: none imports those above it</title>",
        f'<rect width="{_WIDTH}" height="{height}" rx="8" fill="#fbfcfe"/>',
    ]
    for row, (label, rooms) in enumerate(BANDS):
        top = 8 + row * _BAND
        parts.append(f'<text x="16" y="{top + 28}" fill="#45505f">{escape(label)}</text>')
        wide = (_WIDTH - _LABEL - 16) / len(rooms)
        for column, room in enumerate(rooms):
            left = _LABEL + column * wide
            parts.append(
                f'<rect x="{left:.0f}" y="{top + 4}" width="{wide - 8:.0f}" height="{_BAND - 8}" '
                'rx="6" fill="#dce8f7" stroke="#4a78b0"/>'
                f'<text x="{left + (wide - 8) / 2:.0f}" y="{top + 28}" text-anchor="middle" '
                f'fill="#10243c">{room}</text>'
            )
    return "\n".join([*parts, "</svg>", ""])


def pages() -> dict[Path, str]:
    """Return all that is made, by its file."""
    return {
        FOLDER / "options.md": options_page(),
        FOLDER / "findings.md": findings_page(),
        FOLDER / "rooms.svg": rooms_picture(),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the files")
    if parser.parse_args().write:
        for path, text in pages().items():
            path.write_text(text, encoding="utf-8")
    else:
        print(*pages().values(), sep="\n")
