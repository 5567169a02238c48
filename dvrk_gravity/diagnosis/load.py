"""Recordings made ready for diagnosis: checked, filtered, joined to one motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.filtered_data import BAND
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification.hand import beyond_limits
from dvrk_gravity.identification.motion import (
    completed,
    held_beyond,
    require_all,
    require_measured,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import (
    DataWarning,
    LowPass,
    Prepared,
    Recording,
    RecordingFile,
    Segment,
    excerpt,
    prepare,
)
from dvrk_gravity.recording.data_warning import about, labels
from dvrk_gravity.recording.excerpt import held_if_short
from dvrk_gravity.recording.frozen import FrozenSpan, frozen_efforts
from dvrk_gravity.recording.grid import quantum
from dvrk_gravity.recording.read_before import counted_once

Array = NDArray[np.float64]

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
    """

    motion: MeasuredMotion
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]
    floor: Array
    sources: tuple[str, ...] = ()


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
    heads = [_head(recording) for recording in recordings]
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
    pieces: list[MeasuredMotion] = []
    share = settings.longest / len(recordings)
    recordings, left_out, repeated = counted_once(
        [held_if_short(recording, share) for recording in recordings]
    )
    warnings, handling = list(repeated), [*held, *left_out]
    floors = []
    sources = tuple(_head(recording).source for recording in recordings)
    share = settings.longest / len(recordings)
    for number, recording in enumerate(recordings):
        looked_at = excerpt(recording, share, min(settings.stretch, share))
        of_recording = len(pieces)
        found = about(number, sources, looked_at.warnings or ())
        warnings += [warning for warning in found if warning not in warnings]
        rate: float | None = None
        for stretch in looked_at.stretches:
            rate = rate or stretch.rate
            if len(recordings) == 1 and looked_at.warnings is None:
                _require_length(stretch, settings)
            prepared = _prepared(stretch, rate, looked_at.warnings, settings)
            found = about(number, sources, prepared.warnings)
            warnings += [warning for warning in found if warning not in warnings]
            handling += [h for h in prepared.handling if h not in handling]
            start = 0.0 if static else (stretch.start_ns - heads[0].start_ns) * 1e-9
            before = len(pieces)
            step, rounding = _step(stretch, model.arm), _rounding(stretch, model.arm)
            thin = 1 if rate is None else max(1, round(rate / settings.rate))
            pieces += [
                replace(
                    _piece(segment, thin, model, start, still, step),
                    clock=(number,),
                    rounding=rounding,
                )
                for segment in prepared.segments
            ]
            unread = frozen_efforts(stretch)
            if unread and UNREAD not in handling:
                handling.append(UNREAD)
            pieces[before:] = [_without(piece, unread, stretch, start) for piece in pieces[before:]]
            floors.append(_noise_density(stretch, model.arm, settings))
        own = pieces[of_recording:]
        if own:
            seen = np.vstack([piece.q for piece in own])
            warnings += about(number, sources, beyond_limits(seen, model.arm))
        later = _after(pieces[:of_recording], own) if own and not static else 0.0
        if later > 0.0:
            # One arm was in one place at a time: a clock began anew.
            handling.append(f"{labels(sources)[number]}: its times count from {later:.6g} s on")
            pieces[of_recording:] = [replace(piece, time=piece.time + later) for piece in own]
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


def _after(before: Sequence[MeasuredMotion], pieces: Sequence[MeasuredMotion]) -> float:
    """Return by how much later pieces must be not to be at a time of others, s; 0: they are not."""
    first, last = pieces[0].time[0], pieces[-1].time[-1]
    if all(last < other.time[0] or first > other.time[-1] for other in before):
        return 0.0
    return float(max(other.time[-1] for other in before) - first + _BETWEEN)


def _head(recording: Recording | RecordingFile) -> Recording:
    return recording.head if isinstance(recording, RecordingFile) else recording


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


def _piece(
    segment: Segment,
    thin: int,
    model: TorqueModel,
    start: float,
    still: Mapping[str, float],
    step: Array,
) -> MeasuredMotion:
    recording, rows = segment.recording, segment.core
    names = model.arm.joint_names

    def full(values: Array | None, fill: float = 0.0) -> Array:
        result = np.full((len(recording), len(names)), fill)
        if values is not None:
            result[:, columns] = values
        return result[rows][::thin]

    columns = [names.index(joint) for joint in recording.joints]
    present = np.isin(np.arange(len(names)), columns)
    q, qd, qdd = full(recording.position), full(recording.velocity), full(segment.acceleration)
    if not present.all():
        there = np.array([still.get(joint, 0.0) for joint in names])
        arm, which = model.arm, recording.coordinates
        q = completed(q[:, columns], columns, there, arm, which)
        there = np.zeros(len(names))
        qd, qdd = (
            completed(values[:, columns], columns, there, arm, which) for values in (qd, qdd)
        )
    effort = full(recording.effort)
    direction = None if recording.direction is None else full(recording.direction, 1.0)
    if recording.coordinates == "actuator":
        arm = model.arm
        q, qd, qdd = (arm.joint_position(array) for array in (q, qd, qdd))
        effort = arm.joint_effort(effort)
        if direction is not None:
            direction = np.sign(arm.joint_position(direction))
    if recording.time is None:
        qd, qdd = np.zeros_like(q), np.zeros_like(q)
        time, rate = np.arange(len(q), dtype=float), None
    else:
        time = recording.time[rows][::thin] + start
        rate = (recording.rate or 1.0) / thin
    parts = (slice(0, len(q)),)
    return MeasuredMotion(model, q, qd, qdd, effort, direction, time, parts, rate, present, step)


def _without(
    piece: MeasuredMotion, spans: Sequence[FrozenSpan], recording: Recording, start: float
) -> MeasuredMotion:
    """Return a piece that knows which of its efforts are no readings.

    Args:
        piece: Of the recording.
        spans: Of the recording's efforts.
        recording: Whose joints, or motors, they are of.
        start: Of the recording, s, in the piece's time.
    """
    if not spans:
        return piece
    arm, wide = piece.arm, piece.settings.smeared
    unread = np.zeros(piece.q.shape, dtype=bool)
    for span in spans:
        column = arm.joint_names.index(recording.joints[span.joint])
        first, last = span.span
        unread[:, column] |= (piece.time >= start + first - wide) & (
            piece.time <= start + last + wide
        )
    if recording.coordinates == "actuator":
        unread = unread @ (arm.joint_effort(np.eye(arm.n)) != 0.0)
    return replace(piece, unread=unread)


def _step(recording: Recording, arm: Arm) -> Array:
    """Return (n,) steps in which the joints' positions are read, rad; 0 of those that are not."""
    steps = np.zeros(arm.n)
    for joint, column in zip(recording.joints, recording.position.T, strict=True):
        steps[arm.joint_names.index(joint)] = quantum(column)
    if recording.coordinates == "actuator":
        steps = np.abs(arm.actuator_to_joint) @ steps
    return steps


def _rounding(recording: Recording, arm: Arm) -> Array:
    """Return (n,) density of the noise that the steps of the efforts leave, N·m/sqrt(Hz).

    An effort that goes over many steps is rounded by step / sqrt(12), evenly over all frequencies
    up to half the rate (Bennett 1948); one that goes slowly, by as much at lower ones.
    """
    density = np.zeros(arm.n)
    if recording.rate is None or recording.effort is None:
        return density
    for joint, column in zip(recording.joints, recording.effort.T, strict=True):
        density[arm.joint_names.index(joint)] = quantum(column)
    density /= np.sqrt(12.0 * recording.rate / 2.0)
    if recording.coordinates == "actuator":
        density = np.sqrt(density**2 @ arm.joint_effort(np.eye(arm.n)) ** 2)
    return density


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


def _noise_density(recording: Recording, arm: Arm, settings: LoadSettings) -> Array:
    """Return (n,) effort noise in N·m/sqrt(Hz) from what lies above the kinematic band."""
    unknown = np.full(arm.n, np.nan)
    rate = recording.rate
    if rate is None or recording.effort is None or rate < 4.0 * settings.band:
        return unknown
    cutoff = min(1.5 * settings.band, 0.3 * rate)
    low = LowPass(cutoff, rate)
    if len(recording) <= 4 * low.edge:
        return unknown
    columns = [arm.joint_names.index(joint) for joint in recording.joints]
    effort = np.zeros((len(recording), arm.n))
    effort[:, columns] = recording.effort
    if recording.coordinates == "actuator":
        # Of the joints' efforts themselves: the motors' noises need not be independent.
        effort = arm.joint_effort(effort)
    high = effort - low(effort)
    read = np.ones(high.shape, dtype=bool)
    for span in frozen_efforts(recording):
        read[slice(*span.rows), columns[span.joint]] = False
    if recording.coordinates == "actuator":
        read = ~(~read @ (arm.joint_effort(np.eye(arm.n)) != 0.0))
    counted = np.maximum(read[low.edge : -low.edge].sum(axis=0), 1)
    frequency = np.linspace(0.0, rate / 2.0, 2000)
    # Two runs of a second-order Butterworth: amplitude 1 / (1 + (f / fc)^4).
    passed = np.mean((1.0 - 1.0 / (1.0 + (frequency / cutoff) ** 4)) ** 2)
    square = np.where(read, high**2, 0.0)[low.edge : -low.edge].sum(axis=0)
    variance = square / counted / passed
    known = np.isin(np.arange(arm.n), columns)
    return np.where(known, np.sqrt(variance / (rate / 2.0)), np.nan)
