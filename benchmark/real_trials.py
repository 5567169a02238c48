"""Put known effects into recordings of real arms and look for them with an identified model.

    python benchmark/real_trials.py --jobs 2 --json real.json

A part of a real recording identifies; another one is diagnosed as it is, and with the torque of
one effect added to its efforts, or its readings changed. Recordings with a real load of known mass
are diagnosed, too. The recordings are no part of the repository: their folder is ``../shared/data``
or the one that ``DVRK_GRAVITY_DATA`` names; what is absent, or is of an arm that the package does
not know, is left out, saying so.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import RotorInertia, links_of_joints
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing import lab_effects
from testing.hidden_parts import Hidden
from testing.jobs import run_all
from testing.lab_effects import Hiding, Setting, left_by
from testing.lab_physics import Truth
from testing.session import Laboratory, Session, Trial, hold, tell

DATA = Path(
    os.environ.get("DVRK_GRAVITY_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")
)
SIZES = (2.0, 5.0)  # times what the model leaves on the part that is diagnosed
IDENTIFIED = 0.55  # of a recording's time; the rest is diagnosed
PLACES = 3  # joints, and sizes, an effect
# Hz, of accelerations that masses are hidden with. An MTM's wrist vibrates at 4 to 8 Hz, and its
# efforts follow: identified without what is faster than 3 Hz in them, wrist_pitch is left with a
# quarter of its torque instead of a fifth. Inertia that left that out would be none.
BAND = 10.0
UR10E_GAINS = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])  # N·m/A, published


@dataclass(frozen=True, eq=False)
class Case:
    """Real recordings of one arm.

    Attributes:
        name: What the table calls it.
        arm: The arm.
        calibration: What the model is identified from.
        other: What is diagnosed.
        loads: Recordings with a real load: name, recording, and what it is.
        masses: Payloads that are put into ``other``, kg.
        reach: How far from a link's frame they are, m.
    """

    name: str
    arm: Arm
    calibration: Recording
    other: Recording
    masses: tuple[float, float]
    reach: float
    loads: tuple[tuple[str, Recording, Hidden], ...] = ()


class ModelBodies:
    """Masses on an arm by Pinocchio; the arm's own are those of the identified model."""

    def __init__(self, model: TorqueModel) -> None:
        """Take a model; its gravity term follows any gravity."""
        self._arm = model.arm
        self._weights = [term for term in model.terms if term.gravity_vector is not None]
        # Behind a joint that gives way are no motors, and friction is most of it at their gears.
        links = (
            term for term in model.terms if not (term.FRICTION or isinstance(term, RotorInertia))
        )
        self._links = TorqueModel(model.arm, tuple(links))

    def added(
        self, motion: tuple[Array, Array, Array], joint: int, mass: float, com: Array,
        inertia: float = 0.0,
    ) -> Array:  # fmt: skip
        """See :meth:`Bodies.added`."""
        body = pin.Inertia(mass, np.asarray(com), inertia * np.eye(3))
        tree = build_tree(
            self._arm,
            {self._arm.body_names[links_of_joints(self._arm)[joint]]: body},
            self._arm.gravity,
        )
        return np.array([tree.inverse_dynamics(*row) for row in zip(*motion, strict=True)])

    def torque(self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None) -> Array:
        """See :meth:`Bodies.torque`."""
        if gravity is None:
            return self._links.torque(q, qd, qdd)
        turned = tuple(term.with_gravity(np.asarray(gravity)) for term in self._weights)
        return TorqueModel(self._arm, turned).torque(q)


def mtm() -> Case:
    """Return an MTMR's dynamic recording: its first part identifies, the rest is diagnosed."""
    return _mtm("mtm", True)


def mtm_reversed() -> Case:
    """Return the same with its last part to identify from."""
    return _mtm("mtm_reversed", False)


def _mtm(name: str, first: bool) -> Case:
    """Cut the recording in two; its motion repeats after 11.67 s, so either has a whole period."""
    arm = Arm.load("mtmr")
    whole = Recording.load(_path("mtm_dynamic_30s_200hz.csv"), coordinates="actuator", arm=arm)
    calibration, other = _cut(whole, first)
    return Case(name, arm, calibration, other, (0.04, 0.076), 0.03)


def ur10e() -> Case:
    """Return an industrial arm, whose currents are taken for torques by published gains."""
    arm = Arm.load(str(_path("ur10e/ur10e.urdf")))

    def load(name: str) -> Recording:
        recording = Recording.load(_path(f"ur10e/{name}.csv"), arm=arm)
        assert recording.effort is not None
        return replace(recording, effort=recording.effort * UR10E_GAINS)

    calibration, other = _cut(load("ur10e_bare"), True)
    loaded = Hidden("payload", (arm.joint_names[-1],), {"mass": 2.805})
    loads = (("2.805 kg", load("ur10e_2805g"), loaded),)
    return Case("ur10e", arm, calibration, other, (1.0, 2.0), 0.08, loads)


def psm() -> Case:
    """Return a PSM: one recording identifies, the same motion bare and with a weight is looked at.

    The weight hangs on the instrument's carriage, which insertion moves.
    """
    arm = Arm.load("psm")

    def load(name: str) -> Recording:
        return Recording.load(_path(f"psm/{name}.csv"), coordinates="actuator", arm=arm)

    loaded = Hidden("payload", ("insertion",), {"mass": 0.105})
    loads = (("105 g", load("psm_one_105g_insertion"), loaded),)
    return Case("psm", arm, load("psm_one"), load("psm_one_bare"), (0.05, 0.1), 0.03, loads)


CASES: Mapping[str, Callable[[], Case]] = {
    "mtm": mtm, "mtm_reversed": mtm_reversed, "psm": psm, "ur10e": ur10e,
}  # fmt: skip


def _path(name: str) -> Path:
    path = DATA / name
    if not path.is_file():
        raise ConfigError("recording", str(path), "a file (DVRK_GRAVITY_DATA names its folder)")
    return path


def _cut(whole: Recording, first: bool) -> tuple[Recording, Recording]:
    assert whole.time is not None
    start, end = whole.time[0], whole.time[-1]
    share = IDENTIFIED if first else 1.0 - IDENTIFIED
    middle = start + share * (end - start)
    parts = whole.between(start, middle), whole.between(middle, end + 1.0)
    return parts if first else parts[::-1]


def truth_of(recording: Recording, arm: Arm) -> Truth:
    """Return a recorded motion without counts and noise, and its efforts as they are, at joints."""
    assert recording.time is not None
    assert recording.effort is not None
    position, effort = recording.position, recording.effort
    if recording.coordinates == "actuator":
        position, effort = arm.joint_position(position), arm.joint_effort(effort)
    rate = 200.0
    grid = np.arange(recording.time[0], recording.time[-1], 1.0 / rate)
    even = np.stack([np.interp(grid, recording.time, column) for column in position.T], axis=1)
    smooth = sosfiltfilt(butter(3, BAND, fs=rate, output="sos"), even, axis=0)
    speed = np.gradient(smooth, 1.0 / rate, axis=0)
    acceleration = np.gradient(speed, 1.0 / rate, axis=0)
    q, qd, qdd = (
        np.stack([np.interp(recording.time, grid, column) for column in part.T], axis=1)
        for part in (smooth, speed, acceleration)
    )
    return Truth(arm, recording.time, q, qd, qdd, effort)


def with_hidden(recording: Recording, before: Truth, after: Truth) -> Recording:
    """Return a recording with what was hidden in its truth, in its own coordinates.

    A sample that repeats the one before repeats that with what was hidden.
    """
    assert recording.effort is not None
    arm, velocity = before.arm, recording.velocity
    read = _repeated(recording)
    moved, faster = (after.q - before.q)[read], (after.qd - before.qd)[read]
    added = (after.effort - before.effort)[read]
    if recording.coordinates == "actuator":
        moved, faster = arm.actuator_position(moved), arm.actuator_position(faster)
        added = arm.actuator_effort(added)
    return replace(
        recording,
        position=recording.position + moved,
        velocity=None if velocity is None else velocity + faster,
        effort=recording.effort + added,
    )


def _repeated(recording: Recording) -> Array:
    """Return (N,) the sample that each one is, or repeats."""
    assert recording.effort is not None
    read = (recording.position, recording.velocity, recording.effort)
    arrays = np.hstack([each for each in read if each is not None])
    new = np.append(True, np.any(arrays[1:] != arrays[:-1], axis=1))
    return np.asarray(np.maximum.accumulate(np.where(new, np.arange(len(new)), 0)))


def trials(case: Case, effects: Sequence[str], places: int, model: TorqueModel) -> Iterator[Trial]:
    """Yield effect, number and recording of every trial."""
    truth = truth_of(case.other, case.arm)
    residual = left_by(model, in_joints(case.other, case.arm))
    at_frames = np.zeros((case.arm.n, 3))
    rotors = model.term(RotorInertia.NAME)
    setting = Setting(
        truth, ModelBodies(model), residual, case.masses, case.reach, at_frames,
        rotors=rotors.motor if isinstance(rotors, RotorInertia) else 0.0,
    )  # fmt: skip

    def hidden(hiding: Hiding) -> tuple[Recording, Hidden, float]:
        return with_hidden(case.other, truth, hiding.truth), hiding.hidden, hiding.ratio

    nothing = Hidden("nothing", (), {})
    yield "nothing", 0, lambda: (case.other, nothing, 0.0)
    for number, (_, recording, load) in enumerate(case.loads):
        size = float(np.max(left_by(model, in_joints(recording, case.arm)) / residual))
        yield "payload", 100 + number, lambda r=recording, h=load, s=size: (r, h, s)
    n = case.arm.n
    for kind, effect in enumerate(effects):
        if effect == "payload":
            spots = [(joint, mass) for joint in (n - 1, n - 2, n // 2) for mass in case.masses]
            for number, (joint, mass) in enumerate(spots):
                random = np.random.default_rng([kind, number])
                com = case.reach * random.uniform(-1.0, 1.0, 3)
                yield (
                    effect,
                    number,
                    lambda j=joint, m=mass, p=com: hidden(lab_effects.payload(setting, j, m, p)),
                )
            continue
        for number in range(1 if effect in ("base_tilt", "time_delay") else places):
            random = np.random.default_rng([kind, number])
            yield (
                effect,
                number,
                lambda e=effect, r=random: hidden(lab_effects.hide(setting, e, r, sizes=SIZES)),
            )


def in_joints(recording: Recording, arm: Arm) -> Recording:
    """Return a recording in joint coordinates."""
    if recording.coordinates == "joint":
        return recording
    assert recording.effort is not None
    velocity = recording.velocity
    return replace(
        recording,
        coordinates="joint",
        position=arm.joint_position(recording.position),
        velocity=None if velocity is None else arm.joint_position(velocity),
        effort=arm.joint_effort(recording.effort),
    )


def run(name: str, effects: Sequence[str], places: int) -> Session:
    """Identify and try every effect in one case."""

    def prepare() -> Laboratory:
        case = CASES[name]()
        recording = case.calibration
        each = partial(trials, case, effects, places)
        return Laboratory(case.arm, recording, each, recording.coordinates)

    return hold(Session("real", name, 0), prepare)


def main() -> int:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    # fmt: off
    parser.add_argument("--cases", nargs="*", choices=tuple(CASES), default=list(CASES))
    parser.add_argument("--effects", nargs="*", help="only these (default: all)")
    parser.add_argument("--places", type=int, default=PLACES,
                        help="joints and sizes an effect (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", help="write every trial here")
    # fmt: on
    args = parser.parse_args()
    if not DATA.is_dir():
        print(f"skipped: no {DATA} (DVRK_GRAVITY_DATA names another folder)")
        return 0
    known = [effect for effect in lab_effects.HIDERS if effect != "nothing"]
    effects = [effect for effect in known if args.effects is None or effect in args.effects]
    todo = [(case, effects, args.places) for case in args.cases]
    tell("real recordings", run_all(run, todo, args.jobs), args.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
