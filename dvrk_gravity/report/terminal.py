"""What a terminal shows of any answer: lines laid out, and the few that a user has to act on."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterator, Sequence

from dvrk_gravity.observation import contradiction
from dvrk_gravity.recording import Kind, Note, brief

MOST_WARNINGS = 3
"""Lines of warnings without ``--verbose``. Chosen: what is left of a screen beside a table."""

_NARROW = 40  # columns that a cell needs to be read
_HANG = " " * 4
_GREEN, _YELLOW, _RED, _BOLD = 32, 33, 31, 1  # of ECMA-48
_COLOURS = {
    "good": _GREEN, "usable": _YELLOW, "do_not_compensate": _RED,
    "nothing_to_explain": _GREEN, "cannot_judge": _YELLOW, "unexplained": _RED,
}  # fmt: skip
_PAINT = re.compile("\033\\[[0-9]+m")

# Found and put right, or of no consequence for what to do: for the report and --verbose. A kind
# that is not here is shown.
_DETAIL: frozenset[Kind] = frozenset(
    (
        "invalid_stamps", "repeated_stamps", "duplicate_samples", "stale_samples", "read_jitter",
        "time_jitter", "gaps", "samples_discarded", "velocity_mismatch", "effort_ripple",
        "position_quantisation", "velocity_quantisation", "effort_quantisation", "excerpt",
    )
)  # fmt: skip
# But for samples that were left out, if they are more than this part of a recording. Chosen: what a
# few lost messages never are.
_LEFT_OUT: frozenset[Kind] = frozenset(
    ("invalid_stamps", "repeated_stamps", "duplicate_samples", "samples_discarded", "excerpt")
)
_MUCH = 0.1
_WARNING = "warning: "
_DATA = "data: "
# Done with the data, or true of them, so that a user has to know it, and no reason for concern.
_DONE: frozenset[Kind] = frozenset(
    (
        "columns", "held_joints", "effort_read", "drive_gains", "known_errors", "for_file",
        "not_judged",
    )
)  # fmt: skip


def columns() -> int | None:
    """Return the width of the terminal on standard output; ``None`` where it is none.

    Lines for a file or a pipe are not wrapped, so that each can be searched for.
    """
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def wrap(text: str, width: int | None, head: str = "") -> str:
    """Return a line, wrapped to a width; what follows the head goes on below its beginning.

    Where the head leaves little room, and the text needs more, the text has lines of its own.
    """
    wide = len(_PAINT.sub("", head))
    if width is None or not text or wide + len(text) <= width:
        return head + text
    apart = head and width - wide < _NARROW
    lines = textwrap.wrap(
        text,
        width,
        initial_indent=_HANG if apart else " " * wide,
        subsequent_indent=_HANG if apart or not head else " " * wide,
        break_on_hyphens=False,
        break_long_words=False,
    )
    return "\n".join([head.rstrip(), *lines] if apart else [head + lines[0][wide:], *lines[1:]])


def colorize(text: str, verdict: str, width: int | None) -> str:
    """Return a verdict's word in its colour; as it is where NO_COLOR asks for that (no-color.org).

    Args:
        text: The word.
        verdict: Of an identification or a diagnosis; others are bold.
        width: Columns of the terminal; ``None``: there is none, and no colour.
    """
    if width is None or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    return f"\033[{_COLOURS.get(verdict, _BOLD)}m{text}\033[0m"


def warning_lines(warnings: Sequence[Note], verbose: bool = False) -> Iterator[str]:
    """Yield what is odd about recordings: all of it, or what a user has to act on, in few lines.

    That they are of another arm is said before all else (:func:`contradiction`), and not again.

    Args:
        warnings: What was found in the recordings.
        verbose: Yield every warning.
    """
    detail = [warning for warning in warnings if _is_detail(warning)]
    first = contradiction(warnings)
    done = [warning for warning in warnings if warning.kind in _DONE]
    yield from (f"{_DATA}{line}" for line in brief(done))
    rest = [
        warning
        for warning in warnings
        if warning not in detail and warning not in done and str(warning) != first
    ]
    rest.sort(key=lambda warning: warning.numbers.get("samples", 0.0) == 0.0)  # what is left out
    acted_on = [f"{_WARNING}{line}" for line in brief(rest)]
    if verbose:
        yield from acted_on
        yield from (f"{_WARNING}{line}" for line in brief(detail))
        return
    yield from acted_on[:MOST_WARNINGS]
    left = len(acted_on[MOST_WARNINGS:])
    more = left + len(brief(detail))
    if more:
        plural = "s" if more > 1 else ""
        about = f"warning{plural}" if left else f"note{plural} on what was done with the data"
        yield f"and {more} more {about}: --verbose"


def _is_detail(warning: Note) -> bool:
    much = warning.kind in _LEFT_OUT and warning.numbers.get("share", 0.0) > _MUCH
    return warning.kind in _DETAIL and not (warning.unusable or much)
