"""Which columns a model has: chosen by the error on held-out blocks, never on those fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dvrk_gravity.effects import SearchMove, is_friction
from dvrk_gravity.estimation import (
    STANDARD_ERRORS,
    Scored,
    ScoredTrial,
    relative_gain,
    removed_part,
    select,
)
from dvrk_gravity.identification.result import Choice, improvement
from dvrk_gravity.identification.trajectories.problem import Problem, with_motor_weights
from dvrk_gravity.model import Columns, term_moves
from dvrk_gravity.observation import Observation, build_design

Moves = Callable[[Columns, set[int]], Iterator[SearchMove]]
MoveTrial = ScoredTrial[SearchMove, list[int]]

TOLERATED_LOSS = 0.25  # part of the least gain that each removed column may cost. Chosen
GAIN_MOVING = 0.5  # part of what another term gains that it must gain elsewhere. Chosen
_STEPS = 60  # a bound on time
_LAZY = 0.9  # see `select`. Chosen: exact greedy search finds the same
# Choices of what depends on the other terms' torque, which change with it. Chosen: a third changes
# nothing on the arms of `make peers`.
_ROUNDS = 3


def choose(
    problem: Problem, begin: Sequence[list[int]], progress: Callable[[float], None]
) -> tuple[Problem, list[int]]:
    """Return the problem, weighted again, and the columns that improve the held-out error.

    The richest model, whose residual weighs motors at first, overfits the noise of some more than
    that of others. So the search goes on with the weights of its own residual (feasible
    generalised least squares).

    Args:
        problem: The problem, weighted by its richest model.
        begin: Columns to start with; at least one set.
        progress: Called with the share that is done, a guess.
    """
    chosen, choices = _best_end(problem, begin, progress)
    kept = [choice for choice in choices if choice.kept]
    problem = with_motor_weights(problem, chosen)
    chosen, choices = search(problem, chosen)
    problem = with_motor_weights(problem, chosen)
    return replace(problem, choices=(*kept, *choices)), chosen


def _best_end(
    problem: Problem, starts: Sequence[list[int]], progress: Callable[[float], None]
) -> tuple[list[int], list[Choice]]:
    """Return the best end of searches from several starts, and the choices that lead there.

    One change at a time does not find effects that help only together; a search that starts
    with all of them does. A later start must beat the first as a change must. Choices noted
    before count as leading to the first.
    """
    best, best_choices = list[int](), list[Choice]()
    for number, start in enumerate(starts):
        progress(number / len(starts))
        found, choices = search(problem, start)
        if number:
            more = max(1, len(found) - len(best))
            gain, error = relative_gain(problem.score(best), problem.score(found))
            if gain <= max(problem.least_gain * more, STANDARD_ERRORS * error):
                continue
        best, best_choices = found, choices if number else [*problem.choices, *choices]
    return best, best_choices


def search(
    problem: Problem, chosen: list[int], moves: Moves = term_moves, lazy: float | None = _LAZY
) -> tuple[list[int], list[Choice]]:
    """Add, exchange and remove columns for as long as that helps on held-out blocks.

    Args:
        problem: The problem.
        chosen: Columns to start with.
        moves: Which changes there are.
        lazy: See :func:`select`.

    Returns:
        The columns, and the choices, kept or not.
    """
    among = _MoveSearch(problem, moves)
    # By what a move does: several may have the same text.
    found, vain = select(
        among, Scored(chosen, problem.score(chosen)), _STEPS, lazy,
        lambda move: (move.add, move.remove),
    )  # fmt: skip
    return found.choice, [*among.taken, *(among.shown(trial, found, False) for trial in vain)]


@dataclass(frozen=True, eq=False)
class _MoveSearch:
    """A search among moves of one kind.

    Attributes:
        problem: The problem.
        generate: The moves.
        taken: Those that were taken, for the report.
    """

    problem: Problem
    generate: Moves
    taken: list[Choice] = field(default_factory=list)

    def moves(self, state: Scored[list[int]]) -> Iterable[SearchMove]:
        """Yield the moves whose columns may be used."""
        columns = self.problem.design.columns
        for move in self.generate(columns, set(state.choice)):
            added = [columns.columns[i] for i in move.add]
            if all(self.problem.allowed(c.effect) and columns.offers(c) for c in added):
                yield move

    def attempt(self, state: Scored[list[int]], moves: Sequence[SearchMove]) -> list[MoveTrial]:
        """Return the results of moves."""
        problem = self.problem
        others = [_apply(state.choice, move) for move in moves]
        if len(others) == 1:
            theta = problem.fold_fits.fit(others[0])[None]
        else:
            theta = problem.fold_fits.fit_near(state.choice, others)
        after = map(Scored, others, problem.sums.held_out.error(theta))
        trials = [self._judged(state, *pair) for pair in zip(moves, after, strict=True)]
        which = [i for i, trial in enumerate(trials) if trial.passes and self._at_speed(trial.move)]
        if which:
            before = problem.held_out_moving.error(problem.fold_fits.fit(state.choice))
            for i, errors in zip(which, problem.held_out_moving.error(theta[which]), strict=True):
                moving, _ = relative_gain(before, errors)
                trials[i] = replace(trials[i], passes=moving > GAIN_MOVING * trials[i].gain)
        return trials

    def choose(self, trials: Sequence[MoveTrial]) -> MoveTrial | None:
        """Return the best of the trials that pass."""
        passing = (trial for trial in trials if trial.passes)
        return max(passing, key=lambda trial: trial.worth, default=None)

    def take(self, state: Scored[list[int]], trial: MoveTrial) -> Scored[list[int]]:
        """Return the columns after a move, and note it."""
        self.taken.append(self.shown(trial, state, True))
        return trial.after

    def _judged(
        self, before: Scored[list[int]], move: SearchMove, after: Scored[list[int]]
    ) -> MoveTrial:
        gain, deviation = relative_gain(before.errors, after.errors)
        if not move.add:  # a smaller model need not gain, only not lose
            worth = gain + TOLERATED_LOSS * self.problem.least_gain * len(move.remove)
            return ScoredTrial(move, worth, worth > 0.0, after, gain, deviation)
        more = max(1, len(move.add) - len(move.remove))
        worth = gain - self.problem.least_gain * more
        passes = worth > max(0.0, STANDARD_ERRORS * deviation)
        return ScoredTrial(move, worth, passes, after, gain, deviation)

    def _at_speed(self, move: SearchMove) -> bool:
        """Whether a move adds what must explain torque not only where friction turns round."""
        columns = self.problem.design.columns.columns
        return any(not is_friction(columns[i].effect) for i in move.add)

    def shown(self, trial: MoveTrial, before: Scored[list[int]], kept: bool) -> Choice:
        """Return a trial for the report, with its error at the joint where it matters most."""
        removed = removed_part(before.errors, trial.after.errors).sum(axis=0)
        joint = int(np.argmax(removed if trial.gain > 0.0 else -removed))
        power = max(float(np.sum([each.power[joint] for each in self.problem.sums.test])), 1e-300)
        old, new = (
            float(np.sqrt(made.errors.sum(0)[joint] / power)) for made in (before, trial.after)
        )
        name = self.problem.design.columns.arm.joint_names[joint]
        reason = improvement("cross-validated error", trial.gain, trial.deviation, kept)
        reason += f", most at {name}: |e|/|tau| {old:.3f} -> {new:.3f}"
        return Choice(trial.move.text, kept, old, new, reason)


def _apply(chosen: list[int], move: SearchMove) -> list[int]:
    return sorted((set(chosen) | set(move.add)) - set(move.remove))


def with_loads(
    problem: Problem, chosen: list[int], motions: Sequence[Observation]
) -> tuple[Problem, list[int]]:
    """Return the problem with the columns that depend on the torque of a fit, and the choice.

    Args:
        problem: The problem.
        chosen: Columns of the fit.
        motions: Of the problem.
    """
    for _ in range(_ROUNDS):
        before = chosen
        problem, chosen = _with_loads(problem, chosen, motions)
        if chosen == before:
            break
    return problem, chosen


def _with_loads(
    problem: Problem, chosen: list[int], motions: Sequence[Observation]
) -> tuple[Problem, list[int]]:
    """Return the problem with these columns beside the fit as it is, and the choice then."""
    design, columns = problem.design, problem.design.columns
    theta = np.zeros(len(columns.columns))
    theta[chosen] = problem.fit(chosen).theta
    columns = columns.with_terms(columns.terms(theta))
    new = columns.load_dependent
    if not any(problem.allowed(columns.columns[index].effect) for index in new):
        return problem, chosen
    x = design.x.copy()
    x[..., new] = build_design(columns, motions, chosen=new).x
    design = replace(design, columns=columns, x=x)
    problem = replace(problem, design=design, sums=replace(problem.sums, x=x))
    found, choices = search(problem, chosen, _moves_of_others)
    if found != chosen:
        chosen, more = search(problem, found)
        choices += more
    return replace(problem, choices=(*problem.choices, *choices)), chosen


def _moves_of_others(columns: Columns, inside: set[int]) -> Iterator[SearchMove]:
    for term in columns.candidate_terms:
        if term.OF_OTHERS:
            yield from term.moves(columns, inside)
