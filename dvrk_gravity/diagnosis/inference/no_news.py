"""What is significant, and no news: less than the model is known to miss, or there before."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.alternatives import SelectedEffect
from dvrk_gravity.diagnosis.inference.at_calibration import AtCalibration
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.selection import EffectTrial, Selection, SelectionSettings
from dvrk_gravity.diagnosis.inference.significance import Significance


@dataclass(frozen=True)
class NoNewsSettings:
    """How much of it is told.

    Attributes:
        most: Effects, one a joint. Chosen.
    """

    most: int = 3


def no_news(
    validation: CrossValidation,
    pool: Sequence[Candidate],
    selected: Sequence[SelectedEffect],
    unknown: Sequence[EffectTrial],
    at_calibration: AtCalibration | None,
) -> list[EffectTrial]:
    """Return what is significant beside the findings, and no news.

    It is less than the model's known error, of which, too, it may be a part: what the model is
    known to miss has causes as well; or there was as much of it when the model was identified.

    Args:
        validation: What compares hypotheses.
        pool: Those that need no search.
        selected: Named findings.
        unknown: Structure without a name.
        at_calibration: What was there when the model was identified.
    """
    if not validation.known_error.any():
        return []
    validation = copy(validation)
    lenient = replace(validation.significance.settings, least=0.0)
    validation.significance = Significance(validation.data, lenient)
    chosen = [effect.trial.candidate for effect in selected]
    chosen += [trial.candidate for trial in unknown]
    settings = replace(SelectionSettings(), consequence=0.0, another_day=0.0, share=0.0)
    selection = Selection(
        validation, pool, lambda line: None, settings=settings, at_calibration=at_calibration
    )
    validation.weigh(validation.out_of_fold(chosen))
    # What is more was a finding, had held-out blocks confirmed it.
    most = SelectionSettings().least(validation)
    told: list[EffectTrial] = []
    trials = selection.best(chosen, validation.score(chosen))
    for_all = [trial for trial in trials if _no_news(trial, most)][:1]
    if for_all and for_all[0].candidate.hypothesis.common_cause:
        # One for all joints: others are told as far as they differ from it.
        beside = [*chosen, for_all[0].candidate]
        trials = selection.best(beside, validation.score(beside))
        told += for_all
    joints: set[int] = set()
    for trial in trials:
        own = trial.candidate.hypothesis.joints
        if _no_news(trial, most) and joints.isdisjoint(own):
            told.append(trial)
            joints.update(own)
    return told[: NoNewsSettings().most]


def _no_news(trial: EffectTrial, most: Array) -> bool:
    """Tell whether a trial is of something, and no finding."""
    return (trial.passes and not np.any(trial.size > most)) or trial.seen_before
