"""Forward dynamics of the arm: Pinocchio's tree, the model's terms, friction that sticks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from dvrk_gravity.arms import build_tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import PlantPart
from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate.effects import Effects
from dvrk_gravity.simulate.friction import FrictionSolver

# Impulse that a stop can give, N·m·s or N·s: more than any motion of the arm can ask for.
_STOP = 1e6
_POSES = 20  # at which the mass matrix is looked at. Chosen


class Plant:
    """A simulated arm, at a position and a velocity.

    A step is semi-implicit Euler: the acceleration from the forces at (q, v), viscous and dry
    friction at the end of the step, and the position from the new velocity,

        (M + h D + h^2 K) v+ = M v + h (tau - tau_smooth(q, v) - c(q, v~)) + J^T lambda,
        q+ = q + h v+,

    with the damping D and the stiffness K of friction with a memory. The forces act at q, while the
    velocity goes from v to v+: seen at (q, (v + v+) / 2) this is the leapfrog method, of second
    order (Hairer, Lubich and Wanner 2003), if Coriolis torques are those of the velocity there,
    which is extrapolated: v~ = v + (v - v-) / 2. Friction is half a step ahead, so that what sticks
    stands still: a viscosity D seems to be D and an inertia of D h / 2.

    What each term has a part in, its :meth:`dvrk_gravity.effects.Term.plant` says. M and c come
    from the inertia of links, of what they carry and of rotors, with zero gravity: gravity is a
    term of the model, so that a beta identified on a real arm can meet inertia from CAD. Position
    limits are stops without rebound.

    Attributes:
        model: The true terms; their torques are those that the actuators apply.
        parts: What each of them does to the arm and to what its sensors read.
        q: (n,) position, rad.
        v: (n,) velocity, rad/s.
        acted: Position and velocity, (n,) each, at which the last step's forces acted.
        time: Since the beginning, s.
        placed: How often it was put somewhere (:meth:`reset`).
    """

    def __init__(
        self,
        model: TorqueModel,
        links: Mapping[str, pin.Inertia],
        rotors: ArrayLike,
        friction_scale: float = 1.0,
    ) -> None:
        """Build the plant at zero position (or the nearest allowed), at rest.

        Args:
            model: The arm's true terms.
            links: Inertia of each of the arm's bodies, in its link frame (distal DH, URDF);
                those absent weigh nothing.
            rotors: (n,) reflected inertia at the actuators, kg·m^2.
            friction_scale: Factor on every friction, dry and viscous.

        Raises:
            ConfigError: An unknown link, or a mass matrix that is not positive definite.
            ShapeError: ``rotors`` is not (n,).
        """
        inertia = np.asarray(rotors, dtype=float)
        arm = model.arm
        if inertia.shape != (arm.n,):
            raise ShapeError("rotors", inertia.shape, f"({arm.n},)")
        self.model = model
        self.parts = self._parts()
        links = _with_loads(links, self.parts)
        for name in links:
            if name not in arm.body_names:
                raise ConfigError(f"links.{name}", name, f"one of {', '.join(arm.body_names)}")
        self.time, self.placed = 0.0, 0
        self._lower, self._upper = arm.lower, arm.upper
        lowest, highest = arm.range
        self._middle = 0.5 * (lowest + highest)
        half = 0.5 * (highest - lowest) - 1e-9
        # A joint that turns without end has no stops.
        self._half = np.where(np.isfinite(arm.upper - arm.lower), half, np.inf)
        self._tree = build_tree(arm, links, np.zeros(3))
        self._expand = self._tree.expand
        self._gather = np.ascontiguousarray(self._expand.T)
        to_motor = arm.joint_to_actuator
        self._rotors = to_motor.T @ np.diag(inertia) @ to_motor
        self._effects = Effects(arm, self.parts, friction_scale)
        self._damping = self._effects.damping if self._effects.damping.any() else None
        self._dt, self._implicit = 0.0, np.zeros((arm.n, arm.n))
        self._friction = FrictionSolver(self._effects.rows)
        self._evaluated: tuple[Array, Array, Array, Array] | None = None
        self.q = np.clip(np.zeros(arm.n), self._lower, self._upper)
        self.v = np.zeros(arm.n)
        self.acted = self.q, self.v
        self._v_before = self.v
        self._at_stops = self._reaches_stops()
        self._require_inertia()

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Put the arm somewhere, at rest if no velocity is given.

        Args:
            q: (n,) position, rad.
            v: (n,) velocity, rad/s.

        Raises:
            ShapeError: Not (n,).
            ConfigError: Not finite, or a position beyond the joint's limits.
        """
        arm = self.model.arm
        position = np.array(q, dtype=float)
        velocity = np.zeros(arm.n) if v is None else np.array(v, dtype=float)
        for name, array in (("q", position), ("v", velocity)):
            if array.shape != (arm.n,):
                raise ShapeError(name, array.shape, f"({arm.n},)")
            if not np.isfinite(array).all():
                raise ConfigError(name, array.tolist(), "finite numbers")
        for joint, value in zip(arm.joints, position.tolist(), strict=True):
            if not joint.lower <= value <= joint.upper:
                raise ConfigError(
                    f"position of {joint.name}",
                    value,
                    f"{joint.lower:.4g} to {joint.upper:.4g} {joint.unit}",
                )
        self.q, self.v = self.acted = position, velocity
        self.placed += 1
        self._v_before = velocity
        self._at_stops = self._reaches_stops()
        self._friction.reset()
        self._effects.reset()
        self._evaluated = None

    def mass_matrix(self) -> Array:
        """Return the (n, n) inertia at the present position, rotors included, kg·m^2."""
        return self._current_dynamics()[0]

    def smooth_torque(self) -> Array:
        """Return the (n,) torque that balances the arm at rest but for friction, N·m."""
        return self._current_dynamics()[1]

    def step(self, effort: Array, push: Array | None = None, dt: float = 1e-3) -> None:
        """Go one step on.

        Args:
            effort: (n,) torque of the actuators in joint space, N·m.
            push: (n,) torque from outside, N·m.
            dt: Length of the step, s.
        """
        mass, smooth, bounds, tree_q = self._current_dynamics()
        q, v = self.q, self.v
        force = effort - smooth
        if push is not None:
            force += push
        if self._effects.partly_implicit:
            friction, added = self._effects.implicit(q, v, dt)
            force -= friction
        force *= dt
        if np.count_nonzero(v):
            tree = self._tree
            ahead = 1.5 * v - 0.5 * self._v_before
            bias = pin.nonLinearEffects(tree.model, tree.data, tree_q, self._expand.dot(ahead))
            force += mass.dot(v) - dt * self._gather.dot(bias)
        if self._damping is not None:
            if dt != self._dt:
                self._dt, self._implicit = dt, dt * self._damping
            mass = mass + self._implicit
        if self._effects.partly_implicit:
            mass = mass + added
        impulse = dt * bounds
        if self._at_stops:
            impulse[0, : len(q)][q >= self._upper] = -_STOP
            impulse[1, : len(q)][q <= self._lower] = _STOP
        self.v = self._friction.solve(mass, force, impulse)
        self.acted, self._v_before = (q, 0.5 * (v + self.v)), v
        self.q = dt * self.v
        self.q += q
        self._at_stops = self._reaches_stops()
        if self._at_stops:
            self.q = np.minimum(np.maximum(self.q, self._lower), self._upper)
        if self._effects.partly_implicit:
            self._effects.go(self.q - q)
        self.time += dt
        self._evaluated = None

    def _parts(self) -> tuple[PlantPart, ...]:
        """Return the prepared parts of all terms that act on the arm: torque, friction, loads."""
        return tuple(term.plant() for term in self.model.terms)

    def _require_inertia(self) -> None:
        """Refuse links that some motion would take negative work of, at any of some poses."""
        arm, expand = self.model.arm, self._expand
        poses = np.random.default_rng(0).uniform(*arm.range, (_POSES, arm.n))
        for q in (self.q, *poses):
            tree = pin.crba(self._tree.model, self._tree.data, expand.dot(q))
            mass = self._gather.dot(tree).dot(expand) + self._rotors
            least = np.linalg.eigvalsh(mass).min()
            if not least > 0:
                why = f" ({'; '.join(arm.warnings)})" if arm.warnings else ""
                expected = f"a positive mass matrix{why}"
                raise ConfigError("links", f"least eigenvalue {least:g}", expected)

    def _reaches_stops(self) -> bool:
        away = self.q - self._middle
        np.abs(away, out=away)
        # To within round-off: where it matters, the exact limits are compared.
        return bool(np.count_nonzero(away >= self._half))

    def _current_dynamics(self) -> tuple[Array, Array, Array, Array]:
        """Return mass matrix, smooth torque, friction bounds and tree joints, once a step."""
        if self._evaluated is None:
            tree = self._tree
            tree_q = self._expand.dot(self.q)
            mass = self._gather.dot(pin.crba(tree.model, tree.data, tree_q)).dot(self._expand)
            mass += self._rotors
            self._evaluated = (mass, *self._effects.smooth(self.q, self.v), tree_q)
        return self._evaluated


def _with_loads(
    links: Mapping[str, pin.Inertia], parts: tuple[PlantPart, ...]
) -> Mapping[str, pin.Inertia]:
    """Return the links with what they carry."""
    result = dict(links)
    for part in parts:
        for name, body in part.links.items():
            result[name] = result.get(name, pin.Inertia.Zero()) + body
    return result
