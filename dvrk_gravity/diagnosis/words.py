"""Findings in a sentence that a person understands."""

from __future__ import annotations

from collections.abc import Mapping

from dvrk_gravity.diagnosis.findings import Estimate, Gain
from dvrk_gravity.diagnosis.hypothesis import Hypothesis

_CLAIMS = {
    "payload": "{joint} carries a payload",
    "base_tilt": "the base is tilted",
    "link_com": "the centre of mass of {joint}'s link is not where the model has it",
    "joint_offset": "the zero of {joint}'s encoder is off",
    "torque_scale": "the effort of {joint} reads on a wrong scale",
    "torque_offset": "the effort of {joint} has a constant offset",
    "coulomb_friction": "{joint} has Coulomb friction that the model lacks",
    "viscous_friction": "{joint} has viscous friction that the model lacks",
    "stribeck_friction": "friction of {joint} falls with speed",
    "presliding_hysteresis": "friction of {joint} builds up over a way after each reversal",
    "rotor_inertia": "{joint} has rotor inertia that the model lacks",
    "link_inertia": "the link of {joint} has another inertia than the model's",
    "joint_coupling": "{other} leaks into {joint}",
    "time_delay": "effort and position are stamped apart",
    "thermal_drift": "the torque of {joint} drifts with time on",
    "effort_saturation": "the effort of {joint} is clipped",
    "cogging": "{joint} has a ripple with the motor's angle",
    "contact": "something outside pushes {joint}",
}
_SCALES = {
    "N·m": (1e3, "mN·m"),
    "N·m/rad": (1e3, "mN·m/rad"),
    "N·m·s/rad": (1e3, "mN·m·s/rad"),
    "kg": (1e3, "g"),
    "kg·m": (1e3, "g·m"),
    "kg·m^2": (1e6, "kg·mm²"),
    "s": (1e3, "ms"),
    "rad": (57.29577951308232, "deg"),
}
_SHOWN = 2


def shown(estimate: Estimate, seconds: bool = False) -> str:
    """Return a value with half its 95 % interval and its unit, as one reads it."""
    factor, unit = _SCALES.get(estimate.unit, (1.0, estimate.unit))
    if seconds and estimate.unit == "s":
        factor, unit = 1.0, "s"
    half = 0.5 * (estimate.high - estimate.low) * factor
    return f"{estimate.value * factor:.3g}±{half:.2g} {unit}".rstrip()


def sentence_of(
    hypothesis: Hypothesis, parameters: Mapping[str, Estimate], gain: Gain, joint: str
) -> str:
    """Return the finding in one sentence, with value, interval and what it removes.

    Args:
        hypothesis: The hypothesis.
        parameters: Its estimates by name.
        gain: Its gain on held-out data.
        joint: The joint whose error falls most.
    """
    names = hypothesis.names or (joint,)
    if not hypothesis.joints and hypothesis.effect in ("link_com", "link_inertia"):
        what = "weights" if hypothesis.effect == "link_com" else "inertias"
        return (
            f"the links' {what} as a whole are others than the model's; fitting them anew beside "
            f"all else removes {100 * gain.relative:.0f} % of the error at {joint}"
        )
    other = names[1] if len(names) > 1 else joint
    where = f"{names[0]}'s motor" if hypothesis.place == "motor" else names[0]
    if hypothesis.place == "all":
        where = "all joints"
    if hypothesis.effect == "elastic_cable" and "lowest" in parameters:
        return (
            f"{names[0]} is pulled by something elastic, from {shown(parameters['lowest'])} to "
            f"{shown(parameters['highest'])} over its way; adding it removes "
            f"{100 * gain.relative:.0f} % of the error at {joint}"
        )
    if hypothesis.effect == "elastic_cable":
        stiffness = parameters["stiffness"]
        kind = "pulls back like" if stiffness.value > 0.0 else "is pushed away as by"
        return (
            f"{names[0]} {kind} a spring of {shown(stiffness)}; adding it removes "
            f"{100 * gain.relative:.0f} % of the error at {joint}"
        )
    claim = _CLAIMS[hypothesis.effect].format(joint=where, other=other)
    seconds = hypothesis.effect in ("thermal_drift", "contact")
    first = list(parameters.items())[: _SHOWN + ("coulomb" in parameters)]
    values = ", ".join(f"{name.replace('_', ' ')} {shown(e, seconds)}" for name, e in first)
    removed = f"adding it removes {100 * gain.relative:.0f} % of the error at {joint}"
    return f"{claim} ({values}); {removed}"
