"""Findings in sentences that a person understands: signs in words, units of a suitable size."""

from __future__ import annotations

import math
from collections.abc import Mapping

from dvrk_gravity.diagnosis.findings import Estimate, Finding, Gain, neutral
from dvrk_gravity.diagnosis.hypothesis import Hypothesis
from dvrk_gravity.quantity import quantity

# What a positive value of a parameter means, and a negative one.
_MORE = ("more", "less")
_READS = ("too high", "too low")
_ENTRY = ("too small", "too great")  # an entry of the model's beta
_SENSES: Mapping[tuple[str, str], tuple[str, str]] = {
    ("coulomb_friction", "positive"): _MORE,
    ("coulomb_friction", "negative"): _MORE,
    ("viscous_friction", "coefficient"): _MORE,
    ("presliding_hysteresis", "coulomb"): _MORE,
    ("rotor_inertia", "inertia"): _MORE,
    **{("link_inertia", name): _MORE
       for name in ("inertia", "inertia_xx", "inertia_yy", "inertia_zz")},
    ("link_com", "delta_beta"): _ENTRY,
    **{("link_com", f"delta_beta_{axis}"): (f"along +{axis}", f"along -{axis}") for axis in "xyz"},
    ("joint_offset", "offset"): _READS,
    ("torque_offset", "offset"): _READS,
    ("time_delay", "delay"): ("late", "early"),
    ("thermal_drift", "torque"): ("up", "down"),
    # What the actuators apply is against a push.
    ("contact", "torque"): ("in the negative direction", "in the positive direction"),
    ("contact", "stiffness"): ("back", "onwards"),
    ("elastic_cable", "stiffness"): _MORE,
}  # fmt: skip
_LABELS: Mapping[tuple[str, str], str] = {
    ("coulomb_friction", "positive"): "moving up",
    ("coulomb_friction", "negative"): "moving down",
    ("stribeck_friction", "level"): "greater at rest by",
    ("stribeck_friction", "velocity"): "gone above about",
    ("presliding_hysteresis", "length"): "builds up over",
    ("presliding_hysteresis", "coulomb"): "Coulomb friction beside it",
    ("link_com", "delta_beta"): "the model's weight moment is",
    ("joint_offset", "offset"): "reads",
    ("torque_offset", "offset"): "reads",
    ("time_delay", "delay"): "efforts are",
    ("thermal_drift", "torque"): "drifts",
    ("joint_coupling", "factor"): "leaks",
    ("elastic_cable", "lowest"): "least torque",
    ("elastic_cable", "highest"): "greatest torque",
    ("contact", "torque"): "pushes",
    ("contact", "stiffness"): "pushes",
    ("unknown", "rms"): "RMS",
}
# Of each effect that one sentence serves, with its parameters in words.
_CLAIMS: Mapping[str, str] = {
    "payload": "{joint}'s link carries {mass} that the model does not know",
    "base_tilt": "the base is tilted against the model's, by {roll} of roll and {pitch} of pitch",
    "link_inertia": "the link of {joint} has {inertia} inertia than the model's",
    "joint_offset": "the encoder of {where} reads {offset}",
    "torque_offset": "the effort of {where} reads {offset}, always",
    "viscous_friction": "{where} has {coefficient} viscous friction than the model",
    "stribeck_friction": "friction of {where} is {level} greater at rest than at speed, "
    "and falls within about {velocity}",
    "elastic_cable": "{joint} has {stiffness} stiffness than the model",
    "rotor_inertia": "{where} has {inertia} rotor inertia than the model",
    "time_delay": "efforts and positions are stamped apart, efforts {delay}",
    "thermal_drift": "the torque of {joint} drifts {torque} with time (time constant "
    "{time_constant})",
    "effort_saturation": "the effort of {joint} is clipped at {limit}",
    "cogging": "{where} has a ripple of {amplitude}, {cycles_per_revolution}",
}
_TITLES = {"coulomb_friction": "Coulomb friction", "link_com": "centre of mass"}
_TURN = 2.0 * math.pi  # an interval as wide says nothing of an angle
_WHOLE = {"link_com": "weights", "link_inertia": "inertias"}


def shown(estimate: Estimate) -> str:
    """Return a value with half its 95 % interval and its unit, as one reads it."""
    return quantity(estimate.value, estimate.unit, 0.5 * (estimate.high - estimate.low))


def told(effect: str, name: str, estimate: Estimate) -> str:
    """Return a parameter of an effect with its sign in words, where it has one.

    Before a value whose interval holds zero stands `perhaps`.
    """
    if effect == "torque_scale" and name == "factor":
        return _signed(_percent(estimate, 1.0), _READS)
    if effect == "joint_coupling" and name == "factor":
        return _signed(_percent(estimate), ("", "with its sign turned round"))
    if estimate.unit == "rad" and estimate.high - estimate.low > _TURN:
        return "any angle"
    senses = _SENSES.get((effect, name), _ENTRY if name.startswith("delta_beta") else None)
    if senses is not None:
        return _signed(estimate, senses)
    sure = name in ("lowest", "highest") or not estimate.doubtful(neutral(effect, name))
    return shown(estimate) if sure else f"perhaps {shown(estimate)}"


def _signed(estimate: Estimate, senses: tuple[str, str]) -> str:
    words = f"{shown(_sized(estimate))} {senses[estimate.value < 0.0]}".rstrip()
    return f"perhaps {words}" if estimate.doubtful(0.0) else words


def title(effect: str) -> str:
    """Return an effect's name as a person writes it."""
    return _TITLES.get(effect, effect.replace("_", " "))


def label(effect: str, name: str) -> str:
    """Return what a parameter of an effect is called in a table."""
    if (effect, name) in _LABELS:
        return _LABELS[effect, name]
    return name.replace("delta_beta_", "weight moment ").replace("_", " ")


def rows(finding: Finding) -> list[tuple[str, str]]:
    """Return the lines of a table of a finding's parameters: what, and how much."""
    curve = "lowest" in finding.parameters
    return [
        (label(finding.effect, name), told(finding.effect, name, one))
        for name, one in finding.parameters.items()
        # A polynomial's coefficients say nothing to a person, nor does one slope of a curve.
        if not (name[1:].isdigit() or (curve and name == "stiffness"))
    ]


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
    values = {name: told(hypothesis.effect, name, one) for name, one in parameters.items()}
    as_a_whole = _WHOLE.get(hypothesis.effect) if not hypothesis.joints else None
    if as_a_whole is not None:
        claim = f"the links' {as_a_whole} as a whole are others than the model's"
        change = "fitting them anew beside all else"
    else:
        claim, change = _claim(hypothesis, parameters, values), "correcting that"
    effect = "removes" if gain.relative >= 0.0 else "adds"
    preposition = "of" if gain.relative >= 0.0 else "to"
    removed = f"{effect} {100 * abs(gain.relative):.0f} % {preposition} the error at {joint}"
    sentence = f"{claim}; {change} {removed}"
    if gain.low <= 0.0:
        interval = f"{100 * gain.low:.0f} to {100 * gain.high:.0f} %"
        sentence += f" (not certain: 95 % interval of what it removes {interval})"
    return sentence


def _claim(
    hypothesis: Hypothesis, parameters: Mapping[str, Estimate], values: Mapping[str, str]
) -> str:
    """Return what is claimed, with its size.

    Args:
        hypothesis: The hypothesis.
        parameters: Its estimates by name.
        values: The same in words.
    """
    names, effect = hypothesis.names, hypothesis.effect
    first = names[0] if names else ""
    where = f"{first}'s motor" if hypothesis.place == "motor" else first
    match effect:
        case "coulomb_friction":
            return _coulomb(where, parameters, values)
        case "contact":
            return _contact(hypothesis, parameters, values)
        case "elastic_cable" if "lowest" in values:
            return (
                f"an elastic torque beside the model's pulls at {first}, from "
                f"{values['lowest']} to {values['highest']} over its way"
            )
        case "presliding_hysteresis":
            beside = f", beside {values['coulomb']} Coulomb friction" if "coulomb" in values else ""
            return (
                f"friction of {where} builds up to {values['level']} over {values['length']} after "
                f"each reversal{beside}"
            )
        case "link_inertia" if "inertia" not in values:
            about = ", ".join(f"{value} about {name[-1]}" for name, value in values.items())
            return f"the link of {first} has another inertia than the model's: {about}"
        case "link_com":
            return _centre_of_mass(hypothesis, parameters, values)
        case "joint_coupling":
            return _coupling(hypothesis, parameters["factor"])
        case "torque_scale":
            of = "the efforts of all joints read" if hypothesis.place == "all" else (
                f"the effort of {where} reads"
            )  # fmt: skip
            return f"{of} {values['factor']}"
        case _:
            return _CLAIMS[effect].format(where=where, joint=first, **values)


def _coulomb(where: str, parameters: Mapping[str, Estimate], values: Mapping[str, str]) -> str:
    up, down = (parameters[name] for name in ("positive", "negative"))
    if up == down:
        return f"{where} has {values['positive']} Coulomb friction than the model"
    if up.value * down.value > 0.0 and not (up.doubtful(0.0) or down.doubtful(0.0)):
        way = _MORE[up.value < 0.0]
        both = f"{shown(_sized(up))} moving up, {shown(_sized(down))} moving down"
        return f"{where} has {way} Coulomb friction than the model: {both}"
    both = f"{values['positive']} moving up, {values['negative']} moving down"
    return f"{where} has another Coulomb friction than the model: {both}"


def _centre_of_mass(
    hypothesis: Hypothesis, parameters: Mapping[str, Estimate], values: Mapping[str, str]
) -> str:
    link, axis = f"{hypothesis.names[0]}'s link", hypothesis.place.split()[-1]
    if hypothesis.place.startswith("weight only"):
        return f"the model's weight moment {axis} of {link} is {values['delta_beta']}"
    if "delta_beta" in values:
        along = told("link_com", f"delta_beta_{axis}", parameters["delta_beta"])
    else:
        along = ", ".join(values.values())
    place = f"the centre of mass of {link} is not where the model has it"
    return f"{place}: its weight moment is off by {along}"


def _coupling(hypothesis: Hypothesis, factor: Estimate) -> str:
    joint, other = hypothesis.names
    what, where = (
        ("torque", "effort") if hypothesis.place.startswith("torque") else ("motion", "position")
    )
    turned = ", with its sign turned round," if factor.value < 0.0 else ""
    part = shown(_percent(_sized(factor)))
    return f"{part} of {other}'s {what} leaks{turned} into the {where} read at {joint}"


def _contact(
    hypothesis: Hypothesis, parameters: Mapping[str, Estimate], values: Mapping[str, str]
) -> str:
    joint = hypothesis.names[0]
    if "torque" in values:
        return (
            f"something outside pushes {joint} with {values['torque']} from {values['start']} to "
            f"{values['end']}"
        )
    side = "above" if hypothesis.place.startswith("above") else "below"
    way = "back" if parameters["stiffness"].value > 0.0 else "onwards"
    size = shown(_sized(parameters["stiffness"]))
    return f"something outside pushes {joint} {way} {side} {values['position']}, with {size}"


def _percent(estimate: Estimate, neutral: float = 0.0) -> Estimate:
    value, low, high = (
        100.0 * (one - neutral) for one in (estimate.value, estimate.low, estimate.high)
    )
    return Estimate(value, low, high, "%")


def _sized(estimate: Estimate) -> Estimate:
    return Estimate(abs(estimate.value), estimate.low, estimate.high, estimate.unit)
