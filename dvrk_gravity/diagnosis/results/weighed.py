"""Does the torque scale agree with a mass that is said to be there?"""

from __future__ import annotations

from collections.abc import Sequence

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.results.findings import Finding, Weighed
from dvrk_gravity.effects import Estimate, Payload
from dvrk_gravity.units import quantity


def weighed(findings: Sequence[Finding], known: float, arm: Arm, by_reference: bool) -> Weighed:
    """Compare the payload that was found with the mass that is known.

    Args:
        findings: What was found.
        known: The mass, kg.
        arm: The arm.
        by_reference: It was found by comparing two recordings.
    """
    found = next((finding for finding in findings if finding.effect == Payload.NAME), None)
    if found is None:
        return Weighed(known, None, f"no payload was found, and {known:g} kg are said to be there")
    mass = found.parameters["mass"].magnitude  # put on, or taken off since a reference
    unit = arm.own_unit("kg")
    if unit != "kg":
        gain = quantity(known / mass.value, "")
        return Weighed(
            known, None,
            f"{mass.shown} are {known:g} kg if the efforts' unit is {gain} N·m at every joint: "
            "`identify --known-payload` tells each joint's gain",
        )  # fmt: skip
    scale = Estimate(mass.value / known, mass.low / known, mass.high / known, "")
    agrees = scale.low <= 1.0 <= scale.high
    if agrees:
        verdict = (
            "the torque scale agrees with that, as far as it shows: it is "
            f"{100 * scale.low:.0f} to {100 * scale.high:.0f} %"
        )
    else:
        off = scale.percent(1.0).signed(("too high", "too low"))
        other = " or more than it changed between the recordings" if by_reference else ""
        verdict = (
            f"efforts read {off}, or the mass is another{other}: check torque constants, gear "
            "ratios and currents' scales"
        )
    return Weighed(known, scale, f"{mass.shown} were found where {known:g} kg are: {verdict}")
