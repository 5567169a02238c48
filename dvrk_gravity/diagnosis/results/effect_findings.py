"""One selected effect as a finding: its size, what it gains, what could stand in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.candidate import Candidate, slices_of, split
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.alternatives import SelectedEffect
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.inference.infer import poorly_stated
from dvrk_gravity.diagnosis.inference.selection import SELECTION, EffectTrial
from dvrk_gravity.diagnosis.results import sentences
from dvrk_gravity.diagnosis.results.findings import (
    NOT_AS_FOUND,
    Alternative,
    Finding,
    Picture,
)
from dvrk_gravity.diagnosis.results.fitted_hypothesis import FittedHypothesis, estimates
from dvrk_gravity.diagnosis.results.identifiability import separation
from dvrk_gravity.effects import Estimate, Hypothesis, Kind, is_friction
from dvrk_gravity.estimation import squared_distance

_BEYOND = 0.9  # of an effect's squared torque outside the identified range. Chosen: nearly all
_ALPHA = 1e-3  # that recordings which agree are said to differ. Chosen
# Of what one recording shows, that a common value may miss: as much as a reported value may be off.
_MISSED = 0.2
# Times the model's known error that a right cause leaves in one of twenty recordings: 1.22 times a
# log-normal factor of 0.31 (``identification/expected_error.py``).
LEAVES = 2.0


def effect_finding(
    held_out: HeldOut,
    validation: CrossValidation,
    selected: Sequence[SelectedEffect],
    i: int,
    parameters: dict[str, Estimate],
    theta: Array,
    left_out: str,
    likely: Array,
) -> Finding:
    """Return the finding of a selected effect.

    Args:
        held_out: The held-out samples.
        validation: All samples.
        selected: The selected effects.
        i: Which of them.
        parameters: Its estimates.
        theta: (k,) its linear parameters.
        left_out: Why the extended model lacks it; ``""`` if it has it.
        likely: (n,) RMS that noise and the expectation's own error leave, N·m; NaN: not known.
    """
    effect, motion = selected[i], validation.data.motion
    candidate = effect.trial.candidate
    hypothesis = candidate.hypothesis
    named = [other.trial.candidate for other in selected]
    rest = [*named[:i], *named[i + 1 :]]
    # What the others leave to it, in whatever order they were found.
    before, after = held_out.error(rest, named), held_out.error(named)
    joints = held_out.main_joints(candidate, before, after)
    gain = held_out.gain(before, after, joints, candidate=candidate)
    remedy = _remedy(hypothesis, motion, not left_out)
    if left_out == NOT_AS_FOUND:
        remedy = f"{remedy}; or {sentences.IDENTIFY_AGAIN}"
    doubts = (
        (beyond_range(motion, hypothesis, theta), sentences.GO_THERE),
        (
            _pushed_together(hypothesis, [other.hypothesis for other in rest]),
            sentences.RECORD_ALONE,
        ),
        (_shares_joint(validation.data, hypothesis, [other.hypothesis for other in rest]), remedy),
        (held_out.shows_nothing_of(named, candidate, joints), remedy),
        (_leaves(motion, joints, held_out.rmse(after), likely), remedy),
        effect.doubt,
    )
    doubt, remedy = next((pair for pair in doubts if pair[0]), ("", remedy))
    return Finding(
        effect=hypothesis.effect,
        joints=hypothesis.names,
        place=hypothesis.place,
        parameters=_freed(validation, named, i, parameters),
        gain=gain,
        alternatives=_alternatives(validation, rest, effect),
        rejected=tuple(
            _alternative(other, effect.trial) for other in effect.rejected
        ),
        sentence=sentences.effect_found(
            hypothesis, parameters, gain, [hypothesis.arm.joint_names[joint] for joint in joints],
            doubt,
        ),
        picture=picture_of(validation.data, held_out, hypothesis, joints[0], before, after),
        left_out=left_out,
        remedy=remedy,
        doubt=doubt,
        unresolved=_unresolved(validation, rest, effect),
    )  # fmt: skip


def _remedy(hypothesis: Hypothesis, motion: MeasuredMotion, carried: bool) -> str:
    model = motion.model
    if carried and hypothesis.effect in poorly_stated(motion):
        return f"an arm's file states little of it: {sentences.USE_EXTENDED}"
    lacking = model.terms and not any(term.FRICTION for term in model.terms)
    if carried and lacking and is_friction(hypothesis.effect):
        return f"the model has no friction at all: {sentences.USE_EXTENDED}"
    # A difference from a reference cannot hold an arm.
    return hypothesis.remedy(carried and bool(model.terms))


def _freed(
    validation: CrossValidation, named: Sequence[Candidate], i: int, parameters: dict[str, Estimate]
) -> dict[str, Estimate]:
    """Return parameters with intervals that include what parsimony assumed to be equal."""
    free = named[i].hypothesis.unrestricted
    if free is None:
        return parameters
    candidates = [*named[:i], validation.data.candidate(free), *named[i + 1 :]]
    theta, covariance = validation.fit(candidates)
    rows = slices_of(candidates)[i]
    alone = estimates(free, theta[rows], covariance[rows, rows], {})
    widened = {
        name: replace(
            parameters[name],
            low=min(parameters[name].low, own.low),
            high=max(parameters[name].high, own.high),
        )
        for name, own in alone.items()
        if name in parameters
    }
    return parameters | widened


def _alternative(other: EffectTrial, found: EffectTrial, why: str = "") -> Alternative:
    hypothesis, behind = other.candidate.hypothesis, found.gain - other.gain
    names = hypothesis.effect, hypothesis.names, hypothesis.place
    return Alternative(*names, other.gain, behind, why)


def _alternatives(
    validation: CrossValidation, rest: Sequence[Candidate], effect: SelectedEffect
) -> tuple[Alternative, ...]:
    """Return one alternative for each other effect and joint."""
    chosen, gain = effect.trial.candidate, effect.trial.gain
    found = dict[tuple[str, tuple[int, ...]], Alternative]()
    for other in effect.alternatives:
        key = other.named
        if key in found or key == effect.trial.named:
            continue
        how = "as well"
        if other.gain > gain and other.candidate.parameters > chosen.parameters:
            how = "better, with more parameters"
        apart = separation(validation, rest, chosen, other.candidate)
        why = sentences.alternative(other.gain, gain, f"explains unseen blocks {how}", apart)
        found[key] = _alternative(other, effect.trial, why)
    return tuple(found.values())


def _unresolved(
    validation: CrossValidation, rest: Sequence[Candidate], effect: SelectedEffect
) -> tuple[FittedHypothesis, ...]:
    """Return the selected cause and all that could stand in its place, if any could.

    Also forms of these that fit worse here, for further data are explained by any of them.
    """
    if not effect.alternatives:
        return ()
    return tuple(
        FittedHypothesis.of(
            validation, rest, trial.candidate, trial.gain / effect.trial.inflation, rejected
        )
        for trials, rejected in (
            ((effect.trial, *effect.alternatives), False), (effect.forms, True),
        )
        for trial in trials
    )  # fmt: skip


def _leaves(motion: MeasuredMotion, joints: Sequence[int], left: Array, likely: Array) -> str:
    """Return by how much the fit misses at a finding's joints; ``""``: as noise and model do.

    A name that leaves more has part of another cause's torque.
    """
    ratio = {joint: left[joint] / likely[joint] for joint in joints if likely[joint] > 0.0}
    worst = max(ratio, key=lambda joint: ratio[joint], default=-1)
    if worst < 0 or not ratio[worst] > LEAVES:
        return ""
    return sentences.leaves(motion.arm.joint_names[worst], ratio[worst])


def _pushed_together(hypothesis: Hypothesis, others: Sequence[Hypothesis]) -> str:
    """Return which other joints are pushed at the same time as a finding's; ``""`` for none.

    Several joints feel a load that is held for a while, differently in each pose; one constant push
    of each joint approximates that.
    """

    def overlap(other: Hypothesis) -> bool:
        first, second = hypothesis.setting, other.setting
        if not all({"start", "end"} <= setting.keys() for setting in (first, second)):
            return False
        begin = max(first["start"], second["start"])
        return begin < min(first["end"], second["end"])

    joints = dict.fromkeys(name for other in others if overlap(other) for name in other.names)
    return sentences.pushed_together([name for name in joints if name not in hypothesis.names])


def _shares_joint(data: FilteredData, hypothesis: Hypothesis, others: Sequence[Hypothesis]) -> str:
    """Return which other cause is found at a finding's joint; ``""`` for none.

    What no effect is, is often two: torque that grows with the square of the speed is viscous
    friction and less Coulomb friction. A model that was never identified lacks several at once.
    """
    kinds = (Kind.JOINT, Kind.MOTOR) if data.expectation.identified else ()
    for other in others if hypothesis.site.kind in kinds else ():
        if other.site.kind in kinds and other.site.index == hypothesis.site.index:
            return sentences.SHARES_JOINT.format(other.EFFECT.title())
    return ""


def beyond_range(motion: MeasuredMotion, hypothesis: Hypothesis, theta: Array) -> str:
    """Return that a function of position acts outside the identified range, if it does.

    A cable may have any torque there.

    Args:
        motion: The motion.
        hypothesis: The finding's.
        theta: (k,) its parameters.
    """
    known, joint = motion.model.uncertainty, hypothesis.site.index
    at_joint = hypothesis.site.kind is Kind.JOINT and hypothesis.variable == "position"
    if known is None or motion.model.of_file or not at_joint or not np.size(theta):
        return ""
    columns = hypothesis.regressor(motion)[:, joint]
    square, q = (columns @ theta) ** 2, motion.true_q[:, joint]
    low, high = float(known.lower[joint]), float(known.upper[joint])
    if square[(q < low) | (q > high)].sum() <= _BEYOND * square.sum():
        return ""
    where = motion.arm.joints[joint]
    span = f"{where.shown(low).split()[0]} to {where.shown(high)} of {where.name}"
    return f"it acts outside {span}, where the model was not identified"


def difference(
    validation: CrossValidation, named: Sequence[Candidate], i: int, sources: Sequence[str]
) -> tuple[str, bool] | None:
    """Return what each recording shows of a cause, and whether any shows it by itself.

    ``None`` where they agree about it.

    They differ where separate parameters explain it significantly better (Wald's test of
    homogeneity), and common ones miss, at some joint, more than a fifth of the torque that a
    recording shows, than the model is known to miss, and than stays unexplained.

    Args:
        validation: The samples.
        named: The selected effects.
        i: Which of them.
        sources: Names of the recordings.
    """
    from scipy.special import chdtrc

    cause, data = named[i], validation.data
    seen = data.fold >= 0
    own = [(data.recording == number) & seen for number in range(len(sources))]
    shown = [number for number, rows in enumerate(own) if cause.values[rows].any()]
    # One recording may show little of the model itself, and what happens once is in one.
    if len(shown) < 2 or cause.hypothesis.transient or cause.hypothesis.refits_model:
        return None
    divided = _divided(cause, [data.recording == number for number in shown])
    candidates = [*named[:i], divided, *named[i + 1 :]]
    theta, covariance = validation.fit(candidates)
    rows = slices_of(candidates)[i]
    theta, covariance = theta[rows], covariance[rows, rows]
    count, size = len(shown), cause.size
    contrast = np.kron(np.eye(count)[1:] - np.eye(count)[0], np.eye(size))
    change = contrast @ theta
    apart = squared_distance(change, contrast @ covariance @ contrast.T)
    if chdtrc(len(change), apart) > _ALPHA:
        return None
    common = np.tile(split(named, validation.parameters(named))[i][1], count)
    known_error = SELECTION.least(validation)
    least = np.maximum(known_error, validation.score(candidates).rms)
    of_recording = [np.kron(unit, np.ones(size)) for unit in np.eye(count)]
    part = np.array([[own[number].sum() / seen.sum()] for number in shown])
    missed, each = (
        np.stack([validation.size(divided, mine * values) for mine in of_recording]) / np.sqrt(part)
        for values in (theta - common, theta)
    )
    if not np.any((missed > least) & (missed > _MISSED * each)):
        return None
    claims: dict[int, str] = {}
    for number, (values, spread) in zip(
        shown,
        ((theta[mine > 0.0], covariance[np.ix_(mine > 0.0, mine > 0.0)]) for mine in of_recording),
        strict=True,
    ):
        absent = chdtrc(size, squared_distance(values, spread)) > _ALPHA
        found = estimates(cause.hypothesis, values, spread, {})
        claims[number] = "" if absent else cause.hypothesis.claim(found)
    sentence = sentences.difference(cause.hypothesis.subject, claims, sources)
    return sentence, any(claims.values())


def _divided(cause: Candidate, recordings: Sequence[Mask]) -> Candidate:
    """Return a cause with separate parameters in each recording."""
    values = [np.where(rows[:, None, None], cause.values, 0.0) for rows in recordings]
    plausible = tuple(cause.hypothesis.prior_std) * len(recordings)
    return replace(
        cause,
        hypothesis=replace(cause.hypothesis, prior_std=plausible),
        values=np.concatenate(values, axis=2),
    )


def picture_of(
    data: FilteredData,
    held_out: HeldOut,
    hypothesis: Hypothesis,
    joint: int,
    before: Array,
    after: Array,
) -> Picture:
    """Return the held-out error of a joint against what a hypothesis depends on."""
    motion = data.motion
    variable = hypothesis.variable if not motion.static else "position"
    argument = joint if hypothesis.depends_on is None else hypothesis.depends_on
    name, unit = motion.arm.joint_names[argument], motion.arm.joints[argument].unit
    scale, shown = (np.degrees(1.0), "deg") if unit == "rad" else (1e3, "mm")
    values, label = {
        "position": (scale * motion.q[:, argument], f"position of {name} [{shown}]"),
        "velocity": (scale * motion.qd[:, argument], f"velocity of {name} [{shown}/s]"),
        "acceleration": (scale * motion.qdd[:, argument], f"acceleration of {name} [{shown}/s²]"),
        "time": (motion.time, "time [s]"),
    }[variable]
    x = data.reduce_state(values[:, None])[held_out.rows, 0]
    forward = None
    if variable == "position" and is_friction(hypothesis.effect):
        way = motion.qd if motion.direction is None else motion.direction
        forward = data.reduce_state(way[:, [argument]])[held_out.rows, 0] > 0.0
    return Picture(
        motion.arm.joint_names[joint], label, x, before[:, joint], after[:, joint], forward
    )
