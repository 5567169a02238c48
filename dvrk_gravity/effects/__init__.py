"""Effects, one file each; a torque model is the sum of those that are terms.

Their order is how readily a cause is believed when the data cannot tell it from another: the
earlier is the more parsimonious. Effects from outside the package are registered by
:func:`register`, or by their package's entry point in the group ``dvrk_gravity.effects``; they are
believed less readily than those of the package.
"""

from __future__ import annotations

from dvrk_gravity.effects.base.arrays import as_array, as_value, diagonal_columns, joint_array
from dvrk_gravity.effects.base.by_joint import write_rows
from dvrk_gravity.effects.base.effect import (
    MAX_REMOVED,
    Effect,
    Hypothesis,
    Setting,
    Values,
    compared_with,
    spread,
)
from dvrk_gravity.effects.base.evidence import Motion, Residual
from dvrk_gravity.effects.base.late import mean_slope_by_delay
from dvrk_gravity.effects.base.link_prior import (
    base_directions,
    beta_map,
    link_sizes,
    prior_scale,
    samples,
    weight_directions,
)
from dvrk_gravity.effects.base.links import (
    identifiable_links,
    joint_of_link,
    joints_with_weight,
    last_link,
    links_of_joints,
)
from dvrk_gravity.effects.base.meaning import MORE, Estimate, meanings, size
from dvrk_gravity.effects.base.merging import added
from dvrk_gravity.effects.base.plant_part import (
    SLOWEST,
    FrictionWithMemory,
    PlantPart,
    secant_damping,
)
from dvrk_gravity.effects.base.polynomial import MAX_DEGREE, Range, evaluate
from dvrk_gravity.effects.base.registry import (
    ENTRY_POINTS,
    effects,
    from_other_packages,
    is_friction,
    named,
    rank,
    register,
    terms,
)
from dvrk_gravity.effects.base.rigid_body import OF_WEIGHT, PER_LINK
from dvrk_gravity.effects.base.site import THE_ARM, THE_BASE, Kind, Site
from dvrk_gravity.effects.base.state import State
from dvrk_gravity.effects.base.supposed import assumed_inertias, assumed_rotors
from dvrk_gravity.effects.base.term import Evaluator, LinearTerm, Term, Unknowns
from dvrk_gravity.effects.base.unknowns import PRIOR_FRACTION, Column, ColumnTable, ModelChange
from dvrk_gravity.effects.base_tilt import MAX_TILT, BaseTilt, ChangesModelTorque
from dvrk_gravity.effects.cogging import Cogging, RippleHypothesis
from dvrk_gravity.effects.contact import Contact, PushHypothesis, WallHypothesis, push_window
from dvrk_gravity.effects.coulomb_friction import AllFrictionHypothesis, CoulombFriction
from dvrk_gravity.effects.directional_cable import DirectionalCable
from dvrk_gravity.effects.effort_saturation import EffortSaturation
from dvrk_gravity.effects.elastic_cable import CableHypothesis, ElasticCable
from dvrk_gravity.effects.gravity import Gravity
from dvrk_gravity.effects.held_load import HeldLoad, pose_functions
from dvrk_gravity.effects.joint_coupling import JointCoupling
from dvrk_gravity.effects.joint_offset import JointOffset
from dvrk_gravity.effects.link_com import LinkCom
from dvrk_gravity.effects.link_inertia import LinkInertia
from dvrk_gravity.effects.link_weight import LinkWeight
from dvrk_gravity.effects.payload import Payload, PayloadHypothesis
from dvrk_gravity.effects.presliding_hysteresis import PreslidingHypothesis, PreslidingHysteresis
from dvrk_gravity.effects.rotor_inertia import RotorInertia
from dvrk_gravity.effects.shown_torque import ShownTorque
from dvrk_gravity.effects.stribeck_friction import StribeckFriction
from dvrk_gravity.effects.thermal_drift import ThermalDrift
from dvrk_gravity.effects.time_delay import (
    AbsorbedByModel,
    DelayHypothesis,
    OwnTangent,
    RequiresParts,
    TimeDelay,
    TwoForms,
)
from dvrk_gravity.effects.time_scale import TimeScale
from dvrk_gravity.effects.torque_offset import OffsetHypothesis, TorqueOffset
from dvrk_gravity.effects.torque_scale import TorqueScale
from dvrk_gravity.effects.unknown import Unknown, unexplained_structure
from dvrk_gravity.effects.velocity_scale import UNITS, VelocityScale
from dvrk_gravity.effects.viscous_friction import ViscousFriction, ViscousHypothesis
from dvrk_gravity.effects.wrong_coordinates import Reading, WrongCoordinates, readings

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
    JointCoupling,
    Cogging,
    Contact,
    HeldLoad,
    ShownTorque,
    Unknown,
):
    register(_effect)

__all__ = [
    "ENTRY_POINTS",
    "MAX_DEGREE",
    "MAX_REMOVED",
    "MAX_TILT",
    "MORE",
    "OF_WEIGHT",
    "PER_LINK",
    "PRIOR_FRACTION",
    "SLOWEST",
    "THE_ARM",
    "THE_BASE",
    "UNITS",
    "AbsorbedByModel",
    "AllFrictionHypothesis",
    "BaseTilt",
    "CableHypothesis",
    "ChangesModelTorque",
    "Cogging",
    "Column",
    "ColumnTable",
    "Contact",
    "CoulombFriction",
    "DelayHypothesis",
    "DirectionalCable",
    "Effect",
    "ElasticCable",
    "Estimate",
    "Evaluator",
    "FrictionWithMemory",
    "Gravity",
    "HeldLoad",
    "Hypothesis",
    "Kind",
    "LinearTerm",
    "LinkInertia",
    "LinkWeight",
    "ModelChange",
    "Motion",
    "OffsetHypothesis",
    "OwnTangent",
    "Payload",
    "PayloadHypothesis",
    "PlantPart",
    "PreslidingHypothesis",
    "PreslidingHysteresis",
    "PushHypothesis",
    "Range",
    "Reading",
    "RequiresParts",
    "Residual",
    "RippleHypothesis",
    "RotorInertia",
    "Setting",
    "ShownTorque",
    "Site",
    "State",
    "StribeckFriction",
    "Term",
    "TorqueOffset",
    "TwoForms",
    "Unknowns",
    "Values",
    "ViscousFriction",
    "ViscousHypothesis",
    "WallHypothesis",
    "added",
    "as_array",
    "as_value",
    "assumed_inertias",
    "assumed_rotors",
    "base_directions",
    "beta_map",
    "compared_with",
    "diagonal_columns",
    "effects",
    "evaluate",
    "from_other_packages",
    "identifiable_links",
    "is_friction",
    "joint_array",
    "joint_of_link",
    "joints_with_weight",
    "last_link",
    "link_sizes",
    "links_of_joints",
    "mean_slope_by_delay",
    "meanings",
    "named",
    "pose_functions",
    "prior_scale",
    "push_window",
    "rank",
    "readings",
    "register",
    "samples",
    "secant_damping",
    "size",
    "spread",
    "terms",
    "unexplained_structure",
    "weight_directions",
    "write_rows",
]
