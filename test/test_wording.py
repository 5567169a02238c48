"""The field's words: where an expression of our own was replaced, it does not return.

    python test/test_wording.py             how many old words each room of the repository has
    python test/test_wording.py PATH…       every one of them there, and what to say instead

Terms are in ``docs/glossary.md``.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
# Files, and folders with all their .md and .py files. Add a room of the package once it is clean.
CLEAN = (
    "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs", "dvrk_gravity",
)  # fmt: skip
# Codes and array names that files carry stay as they are. Each has its module.
IN_FILES = {
    "dvrk_gravity/console/answer.py": ('"other_hand"',),
    "dvrk_gravity/console/check.py": ('"other_hand"',),
    "dvrk_gravity/console/conversion.py": ('"other_hand"',),
    "dvrk_gravity/intake/arm_side.py": ('"other_hand"',),
    "dvrk_gravity/model/uncertainty.py": ("together: Array", "self.together"),
    "dvrk_gravity/recording/data_warning.py": ('"other_hand"',),
}
WIDTH = 120  # Lines of prose are shorter. Code, tables and pictures cannot be broken.


class Old(NamedTuple):
    """An expression that is refused.

    Attributes:
        pattern: Regular expression, in any case; a blank stands for blanks, line ends and
            underscores, so that names in code count, too.
        instead: What to say.
        example: What it refuses.
    """

    pattern: str
    instead: str
    example: str


OLD = (
    Old("(no|is|are) news", "minor effects; expected, not reported", "NO_NEWS = 3"),
    Old("tells?|told|telling", "shows, reports, states, names; distinguishes", "which is told"),
    Old("(hangs?|hung) (on|together)", "depends on; is correlated", "error that hangs on q"),
    Old("(comes?|came) back", "recurs, returns; recurring discrepancy", "what comes back"),
    Old("nameless", "unexplained structure", "a nameless rest"),
    Old("rightly", "correctly; correct_readings", "read_rightly"),
    Old("unstated", "baseline effects; not stated", "unstated friction"),
    Old("(an)?other day", "day-to-day friction variation", "friction of another day"),
    Old("weighed", "payload check; estimated mass; weighted samples", "the load is weighed"),
    Old("alike", "equal, similar; homogeneity", "all joints alike"),
    Old("by perhaps", "(not significant), after the number", "by perhaps .06 deg"),
    Old("other hand", "other arm side", "the other hand's arm"),
    Old("read before", "duplicate samples", "READ_BEFORE"),
    Old("improbable", "negative log prior", "Score.improbable"),
    Old("stood in for", "confounded columns", "stood_in_for: Array"),
    Old("taken in|took in", "absorbed variance; absorbed", "what a model took in"),
    Old("over with it", "sent, not yet acknowledged", "it is not over with it"),
    Old("when all was well", "baseline recording", "the motion when all was well"),
    Old("known poorly", "uncertain by ±", "is known poorly (to 213 mN·m)"),
    Old("how sure", "uncertainty", "says how sure it is"),
    Old("surely", "significantly", "surely more than noise"),
    Old("suppos(e|es|ed|ing)", "assume; hypothesise", "as diagnose supposes"),
    Old("on trial", "under test", "the model on trial"),
    Old("of consequence", "large enough to matter; practical equivalence", "is of consequence"),
    Old("anew", "again", "chosen anew"),
    Old(r"Tried(?=[.:(\]|])", "multiplicity, n_comparisons", "class Tried:"),
    Old(
        r"(?<=\.)together(?!\()|together: (float|Array|NDArray)",
        "correlation_time",
        "self.together",
    ),
    Old(r"(?<=\.)freedom|freedom: (int|float)", "dof", "fit.freedom"),
)


def _compiled(old: Old) -> re.Pattern[str]:
    pattern = old.pattern.replace(" ", r"[\s_#]+")
    return re.compile(rf"(?<![^\W_])(?:{pattern})(?![^\W_])", re.IGNORECASE)


PATTERNS = [(_compiled(old), old) for old in OLD]


def prose(page: str) -> str:
    """Return a Markdown page with as many lines, but without code, quotations and addresses.

    What the program prints is code or a quotation; it is the program's to mend.
    """
    fenced, lines = False, []
    for line in page.splitlines():
        fence = line.lstrip().startswith("```")
        fenced ^= fence
        left_out = fence or fenced or line.startswith((">", "    "))
        lines.append("" if left_out else re.sub(r"`[^`]*`|\]\([^)]*\)", "", line))
    return "\n".join(lines)


def name(path: Path) -> str:
    """Return a path as the repository has it."""
    inside = path.is_relative_to(REPOSITORY)
    return (path.relative_to(REPOSITORY) if inside else path).as_posix()


def found(path: Path) -> Iterator[tuple[int, str, Old]]:
    """Yield line, words and entry of each old expression in a .md or .py file."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        text = prose(text)
    for code in IN_FILES.get(name(path), ()):
        text = text.replace(code, "")
    for pattern, old in PATTERNS:
        for match in pattern.finditer(text):
            yield text.count("\n", 0, match.start()) + 1, match.group(), old


def files(*places: str) -> list[Path]:
    """Return the pages and modules at these places of the repository."""
    paths = [REPOSITORY / place for place in places]
    inside = [file for path in paths for kind in ("md", "py") for file in path.rglob(f"*.{kind}")]
    return [path for path in paths if path.is_file()] + sorted(inside)


CHECKED = files(*CLEAN)


def test_the_field_s_words_stand_where_ours_were_replaced():
    assert [
        f"{name(path)}:{line}: {words!r}: {old.instead}"
        for path in CHECKED
        for line, words, old in found(path)
    ] == []


def long_lines(path: Path) -> Iterator[str]:
    """Yield where a page has a line of prose that is too long."""
    fenced = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        fenced ^= line.lstrip().startswith("```")
        whole = fenced or line.startswith(("|", "> |", "    ", "!["))
        if len(line) >= WIDTH and not whole:
            yield f"{name(path)}:{number}"


def test_lines_of_prose_are_shorter_than_120_characters():
    pages = [path for path in CHECKED if path.suffix == ".md"]
    assert [place for path in pages for place in long_lines(path)] == []


@pytest.mark.parametrize("suffix", ["md", "py"])
def test_an_old_word_is_found_in_a_page_and_in_a_module(tmp_path, suffix):
    path = tmp_path / f"text.{suffix}"
    for old in OLD:
        path.write_text(f"Torque.\n\n{old.example}\n")
        assert (3, old.instead) in [(line, entry.instead) for line, _, entry in found(path)]


def test_what_to_say_instead_is_no_old_word(tmp_path):
    path = tmp_path / "instead.md"
    path.write_text("\n\n".join(old.instead for old in OLD))
    assert list(found(path)) == []


def test_an_old_expression_is_found_across_the_end_of_a_line(tmp_path):
    page, module = tmp_path / "page.md", tmp_path / "module.py"
    page.write_text("the friction of another\n  day\n")
    module.write_text("# the friction of another\n# day\n")
    assert [line for path in (page, module) for line, _, _ in found(path)] == [1, 1]


@pytest.mark.parametrize(
    "text",
    [
        "Intelligent metallic stellar tools; an unknown newsletter, retold.",
        "Six degrees of freedom, tried together; backlash; a handle.",
        "The warning `read_before`, and [a page](other_day.md).",
        "```\ntold\n```",
        "    what comes back, as a command prints it",
        "> perhaps told by the program",
    ],
)
def test_other_words_code_and_quotations_pass(tmp_path, text):
    path = tmp_path / "page.md"
    path.write_text(text)
    assert list(found(path)) == []


def _rooms() -> list[str]:
    package = REPOSITORY / "dvrk_gravity"
    folders = sorted(path for path in package.iterdir() if any(path.glob("*.py")))
    loose = sorted(package.glob("*.py"))
    rooms = [*CLEAN, *map(name, folders), *map(name, loose), "test", "testing", "benchmark"]
    return list(dict.fromkeys(rooms))


def main(places: list[str]) -> None:
    """Print the old words at these places, or how many each room has."""
    for path in files(*places):
        for line, words, old in sorted(found(path)):
            print(f"{name(path)}:{line}: {words!r}: {old.instead}")
    for room in [] if places else _rooms():
        print(f"{sum(len(list(found(path))) for path in files(room)):6d}  {room}")


if __name__ == "__main__":
    main(sys.argv[1:])
