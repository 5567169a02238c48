"""Are efforts signed, and in N·m? The masses in an arm's file say roughly what they should be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dvrk_gravity.arms import ANY_UNIT, OF_WEIGHT, Arm, newton_metres, weight_regressor
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import last_link, stated_weight
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.model import NO_VERDICT, TorqueModel
from dvrk_gravity.observation.nominal import SAMPLES, NominalTorque, recorded
from dvrk_gravity.observation.reversed_axis import Misread, misread
from dvrk_gravity.recording import (
    Note,
    Recording,
    beyond_the_arm,
    disproved,
    quantum,
    without_friction,
)

# Least correlation of a joint's effort with what nominal masses require for it to show the unit.
# Chosen: half of the effort's variance is then theirs.
FOLLOWS = 0.7
# Factor by which efforts in N·m may be off what nominal masses require: a load, or masses of
# another version of the arm. Chosen: motor currents are off by ten, mN·m by 1000.
OFF = 4.0
# Such a factor with drive gains is a slip of units or of a decimal: less than the least, a hundred,
# and more than any masses of an arm's file were seen to be off. Chosen.
SLIP = 30.0
# Looked for at some joints where others are in the first.
_UNITS = {unit: newton_metres(unit) or 1.0 for unit in ("N·m", "mN·m", "N·cm", "kN·m")}
# Factor within which efforts are per cent of the limits, and others in N·m. Chosen: rotors, which
# no file states, add less.
_CLOSE = 1.5
_SAMPLES = 600  # on which a load is compared: a bound on time
# Of lost signs: part of the squared efforts that is left anyway, of masses that are off by a tenth,
# and least gain in log-likelihood, per two samples. Chosen as for a reversed axis
# (``reversed_axis``).
_FLOOR, _GAIN = 0.01, 1.0
_BOTH = 0.2  # part of its largest size that a weight of both signs has of each. Chosen
_FEWEST_BITS = 7  # below a sign. Chosen: loads of Dynamixel and Feetech servos have ten


class _Part(NamedTuple):
    """Products of a joint's effort with its nominal torque, and of the latter with itself."""

    shared: float
    needed: float


def _parts(nominal: NominalTorque | None, beside_drive: bool = False) -> dict[str, _Part]:
    """Return these products of the joints whose effort follows the nominal torque.

    Args:
        nominal: Samples; ``None``: nothing is known.
        beside_drive: What friction and a rotor can explain is left out of both.
    """
    if nominal is None:
        return {}
    parts = {}
    # By joints' coordinates; what a transmission mixes is of one size.
    every = nominal.weight @ nominal.arm.gravity + nominal.inertia
    columns = (nominal.arm.joint_names, every.T, nominal.effort.T, nominal.qd.T, nominal.qdd.T)
    for name, needed, read, *drive in zip(*columns, strict=True):
        needed, read = needed - needed.mean(), read - read.mean()
        if beside_drive:
            needed, read = without_friction(np.stack([needed, read], axis=1), *drive).T
        size = float(np.linalg.norm(needed) * np.linalg.norm(read))
        if size > 0.0 and abs(needed @ read) > FOLLOWS * size:
            parts[name] = _Part(float(needed @ read), float(needed @ needed))
    return parts


def _require_one_unit(source: str, nominal: NominalTorque | None) -> None:
    """Refuse efforts in N·m at some joints, and in another known unit at others.

    A load makes no such difference: the joints before it carry it, too.
    """
    if nominal is None:
        return
    arm, parts = nominal.arm, _parts(nominal, beside_drive=True)
    if arm.newtons_stated or arm.drive_gains is not None or arm.read_in:
        return
    size = {name: abs(part.shared) / part.needed for name, part in parts.items()}
    units = {name: _known_unit(each) for name, each in size.items()}
    limits = {joint.name: joint.effort_limit for joint in arm.joints if joint.effort_stated}
    percent = {
        name: "%"
        for name, each in size.items()
        if name in limits and _near(each * limits[name] / 100.0) and not _near(each)
    }
    if len(percent) > 1 and all(name in percent or _near(size[name]) for name in size):
        units = dict.fromkeys(size, "N·m") | percent
    others = {name: unit for name, unit in units.items() if unit != "N·m"}
    if "" in units.values():  # a load on a wrist that weighs little, or masses of another arm
        return
    if not others or not (len(set(units.values())) > 1 or percent == others):
        return
    gains = {n: limits[n] / 100.0 if unit == "%" else _UNITS[unit] for n, unit in others.items()}
    if _is_load(nominal, gains):
        return
    shown = ", ".join(f"{name} {size[name]:.2g}" for name in size)
    rest = (
        name
        for name in arm.joint_names
        if name not in size
        or (percent and name not in others and _near(size[name] * limits.get(name, 0.0) / 100.0))
    )
    unseen = ", ".join(rest)
    stated = ",".join(f"{name}={unit}" for name, unit in others.items())
    raise RecordingError(
        source,
        f"efforts over what the masses in the arm's file need are {shown}: expected one unit, "
        f"N·m; if it is another at some joints, --effort-unit {stated} states it"
        + (f" (efforts of {unseen} do not show theirs)" if unseen else "")
        + "; if the masses are wrong, --effort-unit N·m",
    )


def _known_unit(size: float) -> str:
    """Return the unit in which efforts are so many times those in N·m; ``""``: none is known."""
    off = {name: float(abs(np.log(size * each))) for name, each in _UNITS.items()}
    best = min(off, key=lambda name: off[name])
    return best if off[best] < np.log(OFF) else ""


def _is_load(nominal: NominalTorque, gains: Mapping[str, float]) -> bool:
    """Return whether a load on the last link explains efforts as well as units of some joints.

    Args:
        nominal: Samples.
        gains: What is read as one at these joints, N·m or N.
    """
    arm, rows = nominal.arm, slice(None, None, max(1, len(nominal.q) // _SAMPLES))
    first = OF_WEIGHT * arm.body_names.index(last_link(arm))
    load = weight_regressor(arm, nominal.q[rows], arm.gravity)[:, :, first : first + OF_WEIGHT]
    needed = (nominal.weight @ arm.gravity + nominal.inertia)[rows]
    rest, by_unit = [], 0.0
    for joint, name in enumerate(arm.joint_names):
        read = nominal.effort[rows, joint]
        pair = (gains.get(name, 1.0) * read, read, needed[:, joint])
        torques = np.column_stack([*pair, load[:, joint]])
        torques = without_friction(torques, nominal.qd[rows, joint], nominal.qdd[rows, joint])
        stated, read, own = torques[:, :3].T
        by_unit += float(np.log((stated - own) @ (stated - own) / max(own @ own, 1e-300) + 1e-4))
        size = max(float(np.linalg.norm(own)), 1e-300)
        rest.append(np.column_stack([read - own, torques[:, 3:]]) / size)
    left = np.stack(rest)
    found = np.linalg.lstsq(np.concatenate(left[:, :, 1:]), np.concatenate(left[:, :, 0]))[0]
    by_load = np.log(((left[:, :, 0] - left[:, :, 1:] @ found) ** 2).sum(axis=1) + 1e-4).sum()
    return bool(by_load < by_unit + 1.0)


def _near(size: float) -> bool:
    return 1.0 / _CLOSE < size < _CLOSE


def _size(parts: Mapping[str, _Part]) -> float | None:
    """Return efforts over nominal torques, of all joints together; ``None`` if none follows.

    Together, as a load is many times what the links of a wrist weigh.
    """
    if not parts:
        return None
    return sum(abs(part.shared) for part in parts.values()) / sum(p.needed for p in parts.values())


def _opposite(parts: Mapping[str, _Part], arm: Arm) -> tuple[Note, ...]:
    """Return a warning about efforts opposite to what nominal masses require."""
    against = ", ".join(name for name, part in parts.items() if part.shared < 0.0)
    # Of motors that share joints no sign is known.
    if not (against and arm.direct_drive):
        return ()
    text = (
        f"the effort of {against} is opposite to what the masses in the arm's file need: a wrong "
        "sign, exchanged joints, another mounting?"
    )
    return (Note("effort_sign", None, {}, text),)


def in_their_unit(arm: Arm, recordings: Sequence[Recording]) -> tuple[Arm, tuple[Note, ...]]:
    """Return the arm with the unit of its recordings' efforts, and what is to be said of it.

    An arm whose file says that its efforts are in N·m is not checked.

    Raises:
        ConfigError: Drive gains by which no arm of such masses moves; an arm that is read without
            gravity, and states no masses.
        RecordingError: A recording of some joints, of an arm that is read without gravity.
    """
    with_unit, notes, found = their_unit(arm, recordings)
    return with_unit, notes if found is None else (*notes, found.warning)


def their_unit(
    arm: Arm, recordings: Sequence[Recording]
) -> tuple[Arm, tuple[Note, ...], Misread | None]:
    """Return what :func:`in_their_unit` does, and apart from that how they were misread."""
    if not arm.gravity_in_reading:
        _require_stated_weight(arm, recordings)
        return arm, (), None
    nominal, parts = _checked(recordings[0], arm)
    with_unit, notes = _unit(arm, _size(parts))
    found = misread(nominal)
    return with_unit, notes if found else (*notes, *_opposite(parts, arm)), found


def _checked(given: Recording, arm: Arm) -> tuple[NominalTorque | None, dict[str, _Part]]:
    """Return what masses require beside efforts, where those of all joints are in one unit."""
    recording = recorded(given, arm)
    for finding in beyond_the_arm(recording):
        if finding.kind == "position_unit":
            raise RecordingError(recording.source, str(finding))
    if why := disproved(recording):
        raise RecordingError(recording.source, why)
    _require_signs(recording)
    nominal = NominalTorque.of(recording, arm)
    _require_one_unit(recording.source, nominal)
    return nominal, _parts(nominal)


def _require_signs(recording: Recording) -> None:
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


def require_newtons(model: TorqueModel, recordings: Sequence[Recording]) -> tuple[Note, ...]:
    """Refuse efforts not in N·m, or of another mounting, for a model of an arm file's masses.

    An identified model is in the unit of the efforts that it was identified from.

    Returns:
        What is odd, but possible.

    Raises:
        RecordingError: Efforts that such masses need nowhere, or only in another gravity.
        ConfigError: Drive gains by which no arm of such masses moves.
    """
    arm, odd = model.arm, list[Note]()
    if not arm.gravity_in_reading:
        _require_stated_weight(arm, recordings)
        return ()
    if model.verdict != NO_VERDICT or arm.read_in:
        return ()
    for recording in recordings:
        nominal, parts = _checked(recording, arm)
        size = _size(parts)
        with_unit, notes = _unit(arm, size)
        if with_unit.read_in:
            raise RecordingError(
                recording.source,
                f"efforts are {size:.2g} times what the masses in {arm.source} need: not in N·m "
                "(--drive-gains converts currents), or other masses; --effort-unit N·m overrides "
                "them",
            )
        found = misread(nominal) if model.of_file else None
        if found and found.mounted and not arm.base_stated:
            raise RecordingError(recording.source, found.line)
        notes += (found.warning,) if found else _opposite(parts, arm)
        odd += [note for note in notes if note.kind != "effort_read" and note not in odd]
    return tuple(odd)


def _require_stated_weight(arm: Arm, recordings: Sequence[Recording]) -> None:
    """Refuse efforts read without gravity where the gravity that they lack is not known."""
    if arm.inertial_parameters is None:
        raise ConfigError(
            "effort_has_gravity.read", False,
            "an arm's file with masses: efforts without gravity do not show what it weighs",
        )  # fmt: skip
    for recording in recordings:
        if recording.joints != arm.joint_names:
            raise RecordingError(
                recording.source,
                f"has {', '.join(recording.joints)} only: expected all joints, which show what "
                "efforts without gravity lack",
            )


def _unit(arm: Arm, size: float | None) -> tuple[Arm, tuple[Note, ...]]:
    """Return the arm with the unit of its efforts, and a note on it if it is odd.

    Args:
        arm: The arm.
        size: Efforts over what nominal masses need; ``None`` if not known.
    """
    if arm.newtons_stated:
        return arm, ()
    if arm.drive_gains is not None:
        return arm, _by_gains(arm.drive_gains, not np.any(arm.drive_gain_error), size)
    if not arm.read_in:
        if size is None or 1.0 / OFF < size < OFF:
            return arm, ()
        arm = arm.with_effort_unit(ANY_UNIT, size)
        why = f"efforts are {size:.2g} of what the arm's masses need, so they are not in N·m: "
    else:
        arm = arm.with_effort_unit(arm.read_in, arm.effort_size * (size or 1.0))
        why = f"efforts are in {arm.read_in}, and N·m per {arm.read_in} are not known: "
    unit = "the unit of the recordings (a.u.)" if arm.read_in == ANY_UNIT else arm.read_in
    text = (
        f"{why}torques, and masses computed from them, are in {unit}; --drive-gains (N·m/A), or "
        "--known-payload with a second recording, gives N·m and kg"
    )
    return arm, (Note("effort_read", None, {}, text),)


def _by_gains(gains: Array, exact: bool, size: float | None) -> tuple[Note, ...]:
    """Return notes that name the drive gains, and doubt them if the arm's masses do."""
    shown = ", ".join(f"{gain:.4g}" for gain in gains)
    line = f"efforts are motor currents, converted with drive gains of {shown} N·m/A"
    if exact:  # of units that were stated
        line = f"efforts are converted from units of {shown} N·m, as stated"
    read = Note("effort_read", None, {}, line)
    if size is None or 1.0 / OFF < size < OFF:
        return (read,)
    off = f"with these gains, torques are {size:.2g} times what the masses in the arm's file need"
    if not 1.0 / SLIP < size < SLIP:
        raise ConfigError("drive gains", shown, f"N·m/A: {off}")
    doubt = f"{off}: gains in N·m/A, a known load in kg, the right arm?"
    return read, Note("effort_unit", None, {}, doubt)
