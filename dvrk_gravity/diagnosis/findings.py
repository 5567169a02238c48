"""What a diagnosis finds: typed values, rendered elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Estimate

FloorFrom = Literal["repetition", "high_frequencies", "nothing"]


NO_TERM = "no term of a model file carries it"
"""Why most of what is left out of the extended model is left out."""
ANEW = "identify the model anew, with this recording beside its own"
"""What to do about what a term would carry, and this model's does not."""
NOT_AS_FOUND = (
    "the model has such a term already, and cannot hold as much of it here: at the edge of the "
    "range that it was identified on, or at zero, it ends"
)
"""Why the rest is."""

# What the floor is, in words.
FLOORS: Mapping[FloorFrom, str] = {
    "repetition": "what differs between one period of the motion and the next",
    "high_frequencies": "the noise that high frequencies show",
    "nothing": "a noise that is not known",
}


@dataclass(frozen=True)
class Gain:
    """What an effect removes of the error on data that neither fit nor choice has seen.

    Attributes:
        relative: Part of the root-mean-square error that it removes.
        low: Lower end of its 95 % interval (block bootstrap).
        high: Upper end.
        p_value: Of a paired test over the held-out blocks, one-sided.
    """

    relative: float
    low: float
    high: float
    p_value: float


@dataclass(frozen=True)
class Alternative:
    """Another explanation that the data does not tell from the one found.

    Attributes:
        effect: Name in the vocabulary.
        joints: Names of the joints.
        why: Numbers, and what would tell the two apart.
    """

    effect: str
    joints: tuple[str, ...]
    why: str


@dataclass(frozen=True)
class Rejected:
    """An explanation that was tried in the place of the one found, and is worse.

    Attributes:
        effect: Name in the vocabulary.
        joints: Names of the joints.
        place: Which form of the effect.
        gain: Log-likelihood that it brings on unseen blocks.
        behind: By how much less than the one found.
    """

    effect: str
    joints: tuple[str, ...]
    place: str
    gain: float
    behind: float


@dataclass(frozen=True)
class Contender:
    """One of two causes that the data cannot tell apart, whether or not it is there.

    Attributes:
        effect: Name in the vocabulary.
        joints: Names of the joints.
        alone: Estimates if only this one is fitted.
        together: Estimates if both are.
        gain: Log-likelihood that it brings on unseen blocks, its cost taken off.
        suspected: Whether that clearly speaks for it.
        at: Joint whose held-out error it lowers most.
        removed: Part of that error.
    """

    effect: str
    joints: tuple[str, ...]
    alone: Mapping[str, Estimate]
    together: Mapping[str, Estimate]
    gain: float
    suspected: bool
    at: str
    removed: float

    def to_dict(self) -> dict[str, Any]:
        """Return what findings.json holds of it."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "parameters": _parameters(self.alone),
            "parameters_together": _parameters(self.together),
            "log_likelihood_gain": self.gain,
            "held_out": {"joint": self.at, "removed": self.removed},
        }


@dataclass(frozen=True)
class Ambiguity:
    """Two causes that would look alike in this recording.

    Attributes:
        first: One.
        second: The other.
        overlap: Part of the first's torque that the second reproduces.
        pair: The two in words.
        sentence: All of it in words, with what would tell them apart.
    """

    first: Contender
    second: Contender
    overlap: float
    pair: str
    sentence: str

    @property
    def suspected(self) -> bool:
        """Whether unseen blocks clearly speak for either of them."""
        return self.first.suspected or self.second.suspected


@dataclass(frozen=True, eq=False)
class Picture:
    """Residual of one joint against what it depends on, held-out samples.

    Attributes:
        joint: Name of the joint.
        variable: What is on the horizontal axis, with its unit.
        x: (T,) its values.
        before: (T,) error without the effect, N·m.
        after: (T,) error with it, N·m.
        forward: (T,) which samples were taken in positive motion; ``None`` if it does not matter.
    """

    joint: str
    variable: str
    x: Array
    before: Array
    after: Array
    forward: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        """Say what it shows, in short."""
        return f"<Picture of {self.joint} over {self.variable}, {len(self.x)} samples>"


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that the model gets wrong.

    Attributes:
        effect: Name in the vocabulary, or ``unknown``.
        joints: Names of the joints, the affected one first; empty for the whole arm.
        place: Joint, motor, link, or what an unknown structure depends on.
        parameters: Estimates by name.
        gain: What it removes, on held-out data.
        alternatives: Explanations that this data does not tell from it.
        rejected: Explanations that are worse.
        sentence: The finding in words, with figures.
        picture: Where it shows.
        left_out: Why the extended model does not carry it; ``""`` where it does.
        remedy: What to do about it.
        doubt: Why it is not certain, whatever it gains.
    """

    effect: str
    joints: tuple[str, ...]
    place: str
    parameters: Mapping[str, Estimate]
    gain: Gain
    alternatives: tuple[Alternative, ...]
    rejected: tuple[Rejected, ...]
    sentence: str
    picture: Picture | None
    left_out: str
    remedy: str = ""
    doubt: str = ""

    @property
    def in_model(self) -> bool:
        """Whether the extended model carries it."""
        return not self.left_out

    def __repr__(self) -> str:
        """Name effect and joints."""
        return f"<Finding {self.effect} at {', '.join(self.joints) or 'the arm'}: {self.sentence}>"

    @property
    def certain(self) -> bool:
        """Whether zero lies outside the intervals of its gain and of its size.

        Of an effect of several sizes (two directions, three axes) one that is certain is enough.
        Nor is it certain where something else than its gain says so (``doubt``).
        """
        sizes = [
            not estimate.doubtful(zero)
            for name, estimate in self.parameters.items()
            if (zero := effects.named(self.effect).meaning(name).neutral) is not None
        ]
        return self.gain.low > 0.0 and (any(sizes) or not sizes) and not self.doubt

    def to_dict(self) -> dict[str, Any]:
        """Return what findings.json holds of it."""
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


# What is known that is no effect: the model's own parameters moved, the error that it left.
PARAMETERS, ERROR = "model_parameters", "model_error"
KNOWN = "what the model is known to miss, left uncertain, or has of another day"
BETWEEN = "what differs from the reference without a cause that is news"


@dataclass(frozen=True)
class Known:
    """What the model's own uncertainty, or its known error, accounts for: no news.

    Attributes:
        effect: Name of an effect that is significant, and smaller than that error, or such as
            friction changes by from day to day; :data:`PARAMETERS` for how far the model's own
            parameters moved; :data:`ERROR` for what it leaves here as it did when it was
            identified.
        joints: Names of the joints.
        parameters: Estimates by name.
        sentence: It in words, with figures.
        of_all_friction: What friction changed by at all joints, in words; ``""``: it is no such.
        remedy: What to do about it; ``""``: nothing.
    """

    effect: str
    joints: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    sentence: str
    of_all_friction: str = ""
    remedy: str = ""

    @property
    def of_effect(self) -> bool:
        """Whether it is an effect."""
        return self.effect not in (PARAMETERS, ERROR)

    def to_dict(self) -> dict[str, Any]:
        """Return what findings.json holds of it."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "parameters": _parameters(self.parameters),
            "sentence": self.sentence,
            "remedy": self.remedy,
        }


@dataclass(frozen=True)
class Weighed:
    """A payload beside the mass that is said to be there.

    Attributes:
        known: That mass, kg.
        scale: Torque scale by which both would agree: what was found, over what is known; ``None``
            if no payload was found.
        sentence: In words.
    """

    known: float
    scale: Estimate | None
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        """Return what findings.json holds of it."""
        return {
            "mass": self.known,
            "torque_scale": None if self.scale is None else _parameters({"": self.scale})[""],
            "sentence": self.sentence,
        }


def ordered(findings: Iterable[Finding], expected: Collection[str] = ()) -> list[Finding]:
    """Return findings by what they remove, those last of which it may well be nothing.

    Args:
        findings: The findings.
        expected: Names of effects that are no surprise: they come after others.
    """

    def rank(finding: Finding) -> tuple[bool, bool, float]:
        return not finding.certain, finding.effect in expected, -finding.gain.relative

    return sorted(findings, key=rank)


def _parameters(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {
        name: {"value": e.value, "ci95": [e.low, e.high], "unit": e.unit}
        for name, e in estimates.items()
    }
