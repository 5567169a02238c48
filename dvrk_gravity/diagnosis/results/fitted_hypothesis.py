"""A hypothesis as it was fitted: what findings.json holds of causes that data cannot separate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.effects import Estimate, Hypothesis, Kind, Motion, Site
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.estimation import NORMAL_95

_DRAWS = 400  # of parameters, for intervals of what is derived from them: ten lie beyond either end
_WIDEST = 100.0  # times a positive setting: as wide an interval says that nothing is known. Chosen
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
        plain = all(_is_plain(value) for _, value in _given(self.hypothesis))
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
            "given": {name: _written(value) for name, value in _given(self.hypothesis)},
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
            kind = _kind_of(entry["effect"], entry["hypothesis"])
            site = Site(Kind(entry["site"]["kind"]), int(entry["site"]["index"]))
            # Traits of its class that files of an earlier version state as well.
            known = {each.name for each in fields(kind)}
            given = {
                name: _as_read(value) for name, value in entry["given"].items() if name in known
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
            got = entry.get("effect") if isinstance(entry, Mapping) else entry
            raise ConfigError(where, got, f"{UNREADABLE_CAUSE} ({error})") from error


def _given(hypothesis: Hypothesis) -> Iterator[tuple[str, Any]]:
    """Yield names and values of what differs from a hypothesis' defaults, but for arm and site."""
    for each in fields(hypothesis):
        value = getattr(hypothesis, each.name)
        made = each.default_factory
        default = each.default if made is MISSING else made()
        array = isinstance(value, np.ndarray)
        if each.name not in ("arm", "site") and (array or value != default):
            yield each.name, value


def _is_plain(value: Any) -> bool:
    """Return whether a file can hold a value."""
    if isinstance(value, Mapping):
        return all(isinstance(name, str) and _is_plain(each) for name, each in value.items())
    if isinstance(value, tuple | list):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, str | bool | int | float | np.generic | np.ndarray)


def _written(value: Any) -> Any:
    """Return a plain value as JSON holds it."""
    if isinstance(value, np.ndarray):
        return {"array": value.tolist()}
    if isinstance(value, Mapping):
        return {"mapping": {name: _written(each) for name, each in value.items()}}
    if isinstance(value, tuple | list):
        return [_written(each) for each in value]
    plain = value.item() if isinstance(value, np.generic) else value
    # JSON has no infinity, which is the standard deviation of a parameter without a prior.
    infinite = isinstance(plain, float) and not np.isfinite(plain)
    return {"number": str(plain)} if infinite else plain


def _as_read(value: Any) -> Any:
    """Return the value that JSON holds."""
    if isinstance(value, list):
        return tuple(map(_as_read, value))
    if isinstance(value, dict):
        ((kind, content),) = value.items()
        if kind == "array":
            return np.array(content, dtype=float)
        if kind == "number":
            return float(content)
        return {name: _as_read(each) for name, each in content.items()}
    return value


def _kind_of(effect: str, name: str) -> type[Hypothesis]:
    """Return the class of an effect's hypotheses with a name.

    Raises:
        ValueError: There is none.
    """
    of = effects.named(effect)  # an installed one is loaded by that
    pending: list[type[Hypothesis]] = Hypothesis.__subclasses__()
    while pending:
        kind = pending.pop()
        pending += kind.__subclasses__()
        if kind.__name__ == name and getattr(kind, "EFFECT", None) is of:
            return kind
    raise ValueError(f"{name} of {effect}")


def estimates(
    hypothesis: Hypothesis, theta: Array, covariance: Array, spread: Mapping[str, float]
) -> dict[str, Estimate]:
    """Return the named parameters with 95 % intervals.

    Args:
        hypothesis: The hypothesis.
        theta: (k,) linear parameters.
        covariance: (k, k) of them.
        spread: Standard deviations of the settings that were searched for.
    """
    random = np.random.default_rng(0)
    drawn = random.multivariate_normal(theta, covariance, _DRAWS, method="eigh")
    middle = hypothesis.parameters(theta)
    draws = [hypothesis.parameters(draw) for draw in drawn]
    result = {}
    for name, value in middle.items():
        if not hypothesis.meaning(name).reported:
            continue
        if name in spread and name in hypothesis.refine:
            low, high = _interval(value, spread[name], hypothesis.meaning(name).positive)
        else:
            low, high = np.percentile([draw[name] for draw in draws], [2.5, 97.5])
        unit = hypothesis.unit(name)
        result[name] = Estimate(value, float(min(low, value)), float(max(high, value)), unit)
    return result


def _interval(value: float, spread: float, positive: bool) -> tuple[float, float]:
    """Return the 95 % interval of a setting with a standard deviation.

    That of a positive one is even in its logarithm (Meeker and Escobar 1998, Statistical Methods
    for Reliability Data, chapter 7): no time constant is below zero.
    """
    if positive and value > 0.0:
        factor = math.exp(min(NORMAL_95 * spread / value, math.log(_WIDEST)))
        return value / factor, value * factor
    return value - NORMAL_95 * spread, value + NORMAL_95 * spread
