"""The error of any model on any recording, in the recording's own coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification.expected_error import (
    ExpectedError,
    expected_errors,
    outside_range,
)
from dvrk_gravity.identification.quality.weights import idle
from dvrk_gravity.identification.result import (
    JointError,
    Trace,
    error_columns,
    in_short,
    joint_errors,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import (
    Decision,
    Observation,
    all_static,
    decide_coordinates,
    filtered,
    held_beyond,
    in_joint_space,
    log_of,
    noise_floor,
    observe,
    require_newtons,
    stated_coordinates,
    warnings_of,
    without_known_errors,
)
from dvrk_gravity.recording import (
    DEFAULT_CUTOFF,
    Bands,
    Coordinates,
    Given,
    Note,
    Prepared,
    Recording,
    about_arm,
    known_coordinates,
    labels,
    opened,
)
from dvrk_gravity.tabular import Columns, Tabular


@dataclass(frozen=True, eq=False)
class Evaluation(Tabular):
    """How well a model predicts recordings.

    Attributes:
        joints: Error by joint (or motor, in actuator coordinates).
        recordings: The same of each recording, by its label.
        samples: Samples compared.
        coordinates: Of the recordings and of the errors.
        detected: Why these coordinates, one sentence; ``""`` if they were given.
        warnings: Of the recordings' checks.
        handling: How the recordings were prepared.
        traces: Measured against predicted.
        with_friction: Joints whose errors include friction: of poses, where either they or the
            model do not separate it.
        idle: Joints at which there is nothing to predict (``weights.idle``).
        outside: Where joints are outside the range of the model's identification, one sentence
            each.
        expected: RMS error that the model expects of itself here, by joint; of those of which it
            knows (:func:`expected_errors`).
        units: Unit of the errors, by joint: N·m or N, or that of the arm's efforts.
        cutoff: Of the zero-phase low-pass of measured and predicted torques, Hz; ``None`` of poses.
    """

    joints: Mapping[str, JointError]
    samples: int
    coordinates: Coordinates
    detected: str
    warnings: tuple[Note, ...]
    handling: tuple[str, ...]
    traces: tuple[Trace, ...]
    with_friction: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()
    outside: tuple[str, ...] = ()
    recordings: Mapping[str, Mapping[str, JointError]] = field(default_factory=dict)
    expected: Mapping[str, ExpectedError] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    cutoff: float | None = None

    def __repr__(self) -> str:
        """Give the errors, in short."""
        return f"<Evaluation of {self.samples} samples: |e|/|tau| {in_short(self.joints)}>"

    def _headline(self) -> str:
        return f"{self.samples} samples, errors in {self.coordinates} coordinates"

    def _columns(self) -> Columns:
        """Return the errors of each joint, and what the model expects of them, NaN: unknown."""
        expected = [self.expected.get(name) for name in self.joints]
        return {
            **error_columns(self.joints, self.units),
            "expected_low": [np.nan if band is None else band.low for band in expected],
            "expected_high": [np.nan if band is None else band.high for band in expected],
        }

    @property
    def metric(self) -> str:
        """What is compared, and what the numbers of a table mean, in words."""
        filtered = (
            "unfiltered"
            if self.cutoff is None
            else f"both below {self.cutoff:g} Hz (zero-phase Butterworth)"
        )
        return (
            f"e: measured less predicted effort, {filtered}; RMSE: root of the mean of e²; "
            "|e|/|tau|: norm of e over that of the measured effort tau; R2: 1 - |e|²/|tau - mean|²"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the content of ``evaluate --json``."""
        return {
            "joints": {
                name: {
                    **error.to_json(),
                    "unit": self.units[name],
                    "expected": self.expected[name].to_json() if name in self.expected else None,
                }
                for name, error in self.joints.items()
            },
            "metric": self.metric,
            "cutoff_hz": self.cutoff,
            "recordings": {
                label: {name: error.to_json() for name, error in joints.items()}
                for label, joints in self.recordings.items()
            },
            "samples": self.samples,
            "coordinates": self.coordinates,
            "detected": self.detected,
            "warnings": [str(warning) for warning in self.warnings],
            "handling": list(self.handling),
            "outside": list(self.outside),
        }


def evaluate(
    model: TorqueModel | str | Path,
    recordings: Given | Iterable[Given],
    coordinates: Coordinates | None = None,
    cutoff: float = DEFAULT_CUTOFF,
) -> Evaluation:
    """Compare a model's torque with the recorded one.

    On trajectories both go through the same zero-phase low-pass; static poses are not filtered.

    Args:
        model: The model, or the path of its file.
        recordings: Trajectories, or static poses: recordings or paths of their files.
        coordinates: Of the recordings; ``None``: determined for each (``decide_coordinates``).
        cutoff: Of the low-pass, Hz.

    Raises:
        RecordingError: No recording, one that cannot be used, or trajectories mixed with poses.
        ConfigError: A model of absurd torques.
        ArgumentError: An argument of a wrong type.
    """
    model = TorqueModel.of(model)
    recordings = opened(recordings, arm=model.arm)
    coordinates = known_coordinates(coordinates) or stated_coordinates(model)
    if not recordings:
        raise RecordingError("recordings", "none given, expected at least one")
    recordings, corrected = without_known_errors(recordings, model, coordinates)
    odd = require_newtons(model, recordings)
    fixed_positions, held = held_beyond(recordings, model.arm, {})
    warnings = list(about_arm(model.arm.warnings if model.of_file else ()))
    static, decisions = all_static(recordings), list[Decision]()

    def decide(number: int, prepared: Prepared) -> Coordinates:
        if number == 0 or not static:  # poses are in the same, all of them
            found = recordings if static else [prepared]
            decisions.append(coordinates_of(model, found, coordinates, fixed_positions))
            warnings.extend(decisions[-1].warnings)
        return decisions[-1].coordinates

    bands = Bands.of_fit(cutoff)
    observed = observe(recordings, model.arm, bands, fixed_positions or None, decide)
    if static:
        evaluated = _evaluate_static(model, observed, decisions[0])
    else:
        evaluated = _evaluate_dynamic(model, observed, decisions[0], cutoff)
    arm = model.arm
    units = dict(zip(arm.joint_names, arm.effort_units, strict=True))
    return replace(
        evaluated,
        units={name: units[name] for name in evaluated.joints},
        warnings=(*corrected, *odd, *held, *warnings, *evaluated.warnings),
    )


def coordinates_of(
    model: TorqueModel,
    recordings: Sequence[Recording] | Sequence[Prepared],
    given: Coordinates | None,
    fixed_positions: Mapping[str, float],
) -> Decision:
    """Return the coordinates of a trajectory, or of sets of poses, beside a model.

    Where they determine no plain model, the error of this one decides (``decide_coordinates``).
    """

    def misfit(system: Coordinates) -> float:
        each = (filtered(recording).read_as(system) for recording in recordings)
        observed = [in_joint_space(one, model.arm, fixed_positions) for one in each]
        if observed[0].rate is None:
            evaluation = _evaluate_static(model, observed, Decision(system))
        else:
            evaluation = _evaluate_dynamic(model, observed, Decision(system), judged=False)
        return float(np.mean([error.nrmse for error in evaluation.joints.values()]))

    return decide_coordinates(recordings[0], model.arm, given, misfit)


def _evaluate_dynamic(
    model: TorqueModel,
    observed: Sequence[Observation],
    decision: Decision,
    cutoff: float = DEFAULT_CUTOFF,
    judged: bool = True,
) -> Evaluation:
    """Return the errors on trajectories; ``judged``: what the model expects of them, too."""
    arm, coordinates = model.arm, decision.coordinates
    sources = [each.sources[0] for each in observed]
    parts = [part for each in observed for part in each.split()]
    traces, positions, velocities = [], [], []
    recorded = np.zeros(arm.n, dtype=bool)
    for motion in parts:
        low = motion.filter
        assert low is not None
        core = np.arange(low.edge, len(motion) - low.edge)
        usable = np.broadcast_to(~motion.invalid_motor_effort, motion.q.shape)
        core = core[usable[core].all(axis=1)]
        predicted = low(arm.actuator_effort(model.prediction(motion.state)))
        q, qd = motion.q, motion.qd
        positions.append(q[core])
        velocities.append(qd[core])
        measured = motion.motor_effort(arm)
        if coordinates == "actuator":
            q, qd = arm.actuator_position(q), arm.actuator_position(qd)
        else:
            measured, predicted = arm.joint_effort(measured), arm.joint_effort(predicted)
        # Of joints that were held nothing was measured.
        seen = motion.present
        recorded |= seen
        position, velocity, effort, torque = (
            array[core][:, seen] for array in (q, qd, measured, predicted)
        )
        joints, time = tuple(compress(arm.joint_names, seen)), motion.time[core]
        traces.append(
            Trace(
                joints, time, position, velocity, effort, torque, coordinates, False,
                motion.clock[0], motion.noise_left(coordinates)[seen],
            )
        )  # fmt: skip
    if not any(len(trace.measured) for trace in traces):
        raise RecordingError(
            sources[0], "holds no time at which the efforts of all joints are readings"
        )
    q, qd = np.concatenate(positions), np.concatenate(velocities)
    resting = _idle(arm, q, coordinates, static=False)
    result = _result(traces, sources, decision, warnings_of(observed), log_of(observed), resting)
    result = replace(result, cutoff=cutoff)
    if not judged:
        return result
    states = [motion.state for motion in parts]
    seconds = sum(float(motion.time[-1] - motion.time[0]) for motion in parts)
    return replace(
        result,
        outside=outside_range(model, q, qd, recorded),
        expected=_expected(model, coordinates, recorded, states, cutoff, seconds),
    )


def _expected(
    model: TorqueModel,
    coordinates: Coordinates,
    recorded: Mask,
    states: Sequence[State],
    cutoff: float | None,
    seconds: float = 0.0,
) -> dict[str, ExpectedError]:
    """Return what a model expects of the recorded joints; nothing of motors that it mixes."""
    if coordinates == "actuator" and not model.arm.direct_drive:
        return {}
    found = expected_errors(model, states, cutoff, seconds)
    each = zip(model.arm.joint_names, found, recorded.tolist(), strict=True)
    return {name: error for name, error, seen in each if seen and error is not None}


def _evaluate_static(
    model: TorqueModel, observed: Sequence[Observation], decision: Decision
) -> Evaluation:
    arm, coordinates = model.arm, decision.coordinates
    traces: list[Trace] = []
    recorded = observed[0].present
    joints = tuple(compress(arm.joint_names, recorded))
    separate = np.ones(arm.n, dtype=bool)  # joints whose friction is
    for number, each in enumerate(observed):
        predicted = model.prediction(State.of(each.q, direction=each.direction))
        q, measured = each.q, each.effort
        if coordinates == "actuator":
            q, predicted = arm.actuator_position(q), arm.actuator_effort(predicted)
            measured = each.motor_effort(arm)
        separate &= _depends_on_approach(model, each.q, each.direction)
        position, effort, torque = (array[:, recorded] for array in (q, measured, predicted))
        traces.append(
            Trace(joints, None, position, None, effort, torque, coordinates, False, number)
        )
    everywhere = np.concatenate([each.q for each in observed])
    result = _result(
        traces, [each.sources[0] for each in observed], decision, warnings_of(observed),
        ("static poses, unfiltered",), _idle(arm, everywhere, coordinates, static=True),
    )  # fmt: skip
    return replace(
        result,
        with_friction=tuple(compress(joints, ~separate[recorded])),
        outside=outside_range(model, everywhere, None, recorded),
        expected=_expected(model, coordinates, recorded, [State(everywhere)], None),
    )


def _depends_on_approach(model: TorqueModel, q: Array, direction: Array | None) -> Mask:
    """Return (n,) whether a model's torques at (N, n) poses depend on the direction of approach."""
    if direction is None:
        return np.zeros(model.arm.n, dtype=bool)
    here, opposite = (model.torque(q, direction=sign * direction) for sign in (1.0, -1.0))
    return np.asarray((here != opposite).any(axis=0))


def _result(
    traces: Sequence[Trace],
    sources: Sequence[str],
    decision: Decision,
    warnings: Sequence[Note],
    handling: Sequence[str],
    resting: tuple[str, ...],
) -> Evaluation:
    samples = sum(len(trace.measured) for trace in traces)
    by_recording = {
        label: errors_of([trace for trace in traces if trace.source == number], resting)
        for number, label in enumerate(labels(sources))
        if any(trace.source == number and len(trace.measured) for trace in traces)
    }
    return Evaluation(
        errors_of(traces, resting), samples, decision.coordinates, decision.reason,
        tuple(warnings), tuple(handling), tuple(traces), idle=resting, recordings=by_recording,
    )  # fmt: skip


def _idle(arm: Arm, q: Array, coordinates: Coordinates, static: bool) -> tuple[str, ...]:
    """Return the joints, or motors, at whose (N, n) positions there is nothing to predict."""
    resting = idle(arm, q, static)
    if coordinates == "actuator":
        resting = arm.motors_of(resting)
    return tuple(compress(arm.joint_names, resting))


def errors_of(
    traces: Sequence[Trace], resting: Sequence[str], constant: Array | None = None
) -> Mapping[str, JointError]:
    """Return the errors of traces of the same joints by joint; see :func:`joint_errors`."""
    joints = traces[0].joints
    measured = np.concatenate([trace.measured for trace in traces])
    predicted = np.concatenate([trace.predicted for trace in traces])
    floor = _floor(traces)
    return joint_errors(joints, measured, predicted, constant, np.isin(joints, resting), floor)


def _floor(traces: Sequence[Trace]) -> Array | None:
    """Return the (n,) error that noise alone leaves in traces, ``None``: not known."""
    seen = [(trace.noise, len(trace.measured)) for trace in traces if trace.noise is not None]
    if len(seen) < len(traces) or not any(length for _, length in seen):
        return None
    return noise_floor([noise for noise, _ in seen], [length for _, length in seen])
