"""The monitor over recordings, as fast as the machine can."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import ReadingErrors
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.events import Event
from dvrk_gravity.monitoring.rows import Rows
from dvrk_gravity.monitoring.settings import MonitorSettings
from dvrk_gravity.monitoring.stream import Monitor
from dvrk_gravity.observation import observe, stated_coordinates, without_known_errors
from dvrk_gravity.recording import Bands, Coordinates, Given, opened

# Hz, of the kinematics: as a diagnosis has them (``diagnosis.LoadSettings``).
_BAND, _RATE = 20.0, 160.0
_STEP = 2.0  # s, of rows that are looked at together
_FASTEST_BAND = 20.0  # Hz, of the efforts


@dataclass(frozen=True, eq=False)
class MonitorResult:
    """Events and external torque that a monitor found in recordings.

    Attributes:
        model: The model.
        events: In the order in which they were reported.
        seconds: That were listened to.
        judged: s of these in which changes were looked for: not before the arm has moved for a
            while.
        time: (N,) s, of the rows.
        external: (N, n) torque from outside, low-passed, N·m: where the model is right.
        deviation: (N, n) its standard deviation, all that is uncertain about the model included,
            N·m.
    """

    model: TorqueModel
    events: tuple[Event, ...]
    seconds: float
    judged: float
    time: Array
    external: Array
    deviation: Array


def monitor(
    recordings: Given | Iterable[Given],
    model: TorqueModel | str | Path,
    coordinates: Coordinates | None = None,
    settings: MonitorSettings | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> MonitorResult:
    """Run a monitor over recordings and return its events and external torques.

    Args:
        recordings: Trajectories, or the paths of their files, one after the other.
        model: The model, or its file.
        coordinates: Of recordings that do not say theirs.
        settings: See :class:`MonitorSettings`.
        progress: Called with the part that is done.

    Raises:
        RecordingError: A recording that cannot be used, or one of static poses.
        ConfigError: A model that cannot be used.
    """
    model = TorqueModel.of(model)
    settings = settings or MonitorSettings()
    coordinates = coordinates or stated_coordinates(model)
    whole = opened(recordings, coordinates or "joint", model.arm)
    whole, _ = without_known_errors(whole, model, coordinates)
    model = replace(model, reading_errors=ReadingErrors.none(model.arm.n))
    bands = Bands(_BAND, _BAND, _FASTEST_BAND, _RATE, 1.5 * _BAND, for_fit=False)
    events, seconds, judged, pieces = list[Event](), 0.0, 0.0, list[tuple[Array, Array, Array]]()
    for recording in whole:
        if recording.time is None:
            raise RecordingError(recording.source, "holds static poses, expected a motion")
    for observed in observe(whole, model.arm, bands):
        listener = Monitor(model, settings)
        samples = (observed.time, observed.q, observed.qd, observed.effort)
        rows = Rows.of(settings.sampling.row_rate, *samples)
        size = round(_STEP * settings.sampling.row_rate)
        for first in range(0, len(rows), size):
            step = rows.at(slice(first, first + size))
            seen = listener.add(step)
            events += seen.events
            judged += listener.ready * len(step) / settings.sampling.row_rate
            pieces.append((step.time, -seen.residual, seen.deviation))
            progress(first / len(rows))
        seconds += len(rows) / settings.sampling.row_rate
    if not pieces:
        n = model.arm.n
        pieces = [(np.zeros(0), np.zeros((0, n)), np.zeros((0, n)))]
    time, external, deviation = (np.concatenate(each) for each in zip(*pieces, strict=True))
    return MonitorResult(model, tuple(events), seconds, judged, time, external, deviation)
