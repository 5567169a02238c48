"""A hypothesis as it was fitted: what findings.json holds of causes that data cannot separate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.results.hypothesis_file import (
    as_read,
    given,
    is_plain,
    kind_of,
    written,
)
from dvrk_gravity.effects import Hypothesis, Kind, Motion, Site
from dvrk_gravity.errors import ConfigError

UNREADABLE_CAUSE = "a cause as `diagnose` of this version writes it"


@dataclass(frozen=True, eq=False)
class FittedHypothesis:
    """An explanation that another one stands beside, as it was fitted in that one's place.

    Attributes:
        hypothesis: The claim.
        theta: (k,) its parameters.
        covariance: (k, k) of them.
        evidence: Log-likelihood that it gains, over how many samples count as one: odds of 20 to
            one are 3.0. Only differences count.
        rejected: It explains these recordings worse than the best. It may stand in the place of the
            true one when further ones are explained, but is not expected to be that.
    """

    hypothesis: Hypothesis
    theta: Array
    covariance: Array
    evidence: float = 0.0
    rejected: bool = False

    @classmethod
    def of(
        cls,
        validation: CrossValidation,
        rest: Sequence[Candidate],
        candidate: Candidate,
        evidence: float = 0.0,
        rejected: bool = False,
    ) -> FittedHypothesis:
        """Return a candidate as it fits beside the rest, with what is known of it.

        The covariance is that of blocks and of the known error, and that of the posterior: along
        what the recording does not determine blocks agree, for the prior holds them.
        """
        together = [*rest, candidate]
        theta, covariance = validation.fit(together)
        covariance = covariance + validation.posterior(together)[1][-len(theta) :, -len(theta) :]
        own = slice(len(theta) - candidate.size, None)
        return cls(candidate.hypothesis, theta[own], covariance[own, own], evidence, rejected)

    @property
    def words(self) -> str:
        """Effect and where."""
        hypothesis = self.hypothesis
        at_link = hypothesis.site.kind is Kind.LINK or not hypothesis.names
        where = hypothesis.site.words(hypothesis.arm)
        return f"{hypothesis.effect} at {where if at_link else ' and '.join(hypothesis.names)}"

    @property
    def named(self) -> tuple[str, tuple[int, ...]]:
        """Effect and joints, by which findings name it."""
        return self.hypothesis.effect, self.hypothesis.joints

    @property
    def known_elsewhere(self) -> bool:
        """Whether its torque is known in other motions, and its record holds all of it."""
        sized = np.isfinite(self.theta).all() and np.isfinite(self.covariance).all()
        plain = all(is_plain(value) for _, value in given(self.hypothesis))
        return bool(sized and plain and not self.hypothesis.refits_model)

    def columns(self, motion: Motion) -> Array:
        """Return its (N, n, k) torque by parameter in another motion, N·m.

        What happened once is not expected again.
        """
        if self.hypothesis.transient:
            return np.zeros((*motion.q.shape, len(self.theta)))
        return self.hypothesis.extrapolated.regressor(motion)

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        site = self.hypothesis.site
        return {
            "effect": self.hypothesis.effect,
            "joints": list(self.hypothesis.names),
            "hypothesis": type(self.hypothesis).__name__,
            "site": {"kind": site.kind.value, "index": site.index},
            "given": {name: written(value) for name, value in given(self.hypothesis)},
            "theta": self.theta.tolist(),
            "covariance": self.covariance.tolist(),
            "evidence": self.evidence,
            "rejected": self.rejected,
        }

    @classmethod
    def from_dict(cls, entry: Any, arm: Arm, where: str) -> FittedHypothesis:
        """Read it.

        Raises:
            ConfigError: Naming the entry.
        """
        try:
            kind = kind_of(entry["effect"], entry["hypothesis"])
            site = Site(Kind(entry["site"]["kind"]), int(entry["site"]["index"]))
            # Traits of its class that files of an earlier version state as well.
            known = {each.name for each in fields(kind)}
            given = {
                name: as_read(value) for name, value in entry["given"].items() if name in known
            }
            theta, covariance = (np.array(entry[name], float) for name in ("theta", "covariance"))
            if theta.ndim != 1 or covariance.shape != (len(theta),) * 2:
                raise ValueError("covariance")
            if not (np.isfinite(theta).all() and np.isfinite(covariance).all()):
                raise ValueError("theta or covariance is not finite")
            evidence = float(entry["evidence"])
            if not np.isfinite(evidence):
                raise ValueError("evidence is not finite")
            hypothesis = kind(arm=arm, site=site, **given)
            found = cls(hypothesis, theta, covariance, evidence, bool(entry.get("rejected")))
            found.words  # noqa: B018  (fails where its joints or its place are not the arm's)
            return found
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise ConfigError(where, str(error), UNREADABLE_CAUSE) from error
