"""Effects, one file each; a torque model is the sum of those that are terms.

The effect of a file is the class whose ``NAME`` is the file's. Effects from outside the package are
registered by :func:`register`, or by their package's entry point in the group
``dvrk_gravity.effects``.
"""

from importlib import import_module

from dvrk_gravity.effects.base import registry
from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)

# The commonest first: of causes with as few parameters that data cannot separate, the earlier one
# is named. Effects from outside come after these.
_BY_COMMONNESS = (
    "gravity", "link_weight", "wrong_coordinates", "time_scale", "velocity_scale",
    "coulomb_friction", "viscous_friction", "torque_offset", "elastic_cable", "directional_cable",
    "payload", "link_com", "joint_offset", "base_tilt", "torque_scale", "rotor_inertia",
    "link_inertia", "time_delay", "stribeck_friction", "presliding_hysteresis", "thermal_drift",
    "effort_saturation", "torque_saturation", "encoder_scale", "joint_flexibility",
    "joint_coupling", "joint_spring", "cogging", "contact", "held_load", "shown_torque",
    "load_friction", "unknown",
)  # fmt: skip

for _name in _BY_COMMONNESS:
    _module = vars(import_module(f"{__name__}.{_name}"))
    registry.register(next(e for e in _module.values() if getattr(e, "NAME", None) == _name))
