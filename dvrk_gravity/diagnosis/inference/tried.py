"""How many torques the best of them was chosen from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from dvrk_gravity.diagnosis.data.candidate import Candidate


@dataclass(frozen=True)
class Tried:
    """How many torques were tried, for Bonferroni's correction.

    A search tries hundreds for one cause. Half of the chance of an error is theirs, half that of
    hypotheses that need no search, so that neither kind pays for the other.

    Attributes:
        alone: Hypotheses without a search.
        searched: Torques of those that are searched for.
    """

    alone: int
    searched: int

    @classmethod
    def of(cls, pool: Sequence[Candidate]) -> Tried:
        """Return how many hypotheses stand for, whether or not their search is over."""
        found = Counter(candidate.hypothesis.key for candidate in pool)
        stands_for = {each.hypothesis.key: each.hypothesis.n_comparisons for each in pool}
        alone = sum(count for key, count in found.items() if stands_for[key] == 1)
        searched = sum(
            max(count, stands_for[key]) for key, count in found.items() if stands_for[key] > 1
        )
        return cls(alone, searched)

    def with_those_of(self, pool: Sequence[Candidate]) -> Tried:
        """Return the greater of these and those of another pool."""
        other = Tried.of(pool)
        return Tried(max(self.alone, other.alone), max(self.searched, other.searched))

    def beside(self, candidate: Candidate) -> int:
        """Return of how many torques one is the best, of either kind."""
        of_its_kind = self.searched if candidate.hypothesis.n_comparisons > 1 else self.alone
        return 2 * max(of_its_kind, candidate.hypothesis.n_comparisons)
