"""Efforts whose sign was lost, or is a bit: loads of servos, read as unsigned integers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.observation.nominal import SAMPLES
from dvrk_gravity.recording import Recording, quantum, without_friction

# Part of the squared efforts that is left anyway, of masses that are off by a tenth, and least gain
# in log-likelihood, per two samples. Chosen as for a reversed axis (``reversed_axis``).
_FLOOR, _GAIN = 0.01, 1.0
_BOTH = 0.2  # part of its largest size that a weight of both signs has of each. Chosen
_FEWEST_BITS = 7  # below a sign. Chosen: loads of Dynamixel and Feetech servos have ten


def require_signs(recording: Recording) -> None:
    """Refuse efforts that are never negative, and follow the arm's masses with signs alone.

    Raises:
        RecordingError: Naming the joints, and what the efforts look like.
    """
    arm, effort = recording.arm, recording.effort
    if arm is None or effort is None or recording.joints != arm.joint_names:
        return
    if arm.newtons_stated:  # whatever the masses say
        return
    rows = slice(None, None, max(1, len(recording) // SAMPLES))
    q, read = recording.position[rows], effort[rows]
    weight = stated_weight(arm, q)
    unsigned = (read.min(axis=0) >= 0.0) & (np.ptp(read, axis=0) > 0.0)
    if weight is None or not unsigned.any():
        return
    speed = np.zeros_like(q)
    if recording.time is not None and len(q) > 1:
        speed = np.asarray(np.gradient(q, recording.time[rows], axis=0))
    of = np.flatnonzero(unsigned)

    def left(efforts: Array, weights: Array) -> Array:
        pairs = (np.stack([efforts[:, j], weights[:, j]], axis=1) for j in of)
        return np.array([_left(pair, speed[:, j]) for pair, j in zip(pairs, of, strict=True)])

    given = left(read, weight)
    found, most = "", _GAIN
    for words, decoded in _decoded(read, unsigned):
        gain = float(np.log((given + _FLOOR) / (left(decoded, weight) + _FLOOR)).sum())
        if gain > most:
            found, most = words, gain
    both = np.minimum(-weight.min(axis=0), weight.max(axis=0)) > _BOTH * np.abs(weight).max(axis=0)
    if not found and both[of].any():
        gains = np.log((given + _FLOOR) / (left(read, np.abs(weight)) + _FLOOR))
        found = "magnitudes, whose sign was left out" if gains[both[of]].sum() > _GAIN else ""
    if found:
        names = ", ".join(arm.joint_names[joint] for joint in of)
        raise RecordingError(
            recording.source,
            f"efforts of {names} are never negative, and what the arm's file weighs there says "
            f"that they should have signs: expected signed torques; these look like {found}",
        )


def _left(pair: Array, speed: Array) -> float:
    """Return the part of a joint's squared effort that weight, of any scale, and friction leave."""
    effort, weight = without_friction(pair, speed).T
    explained = float(effort @ weight) ** 2 / max(float(weight @ weight), 1e-300)
    return float((effort @ effort - explained) / max(float(pair[:, 0] @ pair[:, 0]), 1e-300))


def _decoded(read: Array, unsigned: Array) -> Iterator[tuple[str, Array]]:
    """Yield what (N, n) efforts, never negative at some joints, may be, and their signed values."""
    steps = np.array([quantum(column) or np.inf for column in read.T])
    counts = np.where(unsigned, np.round(read / steps), 0.0)
    if counts.max() < 2.0**_FEWEST_BITS:
        return
    bit = np.floor(np.log2(counts.max()))
    half = 2.0**bit
    step = float(steps[np.argmax(counts.max(axis=0))])
    first, whole = f"{half * step:g}", f"{2.0 * half * step:g}"
    yield (
        f"loads of a servo, of which bit {bit:.0f} is the sign: values v from {first} on are "
        f"-(v - {first})",
        np.where(counts >= half, half - counts, counts),
    )
    yield (
        f"two's complements without their sign: values v from {first} on are v - {whole}",
        np.where(counts >= half, counts - 2.0 * half, counts),
    )
