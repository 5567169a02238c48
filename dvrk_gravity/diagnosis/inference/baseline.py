"""All hypotheses about a motion, and the baseline effects that every arm has: friction, rotors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dvrk_gravity import effects
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.refinement import begun
from dvrk_gravity.effects import Hypothesis


def hypotheses(motion: MeasuredMotion) -> Iterable[Hypothesis]:
    """Yield every hypothesis that needs no search in the residual."""
    for effect in effects.effects():
        yield from effect.hypotheses(motion)


def prepared(motion: MeasuredMotion) -> tuple[CrossValidation, list[Candidate]]:
    """Return the filtered data of a motion, ready for comparisons, and these hypotheses."""
    validation = CrossValidation(FilteredData.of(motion))
    pool = [
        candidate
        for candidate in validation.data.candidates(hypotheses(motion))
        if candidate.acts.any()
    ]
    beside = baseline_effects(validation, pool)
    return validation, [begun(validation, candidate, beside) for candidate in pool]


def baseline_effects(validation: CrossValidation, pool: Sequence[Candidate]) -> list[Candidate]:
    """Return the effects that any joint has and an arm's own file states poorly.

    Only those of plausible size. None where an identified model is tested.

    Args:
        validation: The samples.
        pool: Hypotheses that need no search.
    """
    names = {term.NAME for term in effects.terms() if term.EVERYWHERE}
    names &= poorly_stated(validation.data.motion)
    found: dict[tuple[str, tuple[int, ...]], Candidate] = {}
    for candidate in pool:
        hypothesis = candidate.hypothesis
        if hypothesis.effect in names and candidate.size == 1:
            found.setdefault((hypothesis.effect, hypothesis.joints), candidate)
    expected = list(found.values())
    while expected:
        fitted = split(expected, validation.parameters(expected))
        kept = [each for each, theta in fitted if each.hypothesis.plausible(theta)]
        if len(kept) == len(expected):
            break
        expected = kept
    return expected


def poorly_stated(motion: MeasuredMotion) -> set[str]:
    """Return the effects that an arm's own file states poorly: friction, rotors.

    Its values are often placeholders, such as one damping for all joints.
    """
    if not motion.model.of_file or motion.reference is not None:
        return set()
    return {term.NAME for term in effects.terms() if term.EVERYWHERE or term.FRICTION}
