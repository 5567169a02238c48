"""Whatever comes in, in whatever order, the compensator never does what it must not: many cases."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import examples

from testing.supervisor_judge import SEQUENCES, SETTINGS, judge, random_sequence


@settings(
    max_examples=examples(100),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)  # fmt: skip
@given(st.integers(0, len(SETTINGS) - 1), SEQUENCES)
def test_no_sequence_of_events_leads_to_a_command_that_must_not_be(start, sequence):
    judge(start, sequence)


@pytest.mark.parametrize("start", range(0, len(SETTINGS), 5))
def test_long_random_sequences_with_good_input_in_between_are_survived(start):
    """Hypothesis rarely keeps input good for long: here commands are the rule."""
    result = judge(start, random_sequence(np.random.default_rng(start), 16000))
    assert result.commands > 100
    assert result.holds > 5
