"""Recordings beside the model under test: what a diagnosis is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.diagnosis.data.motion import BAND, MeasuredMotion
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import (
    Observation,
    held_beyond,
    observe,
    require_all,
    require_measured,
)
from dvrk_gravity.recording import Bands, Recording


@dataclass(frozen=True)
class LoadSettings:
    """Which part of a recording is used.

    Attributes:
        band: Hz, of the kinematics that non-linear columns are computed from. Chosen: more than
            twice that of the torques that are compared.
        rate: Hz; faster recordings are thinned to about this. Chosen: four times the Nyquist rate
            of that band.
        shortest: s of motion, below which no choice among hypotheses can be judged: five blocks of
            half a second are held out of it (``BlockSettings``). Chosen.
        fewest: Static poses, likewise. Chosen.
        longest: s of motion that hypotheses are built for: they then take less than 2 GiB
            (benchmark/diagnose.py).
        stretch: s; of more, stretches that long are used: enough to find a period of the motion.
    """

    band: float = 20.0
    rate: float = 160.0
    shortest: float = 8.0
    fewest: int = 40
    longest: float = 600.0
    stretch: float = 60.0

    @property
    def bands(self) -> Bands:
        """How recordings are filtered."""
        return Bands(self.band, self.band, BAND, self.rate, 1.5 * self.band, for_fit=False)


def load(
    recordings: Sequence[Recording],
    model: TorqueModel,
    fixed_positions: Mapping[str, float] | None = None,
    settings: LoadSettings | None = None,
) -> MeasuredMotion:
    """Return what recordings show beside a model.

    Args:
        recordings: Trajectories, or static poses, not both; joint or actuator coordinates. Of
            trajectories longer than ``settings.longest`` together, stretches are used.
        model: The model under test.
        fixed_positions: Positions of joints that were not recorded, rad.
        settings: Which part of the recordings is used.

    Raises:
        RecordingError: Names what is missing: effort, samples, motion.
    """
    settings = settings or LoadSettings()
    if not recordings:
        raise RecordingError("recordings", "there are none, expected at least one")
    first = recordings[0].source
    kinds = {recording.time is None for recording in recordings}
    if len(kinds) > 1:
        raise RecordingError(first, "static poses and trajectories cannot be diagnosed together")
    static = kinds.pop()
    fixed_positions, held = held_beyond(recordings, model.arm, fixed_positions or {})
    for recording in recordings:
        require_all(recording, model.arm, fixed_positions)
    if len({recording.joints for recording in recordings}) > 1:
        raise RecordingError(first, "the recordings hold different joints")
    if len(recordings) == 1:
        _require_length(recordings[0], settings)
    observed = observe(
        recordings, model.arm, settings.bands, fixed_positions, longest=settings.longest,
        stretch=settings.stretch,
    )  # fmt: skip
    motion = MeasuredMotion.beside_model(model, Observation.joined(observed))
    motion = replace(motion, warnings=(*held, *motion.warnings))
    if model.arm.direct_drive and not static:
        names = np.array(model.arm.joint_names)[motion.present].tolist()
        require_measured(first, names, motion.effort[:, motion.present])
    if static:
        enough = len(motion) >= settings.fewest
        has, needs = f"{len(motion)} static poses", f"at least {settings.fewest}"
    else:
        total = len(motion) / (motion.rate or 1.0)
        enough = total >= settings.shortest
        has, needs = f"{total:.3g} s of usable motion", f"at least {settings.shortest:g} s"
    if not enough:
        raise RecordingError(first, f"holds {has}, a diagnosis needs {needs}")
    return motion


def _require_length(recording: Recording, settings: LoadSettings) -> None:
    if recording.time is None:
        return
    # Each sample stands for an interval, the last one too.
    count = len(recording)
    duration = float(recording.time[-1] - recording.time[0]) * count / max(count - 1, 1)
    if duration < settings.shortest * (1.0 - 1e-6):
        raise RecordingError(
            recording.source,
            f"lasts {duration:.3g} s, a diagnosis needs at least {settings.shortest:g} s of motion",
        )
