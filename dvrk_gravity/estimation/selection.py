"""Forward selection with backward elimination, of whatever a search scores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from dvrk_gravity.arrays import Array, Mask

State = TypeVar("State")
Move = TypeVar("Move")
T = TypeVar("T")
Found = TypeVar("Found", bound="Trial[Any]")

STANDARD_ERRORS = 1.0
"""So many standard errors of the folds' gains a change must gain: the rule of one standard error
(Breiman, Friedman, Olshen and Stone 1984), as luck on one fold is no reason."""


@dataclass(frozen=True, eq=False)
class Trial(Generic[Move]):
    """Score of a move.

    Attributes:
        move: The move.
        worth: Larger is better.
        passes: Whether it may be taken.
    """

    move: Move
    worth: float
    passes: bool


@dataclass(frozen=True, eq=False)
class Scored(Generic[T]):
    """What was chosen, and its held-out error.

    Attributes:
        choice: The choice.
        errors: (folds, m) weighted sums of squared errors.
    """

    choice: T
    errors: Array


@dataclass(frozen=True, eq=False)
class ScoredTrial(Trial[Move], Generic[Move, T]):
    """Score of a move by held-out error.

    Attributes:
        after: What is chosen with it.
        gain: Part of the squared error that it removes, in the mean over channels.
        deviation: Standard error of the gain over the folds.
    """

    after: Scored[T]
    gain: float
    deviation: float


def relative_gain(before: Array, after: Array) -> tuple[float, float]:
    """Return the mean relative gain of (folds, m) held-out errors, and its standard error.

    Every channel's error counts relative to its value before, so that small ones weigh as much as
    large ones.
    """
    counted = max(1, int(np.count_nonzero(before.any(axis=0))))
    gain = removed_part(before, after).sum(axis=1) / counted
    return float(gain.sum()), float(np.std(gain, ddof=1) * np.sqrt(len(gain)))


def removed_part(before: Array, after: Array) -> Array:
    """Return (folds, m) the part of each channel's held-out error that is removed in a fold."""
    power = before.sum(axis=0)
    return np.asarray((before - after) / np.where(power > 0.0, power, 1.0))


class Search(Protocol[State, Move, Found]):
    """The choices of a selection."""

    def moves(self, state: State) -> Iterable[Move]:
        """Yield every change of a state that is worth a try, once each."""

    def attempt(self, state: State, moves: Sequence[Move]) -> Sequence[Found]:
        """Return the scores of moves, perhaps of the promising ones only."""

    def choose(self, trials: Sequence[Found]) -> Found | None:
        """Return the trial to take, ``None`` to stop."""

    def take(self, state: State, trial: Found) -> State:
        """Return the state after a move, with redundant items eliminated."""


def select(
    search: Search[State, Move, Found],
    state: State,
    most_steps: int,
    lazy: float | None = None,
    key: Callable[[Move], object] = lambda move: move,
) -> tuple[State, list[Found]]:
    """Take one move after another for as long as one passes.

    Args:
        search: Moves and their scores.
        state: To start with.
        most_steps: Steps taken at most: a bound on time.
        lazy: After a step only moves that were worth it are tried again, the best one first, until
            its worth is this part of the next one's; ``None``: all are tried again after each step.
            Exact where worth can only fall (Minoux 1978).
        key: Identity of a move in another state.

    Returns:
        The last state, and the trials there that failed.
    """
    steps = 0
    while True:
        trials = list(search.attempt(state, list(search.moves(state))))
        best = search.choose(trials) if steps < most_steps else None
        if best is None:
            return state, trials
        if lazy is None:
            state = search.take(state, best)
            steps += 1
            continue
        waiting = {key(trial.move): trial.worth for trial in trials if trial.passes}
        before, vain = steps, list[Found]()
        while waiting and steps < most_steps:
            which = max(waiting, key=waiting.__getitem__)
            move = next((m for m in search.moves(state) if key(m) == which), None)
            del waiting[which]
            if move is None:
                continue
            (trial,) = search.attempt(state, [move])
            if not trial.passes:
                vain.append(trial)
                continue
            if trial.worth < lazy * max(waiting.values(), default=-float("inf")):
                waiting[which] = trial.worth
                continue
            state = search.take(state, trial)
            steps += 1
        if steps == before:  # tried again, none of them passed
            failed = [trial for trial in trials if not trial.passes]
            return state, [*failed, *vain]


def eliminate_backward(
    kept: Sequence[T],
    failing: Callable[[list[T]], Sequence[tuple[float, T]]],
    note: Callable[[T], None] = lambda gone: None,
) -> list[T]:
    """Drop the weakest of the failing items until none fails: others may take its place.

    Args:
        kept: To begin with.
        failing: Returns worth and item of those that fail beside the others.
        note: Called with each dropped item.
    """
    kept = list(kept)
    while kept:
        found = failing(kept)
        if not found:
            break
        weakest = min(found, key=lambda pair: pair[0])[1]
        note(weakest)
        kept = [item for item in kept if item is not weakest]
    return kept


def beats(error: Array, constant: Array, deviations: float = 1.64, blocks: int = 20) -> Mask:
    """Return (n,) whether squared errors are significantly less than those of a constant.

    Args:
        error: (N, n) squared errors of predictions.
        constant: (N, n) squared errors of a constant.
        deviations: Standard errors of the share removed. Chosen: 95 % of constants are not better.
        blocks: Consecutive blocks whose sums give the standard error, as errors within one are
            correlated. Chosen.
    """
    parts = [rows for rows in np.array_split(np.arange(len(error)), blocks) if len(rows)]
    removed = np.array([(constant[rows] - error[rows]).sum(axis=0) for rows in parts])
    share = removed.sum(axis=0) / np.maximum(constant.sum(axis=0), 1e-300)
    by_block = np.array([constant[rows].sum(axis=0) for rows in parts])
    spread = np.sqrt(((removed - share * by_block) ** 2).sum(axis=0))  # of a ratio of sums
    return np.asarray(removed.sum(axis=0) > deviations * spread)
