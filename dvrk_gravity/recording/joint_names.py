"""Names of joints that a robot's prefix sets apart from those of its arm's file."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence

from dvrk_gravity.recording.notes import Note, note


def arm_names(recorded: Iterable[str], known: Sequence[str]) -> dict[str, str]:
    """Return the arm's names of recorded joints, where one prefix or suffix makes these of those.

    Either the recorded names have it, or the arm's. Empty if an arm's joint is recorded under its
    own name, if some are missing, and if several prefixes would do (two robots in one recording).

    Args:
        recorded: Names in the recording.
        known: Names of all the arm's joints.
    """
    names = set(recorded)
    if len(known) < 2 or names & set(known):
        return {}
    first, found = known[0], []
    for name in names:
        for outer, inner in ((name, first), (first, name)):
            for match in re.finditer(f"(?={re.escape(inner)})", outer) if inner else ():
                before, after = outer[: match.start()], outer[match.start() + len(inner) :]
                if outer is name:
                    mapping = {f"{before}{joint}{after}": joint for joint in known}
                else:
                    mapping = {
                        joint[len(before) : len(joint) - len(after)]: joint
                        for joint in known
                        if joint.startswith(before) and joint.endswith(after)
                    }
                if len(mapping) == len(known) and mapping.keys() <= names:
                    found.append(mapping)
    return found[0] if len(found) == 1 else {}


def note_on(names: dict[str, str]) -> tuple[Note, ...]:
    """Return a note on joints that are read under other names, if there are any."""
    if not names:
        return ()
    recorded, joint = next(iter(names.items()))
    return (note("columns", f"joints read: {recorded} as {joint}, and so on"),)


def fits(recorded: Collection[str], known: Sequence[str]) -> bool:
    """Return whether recorded joints are some of an arm's, under its names or with a prefix."""
    return bool(set(recorded) & set(known)) or bool(arm_names(recorded, known))


def renaming(recorded: str) -> str:
    """Return how a user names a recorded joint's counterpart, as the end of an error."""
    return f"; or --columns '{recorded}=<joint>,…' with the arm's joint for each name"
