"""An arm of ros2_control whose goals go wrong in other ways than those of test/live."""

from __future__ import annotations

import pytest
from controlled import ACTION, go_wrong


@pytest.mark.parametrize(
    ("what", "says", "cancels"),
    [
        ("stuck", "from its set point.*; sent hold", True),
        ("refuses to cancel", "a hand; hold was not acknowledged", True),
        ("early", r"[0-9.]+ s too early", False),
        ("not there", ACTION, False),
    ],
)
def test_what_goes_wrong_cancels_the_goal_where_that_goes_on(
    domain: int, what: str, says: str, cancels: bool
) -> None:
    assert go_wrong(what, says) == cancels
