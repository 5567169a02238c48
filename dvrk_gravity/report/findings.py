"""Findings in tables: names, parameters with their signs in words, sizes in short."""

from __future__ import annotations

from dvrk_gravity import effects
from dvrk_gravity.diagnosis import Finding

_SIZES = 2  # of a finding's parameters in its row of a table of findings; the report has all
KNOWN = (
    "too small for findings, beside the model's uncertainty, its error at calibration and "
    "day-to-day friction variation"
)
SEPARATE = "to separate them"
BETWEEN = "differences from the reference within day-to-day variation"


def effect_title(effect: str) -> str:
    """Return the readable name of an effect."""
    return effects.named(effect).title()


def parameter_rows(finding: Finding) -> list[tuple[str, str]]:
    """Return (name, value) of a finding's parameters, for a table."""
    effect = effects.named(finding.effect)
    return [
        (
            effect.meaning(name).label or name.replace("_", " "),
            effect.meaning(name).in_words(finding.parameters[name]),
        )
        for name in effect.listed(finding.parameters)
    ]


def size_of(finding: Finding) -> str:
    """Return a finding's size with 95 % intervals in short, significant parameters first."""
    if together := effects.named(finding.effect).summary(finding.parameters):
        return together
    found = [f"{label} {value}" for label, value in parameter_rows(finding)]
    found.sort(key=lambda text: "perhaps" in text)
    shown = ", ".join(found[:_SIZES]) or finding.place
    left = len(found) - _SIZES
    return f"{shown}, {left} more in the report" if left > 0 else shown


def exact_model(why: str) -> str:
    """Return what it means that a model states no uncertainty; ``""`` if it does."""
    if not why:
        return ""
    return (
        f"the model is taken as exact ({why}): all of its error counts as findings, and intervals "
        "do not include it"
    )
