"""Which columns a model has: chosen by the error on held-out blocks, never on those fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS
from dvrk_gravity.effects.elastic_cable import DEGREE
from dvrk_gravity.effects.presliding_hysteresis import DISPLACEMENTS
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.folds import Folds
from dvrk_gravity.identification.moments import Design, Moments
from dvrk_gravity.identification.posture import POSTURE
from dvrk_gravity.identification.regression import solve_signed
from dvrk_gravity.identification.result import Choice
from dvrk_gravity.identification.rigid_columns import RIGID
from dvrk_gravity.recording.data import Array

# A step must lower the held-out error by so much in the mean over blocks, and by so many
# standard errors of the blocks' differences: one block's luck is no reason.
LEAST_GAIN = 0.004
STANDARD_ERRORS = 1.0
MOST_STEPS = 60
# Effects that moves of their own are made for; of others each column comes and goes alone.
WITH_MOVES = (
    "coulomb_friction", "elastic_cable", "presliding_hysteresis", "rotor_inertia",
    "viscous_friction", *RIGID, *POSTURE,
)  # fmt: skip
WRIST = (3, 4, 5, 6)  # joints whose rotors are no part of a link, as far as torque can tell


@dataclass(frozen=True)
class Move:
    """A change of the model that is tried.

    Attributes:
        add: Columns that come in.
        remove: Columns that go.
        text: What it is.
    """

    add: tuple[int, ...]
    remove: tuple[int, ...]
    text: str


@dataclass(frozen=True, eq=False)
class Trial:
    """What a move would bring.

    Attributes:
        move: The move.
        errors: (folds, 7) held-out sums of squared errors after it.
        worth: Gain beyond what it must bring; positive if it pays.
    """

    move: Move
    errors: Array
    worth: float


@dataclass
class Selection:
    """Search for the columns of a model.

    Attributes:
        columns: All columns.
        train: Moments that each fold's fit sees.
        test: Moments of each fold's held-out samples.
        weight: (7,) inverse variance of one sample of each motor, correlation included.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        choices: What was tried last for every effect and joint.
    """

    columns: Columns
    train: Sequence[Moments]
    test: Sequence[Moments]
    weight: Array
    effects: Sequence[str] | None = None
    choices: list[Choice] = field(default_factory=list)

    def weighed(self, weight: Array) -> Selection:
        """Return the search with other (7,) weights of motors, and what was tried so far."""
        return Selection(
            self.columns, self.train, self.test, weight, self.effects, list(self.choices)
        )

    def allowed(self, effect: str) -> bool:
        """Tell whether an effect may be used."""
        return self.effects is None or effect in RIGID or effect in self.effects

    def score(self, chosen: Sequence[int]) -> Array:
        """Return (folds, 7) held-out sums of squared errors."""
        index = list(chosen)
        grid = np.ix_(index, index)
        ridge = np.diag(1.0 / self.columns.scale[index] ** 2)
        positive = self.columns.positive[index]
        errors = []
        for (data, right), test in zip(self._weighted, self.test, strict=True):
            theta, _ = solve_signed(data[grid] + ridge, right[index], positive)
            errors.append(test.select(index).error(theta))
        return np.array(errors)

    @cached_property
    def _weighted(self) -> list[tuple[Array, Array]]:
        """What each fold's fit sees, motors added up by their weights: (p, p) and (p,)."""
        return [
            (np.tensordot(self.weight, train.gram, 1), self.weight @ train.cross)
            for train in self.train
        ]

    def compare(self, before: Array, after: Array) -> tuple[float, float]:
        """Return the mean relative gain and its standard error over the blocks.

        Every motor's error counts relative to what it was, so that small wrist torques weigh
        as much as the shoulder's.
        """
        power = before.sum(axis=0)
        gain = ((before - after) / np.where(power > 0.0, power, 1.0)).sum(axis=1)
        folds = len(gain)
        mean = float(gain.sum()) / N_JOINTS
        return mean, float(np.std(gain, ddof=1) * np.sqrt(folds)) / N_JOINTS

    def search(self, starts: Sequence[list[int]], progress: Callable[[float], None]) -> list[int]:
        """Return the best end of searches from several starts.

        One change at a time does not find effects that pay only together; a search that starts
        with all of them does. A later start must beat the first as a change must. Choices that
        are noted already are taken to have led to the first.

        Args:
            starts: Columns to start with; at least one.
            progress: Called with the share that is done, a guess.
        """
        best: list[int] = []
        best_choices, before = self.choices, self.choices
        for number, start in enumerate(starts):
            self.choices = [] if number else list(before)
            progress(number / len(starts))
            found = self.run(start, lambda share: None)
            if number:
                gain, uncertainty = self.compare(self.score(best), self.score(found))
                more = max(1, len(found) - len(best))
                if gain <= max(LEAST_GAIN * more, STANDARD_ERRORS * uncertainty):
                    continue
            best, best_choices = found, self.choices
        self.choices = best_choices
        return best

    def run(self, chosen: list[int], progress: Callable[[float], None]) -> list[int]:
        """Add, exchange and remove columns for as long as that pays on held-out blocks.

        Args:
            chosen: Columns to start with.
            progress: Called with the share that is done, a guess.
        """
        current = self.score(chosen)
        steps = 0
        while True:
            progress(1.0 - 0.9**steps)
            # Every move once; then the promising ones again after each step that was taken, for
            # a step changes little of what moves at other joints are worth.
            trials = {move.text: self._try(move, chosen, current) for move in self._moves(chosen)}
            waiting = {text: trial for text, trial in trials.items() if trial.worth > 0.0}
            if not waiting or steps > MOST_STEPS:
                break
            while waiting:
                text = max(waiting, key=lambda one: waiting[one].worth)
                move = next((m for m in self._moves(chosen) if m.text == text), None)
                if move is None:
                    del waiting[text]
                    continue
                trial = self._try(move, chosen, current)
                others = [one.worth for other, one in waiting.items() if other != text]
                if trial.worth <= 0.0:
                    del waiting[text]
                elif trial.worth < 0.9 * max(others, default=0.0):
                    waiting[text] = trial
                else:
                    self.choices.append(self._choice(move, current, trial.errors, True))
                    chosen, current = self._apply(chosen, move), trial.errors
                    steps += 1
                    progress(1.0 - 0.9**steps)
                    del waiting[text]
        self.choices += [
            self._choice(trial.move, current, trial.errors, False) for trial in trials.values()
        ]
        return chosen

    def posture(self, chosen: list[int]) -> list[int]:
        """Add tilt and zeros for as long as the best of them pays."""
        current = self.score(chosen)
        while True:
            trials = [self._try(move, chosen, current) for move in self._posture_moves(chosen)]
            best = max(trials, key=lambda trial: trial.worth, default=None)
            kept = best is not None and best.worth > 0.0
            self.choices += [
                self._choice(trial.move, current, trial.errors, kept)
                for trial in ([best] if kept and best else trials)
            ]
            if best is None or not kept:
                return chosen
            chosen, current = self._apply(chosen, best.move), best.errors

    def _posture_moves(self, chosen: Sequence[int]) -> Iterator[Move]:
        for effect in filter(self.allowed, POSTURE):
            free = [i for i in self.columns.select(effect=effect) if i not in chosen]
            if effect == "base_tilt" and free:
                yield Move(tuple(free), (), effect)
            elif effect == "joint_offset":
                for i in free:
                    name = JOINT_NAMES[self.columns.columns[i].joint]
                    yield Move((i,), (), f"{effect} {name}")

    def _try(self, move: Move, chosen: list[int], current: Array) -> Trial:
        errors = self.score(self._apply(chosen, move))
        gain, uncertainty = self.compare(current, errors)
        if not move.add:
            # A smaller model has to bring nothing, only to cost nothing that can be told.
            return Trial(move, errors, gain + 0.25 * LEAST_GAIN * len(move.remove))
        more = max(1, len(move.add) - len(move.remove))
        worth = gain - LEAST_GAIN * more
        return Trial(move, errors, worth if worth > STANDARD_ERRORS * uncertainty else 0.0)

    def _apply(self, chosen: list[int], move: Move) -> list[int]:
        return sorted((set(chosen) | set(move.add)) - set(move.remove))

    def _choice(self, move: Move, before: Array, after: Array, kept: bool) -> Choice:
        power = np.array([test.power for test in self.test]).sum(axis=0)
        change = np.abs(after.sum(axis=0) - before.sum(axis=0)) / power
        joint = int(np.argmax(change))
        old, new = (float(np.sqrt(e.sum(0)[joint] / power[joint])) for e in (before, after))
        gain, uncertainty = self.compare(before, after)
        did = "pays" if kept else "does not pay"
        reason = (
            f"{did} on held-out blocks: {100 * gain:+.1f} ± {100 * uncertainty:.1f} % of the "
            f"squared error, {JOINT_NAMES[joint]} |e|/|tau| {old:.3f} -> {new:.3f}"
        )
        return Choice(move.text, kept, old, new, reason)

    def _moves(self, chosen: list[int]) -> Iterator[Move]:
        """Yield every change of the model that is worth a try, once each."""
        for move in self._all_moves(set(chosen)):
            added = [self.columns.columns[i] for i in move.add]
            if all(self.allowed(one.effect) and self.columns.offers(one) for one in added):
                yield move

    def _all_moves(self, inside: set[int]) -> Iterator[Move]:
        yield from self._elastic_moves(inside)
        columns = self.columns
        for j in range(N_JOINTS):
            places = _places(j)
            name = JOINT_NAMES[j]
            for place in places:
                where = f"{name} ({place})" if len(places) == 2 else name
                for effect in ("coulomb_friction", "viscous_friction"):
                    here = columns.select(effect=effect, place=place, joint=j)
                    both = inside & set(columns.select(effect=effect, joint=j))
                    if here[0] not in inside:
                        yield Move(tuple(here), (), f"{effect} {where}")
                    elif effect != "viscous_friction" or len(both) > 1:
                        # Every joint has viscous friction; what is too little to pay would
                        # still be in the other parameters, beyond their intervals.
                        yield Move((), tuple(here), f"without {effect} {where}")
                elements = columns.select(effect="presliding_hysteresis", place=place, joint=j)
                for element, size in zip(elements, DISPLACEMENTS, strict=True):
                    text = f"presliding_hysteresis {where}, {size:g} rad"
                    if element in inside:
                        yield Move((), (element,), f"without {text}")
                        continue
                    yield Move((element,), (), text)
                    for other in elements:
                        if other in inside:
                            yield Move((element,), (other,), f"{text} instead of another")
            if len(places) == 2:
                yield from self._place_moves(inside, j)
            rotor = columns.select(effect="rotor_inertia", joint=j)[0]
            if rotor not in inside:
                yield Move((rotor,), (), f"rotor_inertia {name}")
        yield from self._other_moves(inside)

    def _other_moves(self, inside: set[int]) -> Iterator[Move]:
        for i, column in enumerate(self.columns.columns):
            if column.effect not in WITH_MOVES:
                where = column.site.words(self.columns.arm)
                text = f"{column.effect} {where}" + f", {column.index}" * (column.index > 0)
                if i in inside:
                    yield Move((), (i,), f"without {text}")
                else:
                    yield Move((i,), (), text)

    def _place_moves(self, inside: set[int], j: int) -> Iterator[Move]:
        """Move a joint's friction to its motor or back."""
        for effect in ("coulomb_friction", "viscous_friction", "presliding_hysteresis"):
            places = [
                self.columns.select(effect=effect, place=p, joint=j) for p in ("joint", "motor")
            ]
            for here, there, where in ((*places, "motor"), (*places[::-1], "joint")):
                pairs = [(a, b) for a, b in zip(here, there, strict=True) if a in inside]
                pairs = [(a, b) for a, b in pairs if b not in inside]
                if pairs:
                    gone, come = zip(*pairs, strict=True)
                    yield Move(come, gone, f"{effect} {JOINT_NAMES[j]} at the {where}")

    def _elastic_moves(self, inside: set[int]) -> Iterator[Move]:
        for j, name in enumerate(JOINT_NAMES):
            powers = self.columns.select(effect="elastic_cable", joint=j)
            degree = max((k for k in range(DEGREE + 1) if powers[k] in inside), default=-1)
            # A cubic may pay where neither a slope nor a parabola does.
            for higher in range(degree + 1, min(degree + 4, DEGREE + 1)):
                yield Move(tuple(powers[degree + 1 : higher + 1]), (),
                           f"elastic_cable {name}, degree {higher}")  # fmt: skip
            if degree > 0:
                yield Move((), (powers[degree],), f"elastic_cable {name}, degree {degree - 1} only")
            elif degree == 0:
                yield Move((), (powers[0],), f"without a constant torque on {name}")


def _places(j: int) -> tuple[str, ...]:
    """Return where friction of a joint may live: motors 3 and 4 move more than their joint."""
    return ("joint", "motor") if j in (2, 3) else ("joint",)


def starts(columns: Columns, effects: Sequence[str] | None = None) -> list[list[int]]:
    """Return what searches start with: the plainest model, and one with presliding everywhere.

    Args:
        columns: The columns.
        effects: Effects that may be used besides the rigid body; ``None``: all.
    """
    everywhere = [
        index
        for j in range(N_JOINTS)
        for place in _places(j)
        for index in columns.select(effect="presliding_hysteresis", place=place, joint=j)
    ]
    plain = start_columns(columns)
    permitted = {
        i
        for i, column in enumerate(columns.columns)
        if columns.offers(column) and (effects is None or column.effect in (*RIGID, *effects))
    }
    found = [[i for i in one if i in permitted] for one in (plain, sorted(plain + everywhere))]
    return found if found[0] != found[1] else found[:1]


def start_columns(columns: Columns) -> list[int]:
    """Return the columns of the plainest model that can hold.

    It is the rigid body, friction, a constant torque, and the rotors of the wrist, whose inertia
    is none of a link's.
    """
    chosen = columns.select(effect="link_inertia") + columns.select(effect="gravity")
    chosen += columns.select(effect="elastic_cable", index=0)
    for effect in ("coulomb_friction", "viscous_friction"):
        for j in range(N_JOINTS):
            place = "motor" if j == 2 else "joint"
            chosen += columns.select(effect=effect, place=place, joint=j)
    for j in WRIST:
        chosen += columns.select(effect="rotor_inertia", joint=j)
    return sorted(chosen)


def split_moments(
    design: Design, folds: Folds, weight: Array
) -> tuple[Moments, list[Moments], list[Moments]]:
    """Return the moments of all, what each fold's fit sees of them, and what it is tested on.

    Args:
        design: All samples.
        folds: What is held out.
        weight: (n, 7) robust weights, for the fits; the tests count every sample in full.
    """
    whole = Moments.of(design.x, design.y, weight)
    train, test = [], []
    for fold, excluded in enumerate(folds.excluded):
        train.append(whole - Moments.of(design.x[excluded], design.y[excluded], weight[excluded]))
        held = folds.held_out == fold
        test.append(Moments.of(design.x[held], design.y[held], np.ones_like(weight[held])))
    return whole, train, test
