"""The result of a diagnosis as a whole."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.filtered_data import FloorFrom
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.detectable import Detectable
from dvrk_gravity.diagnosis.results import sentences
from dvrk_gravity.diagnosis.results.findings import (
    Ambiguity,
    Finding,
    InSimulation,
    Known,
    PayloadCheck,
)
from dvrk_gravity.diagnosis.results.fitted_hypothesis import FittedHypothesis
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Note
from dvrk_gravity.tabular import Columns, Tabular
from dvrk_gravity.validation import split_link

_READING = 0.5  # s, in which the efforts of a static pose are read. As `plan --poses` has it
_UNEXPECTED = 2.0  # times what a model expects of itself: more than it should be. Chosen
Verdict = Literal[
    "nothing_to_explain", "explained", "partly_explained", "ambiguous", "unexplained",
    "cannot_judge",
]  # fmt: skip


@dataclass(frozen=True)
class Files:
    """Where a diagnosis is written, and of which model and recordings it is.

    Attributes:
        findings: Path of findings.json.
        model: Path of the model's file, as seen from the folder of that; ``""``: none.
        recordings: Those of the recordings, likewise.
    """

    findings: str = "findings.json"
    model: str = ""
    recordings: tuple[str, ...] = ()

    @classmethod
    def of(cls, findings: Path, model: Path | None, recordings: Iterable[Path] = ()) -> Files:
        """Return them for files as seen from the working directory."""

        def seen(path: Path | str) -> str:
            return os.path.relpath(Path(path).resolve(), findings.parent.resolve())

        path, link = split_link("" if model is None else str(model))
        its = f"{seen(path)}#{link}" if link else seen(path) if path else ""
        return cls(str(findings), its, tuple(map(seen, recordings)))


@dataclass(frozen=True, eq=False)
class Diagnosis(Tabular):
    """The result of a diagnosis.

    Attributes:
        verdict: In one word.
        findings: Causes of the error: certain ones first, by the part of the held-out error that
            each removes; unexplained structure last.
        known: What the model's own uncertainty and its error at calibration explain.
        before: Held-out RMSE of the given model by joint, N·m.
        after: RMSE with all named findings.
        floor: RMSE of noise alone; NaN if unknown.
        expected: RMSE that the model expects of itself: its error at calibration; of a file's, from
            its uncertain masses and day-to-day friction variation. NaN without uncertainty.
        floor_from: Where the floor was seen.
        samples: Samples compared.
        held_out: Those of them held out of fit and selection.
        warnings: About the data.
        notes: How it was judged, one sentence each.
        detectable: The smallest changes that would have been found, site by site.
        cannot_judge: Why what was not found may be there nevertheless, a clause each; empty: such
            changes as ``detectable`` has would have been found.
        model_verdict: The given model's own verdict, of ``identify``; ``""``: none.
        ambiguities: Causes, found or not, that this data cannot separate.
        model: The model, extended by what a model file has terms for.
        in_simulation: The given and the extended model in the simulator
            (``compensate.with_simulation``); ``None``: not asked for, or the same model.
        payload_check: How the payload found compares with its known mass; ``None`` without one.
        band: Hz; errors are those below this. ``None`` for static poses.
        against_reference: The recordings are compared with a reference, not with the model.
        with_model: A model was given, by itself or beside a reference.
        outside: Where joints are outside the identified range, one sentence each.
        of_file: The model is what an arm's own file states.
        exact: Why the model counts as exact; ``""`` if it states its uncertainty.
        misplaced: Where a load was stated to be, and does not fit; ``""``: it fits, or none was.
        motion: What was diagnosed, as it was finally read.
        held_out_spans: Beginning and end of each held-out span of time, s.
        files: Where it is written.
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
    warnings: tuple[Note, ...]
    notes: tuple[str, ...]
    ambiguities: tuple[Ambiguity, ...]
    model: TorqueModel = field(repr=False)
    motion: MeasuredMotion = field(repr=False)
    held_out_spans: tuple[tuple[float, float], ...] = field(repr=False)
    in_simulation: InSimulation | None = None
    payload_check: PayloadCheck | None = None
    band: float | None = None
    against_reference: bool = False
    with_model: bool = True
    outside: tuple[str, ...] = ()
    of_file: bool = False
    exact: str = ""
    detectable: tuple[Detectable, ...] = ()
    cannot_judge: tuple[str, ...] = ()
    model_verdict: str = ""
    misplaced: str = ""
    files: Files = field(default_factory=Files)

    def __repr__(self) -> str:
        """Give the verdict and the effects."""
        found = ", ".join(
            f"{finding.effect} at {', '.join(finding.joints) or 'the arm'}"
            for finding in self.findings
        )
        return f"<Diagnosis {self.verdict}: {found or 'no findings'}>"

    def _headline(self) -> str:
        return f"{self.verdict.replace('_', ' ')}: {self.sentence}"

    def _columns(self) -> Columns:
        """Return the findings, in their order."""
        found = self.findings
        return {
            "effect": [finding.effect for finding in found],
            "joints": [", ".join(finding.joints) or "the arm" for finding in found],
            "place": [finding.place for finding in found],
            "certain": [finding.certain for finding in found],
            "removed": [finding.gain.relative for finding in found],
            "removed_low": [finding.gain.low for finding in found],
            "removed_high": [finding.gain.high for finding in found],
            "p_value": [finding.gain.p_value for finding in found],
            "sentence": [finding.sentence for finding in found],
        }

    @property
    def sentence(self) -> str:
        """The first finding in a sentence, or that there is none and what error remains."""
        if self.findings:
            return self.findings[0].sentence
        if self.cannot_judge:
            return sentences.cannot_judge(self.cannot_judge)
        least, words = self.least
        ratio = {
            name: self.after[name] / value
            for name, value in least.items()
            if value > 0 and np.isfinite(self.after[name])
        }
        return sentences.nothing_found(
            self.against_reference,
            "; ".join(entry.of_all_friction for entry in self.known if entry.of_all_friction),
            [entry.sentence for entry in self.known if entry.said_first],
            ratio,
            words,
            [name for entry in self.known if entry.of_effect for name in entry.joints],
            _UNEXPECTED if least is self.expected else None,
        )

    @property
    def least(self) -> tuple[Mapping[str, float], str]:
        """Error by joint to compare the remaining one with, N·m or N, and what it is.

        What a model expects of itself; without uncertainty only the noise floor is known.
        """
        if np.isfinite(list(self.expected.values())).any():
            return self.expected, "what the model expects"
        return self.floor, sentences.FLOORS[self.floor_from]

    @property
    def unresolved(self) -> tuple[tuple[FittedHypothesis, ...], ...]:
        """Groups of causes that this data cannot separate, and that a plan may: one is there."""
        suspected = [each for each in self.ambiguities if each.suspected]
        several: list[Finding | Ambiguity] = [*self.findings, *suspected]
        return tuple(group for each in several if (group := self._separable(each)))

    def _separable(self, several: Finding | Ambiguity) -> tuple[FittedHypothesis, ...]:
        """Return those of its causes whose torque is known in other motions, two names or more."""
        if self.against_reference:  # torques are known only where they were measured
            return ()
        known = tuple(each for each in several.unresolved if each.known_elsewhere)
        return known if len({each.named for each in known}) > 1 else ()

    @property
    def separated_by(self) -> str:
        """The command that plans what separates causes; ``""``: there are none to separate."""
        if not self.unresolved:
            return ""
        return sentences.separating_command(self.files.findings, self.motion.static)

    def separating(self, several: Finding | Ambiguity) -> str:
        """Return the command that plans what separates its causes; ``""``: no plan may."""
        wanted = isinstance(several, Finding) or several.suspected
        return self.separated_by if wanted and self._separable(several) else ""

    def to_dict(self) -> dict[str, Any]:
        """Return findings.json's content."""
        lasts = _READING if self.motion.rate is None else 1.0 / self.motion.rate
        return {
            "format": 2,
            "verdict": self.verdict,
            "model_verdict": self.model_verdict or None,
            "misplaced_payload": self.misplaced or None,
            "cannot_judge": list(self.cannot_judge),
            "findings": [
                {**finding.to_dict(), "next": self.separating(finding) or None}
                for finding in self.findings
            ],
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
            "detectable": self._detectable(),
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
                    "suspected": ambiguity.suspected,
                    "next": self.separating(ambiguity) or None,
                }
                for ambiguity in self.ambiguities
            ],
            "known_payload": self.payload_check and self.payload_check.to_dict(),
            "notes": list(self.notes),
            "simulation": self.in_simulation and self.in_simulation.to_dict(),
            "next": self.separated_by or None,
            "unseparated": {
                "model": self.files.model or None,
                "recordings": list(self.files.recordings),
                "joints": list(self.model.arm.joint_names),
                "poses": self.motion.static,
                "lasted": len(self.motion.q) * lasts,
                "groups": [[each.to_dict() for each in group] for group in self.unresolved],
            },
        }

    def _detectable(self) -> dict[str, Any]:
        """Return sizes by effect, of joints by joint and effect; ``None``: none would be found."""
        result: dict[str, Any] = {}
        for each in self.detectable:
            of = result.setdefault(each.joint, {}) if each.joint else result
            of[each.effect] = _number(each.size)
        return result

    def to_json(self) -> str:
        """Return findings.json's text."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def by_joint(names: Sequence[str], values: Array) -> dict[str, float]:
    """Return (n,) values by joint name."""
    return dict(zip(names, values.tolist(), strict=True))
