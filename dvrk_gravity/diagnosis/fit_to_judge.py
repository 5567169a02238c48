"""Refusal of efforts that no model can be judged by: noise, or without the model's gravity.

Any effect reduces the error on such efforts a little, and none of them is the cause.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.recording_faults import beginning
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import beats
from dvrk_gravity.identification import GONE, READ_WITHOUT, bears_weight
from dvrk_gravity.intake import predictable
from dvrk_gravity.recording import Recording, RecordingFile
from dvrk_gravity.units import quantity

# Standard errors by which a prediction must beat a constant. Chosen: of two predictions at each of
# seven joints one in fifty does by chance.
_DEVIATIONS = 3.0
# Part of what inertia and friction leave of a joint's effort, squared, that the weights of all
# joints explain, below which they are not in it. Chosen: smooth functions of the positions explain
# some of any error.
_EXPLAINED = 0.25
_SAMPLES = 4000  # that are looked at: a bound on time


def require_predictable(
    motion: MeasuredMotion, recordings: Sequence[Recording | RecordingFile]
) -> None:
    """Refuse efforts that neither the model predicts, nor a plain one fitted to them.

    Args:
        motion: The motion, with the model on trial.
        recordings: Its recordings, corrected.

    Raises:
        RecordingError: Efforts of which those of no joint are predicted better than by a constant.
    """
    if motion.static or not motion.present.all():
        return  # no plain model is determined there
    usable = ~motion.silent
    error, off = (np.where(usable, each, 0.0) for each in (motion.residual, _centred(motion)))
    if beats(error**2, off**2, _DEVIATIONS).any():
        return
    for recording in recordings:
        try:
            if predictable(beginning(recording), motion.arm, _DEVIATIONS):
                return
        except RecordingError:  # too short a one for a plain model
            return
    raise RecordingError(
        recordings[0].head.source,
        "efforts of no joint are predicted better than by a constant, by the model or by one that "
        "is fitted to them: noise, or those of another motion?",
    )


def _centred(motion: MeasuredMotion) -> Array:
    """Return (N, n) efforts less their means over usable samples."""
    usable = ~motion.silent
    count = np.maximum(usable.sum(axis=0), 1)
    return motion.effort - np.where(usable, motion.effort, 0.0).sum(axis=0) / count


def require_gravity(motion: MeasuredMotion, source: str) -> None:
    """Refuse efforts without the model's gravity.

    Most joints that bear weight must lack it; a single one may be balanced, or broken. Efforts of
    another sign or scale, or exchanged, are explained by the weights of the joints.

    Raises:
        RecordingError: Naming the joints, and the option for efforts read without gravity.
    """
    arm = motion.arm
    if not arm.gravity_in_reading:
        return
    terms = tuple(term for term in motion.model.terms if term.WEIGHT_OF_ARM)
    rows = slice(None, None, max(1, len(motion.q) // _SAMPLES))
    weight = sum(
        (term.torque(State.of(motion.true_q[rows])) for term in terms),
        np.zeros_like(motion.q[rows]),
    )
    size = np.sqrt(np.mean(weight**2, axis=0))
    bearing = np.flatnonzero(bears_weight(size, arm) & motion.moves & (size > 0.0))
    held = {joint: _held(motion, rows, weight, joint) for joint in bearing.tolist()}
    gone = {
        joint: found
        for joint, (found, share) in held.items()
        if share < _EXPLAINED and found < GONE * size[joint]
    }
    if 2 * len(gone) <= len(held):
        return
    shown = ", ".join(
        f"{arm.joint_names[joint]} ({found:.2g} of {quantity(size[joint], unit)})"
        for joint, found in gone.items()
        for unit in [arm.joints[joint].effort_unit]
    )
    raise RecordingError(
        source,
        f"gravity is not in the efforts of {shown}, RMS, that the model holds there: does the "
        f"driver subtract it? {READ_WITHOUT} says so",
    )


def _held(motion: MeasuredMotion, rows: slice, weight: Array, joint: int) -> tuple[float, float]:
    """Return the RMS of a joint's effort that the (N, n) weights explain, and their share of it.

    Beside the rest of the model, a constant, friction and a rotor.
    """
    usable = ~motion.silent[rows, joint]
    speed = motion.qd[rows, joint]
    rest = motion.modelled[rows, joint] - weight[:, joint]
    beside = [np.ones_like(speed), np.sign(speed), speed, motion.qdd[rows, joint], rest]
    columns = np.stack(beside, axis=1)[usable]
    both = np.column_stack([motion.effort[rows, joint][usable], weight[usable]])
    both = both - columns @ np.linalg.lstsq(columns, both, rcond=None)[0]
    effort, weights = both[:, 0], both[:, 1:]
    explained = weights @ np.linalg.lstsq(weights, effort, rcond=1e-6)[0]
    left = max(float(np.sum(effort**2)), 1e-300)
    return float(np.sqrt(np.mean(explained**2))), float(np.sum(explained**2)) / left
