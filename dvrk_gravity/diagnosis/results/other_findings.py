"""Findings that are no effect, what the model itself explains, and why none may say little."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.faults import Fault
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData, FloorFrom
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.detectable import Detectable
from dvrk_gravity.diagnosis.inference.fit_context import FitContext, part_of_friction, variation
from dvrk_gravity.diagnosis.inference.held_out import Gain, HeldOut
from dvrk_gravity.diagnosis.inference.remaining import ABOVE, expected_error, proven_error
from dvrk_gravity.diagnosis.inference.selection import SELECTION, EffectTrial
from dvrk_gravity.diagnosis.readings.correction import WrongReading, reading_gain
from dvrk_gravity.diagnosis.results import sentences
from dvrk_gravity.diagnosis.results.effect_findings import picture_of
from dvrk_gravity.diagnosis.results.findings import (
    ERROR,
    NO_TERM,
    OF_ONE,
    PARAMETERS,
    Alternative,
    Finding,
    Known,
    PayloadCheck,
)
from dvrk_gravity.diagnosis.results.fitted_hypothesis import estimates
from dvrk_gravity.effects import Estimate, Kind, is_friction, remedy_text, unexplained
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.model import VERDICTS
from dvrk_gravity.parameters import FRICTION_RATIO
from dvrk_gravity.units import quantity

# Part of a joint's effort limit, and all of its own dry friction, that friction which would be
# missed may exceed. Dry friction of a real MTM is .8 to 9 % of the limits, up to 19 % with what its
# calibrated model leaves of static poses besides. A user asks about twice the friction.
_OF_LIMIT = 0.2
# Of the error that its own uncertainty predicts, below which that is not the model's: the median of
# the joints. Chosen: other motions of a real MTM, PSM and UR10e and of a simulated chain have .6 to
# 1.5; with deviations thirty times as large .04 to .09 (the PSM, recorded days later, .6), with a
# known error thirty times as large .01 to .05.
_FAR_BELOW = 0.2


def unknown_finding(
    held_out: HeldOut, validation: CrossValidation, named: Sequence[Candidate], trial: EffectTrial
) -> Finding:
    """Return the finding of structure that no effect explains."""
    hypothesis = trial.candidate.hypothesis
    with_it = [*named, trial.candidate]
    before, after = held_out.error(named, with_it), held_out.error(with_it)
    joint = hypothesis.joints[0]
    rmse = held_out.rmse(before)[joint], held_out.rmse(after)[joint]
    rms = float(np.sqrt(max(rmse[0] ** 2 - rmse[1] ** 2, 0.0)))
    parameters = {"rms": Estimate(rms, rms, rms, hypothesis.unit("rms"))}
    return Finding(
        effect=hypothesis.effect,
        joints=hypothesis.names,
        place=hypothesis.place,
        parameters=parameters,
        gain=held_out.gain(before, after, [joint]),
        alternatives=(),
        rejected=(),
        sentence=hypothesis.claim(parameters),
        picture=picture_of(validation.data, held_out, hypothesis, joint, before, after),
        left_out=NO_TERM,
        remedy=hypothesis.remedy(carried=False),
    )


def unexplained_error(
    arm: Arm, joint: int, after: float, floor: float, expected: float, source: FloorFrom
) -> Finding:
    """Return the finding of a joint's error that nothing explains, whatever it depends on.

    It is compared with the noise floor, or, where that is unknown, with what the model expects.
    """
    known = np.isfinite(floor)
    least = floor if known else expected
    words = sentences.FLOORS[source] if known else "the model's error at calibration"
    rms = float(np.sqrt(after**2 - least**2))
    name, unit = arm.joint_names[joint], arm.joints[joint].effort_unit
    return Finding(
        effect=unexplained().NAME,
        joints=(name,),
        place="nothing that was tried",
        parameters={"rms": Estimate(rms, rms, rms, unit)},
        gain=Gain(0.0, 0.0, 0.0, 1.0),
        alternatives=(),
        rejected=(),
        sentence=sentences.unknown_error(name, quantity(after, unit), after / least, words),
        picture=None,
        left_out=NO_TERM,
        remedy=unexplained().REMEDY,
    )


def fault_finding(fault: Fault) -> Finding:
    """Return the finding of a fault of a recording."""
    return Finding(
        effect=fault.effect,
        joints=fault.joints,
        place=fault.place,
        parameters={"factor": fault.factor} if fault.factor else {},
        gain=Gain(*fault.removed, fault.p_value),
        alternatives=tuple(
            Alternative(effect, joints, why=why) for effect, joints, why in fault.alternatives
        ),
        rejected=(),
        sentence=fault.sentence,
        picture=None,
        left_out=OF_ONE if fault.of_one else "",
        remedy=fault.remedy,
    )


def reading_finding(wrong: WrongReading, before: Array, after: Array, held_out: HeldOut) -> Finding:
    """Return the finding that the recording was read wrongly.

    Args:
        wrong: The wrong reading and its alternatives.
        before: (H, n) held-out errors as it was read first.
        after: (H, n) held-out errors as it is to be read.
        held_out: The held-out samples.
    """
    reading, names = wrong.score.reading, held_out.joint_names
    joints, gain = reading_gain(wrong.score, before, after, held_out)
    affected = tuple(names[joint] for joint in reading.joints)
    place = "clock" if reading.clock else reading.words
    if reading.scale:
        place = Kind.JOINT.value if affected else "all"
        affected = affected or tuple(names)
    carried = reading.errors is not None
    return Finding(
        effect=reading.effect.NAME,
        joints=affected,
        place=place,
        parameters={"factor": reading.factor} if reading.factor else {},
        gain=gain,
        alternatives=tuple(
            Alternative(
                other.reading.effect.NAME,
                tuple(names[joint] for joint in other.reading.joints),
                why=sentences.alternative(other.gain, wrong.score.gain, other.reading.words),
            )
            for other in wrong.alternatives
        ),
        rejected=(),
        sentence=sentences.wrong_reading(reading.words, gain.relative, names[joints[0]]),
        picture=None,
        left_out="" if carried else NO_TERM,
        remedy=remedy_text(reading.remedy, carried, reading=True),
    )


def check_payload(findings: Sequence[Finding], known: float, reference: bool) -> PayloadCheck:
    """Compare the payload that was found with its known mass, kg.

    Args:
        findings: What was found.
        known: The known mass, kg.
        reference: Two recordings were compared.
    """
    found = next((finding for finding in findings if "mass" in finding.parameters), None)
    if found is None:
        return PayloadCheck(known, None, sentences.payload("", known, None, "", reference))
    mass = found.parameters["mass"].magnitude  # put on, or taken off since a reference
    scale, gain = None, ""
    if mass.unit == "kg":
        scale = Estimate(mass.value / known, mass.low / known, mass.high / known, "")
    else:
        gain = quantity(known / mass.value, "")
    return PayloadCheck(known, scale, sentences.payload(mass.shown, known, scale, gain, reference))


def known(
    validation: CrossValidation,
    held_out: HeldOut,
    minor: Sequence[EffectTrial],
    named: Sequence[Candidate],
) -> tuple[Known, ...]:
    """Return what the model's uncertainty and its error at calibration explain.

    Args:
        validation: The samples.
        held_out: The held-out samples.
        minor: Effects that are significant, and smaller than that error or than day-to-day friction
            variation.
        named: The selected effects.
    """
    motion, data = validation.data.motion, validation.data
    expected, proven = expected_error(data), proven_error(data)
    own_parameters, _ = validation.solution(named)
    moved = np.where(data.usable, data.model_columns @ own_parameters, np.nan)[held_out.rows]
    moved_rms, left = held_out.rmse(moved), held_out.rmse(held_out.error(named))
    found = [_minor(validation, trial, named) for trial in minor]
    source = "file" if motion.model.of_file else "identification"
    for joint in np.flatnonzero(motion.present & held_out.seen).tolist():
        name, unit = motion.arm.joint_names[joint], motion.arm.joints[joint].effort_unit
        moves, rest = float(moved_rms[joint]), float(left[joint])
        if not data.expectation.predicts:
            if moves > rest:
                sentence = sentences.day_to_day_difference(name, quantity(moves, unit))
                found.append(_of_size(PARAMETERS, name, moves, unit, sentence))
            continue
        error = float(data.expectation.day_to_day_error[joint])
        if moves > error:
            most = NORMAL_95 * float(np.sqrt(max(expected[joint] ** 2 - error**2, 0.0)))
            sentence = sentences.within_uncertainty(
                name, quantity(moves, unit), quantity(most, unit), source, moves <= most,
            )  # fmt: skip
            found.append(_of_size(PARAMETERS, name, moves, unit, sentence))
        if proven[joint] > 0.0:
            sentence = sentences.remaining_error(
                name, quantity(rest, unit), quantity(proven[joint], unit),
                rest / proven[joint], ABOVE,
            )  # fmt: skip
            found.append(_of_size(ERROR, name, rest, unit, sentence))
    return tuple(found)


def _of_size(effect: str, joint: str, rms: float, unit: str, sentence: str) -> Known:
    return Known(effect, (joint,), {"rms": Estimate(rms, rms, rms, unit)}, sentence)


def _minor(validation: CrossValidation, trial: EffectTrial, named: Sequence[Candidate]) -> Known:
    candidate, hypothesis = trial.candidate, trial.candidate.hypothesis
    theta, covariance = validation.fit([*named, candidate])
    rows = slice(len(theta) - candidate.size, len(theta))
    theta, covariance = theta[rows], covariance[rows, rows]
    if hypothesis.common_cause:
        differ = variation(FitContext(validation, tuple(named)), candidate, theta)
        covariance = covariance + differ * np.diag(theta**2)
    parameters = estimates(hypothesis, theta, covariance, {})
    claim, of_friction = hypothesis.claim(parameters), is_friction(hypothesis.effect)
    negligible = np.any(trial.size > SELECTION.consequence * validation.known_error)
    friction = "" if of_friction else _like_friction(validation, candidate, theta)
    of_all = trial.day_to_day and hypothesis.common_cause and of_friction
    return Known(
        hypothesis.effect,
        hypothesis.names,
        parameters,
        sentences.minor_effect(
            claim, bool(negligible), trial.seen_before, trial.day_to_day, friction,
            elsewhere=hypothesis.site.kind is not Kind.ARM,
        ),
        claim if of_all else "",
        not of_friction and not trial.seen_before,
        sentences.slower_compensation(_safe_ratio(parameters)) if of_all else "",
    )  # fmt: skip


def _like_friction(validation: CrossValidation, candidate: Candidate, theta: Array) -> str:
    """Return the change of friction that a torque resembles most."""
    torque = validation.torque(candidate, theta)
    part = part_of_friction(torque, validation.of_choice(validation.data.expectation.friction))
    joint = int(np.argmax(np.abs(part)))
    name = candidate.hypothesis.arm.joint_names[joint]
    return f"{'more' if part[joint] > 0.0 else 'less'} friction at {name}"


def _safe_ratio(factors: Mapping[str, Estimate]) -> float | None:
    """Return the part of modelled friction that is certain; ``None``: what is compensated."""
    # Of the kinds of friction, only those that significantly differ.
    certain = [factor.low for factor in factors.values() if not factor.doubtful(1.0)]
    least = float(np.floor(100.0 * max(min(certain, default=1.0), 0.0)) / 100.0)
    return None if least >= FRICTION_RATIO else least


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
