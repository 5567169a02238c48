"""Recordings prepared for diagnosis: checked, filtered, joined to one motion in joint space."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.filtered_data import BAND
from dvrk_gravity.diagnosis.data.motion import SMEARED, MeasuredMotion
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.intake import (
    beyond_limits,
    completed,
    held_beyond,
    require_all,
    require_measured,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import (
    DataWarning,
    Prepared,
    Recording,
    Segment,
    about,
    excerpt,
    labels,
    noise_density,
    prepare,
    quantum,
    unread_efforts,
    without_duplicates,
)

_BETWEEN = 1.0  # s, between recordings whose clocks started again. Chosen: they were apart
UNREAD = "invalid effort samples (see the warnings) left out, of their joints alone"


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


@dataclass(frozen=True, eq=False)
class Loaded:
    """A motion and how it was prepared.

    Attributes:
        motion: The motion.
        warnings: What the checks of the recordings found.
        handling: What was done to the recordings, a sentence each.
        floor: (n,) effort noise density seen at high frequencies, N·m/sqrt(Hz); NaN if unknown.
        sources: Names of the recordings, by the numbers in the motion's ``clock``.
    """

    motion: MeasuredMotion
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]
    floor: Array
    sources: tuple[str, ...] = ()


def load(
    recordings: Sequence[Recording],
    model: TorqueModel,
    still: Mapping[str, float] | None = None,
    settings: LoadSettings | None = None,
) -> Loaded:
    """Prepare recordings for diagnosis.

    Args:
        recordings: Trajectories, or static poses, not both; joint or actuator coordinates. Of
            trajectories longer than ``settings.longest`` together, stretches are used.
        model: The model under test.
        still: Positions of joints that were not recorded, rad.
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
    still, held = held_beyond(recordings, model.arm, still or {})
    for recording in recordings:
        require_all(recording, model.arm, still)
    if len({recording.joints for recording in recordings}) > 1:
        raise RecordingError(first, "the recordings hold different joints")
    once, repeated = without_duplicates(recordings)
    recordings = [each for each in once if each is not None]
    sources = tuple(recording.source for recording in recordings)
    share = settings.longest / len(recordings)
    pieces: list[MeasuredMotion] = []
    warnings, log, floors = list(repeated), list(held), list[Array]()
    for number, recording in enumerate(recordings):
        if len(recordings) == 1:
            _require_length(recording, settings)
        looked_at = excerpt(recording, share, min(settings.stretch, share))
        prepared = prepare(looked_at, _band(looked_at, settings), BAND)
        start = (looked_at.start_ns - recordings[0].start_ns) * 1e-9
        own = list(_motions(prepared, model, start, still, settings))
        reach = beyond_limits(np.vstack([piece.q for piece in own]), model.arm)
        _extend(warnings, about(number, sources, (*prepared.warnings, *reach)))
        _extend(log, prepared.processing_log)
        if any(piece.unread.any() for piece in own):
            _extend(log, [UNREAD])
        floors.append(_noise_density(looked_at, model.arm, settings.band))
        later = 0.0 if static else _after(pieces, own)
        if later > 0.0:
            # One arm was in one place at a time: a clock started again.
            log.append(f"{labels(sources)[number]}: its times count from {later:.6g} s on")
        pieces += [replace(piece, clock=(number,), time=piece.time + later) for piece in own]
    motion = MeasuredMotion.joined(pieces)
    if model.arm.direct_drive and not static:
        names = np.array(model.arm.joint_names)[motion.present].tolist()
        require_measured(first, names, motion.effort[:, motion.present])
    if static:
        enough = len(motion.q) >= settings.fewest
        has, needs = f"{len(motion.q)} static poses", f"at least {settings.fewest}"
    else:
        total = len(motion.q) / (motion.rate or 1.0)
        enough = total >= settings.shortest
        has, needs = f"{total:.3g} s of usable motion", f"at least {settings.shortest:g} s"
    if not enough:
        raise RecordingError(first, f"holds {has}, a diagnosis needs {needs}")
    known = np.ma.masked_invalid(np.square(floors))  # unknown for static poses
    floor = np.sqrt(known.mean(axis=0).filled(np.nan))
    return Loaded(motion, tuple(warnings), tuple(log), floor, sources)


def _extend(known: list, new: Iterable) -> None:
    known += [each for each in new if each not in known]


def _after(before: Sequence[MeasuredMotion], pieces: Sequence[MeasuredMotion]) -> float:
    """Return by how many s pieces must be shifted not to overlap others in time."""
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


def _band(recording: Recording, settings: LoadSettings) -> float:
    """Return the cut-off of motion and efforts, Hz."""
    rate = recording.rate
    return settings.band if rate is None else min(settings.band, rate / 5.0)


def _motions(
    prepared: Prepared,
    model: TorqueModel,
    start: float,
    still: Mapping[str, float],
    settings: LoadSettings,
) -> Iterator[MeasuredMotion]:
    """Yield the segments of a recording that began at ``start`` s, some of their samples."""
    recording, arm = prepared.recording, model.arm
    thin = 1 if recording.rate is None else max(1, round(recording.rate / settings.rate))
    step, rounding = _step(recording, arm), _rounding(recording, arm)
    unread = _unread(recording, arm)
    for segment in prepared.segments:
        piece = _piece(segment, thin, model, start, still)
        mask = np.zeros(piece.q.shape, dtype=bool)
        for joints, first, last in unread:
            inside = piece.time >= start + first - SMEARED
            mask[inside & (piece.time <= start + last + SMEARED)] |= joints
        yield replace(
            piece, step=step, rounding=rounding, thinned=thin, unread=mask,
            timed=recording.velocity is not None,
        )  # fmt: skip


def _piece(
    segment: Segment, thin: int, model: TorqueModel, start: float, still: Mapping[str, float]
) -> MeasuredMotion:
    recording, rows, arm = segment.recording, segment.core, model.arm
    names = arm.joint_names
    columns = [names.index(joint) for joint in recording.joints]
    present = np.isin(np.arange(arm.n), columns)

    def full(values: Array | None, fill: float = 0.0) -> Array:
        result = np.full((len(recording), arm.n), fill)
        if values is not None:
            result[:, columns] = values
        return result[rows][::thin]

    q, qd, qdd = full(recording.position), full(recording.velocity), full(segment.acceleration)
    if not present.all():
        held = np.array([still.get(joint, 0.0) for joint in names])
        q, qd, qdd = (
            completed(values[:, columns], columns, there, arm, recording.coordinates)
            for values, there in ((q, held), (qd, np.zeros(arm.n)), (qdd, np.zeros(arm.n)))
        )
    effort = full(recording.effort)
    direction = None if recording.direction is None else full(recording.direction, 1.0)
    if recording.coordinates == "actuator":
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
    return MeasuredMotion(
        model, q, qd, qdd, effort, direction, time, parts, rate, present, np.zeros(arm.n)
    )


def _unread(recording: Recording, arm: Arm) -> list[tuple[Mask, float, float]]:
    """Return (n,) joints, first and last s of each span of invalid efforts."""
    found = []
    for span in unread_efforts(recording):
        joints = np.isin(np.arange(arm.n), arm.joint_names.index(recording.joints[span.joint]))
        if recording.coordinates == "actuator":
            joints = arm.joints_of(joints)
        found.append((joints, *span.span))
    return found


def _noise_density(recording: Recording, arm: Arm, band: float) -> Array:
    """Return (n,) effort noise in N·m/sqrt(Hz) above a band of kinematics, Hz; NaN if unknown."""
    rate, time = recording.rate, recording.time
    if rate is None or time is None or recording.effort is None or rate < 4.0 * band:
        return np.full(arm.n, np.nan)
    columns = [arm.joint_names.index(joint) for joint in recording.joints]
    effort = np.zeros((len(recording), arm.n))
    effort[:, columns] = recording.effort
    read = np.ones(effort.shape, dtype=bool)
    for span in unread_efforts(recording):
        read[slice(*span.rows), columns[span.joint]] = False
    if recording.coordinates == "actuator":
        # In joint space first: the motors' noises need not be independent.
        effort, read = arm.joint_effort(effort), ~arm.joints_of(~read)
    density = noise_density(time, effort, read, min(1.5 * band, 0.3 * rate), rate)
    return np.where(np.isin(np.arange(arm.n), columns), density, np.nan)


def _step(recording: Recording, arm: Arm) -> Array:
    """Return (n,) resolution of the joints' positions, rad; 0 of those not recorded."""
    steps = _quanta(recording, arm, recording.position)
    return np.abs(arm.actuator_to_joint) @ steps if recording.coordinates == "actuator" else steps


def _rounding(recording: Recording, arm: Arm) -> Array:
    """Return (n,) noise density of rounded efforts, N·m/sqrt(Hz).

    An effort that passes many steps is rounded by step / sqrt(12), evenly over all frequencies up
    to half the rate (Bennett 1948); one that changes slowly, by as much at lower ones.
    """
    if recording.rate is None or recording.effort is None:
        return np.zeros(arm.n)
    density = _quanta(recording, arm, recording.effort) / np.sqrt(12.0 * recording.rate / 2.0)
    if recording.coordinates == "actuator":
        density = np.sqrt(density**2 @ arm.joint_effort(np.eye(arm.n)) ** 2)
    return density


def _quanta(recording: Recording, arm: Arm, values: Array) -> Array:
    steps = np.zeros(arm.n)
    for joint, column in zip(recording.joints, values.T, strict=True):
        steps[arm.joint_names.index(joint)] = quantum(column)
    return steps
