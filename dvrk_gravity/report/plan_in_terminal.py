"""A plan as text for a terminal: what it promises, and what it leaves of each limit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from dvrk_gravity.planning import ExpectedEvidence, MotionDesign, SeparationDesign, Slack
from dvrk_gravity.units import in_one_unit, quantity

_COLUMN = 20  # characters
_PAIRS = 12  # of causes that are shown, those that are separated worst
_ROUNDING = 1e-6  # SI: what is left of a limit that a search ends at
_TIGHTEST = 5  # limits that are shown; the plan's file has all of them
_WORDS = {
    "position": "position", "velocity": "speed", "acceleration": "acceleration",
    "effort": "effort", "distance": "distance",
}  # fmt: skip


def design_text(design: MotionDesign, had_model: bool) -> Iterator[str]:
    """Yield the lines.

    Args:
        design: The plan and what it promises.
        had_model: Whether a model's posterior was known before.
    """
    names = [name for name, *_ in design.parameters]
    broad = 1 + max((len(name) for name in names), default=0)
    before = "now" if had_model else "prior"
    yield f"{'standard error of':<{broad}}{before:>{_COLUMN}}{'expected':>{_COLUMN}}"
    for name, unit, known, expected in design.parameters:
        shown = in_one_unit((known, expected), unit)
        yield f"{name:<{broad}}" + "".join(f"{each:>{_COLUMN}}" for each in shown)
    yield ""
    yield from _tightest(design.slacks)
    yield ""
    yield (
        f"condition number {design.condition:.0f} (base parameters' columns, each divided by its "
        "range)"
    )
    arm = design.plan.arm
    ways = [
        f"{name} (moves by {quantity(way, arm.units[arm.joint_names.index(name)])})"
        for name, way in design.plan.still.items()
    ]
    if ways:
        yield (
            f"teaches next to nothing about {', '.join(ways)}: so little counts as standing still; "
            "widen the limits (degrees in a file), or expect no model that compensates there"
        )


def separation_text(design: SeparationDesign) -> Iterator[str]:
    """Yield the evidence expected between causes, and what is left of each limit."""
    worst = dict[frozenset[str], ExpectedEvidence]()  # of several forms of the same two causes
    for each in sorted(design.expected, key=lambda each: each.planned):
        worst.setdefault(frozenset(each.names), each)
    least = list(worst.values())
    head = "expected evidence (log-likelihood)"
    broad = 1 + max(len(head), *(len(each.words) for each in least[:_PAIRS]))
    yield f"{head:<{broad}}{'planned':>10}{'clear':>8}"
    for each in least[:_PAIRS]:
        # Nothing is as certain as 100 %.
        clear = f"{min(math.floor(100.0 * each.chance), 99)} %"
        yield f"{each.words:<{broad}}{each.planned:>10.1f}{clear:>8}"
    if len(least) > _PAIRS:
        yield f"and {len(least) - _PAIRS} more pairs, {least[_PAIRS].planned:.1f} or more planned"
    if not design.separates:
        yield "no motion was found within the limits that is all but sure to separate any of them:"
    for each in least[:_PAIRS]:
        if not each.separates:
            yield f"{each.words}: {each.why}"
    yield ""
    yield from _tightest(design.slacks)


def _tightest(slacks: Sequence[Slack]) -> Iterator[str]:
    """Yield what a plan leaves of the limits that it comes nearest to, and how many others are."""
    first = sorted(slacks, key=lambda slack: -slack.used)
    yield from limits_text(first[:_TIGHTEST])
    if left := first[_TIGHTEST:]:
        yield f"and {len(left)} more, {100 * left[0].used:.1f} % used at most: in the plan's file"
    if not any(slack.limit == "effort" for slack in slacks):
        yield "efforts are not known without --model, and not limited"


def limits_text(slacks: Sequence[Slack]) -> Iterator[str]:
    """Yield what a plan leaves of each limit, as a table."""
    broad = 1 + max(len(slack.of) for slack in slacks)
    yield f"{'limit of':<{broad}}{'':<13}{'used':>7}{'left':>{_COLUMN}}"
    for slack in slacks:
        used = "" if slack.limit == "distance" else f"{100 * slack.used:.1f} %"
        left = quantity(slack.left if abs(slack.left) > _ROUNDING else 0.0, slack.unit)
        yield f"{slack.of:<{broad}}{_WORDS[slack.limit]:<13}{used:>7}{left:>{_COLUMN}}"
