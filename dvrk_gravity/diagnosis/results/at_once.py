"""Pushes of several joints at the same time: they may be one thing that has no name here."""

from __future__ import annotations

from collections.abc import Sequence

from dvrk_gravity.effects import Hypothesis

REMEDY = (
    "if something was held for a while, record the time with it alone; a hand or a cable: keep it "
    "off the arm while it is recorded"
)


def at_once(hypothesis: Hypothesis, others: Sequence[Hypothesis]) -> str:
    """Return what else pushes at the same time as a finding, if something does; else ``""``.

    A load that is held for a while, or a hand at the arm's end, is felt by several joints, with
    each position otherwise; one constant push of each joint approximates that.

    Args:
        hypothesis: The finding's.
        others: Those beside it.
    """
    joints = dict.fromkeys(
        joint
        for other in others
        if _overlap(hypothesis, other)
        for joint in other.names
        if joint not in hypothesis.names
    )
    if not joints:
        return ""
    pushed = f"{' and '.join(joints)} {'is' if len(joints) == 1 else 'are'} pushed"
    return f"{pushed} at the same time: a load that was held for a while looks so, too"


def _overlap(first: Hypothesis, second: Hypothesis) -> bool:
    """Tell whether two come and go, and are there at the same time for a while."""
    if not all({"start", "end"} <= hypothesis.setting.keys() for hypothesis in (first, second)):
        return False
    begin = max(first.setting["start"], second.setting["start"])
    return begin < min(first.setting["end"], second.setting["end"])
