"""Drive gains, N·m/A, from a load of known mass: one recording without it and one with it.

What the load adds to a joint's torque is, per kg, geometry; so the current that it adds tells the
gain. Its centre of mass is solved for with them, unless it is given.

Where both recordings show the same motion, their difference is looked at: arm, friction and cables
cancel. Otherwise the arm's own parameters are solved for, too. In either case friction may grow
with the torque that the joint transmits, as that of harmonic drives does (Taghirad and Bélanger
1998): without that a UR10e's gains come out up to a sixth too low.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State, last_link
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.estimation import Scales, Track, same_motion, solve_scales
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.design import Design, build_design
from dvrk_gravity.identification.motion import CalibrationMotion, read_motions
from dvrk_gravity.identification.moves import starts
from dvrk_gravity.identification.rigid_columns import RIGID
from dvrk_gravity.recording import Coordinates, Recording, RecordingFile

_FARTHEST = 5.0  # m, from a link's frame, of what somebody fastens to it


@dataclass(frozen=True)
class GainSettings:
    """What is supposed of a load and of friction, and which gains count as determined.

    Attributes:
        extent: m, prior standard deviation of the load's centre from its link's frame. Chosen.
        load_friction: Likewise of friction, as a part of the transmitted torque: that of harmonic
            drives is some per cent of it (Taghirad and Bélanger 1998).
        differing: Likewise of how joints differ in that. Chosen: gears of one arm are of one kind,
            and a joint that carries the load one way only cannot tell it from its gain.
        friction_change: Likewise of the change of Coulomb friction from one recording to the
            other, as a part of the effort. Chosen: an arm warms up.
        certain: Relative standard error, as noise tells it, up to which a gain counts as
            determined. Chosen: a UR10e's shoulder_pan, which a load turns about the vertical, has
            5 % from the difference of one motion, and is then off by a tenth.
        seen: Least size of the load's torque, in units of what is left unexplained, for a joint to
            tell its gain. Chosen: less is noise as much as load.
        undetermined: Relative standard error that is told of gains that are not determined. Chosen:
            see above.
        shown: s of the same motion that must be in both for their difference to be looked at.
            Chosen: twice what tells that it is the same.
        unmodelled: Relative error that a gain may have beyond what noise tells. Chosen: of a UR10e
            the difference of one motion and a fit to all of it tell gains 0.2 to 15 % apart, 6 % of
            the wrist's and 1 % of shoulder_lift's and the elbow's.
        still: Part of a joint's RMS speed, below which friction may have either direction: samples
            that are left out. Chosen: as a diagnosis does.
        rounds: Solutions, each with friction by the gains of the one before. Chosen.
    """

    extent: float = 0.3
    load_friction: float = 0.1
    differing: float = 0.01
    friction_change: float = 0.1
    certain: float = 0.05
    seen: float = 1.0
    undetermined: float = 0.2
    shown: float = 10.0
    unmodelled: float = 0.03
    still: float = 0.06
    rounds: int = 4


def check_mass(known: float) -> None:
    """Refuse a known mass that is none.

    Raises:
        ConfigError: A mass that is not more than 0 kg.
    """
    if not isinstance(known, Real) or not 0.0 < known < np.inf:
        raise ConfigError("--known-payload", known, "a mass of more than 0 kg")


@dataclass(frozen=True, eq=False)
class KnownPayload:
    """A load whose mass is known.

    Attributes:
        mass: kg.
        link: Name of the link that carries it; ``""``: the one that the last joint carries.
        centre: (3,) its centre of mass in the link's frame, m; ``None`` if that is not known.
    """

    mass: float
    link: str = ""
    centre: tuple[float, float, float] | None = None

    def body(self, arm: Arm) -> int:
        """Return the index of the body that carries it.

        Raises:
            ConfigError: A mass that is none, or a link that there is not.
        """
        check_mass(self.mass)
        if self.centre is not None and not np.isfinite(self.centre).all():
            raise ConfigError("--payload-centre", self.centre, "finite coordinates, m")
        if self.centre is not None and np.max(np.abs(self.centre)) > _FARTHEST:
            raise ConfigError(
                "--payload-centre", self.centre,
                f"coordinates in the link's frame of at most {_FARTHEST:g} m (m, not mm)",
            )  # fmt: skip
        link = self.link or last_link(arm)
        arm.body(link)
        return arm.body_names.index(link)

    @property
    def where(self) -> str:
        """What else may be wrong if it tells nothing, in words; ``""`` if nothing was said."""
        said = [f"--payload-link {self.link}"] if self.link else []
        if self.centre is not None:
            said.append(f"--payload-centre {','.join(f'{part:g}' for part in self.centre)}")
        return f" (or is it not at {' '.join(said)}?)" if said else ""


@dataclass(frozen=True, eq=False)
class DriveGains:
    """Drive gains that a known load tells.

    Attributes:
        gain: (n,) N·m, or N, of a unit of each effort.
        error: (n,) relative standard errors.
        determined: (n,) the load tells it; the others are the mean of those.
        how: In a sentence, how they were found.
        same_motion: Whether both recordings show one motion.
    """

    gain: Array
    error: Array
    determined: NDArray[np.bool_]
    how: str
    same_motion: bool

    def lines(self, arm: Arm) -> tuple[str, ...]:
        """Return what was found, in sentences."""
        found = [
            f"{name} {gain:.4g} ± {1.96 * error * gain:.2g}"
            for name, gain, error, known in zip(
                arm.joint_names, self.gain, self.error, self.determined, strict=True
            )
            if known
        ]
        lines = [f"drive gains by the known load ({self.how}), N·m/A: {', '.join(found)}"]
        open_ = [n for n, known in zip(arm.joint_names, self.determined, strict=True) if not known]
        if open_:
            mean = float(self.gain[~self.determined][0])
            lines.append(
                f"the load does not tell the gain of {', '.join(open_)}, whose torque it hardly "
                f"changes: taken as the mean of the others, {mean:.4g} N·m/A, give or take 20 %"
            )
        return tuple(lines)


def drive_gains(
    bare: Sequence[Recording | RecordingFile],
    loaded: Sequence[Recording | RecordingFile],
    arm: Arm,
    load: KnownPayload,
    coordinates: Coordinates = "joint",
    settings: GainSettings | None = None,
) -> DriveGains:
    """Find drive gains from recordings without and with a load of known mass.

    Args:
        bare: Trajectories without it.
        loaded: Trajectories with it.
        arm: The arm; efforts are taken as they were read.
        load: The load.
        coordinates: Of the recordings.
        settings: What is supposed.

    Raises:
        RecordingError: No recording without the load, or one that cannot serve.
        ConfigError: A load that cannot be, or that no gain can be told by.
    """
    settings = settings or GainSettings()
    if not bare or not loaded:
        raise RecordingError(
            "recordings", "one is too few for a known load: expected some without it, then one "
            "with it"
        )  # fmt: skip
    arm = replace(arm, drive_gains=None, drive_gain_error=None)
    body = load.body(arm)
    motions = read_motions([recording.of(arm) for recording in (*bare, *loaded)], arm, coordinates)
    if len({part.source for part in motions.parts}) < len(bare) + len(loaded):
        raise RecordingError(
            loaded[-1].head.source,
            "or another one repeats what was read before: expected each recording once",
        )
    first = [part for part in motions.parts if part.source < len(bare)]
    second = [part for part in motions.parts if part.source >= len(bare)]
    known, unknown, sizes = _load_columns(arm, load, body, settings)
    carried = build_design(_Fixed(arm, np.column_stack([known, unknown])), second)
    when = _when(first, second, carried)
    shown = np.isfinite(when)
    same = float(shown.sum()) / carried.rate >= settings.shown
    if same:
        found, felt = _of_difference(first, carried, when, sizes, load.mass, settings)
        how = f"{shown.sum() / carried.rate:.0f} s of the same motion without and with it"
    else:
        found, felt = _of_all(arm, first, second, carried, sizes, load.mass, settings)
        how = "different motions without and with it"
    error = np.hypot(found.error, settings.unmodelled)
    told = found.gain[found.error < settings.certain]
    if len(told) and (told < 0.0).all():
        raise ConfigError(
            "--known-payload", load.mass,
            "the recording with that load last, and those without it before it",
        )  # fmt: skip
    determined = (found.error < settings.certain) & (found.gain > 0.0)
    determined &= _seen(felt, found, settings)
    if not determined.any():
        raise ConfigError(
            "--known-payload", load.mass,
            "a load that changes the torque of some joint: it tells no gain to "
            f"{100 * settings.certain:.0f} %{load.where}",
        )  # fmt: skip
    mean = float(np.exp(np.mean(np.log(found.gain[determined]))))
    return DriveGains(
        np.where(determined, found.gain, mean),
        np.where(determined, error, settings.undetermined),
        determined,
        f"{how}, on {arm.body_names[body]}",
        same,
    )


class _Fixed(Columns):
    """Columns of changes of one arm's inertial parameters."""

    def __init__(self, arm: Arm, directions: Array) -> None:
        """Take (10 bodies, k) changes."""
        self.arm, self._directions = arm, directions

    def history(self, state: State, before: Array | None = None) -> Array:
        """Nothing is remembered."""
        del before
        return np.zeros((len(state.q), 0))

    def regressor(self, state: State, history: Array, stride: int = 1) -> Array:
        """Return (N, n, k) torques at the motors."""
        del history, stride
        arm = self.arm
        links = rigid_body.regressor(arm, state.q, state.qd, state.qdd, arm.gravity)
        return np.matmul(arm.actuator_to_joint.T, links @ self._directions)


def _load_columns(
    arm: Arm, load: KnownPayload, body: int, settings: GainSettings
) -> tuple[Array, Array, Array]:
    """Return (10 bodies,) known parameters per kg, (…, k) unknown ones, and their prior sizes."""
    own = slice(rigid_body.PER_LINK * body, rigid_body.PER_LINK * (body + 1))
    known = np.zeros(rigid_body.PER_LINK * len(arm.bodies))
    extent = settings.extent
    sizes = load.mass * np.array([*[extent] * 3, *[extent**2] * 6])
    first = 1
    if load.centre is not None:
        import pinocchio as pin

        point = pin.Inertia(1.0, np.array(load.centre), np.zeros((3, 3)))
        known[own] = arm.bodies[body].frame.act(point).toDynamicParameters()
        first, sizes = 4, sizes[3:]
    else:
        known[own.start] = 1.0
    unknown = np.zeros((len(known), rigid_body.PER_LINK - first))
    unknown[own][first:] = np.eye(rigid_body.PER_LINK)[first:, first:]
    return known, unknown, sizes


def _when(
    first: Sequence[CalibrationMotion], second: Sequence[CalibrationMotion], carried: Design
) -> Array:
    """Return (N,) when the bare recordings show the samples of the loaded ones; NaN if never."""
    found = np.full(len(carried.y), np.nan)
    for number in sorted({part.source for part in second}):
        index = [i for i, part in enumerate(second) if part.source == number]
        track = Track([second[i].time for i in index], [second[i].state.q for i in index])
        other = _track([part for part in first if part.source == first[0].source])
        times = same_motion(track, other, second[index[0]].filter.rate)
        for i, when in zip(index, times, strict=True):
            rows = carried.part == i
            found[rows] = np.interp(carried.time[rows], second[i].time, when)
    return found


def _track(parts: Sequence[CalibrationMotion]) -> Track:
    return Track([part.time for part in parts], [part.state.q for part in parts])


def _of_difference(
    first: Sequence[CalibrationMotion],
    carried: Design,
    when: Array,
    sizes: Array,
    mass: float,
    settings: GainSettings,
) -> tuple[Scales, Array]:
    """Return the scales, and the load's torque, that tell one motion with and without it apart."""
    parts = [part for part in first if part.source == first[0].source]
    before = _track(parts).at(when, [part.effort for part in parts])
    rows = np.isfinite(before).all(axis=1)
    x, after, before = carried.x[rows], carried.y[rows], before[rows]
    sign, moves = _direction(carried.state.rows(np.flatnonzero(rows)), settings)
    reading, grown = moves * (after - before), moves * sign * (np.abs(after) - np.abs(before))
    warmer = settings.friction_change * np.maximum(after.std(axis=0), 1e-12)
    x = x * moves[..., None]
    known, shared = mass * x[:, :, 0], x[:, :, 1:]
    gain = guess = _guess(known, reading)
    found = None
    for _ in range(settings.rounds):  # friction by load is in N·m, by gains that are not known yet
        found = solve_scales(
            reading, known, np.concatenate([shared, (grown * gain)[..., None]], axis=2),
            np.append(sizes, settings.load_friction), np.stack([grown, moves * sign], axis=2),
            np.stack([np.full(len(gain), settings.differing), warmer], axis=1), carried.rate,
            guess,
        )  # fmt: skip
        gain = found.gain
        # A joint that does not feel the load must not tell how friction grows with it.
        feels = _seen(known + shared @ found.theta[:-1], found, settings)
        reading, grown, known = (array * feels for array in (reading, grown, known))
        shared = shared * feels[:, None]
    assert found is not None
    return found, known + shared @ found.theta[:-1]


def _of_all(
    arm: Arm,
    first: Sequence[CalibrationMotion],
    second: Sequence[CalibrationMotion],
    carried: Design,
    sizes: Array,
    mass: float,
    settings: GainSettings,
) -> tuple[Scales, Array]:
    """Return the scales by which one arm, and the load, make all efforts, and the load's torque."""
    motions = [*first, *second]
    q = np.concatenate([motion.state.q for motion in motions])
    columns = Columns(arm, q.min(axis=0), q.max(axis=0))
    design = build_design(columns, motions)
    loaded = design.part >= len(first)
    load = np.zeros((*design.y.shape, carried.x.shape[2]))
    load[loaded] = carried.x
    chosen = starts(columns)[-1]
    rigid = [i for i in chosen if columns.columns[i].effect in RIGID]
    sign, moves = _direction(design.state, settings)
    reading, known = moves * design.y, moves * mass * load[:, :, 0]
    shared = np.concatenate([design.x[:, :, rigid], load[:, :, 1:]], axis=2) * moves[..., None]
    shared_scale = np.concatenate([columns.scale[rigid], sizes])
    # What is each motor's own may be in the unit of its readings.
    each = [[i for i in chosen if i not in rigid and design.x[:, j, i].any()] for j in range(arm.n)]
    own = np.zeros((*reading.shape, 1 + max(map(len, each))))
    own_scale = np.full(own.shape[1:], settings.differing)
    for j, index in enumerate(each):
        own[:, j, 1 : 1 + len(index)] = design.x[:, j, index] * moves[:, j, None]
        own_scale[j, 1 : 1 + len(index)] = columns.scale[index]
    guess, grown = _guess(known[loaded], reading[loaded]), np.zeros_like(reading)
    gain = guess
    found = None
    for _ in range(settings.rounds):  # nor is the torque that is transmitted
        own[:, :, 0] = grown / gain
        found = solve_scales(
            reading, known, np.concatenate([shared, grown[..., None]], axis=2),
            np.append(shared_scale, settings.load_friction), own, own_scale, design.rate, guess,
        )  # fmt: skip
        gain = found.gain
        grown = sign * np.abs(known + shared @ found.theta[:-1])
    assert found is not None
    carried_torque = known + moves * (load[:, :, 1:] @ found.theta[len(rigid) : -1])
    return found, carried_torque[loaded]


def _seen(torque: Array, found: Scales, settings: GainSettings) -> NDArray[np.bool_]:
    """Return (n,) at which joints the (N, n) torque of the load stands out of what is left."""
    noise = np.sqrt(np.mean(found.residual**2, axis=0))
    size = np.sqrt(np.mean((torque / found.gain) ** 2, axis=0))
    return np.asarray((size > settings.seen * noise) & (size > 0.0))


def _guess(known: Array, reading: Array) -> Array:
    """Return (n,) gains of the right size: of all joints together."""
    size = np.linalg.norm(known, axis=0) / np.maximum(np.linalg.norm(reading, axis=0), 1e-12)
    told = size[size > 0.0]
    return np.full(reading.shape[1], float(np.median(told)) if len(told) else 1.0)


def _direction(state: State, settings: GainSettings) -> tuple[Array, Array]:
    """Return (N, n) directions of motion, and 1 where a joint moves, so that friction has one."""
    assert state.qd is not None
    speed = np.sqrt(np.mean(state.qd**2, axis=0))
    return np.sign(state.qd), (np.abs(state.qd) > settings.still * speed).astype(float)
