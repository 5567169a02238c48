"""Forward selection with backward pruning, swaps, and what could stand in each one's place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.diagnosis.candidate import Candidate, Score
from dvrk_gravity.diagnosis.contest import Contest, readiest, readiness
from dvrk_gravity.effects.effect import Hypothesis
from dvrk_gravity.effects.evidence import Residual

Array = NDArray[np.float64]
Report = Callable[[str], None]

ALPHA = 0.01  # after correction for the number of hypotheses
LEAST_GAIN = 0.06  # of a joint's error, that a finding must remove
MOST_EFFECTS = 18
_FEW = 4
_SCREENED = 24
_REFINED = 6
_CLOSE = 0.15  # of the best gain: worth refining
_EQUAL = 0.02  # of the best gain: as good as the best
_EQUAL_LEAST = 5.0
_OVERLAP = 0.5  # part of a torque that another must reproduce to stand in its place


@dataclass(frozen=True, eq=False)
class Tried:
    """A hypothesis and how it did beside those that were accepted at the time.

    Attributes:
        candidate: The hypothesis with its columns.
        score: Score of the set with it.
        gain: Log-likelihood over the set without it, its cost taken off.
        p_value: Paired block test, corrected for the number of hypotheses.
        removed: Largest part of a joint's error that it removes.
        plausible: Whether its parameters are such as it can have.
    """

    candidate: Candidate
    score: Score
    gain: float
    p_value: float
    removed: float
    plausible: bool

    @property
    def passes(self) -> bool:
        """Whether it is significant and worth having."""
        worth = self.gain > 0.0 and self.removed > LEAST_GAIN
        return worth and self.plausible and self.p_value < ALPHA


@dataclass(frozen=True, eq=False)
class Accepted:
    """An accepted hypothesis with those that could stand in its place.

    Attributes:
        tried: How it did beside all other accepted ones.
        alternatives: Others in its place, best first, that the data does not tell from it.
        rejected: Others in its place, best first, that are worse.
    """

    tried: Tried
    alternatives: tuple[Tried, ...]
    rejected: tuple[Tried, ...]


class Selection:
    """Chooses among a pool of hypotheses.

    Attributes:
        contest: Scores.
        pool: The candidates that need no search.
        count: How many hypotheses are tried at each step.
    """

    def __init__(
        self,
        contest: Contest,
        pool: Sequence[Candidate],
        report: Report,
        always: Sequence[Candidate] = (),
    ) -> None:
        """Start with nothing accepted but what always moves along.

        Args:
            contest: Scores.
            pool: The candidates that need no search.
            report: Called with a line about every choice.
            always: Parameters of the model itself that are fitted anew beside every hypothesis.
        """
        self.contest = contest
        self._always = list(always)
        self.pool = list(pool)
        self.count = len(pool) + 40
        self._excluded: set[tuple[object, ...]] = set()
        self._report = report

    def exclude(self, hypotheses: Iterable[Hypothesis]) -> None:
        """Take hypotheses out of the choice from now on."""
        self._excluded |= {one.key for one in hypotheses}

    def run(self, start: Sequence[Candidate] | None = None) -> list[Candidate]:
        """Select until nothing more passes.

        Args:
            start: What is accepted to begin with; by default what always moves along.
        """
        accepted = list(self._always if start is None else start)
        while len(accepted) < MOST_EFFECTS + len(self._always):
            best = self._step(accepted)
            if best is None:
                break
            self._report(f"accepted: {best.hypothesis}")
            accepted = self._prune([*accepted, best])
        return accepted

    def explained(self, accepted: Sequence[Candidate]) -> list[Accepted]:
        """Return the accepted hypotheses with those that could stand in their places."""
        return [self._stand_ins(accepted, i) for i in range(len(accepted))]

    def _step(self, accepted: Sequence[Candidate]) -> Candidate | None:
        self.contest.weigh(self.contest.out_of_fold(accepted))
        before = self.contest.score(accepted)
        tried = [one for one in self.best(accepted, before) if one.passes]
        if not tried:
            return None
        return self._choose(tried).candidate

    def _choose(self, tried: Sequence[Tried]) -> Tried:
        best = max(one.gain for one in tried)
        tolerance = max(_EQUAL_LEAST, _EQUAL * best)
        chosen = readiest([(one.gain, one.candidate) for one in tried], tolerance)
        return next(one for one in tried if one.candidate is chosen)

    def best(
        self, accepted: Sequence[Candidate], before: Score, pool: Sequence[Candidate] | None = None
    ) -> list[Tried]:
        """Return the best hypotheses beside the accepted ones, settings refined, best first."""
        contest = self.contest
        if pool is None:
            pool = [*self.pool, *self._searched(accepted)]
        known = {one.hypothesis.key for one in accepted} | self._excluded
        pool = [one for one in pool if one.hypothesis.key not in known]
        screened = contest.screen(accepted, pool, _SCREENED)
        tried = [self.attempt(accepted, one, before) for one in screened]
        if not tried:
            return []
        limit = (1.0 - _CLOSE) * max(one.gain for one in tried)
        tried.sort(key=lambda one: -one.gain)
        result, seen = [], set()
        for one in tried:
            hypothesis = one.candidate.hypothesis
            name = (hypothesis.key, one.candidate.size)
            if name in seen:
                continue
            seen.add(name)
            adjustable = hypothesis.refine or hypothesis.fixed_point
            if adjustable and one.gain >= limit and len(seen) <= _REFINED:
                refined = contest.refined(one.candidate, accepted)
                again = self.attempt(accepted, refined, before)
                one = again if again.gain > one.gain else one
            result.append(one)
        return sorted(result, key=lambda one: -one.gain)

    def attempt(self, accepted: Sequence[Candidate], one: Candidate, before: Score) -> Tried:
        """Return how a candidate does beside the accepted ones."""
        after = self.contest.score([*accepted, one])
        p_value = self.contest.p_value(before, after, one)
        corrected = min(1.0, p_value * self.count * one.hypothesis.searched**0.5)
        removed = self._removed(before, after, one)
        gain = after.likelihood - before.likelihood
        theta = self.contest.parameters([*accepted, one])
        can_be = one.hypothesis.plausible(theta[-one.size :])
        return Tried(one, after, gain, corrected, removed, can_be)

    def _searched(self, accepted: Sequence[Candidate]) -> list[Candidate]:
        """Return the hypotheses that are found in what is left."""
        bench = self.contest.bench
        left = self.contest.left(accepted)
        allowed = bench.fold >= 0
        weight = allowed[:, None] * self.contest.weight**2
        residual = Residual(bench, left, weight, allowed)
        return [
            self.contest.candidate(found)
            for effect, basis in self.contest.search_bases.items()
            for found in effect.search(basis, residual)
        ]

    def _prune(self, accepted: list[Candidate]) -> list[Candidate]:
        while len(accepted) > 1:
            whole = self.contest.score(accepted)
            verdicts = []
            for i, one in enumerate(accepted[:-1]):
                if one in self._always:
                    continue
                rest = [*accepted[:i], *accepted[i + 1 :]]
                without = self.contest.score(rest)
                verdicts.append((self._verdict(without, whole, one), i))
            if not verdicts:
                break
            weakest = min(verdicts, key=lambda pair: pair[0].gain)
            if weakest[0].passes:
                break
            self._report(f"no longer needed: {accepted[weakest[1]].hypothesis}")
            del accepted[weakest[1]]
        return accepted

    def _verdict(self, without: Score, whole: Score, one: Candidate) -> Tried:
        p_value = min(1.0, self.contest.p_value(without, whole, one) * self.count)
        removed = self._removed(without, whole, one)
        return Tried(one, whole, whole.likelihood - without.likelihood, p_value, removed, True)

    def _removed(self, before: Score, after: Score, one: Candidate) -> float:
        """Return the largest part that is gone of the error of a joint that a candidate acts on."""
        used = (self.contest.weight > 0.0) & one.acts
        return float(np.max(1.0 - after.rms[used] / before.rms[used], initial=0.0))

    def confirmed(self, accepted: Sequence[Candidate]) -> list[Candidate]:
        """Return those that are still significant and worth having when all is known.

        The weakest goes first, since others may take its place. Parameters of the model that moved
        along stay if they help to predict what they have not seen.
        """
        kept = list(accepted)
        while kept:
            self.contest.weigh(self.contest.out_of_fold(kept), final=True)
            whole = self.contest.score(kept)
            tests = []
            for one in kept:
                without = self.contest.score([other for other in kept if other is not one])
                verdict = self._verdict(without, whole, one)
                own = one in self._always
                if not (verdict.gain + one.cost > 0.0 if own else verdict.passes):
                    tests.append((verdict.gain, one))
            if not tests:
                break
            weakest = min(tests, key=lambda pair: pair[0])[1]
            self._report(f"not confirmed: {weakest.hypothesis}")
            kept = [one for one in kept if one is not weakest]
        return kept

    def settled(self, accepted: list[Candidate]) -> list[Candidate]:
        """Give every place to the simplest of the best for it, now that the others are known."""
        for i in range(len(accepted)):
            if accepted[i] in self._always:
                continue
            rest = [*accepted[:i], *accepted[i + 1 :]]
            self.contest.weigh(self.contest.out_of_fold(accepted))
            refined = self.contest.refined(accepted[i], rest)
            if self.contest.misfit([*rest, refined]) < self.contest.misfit(accepted):
                accepted[i] = refined
            if len(accepted) == 1:
                continue
            without = self.contest.score(rest)
            mine = self.attempt(rest, accepted[i], without)
            others = [one for one in self.best(rest, without) if one.passes]
            if others:
                best = self._choose([mine, *others])
                margin = max(_EQUAL_LEAST, _EQUAL * best.gain)
                simpler = readiness(best.candidate) < readiness(mine.candidate)
                if simpler or best.gain > mine.gain + margin:
                    self._report(
                        f"{best.candidate.hypothesis} instead of {mine.candidate.hypothesis}"
                    )
                    accepted[i] = best.candidate
        return accepted

    def fewer(self, accepted: list[Candidate]) -> list[Candidate]:
        """Let one hypothesis take the places of two where it explains as well.

        A cause that is named at the wrong joint needs a second one to make up for that. Where many
        causes act, few of them stand for one another, and looking for those takes too long.
        """
        if len(accepted) - len(self._always) > _FEW:
            return accepted
        for i in range(len(accepted)):
            if accepted[i] in self._always or len(accepted) - len(self._always) < 2:
                continue
            rest = [*accepted[:i], *accepted[i + 1 :]]
            self.contest.weigh(self.contest.out_of_fold(accepted))
            whole = self.contest.score(accepted).likelihood
            without = self.contest.score(rest)
            key = accepted[i].hypothesis.key
            others = [
                one.candidate for one in self.best(rest, without)
                if one.passes and one.candidate.hypothesis.key != key
            ]  # fmt: skip
            for other in others[:_REFINED]:
                replaced = [*accepted[:i], other, *accepted[i + 1 :]]
                for two in rest:
                    if two in self._always:
                        continue
                    one_less = [one for one in replaced if one is not two]
                    if self.contest.score(one_less).likelihood >= whole - _EQUAL_LEAST:
                        self._report(
                            f"{other.hypothesis} instead of {accepted[i].hypothesis} "
                            f"and {two.hypothesis}"
                        )
                        return self.fewer(one_less)
        return accepted

    def _stand_ins(self, accepted: Sequence[Candidate], i: int) -> Accepted:
        rest = [*accepted[:i], *accepted[i + 1 :]]
        self.contest.weigh(self.contest.out_of_fold(accepted))
        without = self.contest.score(rest)
        mine = self.attempt(rest, accepted[i], without)
        key = accepted[i].hypothesis.key
        others = [
            one for one in self.best(rest, without)
            if one.candidate.hypothesis.key != key and one.gain > 0.0 and one.plausible
        ]  # fmt: skip
        margin = max(_EQUAL_LEAST, _EQUAL * mine.gain)
        others = [
            one for one in others
            if not self.contest.contains(one.candidate, accepted[i], rest)
            and self.contest.overlap(accepted[i], one.candidate, rest) > _OVERLAP
        ]  # fmt: skip
        alike = tuple(one for one in others if one.gain > mine.gain - margin)
        worse = tuple(one for one in others if one.gain <= mine.gain - margin)
        return Accepted(mine, alike, worse[:8])
