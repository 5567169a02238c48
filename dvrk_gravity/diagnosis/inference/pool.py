"""What a motion is examined with: its filtered data, and every hypothesis that needs no search."""

from __future__ import annotations

from collections.abc import Iterable

from dvrk_gravity import effects
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.refinement import begun
from dvrk_gravity.diagnosis.inference.unstated import unstated
from dvrk_gravity.effects import Hypothesis


def hypotheses(motion: MeasuredMotion) -> Iterable[Hypothesis]:
    """Yield every hypothesis that needs no search in the residual."""
    for effect in effects.effects():
        yield from effect.hypotheses(motion)


def prepared(motion: MeasuredMotion) -> tuple[CrossValidation, list[Candidate]]:
    """Return what compares hypotheses about a motion, and those that need no search."""
    validation = CrossValidation(FilteredData.of(motion))
    pool = [
        candidate
        for candidate in validation.data.candidates(hypotheses(motion))
        if candidate.acts.any()
    ]
    beside = unstated(validation, pool)
    return validation, [begun(validation, candidate, beside) for candidate in pool]
