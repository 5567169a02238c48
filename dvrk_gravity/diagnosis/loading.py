"""Recordings made ready for diagnosis: checked, filtered, joined to one motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.filtered_data import BAND
from dvrk_gravity.diagnosis.findings import Finding
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.diagnosis.stretch import motions, noise_density
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.intake import beyond_limits, held_beyond, require_all, require_measured
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import (
    DataWarning,
    Excerpt,
    Prepared,
    Recording,
    RecordingFile,
    about,
    excerpt,
    labels,
    loaded_if_short,
    prepare,
    without_duplicates,
)

_BETWEEN = 1.0  # s, between recordings whose clocks began anew. Chosen: they were apart
UNREAD = "efforts that are no readings (see the warnings) left out, of their joints alone"


@dataclass(frozen=True)
class LoadSettings:
    """What of a recording is looked at.

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
        stretch: s; of more, stretches that long are used: enough to tell a period of the motion.
    """

    band: float = 20.0
    rate: float = 160.0
    shortest: float = 8.0
    fewest: int = 40
    longest: float = 600.0
    stretch: float = 60.0


@dataclass(frozen=True, eq=False)
class Loaded:
    """A motion, and what was found on the way to it.

    Attributes:
        motion: The motion.
        warnings: What the recordings' checks found.
        handling: What was done to them.
        floor: (n,) noise of the effort as high frequencies show it, density in N·m/sqrt(Hz);
            NaN where it cannot be told.
        sources: Of the recordings, by the numbers in the motion's ``clock``.
        faults: What the recordings showed by themselves, and was put right.
    """

    motion: MeasuredMotion
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]
    floor: Array
    sources: tuple[str, ...] = ()
    faults: tuple[Finding, ...] = ()


def load(
    recordings: Sequence[Recording | RecordingFile],
    model: TorqueModel,
    still: Mapping[str, float] | None = None,
    settings: LoadSettings | None = None,
) -> Loaded:
    """Prepare recordings for diagnosis.

    Of trajectories that together are longer than ``settings.longest``, stretches are used.

    Args:
        recordings: Trajectories, or static poses, not both; joint or actuator coordinates.
        model: The model on trial.
        still: Where joints stood that the recordings do not hold: joint position, rad.
        settings: What is looked at.

    Raises:
        RecordingError: Naming what is missing: effort, samples, motion.
    """
    settings = settings or LoadSettings()
    if not recordings:
        raise RecordingError("recordings", "there are none, expected at least one")
    heads = [recording.head for recording in recordings]
    kinds = {head.time is None for head in heads}
    if len(kinds) > 1:
        raise RecordingError(
            heads[0].source, "static poses and trajectories cannot be diagnosed together"
        )
    static = kinds.pop()
    still, held = held_beyond(recordings, model.arm, still or {})
    for head in heads:
        require_all(head, model.arm, still)
    if {head.joints for head in heads} != {heads[0].joints}:
        raise RecordingError(heads[0].source, "the recordings hold different joints")
    share = settings.longest / len(recordings)
    recordings, left_out, repeated = without_duplicates(
        [loaded_if_short(recording, share) for recording in recordings]
    )
    sources = tuple(recording.head.source for recording in recordings)
    share = settings.longest / len(recordings)
    pieces: list[MeasuredMotion] = []
    warnings, handling, floors = list(repeated), [*held, *left_out], list[Array]()
    for number, recording in enumerate(recordings):
        looked_at = excerpt(recording, share, min(settings.stretch, share))
        alone = len(recordings) == 1
        own = _of_recording(looked_at, model, still, heads[0].start_ns, alone, settings)
        named = about(number, sources, own.warnings)
        warnings += [warning for warning in named if warning not in warnings]
        handling += [line for line in own.handling if line not in handling]
        floors += own.floors
        later = _after(pieces, own.pieces) if own.pieces and not static else 0.0
        if later > 0.0:
            # One arm was in one place at a time: a clock began anew.
            handling.append(f"{labels(sources)[number]}: its times count from {later:.6g} s on")
        pieces += [replace(piece, clock=(number,), time=piece.time + later) for piece in own.pieces]
    if not pieces:
        raise RecordingError(
            heads[0].source, f"has too many gaps: {handling[len(held) + len(left_out)]}"
        )
    motion = _join(pieces)
    names = [
        name for name, there in zip(model.arm.joint_names, motion.present, strict=True) if there
    ]
    if model.arm.direct_drive and not static:
        require_measured(heads[0].source, names, motion.effort[:, motion.present])
    if static and len(motion.q) < settings.fewest:
        raise RecordingError(
            heads[0].source,
            f"holds {len(motion.q)} static poses, a diagnosis needs at least {settings.fewest}",
        )
    if not static:
        total = len(motion.q) / (motion.rate or 1.0)
        if total < settings.shortest:
            raise RecordingError(
                heads[0].source,
                f"holds {total:.3g} s of usable motion, a diagnosis needs at least "
                f"{settings.shortest:g} s",
            )
    known = np.ma.masked_invalid(np.square(floors))  # of static poses none is
    floor = np.sqrt(known.mean(axis=0).filled(np.nan))
    return Loaded(motion, tuple(warnings), tuple(handling), floor, sources)


@dataclass(frozen=True, eq=False)
class _OfRecording:
    """What one of the recordings comes to, see :class:`Loaded`."""

    pieces: Sequence[MeasuredMotion]
    warnings: Sequence[DataWarning]
    handling: Sequence[str]
    floors: Sequence[Array]


def _of_recording(
    looked_at: Excerpt,
    model: TorqueModel,
    still: Mapping[str, float],
    start_ns: int,
    alone: bool,
    settings: LoadSettings,
) -> _OfRecording:
    """Prepare a recording.

    Args:
        looked_at: The recording, or stretches of it.
        model: The model on trial.
        still: Where joints stood that it does not hold.
        start_ns: When the first recording began.
        alone: There is no other one: it has to be long enough by itself.
        settings: What is looked at.
    """
    pieces, floors = list[MeasuredMotion](), list[Array]()
    warnings, handling = list(looked_at.warnings or ()), list[str]()
    rate: float | None = None
    for stretch in looked_at.stretches:
        rate = rate or stretch.rate
        if alone and looked_at.warnings is None:
            _require_length(stretch, settings)
        prepared = _prepared(stretch, rate, looked_at.warnings, settings)
        warnings += [warning for warning in prepared.warnings if warning not in warnings]
        handling += [line for line in prepared.handling if line not in handling]
        start = 0.0 if stretch.time is None else (stretch.start_ns - start_ns) * 1e-9
        thin = 1 if rate is None else max(1, round(rate / settings.rate))
        found = motions(stretch, prepared.segments, model, start, still, thin)
        if any(piece.unread.any() for piece in found) and UNREAD not in handling:
            handling.append(UNREAD)
        pieces += found
        floors.append(noise_density(stretch, model.arm, settings.band))
    if pieces:
        warnings += beyond_limits(np.vstack([piece.q for piece in pieces]), model.arm)
    return _OfRecording(pieces, warnings, handling, floors)


def _after(before: Sequence[MeasuredMotion], pieces: Sequence[MeasuredMotion]) -> float:
    """Return by how much later pieces must be not to be at a time of others, s; 0: they are not."""
    first, last = pieces[0].time[0], pieces[-1].time[-1]
    if all(last < other.time[0] or first > other.time[-1] for other in before):
        return 0.0
    return float(max(other.time[-1] for other in before) - first + _BETWEEN)


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


def _prepared(
    stretch: Recording,
    rate: float | None,
    warnings: tuple[DataWarning, ...] | None,
    settings: LoadSettings,
) -> Prepared:
    """Return a stretch filtered; with the findings of the whole, one that cannot be has no part."""
    band = settings.band if rate is None else min(settings.band, rate / 5.0)
    try:
        return prepare(stretch, band, band=BAND, warnings=warnings)
    except RecordingError as error:
        if warnings is None or stretch.time is None:
            raise
        left_out = f"from {stretch.time[0]:.4g} s on a stretch is left out: it {error.problem}"
        return Prepared((), (), (left_out,), None)


def _join(pieces: Sequence[MeasuredMotion]) -> MeasuredMotion:
    edges = np.concatenate([[0], np.cumsum([len(piece.q) for piece in pieces])]).tolist()
    first = pieces[0]
    directions = [piece.direction for piece in pieces]
    known = [direction for direction in directions if direction is not None]
    return replace(
        first,
        q=np.vstack([piece.q for piece in pieces]),
        qd=np.vstack([piece.qd for piece in pieces]),
        qdd=np.vstack([piece.qdd for piece in pieces]),
        effort=np.vstack([piece.effort for piece in pieces]),
        direction=np.vstack(known) if len(known) == len(pieces) else None,
        unread=np.vstack([np.broadcast_to(piece.unread, piece.q.shape) for piece in pieces]),
        time=np.concatenate([piece.time for piece in pieces]),
        parts=tuple(slice(a, b) for a, b in pairwise(edges)),
        clock=tuple(number for piece in pieces for number in piece.clock),
        rounding=np.sqrt(np.mean([piece.rounding**2 for piece in pieces], axis=0)),
    )
