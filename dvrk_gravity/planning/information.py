"""What a motion would teach: the information in its torques, beside what is known already.

With the regressor Y of independent unknowns of one prior standard deviation each, and the noise R
of a second of measurement, the unknowns have the inverse covariance A = 1 + integral Y' R^-1 Y dt
afterwards. What is maximised is log det A (D-optimality: Atkinson, Donev, Tobias 2007; with a prior
it is Bayesian, Chaloner and Verdinelli 1995).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import PER_LINK, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import LinearTerm, State
from dvrk_gravity.identification import base_parameters
from dvrk_gravity.model import Columns, ModelUncertainty, TorqueModel, start_columns


@dataclass(frozen=True)
class NoiseSettings:
    """Noise of an arm that was never identified.

    Attributes:
        part: RMS of what a model leaves of a joint's effort, as a part of its largest. Chosen: what
            static poses of a real MTM leave of its calibrated model is .004 to .19 of it.
        correlation: Its correlation time, s: of white noise below the 5.65 Hz of the filter it is
            1 / (2 x 5.65 Hz) = .09 s; a model's error is no whiter.
    """

    part: float = 0.02
    correlation: float = 0.1


@dataclass(frozen=True)
class DifferenceSteps:
    """Steps of the finite differences of a regressor.

    Attributes:
        position: rad or m. The regressor is smooth.
        velocity: rad/s (a tenth, m/s). Dry friction is taken to reverse linearly within it, since a
            jump has no slope to follow. Chosen: a motion spends few samples there.
    """

    position: float = 1e-6
    velocity: float = 0.05


class Objective(ABC):
    """What a motion is good for: a function of the Gram matrix of its columns in units of noise.

    Attributes:
        arm: The arm.
        noise: (n,) variance of the mean torque of a second, (N·m)^2 s.
    """

    arm: Arm
    noise: Array

    @property
    def slow(self) -> Array:
        """(n,) speeds below which a joint counts as turning back, rad/s or m/s."""
        return np.asarray(DifferenceSteps().velocity * self.arm.scale)

    @abstractmethod
    def regressor(self, state: State) -> Array:
        """Return (N, n, p) columns of torque, N·m.

        Of several motions one after the other, if states are in order of time.
        """

    @abstractmethod
    def score(self, gram: Array) -> tuple[float, Array]:
        """Return the value of (p, p) G = integral of Y' R^-1 Y dt, and its (p, p) slope by G."""

    def over(self, time: Array) -> Objective:
        """Return the objective of motions that are looked at at (N,) times, s."""
        del time
        return self

    def gram(self, state: State, weight: Array) -> Array:
        """Return (p, p) G for (N, n) states that stand for (N,) seconds each."""
        return _gram(self.regressor(state), weight, self.noise)

    def value(self, state: State, weight: Array) -> float:
        """Return the value of (N, n) states that stand for (N,) seconds each."""
        return self.score(self.gram(state, weight))[0]

    def gradient(self, state: State, weight: Array) -> tuple[float, tuple[Array, Array, Array]]:
        """Return the value and its (N, n) derivatives by position, velocity and acceleration.

        Args:
            state: (N, n) states.
            weight: (N,) s that each of them stands for.
        """
        qd, qdd = state.qd, state.qdd
        assert qd is not None
        assert qdd is not None
        y = self.regressor(state)
        value, slope = self.score(_gram(y, weight, self.noise))
        # d value = 2 sum_t w_t tr(slope Y' R^-1 dY)
        by_y = 2.0 * (weight[:, None] / self.noise)[..., None] * (y @ slope)
        by = tuple(np.empty(state.q.shape) for _ in range(3))
        steps, count = DifferenceSteps(), len(y)
        for j, unit in enumerate(np.eye(self.arm.n)):
            h = steps.position
            states = State(
                np.concatenate([state.q + h * unit, *[state.q] * 3]),
                np.concatenate([qd, qd + h * unit, qd - h * unit, qd]),
                np.concatenate([*[qdd] * 3, qdd + unit]),
            )
            along = np.einsum(
                "kNnp,Nnp->kN", self.regressor(states).reshape(4, count, *y.shape[1:]), by_y
            )
            here = np.einsum("Nnp,Nnp->N", y, by_y)
            by[0][:, j] = (along[0] - here) / h
            by[1][:, j] = (along[1] - along[2]) / (2.0 * h)
            by[2][:, j] = along[3] - here  # linear in accelerations
        return value, (by[0], by[1], by[2])


class Knowledge(Objective):
    """What is known of an arm before a motion; the objective is log det A.

    The columns are the torques of the unknowns, one prior standard deviation of each.

    Attributes:
        names: (m,) names of the parameters that are reported.
        units: (m,) their units.
        rows: (m, p) their changes in each of the p unknowns.
        correlation: (n,) correlation time of the noise, s.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: Array
    correlation: Array

    def score(self, gram: Array) -> tuple[float, Array]:
        """Return log det (1 + G), and its slope."""
        inverse = np.eye(len(gram)) + gram
        factor = np.linalg.cholesky(inverse)
        slope = np.asarray(np.linalg.inv(inverse), dtype=float)
        return 2.0 * float(np.log(np.diag(factor)).sum()), slope

    def errors(self, gram: Array) -> Array:
        """Return (m,) standard errors of the parameters after a motion of (p, p) G."""
        inverse = np.eye(len(gram)) + gram
        return np.sqrt(np.einsum("ij,ji->i", self.rows, np.linalg.solve(inverse, self.rows.T)))

    @property
    def before(self) -> Array:
        """(m,) their standard deviations before the motion."""
        return np.asarray(np.linalg.norm(self.rows, axis=1))


def _gram(y: Array, weight: Array, noise: Array) -> Array:
    scaled = (np.sqrt(weight[:, None] / noise)[..., None] * y).reshape(-1, y.shape[-1])
    return np.asarray(scaled.T @ scaled)


def noise_of(arm: Arm, known: ModelUncertainty | None = None) -> Array:
    """Return (n,) variance of the mean torque of a second, (N·m)^2 s.

    That of a model's known error, as far as there is one; see :class:`NoiseSettings`.
    """
    error = NoiseSettings().part * arm.effort_limit
    if known is not None:
        error = np.where(known.error > 0.0, known.error, error)
    return np.asarray(error**2 * _correlation(arm, known))


def _correlation(arm: Arm, known: ModelUncertainty | None = None) -> Array:
    """Return (n,) correlation times of a model's known error, s; see :class:`NoiseSettings`."""
    correlation = np.full(arm.n, NoiseSettings().correlation)
    if known is None:
        return correlation
    return np.where(known.correlation_time > 0.0, known.correlation_time, correlation)


class PriorKnowledge(Knowledge):
    """What is known of an arm that was never identified: the priors of the effects.

    The unknowns are what every identification fits: base parameters, friction, cables, rotors.
    """

    def __init__(self, arm: Arm, lower: Array, upper: Array, noise: Array | None = None) -> None:
        """Lay out the columns.

        Args:
            arm: The arm.
            lower: (n,) lowest positions of the motion.
            upper: (n,) highest ones.
            noise: See :func:`noise_of`; ``None``: that of an arm without a model.
        """
        self.arm = arm
        self.noise = noise_of(arm) if noise is None else noise
        self.correlation = _correlation(arm)
        self._columns = Columns(arm, lower, upper)
        self._start_columns = start_columns(self._columns)
        columns = self._columns.columns
        self._scale = self._columns.scale[self._start_columns]
        rigid = self._columns.base.shape[1]
        named = [(name, unit, row @ self._columns.base)
                 for name, unit, row in base_parameters(self._columns.mounted)]  # fmt: skip
        names, units = [name for name, *_ in named], [arm.own_unit(unit) for _, unit, _ in named]
        rows = np.zeros((len(named), len(self._start_columns)))
        rows[:, :rigid] = [row for *_, row in named]  # these columns come first
        own = []
        for position, index in enumerate(self._start_columns):
            column = columns[index]
            if column.unit:
                names.append(self._columns.effect(index).coefficient_name(arm, column))
                units.append(column.site.unit(arm, column.unit))
                own.append(position)
        self.names, self.units = tuple(names), tuple(units)
        self.rows = np.vstack([rows, np.eye(len(self._start_columns))[own]]) * self._scale

    def regressor(self, state: State) -> Array:
        """Return the joints' torques; friction that depends on the path is none of the columns."""
        true = self._columns.kinematics.true(state)
        start = len(self._columns.rigid.columns)
        parts = [self._columns.rigid.regressor(true)]
        for unknowns in self._columns.unknowns:
            here = [
                i - start for i in self._start_columns if 0 <= i - start < len(unknowns.columns)
            ]
            start += len(unknowns.columns)
            if here:
                full = unknowns.term.full_speed
                parts.append(
                    unknowns.regressor(_widen_reversal(true, full, self.slow), _NONE)[..., here]
                )
        return np.concatenate(parts, axis=-1) * self._scale


_NONE = np.zeros((1, 0))  # memory
_ASIDE = 1e-4  # rad or m: a slope of which a slope is taken
_STEP = 1e-9  # rad/s: the width of a step that has none


def _widen_reversal(state: State, full: Array | None, slow: Array) -> State:
    """Return a state for friction that is full from (n,) speeds, as if it were from ``slow`` on.

    The slope of its reversal can be followed then.
    """
    if full is None or state.qd is None or state.direction is not None:
        return state
    return State(state.q, state.qd * (np.maximum(full, _STEP) / slow), state.qdd)


class ModelKnowledge(Knowledge):
    """What a model knows already: its posterior.

    The unknowns are the independent directions of its uncertainty.
    """

    def __init__(self, model: TorqueModel, known: ModelUncertainty) -> None:
        """Take over a model's uncertainty."""
        self.arm, self.noise = model.arm, noise_of(model.arm, known)
        self.correlation = _correlation(model.arm, known)
        self._model, self._known = model, known
        still = State(np.zeros((1, self.arm.n)))
        # Friction that depends on the path: its present state is not known here.
        self._terms = tuple(
            term
            for term in model.terms
            if not (isinstance(term, LinearTerm) and term.memory(still).shape[1])
        )
        names, units, rows = [], [], []
        for name, unit, row in _parameter_changes(model, known):
            if row.any():
                names.append(name)
                units.append(unit)
                rows.append(row)
        self.names, self.units = tuple(names), tuple(units)
        self.rows = np.array(rows).reshape(len(rows), known.size)

    def regressor(self, state: State) -> Array:
        """Return the joints' torques; friction that depends on the path is left out."""
        true = replace(state, q=state.q - self._model.joint_offset)
        found = np.zeros((*state.q.shape, self._known.size))
        for term in self._terms:
            found += self._known.torque((term,), _widen_reversal(true, term.full_speed, self.slow))
        for joint in np.flatnonzero(self._known.offset.any(axis=1)).tolist():
            moved = _ASIDE * np.eye(self.arm.n)[joint]
            behind, ahead = (
                np.sum([term.torque(replace(true, q=q)) for term in self._terms], axis=0)
                for q in (true.q - moved, true.q + moved)
            )
            # Where the reading is too high by the offset, the arm is that much behind it.
            slope = (behind - ahead) / (2.0 * _ASIDE)
            found += slope[..., None] * self._known.offset[joint]
        return found


def _parameter_changes(
    model: TorqueModel, known: ModelUncertainty
) -> Iterator[tuple[str, str, Array]]:
    """Yield name, unit and (d,) changes of each parameter in the directions of its uncertainty."""
    arm = model.arm
    for term in model.terms:
        if term.OF_LINKS == PER_LINK and term.NAME in known.deviations:
            for name, unit, row in base_parameters(arm):
                yield name, arm.own_unit(unit), row @ known.deviations[term.NAME]
    for term in model.terms:
        change = known.deviations.get(term.NAME)
        if change is None or not isinstance(term, LinearTerm) or term.OF_LINKS:
            continue
        declared = {entry.name: entry for entry in term.schema(arm)}
        moved = [term.with_theta(term.theta + way).parameters() for way in change.T]
        for name, value in term.parameters().items():
            if isinstance(value, str):  # of which form it is
                continue
            entry, here = declared[name], np.atleast_1d(np.asarray(value, dtype=float))
            there = np.array([np.resize(each.get(name, here), here.shape) for each in moved])
            for k, row in enumerate((there - here).T.astype(float)):
                site = arm.joint_names[k] if len(here) == arm.n else str(k)
                yield f"{name}[{site}]", entry.units[k] if entry.units else entry.unit, row
    for joint, row in zip(arm.joints, known.offset, strict=True):
        yield f"joint_offset[{joint.name}]", joint.unit, row
