"""How far each simple change has gone in a recording, found or not: what a history follows.

A finding is there or it is not; most recordings have none. A trend needs a value with its error in
every recording, and the same value in each: here every change is fitted alone beside the model's
own parameters, to the recording as it is read. Of several that resemble each other all are shown,
for the causes that were found differ from recording to recording; which of them it is, the findings
and the likelihood of a whole history decide.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.run import build
from dvrk_gravity.effects import Hypothesis
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Coordinates, Given


@dataclass(frozen=True)
class TrackedChange:
    """One parameter of a change that was fitted alone.

    Attributes:
        effect: Name of the effect.
        joint: Name of the joint; ``""``: of the arm.
        parameter: Name of the parameter.
        value: By how much it differs from what the model has, SI.
        error: Its standard error.
        unit: Its unit.
        torque_ratio: RMS torque of a change of one unit over the RMS friction that the model has,
            at the joint where that is largest; NaN where it has no friction.
    """

    effect: str
    joint: str
    parameter: str
    value: float
    error: float
    unit: str
    torque_ratio: float


def track(
    recordings: Given | Iterable[Given],
    model: TorqueModel,
    still: Mapping[str, float] | None = None,
    coordinates: Coordinates | None = None,
) -> tuple[TrackedChange, ...]:
    """Return the changes that :meth:`effects.Effect.history_hypotheses` names, each fitted alone.

    Args:
        recordings: As of ``diagnose``.
        model: The model that they are compared with.
        still: As of ``diagnose``.
        coordinates: As of ``diagnose``.

    Raises:
        RecordingError: As of ``diagnose``.
        ConfigError: As of ``diagnose``.
    """
    motion, *_ = build(recordings, model, still, coordinates)
    data = FilteredData.of(motion)
    validation = CrossValidation.of(data).weighted([])
    friction = np.sqrt(np.mean(validation.of_choice(data.expectation.friction) ** 2, axis=0))
    asked = [each for effect in effects.effects() for each in effect.history_hypotheses(motion)]
    found = tuple(
        change
        for candidate in data.candidates(asked)
        if (validation.weight[candidate.joints] > 0.0).any()
        for change in _changes(validation, candidate, friction)
    )
    data.release()
    return found


def _changes(
    validation: CrossValidation, candidate: Candidate, friction: Array
) -> Iterator[TrackedChange]:
    """Yield the parameters of one candidate that have a neutral value, each kind once."""
    hypothesis = candidate.hypothesis
    theta, covariance = validation.fit([candidate])
    if not np.isfinite(covariance).all() or not (np.diag(covariance) > 0.0).all():
        return
    values, slopes = hypothesis.parameters(theta), parameter_slopes(hypothesis, theta, covariance)
    joint = hypothesis.names[0] if hypothesis.of_joint else ""
    seen = list[Array]()
    for name, value in values.items():
        neutral = hypothesis.EFFECT.meaning(name).neutral
        slope = slopes[name]
        # Friction that is the same in both directions is one number of two names.
        if neutral is None or not slope.any() or any(np.allclose(slope, each) for each in seen):
            continue
        seen.append(slope)
        error = float(np.sqrt(slope @ covariance @ slope))
        rms = validation.size(candidate, slope / (slope @ slope))
        acts = (friction > 0.0) & (rms > 0.0)
        ratio = float(np.max(rms[acts] / friction[acts])) if acts.any() else np.nan
        yield TrackedChange(
            hypothesis.effect, joint, name, value - neutral, error, hypothesis.unit(name), ratio
        )


def parameter_slopes(hypothesis: Hypothesis, theta: Array, covariance: Array) -> dict[str, Array]:
    """Return each named parameter's (k,) derivatives by (k,) theta, over a standard error.

    Args:
        hypothesis: The hypothesis.
        theta: Its parameters.
        covariance: (k, k) of these, the diagonal positive.
    """
    steps = np.sqrt(np.diag(covariance))
    middle = hypothesis.parameters(theta)
    moved = [hypothesis.parameters(theta + row) for row in np.diag(steps)]
    return {
        name: np.array([each[name] - value for each in moved]) / steps
        for name, value in middle.items()
    }
