"""How a simulator integrates an effect: what each kind of torque asks of a time step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Tree
from dvrk_gravity.arrays import Array

SLOWEST = 1e-6
"""rad/s, below which :func:`secant_damping` lets go: 3 milliradians in an hour."""


class FrictionWithMemory(Protocol):
    """Friction whose torque depends on the way that was gone; it belongs to one plant."""

    def torque(self, qd: Array) -> tuple[Array, Array]:
        """Return the friction at (n,) velocities, (n,) N·m, and its stiffness, (n, n) N·m/rad.

        The stiffness is symmetric and has no negative eigenvalue.
        """

    def go(self, way: Array) -> None:
        """Follow the joints along (n,) rad."""

    def reset(self) -> None:
        """Forget the way."""


@dataclass(frozen=True, eq=False)
class PlantPart:
    """What an effect does to a simulated arm; all that is not given is nothing.

    Torques are those that the actuators apply; friction counts positive along the motion. For a
    step of length h from (q, v) to the velocity v+:

    Attributes:
        at: (q, v), each (n,), -> smooth torque (n,) at the step's beginning, N·m, and a level of
            dry friction at the joints (n,), not negative, N·m, the same both ways, or ``None``.
        weight: Tree whose gravity torques are a smooth torque at q.
        links: Bodies that links carry, by link, each in the link's frame.
        damping: (n, n) symmetric, without negative eigenvalues, N·m·s/rad: torque damping v+.
        dry: (2, 2 n) levels of dry friction, N·m, moving up and moving down: at the joints, then
            at the motors. Up to its level it holds still what rubs; beyond that it is constant.
        fade: (n,) v -> (2 n,) part of ``dry`` that is left at this velocity, 0 to 1.
        drag: (q, v), each (n,), -> torque (n,) taken as it is, and damping (n, n), symmetric and
            without negative eigenvalues: torque damping v+ beside it.
        memory: Friction that depends on the way; in the step it is torque + h stiffness v+. A new
            one with every call of :meth:`dvrk_gravity.effects.Term.plant`.
        reading: (q, v), each (n,), -> (n,) N·m by which the measured effort is more than the
            applied one: the arm does not feel it.
    """

    at: Callable[[Array, Array], tuple[Array, Array | None]] | None = None
    weight: Tree | None = None
    links: Mapping[str, pin.Inertia] = field(default_factory=dict)
    damping: Array | None = None
    dry: Array | None = None
    fade: Callable[[Array], Array] | None = None
    drag: Callable[[Array, Array], tuple[Array, Array]] | None = None
    memory: FrictionWithMemory | None = None
    reading: Callable[[Array, Array], Array] | None = None


def secant_damping(
    torque: Callable[[Array, Array], Array],
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Return the drag of a friction of which only its torque is known, for :class:`PlantPart`.

    At (q, v) the friction f(q, v) is written as f = D v, with D symmetric and without negative
    eigenvalues, and taken as D v+ at the step's end. As v+ D v+ is never negative, it takes
    energy from every step, however long: it cannot set the arm swinging, which an explicit f
    does as soon as h df/dv exceeds twice the inertia. For h -> 0 it is f.

    - Where every joint's friction is against its own motion, D is diagonal, f_j / v_j.
    - Where it couples joints, D = f f' / (f' v), the only symmetric rank-one D with D v = f.
    - A torque that takes no power from the motion is no friction at this state: it is taken as
      it is.

    D has an upper bound, so that a friction that jumps with the sign of the velocity sticks as a
    creep slower than :data:`SLOWEST`; if it is to stand still, and break away at once, its effect
    has to give its levels as :attr:`PlantPart.dry`.

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
