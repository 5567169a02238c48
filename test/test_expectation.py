"""A model that does not know its error on a recording says which difference is the reason."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from dvrk_gravity.report import fit_in_terminal

NAN = float("nan")


@pytest.mark.parametrize(
    ("band", "cutoff", "coordinates", "reason"),
    [
        (
            8.0,
            5.65,
            "joint",
            "it is known below 8 Hz, these are errors below 5.65 Hz; `identify` or "
            "`diagnose` again writes it for these",
        ),
        (
            NAN,
            5.65,
            "joint",
            "it is known for static poses, these are trajectories; identify from trajectories",
        ),
        (
            5.65,
            None,
            "joint",
            "it is known for trajectories, these are static poses; identify from static poses",
        ),
        (
            5.65,
            5.65,
            "actuator",
            "it is known in joint coordinates, these are errors at the motors; evaluate a "
            "recording in joint coordinates",
        ),
        (
            NAN,
            None,
            "joint",
            "its uncertainty states no error on held-out data; identify from a longer recording",
        ),
    ],
)
def test_an_unknown_error_has_one_reason(
    band: float, cutoff: float | None, coordinates: str, reason: str
) -> None:
    result = SimpleNamespace(expected={}, cutoff=cutoff, coordinates=coordinates)
    model = SimpleNamespace(
        of_file=False,
        unsure="",
        uncertainty=SimpleNamespace(band=band),
        arm=SimpleNamespace(direct_drive=False),
    )
    said = fit_in_terminal.expectation(cast("Any", result), cast("Any", model))
    assert said == f"expected: the model does not know its error here ({reason})"
