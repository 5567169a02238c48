"""What every arm has and its file says little of: friction and rotors, beside all other causes."""

from __future__ import annotations

from collections.abc import Sequence

from dvrk_gravity import effects
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation


def unstated(validation: CrossValidation, pool: Sequence[Candidate]) -> list[Candidate]:
    """Return what is to be expected at each joint though the arm's file says little of it.

    None of it where less would be left than nothing. Of an identified model, nothing is expected.

    Args:
        validation: What compares hypotheses.
        pool: Those that need no search.
    """
    names = {term.NAME for term in effects.terms() if term.EVERYWHERE}
    names &= little_said_of(validation.data.motion)
    found: dict[tuple[str, tuple[int, ...]], Candidate] = {}
    for candidate in pool:
        hypothesis = candidate.hypothesis
        if hypothesis.effect in names and candidate.size == 1:
            found.setdefault((hypothesis.effect, hypothesis.joints), candidate)
    expected = list(found.values())
    while expected:
        theta = validation.parameters(expected)
        kept = [
            candidate
            for candidate, value in split(expected, theta)
            if candidate.hypothesis.plausible(value)
        ]
        if len(kept) == len(expected):
            break
        expected = kept
    return expected


def little_said_of(motion: MeasuredMotion) -> set[str]:
    """Return names of what arms have and an arm's own file says little of: friction, rotors.

    What it says, if anything, is a placeholder as often as not: many have one damping throughout.
    """
    if not motion.model.of_file or motion.reference is not None:
        return set()
    return {term.NAME for term in effects.terms() if term.EVERYWHERE or term.FRICTION}
