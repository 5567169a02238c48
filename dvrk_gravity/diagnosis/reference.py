"""The same motion when all was well: what is different now, without any model.

Both recordings are brought to a common time, and what the reference measured at the same phase is
put in the place of what a model would say. Whatever the arm does in either, weight, friction,
cables, cancels; what is left is what changed. The two motions are not quite the same: a controller
lets a loaded arm sag and swing further. By how much that alone changes the efforts, a rough model
says that is fitted to the reference (:mod:`dvrk_gravity.diagnosis.nearby`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.filtered_data import BAND
from dvrk_gravity.diagnosis.loading import Loaded, LoadSettings
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.diagnosis.nearby import NearbyTorque
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.estimation import SAME_STATE, Track, same_motion, same_path
from dvrk_gravity.model import VERDICTS, TorqueModel
from dvrk_gravity.recording import DataWarning, LowPass, Recording, RecordingFile

ONLY_CHANGES = "it holds only what changed against a reference, and not what holds the arm"


@dataclass(frozen=True)
class ReferenceSettings:
    """When a reference serves.

    Attributes:
        piece: s, of which a piece that both show lasts at least. Chosen: three lengths of the
            filter that torques are compared behind.
        turned: Cosine of the angle between a joint's efforts and minus the reference's, as vectors
            of their samples, from which on a sign was turned. Chosen: no change of the arm turns
            weight and friction round.
        slow: Hz; faster, no arm sags or swings further under a load. Chosen.
        loud: Part of the efforts' difference, RMS, from which on it matters whether what is faster
            is noise. Chosen.
        path: Part of a motion that lies on the reference's path, at any pace, from which on it is
            told that only the times differ. Chosen: most of it.
    """

    piece: float = 1.0
    turned: float = 0.9
    slow: float = 2.0
    loud: float = 0.7
    path: float = 0.5


def model_of(arm: Arm) -> TorqueModel:
    """Return the model that a difference needs: no term, and not to be compensated with."""
    return TorqueModel(arm, (), verdict=VERDICTS[-1], reason=ONLY_CHANGES)


def require_moving(recording: Recording | RecordingFile) -> None:
    """Refuse static poses.

    Raises:
        RecordingError: Poses, which no time tells the order of.
    """
    first = recording.head
    if first.time is None:
        raise RecordingError(
            first.source, "holds static poses: a reference is compared with as a motion, in time"
        )


def compared(loaded: Loaded, reference: Loaded, names: Sequence[str]) -> Loaded:
    """Return what both show, with the reference's efforts in the place of a model's torques.

    Args:
        loaded: The recordings on trial.
        reference: The reference.
        names: What the first recording on trial, and the reference, are called.

    Raises:
        RecordingError: They hold other joints, or show no motion, or too little, alike.
    """
    motion, other = loaded.motion, reference.motion
    if (motion.present != other.present).any():
        raise RecordingError(names[1], f"holds other joints than {names[0]}: expected the same")
    assert motion.rate is not None
    track = Track([other.time[p] for p in other.parts], [other.q[p] for p in other.parts])
    told = np.concatenate([_times(motion, group, track) for group in _by_clock(motion)])
    rough = NearbyTorque.fit(other)
    # What friction leaves of the reference is of that phase; friction, of how the arm moves now.
    rubbed, carried = other.effort - rough.friction_torque(other), rough.inertial_torque(other)
    rubbed = np.where(other.unread, np.nan, rubbed)
    then, nearby = (
        track.at(told, [torque[p] for p in other.parts]) for torque in (rubbed, carried)
    )
    then += rough.friction_torque(motion)
    change = rough.inertial_torque(motion) - nearby
    shown: NDArray[np.bool_] = np.all(np.isfinite(then), axis=1)
    pieces = [
        piece
        for part in motion.parts
        for piece in _spans(shown, part)
        if piece.stop - piece.start >= ReferenceSettings().piece * motion.rate
    ]
    length = sum(piece.stop - piece.start for piece in pieces) / motion.rate
    shortest = LoadSettings().shortest
    if length < shortest:
        elsewhere = _elsewhere(motion, other)  # at the same times: no matter of pace
        raise RecordingError(
            names[0],
            ("" if elsewhere else _paced(motion, other, names[1]))
            or f"shows {length:.3g} s of the motion of {names[1]}: expected the same motion, "
            f"{shortest:g} s of it at least{elsewhere}",
        )
    change = _real(change, motion.effort - then, pieces, motion.rate)
    both = _cut(replace(motion, reference=then + change), pieces)
    _require_signs(both, names)
    total = len(motion.q) / motion.rate
    line = (
        f"{length:.1f} of {total:.1f} s show the motion of {names[1]}, to 2 % of its spread; of "
        "both the difference is looked at: what they have in common cancels"
    )
    return replace(
        loaded,
        motion=both,
        handling=(*loaded.handling, line),
        warnings=(*loaded.warnings, *_further(reference.warnings, loaded.warnings)),
        # Both are noisy.
        floor=np.hypot(loaded.floor, reference.floor),
    )


def _real(change: Array, difference: Array, pieces: Sequence[slice], rate: float) -> Array:
    """Return (N, n) what of a change of the links' torque is in the efforts, and no noise, N·m.

    It is as noisy as the accelerations that it was computed from, of which the efforts know
    nothing. What is faster than an arm sags and swings further, if it is a large part of that by
    which the efforts differ, by the part of it that they show, by least squares between 0 and 1.
    What is slower all, for a load that the arm swings further with would be taken for it.

    Args:
        change: (N, n) by which the links' torques are said to differ, for the motions do, N·m.
        difference: (N, n) by which the efforts differ.
        pieces: Which samples count.
        rate: Hz.
    """
    settings = ReferenceSettings()
    slow, compare = (LowPass(min(f, rate / 6.0), rate) for f in (settings.slow, BAND))
    shared, square, differs = np.zeros((3, change.shape[1]))
    result, fast = np.array(change), np.zeros_like(change)
    for piece in pieces:
        result[piece] = slow(change[piece])
        fast[piece] = change[piece] - result[piece]
        said, seen = compare(fast[piece]), compare(difference[piece] - slow(difference[piece]))
        shared += (said * seen).sum(axis=0)
        square += (said * said).sum(axis=0)
        differs += (seen * seen).sum(axis=0)
    part = np.clip(shared / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return result + fast * np.where(square > settings.loud**2 * differs, part, 1.0)


def _paced(motion: MeasuredMotion, other: MeasuredMotion, name: str) -> str:
    """Say what to do if the path is the same, but not the times: of a machine that was busy."""
    track, reference = (
        Track([moved.time[p] for p in moved.parts], [moved.q[p] for p in moved.parts])
        for moved in (motion, other)
    )
    assert motion.rate is not None
    along = sum(int(part.sum()) for part in same_path(track, reference)) / motion.rate
    shortest = LoadSettings().shortest
    if along < max(shortest, ReferenceSettings().path * len(motion.q) / motion.rate):
        return ""
    return (
        f"goes the way of {name} for {along:.1f} s, but with pauses or at another pace: expected "
        f"{shortest:g} s at least at the same times; record both again, on a machine that keeps "
        "pace (no other load beside excite and simulator)"
    )


def _elsewhere(motion: MeasuredMotion, other: MeasuredMotion) -> str:
    """Say which joints are elsewhere, if the motions are the same but for that."""
    off = np.median(motion.q, axis=0) - np.median(other.q, axis=0)
    track = Track([other.time[p] for p in other.parts], [other.q[p] + off for p in other.parts])
    told = np.concatenate([_times(motion, group, track) for group in _by_clock(motion)])
    assert motion.rate is not None
    if np.isfinite(told).sum() < LoadSettings().shortest * motion.rate:
        return ""
    large = np.abs(off) > SAME_STATE * np.std(other.q, axis=0)
    joints = zip(motion.arm.joints, off, large, strict=True)
    moved = [f"{joint.name} is {joint.shown(by, 1)} further" for joint, by, yes in joints if yes]
    return f"; it does where {', '.join(moved)}"


def _require_signs(motion: MeasuredMotion, names: Sequence[str]) -> None:
    """Refuse efforts that are the reference's with their sign turned round.

    All that differs then would be told, and none of it would be there.
    """
    assert motion.reference is not None
    alike = (motion.effort * motion.reference).sum(axis=0)
    sizes = np.linalg.norm(motion.effort, axis=0) * np.linalg.norm(motion.reference, axis=0)
    turned = motion.moves & (alike < -ReferenceSettings().turned * sizes)
    if turned.any():
        joints = ", ".join(np.array(motion.arm.joint_names)[turned])
        raise RecordingError(
            names[0],
            f"efforts of {joints} are those of {names[1]} with the sign turned round: expected "
            "both to be read alike",
        )


def _by_clock(motion: MeasuredMotion) -> list[list[slice]]:
    """Return the parts, those of one recording together, in order."""
    groups: dict[int, list[slice]] = {}
    for number, part in zip(motion.clocks, motion.parts, strict=True):
        groups.setdefault(number, []).append(part)
    return list(groups.values())


def _times(motion: MeasuredMotion, parts: Sequence[slice], reference: Track) -> Array:
    assert motion.rate is not None
    track = Track([motion.time[p] for p in parts], [motion.q[p] for p in parts])
    return np.concatenate(same_motion(track, reference, motion.rate))


def _spans(shown: NDArray[np.bool_], part: slice) -> list[slice]:
    edges = np.flatnonzero(np.diff(shown[part].astype(int), prepend=0, append=0)) + part.start
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _cut(motion: MeasuredMotion, pieces: Sequence[slice]) -> MeasuredMotion:
    """Return some pieces of a motion."""
    rows = np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])
    edges = np.cumsum([0, *(piece.stop - piece.start for piece in pieces)]).tolist()
    of = [
        motion.clocks[
            next(i for i, part in enumerate(motion.parts) if part.start <= p.start < part.stop)
        ]
        for p in pieces
    ]
    assert motion.reference is not None
    return replace(
        motion,
        q=motion.q[rows],
        qd=motion.qd[rows],
        qdd=motion.qdd[rows],
        effort=motion.effort[rows],
        reference=motion.reference[rows],
        unread=np.broadcast_to(motion.unread, motion.q.shape)[rows],
        time=motion.time[rows],
        parts=tuple(slice(a, b) for a, b in pairwise(edges)),
        clock=tuple(of),
        rounding=np.sqrt(2.0) * motion.rounding,
    )


def arm_for(model: TorqueModel | None, arm: Arm | None, reference: bool) -> Arm:
    """Return the arm of a diagnosis.

    Args:
        model: The model on trial, if there is one.
        arm: The arm, if it is given.
        reference: Whether there is a reference.

    Raises:
        ConfigError: Neither model nor arm, two different arms, or no model and no reference.
    """
    if model is None:
        if not reference:
            raise ConfigError("--model", None, "a model; or --arm with --reference")
        if arm is None:
            raise ConfigError("--arm", None, "the arm, or a --model, beside --reference")
        return arm
    if arm is not None and arm.joint_names != model.arm.joint_names:
        its = f"{model.arm.name} with {', '.join(model.arm.joint_names)}"
        raise ConfigError("--arm", arm.name, f"that of the model, {its}, or none")
    return model.arm


def _further(warnings: Sequence[DataWarning], said: Sequence[DataWarning]) -> list[DataWarning]:
    """Return the warnings of a reference that the recording itself does not deserve as well."""
    known = {(warning.kind, warning.joint) for warning in said}
    return [warning for warning in warnings if (warning.kind, warning.joint) not in known]
