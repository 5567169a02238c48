"""The one door from recordings to what an arm did."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.observation.absent_joints import require_all
from dvrk_gravity.observation.arm_side import beyond_limits
from dvrk_gravity.observation.joint_space import in_joint_space
from dvrk_gravity.observation.observation import Observation
from dvrk_gravity.recording import (
    STRETCH,
    Bands,
    Coordinates,
    Note,
    Prepared,
    Recording,
    about,
    excerpt,
    prepare,
    without_duplicates,
)

# Ratio of two clocks of one rate. Chosen: they differ by more than clocks do, by less than any two
# rates in use.
_SAME_RATE = 1.001
INVALID_EFFORT = "invalid effort samples (see the warnings) left out, of their joints alone"

Decide = Callable[[int, Prepared], Coordinates]
"""The coordinates that a recording, of a number, really has."""


def observe(
    recordings: Sequence[Recording],
    arm: Arm,
    bands: Bands | None = None,
    fixed_positions: Mapping[str, float] | None = None,
    decide: Decide | None = None,
    longest: float = np.inf,
    stretch: float = STRETCH,
) -> list[Observation]:
    """Return what recordings show of an arm, of each that is not a copy of others.

    All come at one rate, the lowest of theirs.

    Args:
        recordings: Trajectories or static poses with efforts, in the arm's order and units.
        arm: The arm.
        bands: How they are filtered; default: those of a fit.
        fixed_positions: Where joints stood that a recording lacks, rad; ``None``: none may lack
            any.
        decide: Returns the coordinates of a recording; default: as it says.
        longest: s, of the motion that is used of all together.
        stretch: s; of longer ones, stretches that long are used.

    Raises:
        RecordingError: No efforts, a joint missing, or whatever ``prepare`` refuses.
    """
    bands = bands or Bands.of_fit()
    for recording in recordings:
        require_all(recording, arm, fixed_positions)
    once, repeated = without_duplicates(recordings)
    used = [(number, each) for number, each in enumerate(once) if each is not None]
    sources = [recording.source for _, recording in used]
    share = longest / len(used)
    bands = bands.within(min((each.rate or np.inf for _, each in used), default=np.inf))
    filtered = list[Prepared]()
    for number, recording in used:
        prepared = prepare(excerpt(recording, share, min(stretch, share)), bands)
        if decide is not None:
            prepared = prepared.read_as(decide(number, prepared))
        filtered.append(prepared)
    rates = [prepared.filter.rate for prepared in filtered if prepared.filter is not None]
    result = list[Observation]()
    for number, prepared in enumerate(filtered):
        log, warnings = prepared.processing_log, prepared.warnings
        if prepared.filter is not None and prepared.filter.rate > _SAME_RATE * min(rates):
            prepared = prepared.at_rate(min(rates))
            log += (f"recordings of several rates, resampled to {min(rates):.6g} Hz",)
        seen = in_joint_space(prepared, arm, fixed_positions)
        if seen.invalid_effort.any():
            log += (INVALID_EFFORT,)
        warnings = about(number, sources, (*warnings, *beyond_limits(seen.q, arm)))
        clock = (number,) * len(seen.parts)
        result.append(replace(seen, clock=clock, warnings=warnings, processing_log=log))
    first = replace(result[0], warnings=(*repeated, *result[0].warnings))
    return [first, *result[1:]]


def warnings_of(observations: Sequence[Observation]) -> tuple[Note, ...]:
    """Return the warnings about all."""
    return tuple(warning for each in observations for warning in each.warnings)


def log_of(observations: Sequence[Observation]) -> tuple[str, ...]:
    """Return what was done to all, each step once."""
    return tuple(dict.fromkeys(line for each in observations for line in each.processing_log))
