"""Recordings in whose middle an arm changes or is pushed, and clean ones, for judging a monitor.

    from testing.flights import laboratory

    flight = laboratory("ur5", 3).fly("payload", 0)
    flight.recording, flight.model        # what a monitor gets
    flight.hidden, flight.onset           # what it is to find

An arm is drawn, recorded and identified as in ``benchmark/lab_trials.py``: the model is never
exact. Arms are the package's simulator's (``mtm``) or MuJoCo's with friction, cables and sensors
that nobody models. In both the controller knows the arm as it was: it yields to what happens and
brings the arm back, and position and velocity go on without a jump.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.flight_motion import PausedMotion, back_and_forth, pauses_within
from testing.flight_mtm import MtmBench
from testing.flight_mujoco import MujocoBench
from testing.happening import Bench, Happening
from testing.hidden_parts import Hidden, found
from testing.lab_motion import draw_other

Random = np.random.Generator

ARMS = ("mtm", "ur5", "panda", "kinova", "ur10", "psm", "ecm", "mtml")
"""Those of the benchmark; MuJoCo's others (testing/mujoco_world.py) fly as well."""

BAND = 5.65  # Hz, of what a monitor compares: what a model leaves is measured below it
IDENTIFIED = 30.0  # s, of a clean motion on which that is measured
BLOCK = 600.0  # s, of a clean recording
DURATION = (60.0, 90.0)  # s, of the others
ONSET, AFTER = 30.0, 25.0  # s, before and after something happens, at least
FRICTION = 2.0  # times what the model leaves of the joint
DRIFT = 2.5  # times the joint's friction, at the end of the ramp
ZERO = float(np.radians(2.0))  # rad; where a joint slides a tenth of it, m
TILT = (float(np.radians(2.0)), float(np.radians(4.0)))
SCALE = (1.15, 1.35)  # of a torque constant that changes, or their inverses
IMPULSE = (1.0, 3.0)  # N·s, of a hand
PUSHES = (0.3, 2.0)  # s
STRONG = 0.3  # of a joint's greatest effort: a hand that feels more than that gives way
CENTRE = 0.05  # of a centre of mass's distance
OPENS = 0.025  # m, that a gripper's part moves
_TRIES = 50
_PLACES = ("velocity", "displacement")  # of friction's parameters, those that are no torques


@dataclass(frozen=True)
class Load:
    """What is fastened to an arm.

    Attributes:
        mass: 50 g on a master arm, 5 % of the rated load of an industrial one, kg.
        links: Indices of the joints whose links carry it.
        reach: How far from the link's centre it may be along each axis, m.
    """

    mass: float
    links: tuple[int, ...]
    reach: float


LOADS: Mapping[str, Load] = {
    "mtm": Load(0.05, (5, 6), 0.03),
    "mtmr": Load(0.05, (5, 6), 0.03),
    "mtml": Load(0.05, (5, 6), 0.03),
    "ur5": Load(0.25, (4, 5), 0.08),  # rated 5 kg
    "ur10": Load(0.5, (4, 5), 0.08),  # 10 kg
    "panda": Load(0.15, (5, 6), 0.08),  # 3 kg
    "panda_gripper": Load(0.15, (5, 6), 0.08),
    "kinova": Load(0.13, (4, 5), 0.08),  # 2.6 kg
    "chain": Load(0.1, (2, 3), 0.08),  # of an arm that nobody rates
    # No load is rated: a weight as on the recorded PSM, a camera on the endoscope.
    "psm": Load(0.1, (2,), 0.03),
    "ecm": Load(0.125, (2, 3), 0.05),
}


@dataclass(frozen=True, eq=False)
class Flight:
    """A recording, and what is true of it.

    Attributes:
        arm: Name of the arm.
        seed: Of arm and flight.
        scenario: One of ``SCENARIOS``.
        recording: Time from 0, s; joint space.
        model: What was identified before; what it says is wrong where the scenario says so.
        hidden: Effect of the vocabulary, or ``push``, ``nothing``, ``gripper``; joints; values by
            the names that findings use.
        onset: When it happens, s; 0: from the beginning; of a clean one ``inf``.
        end: When a push, or a gripper's motion, is over, s; else ``inf``.
        motion: What the controller follows; ``None``: nobody knows.
        shown: (n,) RMS of the torque that it adds, while it is there, in units of what the model
            leaves of a clean motion below ``BAND``; zero where that is not computed.
        left: (n,) that, N·m or N.
    """

    arm: str
    seed: int
    scenario: str
    recording: Recording
    model: TorqueModel
    hidden: Hidden
    onset: float
    end: float
    motion: PausedMotion | None
    shown: Array
    left: Array

    def moved(self, time: float) -> float:
        """Return for how long the arm has moved since the onset at some time, s."""
        if self.motion is None:
            return time - self.onset
        return self.motion.moved(self.onset, time)


@dataclass(frozen=True, eq=False)
class Laboratory:
    """An identified arm.

    Attributes:
        name: One of ``ARMS``, or MuJoCo's.
        seed: Of the arm.
        bench: What is recorded.
        model: As identified.
        left: (n,) RMS of what the model leaves of a clean motion below ``BAND``, N·m or N.
    """

    name: str
    seed: int
    bench: Bench
    model: TorqueModel
    left: Array = field(repr=False)

    @classmethod
    def prepare(cls, name: str, seed: int) -> Laboratory:
        """Draw an arm and identify it.

        Args:
            name: One of ``ARMS``, or MuJoCo's.
            seed: Of the arm and its calibration.
        """
        bench: Bench = MtmBench.draw(seed) if name == "mtm" else MujocoBench.draw(name, seed)
        model = identify(bench.calibrate(), bench.arm, "joint").model
        drawn = int(np.random.default_rng([seed, 2]).integers(1 << 30))
        other = draw_other(bench.arm, drawn, bench.calibration, near=1.0)
        clean = bench.record(PausedMotion(other), IDENTIFIED, None, seed + 1)
        left = evaluate(model, [clean], "joint", BAND).joints.values()
        return cls(name, seed, bench, model, np.array([error.rmse for error in left]))

    def fly(self, scenario: str, number: int = 0) -> Flight:
        """Record a flight.

        Args:
            scenario: One of ``SCENARIOS``.
            number: Of the flight, which with arm and scenario is its seed.
        """
        kinds = tuple(SCENARIOS)
        random = np.random.default_rng([self.seed, number, kinds.index(scenario), 77])
        plan = SCENARIOS[scenario](self, random)
        noise = int(random.integers(1 << 30))
        recording = self.bench.record(plan.motion, plan.duration, plan.happening, noise)
        happening, onset, end = plan.happening, np.inf, np.inf
        if happening is not None:
            onset = max(happening.start, 0.0)
            if happening.what in ("push", "gripper"):
                end = happening.end
        elif plan.model is not None:
            onset = 0.0
        return Flight(
            self.name, self.seed, scenario, recording, plan.model or self.model, plan.hidden,
            onset, end, plan.motion, self._shown(recording, happening), self.left,
        )  # fmt: skip

    def _shown(self, recording: Recording, happening: Happening | None) -> Array:
        """Return (n,) how much of it shows, without inertia: RMS while it acts, by what is left."""
        none = np.zeros(self.bench.arm.n)
        if happening is None:
            return none
        assert recording.time is not None
        assert recording.effort is not None
        time = recording.time
        acts = happening if happening.what == "push" else replace(happening, lasts=np.inf)
        rows = np.flatnonzero(acts.acts(time))[::10]
        q, engine, joint = recording.position[rows], self.bench.engine, happening.joint
        still = np.zeros_like(q)
        torque = np.zeros_like(q)
        if happening.what == "payload":
            torque = engine.added((q, still, still), joint, happening.size, happening.place)
        elif happening.what == "push":
            jacobian = engine.tip_jacobian(q, np.zeros(3))
            torque = np.einsum("tij,ti->tj", jacobian, happening.force(time[rows]))
        elif happening.what == "base_tilt":
            gravity = self.bench.arm.gravity
            torque = engine.torque(q, still, still, happening.tilted(gravity) - gravity)
        elif happening.what == "coulomb_friction":
            torque[:, joint] = happening.size
        elif happening.what == "elastic_cable":
            torque = self.bench.cable_torque(q)
        elif happening.what == "torque_scale":
            read = recording.effort[rows, joint]
            torque[:, joint] = read * (1.0 - 1.0 / happening.size)
        elif happening.what == "joint_offset":
            before = q - happening.size * np.eye(len(none))[joint]
            torque = engine.torque(q, still, still) - engine.torque(before, still, still)
        elif happening.what == "drift":
            torque[:, joint] = happening.size * happening.grown(time[rows])
        return np.asarray(np.sqrt(np.mean(torque**2, axis=0)) / self.left)


@lru_cache(maxsize=2)
def laboratory(name: str, seed: int) -> Laboratory:
    """Return an identified arm; the last ones are kept (:meth:`Laboratory.prepare`)."""
    return Laboratory.prepare(name, seed)


@dataclass(frozen=True, eq=False)
class Plan:
    """What a flight is to be.

    Attributes:
        motion: What the controller follows.
        duration: s.
        hidden: What is true.
        happening: What happens.
        model: What the monitor gets in the place of the identified model.
    """

    motion: PausedMotion
    duration: float
    hidden: Hidden
    happening: Happening | None = None
    model: TorqueModel | None = None


def _drawn(
    lab: Laboratory, random: Random, duration: float,
    rest: tuple[float, float] = (2.0, 6.0), between: tuple[float, float] = (12.0, 60.0),
    anywhere: bool = False,
) -> PausedMotion:  # fmt: skip
    """Draw a motion with rests about where the calibration went, or anywhere."""
    seed = int(random.integers(1 << 30))
    motion = draw_other(
        lab.bench.arm, seed, lab.bench.calibration, max(duration, 120.0), 0.0 if anywhere else 1.0
    )
    return PausedMotion(motion, pauses_within(random, duration, rest, between))


def _times(random: Random) -> tuple[float, float]:
    """Draw a duration and the moment of what happens in it, s."""
    duration = float(random.uniform(*DURATION))
    return duration, float(random.uniform(ONSET, duration - AFTER))


def _changed(
    lab: Laboratory, random: Random, make: Callable[[float], Happening], effect: str,
    joint: int | None, **values: float,
) -> Plan:  # fmt: skip
    duration, onset = _times(random)
    motion = _drawn(lab, random, duration)
    hidden = found(lab.bench.arm, effect, joint, **values)
    return Plan(motion, duration, hidden, make(onset))


def _clean(lab: Laboratory, random: Random, anywhere: bool = False) -> Plan:
    """Ten minutes of work: motions, rests, for a part of them seconds at a pose."""
    slow = random.random() < 0.3
    between, rest = ((4.0, 12.0), (3.0, 10.0)) if slow else ((15.0, 90.0), (2.0, 20.0))
    motion = _drawn(lab, random, BLOCK, rest, between, anywhere)
    return Plan(motion, BLOCK, Hidden("nothing", (), {}))


def _elsewhere(lab: Laboratory, random: Random) -> Plan:
    """The same, where the calibration did not go: a model's cables are extrapolated there."""
    return _clean(lab, random, True)


def _payload(lab: Laboratory, random: Random) -> Plan:
    load = LOADS[lab.name]
    joint = int(random.choice(load.links))
    place = lab.bench.engine.centres[joint] + load.reach * random.uniform(-1.0, 1.0, 3)
    moments = {
        f"first_moment_{axis}": load.mass * at for axis, at in zip("xyz", place, strict=True)
    }
    return _changed(
        lab, random, lambda t: Happening("payload", joint, t, load.mass, place), "payload", joint,
        mass=load.mass, **moments,
    )  # fmt: skip


def _friction(lab: Laboratory, random: Random) -> Plan:
    """Of twice what the model leaves of a clean motion below a monitor's band."""
    joint = int(random.integers(lab.bench.arm.n))
    return _rubs(lab, random, joint, FRICTION * float(lab.left[joint]))


def _friction_of_noise(lab: Laboratory, random: Random) -> Plan:
    """Of twice the standard deviation of an effort as it is read, unfiltered."""
    joint = int(random.integers(lab.bench.arm.n))
    return _rubs(lab, random, joint, FRICTION * float(lab.bench.noise[joint]))


def _rubs(lab: Laboratory, random: Random, joint: int, level: float) -> Plan:
    return _changed(
        lab, random, lambda t: Happening("coulomb_friction", joint, t, level), "coulomb_friction",
        joint, level=level,
    )  # fmt: skip


def _cable(lab: Laboratory, random: Random) -> Plan:
    joint = lab.bench.cable
    return _changed(
        lab, random, lambda t: Happening("elastic_cable", joint, t), "elastic_cable", joint
    )


def _zero(lab: Laboratory, random: Random) -> Plan:
    # Of a joint whose position the weight depends on: elsewhere only a camera could know.
    q = np.array([lab.bench.calibration.middle])
    still = np.zeros_like(q)
    shift = np.eye(lab.bench.arm.n) * 0.1 * lab.bench.arm.scale
    slopes = [
        lab.bench.engine.torque(q + step, still, still)
        - lab.bench.engine.torque(q - step, still, still)
        for step in shift
    ]
    shows = np.array([np.max(np.abs(slope[0]) / lab.left) for slope in slopes])
    joint = int(random.choice(np.flatnonzero(shows >= 0.3 * shows.max())))
    offset = ZERO * float(lab.bench.arm.scale[joint]) * float(random.choice([-1.0, 1.0]))
    return _changed(
        lab, random, lambda t: Happening("joint_offset", joint, t, offset), "joint_offset", joint,
        offset=offset,
    )  # fmt: skip


def _scale(lab: Laboratory, random: Random) -> Plan:
    # Of the joints that carry more than their friction.
    q = lab.bench.calibration.at(np.arange(0.0, 30.0, 0.5))[0]
    weight = np.abs(lab.bench.engine.torque(q, np.zeros_like(q), np.zeros_like(q))).mean(axis=0)
    carries = weight / lab.left
    joint = int(random.choice(np.flatnonzero(carries >= 0.5 * carries.max())))
    factor = float(random.uniform(*SCALE)) ** float(random.choice([-1.0, 1.0]))
    return _changed(
        lab, random, lambda t: Happening("torque_scale", joint, t, factor), "torque_scale", joint,
        factor=factor,
    )  # fmt: skip


def _push(lab: Laboratory, random: Random) -> Plan:
    """A hand at the tip, no stronger than joints can bear."""
    duration, onset = _times(random)
    motion = _drawn(lab, random, duration)
    arm = lab.bench.arm
    best: tuple[float, Happening] | None = None
    for _ in range(_TRIES):
        way = random.normal(size=3)
        lasts = float(np.exp(random.uniform(*np.log(PUSHES))))
        happening = Happening(
            "push", arm.n - 1, onset, float(random.uniform(*IMPULSE)), way / np.linalg.norm(way),
            lasts, bool(random.random() < 0.5),
        )  # fmt: skip
        time = onset + lasts * np.linspace(0.0, 1.0, 21)
        jacobian = lab.bench.engine.tip_jacobian(motion.at(time)[0], np.zeros(3))
        torque = np.einsum("tij,ti->tj", jacobian, happening.force(time))
        strain = float(np.max(np.abs(torque) / arm.effort_limit))
        if best is None or strain < best[0]:
            best = strain, happening
        if strain < STRONG:
            best = strain, happening
            break
    assert best is not None
    happening = best[1]
    force = happening.size * happening.place
    values = {axis: float(part) for axis, part in zip("xyz", force, strict=True)}
    hidden = Hidden("push", (), {"impulse": happening.size, "lasts": happening.lasts, **values})
    return Plan(motion, duration, hidden, happening)


def _drift(lab: Laboratory, random: Random) -> Plan:
    """An arm that stands still, one of whose efforts creeps up for ten minutes."""
    joint = int(random.integers(lab.bench.arm.n))
    level = float(lab.bench.friction[joint] + lab.left[joint])
    height = DRIFT * level * float(random.choice([-1.0, 1.0]))
    stops, onset = 20.0, 40.0
    motion = _drawn(lab, random, 120.0)
    motion = replace(motion, pauses=((stops, 1e4),))
    hidden = found(lab.bench.arm, "drift", joint, height=height)
    return Plan(
        motion, onset + BLOCK + 20.0, hidden,
        Happening("drift", joint, onset, height, lasts=BLOCK),
    )  # fmt: skip


def _tilt(lab: Laboratory, random: Random) -> Plan:
    angle, way = float(random.uniform(*TILT)), float(random.uniform(0.0, 2.0 * np.pi))
    axis = np.array([np.cos(way), np.sin(way), 0.0])
    duration, _ = _times(random)
    hidden = found(lab.bench.arm, "base_tilt", None, angle=angle)
    motion = _drawn(lab, random, duration)
    return Plan(motion, duration, hidden, Happening("base_tilt", 0, -np.inf, angle, axis))


def _centre(lab: Laboratory, random: Random) -> Plan:
    """Poses, seconds at each, with a link's centre of mass 5 % farther out than identified."""
    joint = int(random.choice(np.arange(1, lab.bench.arm.n)))
    centre = lab.bench.engine.centres[joint]
    motion = _drawn(lab, random, DURATION[1], (3.0, 6.0), (3.0, 5.0))
    hidden = found(lab.bench.arm, "link_com", joint)
    happening = Happening("link_com", joint, -np.inf, CENTRE, centre)
    return Plan(motion, DURATION[1], hidden, happening)


def _half_friction(lab: Laboratory, random: Random) -> Plan:
    """Reversals, with a model that has half of the friction that was identified."""
    frictions = tuple(term.NAME for term in lab.model.terms if term.FRICTION)
    values = {
        name: (0.5 * np.asarray(value)).tolist()
        if name.startswith(frictions) and not name.endswith(_PLACES)
        else value
        for name, value in lab.model.parameters().items()
    }
    halved = TorqueModel.from_parameters(values, lab.bench.arm)
    drawn = _drawn(lab, random, DURATION[1])
    motion = PausedMotion(back_and_forth(drawn.motion))
    hidden = found(lab.bench.arm, "coulomb_friction", None)
    return Plan(motion, DURATION[1], hidden, model=replace(lab.model, terms=halved.terms))


def _gripper(lab: Laboratory, random: Random) -> Plan:
    """A part of what the last link holds moves by some centimetres."""
    load = LOADS[lab.name]
    joint, way = load.links[-1], random.normal(size=3)
    happening = Happening(
        "gripper", joint, 0.0, 0.4 * load.mass, OPENS * way / np.linalg.norm(way),
        float(random.uniform(0.3, 1.0)),
    )  # fmt: skip
    return _changed(
        lab, random, lambda t: replace(happening, start=t), "gripper", joint,
        mass=happening.size,
    )  # fmt: skip


SCENARIOS: Mapping[str, Callable[[Laboratory, Random], Plan]] = {
    "clean": _clean,
    "payload": _payload,
    "coulomb_friction": _friction,
    "elastic_cable": _cable,
    "joint_offset": _zero,
    "torque_scale": _scale,
    "push": _push,
    "half_friction": _half_friction,
    "link_com": _centre,
    "drift": _drift,
    "base_tilt": _tilt,
    "gripper": _gripper,
    "friction_of_noise": _friction_of_noise,
    "elsewhere": _elsewhere,
}
"""Scenario -> how a flight of it is planned. Their order is part of the seeds: new ones come last.
"""
