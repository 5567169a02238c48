"""Physical terms, one file an effect; a model is their sum."""

from dvrk_gravity.effects.cogging import Cogging
from dvrk_gravity.effects.contact import Contact
from dvrk_gravity.effects.coulomb_friction import CoulombFriction
from dvrk_gravity.effects.directional_cable import DirectionalCable
from dvrk_gravity.effects.elastic_cable import ElasticCable
from dvrk_gravity.effects.gravity import Gravity
from dvrk_gravity.effects.held_load import HeldLoad
from dvrk_gravity.effects.link_inertia import LinkInertia
from dvrk_gravity.effects.payload import Payload
from dvrk_gravity.effects.plant_part import FrictionWithMemory, PlantPart
from dvrk_gravity.effects.presliding_hysteresis import PreslidingHysteresis
from dvrk_gravity.effects.rotor_inertia import RotorInertia
from dvrk_gravity.effects.shown_torque import ShownTorque
from dvrk_gravity.effects.stribeck_friction import StribeckFriction
from dvrk_gravity.effects.term import LinearTerm, State, Term
from dvrk_gravity.effects.torque_offset import TorqueOffset
from dvrk_gravity.effects.viscous_friction import ViscousFriction

TERMS: tuple[type[Term], ...] = (
    Gravity,
    Payload,
    ElasticCable,
    DirectionalCable,
    Cogging,
    Contact,
    CoulombFriction,
    StribeckFriction,
    ViscousFriction,
    LinkInertia,
    RotorInertia,
    PreslidingHysteresis,
    HeldLoad,
    ShownTorque,
    TorqueOffset,
)

__all__ = [
    "TERMS",
    "Cogging",
    "Contact",
    "CoulombFriction",
    "DirectionalCable",
    "ElasticCable",
    "FrictionWithMemory",
    "Gravity",
    "HeldLoad",
    "LinearTerm",
    "LinkInertia",
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
]
