"""Physical terms, one file an effect; a model is their sum."""

from dvrk_gravity.terms.base import State, Term
from dvrk_gravity.terms.coulomb_friction import CoulombFriction
from dvrk_gravity.terms.directional_cable import DirectionalCable
from dvrk_gravity.terms.elastic_cable import ElasticCable
from dvrk_gravity.terms.gravity import Gravity
from dvrk_gravity.terms.viscous_friction import ViscousFriction

TERMS: tuple[type[Term], ...] = (
    Gravity,
    ElasticCable,
    DirectionalCable,
    CoulombFriction,
    ViscousFriction,
)

__all__ = [
    "TERMS",
    "CoulombFriction",
    "DirectionalCable",
    "ElasticCable",
    "Gravity",
    "State",
    "Term",
    "ViscousFriction",
]
