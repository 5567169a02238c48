"""Findings in sentences that a person understands; what effects say of themselves is theirs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dvrk_gravity import effects
from dvrk_gravity.diagnosis.findings import Finding, Gain
from dvrk_gravity.effects import Estimate, Hypothesis

_SIZES = 2  # of a finding's parameters in its row of a table of findings; the report has all


def title(effect: str) -> str:
    """Return an effect's name as a person writes it."""
    return effects.named(effect).title()


def told(effect: str, name: str, estimate: Estimate) -> str:
    """Return a parameter of an effect with its sign in words, where it has one."""
    return effects.named(effect).meaning(name).in_words(estimate)


def rows(finding: Finding) -> list[tuple[str, str]]:
    """Return the lines of a table of a finding's parameters: what, and how much."""
    effect = effects.named(finding.effect)
    return [
        (
            effect.meaning(name).label or name.replace("_", " "),
            effect.meaning(name).in_words(finding.parameters[name]),
        )
        for name in effect.listed(finding.parameters)
    ]


def size_of(finding: Finding) -> str:
    """Return how much a finding is, with 95 % intervals: its first sizes, certain ones before.

    An effect whose sizes belong together says them in words of its own.
    """
    if together := effects.named(finding.effect).summary(finding.parameters):
        return together
    found = [f"{label} {value}" for label, value in rows(finding)]
    found.sort(key=lambda text: "perhaps" in text)
    shown = ", ".join(found[:_SIZES]) or finding.place
    left = len(found) - _SIZES
    return f"{shown}, {left} more in the report" if left > 0 else shown


def sentence_of(
    hypothesis: Hypothesis, parameters: Mapping[str, Estimate], gain: Gain, joints: Sequence[str],
    doubt: str = "",
) -> str:  # fmt: skip
    """Return the finding in one sentence, with value, interval and what it removes.

    Args:
        hypothesis: The hypothesis.
        parameters: Its estimates by name.
        gain: Its gain on held-out data.
        joints: The joints of whose error the gain is, the one that gains most first.
        doubt: Why it is not certain, whatever it gains.
    """
    first, *others = joints
    where = f"{first} and {len(others)} more joints" if len(others) > 1 else " and ".join(joints)
    does = "removes" if gain.relative >= 0.0 else "adds"
    preposition = "of" if gain.relative >= 0.0 else "to"
    removed = f"{does} {100 * abs(gain.relative):.0f} % {preposition} the error at {where}"
    claim = hypothesis.claim(parameters)
    if (doubt or gain.low <= 0.0) and "perhaps" not in claim:
        claim = f"perhaps {claim}"
    sentence = f"{claim}; {hypothesis.correction()} {removed}"
    if doubt:
        sentence += f" (not certain: {doubt})"
    elif gain.low <= 0.0:
        interval = f"{100 * gain.low:.0f} to {100 * gain.high:.0f} %"
        sentence += f" (not certain: 95 % interval of what it removes {interval})"
    return sentence
