"""Drive gains, N·m/A, from a load of known mass: one recording without it and one with it.

What the load adds to a joint's torque is, per kg, geometry; so the current that it adds gives the
gain. Its centre of mass is solved for, too, unless it is given.

Where both recordings show the same motion, their difference is used: arm, friction and cables
cancel. Otherwise the arm's own parameters are solved for, too. In either case friction may grow
with the torque that the joint transmits, as that of harmonic drives does (Taghirad and Bélanger
1998): without that a UR10e's gains are up to a sixth too low.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State, last_link
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.estimation import Scales, Track, same_motion, solve_scales
from dvrk_gravity.model import Columns, search_starts
from dvrk_gravity.observation.design import Design, build_design
from dvrk_gravity.observation.observation import Observation
from dvrk_gravity.observation.observing import observe
from dvrk_gravity.recording import Coordinates, Note, Recording, without_duplicates

if TYPE_CHECKING:
    import pinocchio as pin

_FARTHEST = 5.0  # m, of a load's centre from its link's frame


# Prior standard deviations: of the load's centre from its link's frame, m (chosen);
EXTENT = 0.3
# of friction as a part of the transmitted torque: some per cent of it in harmonic drives (Taghirad
# and Bélanger 1998);
LOAD_FRICTION = 0.1
# of its difference between joints. Chosen: gears of one arm are of one kind, and a joint that
# carries the load one way only cannot separate it from its gain;
DIFFERING = 0.01
# of the change of Coulomb friction from one recording to the other, as a part of the effort.
# Chosen: an arm warms up.
FRICTION_CHANGE = 0.1
# Relative standard error, by noise, up to which a gain counts as determined. Chosen: a UR10e's
# shoulder_pan, which a load turns about the vertical, has 5 % from the difference of one motion,
# and is then off by a tenth.
CERTAIN = 0.05
# Least torque of the load, in units of the residual, for a joint to determine its gain. Chosen:
# less is noise as much as load.
SEEN = 1.0
# Relative standard error reported of gains that are not determined. Chosen: see CERTAIN.
UNDETERMINED = 0.2
# s of the same motion that both must hold for their difference to be used. Chosen: twice what shows
# that it is the same.
SHOWN = 10.0
# Relative error of a gain beyond noise. Chosen: of a UR10e the difference of one motion and a fit
# to all of it give gains 0.2 to 15 % apart, 6 % of the wrist's and 1 % of shoulder_lift's and the
# elbow's.
UNMODELLED = 0.03
# Part of a joint's RMS speed, below which friction may have either direction: samples left out.
# Chosen: as a diagnosis does.
STILL = 0.06
ROUNDS = 4  # solutions, each with friction by the gains of the one before. Chosen


def check_mass(known: float) -> None:
    """Refuse a mass that is not positive.

    Raises:
        ConfigError: Naming it.
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

    def carrier(self, arm: Arm) -> tuple[int, pin.SE3]:
        """Return the index of the body that carries it, and its link's frame in the body's.

        Raises:
            ConfigError: A mass that is not positive, an impossible centre, or an unknown link.
        """
        check_mass(self.mass)
        if self.centre is not None and not np.isfinite(self.centre).all():
            raise ConfigError("--payload-centre", self.centre, "finite coordinates, m")
        if self.centre is not None and np.max(np.abs(self.centre)) > _FARTHEST:
            raise ConfigError(
                "--payload-centre", self.centre,
                f"coordinates in the link's frame of at most {_FARTHEST:g} m (m, not mm)",
            )  # fmt: skip
        return arm.carrier(self.link or last_link(arm))

    @property
    def where(self) -> str:
        """What else may be wrong if no gain follows, in words; ``""`` if nothing was given."""
        given = [f"--payload-link {self.link}"] if self.link else []
        if self.centre is not None:
            given.append(f"--payload-centre {','.join(f'{part:g}' for part in self.centre)}")
        return f" (or is it not at {' '.join(given)}?)" if given else ""


@dataclass(frozen=True, eq=False)
class DriveGains:
    """Drive gains found by a known load.

    Attributes:
        gain: (n,) N·m, or N, of a unit of each effort.
        error: (n,) relative standard errors.
        determined: (n,) found by the load; the others are the mean of those.
        how: How they were found, in words.
    """

    gain: Array
    error: Array
    determined: Mask
    how: str

    def notes(self, arm: Arm) -> tuple[Note, ...]:
        """Return the gains, in words."""
        found = [
            f"{name} {gain:.4g} ± {1.96 * error * gain:.2g}"
            for name, gain, error, known in zip(
                arm.joint_names, self.gain, self.error, self.determined, strict=True
            )
            if known
        ]
        lines = [f"drive gains from the known load ({self.how}), N·m/A: {', '.join(found)}"]
        open_ = [n for n, known in zip(arm.joint_names, self.determined, strict=True) if not known]
        if open_:
            mean = float(self.gain[~self.determined][0])
            lines.append(
                f"the load does not determine the gain of {', '.join(open_)}, whose torque it "
                f"hardly changes: taken as the mean of the others, {mean:.4g} N·m/A ± 20 %"
            )
        return tuple(Note("drive_gains", None, {}, line) for line in lines)


def drive_gains(
    bare: Sequence[Recording],
    loaded: Sequence[Recording],
    arm: Arm,
    load: KnownPayload,
    coordinates: Coordinates = "joint",
) -> DriveGains:
    """Find drive gains from recordings without and with a load of known mass.

    Args:
        bare: Trajectories without it.
        loaded: Trajectories with it.
        arm: The arm; its own drive gains, if any, are ignored.
        load: The load.
        coordinates: Of the recordings.

    Raises:
        RecordingError: No recording without the load, or one that cannot be used.
        ConfigError: An impossible load, or one that determines no gain.
    """
    if not bare or not loaded:
        raise RecordingError(
            "recordings", "one recording is too few for a known load: expected some without it, "
            "then one with it"
        )  # fmt: skip
    arm = replace(arm, drive_gains=None, drive_gain_error=None)
    body, _ = load.carrier(arm)
    recordings = [recording.of(arm) for recording in (*bare, *loaded)]
    if None in without_duplicates(recordings)[0]:
        raise RecordingError(
            loaded[-1].source,
            "or another one repeats an earlier recording: expected each recording once",
        )
    observed = observe(recordings, arm, decide=lambda number, prepared: coordinates)
    parts = [part for each in observed for part in each.split()]
    first = [part for part in parts if part.clock[0] < len(bare)]
    second = [part for part in parts if part.clock[0] >= len(bare)]
    known, unknown, sizes = _load_columns(arm, load, body)
    carried = build_design(_Fixed(arm, np.column_stack([known, unknown])), second)
    when = _when(first, second, carried)
    shown = np.isfinite(when)
    if float(shown.sum()) / carried.rate >= SHOWN:
        found, felt = _of_difference(first, carried, when, sizes, load.mass)
        how = f"{shown.sum() / carried.rate:.0f} s of the same motion without and with it"
    else:
        found, felt = _of_all(arm, first, second, carried, sizes, load.mass)
        how = "different motions without and with it"
    error = np.hypot(found.error, UNMODELLED)
    sure = found.gain[found.error < CERTAIN]
    if len(sure) and (sure < 0.0).all():
        raise ConfigError(
            "--known-payload", load.mass,
            "the recording with that load last, and those without it before it",
        )  # fmt: skip
    determined = (found.error < CERTAIN) & (found.gain > 0.0)
    determined &= _seen(felt, found)
    if not determined.any():
        raise ConfigError(
            "--known-payload", load.mass,
            "a load that changes the torque of some joint: it determines no gain to "
            f"{100 * CERTAIN:.0f} %{load.where}",
        )  # fmt: skip
    mean = float(np.exp(np.mean(np.log(found.gain[determined]))))
    return DriveGains(
        np.where(determined, found.gain, mean),
        np.where(determined, error, UNDETERMINED),
        determined,
        f"{how}, on {arm.body_names[body]}",
    )


class _Fixed(Columns):
    """Columns of changes of one arm's inertial parameters."""

    def __init__(self, arm: Arm, directions: Array) -> None:
        """Take (10 bodies, k) changes."""
        self.arm, self._directions = arm, directions

    def history(
        self, state: State, before: Array | None = None, chosen: Sequence[int] | None = None
    ) -> Array:
        """Return no memory."""
        del before, chosen
        return np.zeros((len(state.q), 0))

    def regressor(
        self, state: State, history: Array, stride: int = 1, chosen: Sequence[int] | None = None
    ) -> Array:
        """Return (N, n, k) torques at the motors."""
        del history, stride, chosen
        arm = self.arm
        links = rigid_body.regressor(arm, state.q, state.qd, state.qdd, arm.gravity)
        return np.matmul(arm.actuator_to_joint.T, links @ self._directions)


def _load_columns(arm: Arm, load: KnownPayload, body: int) -> tuple[Array, Array, Array]:
    """Return (10 bodies,) known parameters per kg, (…, k) unknown ones, and their prior sizes."""
    own = slice(rigid_body.PER_LINK * body, rigid_body.PER_LINK * (body + 1))
    known = np.zeros(rigid_body.PER_LINK * len(arm.bodies))
    sizes = load.mass * np.array([*[EXTENT] * 3, *[EXTENT**2] * 6])
    first = 1
    if load.centre is not None:
        import pinocchio as pin

        _, link = load.carrier(arm)
        point = pin.Inertia(1.0, link.act(np.array(load.centre)), np.zeros((3, 3)))
        known[own] = arm.bodies[body].frame.act(point).toDynamicParameters()
        first, sizes = 4, sizes[3:]
    else:
        known[own.start] = 1.0
    unknown = np.zeros((len(known), rigid_body.PER_LINK - first))
    unknown[own][first:] = np.eye(rigid_body.PER_LINK)[first:, first:]
    return known, unknown, sizes


def _when(first: Sequence[Observation], second: Sequence[Observation], carried: Design) -> Array:
    """Return (N,) times of the loaded samples in the bare recording; NaN where there is none."""
    found = np.full(len(carried.y), np.nan)
    for number in sorted({part.clock[0] for part in second}):
        index = [i for i, part in enumerate(second) if part.clock[0] == number]
        other = _track([part for part in first if part.clock == first[0].clock])
        rate = second[index[0]].rate
        assert rate is not None
        times = same_motion(_track([second[i] for i in index]), other, rate)
        for i, when in zip(index, times, strict=True):
            rows = carried.part == i
            found[rows] = np.interp(carried.time[rows], second[i].time, when)
    return found


def _track(parts: Sequence[Observation]) -> Track:
    return Track([part.time for part in parts], [part.q for part in parts])


def _of_difference(
    first: Sequence[Observation],
    carried: Design,
    when: Array,
    sizes: Array,
    mass: float,
) -> tuple[Scales, Array]:
    """Return the scales, and the load's torque, from the difference of two equal motions."""
    parts, arm = [part for part in first if part.clock == first[0].clock], carried.columns.arm
    before = _track(parts).at(when, [part.motor_effort(arm) for part in parts])
    rows = np.isfinite(before).all(axis=1)
    x, after, before = carried.x[rows], carried.y[rows], before[rows]
    sign, moves = _direction(carried.state.rows(np.flatnonzero(rows)))
    reading, grown = moves * (after - before), moves * sign * (np.abs(after) - np.abs(before))
    warmer = FRICTION_CHANGE * np.maximum(after.std(axis=0), 1e-12)
    x = x * moves[..., None]
    known, shared = mass * x[:, :, 0], x[:, :, 1:]
    gain = guess = _guess(known, reading)
    found = None
    for _ in range(ROUNDS):  # friction by load is in N·m, by gains that are not known yet
        found = solve_scales(
            reading, known, np.concatenate([shared, (grown * gain)[..., None]], axis=2),
            np.append(sizes, LOAD_FRICTION), np.stack([grown, moves * sign], axis=2),
            np.stack([np.full(len(gain), DIFFERING), warmer], axis=1), carried.rate,
            guess,
        )  # fmt: skip
        gain = found.gain
        # A joint without load torque must not determine how friction grows with it.
        feels = _seen(known + shared @ found.theta[:-1], found)
        reading, grown, known = (array * feels for array in (reading, grown, known))
        shared = shared * feels[:, None]
    assert found is not None
    return found, known + shared @ found.theta[:-1]


def _of_all(
    arm: Arm,
    first: Sequence[Observation],
    second: Sequence[Observation],
    carried: Design,
    sizes: Array,
    mass: float,
) -> tuple[Scales, Array]:
    """Return the scales, and the load's torque, from a fit of arm and load to all efforts."""
    motions = [*first, *second]
    q = np.concatenate([motion.q for motion in motions])
    columns = Columns(arm, q.min(axis=0), q.max(axis=0))
    design = build_design(columns, motions)
    loaded = design.part >= len(first)
    load = np.zeros((*design.y.shape, carried.x.shape[2]))
    load[loaded] = carried.x
    chosen = search_starts(columns)[-1]
    rigid = [i for i in chosen if i < len(columns.rigid.columns)]
    sign, moves = _direction(design.state)
    reading, known = moves * design.y, moves * mass * load[:, :, 0]
    shared = np.concatenate([design.x[:, :, rigid], load[:, :, 1:]], axis=2) * moves[..., None]
    shared_scale = np.concatenate([columns.scale[rigid], sizes])
    # Each motor's own effects may be in the unit of its readings.
    each = [[i for i in chosen if i not in rigid and design.x[:, j, i].any()] for j in range(arm.n)]
    own = np.zeros((*reading.shape, 1 + max(map(len, each))))
    own_scale = np.full(own.shape[1:], DIFFERING)
    for j, index in enumerate(each):
        own[:, j, 1 : 1 + len(index)] = design.x[:, j, index] * moves[:, j, None]
        own_scale[j, 1 : 1 + len(index)] = columns.scale[index]
    guess, grown = _guess(known[loaded], reading[loaded]), np.zeros_like(reading)
    gain = guess
    found = None
    for _ in range(ROUNDS):  # nor is the torque that is transmitted
        own[:, :, 0] = grown / gain
        found = solve_scales(
            reading, known, np.concatenate([shared, grown[..., None]], axis=2),
            np.append(shared_scale, LOAD_FRICTION), own, own_scale, design.rate, guess,
        )  # fmt: skip
        gain = found.gain
        grown = sign * np.abs(known + shared @ found.theta[:-1])
    assert found is not None
    carried_torque = known + moves * (load[:, :, 1:] @ found.theta[len(rigid) : -1])
    return found, carried_torque[loaded]


def _seen(torque: Array, found: Scales) -> Mask:
    """Return (n,) joints at which the (N, n) torque of the load exceeds the residual."""
    noise = np.sqrt(np.mean(found.residual**2, axis=0))
    size = np.sqrt(np.mean((torque / found.gain) ** 2, axis=0))
    return np.asarray((size > SEEN * noise) & (size > 0.0))


def _guess(known: Array, reading: Array) -> Array:
    """Return (n,) initial gains, one size for all joints."""
    size = np.linalg.norm(known, axis=0) / np.maximum(np.linalg.norm(reading, axis=0), 1e-12)
    known_sizes = size[size > 0.0]
    middle = float(np.median(known_sizes)) if len(known_sizes) else 1.0
    return np.full(reading.shape[1], middle)


def _direction(state: State) -> tuple[Array, Array]:
    """Return (N, n) directions of motion, and 1 where a joint moves, so that friction has one."""
    assert state.qd is not None
    speed = np.sqrt(np.mean(state.qd**2, axis=0))
    return np.sign(state.qd), (np.abs(state.qd) > STILL * speed).astype(float)
