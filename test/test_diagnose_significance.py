"""What is evidence of a cause where the model knows an error."""

from types import SimpleNamespace

import numpy as np
import pytest

from dvrk_gravity.diagnosis import Significance

KNOWN = np.array([0.02, 0.01, 0.0])  # N·m; the last joint's is not known
SAMPLES = np.full(3, 100.0)


@pytest.fixture
def significance() -> Significance:
    return Significance(SimpleNamespace(known_error=KNOWN, band=8.0, samples_per_independent=2.5))


def gain(significance: Significance, before: float, after: float) -> list[float]:
    """Return the gains from one multiple of the known error (or of 1 mN·m) to another."""
    scale = np.where(KNOWN > 0.0, KNOWN, 1e-3)
    squares = ((times * scale) ** 2 for times in (before, after))
    return significance.gain(*squares, SAMPLES).tolist()


def test_an_error_that_falls_below_the_known_one_is_evidence_of_nothing(significance):
    assert gain(significance, 1.0, 0.2)[:2] == [0.0, 0.0]
    assert gain(significance, 0.9, 0.3)[:2] == [0.0, 0.0]
    assert gain(significance, 2.0, 0.2) == pytest.approx(
        [*gain(significance, 2.0, 1.0)[:2], 230.3], abs=0.1
    )


def test_an_error_beyond_the_known_one_is_and_where_none_is_known_every_gain(significance):
    """By 100 samples of a variance that 30 others told: -65 ln(1 + 100 (4 - 1) / 130)."""
    first, second, unknown = gain(significance, 2.0, 1.0)
    assert first == second == pytest.approx(65.0 * np.log(1.0 + 300.0 / 130.0))
    assert unknown == pytest.approx(100.0 * np.log(2.0))
    assert gain(significance, 1.0, 2.0) == pytest.approx([-first, -second, -unknown])


def test_a_joint_whose_error_is_known_has_fewer_samples_that_count(significance):
    """A part of it, 15 %, may look like any cause: 1 + 100 * 0.15² times the variance."""
    white = np.random.default_rng(0).normal(size=(4000, 3))
    inflation = significance.inflation(white, SAMPLES)
    assert inflation == pytest.approx([3.25, 3.25, 1.0], abs=0.05)
