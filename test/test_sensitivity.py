"""`make sensitivity` halves and doubles every threshold; that none is forgotten."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import pytest

import dvrk_gravity.diagnosis
import dvrk_gravity.estimation
import dvrk_gravity.identification
import dvrk_gravity.recording
from dvrk_gravity.estimation import RobustSettings
from dvrk_gravity.identification.poses import solver

ROOMS = (
    dvrk_gravity.diagnosis, dvrk_gravity.estimation, dvrk_gravity.identification,
    dvrk_gravity.recording,
)  # fmt: skip
# How a search goes on is given by who searches, and among their settings.
GIVEN = {"SearchSettings"}


@pytest.fixture(scope="module")
def sensitivity():
    sys.path.insert(0, str(Path(__file__).parents[1] / "benchmark"))
    try:
        return importlib.import_module("sensitivity")
    finally:
        sys.path.pop(0)


def declared() -> set[type]:
    """Every settings class of the rooms where something is estimated or checked."""
    found = set()
    for room in ROOMS:
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            for name, value in vars(importlib.import_module(module.name)).items():
                known = name.endswith("Settings") and is_dataclass(value) and name not in GIVEN
                if known and value.__module__ == module.name:
                    found.add(value)
    return found


def test_every_threshold_is_among_those_that_are_halved_and_doubled(sensitivity):
    assert declared() == {settings for settings, _ in sensitivity.CLASSES}


def test_a_threshold_that_is_changed_is_changed_where_it_is_used_and_only_for_a_while(sensitivity):
    kind = next(
        settings for settings, _ in sensitivity.CLASSES if settings.__name__ == "FilterSettings"
    )
    with sensitivity.changed(kind, "band", 2.0):
        assert kind().band == 16.0
        assert kind(band=3.0).band == 3.0
    with sensitivity.changed(kind, "blocks.duration", 0.5):
        assert kind().blocks.duration == 0.25
    assert kind().band == 8.0


def test_so_is_one_that_a_module_holds_as_a_constant(sensitivity):
    before, (first, *_) = replace(solver.ROBUST), fields(RobustSettings)
    with sensitivity.changed(RobustSettings, first.name, 3.0):
        assert getattr(solver.ROBUST, first.name) == 3.0 * first.default
    assert before == solver.ROBUST


@pytest.mark.slow
@pytest.mark.slow  # `make sensitivity` itself, of one threshold
def test_a_threshold_that_matters_moves_what_is_told(sensitivity):
    number = next(
        i
        for i, (settings, _) in enumerate(sensitivity.CLASSES)
        if settings.__name__ == "TimingSettings"
    )
    _, before = sensitivity.solve(number, None, 1.0)
    value, after = sensitivity.solve(number, "gap", 2.0)
    assert value == "7.0"
    assert any(line.startswith("lost: ") for line in sensitivity.moved(before, after))
    assert sensitivity.moved(before, before) == []
