"""From the posterior to findings with numbers, and the extended model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, slices_of
from dvrk_gravity.diagnosis.data.faults import Fault
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.inference.infer import Posterior, poorly_stated
from dvrk_gravity.diagnosis.inference.load_posterior import LoadPosterior
from dvrk_gravity.diagnosis.inference.nonlinear import EDGE_STEP, plateau, setting_columns, tangents
from dvrk_gravity.diagnosis.inference.remaining import proven_error
from dvrk_gravity.diagnosis.readings.correction import (
    WrongReading,
    error_as_read,
    error_beside_ordinary,
)
from dvrk_gravity.diagnosis.results import sentences
from dvrk_gravity.diagnosis.results.diagnosis import Diagnosis, Verdict, by_joint
from dvrk_gravity.diagnosis.results.effect_findings import (
    LEAVES,
    difference,
    effect_finding,
)
from dvrk_gravity.diagnosis.results.extended_model import contradicted, extended, updated
from dvrk_gravity.diagnosis.results.findings import NOT_AS_FOUND, Finding, Known, ordered
from dvrk_gravity.diagnosis.results.fitted_hypothesis import estimates
from dvrk_gravity.diagnosis.results.identifiability import ambiguities
from dvrk_gravity.diagnosis.results.other_findings import (
    check_payload,
    fault_finding,
    known,
    reading_finding,
    reasons_not_to_judge,
    unexplained_error,
    unknown_finding,
)
from dvrk_gravity.effects import (
    AbsorbedByModel,
    Estimate,
    PayloadHypothesis,
    ReadingErrors,
)
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import outside_range
from dvrk_gravity.model import NO_VERDICT, TorqueModel
from dvrk_gravity.recording import Note


def report(
    posterior: Posterior,
    faults: Sequence[Fault] = (),
    wrong: Sequence[WrongReading] = (),
    known_payload: float | None = None,
    errors: ReadingErrors | None = None,
) -> Diagnosis:
    """Return the diagnosis that a posterior amounts to.

    Args:
        posterior: What explains the recordings.
        faults: Of the recordings themselves, which were corrected.
        wrong: Wrong readings, in the order in which they were corrected.
        known_payload: Mass that a link carries, kg: the payload found is compared with it.
        errors: Errors of readings that the recordings were corrected for; ``None``: none.
    """
    motion, validation = posterior.motion, posterior.validation
    held_out, data, names = HeldOut(validation), validation.data, motion.arm.joint_names
    named = [effect.trial.candidate for effect in posterior.selected]
    theta, covariance, spreads = _fit(validation, named)
    differences = [difference(validation, named, i, motion.sources) for i in range(len(named))]
    model, left_out, conflicts = _extended(posterior, wrong, held_out, named, theta, differences)
    if errors is not None:
        model = replace(model, reading_errors=errors.after(model.reading_errors))
    findings = [fault_finding(fault) for fault in faults]
    first = held_out.as_read()
    if wrong:
        first = error_as_read(wrong[0].motion, data, held_out)
        findings += _reading_findings(wrong, held_out, named, first)
    effect_findings, averaged = [], _averaged(differences)
    floor, proven = posterior.floor, proven_error(data)
    predicts = data.expectation.predicts
    # What friction and springs differ by from one recording to another is no error of a model.
    likely = np.fmax(floor, proven) if predicts else np.full(motion.arm.n, np.nan)
    for i, rows in enumerate(slices_of(named)):
        if averaged[i]:
            continue
        parameters = _parameters(
            posterior, named, i, theta[rows], covariance[rows, rows], spreads[i]
        )
        finding = effect_finding(
            held_out, validation, posterior.selected, i, parameters, theta[rows], left_out[i],
            likely,
        )  # fmt: skip
        if (differs := differences[i]) is not None:
            sentence = f"{differs[0]}; on average {finding.sentence}"
            finding = replace(finding, sentence=sentence, remedy=sentences.DIAGNOSE_ALONE)
        effect_findings.append(finding)
    findings += ordered(effect_findings, poorly_stated(motion))
    different = any(differences)
    source = data.noise_source(floor)
    if not different:
        findings += [
            unknown_finding(held_out, validation, named, trial) for trial in posterior.unexplained
        ]
        # Day-to-day friction variation is listed as known.
        left = held_out.rmse(held_out.error([*named, *posterior.day_to_day]))
        findings += [
            unexplained_error(motion.arm, j, left[j], floor[j], proven[j], source)
            for j in posterior.unexplained_joints
        ]
    after = held_out.rmse(held_out.error(named))
    of_joints = {j for each in named if each.hypothesis.of_joint for j in each.hypothesis.joints}
    missed = np.flatnonzero(after > LEAVES * likely).tolist()
    leaves = not of_joints.isdisjoint(missed)
    seen = np.where(held_out.seen, 1.0, np.nan)
    grown = [names[joint] for joint in held_out.worse(named, first, floor)]
    outside = outside_range(
        motion.model, motion.q, None if motion.static else motion.qd, motion.present
    )
    blind = reasons_not_to_judge(data, held_out, posterior.detectable)
    unseparated = ambiguities(validation, named, posterior.pool)
    return Diagnosis(
        verdict=_verdict(findings, different or bool(grown) or leaves, blind),
        findings=tuple(findings),
        known=(
            *(_not_significant(posterior, named, each) for each in posterior.stated),
            *known(validation, held_out, posterior.minor, named),
        ),
        before=by_joint(names, seen * held_out.rmse(first)),
        after=by_joint(names, seen * after),
        floor=by_joint(names, floor),
        expected=by_joint(names, proven),
        floor_from=source,
        samples=int((data.block >= 0).sum()),
        held_out=held_out.samples,
        warnings=(*motion.warnings, *_not_judged(motion), *_larger(grown)),
        notes=(
            *sentences.method_notes(motion, data, floor),
            *sentences.extrapolated(outside),
            *(sentences.rejected(effect) for effect in posterior.unconfirmed),
            *(sentences.left_out(named[i].hypothesis, why) for i, why in conflicts.items()),
        ),
        ambiguities=unseparated,
        model=model,
        payload_check=None
        if known_payload is None
        else check_payload(findings, known_payload, not predicts),
        band=data.band,
        against_reference=not predicts,
        with_model=predicts or bool(motion.model.terms),
        outside=outside,
        of_file=motion.model.of_file,
        exact=sentences.why_exact(motion.model) if predicts else "",
        motion=motion,
        held_out_spans=tuple(data.held_out_spans),
        detectable=posterior.detectable,
        cannot_judge=blind,
        model_verdict="" if motion.model.verdict == NO_VERDICT else motion.model.verdict,
    )


def _parameters(
    posterior: Posterior, named: Sequence[Candidate], i: int, theta: Array, covariance: Array,
    spreads: dict[str, float],
) -> dict[str, Estimate]:  # fmt: skip
    """Return the estimates of one of the causes.

    Args:
        posterior: What explains the recordings.
        named: All causes.
        i: Which of them.
        theta: (k,) its linear parameters.
        covariance: (k, k) of them.
        spreads: Standard deviations of its settings.
    """
    hypothesis, motion = named[i].hypothesis, posterior.motion
    beyond = _scale_error(motion.arm) ** 2 * np.outer(theta, theta)
    of_settings = dict(spreads)
    if posterior.at_calibration is not None:
        back, deviations = posterior.at_calibration.spread(named[i], theta)
        beyond += back
        for name, deviation in deviations.items():
            of_settings[name] = np.hypot(of_settings.get(name, 0.0), deviation)
    if isinstance(hypothesis, PayloadHypothesis):
        load = LoadPosterior.of(posterior.validation, named, named[i], theta, beyond)
        return load.estimates(hypothesis)
    if isinstance(hypothesis, AbsorbedByModel):
        beyond += hypothesis.absorbed_variance(motion) * np.eye(len(theta))
    return estimates(hypothesis, theta, covariance + beyond, of_settings)


def _not_significant(posterior: Posterior, named: Sequence[Candidate], stated: Candidate) -> Known:
    """Return how large what is known to be there may be, though nothing shows it."""
    hypothesis, both = stated.hypothesis, [*named, stated]
    theta, covariance, spreads = _fit(posterior.validation, both)
    own = slices_of(both)[-1]
    parameters = _parameters(
        posterior, both, len(named), theta[own], covariance[own, own], spreads[-1]
    )
    sentence = sentences.not_significant(hypothesis.claim(parameters))
    return Known(hypothesis.effect, hypothesis.names, parameters, sentence, stated=True)


def _averaged(differences: Sequence[tuple[str, bool] | None]) -> list[bool]:
    """Return which effects only compensate an average of recordings that differ.

    No recording shows them by itself.
    """
    shown = any(each and each[1] for each in differences)
    return [any(differences) and (not each or shown > each[1]) for each in differences]


def _extended(
    posterior: Posterior,
    misread: Sequence[WrongReading],
    held_out: HeldOut,
    named: Sequence[Candidate],
    theta: Array,
    differences: Sequence[tuple[str, bool] | None],
) -> tuple[TorqueModel, tuple[str, ...], dict[int, str]]:
    """Return the extended model, why it lacks each effect (``""`` if not), and which conflict."""
    motion, data = posterior.motion, posterior.validation.data
    parts = [theta[rows] for rows in slices_of(named)]
    found = [(each.hypothesis, part) for each, part in zip(named, parts, strict=True)]
    averaged = _averaged(differences)
    conflicts = {
        i: sentences.BESIDE_DIFFERENT if averaged[i] else sentences.DIFFERENT
        for i, each in enumerate(differences)
        if averaged[i] or each
    }
    model, left_out = extended(motion, found, conflicts)
    lost = {
        i: NOT_AS_FOUND
        for i, (candidate, part) in enumerate(zip(named, parts, strict=True))
        if not left_out[i] and contradicted(data, candidate, part)
    }
    if lost:
        conflicts |= lost
        model, left_out = extended(motion, found, conflicts)
    if found:
        # Samples that are kept would be as they were read.
        as_read = misread or any(each.EFFECT.READS_WRONGLY for each, _ in found)
        whole = not any(left_out) and not as_read
        model = updated(model, posterior.validation, named, held_out, conflicts, whole)
    right = ReadingErrors.none(motion.arm.n)
    wrong = [errors for each in misread if (errors := each.score.reading.errors)]
    errors = reduce(ReadingErrors.after, [*wrong, model.reading_errors], right)
    return replace(model, reading_errors=errors), left_out, conflicts


def _reading_findings(
    misread: Sequence[WrongReading], held_out: HeldOut, named: Sequence[Candidate], first: Array
) -> list[Finding]:
    """Return wrong readings, all by the gain of their corrections together.

    Of three exchanged joints one exchange alone corrects nothing.
    """
    before, after = first, held_out.as_read()
    # What friction hides does not separate readings.
    if baseline := poorly_stated(held_out.motion):
        of_file = [candidate for candidate in named if candidate.hypothesis.effect in baseline]
        before = error_beside_ordinary(misread[0].motion)
        after = held_out.error(of_file)
    return [reading_finding(wrong, before, after, held_out) for wrong in misread]


def _scale_error(arm: Arm) -> float:
    """Return the relative standard error of torques, from drive gains.

    Their errors, from one table or one weighing, are not independent between joints.
    """
    return 0.0 if arm.drive_gain_error is None else float(np.mean(arm.drive_gain_error))


def _fit(
    validation: CrossValidation, named: Sequence[Candidate]
) -> tuple[Array, Array, list[dict[str, float]]]:
    """Return parameters, covariance, and standard deviations of each effect's settings."""
    if not named:
        return np.zeros(0), np.zeros((0, 0)), []
    along, tangent = tangents(validation, named)
    theta, _ = along.fit(tangent)
    slopes: list[Candidate] = []
    names: list[list[str]] = []
    for candidate, rows in zip(named, slices_of(named), strict=True):
        found, columns = setting_columns(validation, candidate, theta[rows])
        names.append(found)
        slopes += columns
    # Free settings widen the others' intervals; their values stay.
    _, covariance = along.fit([*tangent, *slopes])
    deviation = np.sqrt(np.maximum(np.diag(covariance)[len(theta) :], 0.0)).tolist()
    spreads = []
    for candidate, found in zip(named, names, strict=True):
        spread = {name: deviation.pop(0) for name in found}
        rest = [other for other in named if other is not candidate]
        for name in set(candidate.hypothesis.edges) & set(candidate.hypothesis.refine):
            low, high = plateau(validation, candidate, rest, name)
            spread[name] = max(high - low, EDGE_STEP) / (2.0 * NORMAL_95)
        spreads.append(spread)
    return theta, covariance[: len(theta), : len(theta)], spreads


def _not_judged(motion: MeasuredMotion) -> tuple[Note, ...]:
    if not motion.stands.any():
        return ()
    names = np.array(motion.arm.joint_names)[motion.stands].tolist()
    return (Note("not_judged", None, {}, sentences.stands_still(names)),)


def _larger(joints: Sequence[str]) -> tuple[Note, ...]:
    if not joints:
        return ()
    return (Note("larger_errors", None, {}, sentences.larger_errors(joints)),)


def _verdict(findings: Sequence[Finding], in_part: bool, blind: Sequence[str]) -> Verdict:
    """Return the verdict; where others may be there unseen, findings explain a part at best."""
    unknown = [finding.unexplained for finding in findings]
    if blind and not any(unknown) and not any(finding.certain for finding in findings):
        return "cannot_judge"
    if not findings:
        return "nothing_to_explain"
    if all(unknown):
        return "unexplained"
    if any(unknown) or in_part or blind:
        return "partly_explained"
    if any(finding.alternatives for finding in findings):
        return "ambiguous"
    return "explained"
