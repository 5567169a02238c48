"""Effects, one file each; a torque model is the sum of those that are terms.

Their order is how readily a cause is believed when the data cannot tell it from another: the
earlier is the more parsimonious. Effects from outside the package are registered by
:func:`register`, or by their package's entry point in the group ``dvrk_gravity.effects``; they are
believed less readily than those of the package.
"""

from __future__ import annotations

from dvrk_gravity.effects.base.effect import Effect, Hypothesis
from dvrk_gravity.effects.base.plant_part import FrictionWithMemory, PlantPart
from dvrk_gravity.effects.base.registry import effects, is_friction, named, rank, register, terms
from dvrk_gravity.effects.base.state import State
from dvrk_gravity.effects.base.term import LinearTerm, Term
from dvrk_gravity.effects.base_tilt import BaseTilt
from dvrk_gravity.effects.cogging import Cogging
from dvrk_gravity.effects.contact import Contact
from dvrk_gravity.effects.coulomb_friction import CoulombFriction
from dvrk_gravity.effects.directional_cable import DirectionalCable
from dvrk_gravity.effects.effort_saturation import EffortSaturation
from dvrk_gravity.effects.elastic_cable import ElasticCable
from dvrk_gravity.effects.encoder_scale import EncoderScale
from dvrk_gravity.effects.gravity import Gravity
from dvrk_gravity.effects.held_load import HeldLoad
from dvrk_gravity.effects.joint_coupling import JointCoupling
from dvrk_gravity.effects.joint_offset import JointOffset
from dvrk_gravity.effects.joint_spring import JointSpring
from dvrk_gravity.effects.link_com import LinkCom
from dvrk_gravity.effects.link_inertia import LinkInertia
from dvrk_gravity.effects.link_weight import LinkWeight
from dvrk_gravity.effects.payload import Payload
from dvrk_gravity.effects.presliding_hysteresis import PreslidingHysteresis
from dvrk_gravity.effects.rotor_inertia import RotorInertia
from dvrk_gravity.effects.shown_torque import ShownTorque
from dvrk_gravity.effects.stribeck_friction import StribeckFriction
from dvrk_gravity.effects.thermal_drift import ThermalDrift
from dvrk_gravity.effects.time_delay import TimeDelay
from dvrk_gravity.effects.time_scale import TimeScale
from dvrk_gravity.effects.torque_offset import TorqueOffset
from dvrk_gravity.effects.torque_scale import TorqueScale
from dvrk_gravity.effects.unknown import Unknown
from dvrk_gravity.effects.velocity_scale import VelocityScale
from dvrk_gravity.effects.viscous_friction import ViscousFriction
from dvrk_gravity.effects.wrong_coordinates import WrongCoordinates

for _effect in (
    Gravity,
    LinkWeight,
    WrongCoordinates,
    TimeScale,
    VelocityScale,
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
    EncoderScale,
    JointCoupling,
    JointSpring,
    Cogging,
    Contact,
    HeldLoad,
    ShownTorque,
    Unknown,
):
    register(_effect)

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
    "is_friction",
    "named",
    "rank",
    "register",
    "terms",
]
