"""The result of a diagnosis: what it says as a whole."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.findings import FLOORS, Ambiguity, Finding, FloorFrom, Known, Weighed
from dvrk_gravity.diagnosis.simulation_check import InSimulation
from dvrk_gravity.effects import compared_with
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import DataWarning

_MORE = 2.0  # times what a model expects of itself: more than it should be. Chosen.
Verdict = Literal["nothing_to_explain", "explained", "partly_explained", "ambiguous", "unexplained"]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The result of a diagnosis.

    Attributes:
        verdict: In one word.
        findings: What changed or was missed: those that are certain first, by the part of the
            held-out error that each removes; what has no name last.
        known: What the model's own uncertainty and its known error account for.
        before: RMSE of the given model by joint, held-out, N·m.
        after: RMSE with all findings that have a name.
        floor: RMSE that noise alone would leave; NaN where it cannot be told.
        expected: RMSE that the model expects of itself here, from its parameters' posterior and its
            known error; NaN of one that does not tell.
        floor_from: What the floor was seen in: ``repetition``, ``high_frequencies``, ``nothing``.
        samples: Samples compared.
        held_out: Those of them that neither fit nor choice has seen.
        warnings: About the data.
        notes: How it was judged, one sentence each.
        ambiguities: Causes, found or not, that this data could not tell apart.
        model: The model, extended by what a model file can carry.
        in_simulation: The given and the extended model in the simulator; ``None`` if not asked
            for, or if they are the same.
        weighed: How the payload found compares with the mass that is said to be there; ``None`` if
            none is.
        band: Hz; errors are of what lies below this. ``None`` of static poses.
        against_reference: The recordings are compared with a reference, not with the model.
        with_model: There is a model, on trial or beside a reference.
        outside: Where joints are beyond what the model was identified on, one sentence each.
        of_file: What an arm's own file states was on trial.
        exact: Why the model on trial counts as exact; ``""``: it says how sure it is.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    known: tuple[Known, ...]
    before: Mapping[str, float]
    after: Mapping[str, float]
    floor: Mapping[str, float]
    expected: Mapping[str, float]
    floor_from: FloorFrom
    samples: int
    held_out: int
    warnings: tuple[DataWarning, ...]
    notes: tuple[str, ...]
    ambiguities: tuple[Ambiguity, ...]
    model: TorqueModel = field(repr=False)
    in_simulation: InSimulation | None = None
    weighed: Weighed | None = None
    band: float | None = None
    against_reference: bool = False
    with_model: bool = True
    outside: tuple[str, ...] = ()
    of_file: bool = False
    exact: str = ""

    def __repr__(self) -> str:
        """Give the verdict and the effects, in short."""
        found = ", ".join(
            f"{finding.effect} at {', '.join(finding.joints) or 'the arm'}"
            for finding in self.findings
        )
        return f"<Diagnosis {self.verdict}: {found or 'no findings'}>"

    @property
    def sentence(self) -> str:
        """The diagnosis in one sentence."""
        if self.findings:
            return self.findings[0].sentence
        against = compared_with(self.against_reference)
        friction = "; ".join(entry.of_all_friction for entry in self.known if entry.of_all_friction)
        but = f" but friction as another day has it: {friction}" if friction else ""
        nothing = f"Nothing was found that {against} lacks{but}"
        least, words = self.least
        ratio = {
            name: self.after[name] / value
            for name, value in least.items()
            if value > 0 and np.isfinite(self.after[name])
        }
        if not ratio:
            return f"{nothing}."
        most = max(ratio, key=lambda name: ratio[name])
        told = any(most in entry.joints for entry in self.known if entry.of_effect)
        beside = ", friction of another day and other known causes included" if told else ""
        more = (
            f" That is more than it should be, and nothing that was tried explains it for certain: "
            f"a longer recording in which {most} moves more, and one of it alone, would tell."
            if least is self.expected and not told and ratio[most] > _MORE
            else ""
        )
        return (
            f"{nothing}{'. What' if friction else ': what'} it leaves is at most "
            f"{ratio[most]:.2g} times {words} ({most}{beside}).{more}"
        )

    @property
    def least(self) -> tuple[Mapping[str, float], str]:
        """The error by joint, N·m or N, that what is left is measured by, and what it is.

        That of a model that knows how sure it is; of others only noise is known.
        """
        if np.isfinite(list(self.expected.values())).any():
            return self.expected, "what it expects of itself"
        return self.floor, FLOORS[self.floor_from]

    @property
    def headline(self) -> str:
        """What every figure rests on, if that is in question; ``""`` if it is not."""
        if not self.exact:
            return ""
        return (
            f"the model counts as exact, for {self.exact}: whatever it misses is a finding, and "
            "every interval leaves its own error out"
        )

    @property
    def gains_most(self) -> str:
        """Name of the joint where the first finding that the extended model carries gains most."""
        for finding in self.findings:
            if finding.in_model:
                return finding.joints[0] if finding.picture is None else finding.picture.joint
        return ""

    @property
    def caveat(self) -> str:
        """What to bear in mind about the findings, in a sentence; ``""`` if nothing."""
        if not (self.against_reference and self.findings):
            return ""
        no_model = (
            ". A tilt of the base or a joint's zero is told as other causes: a --model beside the "
            "reference tells it"
        )
        return (
            "against a reference all counts that differs between two recordings, friction that "
            "warmth or another day changes, too: made in one sitting, one after the other, they "
            "tell the change alone. Of a load on a link that turns, mass times place is surer than "
            f"the mass, which its inertia tells{'' if self.with_model else no_model}"
        )

    @property
    def errors(self) -> tuple[Mapping[str, float], ...]:
        """RMS error by joint: before, after, its floor, and what was expected; N·m or N."""
        return self.before, self.after, self.floor, self.expected

    @property
    def sizes(self) -> tuple[float, ...]:
        """What the unit of a table of errors fits: all but those expected.

        Outside the range that it was identified on, a model's own expectation has no bounds.
        """
        return *self.before.values(), *self.after.values(), *self.floor.values()

    @property
    def compared(self) -> str:
        """What the errors are of, in words."""
        below = "" if self.band is None else f" below {self.band:g} Hz,"
        return f"in joint coordinates,{below} on blocks held out of fit and choice"

    def to_dict(self) -> dict[str, Any]:
        """Return findings.json's content."""
        return {
            "format": 2,
            "verdict": self.verdict,
            "findings": [finding.to_dict() for finding in self.findings],
            "known": [known.to_dict() for known in self.known],
            "rmse": {
                name: {joint: _number(v) for joint, v in values.items()}
                for name, values in (
                    ("before", self.before),
                    ("after", self.after),
                    ("floor", self.floor),
                    ("model", self.expected),
                )
            },
            "data": {
                "samples": self.samples,
                "held_out": self.held_out,
                "warnings": [str(warning) for warning in self.warnings],
                "floor_from": self.floor_from,
                "model_exact": bool(self.exact),
            },
            "ambiguities": [
                {
                    "between": [ambiguity.first.to_dict(), ambiguity.second.to_dict()],
                    "overlap": ambiguity.overlap,
                    "sentence": ambiguity.sentence,
                }
                for ambiguity in self.ambiguities
            ],
            "known_payload": self.weighed and self.weighed.to_dict(),
            "notes": list(self.notes),
            "simulation": self.in_simulation and self.in_simulation.to_dict(),
        }

    def to_json(self) -> str:
        """Return findings.json's text."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def by_joint(names: Sequence[str], values: Array) -> dict[str, float]:
    """Return (n,) values by joint name."""
    return dict(zip(names, values.tolist(), strict=True))
