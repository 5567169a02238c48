"""How recordings were prepared and hypotheses judged, in words."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.results.sentences import FLOORS
from dvrk_gravity.recording import Note


def method_notes(motion: MeasuredMotion, data: FilteredData, floor: np.ndarray) -> list[str]:
    """Return how recordings were prepared and hypotheses judged, a sentence each.

    Args:
        motion: The motion as it was finally read.
        data: What was compared.
        floor: (n,) noise, N·m.
    """
    blocks = data.settings.blocks
    notes = [
        *motion.processing_log,
        f"{data.count} blocks, one in {blocks.held_out} held out of fit and model selection; the "
        f"others in {blocks.folds} folds for cross-validation",
    ]
    if data.repetition is not None:
        notes.append(
            f"the motion repeats every {data.repetition.period:.4g} s, {data.copies:.3g} times: a "
            "block is one phase of every period"
        )
    notes.append(f"noise floor: {FLOORS[data.noise_source(floor)]}")
    notes.append(_certainty(data))
    if data.band is None:
        return notes
    notes.append(f"torques and hypotheses compared below {data.band:g} Hz, zero-phase")
    names = np.array(motion.arm.joint_names)
    stuck = np.where(motion.stands, 0.0, motion.stuck.mean(axis=0))
    return notes + [
        f"{name} stands still {100 * part:.0f} % of the time: those samples are left out"
        for name, part in zip(names, stuck, strict=True)
        if part > 0.05
    ]


def not_judged(motion: MeasuredMotion) -> tuple[Note, ...]:
    """Return a note on joints whose efforts show nothing, if there are any."""
    if not motion.stands.any():
        return ()
    names = ", ".join(np.array(motion.arm.joint_names)[motion.stands])
    text = (
        f"not judged: efforts of {names}, which never move: friction may hold any torque up to its "
        "level"
    )
    return (Note("not_judged", None, {}, text),)


def _certainty(data: FilteredData) -> str:
    """Return how certain the model was taken to be."""
    model = data.motion.model
    if not data.expectation.predicts:
        return "the reference's efforts at the same phase were used in place of a model's torques"
    if model.uncertainty is None:
        why = f" ({model.unsure})" if model.unsure else ""
        return (
            f"the model states no uncertainty{why}: its parameters were taken as exact and, where "
            "much error remained, as free as links plausibly weigh (their prior in "
            "docs/judgement.md)"
        )
    return (
        f"the model's parameters were free in {model.uncertainty.size} directions within their "
        "posterior, and its error at calibration counted as noise"
    )
