"""Efforts that no model can be judged by: noise, those of another motion, those without gravity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.faults import beginning
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import beats
from dvrk_gravity.identification import READ_WITHOUT, bears_weight
from dvrk_gravity.observation import predictable
from dvrk_gravity.recording import Recording
from dvrk_gravity.units import quantity

# Standard errors by which a prediction must beat a constant. Chosen: of two predictions at each of
# seven joints one in fifty does by chance.
_DEVIATIONS = 3.0
# Part of what inertia and friction leave of a joint's effort, and of its weight, squared, that the
# weights of all joints explain, below which they are not in it. Chosen: smooth functions of the
# positions explain some of any error. A weight that would be a smaller part cannot be judged.
# `identify` has a fit and its standard errors, and another question: the part of the masses' weight
# that is left (`GONE`), where another unit counts as none. Here efforts may have any scale.
_EXPLAINED = 0.25
_CONSTANT = 0.01  # of a weight's RMS: what varies less is not distinguished from a bias. Chosen
_SAMPLES = 4000  # that are looked at: a bound on time


def require_predictable(motion: MeasuredMotion, recordings: Sequence[Recording]) -> None:
    """Refuse efforts that neither the model predicts, nor a plain one fitted to them.

    Args:
        motion: The motion, with the model under test.
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
        recordings[0].source,
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

    Most joints that bear weight must lack it; a single one may be balanced, or broken. A weight
    that stays the same, as on a vertical slide, cannot be distinguished from a bias. Efforts of
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
    varies = weight.std(axis=0) > _CONSTANT * size
    bearing = np.flatnonzero(bears_weight(size, arm) & motion.moves & varies)
    lacks = {joint: _lacks(motion, rows, weight, joint) for joint in bearing.tolist()}
    gone = [joint for joint, lacking in lacks.items() if lacking]
    judged = [joint for joint, lacking in lacks.items() if lacking is not None]
    if 2 * len(gone) <= len(judged):
        return
    shown = ", ".join(
        f"{arm.joint_names[joint]} ({quantity(size[joint], arm.joints[joint].effort_unit)})"
        for joint in gone
    )
    raise RecordingError(
        source,
        f"gravity is not in the efforts of {shown}, RMS by the model: does the driver subtract it? "
        f"{READ_WITHOUT} says so",
    )


def _lacks(motion: MeasuredMotion, rows: slice, weight: Array, joint: int) -> bool | None:
    """Return whether a joint's effort lacks the (N, n) weights; None: the motion would not show it.

    It does not where they are in it as the model states them, which their mean shows, too. Else,
    beside a constant, friction, a rotor and the rest of the model, at its scale in the efforts.
    """

    def left(values: Array, columns: Array) -> Array:
        return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=1e-6)[0])

    used, effort = ~motion.silent[rows, joint], motion.effort[rows, joint]
    modelled, speed = motion.modelled[rows, joint], motion.qd[rows, joint]
    rest = modelled - weight[:, joint]
    stated, unweighted = (float(np.sum((effort - each)[used] ** 2)) for each in (modelled, rest))
    if stated <= (1.0 - _EXPLAINED) * unweighted:
        return False
    beside = np.ones_like(speed), np.sign(speed), speed, motion.qdd[rows, joint]
    every = np.column_stack([*beside, effort, rest, weight])[used]
    every = left(every[:, 4:], every[:, :4])
    effort, rest, weights = every[:, 0], every[:, 1:2], every[:, 2:]
    scale = float(np.linalg.lstsq(rest, effort, rcond=None)[0][0]) if rest.any() else 1.0
    own = float(np.sum((scale * left(weights, rest)[:, joint]) ** 2))
    without, by_all = (
        float(np.sum(left(effort, of) ** 2)) for of in (rest, np.hstack([rest, weights]))
    )
    if without - by_all >= _EXPLAINED * min(own, without):
        return False
    return True if own >= _EXPLAINED * without else None
