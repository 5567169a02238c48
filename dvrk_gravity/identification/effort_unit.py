"""Are efforts in N·m? The masses in an arm's file tell roughly what they should be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dvrk_gravity.arms import ANY_UNIT, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification.mounting_check import mounting
from dvrk_gravity.identification.nominal_torque import NominalTorque
from dvrk_gravity.model import NO_VERDICT, TorqueModel
from dvrk_gravity.recording import Recording, RecordingFile


@dataclass(frozen=True)
class UnitSettings:
    """When efforts are not in N·m.

    Attributes:
        follows: Least correlation of a joint's effort with what nominal masses need for it to tell
            the unit. Chosen: half of the effort's variance is then theirs.
        off: Factor by which efforts in N·m may be off what nominal masses need: a load, or masses
            of another version of the arm. Chosen: motor currents are off by ten, mN·m by 1000.
        slip: Such a factor with drive gains is a slip of units or of a decimal, not an arm: less
            than the least, a hundred, and more than any masses of an arm's file were seen to be
            off. Chosen.
    """

    follows: float = 0.7
    off: float = 4.0
    slip: float = 30.0


class _Part(NamedTuple):
    """What a joint tells of the unit: products of effort and nominal weight, and of the latter."""

    shared: float
    needed: float


def _parts(nominal: NominalTorque | None, settings: UnitSettings) -> dict[str, _Part]:
    """Return, by joint that tells, how its effort goes with what nominal masses need."""
    if nominal is None:
        return {}
    parts = {}
    # By joints' coordinates; what a transmission mixes is of one size.
    every = nominal.weight @ nominal.arm.gravity + nominal.inertia
    for name, needed, read in zip(nominal.arm.joint_names, every.T, nominal.effort.T, strict=True):
        needed, read = needed - needed.mean(), read - read.mean()
        size = float(np.linalg.norm(needed) * np.linalg.norm(read))
        if size > 0.0 and abs(needed @ read) > settings.follows * size:
            parts[name] = _Part(float(needed @ read), float(needed @ needed))
    return parts


def _size(parts: Mapping[str, _Part]) -> float | None:
    """Return what part efforts are of those that nominal masses need, if any joint tells.

    Of all joints together, for a load is many times what the links of a wrist weigh.
    """
    if not parts:
        return None
    return sum(abs(part.shared) for part in parts.values()) / sum(p.needed for p in parts.values())


def _mounted(nominal: NominalTorque | None) -> str:
    """Return how an arm seems to be mounted; ``""`` if it is as its file says.

    Of motors that share joints no sign is known.
    """
    found = None if nominal is None or not nominal.arm.direct_drive else mounting(nominal)
    if found is None:
        return ""
    roll, pitch = np.degrees((found.roll, found.pitch))
    signs = (
        "; or efforts have the wrong sign, all or those that bear most: no friction tells"
        if found.signs
        else ""
    )
    return (
        "by the masses in the arm's file gravity acts as on a base with "
        f"base_rpy: [{roll:.0f}, {pitch:.0f}, 0] (degrees): however it is mounted, a .yaml that "
        f"names the URDF says it, and is believed (docs/own_arm.md){signs}"
    )


def _turned_round(parts: Mapping[str, _Part], arm: Arm) -> tuple[str, ...]:
    """Say which efforts are against what nominal masses need."""
    against = ", ".join(name for name, part in parts.items() if part.shared < 0.0)
    # Of motors that share joints no sign is known.
    if not (against and arm.direct_drive):
        return ()
    return (
        f"warning: what the masses in the arm's file need is against the effort of {against}: "
        "a wrong sign, exchanged joints, another way of mounting?",
    )


def in_their_unit(
    arm: Arm, recordings: Sequence[Recording | RecordingFile], settings: UnitSettings | None = None
) -> tuple[Arm, tuple[str, ...]]:
    """Return the arm with the unit of its recordings' efforts, and a line about it if it is odd.

    An arm whose file says that its efforts are in N·m is not asked.

    Raises:
        ConfigError: Drive gains by which no arm of such masses moves; an arm that is read without
            gravity, and states no masses.
        RecordingError: A recording of some joints, of an arm that is read without gravity.
    """
    settings = settings or UnitSettings()
    if not arm.gravity_in_reading:
        _require_stated_weight(arm, recordings)
        return arm, ()
    nominal = NominalTorque.of(recordings[0], arm)
    parts = _parts(nominal, settings)
    told, said = _unit(arm, _size(parts), settings)
    if mounted := _mounted(nominal):
        return told, (*said, f"warning: {mounted}")
    return told, (*said, *_turned_round(parts, arm))


def require_newtons(
    model: TorqueModel, recordings: Sequence[Recording | RecordingFile]
) -> tuple[str, ...]:
    """Refuse efforts that are not in N·m, or of another mounting, where masses are of a file.

    An identified model is in the unit of the efforts that it was identified from.

    Returns:
        What is odd about efforts that may be, in lines.

    Raises:
        RecordingError: Efforts that no such masses need, or only in another gravity.
        ConfigError: Drive gains by which no arm of such masses moves.
    """
    arm, settings, odd = model.arm, UnitSettings(), list[str]()
    if not arm.gravity_in_reading:
        _require_stated_weight(arm, recordings)
        return ()
    if model.verdict != NO_VERDICT or arm.read_in:
        return ()
    for recording in recordings:
        nominal = NominalTorque.of(recording, arm)
        parts = _parts(nominal, settings)
        size = _size(parts)
        told, said = _unit(arm, size, settings)
        if told.read_in:
            raise RecordingError(
                recording.head.source,
                f"efforts are {size:.2g} times what the masses in {arm.source} need: not in N·m "
                "(--drive-gains takes currents to it), or other masses; --effort-unit N·m insists",
            )
        if model.of_file and (mounted := _mounted(nominal)):
            if not arm.base_stated:
                raise RecordingError(recording.head.source, mounted)
            said = (*said, f"warning: {mounted}")
        said = (*said, *_turned_round(parts, arm))
        odd += [line for line in said if line.startswith("warning: ") and line not in odd]
    return tuple(odd)


def _require_stated_weight(arm: Arm, recordings: Sequence[Recording | RecordingFile]) -> None:
    """Refuse efforts without gravity of which it is not known what they lack."""
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
                f"holds {', '.join(head.joints)} only: expected all joints, which show what "
                "efforts without gravity lack",
            )


def _unit(arm: Arm, size: float | None, settings: UnitSettings) -> tuple[Arm, tuple[str, ...]]:
    """Return the arm with the unit of its efforts, and a line about it if it is odd.

    Args:
        arm: The arm.
        size: What part efforts are of those that nominal masses need; ``None`` if nothing tells.
        settings: When efforts are not in N·m.
    """
    if arm.newtons_said:
        return arm, ()
    if arm.drive_gains is not None:
        return arm, _by_gains(arm.drive_gains, size, settings)
    if not arm.read_in:
        if size is None or 1.0 / settings.off < size < settings.off:
            return arm, ()
        arm = arm.told_in(ANY_UNIT, size)
        why = f"efforts are {size:.2g} of what the masses in the arm's file need, so not in N·m: "
    else:
        arm = arm.told_in(arm.read_in, arm.effort_size * (size or 1.0))
        why = f"efforts are in {arm.read_in}, and what that is in N·m is not known: "
    unit = "their own unit (a.u., the recordings')" if arm.read_in == ANY_UNIT else arm.read_in
    return arm, (
        f"{why}torques, and masses by them, are told in {unit}; --drive-gains (N·m/A), or "
        "--known-payload with a second recording, gives N·m and kg",
    )


def _by_gains(gains: Array, size: float | None, settings: UnitSettings) -> tuple[str, ...]:
    """Say by which gains efforts are torques, and whether the arm's masses need such torques."""
    shown = ", ".join(f"{gain:.4g}" for gain in gains)
    line = f"efforts are motor currents, by drive gains of {shown} N·m/A"
    if size is None or 1.0 / settings.off < size < settings.off:
        return (line,)
    off = f"by them torques are {size:.2g} times what the masses in the arm's file need"
    if not 1.0 / settings.slip < size < settings.slip:
        raise ConfigError("drive gains", shown, f"N·m/A: {off}")
    return (line, f"warning: {off}: gains in N·m/A, a known load in kg, the right arm?")
