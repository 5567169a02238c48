"""Findings in tables: names, parameters with their signs in words, sizes in short."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import itemgetter

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.diagnosis import Detectable, Diagnosis, Finding
from dvrk_gravity.units import percent, quantity

_SIZES = 2  # of a finding's parameters in its row of a table of findings; the report has all
KNOWN = (
    "too small for findings, beside the model's uncertainty, its error at calibration and "
    "day-to-day friction variation"
)
SEPARATE = "to separate them"
BLIND = "Other causes may be there unseen:"
DETECTABLE = (
    "The smallest change of one kind alone that would have been found in 95 % of such recordings; "
    "none: no change that is possible. A load is at the end of the last link, a tilt about the "
    "horizontal axis that shows it least."
)
BETWEEN = "differences from the reference within day-to-day variation"


def misplaced_load(place: str) -> str:
    """Return the sentence on a load that does not fit its stated place."""
    return (
        f"no load fits at its stated place, {place}: what follows is with a load that may be "
        "anywhere"
    )


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
    effect = effects.named(finding.effect)
    names = effect.listed(finding.parameters)
    doubtful = [effect.meaning(name).is_hedged(finding.parameters[name]) for name in names]
    rows = [f"{label} {value}" for label, value in parameter_rows(finding)]
    found = [row for _, row in sorted(zip(doubtful, rows, strict=True), key=itemgetter(0))]
    shown = ", ".join(found[:_SIZES]) or finding.place
    left = len(found) - _SIZES
    return f"{shown}, {left} more in the report" if left > 0 else shown


def exact_model(why: str) -> str:
    """Return a note on a model without uncertainty, for that reason; ``""`` without a reason."""
    if not why:
        return ""
    return (
        f"the model is taken as exact ({why}): all of its error counts as findings, and intervals "
        "do not include it"
    )


def model_verdict(verdict: str) -> str:
    """Return a line with the given model's own verdict; ``""`` if it has none."""
    return f"the model's own verdict: {verdict.replace('_', ' ')}" if verdict else ""


def detectable_size(found: Detectable) -> str:
    """Return the smallest change that would have been found, with its unit."""
    if not np.isfinite(found.size):
        return "none"
    part = effects.named(found.effect).meaning(found.parameter).percent
    return percent(found.size) if part else quantity(found.size, found.unit)


def detectable_table(found: Sequence[Detectable]) -> tuple[list[str], list[list[str]]]:
    """Return head and rows of a table: by joint, and of the arm, what would have been found."""
    kinds = list(dict.fromkeys(each.effect for each in found))
    sizes = {(each.joint, each.effect): detectable_size(each) for each in found}
    joints = sorted({each.joint: None for each in found}, key=lambda joint: not joint)
    rows = [[joint or "the arm", *(sizes.get((joint, kind), "") for kind in kinds)]
            for joint in joints]  # fmt: skip
    return ["joint", *(effect_title(kind) for kind in kinds)], rows


def detectable_line(found: Iterable[Detectable]) -> str:
    """Return in a line what would have been found: of joints the smallest and the largest."""
    kinds: dict[tuple[str, str], list[Detectable]] = {}
    for each in found:
        kinds.setdefault((each.effect, each.unit), []).append(each)
    return ", ".join(map(_range, kinds.values()))


def _range(of_kind: Sequence[Detectable]) -> str:
    ends = (at(of_kind, key=lambda each: each.size) for at in (min, max))
    sizes = dict.fromkeys(
        detectable_size(each) + (f" ({each.joint})" if each.joint else "") for each in ends
    )
    return f"{effect_title(of_kind[0].effect)} {' to '.join(sizes)}"


def caveat(diagnosis: Diagnosis) -> str:
    """Return what limits the findings of a diagnosis; ``""`` if nothing does."""
    if not (diagnosis.findings and diagnosis.against_reference):
        return ""
    without = (
        ". Without a model, a tilt of the base or a joint's zero appears as other causes: give "
        "--model with the reference"
    )
    return (
        "every difference between the two recordings counts, also friction that changes with "
        "warmth or from day to day: record both in one session. For a load on a link that rotates, "
        "mass times position is better known than mass alone, which only its inertia shows"
        f"{'' if diagnosis.with_model else without}"
    )


def what_is_compared(diagnosis: Diagnosis) -> str:
    """Return what the errors of a diagnosis are, in words."""
    below = "" if diagnosis.band is None else f" below {diagnosis.band:g} Hz,"
    return f"in joint coordinates,{below} on blocks held out of fit and model selection"
