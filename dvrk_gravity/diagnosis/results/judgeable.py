"""Whether a diagnosis could have seen what a user asks about, and why not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.inference.detectable import Detectable
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.results import sentences
from dvrk_gravity.effects import is_friction
from dvrk_gravity.model import VERDICTS

# Part of a joint's effort limit, and all of its own dry friction, that friction which would be
# missed may exceed. Dry friction of a real MTM is .8 to 9 % of the limits, up to 19 % with what its
# calibrated model leaves of static poses besides. A user asks about twice the friction.
_OF_LIMIT = 0.2
# Of the error that its own uncertainty predicts, below which that is not the model's: the median of
# the joints. Chosen: other motions of a real MTM, PSM and UR10e and of a simulated chain have .6 to
# 1.5; with deviations thirty times as large .04 to .09 (the PSM, recorded days later, .6), with a
# known error thirty times as large .01 to .05.
_FAR_BELOW = 0.2


def reasons_not_to_judge(
    data: FilteredData, held_out: HeldOut, detectable: Sequence[Detectable]
) -> tuple[str, ...]:
    """Return why nothing that is not found may be said not to be there, a clause each.

    Args:
        data: What was compared.
        held_out: The held-out samples.
        detectable: What would have been found.
    """
    return (*_unfit(data), *_too_uncertain(data, held_out), *_unseen(data, held_out, detectable))


def _unfit(data: FilteredData) -> Iterator[str]:
    """Yield that the model's own verdict is that it is unfit."""
    model = data.motion.model
    if data.expectation.predicts and model.verdict == VERDICTS[-1]:
        yield sentences.unfit_model(model)


def _too_uncertain(data: FilteredData, held_out: HeldOut) -> Iterator[str]:
    """Yield that errors are far below those that an identified model's uncertainty predicts."""
    uncertainty = data.motion.model.uncertainty
    if uncertainty is None or not data.expectation.identified:
        return
    torque = data.model_columns[held_out.rows][:, :, : uncertainty.size]
    variance = (torque**2).sum(axis=2) + data.known_error**2
    predicted = held_out.rmse(np.sqrt(variance))
    judged = held_out.seen & (predicted > 0.0)
    error = held_out.rmse(held_out.as_read())
    if not judged.any():
        return
    ratio = float(np.median(error[judged] / predicted[judged]))
    if ratio < _FAR_BELOW:
        yield sentences.error_far_below(ratio, _FAR_BELOW)


def _unseen(
    data: FilteredData, held_out: HeldOut, detectable: Sequence[Detectable]
) -> Iterator[str]:
    """Yield how much friction would have been missed where that is more than a joint's own."""
    arm = data.motion.arm
    own = np.sqrt(np.mean(data.motion.friction**2, axis=0))
    most: Array = np.maximum(own, _OF_LIMIT * arm.effort_limit)
    missed = [
        (each, float(most[joint]))
        for each in detectable
        if is_friction(each.effect)
        for joint in [arm.joint_names.index(each.joint)]
        if held_out.seen[joint] and each.size > most[joint]
    ]
    if missed:
        each, limit = max(missed, key=lambda pair: pair[0].size / pair[1])
        yield sentences.unseen_friction(each.joint, each.size, limit, each.unit, len(missed) - 1)
