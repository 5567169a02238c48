"""What a search begins with: the hypotheses about a motion, and those that any arm has."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dvrk_gravity import effects
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.fit_context import FitContext
from dvrk_gravity.diagnosis.inference.nonlinear import begun
from dvrk_gravity.effects import Hypothesis


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """The hypotheses about a motion that need no search in its residual.

    Attributes:
        context: The samples, ready for comparisons, with the ordinary effects.
        pool: The hypotheses with their columns.
    """

    context: FitContext
    pool: list[Candidate]

    @property
    def motion(self) -> MeasuredMotion:
        """The motion."""
        return self.context.validation.data.motion

    @classmethod
    def about(cls, motion: MeasuredMotion) -> Hypotheses:
        """Return those about a motion."""
        return cls.of(ordinary_effects(motion))

    @classmethod
    def of(cls, context: FitContext) -> Hypotheses:
        """Return those of the motion of a context."""
        validation = context.validation
        pool = _acting(validation, every_hypothesis(validation.data.motion))
        return cls(context, [begun(validation, each, context.candidates) for each in pool])


def every_hypothesis(motion: MeasuredMotion) -> Iterable[Hypothesis]:
    """Yield every hypothesis that needs no search in the residual."""
    for effect in effects.effects():
        yield from effect.hypotheses(motion)


def _acting(validation: CrossValidation, claims: Iterable[Hypothesis]) -> list[Candidate]:
    """Return hypotheses with their columns, but for those that do nothing in a motion."""
    return [each for each in validation.data.candidates(claims) if each.acts.any()]


def ordinary_effects(motion: MeasuredMotion) -> FitContext:
    """Return the filtered data of a motion, ready for comparisons, with the ordinary effects.

    These are the effects that any joint has and an arm's own file states poorly, of plausible
    size. Where an identified model is tested, only a load that is stated.
    """
    validation = CrossValidation.of(FilteredData.of(motion))
    names = {term.NAME for term in effects.terms() if term.EVERYWHERE} & poorly_stated(motion)
    claims = (each for each in every_hypothesis(motion) if each.STATED or each.effect in names)
    found: dict[tuple[str, tuple[int, ...]], Candidate] = {}
    for candidate in _acting(validation, claims):
        hypothesis = candidate.hypothesis
        if hypothesis.STATED or candidate.size == 1:
            found.setdefault((hypothesis.effect, hypothesis.joints), candidate)
    expected = list(found.values())
    while expected:
        fitted = split(expected, validation.parameters(expected))
        kept = [each for each, theta in fitted if each.hypothesis.plausible(theta)]
        if len(kept) == len(expected):
            break
        expected = kept
    return FitContext(validation, tuple(expected))


def poorly_stated(motion: MeasuredMotion) -> set[str]:
    """Return the effects that an arm's own file states poorly: friction, rotors.

    Its values are often placeholders, such as one damping for all joints.
    """
    if not motion.model.of_file or motion.measured_twice:
        return set()
    return {term.NAME for term in effects.terms() if term.EVERYWHERE or term.FRICTION}
