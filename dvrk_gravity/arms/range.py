"""How large a number of an arm's file may be."""

from __future__ import annotations

from collections.abc import Sequence

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import is_finite

# Chosen: no arm's length (m), mass (kg), effort (N·m, N), angle (deg) or ratio is as large, and the
# products of some of them that a fit makes are far from overflow.
LARGEST = 1e6


def check_range(field: str, values: Sequence[float]) -> None:
    """Check that every number is at most :data:`LARGEST` in size.

    Raises:
        ConfigError: One is larger, or not finite.
    """
    for value in values:
        if not is_finite(value):
            raise ConfigError(field, value, "a finite number")
        if abs(value) > LARGEST:
            raise ConfigError(field, value, f"a number from -{LARGEST:g} to {LARGEST:g}")
