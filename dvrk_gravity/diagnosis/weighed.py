"""Does the torque scale agree with a mass that is said to be there?"""

from __future__ import annotations

from collections.abc import Sequence

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.findings import Finding, Weighed
from dvrk_gravity.effects import Payload
from dvrk_gravity.effects.base.meaning import Estimate
from dvrk_gravity.quantity import quantity


def weighed(findings: Sequence[Finding], known: float, arm: Arm) -> Weighed:
    """Compare the payload that was found with the mass that is known."""
    found = next((finding for finding in findings if finding.effect == Payload.NAME), None)
    if found is None:
        return Weighed(known, None, f"no payload was found, and {known:g} kg are said to be there")
    mass = found.parameters["mass"]
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
    verdict = (
        "the torque scale agrees with that"
        if agrees
        else "efforts read "
        + scale.percent(1.0).signed(("too high", "too low"))
        + ", or the mass is another: check torque constants, gear ratios and currents' scales"
    )
    return Weighed(known, scale, f"{mass.shown} were found where {known:g} kg are: {verdict}")
