"""What a diagnosis finds, as typed values; ``report`` renders them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.inference.held_out import Gain
from dvrk_gravity.diagnosis.results.fitted_hypothesis import FittedHypothesis
from dvrk_gravity.effects import Estimate

NO_TERM = "model files have no term for it"
"""Why most of what is left out of the extended model is left out."""
NOT_AS_FOUND = (
    "the model's own term of this kind cannot take it here: it is at zero, or at the edge of the "
    "range that it was identified on"
)
"""Why the rest is."""
OF_ONE = "recordings differ in how they were read"
"""Why what one of several recordings reads wrongly is left out."""
WINDOW = 0.1  # s of open-loop prediction, which soon diverges
DURATION = 2.0  # s of drift, as long as the console watches it to accept a calibration


@dataclass(frozen=True)
class Alternative:
    """Another explanation than the one found.

    Attributes:
        effect: Name in the vocabulary.
        joints: Names of the joints.
        place: Form of the effect.
        gain: Log-likelihood gain on unseen blocks.
        behind: How much less that is than for the one found.
        why: Why it may stand in that one's place, and what would separate the two; ``""``: it is
            worse.
    """

    effect: str
    joints: tuple[str, ...]
    place: str = ""
    gain: float = 0.0
    behind: float = 0.0
    why: str = ""


@dataclass(frozen=True)
class Contender:
    """One of two causes that the data cannot separate, whether or not it is there.

    Attributes:
        effect: Name in the vocabulary.
        joints: Names of the joints.
        alone: Estimates if only this one is fitted.
        combined: Estimates if both are.
        gain: Log-likelihood gain on unseen blocks, less the cost of its parameters.
        suspected: Whether that gain is clear.
        at: Joint whose held-out error it reduces most.
        removed: Part of that error.
    """

    effect: str
    joints: tuple[str, ...]
    alone: Mapping[str, Estimate]
    combined: Mapping[str, Estimate]
    gain: float
    suspected: bool
    at: str
    removed: float

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "parameters": _parameters(self.alone),
            "parameters_together": _parameters(self.combined),
            "log_likelihood_gain": self.gain,
            "held_out": {"joint": self.at, "removed": self.removed},
        }


@dataclass(frozen=True)
class Ambiguity:
    """Two causes that this recording cannot separate.

    Attributes:
        first: One.
        second: The other.
        overlap: Part of the first's torque that the second reproduces.
        pair: The two in words.
        sentence: All of it in words, with what would separate them.
        unresolved: The two, for a plan that separates them.
    """

    first: Contender
    second: Contender
    overlap: float
    pair: str
    sentence: str
    unresolved: tuple[FittedHypothesis, ...] = ()

    @property
    def suspected(self) -> bool:
        """Whether either has a clear gain on unseen blocks."""
        return self.first.suspected or self.second.suspected


@dataclass(frozen=True, eq=False)
class Picture:
    """Held-out error of one joint against what it depends on.

    Attributes:
        joint: Name of the joint.
        variable: What is on the horizontal axis, with its unit.
        x: (T,) its values.
        before: (T,) error without the effect, N·m.
        after: (T,) error with it, N·m.
        forward: (T,) samples in positive motion; ``None`` if the direction does not matter.
    """

    joint: str
    variable: str
    x: Array
    before: Array
    after: Array
    forward: Mask | None = None

    def __repr__(self) -> str:
        """Name joint, variable and length."""
        return f"<Picture of {self.joint} over {self.variable}, {len(self.x)} samples>"


@dataclass(frozen=True, eq=False)
class Finding:
    """One cause of a model's error.

    Attributes:
        effect: Name in the vocabulary, or ``unknown``.
        joints: Names of the joints, the affected one first; empty for the whole arm.
        place: Joint, motor, link, or what an unexplained structure depends on.
        parameters: Estimates by name.
        gain: Part of the held-out error that it removes.
        alternatives: Explanations that this data cannot separate from it.
        rejected: Worse explanations.
        sentence: The finding in words, with figures.
        picture: Where it shows.
        left_out: Why the extended model lacks it; ``""`` where it has it.
        remedy: What to do about it.
        doubt: Why it is uncertain in spite of its gain; ``""`` if it is not.
        unresolved: It and all that the data cannot separate from it, for a plan that does; none: it
            stands alone, or is about readings.
    """

    effect: str
    joints: tuple[str, ...]
    place: str
    parameters: Mapping[str, Estimate]
    gain: Gain
    alternatives: tuple[Alternative, ...]
    rejected: tuple[Alternative, ...]
    sentence: str
    picture: Picture | None
    left_out: str
    remedy: str = ""
    doubt: str = ""
    unresolved: tuple[FittedHypothesis, ...] = ()

    @property
    def in_model(self) -> bool:
        """Whether the extended model has it."""
        return not self.left_out

    @property
    def unexplained(self) -> bool:
        """Whether it is structure that no cause explains."""
        return effects.named(self.effect).UNEXPLAINED

    @property
    def of_arm(self) -> bool:
        """Whether it is about the arm, and not about what is read of it."""
        return not effects.named(self.effect).READS_WRONGLY

    def __repr__(self) -> str:
        """Name effect and joints."""
        return f"<Finding {self.effect} at {', '.join(self.joints) or 'the arm'}: {self.sentence}>"

    @property
    def certain(self) -> bool:
        """Whether nothing makes it doubtful.

        Neither :attr:`doubt`, nor an interval of its gain that holds zero, nor those of all of its
        sizes.
        """
        sizes = [
            not estimate.doubtful(zero)
            for name, estimate in self.parameters.items()
            if (zero := effects.named(self.effect).meaning(name).neutral) is not None
        ]
        return self.gain.low > 0.0 and (any(sizes) or not sizes) and not self.doubt

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "place": self.place,
            "parameters": _parameters(self.parameters),
            "certainty": "certain" if self.certain else "perhaps",
            "gain": {
                "relative": self.gain.relative,
                "ci95": [self.gain.low, self.gain.high],
                "p_value": self.gain.p_value,
            },
            "alternatives": [
                {"effect": a.effect, "joints": list(a.joints), "why": a.why}
                for a in self.alternatives
            ],
            "sentence": self.sentence,
            "remedy": self.remedy,
            "in_model": self.in_model,
        }


PARAMETERS, ERROR = "model_parameters", "model_error"  # what is known, and is no effect


@dataclass(frozen=True)
class Known:
    """What the model's own uncertainty or known error explains: expected, no finding.

    Attributes:
        effect: Name of an effect that is significant, and smaller than that error or day-to-day
            friction variation; :data:`PARAMETERS` for a change of the model's own parameters;
            :data:`ERROR` for the remaining error.
        joints: Names of the joints.
        parameters: Estimates by name.
        sentence: In words, with figures.
        of_all_friction: Change of friction at all joints, in words; ``""`` for anything else.
        said_first: A diagnosis without findings says it in its first sentence.
        remedy: What to do about it; ``""``: nothing.
        stated: It was said to be there.
    """

    effect: str
    joints: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    sentence: str
    of_all_friction: str = ""
    said_first: bool = False
    remedy: str = ""
    stated: bool = False

    @property
    def of_effect(self) -> bool:
        """Whether it is an effect that the recording shows."""
        return self.effect not in (PARAMETERS, ERROR) and not self.stated

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "parameters": _parameters(self.parameters),
            "sentence": self.sentence,
            "remedy": self.remedy,
        }


@dataclass(frozen=True)
class PayloadCheck:
    """A payload found beside its known mass.

    Attributes:
        known: Known mass, kg.
        scale: Mass found over known mass, a torque scale; ``None`` if no payload was found.
        sentence: In words.
    """

    known: float
    scale: Estimate | None
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        return {
            "mass": self.known,
            "torque_scale": None if self.scale is None else _parameters({"": self.scale})[""],
            "sentence": self.sentence,
        }


@dataclass(frozen=True, eq=False)
class Drift:
    """How an arm moves under compensation after release.

    Attributes:
        friction: Part of the arm's friction, and of its compensation, that is simulated.
        time: (T,) s.
        before: (P, T, n) displacement from each pose with the given model, rad or m.
        after: (P, T, n) the same with the extended model.
    """

    friction: float
    time: Array
    before: Array
    after: Array


@dataclass(frozen=True, eq=False)
class InSimulation:
    """The given and the extended model in the simulator.

    Attributes:
        joints: Names of the joints.
        units: Units of their positions.
        windows: Number of predicted pieces of held-out motion.
        before: (n,) RMS error of predicted positions after :data:`WINDOW` with the given model, rad
            or m; ``None`` where motion could not be simulated.
        after: (n,) the same with the extended model.
        drifts: One for each part of the arm's friction; none without compensation.
        notes: What was not simulated, and why.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    windows: int
    before: Array | None
    after: Array | None
    drifts: tuple[Drift, ...]
    notes: tuple[str, ...]

    def _by_joint(self, values: Array) -> dict[str, float]:
        return dict(zip(self.joints, values.tolist(), strict=True))

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        motion = None
        if self.before is not None and self.after is not None:
            motion = {
                "seconds": WINDOW,
                "windows": self.windows,
                "rmse_before": self._by_joint(self.before),
                "rmse_after": self._by_joint(self.after),
            }
        drifts = [
            {
                "friction": drift.friction,
                "seconds": DURATION,
                "poses": len(drift.before),
                "largest_before": self._by_joint(np.abs(drift.before).max(axis=(0, 1))),
                "largest_after": self._by_joint(np.abs(drift.after).max(axis=(0, 1))),
            }
            for drift in self.drifts
        ]
        units = dict(zip(self.joints, self.units, strict=True))
        return {"units": units, "motion": motion, "drift": drifts, "notes": list(self.notes)}


def ordered(findings: Iterable[Finding], expected: Collection[str] = ()) -> list[Finding]:
    """Return findings by gain: certain ones first, and effects expected of any arm last."""

    def rank(finding: Finding) -> tuple[bool, bool, float]:
        return not finding.certain, finding.effect in expected, -finding.gain.relative

    return sorted(findings, key=rank)


def _parameters(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: estimate.as_json() for name, estimate in estimates.items()}
