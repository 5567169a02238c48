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


@dataclass(frozen=True)
class SearchSettings:
    """Course of a selection.

    Attributes:
        most_steps: Steps taken at most: a bound on time.
        lazy: After a step only moves that were worth it are tried again, the best one first, until
            its worth is this part of the next one's; ``None``: all are tried again after each step.
            Exact where worth can only fall (Minoux 1978).
    """

    most_steps: int
    lazy: float | None = None


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
    settings: SearchSettings,
    key: Callable[[Move], object] = lambda move: move,
    progress: Callable[[int], None] = lambda steps: None,
) -> tuple[State, list[Found]]:
    """Take one move after another for as long as one passes.

    Args:
        search: Moves and their scores.
        state: To start with.
        settings: Bounds of the search.
        key: Identity of a move in another state.
        progress: Called with the number of steps taken.

    Returns:
        The last state, and the trials there that failed.
    """
    steps = 0
    while True:
        progress(steps)
        trials = list(search.attempt(state, list(search.moves(state))))
        best = search.choose(trials) if steps < settings.most_steps else None
        if best is None:
            return state, trials
        if settings.lazy is None:
            state = search.take(state, best)
            steps += 1
            continue
        waiting = {key(trial.move): trial.worth for trial in trials if trial.passes}
        before, vain = steps, list[Found]()
        while waiting and steps < settings.most_steps:
            which = max(waiting, key=waiting.__getitem__)
            move = next((m for m in search.moves(state) if key(m) == which), None)
            del waiting[which]
            if move is None:
                continue
            (trial,) = search.attempt(state, [move])
            if not trial.passes:
                vain.append(trial)
                continue
            if trial.worth < settings.lazy * max(waiting.values(), default=-float("inf")):
                waiting[which] = trial.worth
                continue
            state = search.take(state, trial)
            steps += 1
            progress(steps)
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
