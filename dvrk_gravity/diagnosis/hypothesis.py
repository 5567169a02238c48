"""A named physical hypothesis: an effect on some joints, with its few columns of torque."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES
from dvrk_gravity.diagnosis.motion import Motion

Array = NDArray[np.float64]
Build = Callable[[Motion, Mapping[str, float]], Array]
Describe = Callable[[Array, Mapping[str, float]], dict[str, float]]

# How readily a cause is believed when the data cannot tell it from another: lower is readier.
RANK = {
    name: rank
    for rank, name in enumerate(
        (
            "wrong_coordinates", "coulomb_friction", "viscous_friction", "torque_offset",
            "elastic_cable", "payload", "link_com", "joint_offset", "base_tilt", "torque_scale",
            "rotor_inertia", "link_inertia", "time_delay", "stribeck_friction",
            "presliding_hysteresis", "thermal_drift", "effort_saturation", "joint_coupling",
            "cogging", "contact", "unknown",
        )
    )
}  # fmt: skip

OF_LINKS = ("payload", "link_com", "link_inertia")
"""Effects that are named after a link, and carried by all joints before it."""

UNITS = {
    "mass": "kg", "first_moment_x": "kg·m", "first_moment_y": "kg·m", "first_moment_z": "kg·m",
    "roll": "rad", "pitch": "rad", "offset": "", "factor": "", "positive": "N·m",
    "negative": "N·m", "coefficient": "N·m·s/rad", "level": "N·m",
    "coulomb": "N·m", "lowest": "N·m", "highest": "N·m", "velocity": "rad/s",
    "length": "rad", "stiffness": "N·m/rad", "delay": "s",
    "torque": "N·m", "time_constant": "s", "limit": "N·m", "amplitude": "N·m",
    "cycles_per_revolution": "1/rev", "phase": "rad", "start": "s", "end": "s",
    "position": "rad", "side": "", "sign": "", "rms": "N·m",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One effect on one place, at one setting of its non-linear parameters.

    Attributes:
        effect: Name in the vocabulary, or ``unknown``.
        joints: Indices of the joints that it is said of, the affected one first.
        place: Where: ``joint``, ``motor``, a link, a form of the effect.
        build: (motion, setting) -> (N, 7, k) columns of torque, N·m per unit of each parameter.
        describe: (k,) parameters and the setting -> named values.
        setting: Non-linear parameters, by name.
        relative_steps: Names of settings that may be refined by a continuous search.
        fixed_point: Name of a setting whose best value is what ``describe`` returns under the
            same name: the columns are rebuilt there.
        variable: What the torque is a function of, for the picture: ``position``, ``velocity``,
            ``acceleration`` or ``time``.
        plausible_size: (k,) standard deviations that parameters of the model itself may have, which
            move along beside others; empty for claims, which no prior holds back.
        least: Smallest values that parameters of this one can have, by name.
        prior_count: How many more hypotheses it stands for (the grid of a search), at least 1.
    """

    effect: str
    joints: tuple[int, ...]
    place: str
    build: Build
    describe: Describe
    setting: Mapping[str, float] = field(default_factory=dict)
    refine: tuple[str, ...] = ()
    fixed_point: tuple[str, ...] = ()
    variable: str = "position"
    prior_count: int = 1
    least: Mapping[str, float] = field(default_factory=dict)
    plausible_size: tuple[float, ...] = ()

    @property
    def key(self) -> tuple[str, tuple[int, ...], str]:
        """What it claims, its continuous settings apart."""
        return self.effect, self.joints, self.place

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(JOINT_NAMES[joint] for joint in self.joints)

    def __str__(self) -> str:
        """Return the claim in words."""
        where = " and ".join(self.names) or "the arm"
        detail = "" if self.place in ("joint", "") else f" ({self.place})"
        return f"{self.effect} at {where}{detail}"


def unit_of(effect: str, name: str) -> str:
    """Return the unit of a parameter of an effect."""
    if name == "offset":
        return "N·m" if effect == "torque_offset" else "rad"
    if effect == "contact" and name == "stiffness":
        return "N·m/rad"
    if name.startswith("k") and name[1:].isdigit():
        return "N·m" if name == "k0" else f"N·m/rad^{name[1:]}"
    if name.startswith("delta_beta"):
        return "N·m"
    if name.startswith("inertia"):
        return "kg·m^2"
    return UNITS.get(name, "")


# What a parameter can be; outside, the effect is a name for something else.
_PLAUSIBLE: Mapping[tuple[str, str], tuple[float, float]] = {
    ("torque_scale", "factor"): (0.2, 5.0),
    ("effort_saturation", "share"): (0.6, 1.4),
    ("presliding_hysteresis", "level"): (0.0, np.inf),
    ("stribeck_friction", "level"): (0.0, np.inf),
    ("payload", "mass"): (0.0, 5.0),
    ("joint_offset", "offset"): (-0.6, 0.6),
    ("base_tilt", "roll"): (-0.6, 0.6),
    ("base_tilt", "pitch"): (-0.6, 0.6),
    ("time_delay", "delay"): (-0.3, 0.3),
}


_DRIVES = 0.3  # of the larger level, within which the smaller may be below zero by chance


def plausible(hypothesis: Hypothesis, theta: Array) -> bool:
    """Tell whether a hypothesis can have (k,) such parameters.

    A scale near zero, a friction that drives, a weight that lifts: a fit that asks for these
    has found something else.
    """
    values = hypothesis.describe(theta, hypothesis.setting)
    if hypothesis.effect == "coulomb_friction":
        # Friction that drives one way and brakes the other is an offset beside friction.
        up, down = values["positive"], values["negative"]
        if up * down < 0.0 and min(abs(up), abs(down)) > _DRIVES * max(abs(up), abs(down)):
            return False
    for name, value in values.items():
        low, high = _PLAUSIBLE.get((hypothesis.effect, name), (-np.inf, np.inf))
        if not max(low, hypothesis.least.get(name, -np.inf)) <= value <= high:
            return False
    return True
