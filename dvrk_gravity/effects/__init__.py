"""Effects, one file each; a torque model is the sum of those that are terms.

Their order is how readily a cause is believed when the data cannot tell it from another: the
earlier is the more parsimonious. Effects from outside the package are registered by
:func:`register`, or by their package's entry point in the group ``dvrk_gravity.effects``.
"""

from __future__ import annotations

from functools import cache

from dvrk_gravity.effects.base_tilt import BaseTilt
from dvrk_gravity.effects.cogging import Cogging
from dvrk_gravity.effects.contact import Contact
from dvrk_gravity.effects.coulomb_friction import CoulombFriction
from dvrk_gravity.effects.directional_cable import DirectionalCable
from dvrk_gravity.effects.effect import Effect, Hypothesis
from dvrk_gravity.effects.effort_saturation import EffortSaturation
from dvrk_gravity.effects.elastic_cable import ElasticCable
from dvrk_gravity.effects.gravity import Gravity
from dvrk_gravity.effects.held_load import HeldLoad
from dvrk_gravity.effects.joint_coupling import JointCoupling
from dvrk_gravity.effects.joint_offset import JointOffset
from dvrk_gravity.effects.link_com import LinkCom
from dvrk_gravity.effects.link_inertia import LinkInertia
from dvrk_gravity.effects.link_weight import LinkWeight
from dvrk_gravity.effects.payload import Payload
from dvrk_gravity.effects.plant_part import FrictionWithMemory, PlantPart
from dvrk_gravity.effects.presliding_hysteresis import PreslidingHysteresis
from dvrk_gravity.effects.rotor_inertia import RotorInertia
from dvrk_gravity.effects.shown_torque import ShownTorque
from dvrk_gravity.effects.stribeck_friction import StribeckFriction
from dvrk_gravity.effects.term import LinearTerm, State, Term
from dvrk_gravity.effects.thermal_drift import ThermalDrift
from dvrk_gravity.effects.time_delay import TimeDelay
from dvrk_gravity.effects.torque_offset import TorqueOffset
from dvrk_gravity.effects.torque_scale import TorqueScale
from dvrk_gravity.effects.unknown import Unknown
from dvrk_gravity.effects.viscous_friction import ViscousFriction
from dvrk_gravity.effects.wrong_coordinates import WrongCoordinates

ENTRY_POINTS = "dvrk_gravity.effects"
_effects: list[type[Effect]] = [
    Gravity,
    LinkWeight,
    WrongCoordinates,
    CoulombFriction,
    ViscousFriction,
    TorqueOffset,
    ElasticCable,
    DirectionalCable,
    Payload,
    LinkCom,
    JointOffset,
    BaseTilt,
    TorqueScale,
    RotorInertia,
    LinkInertia,
    TimeDelay,
    StribeckFriction,
    PreslidingHysteresis,
    ThermalDrift,
    EffortSaturation,
    JointCoupling,
    Cogging,
    Contact,
    HeldLoad,
    ShownTorque,
    Unknown,
]


def register(effect: type[Effect]) -> type[Effect]:
    """Make an effect from outside the package known to all who use effects.

    It is believed less readily than those of the package. May decorate the effect's class.

    Raises:
        ValueError: Another effect has its name.
    """
    known = _effect_by_name().get(effect.NAME)
    if known is effect:
        return effect
    if known is not None:
        raise ValueError(f"effect {effect.NAME!r} is registered already, by {known.__module__}")
    _effects.insert(_effects.index(Unknown), effect)
    _effect_by_name.cache_clear()
    return effect


def effects() -> tuple[type[Effect], ...]:
    """Return all effects, those of installed packages among them, the most readily believed first.

    Raises:
        ValueError: Two with one name.
    """
    _load_entry_points()
    return tuple(_effects)


def terms() -> tuple[type[Term], ...]:
    """Return the effects that are terms of a torque model."""
    return tuple(effect for effect in effects() if issubclass(effect, Term))


def named(name: str) -> type[Effect]:
    """Return the effect of a name.

    Raises:
        KeyError: There is none.
    """
    effects()
    return _effect_by_name()[name]


def rank(name: str) -> int:
    """Return how readily an effect is believed: the lower, the more readily."""
    return effects().index(named(name))


@cache
def _effect_by_name() -> dict[str, type[Effect]]:
    return {effect.NAME: effect for effect in _effects}


@cache
def _load_entry_points() -> None:
    from importlib.metadata import entry_points

    for entry in entry_points(group=ENTRY_POINTS):
        register(entry.load())


__all__ = [
    "BaseTilt",
    "Cogging",
    "Contact",
    "CoulombFriction",
    "DirectionalCable",
    "Effect",
    "ElasticCable",
    "FrictionWithMemory",
    "Gravity",
    "HeldLoad",
    "Hypothesis",
    "LinearTerm",
    "LinkInertia",
    "LinkWeight",
    "Payload",
    "PlantPart",
    "PreslidingHysteresis",
    "RotorInertia",
    "ShownTorque",
    "State",
    "StribeckFriction",
    "Term",
    "TorqueOffset",
    "ViscousFriction",
    "effects",
    "named",
    "rank",
    "register",
    "terms",
]
