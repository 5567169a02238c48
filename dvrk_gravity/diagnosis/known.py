"""What a model says of its own error, and what of a recording that accounts for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.alike import Alike
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.filtered_data import FilteredData
from dvrk_gravity.diagnosis.findings import ERROR, PARAMETERS, Known
from dvrk_gravity.diagnosis.held_out import HeldOut, estimates
from dvrk_gravity.diagnosis.model_error import part_of_friction
from dvrk_gravity.diagnosis.selection import EffectTrial, SelectionSettings
from dvrk_gravity.effects import Estimate, Kind, is_friction
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.parameters import FRICTION_RATIO
from dvrk_gravity.units import quantity


def expected_error(data: FilteredData, held_out: HeldOut) -> Array:
    """Return (n,) RMS error that a model expects of itself on held-out samples, N·m.

    The root of the mean square of its known error, of what friction changes by from day to day, and
    of what its parameters' posterior lets its torque be off by; NaN of a model that does not tell.
    """
    if data.motion.model.uncertainty is None:
        return np.full(data.motion.arm.n, np.nan)
    usable = data.usable[held_out.rows]
    variance = (data.model_columns[held_out.rows] ** 2).sum(axis=2)
    variance = np.minimum(variance, data.motion.arm.effort_limit**2)
    mean = np.where(usable, variance, 0.0).sum(axis=0) / np.maximum(usable.sum(axis=0), 1)
    return np.sqrt(data.expected_on_another_day**2 + mean)


def known(
    validation: CrossValidation,
    held_out: HeldOut,
    minor: Sequence[EffectTrial],
    named: Sequence[Candidate],
    expected: Array,
) -> tuple[Known, ...]:
    """Return what the model's uncertainty and its known error account for.

    Args:
        validation: The validation.
        held_out: The held-out samples.
        minor: Effects that are significant, and smaller than the known error, or what friction
            changes by from day to day.
        named: The selected effects.
        expected: See :func:`expected_error`.
    """
    motion = validation.data.motion
    if motion.reference is not None:
        return _between_recordings(validation, held_out, named)
    if motion.model.uncertainty is None:
        return ()
    arm = motion.arm
    source = "file" if motion.model.of_file else "identification"
    told = [_minor(validation, trial, named) for trial in minor]
    moved = validation.moved(named)[held_out.rows]
    residual_rmse = held_out.rmse(held_out.error(named))
    size = held_out.rmse(np.where(validation.data.usable[held_out.rows], moved, np.nan))
    for joint in np.flatnonzero(motion.present & held_out.seen).tolist():
        name, unit = arm.joint_names[joint], arm.joints[joint].effort_unit
        error = float(validation.data.expected_on_another_day[joint])
        if size[joint] > error:
            reach = float(np.sqrt(max(expected[joint] ** 2 - error**2, 0.0)))
            moves = (
                f"{quantity(float(size[joint]), unit)} RMS at {name} are the model's own parameters"
            )
            left_open = f"what its {source} left open ({quantity(reach, unit)} RMS)"
            how = "moved within" if size[joint] <= NORMAL_95 * reach else "moved further than"
            told.append(
                _of_size(
                    PARAMETERS, name, float(size[joint]), unit, f"{moves}, {how} {left_open}"
                )
            )  # fmt: skip
        if error > 0.0:
            value = float(residual_rmse[joint])
            told.append(
                _of_size(
                    ERROR, name, value, unit,
                    f"{name} is left with {quantity(value, unit)} RMS; by what it "
                    "left of data that its identification had not seen, and as friction changes "
                    f"from day to day, the model may be off by {quantity(error, unit)}",
                )
            )  # fmt: skip
    return tuple(told)


def _between_recordings(
    validation: CrossValidation, held_out: HeldOut, named: Sequence[Candidate]
) -> tuple[Known, ...]:
    """Return where two recordings differ by more than is left, and no more than they may."""
    motion, usable = validation.data.motion, validation.data.usable[held_out.rows]
    moved = np.where(usable, validation.moved(named)[held_out.rows], np.nan)
    size, left = held_out.rmse(moved), held_out.rmse(held_out.error(named))
    told = []
    for joint in np.flatnonzero(motion.present & (size > left)).tolist():
        name, unit = motion.arm.joint_names[joint], motion.arm.joints[joint].effort_unit
        told.append(
            _of_size(
                PARAMETERS, name, float(size[joint]), unit,
                f"{quantity(float(size[joint]), unit)} RMS at {name} are what differs from the "
                "reference, and may from one day to another: friction, springs, timing",
            )
        )  # fmt: skip
    return tuple(told)


def _of_size(effect: str, joint: str, rms: float, unit: str, sentence: str) -> Known:
    return Known(effect, (joint,), {"rms": Estimate(rms, rms, rms, unit)}, sentence)


def _friction_of(validation: CrossValidation, candidate: Candidate, theta: Array) -> str:
    """Return that there is another friction, where a torque looks most like that."""
    torque = validation.torque(candidate, theta)
    friction = validation.of_choice(validation.data.friction)
    part = part_of_friction(torque, friction)
    joint = int(np.argmax(np.abs(part)))
    more = "more" if part[joint] > 0.0 else "less"
    return f"there is {more} friction at {candidate.hypothesis.arm.joint_names[joint]}"


def _minor(validation: CrossValidation, trial: EffectTrial, named: Sequence[Candidate]) -> Known:
    candidate, hypothesis = trial.candidate, trial.candidate.hypothesis
    theta, covariance = validation.fit([*named, candidate])
    rows = slice(len(theta) - candidate.size, len(theta))
    theta, covariance = theta[rows], covariance[rows, rows]
    if hypothesis.common_cause:
        differ = Alike(validation).differ(candidate, theta, named)
        covariance = covariance + differ * np.diag(theta**2)
    parameters = estimates(hypothesis, theta, covariance, {})
    claim, no_news = hypothesis.claim(parameters), "and no more than the model is known to miss"
    if np.any(trial.size > SelectionSettings().consequence * validation.known_error):
        no_news = "and next to nothing of the joint's torque"
    if trial.seen_before:
        claim = f"what the model misses looks as if {claim}"
        no_news = "but not beside what the recording that the model was identified on shows of it"
    if trial.other_day:
        no_news = "and no more than friction changes by from one day to another"
        if hypothesis.site.kind is not Kind.ARM:
            no_news += ", as other joints' has here"
        if not is_friction(hypothesis.effect):
            claim = f"{_friction_of(validation, candidate, theta)}, much as if {claim}"
    sentence, of_all = f"{claim}; that is significant, {no_news}", ""
    if trial.other_day and hypothesis.common_cause and is_friction(hypothesis.effect):
        of_all = claim
    return Known(
        hypothesis.effect, hypothesis.names, parameters, sentence, of_all,
        _of_changed_friction(parameters) if of_all else "",
    )  # fmt: skip


def _of_changed_friction(factors: Mapping[str, Estimate]) -> str:
    """Return what to do about friction that is so many times the model's, and compensated."""
    # Of kinds that are told apart the claim is of those that surely differ.
    sure = [factor.low for factor in factors.values() if not factor.doubtful(1.0)]
    least = np.floor(100.0 * max(min(sure, default=1.0), 0.0)) / 100.0
    again = "identify again as warm as the arm is in use"
    if least >= FRICTION_RATIO:
        return again
    return (
        f"{again}; till then friction_compensation.ratio {least:.2f} at most: more than there is "
        "drives the arm"
    )
