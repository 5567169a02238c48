"""Physical terms, one file an effect; a model is their sum."""

from dvrk_gravity.terms.base import LinearTerm, State, Term
from dvrk_gravity.terms.cogging import Cogging
from dvrk_gravity.terms.contact import Contact
from dvrk_gravity.terms.coulomb_friction import CoulombFriction
from dvrk_gravity.terms.directional_cable import DirectionalCable
from dvrk_gravity.terms.elastic_cable import ElasticCable
from dvrk_gravity.terms.gravity import Gravity
from dvrk_gravity.terms.held_load import HeldLoad
from dvrk_gravity.terms.link_inertia import LinkInertia
from dvrk_gravity.terms.payload import Payload
from dvrk_gravity.terms.presliding_hysteresis import PreslidingHysteresis
from dvrk_gravity.terms.rotor_inertia import RotorInertia
from dvrk_gravity.terms.shown_torque import ShownTorque
from dvrk_gravity.terms.stribeck_friction import StribeckFriction
from dvrk_gravity.terms.torque_offset import TorqueOffset
from dvrk_gravity.terms.viscous_friction import ViscousFriction

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
    "Gravity",
    "HeldLoad",
    "LinearTerm",
    "LinkInertia",
    "Payload",
    "PreslidingHysteresis",
    "RotorInertia",
    "ShownTorque",
    "State",
    "StribeckFriction",
    "Term",
    "TorqueOffset",
    "ViscousFriction",
]
