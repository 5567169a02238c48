"""Are efforts in N·m? The masses in an arm's file say roughly what they should be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dvrk_gravity.arms import ANY_UNIT, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.intake.nominal import NominalTorque, mounting
from dvrk_gravity.model import NO_VERDICT, TorqueModel
from dvrk_gravity.recording import Recording, RecordingFile

# Least correlation of a joint's effort with what nominal masses require for it to show the unit.
# Chosen: half of the effort's variance is then theirs.
FOLLOWS = 0.7
# Factor by which efforts in N·m may be off what nominal masses require: a load, or masses of
# another version of the arm. Chosen: motor currents are off by ten, mN·m by 1000.
OFF = 4.0
# Such a factor with drive gains is a slip of units or of a decimal: less than the least, a hundred,
# and more than any masses of an arm's file were seen to be off. Chosen.
SLIP = 30.0


class _Part(NamedTuple):
    """Products of a joint's effort with its nominal torque, and of the latter with itself."""

    shared: float
    needed: float


def _parts(nominal: NominalTorque | None) -> dict[str, _Part]:
    """Return these products of the joints whose effort follows the nominal torque."""
    if nominal is None:
        return {}
    parts = {}
    # By joints' coordinates; what a transmission mixes is of one size.
    every = nominal.weight @ nominal.arm.gravity + nominal.inertia
    for name, needed, read in zip(nominal.arm.joint_names, every.T, nominal.effort.T, strict=True):
        needed, read = needed - needed.mean(), read - read.mean()
        size = float(np.linalg.norm(needed) * np.linalg.norm(read))
        if size > 0.0 and abs(needed @ read) > FOLLOWS * size:
            parts[name] = _Part(float(needed @ read), float(needed @ needed))
    return parts


def _size(parts: Mapping[str, _Part]) -> float | None:
    """Return efforts over nominal torques, of all joints together; ``None`` if none follows.

    Together, as a load is many times what the links of a wrist weigh.
    """
    if not parts:
        return None
    return sum(abs(part.shared) for part in parts.values()) / sum(p.needed for p in parts.values())


def _mounted(nominal: NominalTorque | None) -> str:
    """Return a sentence on another apparent mounting; ``""`` if it is as the file says."""
    # Of motors that share joints no sign is known.
    found = None if nominal is None or not nominal.arm.direct_drive else mounting(nominal)
    if found is None:
        return ""
    roll, pitch = np.degrees((found.roll, found.pitch))
    signs = (
        "; or efforts have the wrong sign (all, or those that carry most): friction does not decide"
        if found.signs
        else ""
    )
    return (
        "according to the masses in the arm's file, gravity acts as on a base with "
        f"base_rpy: [{roll:.0f}, {pitch:.0f}, 0] (degrees): state the mounting, whatever it is, in "
        f"a .yaml that names the URDF (docs/own_arm.md){signs}"
    )


def _opposite(parts: Mapping[str, _Part], arm: Arm) -> tuple[str, ...]:
    """Return a line about efforts opposite to what nominal masses require."""
    against = ", ".join(name for name, part in parts.items() if part.shared < 0.0)
    # Of motors that share joints no sign is known.
    if not (against and arm.direct_drive):
        return ()
    return (
        f"warning: the effort of {against} is opposite to what the masses in the arm's file need: "
        "a wrong sign, exchanged joints, another mounting?",
    )


def in_their_unit(
    arm: Arm, recordings: Sequence[Recording | RecordingFile]
) -> tuple[Arm, tuple[str, ...]]:
    """Return the arm with the unit of its recordings' efforts, and lines about what is odd.

    An arm whose file says that its efforts are in N·m is not checked.

    Raises:
        ConfigError: Drive gains by which no arm of such masses moves; an arm that is read without
            gravity, and states no masses.
        RecordingError: A recording of some joints, of an arm that is read without gravity.
    """
    if not arm.gravity_in_reading:
        _require_stated_weight(arm, recordings)
        return arm, ()
    nominal = NominalTorque.of(recordings[0], arm)
    parts = _parts(nominal)
    with_unit, lines = _unit(arm, _size(parts))
    if mounted := _mounted(nominal):
        return with_unit, (*lines, f"warning: {mounted}")
    return with_unit, (*lines, *_opposite(parts, arm))


def require_newtons(
    model: TorqueModel, recordings: Sequence[Recording | RecordingFile]
) -> tuple[str, ...]:
    """Refuse efforts not in N·m, or of another mounting, for a model of an arm file's masses.

    An identified model is in the unit of the efforts that it was identified from.

    Returns:
        Lines about what is odd, but possible.

    Raises:
        RecordingError: Efforts that such masses need nowhere, or only in another gravity.
        ConfigError: Drive gains by which no arm of such masses moves.
    """
    arm, odd = model.arm, list[str]()
    if not arm.gravity_in_reading:
        _require_stated_weight(arm, recordings)
        return ()
    if model.verdict != NO_VERDICT or arm.read_in:
        return ()
    for recording in recordings:
        nominal = NominalTorque.of(recording, arm)
        parts = _parts(nominal)
        size = _size(parts)
        with_unit, lines = _unit(arm, size)
        if with_unit.read_in:
            raise RecordingError(
                recording.head.source,
                f"efforts are {size:.2g} times what the masses in {arm.source} need: not in N·m "
                "(--drive-gains converts currents), or other masses; --effort-unit N·m overrides "
                "them",
            )
        if model.of_file and (mounted := _mounted(nominal)):
            if not arm.base_stated:
                raise RecordingError(recording.head.source, mounted)
            lines = (*lines, f"warning: {mounted}")
        lines = (*lines, *_opposite(parts, arm))
        odd += [line for line in lines if line.startswith("warning: ") and line not in odd]
    return tuple(odd)


def _require_stated_weight(arm: Arm, recordings: Sequence[Recording | RecordingFile]) -> None:
    """Refuse efforts read without gravity where the gravity that they lack is not known."""
    if arm.inertial_parameters is None:
        raise ConfigError(
            "effort_has_gravity.read", False,
            "an arm's file with masses: efforts without gravity do not show what it weighs",
        )  # fmt: skip
    for recording in recordings:
        head = recording.head
        if head.joints != arm.joint_names:
            raise RecordingError(
                head.source,
                f"has {', '.join(head.joints)} only: expected all joints, which show what "
                "efforts without gravity lack",
            )


def _unit(arm: Arm, size: float | None) -> tuple[Arm, tuple[str, ...]]:
    """Return the arm with the unit of its efforts, and a line about it if it is odd.

    Args:
        arm: The arm.
        size: Efforts over what nominal masses need; ``None`` if not known.
    """
    if arm.newtons_said:
        return arm, ()
    if arm.drive_gains is not None:
        return arm, _by_gains(arm.drive_gains, size)
    if not arm.read_in:
        if size is None or 1.0 / OFF < size < OFF:
            return arm, ()
        arm = arm.with_effort_unit(ANY_UNIT, size)
        why = f"efforts are {size:.2g} of what the arm's masses need, so they are not in N·m: "
    else:
        arm = arm.with_effort_unit(arm.read_in, arm.effort_size * (size or 1.0))
        why = f"efforts are in {arm.read_in}, and N·m per {arm.read_in} are not known: "
    unit = "the unit of the recordings (a.u.)" if arm.read_in == ANY_UNIT else arm.read_in
    return arm, (
        f"{why}torques, and masses computed from them, are in {unit}; --drive-gains (N·m/A), or "
        "--known-payload with a second recording, gives N·m and kg",
    )


def _by_gains(gains: Array, size: float | None) -> tuple[str, ...]:
    """Return lines that name the drive gains, and doubt them if the arm's masses do."""
    shown = ", ".join(f"{gain:.4g}" for gain in gains)
    line = f"efforts are motor currents, converted with drive gains of {shown} N·m/A"
    if size is None or 1.0 / OFF < size < OFF:
        return (line,)
    off = f"with these gains, torques are {size:.2g} times what the masses in the arm's file need"
    if not 1.0 / SLIP < size < SLIP:
        raise ConfigError("drive gains", shown, f"N·m/A: {off}")
    return (line, f"warning: {off}: gains in N·m/A, a known load in kg, the right arm?")
