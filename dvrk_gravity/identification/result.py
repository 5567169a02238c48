"""Results of an identification: a model, its errors, its verdict, what the data leave open."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation import beats
from dvrk_gravity.model import VERDICTS, TorqueModel
from dvrk_gravity.recording import Coordinates, Note
from dvrk_gravity.tabular import Columns, Tabular

# Standard errors that a constant may be more than it is. Chosen: 95 %.
SIGNIFICANT = 2.0


@dataclass(frozen=True)
class JointError:
    """Error of a prediction on one joint.

    Attributes:
        rmse: Root mean square of measured minus predicted torque, N·m.
        nrmse: |e| / |tau|: norm of the error over the norm of the measured torque.
        r2: 1 - |e|^2 / |tau - mean(tau)|^2.
        beats_constant: Whether it is significantly less than that of a constant, the mean of the
            fitted data; or the joint bears no weight and rests, so that nothing can be predicted.
        floor: The RMSE that the recording's noise alone leaves, N·m; NaN where it is not known.
    """

    rmse: float
    nrmse: float
    r2: float
    beats_constant: bool = True
    floor: float = math.nan

    @property
    def over_floor(self) -> float:
        """How many times the noise it is; NaN where that is not known."""
        return self.rmse / self.floor if self.floor > 0.0 else math.nan

    def to_json(self) -> dict[str, float | None]:
        """Return it without the comparison with a constant."""
        floor = self.floor if math.isfinite(self.floor) else None
        return {"rmse": self.rmse, "floor": floor, "nrmse": self.nrmse, "r2": self.r2}


@dataclass(frozen=True)
class FittedParameter:
    """One identified number.

    Attributes:
        name: As in the model file, with an index for arrays: ``viscous_friction.joint[3]``; or a
            combination that the data do determine, in words: ``beta1 + 0.98 k1``.
        value: Estimate.
        unit: SI unit.
        ci95: 95 % confidence interval, robust to autocorrelation of the residual; both infinite
            where the data say nothing.
        identifiable: Determined by the data, not by a prior.
    """

    name: str
    value: float
    unit: str
    ci95: tuple[float, float]
    identifiable: bool = True


@dataclass(frozen=True)
class Choice:
    """A change of the model that was tested.

    Attributes:
        term: Effect, with the joint or place where it matters.
        kept: Whether it is in the model.
        before: Held-out error without it, relative to the measured torque.
        after: Held-out error with it.
        reason: One sentence.
    """

    term: str
    kept: bool
    before: float
    after: float
    reason: str

    @property
    def added(self) -> bool:
        """Whether it added something to the model; else it removed something, or was rejected."""
        return self.kept and not self.term.startswith("without ")


@dataclass(frozen=True)
class Identifiability:
    """What the data determine.

    Attributes:
        rank: Number of independent combinations of parameters that the data determine better than
            the prior.
        columns: Number of parameters of the fit.
        condition: Condition number of the determined part, columns scaled to length one.
        statements: Sentences: which parameters cannot be separated, and what motion would
            separate them.
    """

    rank: int
    columns: int
    condition: float
    statements: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The rank in a sentence."""
        return (
            f"the data determine {self.rank} of {self.columns} independent combinations of "
            f"parameters better than the prior does; condition number {self.condition:.3g}"
        )


def improvement(error: str, gain: float, uncertainty: float, kept: bool) -> str:
    """Return a sentence on why a change was made or rejected.

    Args:
        error: Name of the error that decides.
        gain: Part of its square that the change removes.
        uncertainty: Standard error of the gain.
        kept: Whether it was made.
    """
    did = "improves" if kept or gain > 0.0 else "does not improve"
    enough = ", but not by enough" if not kept and gain > 0.0 else ""
    share = f"{100 * gain:+.1f} ± {100 * uncertainty:.1f} %"
    return f"{did} the {error}{enough}: {share} of the squared error"


@dataclass(frozen=True, eq=False)
class Trace:
    """Measured and predicted torque side by side, for pictures.

    Attributes:
        joints: Names of the n columns.
        time: (N,) s, ``None`` for static poses.
        position: (N, n) rad.
        velocity: (N, n) rad/s, ``None`` for static poses.
        measured: (N, n) N·m.
        predicted: (N, n) N·m; held-out prediction where ``held_out``.
        coordinates: Of all of them.
        held_out: Each sample was predicted by a fit that had not seen it.
        source: Number of the recording.
        noise: (n,) RMS that noise alone leaves in ``measured``; ``None``: not known.
    """

    joints: tuple[str, ...]
    time: Array | None
    position: Array
    velocity: Array | None
    measured: Array
    predicted: Array
    coordinates: Coordinates
    held_out: bool
    source: int = 0
    noise: Array | None = None

    def __repr__(self) -> str:
        """Say what it holds, in short."""
        return f"<Trace of {len(self.measured)} samples, {self.coordinates} coordinates>"


def in_short(joints: Mapping[str, JointError]) -> str:
    """Return the relative errors of some joints on one line."""
    return ", ".join(f"{name} {error.nrmse:.3f}" for name, error in joints.items())


def error_columns(errors: Mapping[str, JointError], units: Mapping[str, str]) -> Columns:
    """Return a table of errors by joint, with the units of their RMSE."""
    return {
        "joint": list(errors),
        "rmse": [error.rmse for error in errors.values()],
        "floor": [error.floor for error in errors.values()],
        "unit": [units[name] for name in errors],
        "nrmse": [error.nrmse for error in errors.values()],
        "r2": [error.r2 for error in errors.values()],
    }


def in_words(level: str) -> str:
    """Return one of ``model.VERDICTS`` in words."""
    return "do not compensate with this" if level == VERDICTS[-1] else level


@dataclass(frozen=True)
class Holding:
    """Gravity torque of one joint, at rest, and its uncertainty; root mean squares.

    Attributes:
        torque: At recorded poses, N·m.
        error: Its standard error, N·m.
        torque_anywhere: At poses anywhere within the arm's limits, N·m.
        error_anywhere: Its standard error, N·m.
        lower: Least recorded position, rad.
        upper: Greatest recorded position, rad.
        friction: Dry friction that opposes this joint alone, N·m; zero if none was identified.
    """

    torque: float
    error: float
    torque_anywhere: float
    error_anywhere: float
    lower: float
    upper: float
    friction: float = 0.0


@dataclass(frozen=True)
class Constant:
    """The constant part of what holds a joint and is neither its weight nor its dry friction.

    Efforts alone do not distinguish a spring's constant, which the arm feels, from a bias of the
    reading and from a hand that pushed through the whole recording, which it does not.

    Attributes:
        value: N·m or N.
        error: Its standard error.
        held: RMS torque that holds the joint, likewise.
        least: More than this would move the joint: its dry friction, or what moves no joint.
        settled: What it is (one of ``model.BIAS_IS``), where that was stated; ``""``: unknown.
    """

    value: float
    error: float
    held: float
    least: float
    settled: str = ""

    @property
    def share(self) -> float:
        """Its size as a part of the torque that holds the joint."""
        return _ratio(abs(self.value), self.held)

    @property
    def most(self) -> float:
        """What it may be, N·m or N, with its sign: where weight looks like it, more than it is."""
        return self.value + math.copysign(SIGNIFICANT * self.error, self.value)

    @property
    def determined(self) -> bool:
        """Whether it is known to what moves no joint, beside weight that looks like it."""
        return SIGNIFICANT * self.error <= self.least

    @property
    def moves(self) -> bool:
        """Whether it may move the joint, where the arm does not feel it."""
        return abs(self.most) > self.least

    @property
    def in_doubt(self) -> bool:
        """Whether it may move the joint, and nothing has settled what it is."""
        return self.moves and not self.settled

    def to_json(self) -> dict[str, Any]:
        """Return its part of ``identify --json``."""
        return {**vars(self), "share": self.share, "in_doubt": self.in_doubt}


@dataclass(frozen=True)
class HeldWeight:
    """Torque of a model at rest at one joint, beside the weight of the arm's masses.

    Attributes:
        joint: Name.
        ratio: Torque over weight at the recorded poses: of stated masses the projection on their
            weight, of plausible ones only the size.
        error: Its standard error.
        weight: RMS of the masses' weight, N·m or N.
        stated: Whether the arm's file states the masses; else they are the shipped plant's.
        believed: Whether efforts should be in N·m and the masses right: no other unit is stated,
            nor N·m whatever the masses say.
        loaded: A plausible load on the last link explains it better than a wrong scale.
        scale: One N·m in the unit of the efforts, where the masses determined it.
    """

    joint: str
    ratio: float
    error: float
    weight: float
    stated: bool
    believed: bool
    loaded: bool = False
    scale: float = 1.0


@dataclass(frozen=True)
class Contradiction:
    """Evidence against a model at some joints.

    Attributes:
        joints: Their names.
        level: The best verdict that they can have, one of ``model.VERDICTS``.
        reason: Short, for each joint.
        line: One line for the head of a report.
        record: What to record instead.
    """

    joints: tuple[str, ...]
    level: str
    reason: str
    line: str
    record: str = "efforts with gravity, in the unit that the arm's file states (docs/own_arm.md)"


@dataclass(frozen=True)
class JointVerdict:
    """The verdict on one joint.

    Attributes:
        level: One of ``model.VERDICTS``.
        reason: Why.
        record: What to record instead; ``""`` for a good one.
    """

    level: str
    reason: str
    record: str = ""

    @property
    def words(self) -> str:
        """The level in words."""
        return in_words(self.level)


@dataclass(frozen=True)
class Verdict:
    """Whether an arm may be compensated with a model.

    Attributes:
        level: One of ``model.VERDICTS``: that of the worst joint.
        reason: Which joints, and why; ``""`` for a good model.
        record: What to record instead; ``""`` for a good model.
        joints: By joint.
        findings: Evidence against the data as a whole, a line each, for the head of a report:
            efforts without gravity, in another unit, exchanged.
    """

    level: str
    reason: str
    record: str
    joints: Mapping[str, JointVerdict]
    findings: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The level in words."""
        return in_words(self.level)

    def to_json(self) -> dict[str, Any]:
        """Return its part of ``identify --json``."""
        return {
            "overall": self.level,
            "findings": list(self.findings),
            "reason": self.reason,
            "record": self.record,
            "joints": {
                name: {"verdict": verdict.level, "reason": verdict.reason, "record": verdict.record}
                for name, verdict in self.joints.items()
            },
        }


@dataclass(frozen=True, eq=False)
class Fit(Tabular):
    """A fitted model, its errors and its verdict.

    Attributes:
        model: The model, ready to be saved as the compensator's parameter file.
        held_out: Error by joint on data that the fit had not seen; see ``validation``.
        training: Error by joint on the data fitted.
        parameters: Identified numbers with confidence.
        identifiability: What the data determine.
        choices: Terms tested, in this order.
        warnings: Of the recordings' checks.
        handling: How the data were prepared, one sentence each.
        validation: How the held-out error was obtained, one sentence.
        coordinates: Of the errors.
        samples: Samples that the fit used.
        physical: Least over greatest eigenvalue of each link's pseudo-inertia; empty if the links
            need not be bodies.
        traces: Measured against predicted.
        rest_error: From (K, n) measured positions, rad or m, to (K, n) standard errors of the
            gravity torque there, N·m or N; what the model lacks counts.
        holding: Gravity torque and its uncertainty, by joint.
        verdict: Whether to compensate with the model; the model carries it, too.
        against: Evidence against the model.
        constants: The constant part of what holds each joint, by joint.
        weights: The weight that was found beside that of the arm's masses, where they are known.
    """

    model: TorqueModel
    held_out: Mapping[str, JointError]
    training: Mapping[str, JointError]
    parameters: tuple[FittedParameter, ...]
    identifiability: Identifiability
    choices: tuple[Choice, ...]
    warnings: tuple[Note, ...]
    handling: tuple[str, ...]
    validation: str
    coordinates: Coordinates
    samples: int
    physical: Mapping[str, float]
    traces: tuple[Trace, ...]
    rest_error: Callable[[Array], Array]
    holding: Mapping[str, Holding]
    verdict: Verdict
    against: tuple[Contradiction, ...] = ()
    constants: Mapping[str, Constant] = field(default_factory=dict)
    weights: tuple[HeldWeight, ...] = ()

    def __repr__(self) -> str:
        """Give the verdict and the errors, in short."""
        return (
            f"<Fit of {self.model.arm.name} to {self.samples} samples: {self.verdict.words}; "
            f"held-out |e|/|tau| {in_short(self.held_out)}>"
        )

    def _headline(self) -> str:
        return f"{self.model.arm.name}: {self.verdict.words}"

    def _columns(self) -> Columns:
        """Return held-out errors and verdict of each joint."""
        arm = self.model.arm
        units = dict(zip(arm.joint_names, arm.effort_units, strict=True))
        verdicts = [self.verdict.joints[name] for name in self.held_out]
        return {
            **error_columns(self.held_out, units),
            "verdict": [verdict.words for verdict in verdicts],
            "why": [verdict.reason for verdict in verdicts],
        }

    def to_json(self) -> dict[str, Any]:
        """Return the content of ``identify --json``."""
        return {
            "verdict": self.verdict.to_json(),
            "joints": {name: error.to_json() for name, error in self.held_out.items()},
            "training": {name: error.to_json() for name, error in self.training.items()},
            "samples": self.samples,
            "coordinates": self.coordinates,
            "validation": self.validation,
            "parameters": [vars(parameter) for parameter in self.parameters],
            "identifiability": vars(self.identifiability),
            "constants": {name: each.to_json() for name, each in self.constants.items()},
            "weights": [vars(each) for each in self.weights],
            "choices": [vars(choice) for choice in self.choices],
            "physical": dict(self.physical),
            "warnings": [str(warning) for warning in self.warnings],
            "handling": list(self.handling),
        }


def joint_errors(
    joints: Sequence[str],
    measured: Array,
    predicted: Array,
    constant: Array | None = None,
    idle: Mask | None = None,
    floor: Array | None = None,
) -> dict[str, JointError]:
    """Return the errors of predicted torques by joint.

    Args:
        joints: Names of the n joints.
        measured: (N, n) N·m or N.
        predicted: (N, n) likewise.
        constant: (n,) or (N, n) prediction without a model; ``None``: the mean of ``measured``.
        idle: (n,) joints at which there is nothing to predict (``weights.idle``): they need not be
            predicted better than by a constant, unless no other joint is.
        floor: (n,) error that noise alone leaves, N·m; ``None``: not known.
    """
    residual = measured - predicted
    power = np.mean(residual**2, axis=0)
    size = np.mean(measured**2, axis=0)
    spread = np.var(measured, axis=0)
    off = measured - (measured.mean(axis=0) if constant is None else constant)
    # Of efforts that are noise at all joints, one in twenty recordings looks better at any of them.
    better = beats(residual**2, off**2, NormalDist().inv_cdf(1.0 - 0.05 / residual.shape[1]))
    if idle is not None and (idle.all() or (better & ~idle).any()):
        better |= idle
    return {
        joint: JointError(
            float(np.sqrt(power[k])),
            _ratio(np.sqrt(power[k]), np.sqrt(size[k])),
            1.0 - _ratio(power[k], spread[k]),
            bool(better[k]),
            math.nan if floor is None else float(floor[k]),
        )
        for k, joint in enumerate(joints)
    }


def _ratio(error: float, size: float) -> float:
    """Return error / size; where nothing was measured, 0 for no error and 1 for any."""
    return float(error / size) if size > 0.0 else float(error > 0.0)
