"""Rival causes as a plan needs them: their torque in any motion, and what was found of each."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.alternatives import CONTAINED
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.significance import SignificanceSettings
from dvrk_gravity.diagnosis.results.hypothesis_file import (
    as_read,
    given,
    is_plain,
    kind_of,
    written,
)
from dvrk_gravity.effects import Hypothesis, Kind, Motion, Site, State
from dvrk_gravity.errors import ConfigError, PlanError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import PlanLimits, PoseSettings, Rival, Rivalry, Unseparated, noise_of

EXPECTED = "a cause as `diagnose` of this version writes it"
_SLOW = 0.05  # rad/s, a tenth in m: a step at each reversal has no slope. As `plan` has it
_NOISE_TIME = 0.1  # s, correlation time of noise where no model states one: as `plan` has it
_AGAIN = 400  # samples of the diagnosed motion at which it is compared with a plan: a bound on time
_Named = tuple[str, tuple[int, ...]]  # effect and joints
_Beside = tuple[_Named, _Named]  # a cause that is true, and one beside it
_STATES = 200  # at which the torques of two causes are compared: far more than parameters


class PlannedMotion(MeasuredMotion):
    """States that a plan passes: nothing was measured there."""

    def slowest(self, row: Array) -> float:
        """Return the speed below which the direction of a row of joints is uncertain, rad/s."""
        return _SLOW * self._scale(row)

    @classmethod
    def of(cls, model: TorqueModel, state: State, time: Array) -> PlannedMotion:
        """Return (N, n) states at (M,) times, s: N / M motions, or poses with a direction."""
        none, count = np.zeros_like(state.q), len(time)
        copies = len(state.q) // count
        qd = none if state.qd is None else state.qd
        static = state.direction is not None
        rate = None if static or count < 2 else (count - 1) / float(time[-1] - time[0] or 1.0)
        return cls(
            model=model, q=state.q, qd=qd, qdd=none if state.qdd is None else state.qdd,
            effort=none, direction=state.direction, time=np.tile(time, copies),
            parts=tuple(slice(k * count, (k + 1) * count) for k in range(copies)), rate=rate,
            present=np.ones(model.arm.n, dtype=bool), step=np.zeros(model.arm.n),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class RivalCause:
    """An explanation that another one stands beside.

    Attributes:
        hypothesis: The claim.
        theta: (k,) its parameters, fitted in the other's place.
        covariance: (k, k) of them.
        evidence: Log-likelihood that it gains here, over how many samples count as one.
        rejected: It explains these recordings worse than the best. It may stand in the place of the
            true one when further ones are explained, but is not expected to be that.
    """

    hypothesis: Hypothesis
    theta: Array
    covariance: Array
    evidence: float = 0.0
    rejected: bool = False

    @classmethod
    def fitted(
        cls,
        validation: CrossValidation,
        rest: Sequence[Candidate],
        candidate: Candidate,
        evidence: float = 0.0,
        rejected: bool = False,
    ) -> RivalCause:
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
    def listed(self) -> str:
        """Effect and joints, as findings list it: all forms at one joint are one."""
        return f"{self.hypothesis.effect} at {' and '.join(self.hypothesis.names) or 'the arm'}"

    @property
    def named(self) -> _Named:
        """Effect and joints, by which findings name it."""
        return self.hypothesis.effect, self.hypothesis.joints

    @property
    def known_elsewhere(self) -> bool:
        """Whether its torque is known in other motions, and its record holds all of it."""
        sized = np.isfinite(self.theta).all() and np.isfinite(self.covariance).all()
        plain = all(is_plain(value) for _, value in given(self.hypothesis))
        return bool(sized and plain and not self.hypothesis.refits_model)

    def rival(self, seen: Motion | None = None, rows: Array | slice = slice(None)) -> Rival:
        """Return it as a plan needs it, or as it acts at some rows of a motion that was seen."""

        def columns(motion: Motion) -> Array:
            if self.hypothesis.transient:  # it happened once
                return np.zeros((*motion.q.shape, len(self.theta)))
            # Friction depends on the path, and on which speeds exceed noise.
            if seen is not None:
                return self.hypothesis.regressor(seen)[rows]
            return self.hypothesis.beyond.regressor(motion)

        return Rival(self.words, columns, self.theta, self.covariance, self.evidence)

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
        }

    @classmethod
    def from_dict(cls, entry: Any, arm: Arm, where: str) -> RivalCause:
        """Read it.

        Raises:
            ConfigError: Naming the entry.
        """
        try:
            kind = kind_of(entry["effect"], entry["hypothesis"])
            site = Site(Kind(entry["site"]["kind"]), int(entry["site"]["index"]))
            given = {name: as_read(value) for name, value in entry["given"].items()}
            theta, covariance = (np.array(entry[name], float) for name in ("theta", "covariance"))
            if theta.ndim != 1 or covariance.shape != (len(theta),) * 2:
                raise ValueError("covariance")
            if not (np.isfinite(theta).all() and np.isfinite(covariance).all()):
                raise ValueError("theta or covariance is not finite")
            evidence = float(entry["evidence"])
            if not np.isfinite(evidence):
                raise ValueError("evidence is not finite")
            found = cls(kind(arm=arm, site=site, **given), theta, covariance, evidence)
            found.words  # noqa: B018  (fails where its joints or its place are not the arm's)
            return found
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise ConfigError(where, str(error), EXPECTED) from error


@dataclass(frozen=True, eq=False)
class RivalCauses:
    """Two causes that recordings cannot separate.

    Attributes:
        first: One.
        second: The other.
        either: Whether the first, and whether the second, is to be shown if it is true.
    """

    first: RivalCause
    second: RivalCause
    either: tuple[bool, bool] = (True, True)

    @classmethod
    def of(cls, model: TorqueModel, first: RivalCause, second: RivalCause) -> RivalCauses:
        """Return a pair.

        If a cause is true that another one at the same place contains, a diagnosis takes it as the
        simpler one: nothing is to be shown.
        """
        both = first, second
        either = [
            not (each.rejected or _contains(model, other, each))
            for each, other in zip(both, both[::-1], strict=True)
        ]
        return cls(first, second, (either[0], either[1]))


@dataclass(frozen=True, eq=False)
class Contest:
    """All pairs of causes that recordings could not separate, and how well torques are known.

    Attributes:
        model: The model that was diagnosed.
        pairs: The pairs; none: all is clear.
        noise: (n,) variance of the mean torque of a second, (N·m)^2 s.
        coherent: (n,) N·m, see :class:`Unseparated`.
        poses: Static poses were diagnosed.
        lasted: How long what was diagnosed lasts, s.
        again: Of each pair the evidence that the same motion would be expected to give.
    """

    model: TorqueModel
    pairs: tuple[RivalCauses, ...]
    noise: Array
    coherent: Array
    poses: bool
    lasted: float
    again: tuple[float, ...] = ()

    @classmethod
    def of(
        cls, motion: MeasuredMotion, several: Sequence[Sequence[RivalCause]], left: Array
    ) -> Contest:
        """Return the pairs of which a plan knows the torques.

        Args:
            motion: What was diagnosed.
            several: Causes of which one is there, each time. Any two are a pair, for any may be the
                true one; but not two of the same name in findings, or where none is to be shown.
            left: (n,) RMS error that the findings leave, N·m.
        """
        if motion.reference is not None:  # torques are known only where they were measured
            several = ()
        known = motion.model.uncertainty
        pairs = tuple(
            pair
            for rivals in several
            for first, second in combinations([each for each in rivals if each.known_elsewhere], 2)
            if first.named != second.named
            if any((pair := RivalCauses.of(motion.model, first, second)).either)
        )
        if known is None:
            noise, coherent = left**2 * _NOISE_TIME, np.zeros(motion.arm.n)
            noise = np.where(np.isfinite(noise) & (noise > 0.0), noise, noise_of(motion.arm))
        else:  # where findings leave more than that, nothing says that less would remain elsewhere
            known = replace(known, error=np.fmax(known.error, left))
            noise = noise_of(motion.arm, known)
            coherent = SignificanceSettings().coherent * np.nan_to_num(known.error)
        lasted = PoseSettings().reading * len(motion.q)
        if motion.rate is not None:
            lasted = len(motion.q) / motion.rate
        contest = cls(motion.model, pairs, noise, coherent, motion.static, lasted)
        return replace(contest, again=contest._again(motion))

    @cached_property
    def _wanted(self) -> tuple[frozenset[_Beside], frozenset[_Beside]]:
        """Which cause a plan may show if it is true, beside which other, and which no motion does.

        Of the likeliest form of each. Where the arm's limits are not known, a motion may show any.
        """
        likeliest = dict[_Named, RivalCause]()
        for rival in (each for pair in self.pairs for each in (pair.first, pair.second)):
            best = likeliest.get(rival.named)
            if not rival.rejected and (best is None or rival.evidence > best.evidence):
                likeliest[rival.named] = rival
        none = [(False, False)] * len(self.pairs)
        if self.pairs:
            with suppress(ConfigError, PlanError):
                none = self.unseparated().hidden(PlanLimits.of(self.model.arm))
        senses = {True: set[_Beside](), False: set[_Beside]()}
        for pair, hidden in zip(self.pairs, none, strict=True):
            both = pair.first, pair.second
            for i in (0, 1):
                true, other = both[i], both[1 - i]
                if pair.either[i] and likeliest[true.named] is true:
                    senses[hidden[i]].add((true.named, other.named))
        return frozenset(senses[False] - senses[True]), frozenset(senses[True])

    @property
    def hidden(self) -> frozenset[_Beside]:
        """Effect and joints of causes that no motion of the arm within its limits shows.

        Each with that of the other one that can do there all that it does.
        """
        return self._wanted[1]

    def may_separate(self, rivals: Sequence[RivalCause]) -> bool:
        """Return whether a motion may separate some causes."""
        names = {each.named for each in rivals}
        return any(set(beside) <= names for beside in self._wanted[0])

    def inseparable(self, rivals: Sequence[RivalCause]) -> str:
        """Return which of some causes no motion separates from which; ``""``: from none."""
        names = dict[_Named, str]()
        for rival in rivals:
            names.setdefault(rival.named, rival.listed)
        never = {named: [other for other in names if (named, other) in self.hidden]
                 for named in names}  # fmt: skip
        beside = {other for others in never.values() for other in others}
        concerned = [named for named in names if never[named] or named in beside]
        if not concerned:
            return ""
        within = "no motion of this arm within its limits is expected to"
        if all(len(never[named]) == len(concerned) - 1 for named in concerned):
            *most, last = (names[named] for named in concerned)
            return f"{within} separate {', '.join(most)} and {last}"
        ruled_out = (
            f"{' or '.join(names[other] for other in never[named])}, if it is {names[named]}"
            for named in concerned
            if never[named]
        )
        return f"{within} rule out {'; '.join(ruled_out)}"

    def _again(self, motion: MeasuredMotion) -> tuple[float, ...]:
        if not self.pairs:
            return ()
        some = np.unique(np.linspace(0, len(motion.q) - 1, _AGAIN).astype(int))
        objective = self.unseparated(motion, some).objective(self.lasted)
        state = State(motion.q, motion.qd, motion.qdd, motion.direction).rows(some)
        weight = np.full(len(some), self.lasted / len(some))
        gram = objective.over(motion.time[some]).gram(state, weight)
        return tuple(value for value, _ in objective.expected(gram))

    def unseparated(
        self, seen: Motion | None = None, rows: Array | slice = slice(None)
    ) -> Unseparated:
        """Return it as a plan needs it, or at some rows of a motion that was seen."""
        again = self.again or (None,) * len(self.pairs)
        rivals = {
            id(each): each.rival(seen, rows)
            for pair in self.pairs
            for each in (pair.first, pair.second)
        }  # one that stands beside several has its columns once
        rivalries = tuple(
            Rivalry(rivals[id(pair.first)], rivals[id(pair.second)], value, pair.either)
            for pair, value in zip(self.pairs, again, strict=True)
        )
        passing = partial(PlannedMotion.of, self.model)
        return Unseparated(
            self.model, rivalries, passing, self.noise, self.coherent, self.poses, self.lasted
        )

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        return {
            "joints": list(self.model.arm.joint_names),
            "noise": self.noise.tolist(),
            "coherent": self.coherent.tolist(),
            "poses": self.poses,
            "lasted": self.lasted,
            "pairs": [
                {
                    "between": [pair.first.to_dict(), pair.second.to_dict()],
                    "either": list(pair.either),
                    "again": again,
                }
                for pair, again in zip(self.pairs, self.again, strict=True)
            ],
        }


def _contains(model: TorqueModel, larger: RivalCause, smaller: RivalCause) -> bool:
    """Return whether the torque of a cause is one of a larger one's at the same place, anywhere."""
    if larger.hypothesis.site != smaller.hypothesis.site or len(larger.theta) <= len(smaller.theta):
        return False
    arm, random = model.arm, np.random.default_rng(0)
    lower, upper = np.clip(arm.range, -np.pi, np.pi)
    q = random.uniform(lower, upper, (_STATES, arm.n))
    qd, qdd = random.normal(size=(2, _STATES, arm.n)) * arm.scale
    motion = PlannedMotion.of(model, State(q, qd, qdd), np.arange(float(_STATES)))
    columns = larger.rival().columns(motion).reshape(-1, len(larger.theta))
    torque = (smaller.rival().columns(motion) @ smaller.theta).ravel()
    left = torque - columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]
    return bool(left @ left <= CONTAINED * (torque @ torque))
