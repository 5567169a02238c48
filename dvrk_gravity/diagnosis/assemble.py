"""From what was selected to findings with numbers and words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.ambiguity import ambiguities
from dvrk_gravity.diagnosis.at_calibration import AtCalibration
from dvrk_gravity.diagnosis.at_once import REMEDY as RECORD_ALONE
from dvrk_gravity.diagnosis.at_once import at_once
from dvrk_gravity.diagnosis.by_recording import REMEDY as DIAGNOSE_ALONE
from dvrk_gravity.diagnosis.by_recording import difference
from dvrk_gravity.diagnosis.candidate import Candidate, slices_of
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.extend import contradicted, extended, updated
from dvrk_gravity.diagnosis.findings import (
    ANEW,
    NOT_AS_FOUND,
    Alternative,
    Finding,
    Rejected,
    ordered,
)
from dvrk_gravity.diagnosis.held_out import HeldOut, Unconfirmed, estimates, setting_columns
from dvrk_gravity.diagnosis.known import expected_error, known
from dvrk_gravity.diagnosis.loading import Loaded
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.diagnosis.notes import exact, notes
from dvrk_gravity.diagnosis.other_findings import (
    as_read_before,
    error_beside,
    picture_of,
    reading_finding,
    shapeless_finding,
    unknown_finding,
)
from dvrk_gravity.diagnosis.outside_range import REMEDY as GO_THERE
from dvrk_gravity.diagnosis.outside_range import beyond_range
from dvrk_gravity.diagnosis.places import SelectedEffect
from dvrk_gravity.diagnosis.readings import WrongReading
from dvrk_gravity.diagnosis.refinement import RefinementSettings, plateau
from dvrk_gravity.diagnosis.result import Diagnosis, Verdict, by_joint
from dvrk_gravity.diagnosis.selection import EffectTrial
from dvrk_gravity.diagnosis.separate import separation
from dvrk_gravity.diagnosis.tangent import tangents
from dvrk_gravity.diagnosis.unstated import little_said_of
from dvrk_gravity.diagnosis.words import sentence_of
from dvrk_gravity.diagnosis.worse_joints import worse
from dvrk_gravity.effects import Estimate, Hypothesis, Unknown, is_friction
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import outside_range


@dataclass(frozen=True)
class ShapelessSettings:
    """When error that depends on nothing tried is told.

    Attributes:
        above: Times the noise, or the model's known error: more is structure, if it lasts. Chosen.
        far_above: Times likewise: more cannot be noise, of whatever colour. Chosen.
        lasting: Part of an error that lasts as long as a motion does, and noise does not. Chosen.
    """

    above: float = 2.5
    far_above: float = 5.0
    lasting: float = 0.6


_SHAPELESS = ShapelessSettings()
_DIFFERENT = "the recordings differ about it"
_BESIDE_DIFFERENT = "found beside the average of what the recordings differ about"
_WORSE = "what was found does not explain all: after it the error is larger at"
_EXTRAPOLATED = "what the model says there is extrapolated, and counts as uncertain"


def assemble(
    loaded: Loaded,
    wrong: Sequence[WrongReading],
    validation: CrossValidation,
    selected: Sequence[SelectedEffect],
    unknown: Sequence[EffectTrial],
    unconfirmed: Sequence[Unconfirmed],
    minor: Sequence[EffectTrial],
    other_day: Sequence[Candidate],
    pool: Sequence[Candidate],
    at_calibration: AtCalibration | None,
) -> Diagnosis:
    """Put everything together; see :class:`dvrk_gravity.diagnosis.run.Outcome`."""
    held_out, data = HeldOut(validation), validation.data
    arm = data.motion.arm
    names = arm.joint_names
    named = [effect.trial.candidate for effect in selected]
    theta, covariance, spreads = _fit(validation, named)
    scale = _scale_error(arm)
    slices = slices_of(named)
    found = [
        (candidate.hypothesis, theta[rows]) for candidate, rows in zip(named, slices, strict=True)
    ]
    differences = [difference(validation, named, i, loaded.sources) for i in range(len(named))]
    different = any(differences)
    # What no recording shows by itself only makes up for the average of what they differ about.
    shown = any(each and each.shown for each in differences)
    not_told = [
        i for i, each in enumerate(differences) if different and (not each or shown > each.shown)
    ]
    contradictory = {i: _DIFFERENT for i, each in enumerate(differences) if each}
    contradictory |= dict.fromkeys(not_told, _BESIDE_DIFFERENT)
    model, left_out = extended(loaded.motion, found, contradictory)
    contradictory |= {
        i: NOT_AS_FOUND
        for i, (candidate, rows) in enumerate(zip(named, slices, strict=True))
        if not left_out[i] and contradicted(data, candidate, theta[rows])
    }
    if contradictory:
        model, left_out = extended(loaded.motion, found, contradictory)
    if found:
        model = updated(
            model, validation, named, held_out, contradictory, not any(left_out) and not wrong
        )
    first = read_rightly = held_out.as_read()
    of_any_arm = little_said_of(data.motion)
    if wrong:
        first = as_read_before(wrong[0].motion, data, held_out)
    readings = first, read_rightly
    if wrong and of_any_arm:  # what friction hides tells no reading from another
        of_file = [candidate for candidate in named if candidate.hypothesis.effect in of_any_arm]
        readings = error_beside(wrong[0].motion), held_out.error(of_file)
    # Of three joints that are exchanged one exchange alone puts nothing right: all are told by
    # what they do together.
    findings = list(loaded.faults)
    findings += [reading_finding(reading, *readings, held_out) for reading in wrong]
    effect_findings = []
    for i, effect in enumerate(selected):
        if i in not_told:
            continue
        rows, hypothesis = slices[i], effect.trial.candidate.hypothesis
        spread = covariance[rows, rows] + scale**2 * np.outer(theta[rows], theta[rows])
        if at_calibration is not None:
            back, of_settings = at_calibration.spread(named[i], theta[rows])
            spread += back
            for name, deviation in of_settings.items():
                spreads[i][name] = np.hypot(spreads[i].get(name, 0.0), deviation)
        spread += hypothesis.taken_in(loaded.motion) * np.eye(len(spread))
        parameters = estimates(hypothesis, theta[rows], spread, spreads[i])
        finding = _finding(held_out, validation, selected, i, parameters, theta[rows], left_out[i])
        differs = differences[i]
        if differs is not None:
            sentence = f"{differs.sentence}; on average {finding.sentence}"
            finding = replace(finding, sentence=sentence, remedy=DIAGNOSE_ALONE)
        effect_findings.append(finding)
    findings += ordered(effect_findings, of_any_arm)
    if not different:
        findings += [unknown_finding(held_out, validation, named, trial) for trial in unknown]
    after = held_out.rmse(held_out.error(named))
    # Friction of another day is told, if not as a finding: it is no error that nothing explains.
    explained = [*named, *other_day]
    unexplained = held_out.error(explained)
    residual_rmse = held_out.rmse(unexplained)
    floor = data.noise_rms(loaded.floor, validation.residual(named))
    source = data.noise_source(floor)
    nameless = [finding for finding in findings if finding.effect == Unknown.NAME]
    told = {name for finding in nameless for name in finding.joints}
    # Out of fold, too: a push's edge may hide in a held-out block.
    seen = validation.score(explained).rms
    # A floor that high frequencies show takes the noise for white; one of repetition need not.
    lasting = held_out.lasting(unexplained) > _SHAPELESS.lasting
    noise = np.full(len(after), source != "repetition") & ~lasting
    expected = expected_error(data, held_out)
    likely = np.fmax(floor, expected)
    uncertainty = data.motion.model.uncertainty
    if uncertainty is not None:  # of a joint without weight a file expects nothing, not even noise
        likely[np.isnan(floor) & np.isnan(uncertainty.error)] = np.nan
    shapeless = [
        joint
        for joint in range(len(residual_rmse))
        if min(residual_rmse[joint], seen[joint])
        > (_SHAPELESS.far_above if noise[joint] else _SHAPELESS.above) * likely[joint]
        and names[joint] not in told
        and not different
    ]
    findings += [
        shapeless_finding(arm, joint, residual_rmse[joint], floor[joint], expected[joint], source)
        for joint in shapeless
    ]
    motion = data.motion
    qd = None if motion.static else motion.qd
    told_of = np.where(held_out.seen, 1.0, np.nan)
    grown = [names[joint] for joint in worse(held_out, named, first, floor)]
    outside = outside_range(motion.model, motion.q, qd, motion.present)
    return Diagnosis(
        verdict=_verdict(findings, different or bool(grown)),
        findings=tuple(findings),
        known=known(validation, held_out, minor, named, expected),
        before=by_joint(names, told_of * held_out.rmse(first)),
        after=by_joint(names, told_of * after),
        floor=by_joint(names, floor),
        expected=by_joint(names, expected),
        floor_from=source,
        samples=int((data.block >= 0).sum()),
        held_out=held_out.samples,
        warnings=loaded.warnings,
        notes=(
            *notes(loaded, validation, floor),
            *((f"warning: {_WORSE} {', '.join(grown)}",) if grown else ()),
            *(f"{line}: {_EXTRAPOLATED}" for line in outside),
            *(str(effect) for effect in unconfirmed),
            *(f"not told: {named[i].hypothesis}: {_BESIDE_DIFFERENT}" for i in not_told),
            *(
                f"left out of the extended model: {named[i].hypothesis}: {reason}"
                for i, reason in contradictory.items()
                if i not in not_told
            ),
        ),
        ambiguities=ambiguities(validation, named, pool),
        model=model,
        band=data.band,
        beside_reference=motion.reference is not None,
        with_model=motion.reference is None or bool(motion.model.terms),
        outside=outside,
        of_file=motion.model.of_file,
        exact="" if motion.reference is not None else exact(motion.model),
    )


def _scale_error(arm: Arm) -> float:
    """Return the relative standard error of torques, and so of all that is linear in them.

    Of drive gains: the load that three joints show is no surer than their gains together, whose
    errors, of one table or one weighing, are not independent.
    """
    return 0.0 if arm.drive_gain_error is None else float(np.mean(arm.drive_gain_error))


def _fit(
    validation: CrossValidation, named: Sequence[Candidate]
) -> tuple[Array, Array, list[dict[str, float]]]:
    """Return parameters, covariance, and the spread of each one's searched settings."""
    if not named:
        return np.zeros(0), np.zeros((0, 0)), []
    validation.weigh(validation.out_of_fold(named))
    along, tangent = tangents(validation, named)
    theta, _ = along.fit(tangent)
    slopes: list[Candidate] = []
    names: list[list[str]] = []
    for candidate, rows in zip(named, slices_of(named), strict=True):
        found, columns = setting_columns(validation, candidate, theta[rows])
        names.append(found)
        slopes += columns
    # The settings move along, so that they widen the others' intervals; their values stay.
    _, covariance = along.fit([*tangent, *slopes])
    deviation = np.sqrt(np.maximum(np.diag(covariance)[len(theta) :], 0.0)).tolist()
    spreads = []
    for candidate, found in zip(named, names, strict=True):
        spread = {name: deviation.pop(0) for name in found}
        rest = [other for other in named if other is not candidate]
        for name in set(candidate.hypothesis.edges) & set(candidate.hypothesis.refine):
            low, high = plateau(validation, candidate, rest, name)
            spread[name] = max(high - low, RefinementSettings().edge_step) / (2.0 * NORMAL_95)
        spreads.append(spread)
    return theta, covariance[: len(theta), : len(theta)], spreads


def _finding(
    held_out: HeldOut,
    validation: CrossValidation,
    selected: Sequence[SelectedEffect],
    i: int,
    parameters: dict[str, Estimate],
    theta: Array,
    left_out: str,
) -> Finding:
    effect, motion = selected[i], validation.data.motion
    hypothesis = effect.trial.candidate.hypothesis
    named = [other.trial.candidate for other in selected]
    # What the others leave to it, in whatever order they were found.
    before = held_out.error([other for k, other in enumerate(named) if k != i], named)
    after = held_out.error(named)
    joints = held_out.main_joints(effect.trial.candidate, before, after)
    gain = held_out.gain(before, after, joints, candidate=effect.trial.candidate)
    rest_named = [other for k, other in enumerate(named) if k != i]
    alternatives = _alternatives(validation, rest_named, effect)
    usual_remedy = _remedy(hypothesis, motion, not left_out)
    if left_out == NOT_AS_FOUND:
        usual_remedy = f"{usual_remedy}; or {ANEW}"
    doubts = (
        (beyond_range(motion, hypothesis, theta), GO_THERE),
        (at_once(hypothesis, [other.hypothesis for other in rest_named]), RECORD_ALONE),
        (held_out.shows_nothing_of(named, effect.trial.candidate, joints), usual_remedy),
        (effect.doubt, Unknown.REMEDY),
    )
    no_doubt = ("", usual_remedy)
    doubt, remedy = next((pair for pair in doubts if pair[0]), no_doubt)
    return Finding(
        effect=hypothesis.effect,
        joints=hypothesis.names,
        place=hypothesis.place,
        parameters=_freed(validation, named, i, parameters),
        gain=gain,
        alternatives=alternatives,
        rejected=tuple(
            Rejected(
                other.candidate.hypothesis.effect,
                other.candidate.hypothesis.names,
                other.candidate.hypothesis.place,
                other.gain,
                effect.trial.gain - other.gain,
            )
            for other in effect.rejected
        ),
        sentence=sentence_of(
            hypothesis, parameters, gain, [hypothesis.arm.joint_names[joint] for joint in joints],
            doubt,
        ),
        picture=picture_of(validation.data, held_out, hypothesis, joints[0], before, after),
        left_out=left_out,
        remedy=remedy,
        doubt=doubt,
    )  # fmt: skip


def _remedy(hypothesis: Hypothesis, motion: MeasuredMotion, carried: bool) -> str:
    """Return what to do about a finding."""
    model = motion.model
    if carried and hypothesis.effect in little_said_of(motion):
        return "an arm's file says little of it: use the extended model, which has it"
    lacking = model.terms and not any(term.FRICTION for term in model.terms)
    if carried and lacking and is_friction(hypothesis.effect):
        return "the model has no friction at all: use the extended model, which has it"
    # What changed against a reference holds no arm.
    return hypothesis.remedy(carried and bool(model.terms))


def _freed(
    validation: CrossValidation, named: Sequence[Candidate], i: int, parameters: dict[str, Estimate]
) -> dict[str, Estimate]:
    """Return parameters whose intervals hold what parsimony took to be equal, and may not be."""
    freed = named[i].hypothesis.freed
    if freed is None:
        return parameters
    candidates = [*named[:i], validation.data.candidate(freed), *named[i + 1 :]]
    theta, covariance = validation.fit(candidates)
    rows = slices_of(candidates)[i]
    alone = estimates(freed, theta[rows], covariance[rows, rows], {})
    return {
        name: replace(
            estimate,
            low=min(estimate.low, alone[name].low),
            high=max(estimate.high, alone[name].high),
        )
        if name in alone
        else estimate
        for name, estimate in parameters.items()
    }


def _alternatives(
    validation: CrossValidation, rest: Sequence[Candidate], effect: SelectedEffect
) -> tuple[Alternative, ...]:
    result, seen = (
        [],
        {(effect.trial.candidate.hypothesis.effect, effect.trial.candidate.hypothesis.joints)},
    )
    for other in effect.alternatives:
        hypothesis = other.candidate.hypothesis
        if (hypothesis.effect, hypothesis.joints) in seen:
            continue
        seen.add((hypothesis.effect, hypothesis.joints))
        more = other.candidate.parameters > effect.trial.candidate.parameters
        better = other.gain > effect.trial.gain and more
        why = (
            f"explains unseen blocks {'better, with more parameters' if better else 'as well'}: "
            f"log-likelihood gain {other.gain:.0f} against {effect.trial.gain:.0f}"
        )
        apart = separation(validation, rest, effect.trial.candidate, other.candidate)
        result.append(
            Alternative(hypothesis.effect, hypothesis.names, f"{why}; {apart}" if apart else why)
        )
    return tuple(result)


def _verdict(findings: Sequence[Finding], in_part: bool) -> Verdict:
    if not findings:
        return "nothing_to_explain"
    unknown = [finding.effect == Unknown.NAME for finding in findings]
    if all(unknown):
        return "unexplained"
    if any(unknown) or in_part:
        return "partly_explained"
    if any(finding.alternatives for finding in findings):
        return "ambiguous"
    return "explained"
