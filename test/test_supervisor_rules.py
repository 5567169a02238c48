"""What the compensator may never do, whatever comes in: some cases; many are in trials."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from testing.supervisor_judge import SEQUENCES, SETTINGS, judge, random_sequence


@settings(
    max_examples=20,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)  # fmt: skip
@given(st.integers(0, len(SETTINGS) - 1), SEQUENCES)
def test_no_sequence_of_events_leads_to_a_command_that_must_not_be(start, sequence):
    judge(start, sequence)


def test_a_long_random_sequence_with_good_input_in_between_is_survived():
    """Hypothesis rarely keeps input good for long: here commands are the rule."""
    result = judge(0, random_sequence(np.random.default_rng(0), 8000))
    assert result.commands > 50
    assert result.holds > 2
