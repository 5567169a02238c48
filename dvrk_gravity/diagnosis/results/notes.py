"""How a recording was judged, in sentences."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.loading import Loaded
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.results.findings import FLOORS
from dvrk_gravity.model import TorqueModel


def notes(loaded: Loaded, validation: CrossValidation, floor: Array) -> tuple[str, ...]:
    """Return how the recordings were handled and hypotheses judged, a sentence each.

    Args:
        loaded: The motion as it was finally read.
        validation: What compared hypotheses.
        floor: (n,) noise, N·m.
    """
    data = validation.data
    notes = [
        *loaded.handling,
        f"{data.count} blocks, every third held out of fit and choice; "
        "the others in five folds for cross-validation",
    ]
    if data.repetition is not None:
        notes.append(
            f"the motion repeats every {data.repetition.period:.4g} s, {data.copies:.3g} times "
            "in all: a block is one phase of every period"
        )
    notes.append(f"noise floor: {FLOORS[data.noise_source(floor)]}")
    notes += _certainty(data)
    if data.band is not None:
        notes.append(f"torques and hypotheses compared below {data.band:g} Hz, zero-phase")
        motion = loaded.motion
        notes += _standing(motion)
        stuck = np.where(motion.stands, 0.0, motion.stuck.mean(axis=0))
        notes += [
            f"{name} stands still for {100 * part:.0f} % of the time: left out there"
            for name, part in zip(motion.arm.joint_names, stuck, strict=True)
            if part > 0.05
        ]
    return tuple(notes)


def exact(model: TorqueModel) -> str:
    """Return why a model counts as exact; ``""``: it says how sure it is."""
    if model.uncertainty is not None:
        return ""
    return model.unsure or "nothing beside it says how sure it is"


def _certainty(data: FilteredData) -> list[str]:
    """Return how sure the model was taken to be, one sentence each."""
    motion = data.motion
    uncertainty = motion.model.uncertainty
    if motion.reference is not None:
        return ["in the place of a model stood what the reference measured at the same phase"]
    if uncertainty is None:
        why = f" ({motion.model.unsure})" if motion.model.unsure else ""
        return [
            f"the model does not tell how sure it is{why}: its parameters were taken as exact and, "
            "where much was left, as free as links plausibly weigh (their prior in "
            "docs/judgement.md)"
        ]
    return [
        f"the model's parameters could move in {uncertainty.size} directions as far as their "
        "identification left them uncertain, and its known error counted as noise"
    ]


def _standing(motion: MeasuredMotion) -> list[str]:
    """Return a line about the joints that never move, if there are any."""
    names = [motion.arm.joint_names[joint] for joint in np.flatnonzero(motion.stands).tolist()]
    if not names:
        return []
    return [
        f"not judged: efforts of {', '.join(names)}: where a joint stands still all the time, "
        "friction may hold any torque up to its level"
    ]
