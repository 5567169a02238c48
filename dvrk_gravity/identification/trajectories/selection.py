"""Which columns a model has: chosen by the error on held-out blocks, never on those fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import RigidColumns, SearchMove, is_friction
from dvrk_gravity.estimation import (
    Folds,
    HeldOutSums,
    NormalEquations,
    SearchSettings,
    SeenSums,
    SignedFits,
    Trial,
    select,
)
from dvrk_gravity.identification.result import Choice, improvement
from dvrk_gravity.model import Columns, kinematic_moves, term_moves
from dvrk_gravity.observation import Design, training_equations

Moves = Callable[[Columns, set[int]], Iterator[SearchMove]]

# Part of the squared held-out error, in the mean over motors, that each further column must remove,
# chosen; and so many standard errors of the folds' gains: the rule of one standard error (Breiman,
# Friedman, Olshen and Stone 1984).
LEAST_GAIN = 0.004
STANDARD_ERRORS = 1.0
TOLERATED_LOSS = 0.25  # part of LEAST_GAIN that each removed column may cost. Chosen
# Part of a motor's RMS speed below which it turns round. No term has exactly what friction does
# there, and in a motion of few frequencies a spring may imitate it. Chosen: from .05 to .2 the same
# columns are chosen on every arm of `make peers`.
SLOW = 0.1
GAIN_MOVING = 0.5  # part of what another term gains that it must gain elsewhere. Chosen
_TERMS = SearchSettings(60, lazy=0.9)  # chosen: exact greedy search finds the same
_KINEMATICS = SearchSettings(60)


@dataclass(frozen=True, eq=False)
class FoldSums:
    """Sums of products over the samples of each fold, when they are first asked for.

    Attributes:
        design: All samples.
        folds: What is held out.
        weight: (N, m) robust weights, for the fits; tests count every informative sample in full.
        whole: Sums over all samples.
    """

    design: Design
    folds: Folds
    weight: Array
    whole: NormalEquations

    @cached_property
    def train(self) -> list[NormalEquations]:
        """Sums that each fold's fit sees."""
        return training_equations(self.design, self.folds, self.weight, self.whole)

    @cached_property
    def test(self) -> list[NormalEquations]:
        """Sums over each fold's held-out samples."""
        x, y, informative = self.design.x, self.design.y, self.design.informative
        return [
            NormalEquations.of(x[tested], y[tested], informative[tested].astype(float))
            for tested in self.folds.tested
        ]

    @cached_property
    def moving(self) -> list[NormalEquations]:
        """Those of :attr:`test` without the samples at which a motor turns round."""
        design, speed = self.design, self.design.state.qd
        assert speed is not None
        speed = np.abs(design.columns.arm.actuator_position(speed))
        slow = design.informative & (speed < SLOW * np.sqrt(np.mean(speed**2, axis=0)))
        found = []
        for whole, tested in zip(self.test, self.folds.tested, strict=True):
            rows = tested & slow.any(axis=1)
            weight = slow[rows].astype(float)
            found.append(whole - NormalEquations.of(design.x[rows], design.y[rows], weight))
        return found


@dataclass(frozen=True, eq=False)
class Chosen:
    """Columns of a model.

    Attributes:
        columns: Their numbers.
        errors: (folds, m) held-out sums of squared errors.
    """

    columns: list[int]
    errors: Array


@dataclass(frozen=True, eq=False)
class MoveTrial(Trial[SearchMove]):
    """Result of trying a move.

    Attributes:
        errors: (folds, m) held-out sums of squared errors after it.
    """

    errors: Array


@dataclass
class ColumnSelection:
    """Search for the columns of a model.

    Attributes:
        columns: All columns.
        sums: Over the samples that each fold's fit sees, and those that it is tested on.
        weight: (m,) inverse variance of one sample of each motor, correlation included.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        least_gain: Part of the squared held-out error, in the mean over motors, that each further
            column must remove.
        choices: The last trial of every effect and joint.
    """

    columns: Columns
    sums: FoldSums
    weight: Array
    effects: Sequence[str] | None = None
    least_gain: float = LEAST_GAIN
    choices: list[Choice] = field(default_factory=list)

    def with_weights(self, weight: Array) -> ColumnSelection:
        """Return the search with other (m,) weights of motors, and the trials so far."""
        return replace(self, weight=weight, choices=list(self.choices))

    def allowed(self, effect: str) -> bool:
        """Whether an effect may be used."""
        return self.effects is None or effect in RigidColumns.EFFECTS or effect in self.effects

    def score(self, chosen: Sequence[int]) -> Array:
        """Return (folds, m) held-out sums of squared errors."""
        return self._held_out.error(self._fits.fit(chosen))

    @cached_property
    def _fits(self) -> SignedFits:
        seen = SeenSums(self.sums.train, self.weight)
        return SignedFits(seen, self.columns.scale, self.columns.positive)

    @cached_property
    def _held_out(self) -> HeldOutSums:
        return HeldOutSums(self.sums.test)

    @cached_property
    def _moving(self) -> HeldOutSums:
        return HeldOutSums(self.sums.moving)

    def compare(self, before: Array, after: Array) -> tuple[float, float]:
        """Return the mean relative gain and its standard error over the blocks.

        Every motor's error counts relative to its value before, so that small wrist torques weigh
        as much as the shoulder's.
        """
        counted = max(1, int(np.count_nonzero(before.any(axis=0))))
        gain = self._by_motor(before, after).sum(axis=1) / counted
        return float(gain.sum()), float(np.std(gain, ddof=1) * np.sqrt(len(gain)))

    def _by_motor(self, before: Array, after: Array) -> Array:
        """Return (folds, m) the part of each motor's error that is removed."""
        power = before.sum(axis=0)
        return np.asarray((before - after) / np.where(power > 0.0, power, 1.0))

    def search(self, starts: Sequence[list[int]], progress: Callable[[float], None]) -> list[int]:
        """Return the best end of searches from several starts.

        One change at a time does not find effects that help only together; a search that starts
        with all of them does. A later start must beat the first as a change must. Choices noted
        before count as leading to the first.

        Args:
            starts: Columns to start with; at least one set.
            progress: Called with the share that is done, a guess.
        """
        best: list[int] = []
        best_choices, before = self.choices, self.choices
        for number, start in enumerate(starts):
            self.choices = [] if number else list(before)
            progress(number / len(starts))
            found = self.run(start)
            if number:
                more = max(1, len(found) - len(best))
                gain, error = self.compare(self.score(best), self.score(found))
                if gain <= max(self.least_gain * more, STANDARD_ERRORS * error):
                    continue
            best, best_choices = found, self.choices
        self.choices = best_choices
        return best

    def run(self, chosen: list[int]) -> list[int]:
        """Add, exchange and remove columns for as long as that helps on held-out blocks."""
        return self._select(chosen, term_moves, _TERMS)

    def of_others(self, chosen: list[int]) -> list[int]:
        """Add what depends on the torque of the other columns for as long as that helps."""
        return self._select(chosen, _moves_of_others, _TERMS)

    def kinematics(self, chosen: list[int]) -> list[int]:
        """Add tilt and encoder offsets for as long as the best of them helps."""
        return self._select(chosen, kinematic_moves, _KINEMATICS)

    def _select(self, chosen: list[int], moves: Moves, settings: SearchSettings) -> list[int]:
        # By what a move does: several may have the same text.
        found, vain = select(
            _MoveSearch(self, moves), Chosen(chosen, self.score(chosen)), settings,
            lambda move: (move.add, move.remove),
        )  # fmt: skip
        self.choices += [self.choice(trial, found.errors, False) for trial in vain]
        return found.columns

    def evaluate(self, state: Chosen, moves: Sequence[SearchMove]) -> list[MoveTrial]:
        """Return the results of moves."""
        others = [_apply(state.columns, move) for move in moves]
        if len(others) == 1:
            theta = self._fits.fit(others[0])[None]
        else:
            theta = self._fits.fit_near(state.columns, others)
        errors = self._held_out.error(theta)
        trials = [self._judged(state.errors, m, e) for m, e in zip(moves, errors, strict=True)]
        which = [i for i, trial in enumerate(trials) if trial.passes and self._at_speed(trial.move)]
        if which:
            before = self._moving.error(self._fits.fit(state.columns))
            for i, after in zip(which, self._moving.error(theta[which]), strict=True):
                (gain, _), (moving, _) = (
                    self.compare(state.errors, errors[i]), self.compare(before, after)
                )  # fmt: skip
                trials[i] = replace(trials[i], passes=moving > GAIN_MOVING * gain)
        return trials

    def _at_speed(self, move: SearchMove) -> bool:
        """Whether a move adds what must explain torque not only where friction turns round."""
        return any(not is_friction(self.columns.columns[i].effect) for i in move.add)

    def _judged(self, before: Array, move: SearchMove, errors: Array) -> MoveTrial:
        gain, uncertainty = self.compare(before, errors)
        if not move.add:  # a smaller model need not gain, only not lose
            worth = gain + TOLERATED_LOSS * self.least_gain * len(move.remove)
            return MoveTrial(move, worth, worth > 0.0, errors)
        more = max(1, len(move.add) - len(move.remove))
        worth = gain - self.least_gain * more
        return MoveTrial(move, worth, worth > max(0.0, STANDARD_ERRORS * uncertainty), errors)

    def permitted(self, move: SearchMove) -> bool:
        """Whether a move may be tested."""
        added = [self.columns.columns[i] for i in move.add]
        return all(self.allowed(column.effect) and self.columns.offers(column) for column in added)

    def choice(self, trial: MoveTrial, before: Array, kept: bool) -> Choice:
        """Return a trial for the report, with its error at the joint where it matters most."""
        after = trial.errors
        gain, uncertainty = self.compare(before, after)
        removed = self._by_motor(before, after).sum(axis=0)
        joint = int(np.argmax(removed if gain > 0.0 else -removed))
        power = max(float(np.sum([test.power[joint] for test in self.sums.test])), 1e-300)
        old, new = (float(np.sqrt(e.sum(0)[joint] / power)) for e in (before, after))
        name = self.columns.arm.joint_names[joint]
        reason = improvement("cross-validated error", gain, uncertainty, kept)
        reason += f", most at {name}: |e|/|tau| {old:.3f} -> {new:.3f}"
        return Choice(trial.move.text, kept, old, new, reason)


def _moves_of_others(columns: Columns, inside: set[int]) -> Iterator[SearchMove]:
    for term in columns.candidate_terms:
        if term.OF_OTHERS:
            yield from term.moves(columns, inside)


@dataclass(frozen=True, eq=False)
class _MoveSearch:
    """A selection that tries moves of one kind."""

    selection: ColumnSelection
    generate: Moves

    def moves(self, state: Chosen) -> Iterable[SearchMove]:
        found = self.generate(self.selection.columns, set(state.columns))
        return filter(self.selection.permitted, found)

    def attempt(self, state: Chosen, moves: Sequence[SearchMove]) -> list[MoveTrial]:
        return self.selection.evaluate(state, moves)

    def choose(self, trials: Sequence[MoveTrial]) -> MoveTrial | None:
        passing = (trial for trial in trials if trial.passes)
        return max(passing, key=lambda trial: trial.worth, default=None)

    def take(self, state: Chosen, trial: MoveTrial) -> Chosen:
        self.selection.choices.append(self.selection.choice(trial, state.errors, True))
        return Chosen(_apply(state.columns, trial.move), trial.errors)


def _apply(chosen: list[int], move: SearchMove) -> list[int]:
    return sorted((set(chosen) | set(move.add)) - set(move.remove))
