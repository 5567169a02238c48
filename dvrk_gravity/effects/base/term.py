"""What a physical term of a torque model is: parameters with units, and a torque at a state."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, Tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect
from dvrk_gravity.effects.base.joint_dynamics import JointDynamics
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.polynomials import JointPolynomials, Range
from dvrk_gravity.parameters import Parameter, Value

Evaluator = Callable[[Array, "Array | None"], Array]
"""Torque (n,) of one sample from positions (n,) and velocities (n,), ``None`` where unknown."""

SLOWEST = 1e-6
"""rad/s, below which :func:`secant_damping` releases: 3 milliradians in an hour."""


class FrictionWithMemory(Protocol):
    """Friction whose torque depends on the path; it belongs to one plant."""

    def torque(self, qd: Array) -> tuple[Array, Array]:
        """Return the friction at (n,) velocities, (n,) N·m, and its stiffness, (n, n) N·m/rad.

        The stiffness is symmetric and positive semidefinite.
        """

    def go(self, way: Array) -> None:
        """Follow the joints along (n,) rad."""

    def reset(self) -> None:
        """Forget the path."""


@dataclass(frozen=True, eq=False)
class PlantPart:
    """How a simulator integrates an effect; each attribute is optional.

    Torques are those that the actuators apply; friction is positive along the motion. For a step of
    length h from (q, v) to the velocity v+:

    Attributes:
        at: (q, v), each (n,), -> smooth torque (n,) at the step's beginning, N·m, and a level of
            dry friction at the joints (n,), not negative, N·m, the same in both directions, or
            ``None``.
        weight: Tree whose gravity torques are a smooth torque at q.
        links: Bodies that links carry, by link, each in the link's frame.
        rotors: (n,) reflected inertia at the motors, kg·m^2 (kg), which is the plant's.
        damping: (n, n) symmetric, positive semidefinite, N·m·s/rad: torque damping v+.
        dry: (2, 2 n) levels of dry friction, N·m, moving up and moving down: at the joints, then
            at the motors. Up to its level it holds a joint still; beyond that it is constant.
        fade: (n,) v -> (2 n,) fraction of ``dry`` left at this velocity, 0 to 1.
        drag: (q, v), each (n,), -> torque (n,) taken explicitly, and damping (n, n), symmetric and
            positive semidefinite: torque damping v+ beside it.
        memory: Friction that depends on the path; in the step it is torque + h stiffness v+. A new
            one with every call of :meth:`Term.plant`.
        reading: (q, v), each (n,), -> (n,) N·m by which the measured effort exceeds the applied
            one: the arm does not feel it.
    """

    at: Callable[[Array, Array], tuple[Array, Array | None]] | None = None
    weight: Tree | None = None
    links: Mapping[str, pin.Inertia] = field(default_factory=dict)
    rotors: Array | None = None
    damping: Array | None = None
    dry: Array | None = None
    fade: Callable[[Array], Array] | None = None
    drag: Callable[[Array, Array], tuple[Array, Array]] | None = None
    memory: FrictionWithMemory | None = None
    reading: Callable[[Array, Array], Array] | None = None


class Term(Effect):
    """One named physical cause of torque: an effect that models contain.

    Torques are those that the *actuators* apply, in joint space: a static arm reads ``g(q)``, and
    friction is positive along the motion. A minimal term has four methods: :meth:`schema`,
    :meth:`from_parameters`, :meth:`parameters` and :meth:`torque`.

    Class attributes:
        FRICTION: Dissipative: the compensator scales it by its friction ratio, with
            :meth:`scaled`.
        EVERYWHERE: Every arm has it at each joint, even if its file does not mention it.
        COMPENSATED: The compensator applies it; off for what needs the past of the motion or
            belongs to a sensor.
        AT_POSES: Static poses determine it.
        WEIGHT_OF_ARM: The arm's own weight, without which nothing is compensated.
        OF_LINKS: How many of each link's ten inertial parameters, in Pinocchio's order, its
            coefficients are; 0: they are something else.
        OF_POSITION: It depends on where the joints are, and not only on how they move.
        OF_OTHERS: It depends on the torque of the model's other terms (:meth:`with_terms`): a fit
            tries it once it has these.
        NOT_FITTED: Why trajectories are not fitted with it, for whoever asks for that.
    """

    FRICTION: ClassVar[bool] = False
    EVERYWHERE: ClassVar[bool] = False
    COMPENSATED: ClassVar[bool] = True
    AT_POSES: ClassVar[bool] = False
    WEIGHT_OF_ARM: ClassVar[bool] = False
    OF_LINKS: ClassVar[int] = 0
    OF_POSITION: ClassVar[bool] = True
    OF_OTHERS: ClassVar[bool] = False
    NOT_FITTED: ClassVar[str] = ""

    @classmethod
    @abstractmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        """Return the declarations of all parameters that the effect has in an arm's files."""

    @classmethod
    @abstractmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Term | None:
        """Build the term from checked values; ``None``: they do not mention it.

        Raises:
            ConfigError: The values contradict each other.
        """

    @abstractmethod
    def parameters(self) -> dict[str, Value]:
        """Return the values that :meth:`from_parameters` would take."""

    @abstractmethod
    def torque(self, state: State) -> Array:
        """Return (…, n) joint torques, N·m (N where a joint slides)."""

    def torque_given(self, state: State, others: Mapping[int, Array]) -> Array:
        """Return :meth:`torque` where (…, n) torques of other terms are known, by their ``id``."""
        return self.torque(state)

    def momentum(self, q: Array, qd: Array) -> tuple[Array, Array] | None:
        """Return momentum and slope of the kinetic energy of what the term moves.

        Where it has inertia, its torque is that at rest plus dp/dt - slope, with p its generalised
        momentum. ``None``: it has none, and its torque does not depend on acceleration.

        Args:
            q: (N, n) positions.
            qd: (N, n) velocities.

        Returns:
            (N, n) momenta, N·m·s, and (N, n) slopes, N·m; see ``rigid_body.momentum``.
        """
        return None

    def with_terms(self, terms: Sequence[Term]) -> Term:
        """Return the term in a model with others; the same unless it depends on their torque."""
        return self

    # What files of other programs can hold.
    @property
    def gravity_beta(self) -> Array | None:
        """(10,) or more base parameters of gravity, N·m, if its torque is gY(q) beta."""
        return None

    @property
    def polynomials(self) -> JointPolynomials | None:
        """Its torque, if that is a polynomial of each joint's own position."""
        return None

    @property
    def fitted_range(self) -> Range | None:
        """Positions on which it was fitted; ``None``: not stated."""
        return None if self.polynomials is None else self.polynomials.valid

    @property
    def inertial_parameters(self) -> Array | None:
        """(bodies, 10) of what it has of rigid bodies, in their joints' frames; ``None``: nothing.

        In Pinocchio's order: m kg, m c (3) kg·m, Ixx, Ixy, Iyy, Ixz, Iyz, Izz kg·m^2.
        """
        return None

    def joint_dynamics(self, arm: Arm, q: Array) -> JointDynamics | None:
        """Return the nearest torque that a URDF or an MJCF can hold; ``None``: they hold nothing.

        Args:
            arm: The arm.
            q: (N, n) true positions, evenly over the range that the model is good for.
        """
        return None

    # Without a measurement.
    @classmethod
    def nominal(cls, arm: Arm) -> Term | None:
        """Return the term to simulate an arm with of which only its own file is known."""
        return None

    @classmethod
    def from_arm(cls, arm: Arm) -> Term | None:
        """Return the term that the arm's own file states."""
        return None

    @classmethod
    def drawn(cls, arm: Arm, random: np.random.Generator, part: float) -> Term | None:
        """Return what an arm has that differs from the next, drawn; ``None``: it is not drawn.

        Args:
            arm: The arm.
            random: What it is drawn from.
            part: Greatest coefficient, as a part of each joint's effort limit.
        """
        return None

    # Compensated.
    def scaled(self, part: Array) -> Term:
        """Return the friction with (n,) fractions left at each joint and its motor.

        Raises:
            NotImplementedError: The effect is no friction.
        """
        raise NotImplementedError(f"{self.NAME} is no friction")

    def whole(self) -> Term:
        """Return the term as physics, not only the compensated part of it."""
        return self

    def split(self, part: Array) -> tuple[Term | None, Term | None]:
        """Return what a compensator applies: the term without friction, and (n,) parts of friction.

        The first is applied as at rest: a compensator leaves inertia to the hand.
        """
        return (None, self.scaled(part)) if self.FRICTION else (self, None)

    def friction_part(self, part: Array) -> Array:
        """Return (n,) the fraction of its friction that :meth:`split` leaves."""
        return part if self.FRICTION else np.zeros_like(part)

    @property
    def carries_arm(self) -> bool:
        """Whether it holds the arm itself up against gravity."""
        return False

    @property
    def gravity_vector(self) -> Array | None:
        """(3,) gravity in the base frame that it is computed with, m/s^2; ``None``: no weight."""
        return None

    @property
    def full_speed(self) -> Array | None:
        """(n,) speeds above which a friction that is smoothed about zero is complete."""
        return None

    def with_gravity(self, vector: Array) -> Term:
        """Return the term with another gravity in the base frame; no change without weight."""
        return self

    def prepare(self) -> Evaluator:
        """Return an evaluator of one sample, equal to :meth:`torque` but faster.

        Without friction it may be the torque at rest, which is what a compensator applies.
        """
        return lambda q, qd: self.torque(State(q, qd))

    def prepare_parts(self, part: Array) -> Evaluator | None:
        """Return an evaluator of both parts of :meth:`split`, (2, n), if the term has both."""
        return None

    # Simulated.
    def plant(self) -> PlantPart:
        """Return how a simulator integrates the effect.

        By default friction is integrated by :func:`secant_damping`, stable at any step, and
        everything else explicitly.
        """
        if self.FRICTION:
            return PlantPart(drag=secant_damping(lambda q, qd: self.torque(State(q, qd))))
        return PlantPart(at=lambda q, qd: (self.torque(State(q, qd)), None))


def secant_damping(
    torque: Callable[[Array, Array], Array],
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Return the drag of a friction of which only its torque is known, for :class:`PlantPart`.

    At (q, v) the friction f(q, v) is written as f = D v, with D symmetric and positive
    semidefinite, and applied as D v+ at the step's end. As v+ D v+ is never negative, it takes
    energy from every step, however long: it cannot make the arm oscillate, which an explicit f
    does once h df/dv exceeds twice the inertia. For h -> 0 it is f.

    - Where every joint's friction opposes its own motion, D is diagonal, f_j / v_j.
    - Where it couples joints, D = f f' / (f' v), the only symmetric rank-one D with D v = f.
    - A torque that takes no power from the motion is no friction at this state: it is taken
      explicitly.

    D has an upper bound, so that a friction that jumps with the sign of the velocity sticks as a
    creep slower than :data:`SLOWEST`; an effect that is to stand still, and break away at once,
    gives its levels as :attr:`PlantPart.dry`.

    Args:
        torque: (q, v), each (n,), -> friction (n,), N·m, positive along the motion.
    """

    def drag(q: Array, v: Array) -> tuple[Array, Array]:
        friction = torque(q, v)
        power = friction * v
        if not np.count_nonzero(friction[power <= 0.0]):
            return np.zeros(len(v)), np.diag(power / (v * v + SLOWEST**2))
        total = float(power.sum())
        if total <= 0.0:
            return friction, np.zeros((len(v), len(v)))
        least = SLOWEST * float(np.linalg.norm(friction))
        return np.zeros(len(v)), np.outer(friction, friction) / max(total, least)

    return drag
