"""The field's words: where an expression of our own was replaced, it does not return.

Terms are in ``docs/glossary.md``.
"""

from __future__ import annotations

import re

from support import REPOSITORY

# Files, and folders with all their .md and .py files. Add a room of the package once it is clean.
CLEAN = (
    "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs", "dvrk_gravity",
)  # fmt: skip
# Codes and array names that files carry stay as they are. Each has its module.
IN_FILES = {
    "dvrk_gravity/console/answer.py": ('"other_hand"',),
    "dvrk_gravity/console/check.py": ('"other_hand"',),
    "dvrk_gravity/console/conversion.py": ('"other_hand"',),
    "dvrk_gravity/observation/arm_side.py": ('"other_hand"',),
    "dvrk_gravity/model/uncertainty.py": ("together: Array", "self.together"),
    "dvrk_gravity/recording/notes.py": ('"other_hand"',),
}
# Regular expression -> what to say. A blank stands for blanks, line ends and underscores, so that
# names in code count, too.
OLD = {
    "(no|is|are) news": "minor effects; expected, not reported",
    "tells?|told|telling": "shows, reports, states, names; distinguishes",
    "(hangs?|hung) (on|together)": "depends on; is correlated",
    "(comes?|came) back": "recurs, returns; recurring discrepancy",
    "nameless": "unexplained structure",
    "rightly": "correctly; correct_readings",
    "unstated": "baseline effects; not stated",
    "(an)?other day": "day-to-day friction variation",
    "weighed": "payload check; estimated mass; weighted samples",
    "alike": "equal, similar; homogeneity",
    "by perhaps": "(not significant), after the number",
    "other hand": "other arm side",
    "read before": "duplicate samples",
    "improbable": "negative log prior",
    "stood in for": "confounded columns",
    "taken in|took in": "absorbed variance; absorbed",
    "over with it": "sent, not yet acknowledged",
    "when all was well": "baseline recording",
    "known poorly": "uncertain by ±",
    "how sure": "uncertainty",
    "surely": "significantly",
    "suppos(e|es|ed|ing)": "assume; hypothesise",
    "on trial": "under test",
    "of consequence": "large enough to matter; practical equivalence",
    "anew": "again",
    "Tried(?=[.:(\\]|])": "multiplicity, n_comparisons",
    "(?<=\\.)together(?!\\()|together: (float|Array|NDArray)": "correlation_time",
    "(?<=\\.)freedom|freedom: (int|float)": "dof",
}


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


def test_the_field_s_words_stand_where_ours_were_replaced():
    patterns = []
    for old, say in OLD.items():
        words = old.lower().replace(" ", r"[\s_#]+")
        whole = re.compile(rf"(?<![^\W_])(?:{words})(?![^\W_])")
        patterns.append((whole, say))
    places = [REPOSITORY / place for place in CLEAN]
    paths = [path for place in places for kind in ("md", "py") for path in place.rglob(f"*.{kind}")]
    found = []
    for path in [*(place for place in places if place.is_file()), *paths]:
        text = path.read_text(encoding="utf-8")
        text = prose(text) if path.suffix == ".md" else text
        name = path.relative_to(REPOSITORY).as_posix()
        for code in IN_FILES.get(name, ()):
            text = text.replace(code, "")
        text = text.lower()
        found += [f"{name}:{text.count(chr(10), 0, match.start()) + 1}: {match.group()!r}: {say}"
                  for pattern, say in patterns for match in pattern.finditer(text)]  # fmt: skip
    assert found == []
    # None of what to say instead is refused, and an old expression is, even across a line's end.
    assert not [say for say in OLD.values() for pattern, _ in patterns if pattern.search(say)]
    assert [pattern for pattern, _ in patterns if pattern.search("# of another\n# day")]
