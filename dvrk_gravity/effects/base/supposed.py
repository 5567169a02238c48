"""What is supposed of an arm of which nothing was measured, to simulate it."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.link_prior import link_sizes
from dvrk_gravity.effects.base.site import Kind
from dvrk_gravity.effects.base.unknowns import unit_way


@dataclass(frozen=True)
class Supposed:
    """Friction and rotors, as parts of a joint's or motor's largest effort.

    Attributes:
        coulomb: Of dry friction. Chosen: what static poses of a real MTM leave beside its
            calibrated model, mostly dry friction, is 0.004 to 0.19 of its joints' limits, RMS.
        viscous: Of viscous friction at 1 rad/s, or as much where the joint slides (``Arm.scale``).
            Chosen.
        rotor: What the rotor takes for 1 rad/s^2: of the MTM's in ``config/plants`` it is 0.0004 to
            0.0023.
    """

    coulomb: float = 0.02
    viscous: float = 0.01
    rotor: float = 0.002


SUPPOSED = Supposed()


def assumed_inertias(arm: Arm) -> dict[str, pin.Inertia]:
    """Return inertias of an arm's bodies, in their link frames.

    The nominal ones of its file, if it brings some (a URDF); or spheres about the links' origins,
    of :func:`~dvrk_gravity.effects.base.link_prior.link_sizes`.
    """
    return nominal_inertias(arm) or {
        name: pin.Inertia.FromSphere(mass, extent)
        for name, (mass, extent) in zip(arm.body_names, link_sizes(arm), strict=True)
    }


def assumed_rotors(arm: Arm) -> Array:
    """Return (n,) reflected inertia of rotors, kg·m^2 (kg)."""
    return SUPPOSED.rotor * arm.actuator_effort_limit / unit_way(arm, Kind.MOTOR)
