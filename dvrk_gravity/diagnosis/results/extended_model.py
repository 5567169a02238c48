"""The model extended by findings, as far as a model file has terms for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.expectation import joints_rubbing_by_load
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.results.findings import NO_TERM, NOT_AS_FOUND
from dvrk_gravity.effects import Hypothesis, LinearTerm, ReadingErrors, Term, Values
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import (
    NO_VERDICT,
    VERDICTS,
    CalibrationSamples,
    ModelUncertainty,
    TorqueModel,
    coefficients_of,
    model_parameters,
)
from dvrk_gravity.recording import DEFAULT_CUTOFF, LowPass

_EXTENDED = "extended by diagnose: evaluate it on another recording"
_ROUNDING = 1e-9  # of a term's largest coefficient


# Of a torque's RMS, that a merged model may miss. Derived: half of its energy; with less missing
# the model is nearer to the finding than without it. What begins unknown or is held at its range
# (presliding, a cable) misses up to 0.33 in the trials with real recordings; a lost sign misses 2.
_MISSED = 0.7


def contradicted(data: FilteredData, candidate: Candidate, theta: Array) -> bool:
    """Return whether the extended model's torque contradicts what was found.

    An effect's columns and its ``merge`` are written separately: a wrong sign in one of them would
    make the extended model worse than the given one.

    Args:
        data: The samples.
        candidate: What was found and merged.
        theta: (k,) its parameters.
    """
    motion = data.motion
    if candidate.hypothesis.EFFECT.READS_WRONGLY and not data.expectation.predicts:
        return False  # relative to how the expected torque was read
    model, _ = extended(motion, [(candidate.hypothesis, theta)])
    merged = data.reduce(motion.read_by(model) - motion.modelled)
    found = candidate.columns() @ theta
    size, missing = (np.linalg.norm(torque[data.usable]) for torque in (found, found - merged))
    return bool(missing > _MISSED * size)


def extended(
    motion: MeasuredMotion,
    found: Sequence[tuple[Hypothesis, Array]],
    left_out: Mapping[int, str] | None = None,
) -> tuple[TorqueModel, tuple[str, ...]]:
    """Return the model with what was found, and why it lacks each finding; ``""`` if it has it.

    Functions of the state, encoder zeros and effort bias go into the file as terms, and wrong
    readings (scale, delay, clipping, coupling) as errors of readings, ``reading.*``. What depends
    on time (drift, a push for a while) is neither.

    Findings are functions of measured positions, a model's terms of true ones: encoder offsets are
    merged first, so that every other finding can take them into account.

    Args:
        motion: The motion, for its model and for the range on which cables were fitted.
        found: Hypotheses and their (k,) parameters, in order.
        left_out: Why some are not merged, by index.
    """
    found = _as_applied(motion, found)
    values: Values = dict(motion.model.parameters())
    model = TorqueModel.from_parameters(values, motion.arm)
    left_out = left_out or {}
    names = {term.NAME for term in effects.terms()}
    reasons = [
        left_out.get(i, NOT_AS_FOUND if each.effect in names and not each.transient else NO_TERM)
        for i, (each, _) in enumerate(found)
    ]
    order = sorted(range(len(found)), key=lambda i: not found[i][0].shifts_positions)
    wrong: list[ReadingErrors] = []
    for i in order:
        hypothesis, theta = found[i]
        if i in left_out:
            continue
        errors = hypothesis.reading_errors(theta)
        changed = hypothesis.merge(values, theta, motion)
        if changed is None and errors is None:
            continue
        try:
            model = TorqueModel.from_parameters(changed or values, motion.arm)
        except ConfigError as error:  # of two offsets, say, the sum may be too large for a file
            reasons[i] = f"a model file refuses it: {error}"
            continue
        values, reasons[i] = changed or values, ""
        if errors is not None:
            wrong.append(errors)
    # Limits were found in applied efforts: a scale found beside them comes after.
    wrong.sort(key=lambda errors: bool(np.isfinite(errors.limit).any()))
    other_terms = tuple(term for term in motion.model.terms if term.NAME not in names)
    model = replace(
        model,
        terms=(*model.terms, *other_terms),
        reading_errors=reduce(ReadingErrors.after, wrong, motion.model.reading_errors),
    )
    if "" in reasons and model.verdict != VERDICTS[-1]:
        # Nobody has evaluated this model; an unusable one stays so.
        model = replace(model, verdict=NO_VERDICT, reason=_EXTENDED)
    return model, tuple(reasons)


def _as_applied(
    motion: MeasuredMotion, found: Sequence[tuple[Hypothesis, Array]]
) -> Sequence[tuple[Hypothesis, Array]]:
    """Return what was found with parameters of the torques that act, not of those that are read.

    A wrong reading of efforts that was found beside other causes, and not of their torque, leaves
    theirs as they are read. Once it is corrected, they are what is nearest to that by least
    squares: of a cause at one joint exactly it.
    """
    wrong = [
        errors.effort
        for hypothesis, theta in found
        if not hypothesis.reads_others and not hypothesis.against_reference
        if (errors := hypothesis.reading_errors(theta)) is not None
    ]
    read = reduce(np.matmul, wrong, np.eye(motion.arm.n))
    if np.array_equal(read, np.eye(motion.arm.n)):
        return found

    def applied(hypothesis: Hypothesis, theta: Array) -> Array:
        columns = hypothesis.regressor(motion)
        acts = np.linalg.solve(read, (columns @ theta).T).T
        flat = columns.reshape(-1, len(theta))
        return np.asarray(np.linalg.lstsq(flat, acts.ravel(), rcond=None)[0])

    return [
        (each, theta if each.EFFECT.READS_WRONGLY else applied(each, theta))
        for each, theta in found
    ]


def updated(
    model: TorqueModel,
    validation: CrossValidation,
    named: Sequence[Candidate],
    held_out: HeldOut,
    left_out: Mapping[int, str],
    whole: bool,
) -> TorqueModel:
    """Return an extended model with the posterior of its parameters and of what was found.

    A model without uncertainty is returned unchanged.

    Args:
        model: The model, extended by what was found.
        validation: The samples.
        named: What was found.
        held_out: The held-out samples, for the error at this new calibration.
        left_out: Why some of what was found is not merged, by index.
        whole: The model has all that was found, and the recording's samples may be kept. What it
            lacks would else count as known from now on.
    """
    motion = validation.data.motion
    before = motion.model.uncertainty
    if before is None:
        return model
    before = before.extended_to(model.terms)
    mean, covariance = validation.posterior(named)
    variance, vectors = np.linalg.eigh(covariance)
    spread = vectors * np.sqrt(np.maximum(variance, 0.0))
    # Between them lie extrapolation and friction by load, which no term has.
    own_parameters, found = mean[: before.size], mean[validation.model_size :]
    edges = np.cumsum([0, *(candidate.size for candidate in named)])
    own_parameters = _within(
        own_parameters, covariance[: before.size, : before.size], model, before
    )

    def at(theta: Array) -> TorqueModel:
        parts = np.split(theta, edges[1:-1])
        found = [(o.hypothesis, p) for o, p in zip(named, parts, strict=True)]
        return extended(motion, found, left_out)[0]

    here = coefficients_of(model.terms)
    deviations = {
        name: change @ spread[: before.size]
        for name, change in before.deviations.items()
        if name in here and len(here[name]) == len(change)
    }
    for row, column in zip(spread[validation.model_size :], np.eye(len(found)), strict=True):
        size = float(np.linalg.norm(row))
        there = coefficients_of(at(found + size * column).terms)
        for name, theta in here.items():
            if size > 0.0 and name in there and there[name].shape == theta.shape:
                slope = (there[name] - theta) / size
                if slope.any():
                    empty = np.zeros((len(theta), spread.shape[1]))
                    deviations[name] = deviations.get(name, empty) + np.outer(slope, row)
    terms = tuple(
        within
        for term in before.shift_terms(model.terms, own_parameters)
        if (within := _clipped(term, model) if term.NAME in before.deviations else term) is not None
    )
    moved = replace(
        model,
        terms=terms,
        joint_offset=model.joint_offset + before.offset @ own_parameters,
    )
    after = coefficients_of(moved.terms)
    # As of an identified model, so that `evaluate` compares it with errors below the same.
    of_poses = validation.data.band is None
    band = before.band if of_poses else min(validation.data.band or np.inf, DEFAULT_CUTOFF)
    error = held_out.rmse(held_out.error_below(named, band))
    error = np.where(np.isfinite(error) & (error > 0.0), error, before.error)
    # The columns after these are of friction by load, which acts everywhere.
    by_load = len(joints_rubbing_by_load(motion))
    outside = slice(before.size, validation.model_size - by_load)
    right = _right_outside(validation.data.model_columns[:, :, outside], mean[outside], error)
    lower, upper = motion.true_q.min(axis=0), motion.true_q.max(axis=0)
    fastest = np.abs(motion.qd).max(axis=0)
    uncertainty = ModelUncertainty(
        coefficients={name: after[name] for name in deviations if name in after},
        deviations={name: change for name, change in deviations.items() if name in after},
        offset=before.offset @ spread[: before.size],
        gravity=before.gravity @ spread[: before.size],
        error=error,
        band=band,
        correlation_time=before.correlation_time,
        lower=np.where(right, np.minimum(before.lower, lower), before.lower),
        upper=np.where(right, np.maximum(before.upper, upper), before.upper),
        speed=np.where(right, np.maximum(before.speed, fastest), before.speed),
        calibration=_samples(validation.data, band) if whole else None,
    )
    return replace(moved, uncertainty=uncertainty)


def _right_outside(columns: Array, parameters: Array, error: Array) -> Array:
    """Return (n,) whether a model's error outside its range is no larger than inside.

    Otherwise it lacks terms there, and its identified range does not grow.

    Args:
        columns: (T, n, e) torques by which it may be off there.
        parameters: (e,) fitted coefficients of them.
        error: (n,) RMS error at this calibration.
    """
    missed = np.square(columns @ parameters).sum(axis=0)
    return np.asarray(missed <= error**2 * columns.any(axis=2).sum(axis=0))


def _samples(data: FilteredData, band: float) -> CalibrationSamples | None:
    """Return the samples that an extended model keeps as its calibration, efforts below a band."""
    motion = data.motion
    partly = not motion.present.all() or motion.invalid_effort.any()
    if data.band is None or motion.rate is None or partly:
        return None
    low = LowPass(band, motion.rate)
    inside = [p for p in motion.parts if p.stop - p.start > 3 * low.edge]
    filtered = ((part, low(motion.effort[part])) for part in inside)
    parts = (
        tuple(
            values[low.edge : -low.edge]
            for values in (motion.q[part], motion.qd[part], motion.qdd[part], effort)
        )
        for part, effort in filtered
    )
    return CalibrationSamples.of(parts, motion.rate)


def _within(
    unconstrained: Array, covariance: Array, model: TorqueModel, before: ModelUncertainty
) -> Array:
    """Return (d,) the mean of parameters given that coefficients stay in their ranges.

    A coefficient that would leave its range is at its end, and the others have their conditional
    mean: clipping it alone would keep what compensated for it.

    Args:
        unconstrained: (d,) their mean without that.
        covariance: (d, d) of them.
        model: The model that they are added to.
        before: Their directions.
    """
    rows: list[Array] = []
    ends: list[float] = []
    mean = unconstrained
    for _ in range(len(unconstrained)):
        new = False
        for term, moved in zip(model.terms, before.shift_terms(model.terms, mean), strict=True):
            change = before.deviations.get(term.NAME)
            if change is None or not isinstance(term, LinearTerm):
                continue
            assert isinstance(moved, LinearTerm)
            theta, clipped = moved.theta, _clipped(moved, model)
            if not isinstance(clipped, LinearTerm) or len(clipped.theta) != len(theta):
                continue
            for k in np.flatnonzero(
                np.abs(clipped.theta - theta) > _ROUNDING * np.abs(theta).max()
            ):
                rows.append(change[k])
                ends.append(float(clipped.theta[k] - term.theta[k]))
                new = True
        if not new:
            break
        held = np.array(rows)
        gain = covariance @ held.T
        missing = np.array(ends) - held @ unconstrained
        mean = unconstrained + gain @ np.linalg.pinv(held @ gain) @ missing
    return mean


def _clipped(term: Term, model: TorqueModel) -> Term | None:
    """Return a term with its parameters within the range of files; ``None`` if none is left."""
    declared, values = model_parameters(model.arm), term.parameters()
    for name, value in values.items():
        if isinstance(value, tuple):
            low, high = declared[name].lower, declared[name].upper
            values[name] = tuple(np.clip(value, low, high).tolist())
    return type(term).from_parameters(model.arm, values)
