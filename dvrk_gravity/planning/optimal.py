"""The best motion within limits: an augmented Lagrangian over Fourier coefficients.

Positions, velocities and accelerations are linear in the coefficients, so all but efforts and boxes
are linear constraints, on a grid. Maximised is an objective of :mod:`.information`; its gradient
goes through the regressor's slopes and the series, which is exact. L-BFGS solves each step (Nocedal
and Wright 2006, section 17.4). What is left beyond a limit, by the proof between points, is taken
off by moving the whole motion towards a position at rest that keeps them all.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.errors import PlanError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.fourier import Basis, FourierMotion
from dvrk_gravity.planning.information import Objective
from dvrk_gravity.planning.keeping import box_violations, efforts, kept_parts, slacks
from dvrk_gravity.planning.limits import PlanLimits
from dvrk_gravity.planning.places import levers
from dvrk_gravity.planning.resting import resting_positions
from dvrk_gravity.units import quantity

Report = Callable[[float], None]
# From (n,) middle and (2 k, n) coefficients to values g <= 0, and to what takes a force on each of
# them back to a slope by middle and coefficients.
Constraint = Callable[[Array, Array], tuple[Array, Callable[[Array], tuple[Array, Array]]]]
Multiplier = Array | float  # of the shape of g; 0.0: of no force yet
_HALVINGS = 10  # of the part of a motion that keeps its limits: to a thousandth
_PLACES = 21  # positions at rest about which random motions are drawn. Chosen
# Of finite differences of efforts by position, velocity and acceleration, rad and s: dry friction
# reverses within the second, as in `information.DifferenceSteps`; the third is exact.
_STEPS = (1e-5, 0.05, 1.0)
_BOX_UNIT = 0.1  # m, which counts as much as all of a limit. Chosen
_BOX_SPARE = 0.005  # m, by which links stay further off, for what is between grid points. Chosen


@dataclass(frozen=True)
class SolverSettings:
    """Effort of the search. Numbers are chosen; `benchmark/plan.py` prints what they reach.

    Attributes:
        samples: Times at which the information is integrated, in each period of the fastest wave.
        most_samples: ... but no more than this.
        grid: Times at which limits are kept, in each period of the fastest wave. A sine is 1 - cos(
            pi / grid) higher between them: .2 %.
        spare: Part of each limit that is left for that.
        draws: Random motions among which the starts are chosen.
        starts: From so many the search starts.
        first: Iterations of each start.
        rounds: Steps of the augmented Lagrangian for the best.
        iterations: Iterations in each.
        stiffness: Of the penalty at first.
        stiffer: Its factor from step to step.
        seconds: After this time of one core the search ends, s.
        evaluations: After so many of the objective it ends, too: unlike a time, the same number
            finds the same motion again; ``None``: that is no bound.
    """

    samples: int = 6
    most_samples: int = 200
    grid: int = 48
    spare: float = 0.002
    draws: int = 40
    starts: int = 3
    first: int = 40
    rounds: int = 6
    iterations: int = 80
    stiffness: float = 30.0
    stiffer: float = 2.0
    seconds: float = 100.0
    evaluations: int | None = None


def _force(g: Array, multiplier: Multiplier, stiffness: float) -> Array:
    """Return the slope of the Lagrangian by g: after an iteration, the next multiplier."""
    return np.asarray(np.maximum(0.0, multiplier + stiffness * g))


class MotionSearch:
    """A problem: what is maximised, and what is kept."""

    def __init__(
        self,
        basis: Basis,
        limits: PlanLimits,
        objective: Objective,
        model: TorqueModel | None = None,
        seed: int = 0,
        settings: SolverSettings | None = None,
    ) -> None:
        """Lay out the grids.

        Args:
            basis: Of the motion.
            limits: What it keeps.
            objective: What is maximised.
            model: For its efforts; ``None``: none are known.
            seed: Of the draws.
            settings: Effort of the search.

        Raises:
            PlanError: Limits that no position at rest keeps.
        """
        self.basis, self.limits, self.model = basis, limits, model
        self.arm: Arm = objective.arm
        self.settings = settings or SolverSettings()
        self._random = np.random.default_rng(seed)
        self.rest = resting_positions(limits, self.arm, model, self._random, _PLACES)
        fastest = float(basis.frequency.max())
        needed = int(self.settings.samples * fastest * basis.duration) + 2
        count = min(self.settings.most_samples, needed)
        # Each stands for the same time; where they are too few for the fastest wave, at random.
        place = 0.5 if count == needed else self._random.uniform(0.0, 1.0, count)
        self._time = (np.arange(count) + place) * basis.duration / count
        self._weight = np.full(count, basis.duration / count)
        self.objective = objective.over(self._time)
        self._at = basis.at(self._time)
        self._grid = basis.at(basis.grid(1.0 / (self.settings.grid * fastest))[0])
        self._scale = self._sizes()
        self._begun, self._evaluated = 0.0, 0
        self._constraints: list[Constraint] = [self._kinematic]
        if model is not None:
            self._constraints.append(self._efforts)
        if limits.boxes:
            self._constraints.append(self._boxes)

    def _sizes(self) -> Array:
        """Return (1 + 2 k, n) about how large middle and coefficients can be."""
        limits = self.limits
        half = 0.5 * np.minimum(limits.upper - limits.lower, 2.0 * np.pi)
        omega = np.tile(2.0 * np.pi * self.basis.frequency, 2)[:, None]
        size = np.minimum(np.minimum(half, limits.velocity / omega), limits.acceleration / omega**2)
        return np.vstack([half, size]) + 1e-9

    def best(self, report: Report = lambda share: None) -> FourierMotion:
        """Return the best motion that was found; it keeps all limits.

        Raises:
            PlanError: None was found, though positions at rest keep them all.
        """
        settings, self._begun, self._evaluated = self.settings, time.process_time(), 0
        total = settings.starts * settings.first + settings.rounds * settings.iterations
        done = 0

        def count(_: Array) -> None:
            nonlocal done
            done += 1
            report(min(1.0, max(done / total, self._spent_share())))
            if self._spent_share() >= 1.0:
                raise StopIteration  # as the solver expects it of who wants no more

        drawn = sorted((self._draw(k) for k in range(settings.draws)), key=self.value, reverse=True)
        found = []
        free: list[Multiplier] = [0.0] * len(self._constraints)
        for start in drawn[: settings.starts]:
            x, multipliers = self._solve(self._vector(start), free, 1, settings.first, count)
            found.append((self._shrink_to_limits(x), x, multipliers))
        found.sort(key=lambda each: -self.value(each[0]))
        done = settings.starts * settings.first
        _, x, multipliers = found[0]
        x, _ = self._solve(x, multipliers, settings.rounds, settings.iterations, count)
        return max(
            [
                self._shrink_to_limits(x),
                *(each[0] for each in found),
                self._shrink_to_limits(self._vector(drawn[0])),
            ],
            key=self.value,
        )

    def value(self, motion: FourierMotion) -> float:
        """Return what a motion is worth."""
        return self.objective.value(State(*motion.at(self._time)), self._weight)

    def gram(self, motion: FourierMotion) -> Array:
        """Return (p, p) G of a motion, at twice as many times as the fastest wave needs."""
        fastest, duration = float(self.basis.frequency.max()), self.basis.duration
        count = int(2 * self.settings.samples * fastest * duration) + 2
        moments = (np.arange(count) + 0.5) * duration / count
        weight = np.full(count, duration / count)
        return self.objective.over(moments).gram(State(*motion.at(moments)), weight)

    def _vector(self, motion: FourierMotion) -> Array:
        return np.asarray(np.vstack([motion.middle, motion.coefficients]) / self._scale).ravel()

    def _motion(self, x: Array) -> FourierMotion:
        whole = x.reshape(self._scale.shape) * self._scale
        return FourierMotion(self.basis, whole[0], whole[1:])

    def _draw(self, number: int) -> FourierMotion:
        """Draw a motion that goes as far as the limits on the grid let it."""
        middle = self.rest[number % len(self.rest)]
        wave = self._random.normal(size=self._scale[1:].shape) * self._scale[1:]
        n, rows = self.arm.n, self.limits.rows
        lower, upper = self.limits.range

        def factor(coefficients: Array, which: slice) -> Array:
            """Return how much longer the ways of some rows may be."""
            q, qd, qdd = self._grid @ (coefficients @ rows[which].T)
            here = rows[which] @ middle
            with np.errstate(divide="ignore", invalid="ignore"):
                room = [
                    (upper[which] - here) / q.max(axis=0), (lower[which] - here) / q.min(axis=0),
                    *(rate[which] / np.abs(way).max(axis=0)
                      for rate, way in zip(self.limits.rates, (qd, qdd), strict=True)),
                ]  # fmt: skip
            return np.nan_to_num(np.min(room, axis=0), nan=np.inf, posinf=1e3)

        wave = wave * factor(wave, slice(0, n))
        if len(rows) > n:
            wave = wave * min(1.0, float(factor(wave, slice(n, None)).min()))
        return FourierMotion(self.basis, middle, wave)

    def _solve(
        self,
        x: Array,
        multipliers: list[Multiplier],
        rounds: int,
        iterations: int,
        count: Callable[[Array], None],
    ) -> tuple[Array, list[Multiplier]]:
        """Return where rounds of the augmented Lagrangian lead, and the multipliers there."""
        from scipy.optimize import minimize

        stiffness = self.settings.stiffness
        for _ in range(rounds):
            if self._spent_share() >= 1.0:
                break
            x = minimize(
                self._lagrangian, x, args=(multipliers, stiffness), jac=True, method="L-BFGS-B",
                callback=count, options={"maxiter": iterations, "maxcor": 30},
            ).x  # fmt: skip
            motion = self._motion(x)
            multipliers = [
                _force(constraint(motion.middle, motion.coefficients)[0], multiplier, stiffness)
                for constraint, multiplier in zip(self._constraints, multipliers, strict=True)
            ]
            stiffness *= self.settings.stiffer
        return x, multipliers

    def _spent_share(self) -> float:
        """Return the part of the search's time, or of its evaluations, that is spent."""
        settings = self.settings
        parts = [(time.process_time() - self._begun) / settings.seconds]
        if settings.evaluations is not None:
            parts.append(self._evaluated / settings.evaluations)
        return max(parts)

    def _lagrangian(
        self, x: Array, multipliers: list[Multiplier], stiffness: float
    ) -> tuple[float, Array]:
        """Return the augmented Lagrangian, to be minimised, and its slope."""
        self._evaluated += 1
        motion = self._motion(x)
        states = (self._at @ motion.coefficients) + np.stack(
            [motion.middle, *[np.zeros(self.arm.n)] * 2]
        )[:, None]
        value, by = self.objective.gradient(State(*states), self._weight)
        total = -value
        of_middle = -by[0].sum(axis=0)
        of_waves = -sum(b.T @ each for b, each in zip(self._at, by, strict=True))
        for constraint, multiplier in zip(self._constraints, multipliers, strict=True):
            g, back = constraint(motion.middle, motion.coefficients)
            force = _force(g, multiplier, stiffness)
            total += float(np.sum(force**2 - multiplier**2)) / (2.0 * stiffness)
            middle, waves = back(force)
            of_middle = of_middle + middle
            of_waves = of_waves + waves
        slope = np.vstack([of_middle, of_waves]) * self._scale
        return total, slope.ravel()

    def _kinematic(
        self, middle: Array, coefficients: Array
    ) -> tuple[Array, Callable[[Array], tuple[Array, Array]]]:
        """Return (3, N, r) parts beyond the limits of joints and combinations."""
        rows, allowed = self.limits.rows, 1.0 - self.settings.spare
        lower, upper = self.limits.range
        open_ended = ~np.isfinite(upper - lower)
        half = np.where(open_ended, np.inf, np.maximum(0.5 * (upper - lower), 1e-9))
        centre = np.where(open_ended, 0.0, 0.5 * (np.where(open_ended, 0.0, lower + upper)))
        size = np.stack([half, *self.limits.rates])[:, None]
        ways = self._grid @ (coefficients @ rows.T)
        ways[0] += rows @ middle - centre
        part = np.abs(ways) / size - allowed
        sign = np.sign(ways) / size

        def back(force: Array) -> tuple[Array, Array]:
            pull = (force * sign) @ rows  # (3, N, n)
            waves = np.einsum("dNk,dNn->kn", self._grid, pull, optimize=True)
            return pull[0].sum(axis=0), waves

        return part, back

    def _efforts(
        self, middle: Array, coefficients: Array
    ) -> tuple[Array, Callable[[Array], tuple[Array, Array]]]:
        """Return (N, n) parts of the actuators' efforts beyond their limits."""
        model, allowed = self.model, 1.0 - self.settings.spare
        assert model is not None
        q, qd, qdd = self._at @ coefficients
        q = q + middle
        load, torque = efforts(model, State(q, qd, qdd))
        part = load / self.limits.effort - allowed

        def back(force: Array) -> tuple[Array, Array]:
            pull = force * np.sign(torque) / self.limits.effort
            if not pull.any():
                return np.zeros_like(middle), np.zeros_like(coefficients)
            by = np.zeros((3, *q.shape))
            busy = pull.any(axis=1)
            state = [each[busy] for each in (q, qd, qdd)]
            # The band moves little beside the torque itself.
            for order, step in enumerate(_STEPS):
                for j, unit in enumerate(np.eye(self.arm.n)):
                    ahead, behind = (
                        self.arm.actuator_effort(
                            model.torque_at(
                                State(*(each + (sign * step * unit if order == k else 0.0)
                                        for k, each in enumerate(state)))
                            )
                        )
                        for sign in (1.0, -1.0)
                    )  # fmt: skip
                    slope = (ahead - behind) / (2.0 * step)
                    by[order, busy, j] = np.einsum("Nn,Nn->N", slope, pull[busy])
            waves = np.einsum("dNk,dNn->kn", self._at, by, optimize=True)
            return by[0].sum(axis=0), waves

        return part, back

    def _boxes(
        self, middle: Array, coefficients: Array
    ) -> tuple[Array, Callable[[Array], tuple[Array, Array]]]:
        """Return (N, links) how far links are within boxes, in units of 0.1 m."""
        boxes = self.limits.boxes
        q = self._grid[0] @ coefficients + middle
        away, slope = box_violations(self.arm, boxes, q)
        part = (_BOX_SPARE - away) / _BOX_UNIT

        def back(force: Array) -> tuple[Array, Array]:
            busy = force.any(axis=1)
            by = np.zeros_like(q)
            if busy.any():
                links = [link for box in boxes for link in box.links]
                lever = levers(self.arm, links, q[busy])
                by[busy] = (
                    -np.einsum("Nl,Nlx,Nlxn->Nn", force[busy], slope[busy], lever) / _BOX_UNIT
                )
            return by.sum(axis=0), self._grid[0].T @ by

        return part, back

    def _shrink_to_limits(self, x: Array) -> FourierMotion:
        """Return the motion, moved towards rest as far as it takes to keep all limits.

        First each joint alone, towards the middle of its range, as far as its own limits take it,
        so that one of little room leaves the others theirs; then all of them.

        Raises:
            PlanError: Only the position at rest itself keeps them.
        """
        motion, about = self._motion(x), self.rest[0]
        lower, upper = self.limits.lower, self.limits.upper
        with np.errstate(invalid="ignore"):
            half_way = np.where(np.isfinite(upper - lower), 0.5 * (lower + upper), motion.middle)
        motion = motion.scaled(half_way, kept_parts(motion, self.limits, half_way))
        low, high, kept, beyond = 0.0, 1.0, None, None
        factor = high
        for _ in range(_HALVINGS):
            tried = motion.scaled(about, factor)
            found = slacks(tried, self.limits, self.arm, self.model)
            over = [each for each in found if each.left < 0.0]
            if over:
                high, beyond = factor, max(over, key=lambda each: each.used)
            else:
                low, kept = factor, tried
            if low == 1.0:
                break
            factor = 0.5 * (low + high)
        if kept is None:
            assert beyond is not None
            raise PlanError(
                f"the slightest motion exceeds a limit: the {beyond.limit} of {beyond.of} would "
                f"have to give {quantity(-beyond.left, beyond.unit)}"
            )
        return kept
