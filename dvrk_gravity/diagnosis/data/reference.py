"""A baseline recording of the same motion in place of a model: what changed since?

Both recordings are brought to a common time, and the reference's efforts at the same phase replace
the model's torques. Whatever the arm does in both, weight, friction, cables, cancels. The motions
differ a little, since a controller lets a loaded arm sag and overshoot; how that alone changes the
efforts is computed by a rough model fitted to the reference (``NearbyTorque``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.expectation import NearbyTorque
from dvrk_gravity.diagnosis.data.loading import LoadSettings
from dvrk_gravity.diagnosis.data.motion import BAND, MeasuredMotion
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import SAME_STATE, Track, same_motion, same_path
from dvrk_gravity.model import VERDICTS, TorqueModel
from dvrk_gravity.recording import LowPass, Note, Recording

ONLY_CHANGES = "it holds changes against a reference only, and cannot hold the arm"


_PIECE = 1.0  # s, of the shortest piece that both show. Chosen: three lengths of the filter
# Cosine of the angle between a joint's efforts and minus the reference's, as vectors of samples, at
# which a sign was reversed. Chosen: no change of the arm reverses weight and friction.
_REVERSED = 0.9
_SLOW = 2.0  # Hz; above it no arm sags or overshoots under a load. Chosen
_LOUD = 0.7  # of the efforts' RMS difference: above it, noise of accelerations matters. Chosen
_PATH = 0.5  # of a motion on the reference's path, at any pace: then only its times differ. Chosen


def model_of(arm: Arm) -> TorqueModel:
    """Return the model of a difference: without terms, and not for compensation."""
    return TorqueModel(arm, (), verdict=VERDICTS[-1], reason=ONLY_CHANGES)


def require_moving(recording: Recording) -> None:
    """Raise RecordingError for static poses, which have no times to compare at."""
    if recording.time is None:
        raise RecordingError(
            recording.source, "holds static poses: expected a motion, to compare with the reference"
        )


def compared(motion: MeasuredMotion, other: MeasuredMotion, names: Sequence[str]) -> MeasuredMotion:
    """Return what both show, with the reference's efforts in place of a model's torques.

    Args:
        motion: The recordings.
        other: The reference.
        names: Names of the first recording and of the reference.

    Raises:
        RecordingError: Other joints, or too little motion in common.
    """
    if (motion.present != other.present).any():
        raise RecordingError(names[1], f"holds other joints than {names[0]}: expected the same")
    assert motion.rate is not None
    track = Track([other.time[p] for p in other.parts], [other.q[p] for p in other.parts])
    times = _times(motion, track)
    rough = NearbyTorque.fit(other)
    # Friction follows the present velocity; all else, the reference's phase.
    rubbed, carried = other.effort - rough.friction_torque(other), rough.inertial_torque(other)
    rubbed = np.where(other.invalid_effort, np.nan, rubbed)
    then, nearby = (
        track.at(times, [torque[p] for p in other.parts]) for torque in (rubbed, carried)
    )
    then += rough.friction_torque(motion)
    change = rough.inertial_torque(motion) - nearby
    shown: NDArray[np.bool_] = np.all(np.isfinite(then), axis=1)
    pieces = [
        piece
        for part in motion.parts
        for piece in _spans(shown, part)
        if piece.stop - piece.start >= _PIECE * motion.rate
    ]
    length = sum(piece.stop - piece.start for piece in pieces) / motion.rate
    shortest = LoadSettings().shortest
    if length < shortest:
        elsewhere = _elsewhere(motion, other)
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
        f"{length:.1f} of {total:.1f} s match the motion of {names[1]} within 2 % of its spread: "
        "only the difference of efforts is judged"
    )
    return replace(
        both,
        processing_log=(*motion.processing_log, line),
        warnings=(*motion.warnings, *_further(other.warnings, motion.warnings)),
        noise=np.hypot(motion.noise, other.noise),  # both are noisy
    )


def _real(change: Array, difference: Array, pieces: Sequence[slice], rate: float) -> Array:
    """Return (N, n) the change of the links' torque without the noise of accelerations, N·m.

    Where its fast part is large beside the efforts' difference, it is scaled to the part of it that
    the efforts show, by least squares between 0 and 1. The slow part is kept: a load that the arm
    overshoots with would be taken for it.

    Args:
        change: (N, n) computed difference of the links' torques, N·m.
        difference: (N, n) measured difference of the efforts.
        pieces: Which samples count.
        rate: Hz.
    """
    slow, compare = (LowPass(min(f, rate / 6.0), rate) for f in (_SLOW, BAND))
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
    return result + fast * np.where(square > _LOUD**2 * differs, part, 1.0)


def _paced(motion: MeasuredMotion, other: MeasuredMotion, name: str) -> str:
    """Return the message for the same path at other times, as of a busy machine; else ``""``."""
    track, reference = (
        Track([moved.time[p] for p in moved.parts], [moved.q[p] for p in moved.parts])
        for moved in (motion, other)
    )
    assert motion.rate is not None
    along = sum(int(part.sum()) for part in same_path(track, reference)) / motion.rate
    shortest = LoadSettings().shortest
    if along < max(shortest, _PATH * len(motion.q) / motion.rate):
        return ""
    return (
        f"follows the path of {name} for {along:.1f} s, but with pauses or at another pace: "
        f"expected {shortest:g} s at least at the same times; record both again, on a machine "
        "that keeps pace (no other load beside excite and simulator)"
    )


def _elsewhere(motion: MeasuredMotion, other: MeasuredMotion) -> str:
    """Return the message for the same motion about another pose; else ``""``."""
    off = np.median(motion.q, axis=0) - np.median(other.q, axis=0)
    track = Track([other.time[p] for p in other.parts], [other.q[p] + off for p in other.parts])
    assert motion.rate is not None
    if np.isfinite(_times(motion, track)).sum() < LoadSettings().shortest * motion.rate:
        return ""
    large = np.abs(off) > SAME_STATE * np.std(other.q, axis=0)
    joints = zip(motion.arm.joints, off, large, strict=True)
    moved = [f"{joint.name} is {joint.shown(by, 1)} further" for joint, by, yes in joints if yes]
    return f"; it does so where {', '.join(moved)}"


def _require_signs(motion: MeasuredMotion, names: Sequence[str]) -> None:
    """Raise RecordingError for efforts that are the reference's with reversed sign."""
    product = (motion.effort * motion.expected).sum(axis=0)
    sizes = np.linalg.norm(motion.effort, axis=0) * np.linalg.norm(motion.expected, axis=0)
    turned = motion.moves & (product < -_REVERSED * sizes)
    if turned.any():
        joints = ", ".join(np.array(motion.arm.joint_names)[turned])
        raise RecordingError(
            names[0],
            f"efforts of {joints} are those of {names[1]} with reversed sign: expected both in "
            "the same convention",
        )


def _times(motion: MeasuredMotion, reference: Track) -> Array:
    """Return (N,) times at which the reference shows the same, s; NaN where it does not."""
    assert motion.rate is not None
    groups: dict[int, list[slice]] = {}
    for number, part in zip(motion.clocks, motion.parts, strict=True):
        groups.setdefault(number, []).append(part)
    found: list[Array] = []
    for parts in groups.values():
        track = Track([motion.time[p] for p in parts], [motion.q[p] for p in parts])
        found += same_motion(track, reference, motion.rate)
    return np.concatenate(found)


def _spans(shown: NDArray[np.bool_], part: slice) -> list[slice]:
    edges = np.flatnonzero(np.diff(shown[part].astype(int), prepend=0, append=0)) + part.start
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _cut(motion: MeasuredMotion, pieces: Sequence[slice]) -> MeasuredMotion:
    """Return some pieces of a motion; rounding is that of two recordings."""
    edges = np.cumsum([0, *(piece.stop - piece.start for piece in pieces)]).tolist()
    clock = tuple(
        number
        for piece in pieces
        for number, part in zip(motion.clocks, motion.parts, strict=True)
        if part.start <= piece.start < part.stop
    )
    cut = motion.at(
        np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces]),
        tuple(slice(a, b) for a, b in pairwise(edges)),
    )
    return replace(cut, clock=clock, rounding=np.sqrt(2.0) * motion.rounding)


def _further(warnings: Sequence[Note], said: Sequence[Note]) -> list[Note]:
    """Return warnings of the reference that do not apply to the recording as well."""
    known = {(warning.kind, warning.joint) for warning in said}
    return [warning for warning in warnings if (warning.kind, warning.joint) not in known]
