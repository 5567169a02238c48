"""A judge of what the compensator may never do, whatever comes in, in whatever order.

A sequence is any mixture of messages (good and bad), silences, changes of parameters, switching
on and off, and the arm's own compensation. The judge keeps its own books on what was sent and
knows nothing of the supervisor's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.compensate import (
    CAUSES,
    DroppedSampleError,
    SampleReader,
    Settings,
    Status,
    Supervisor,
)

MODEL_FILE = Path(__file__).resolve().parents[1] / "config" / "mtmr_28002.yaml"
TOLERANCE = 1e-9  # N·m
HICCUP = 0.02  # s; the longest time in which a command may change at its slew rate


# --- what may come ---------------------------------------------------------------------------


def some_settings(count: int = 24) -> list[Settings]:
    """Settings of every kind, tight and wide, with a model of all terms."""
    rng = np.random.default_rng(7)
    base = TorqueModel.load(MODEL_FILE).parameters() | {
        "elastic_cable.wrist_yaw": [0.0, 0.1, 0.0, 0.3],  # without a range: overflows far out
        "coulomb_friction.motor_positive": [0.05] * 7,
        "viscous_friction.motor": [0.02] * 7,
    }
    found = []
    for number in range(count):

        def seven(upper: float, zeros: float = 0.2) -> list[float]:
            return (rng.uniform(0, upper, 7) * (rng.random(7) > zeros)).tolist()

        values = {
            "enabled": number % 8 != 7,
            "effort_limit": [] if number % 3 == 0 else seven(10.0),
            "actuator_effort_limit": [] if number % 4 == 0 else seven(8.0),
            "slew_limit": [[0.0] * 7, seven(20.0), seven(1.0, 0.0)][number % 3],
            "ramp_time": float(rng.choice([0.0, 0.01, 0.2])),
            "timeout": float(rng.choice([0.01, 0.1])),
            "start_tolerance": float(rng.choice([0.3, 2.0])),
            "friction_compensation.ratio": rng.uniform(0, 1, 7).tolist(),
            "resume": "automatic" if number % 2 else "explicit",
            "disable_builtin": number % 5 == 0,
            "gravity_enabled": number % 6 != 5,
        }
        found.append(Settings.from_parameters(base | values))
    return found


SETTINGS = some_settings()
ARM = SETTINGS[0].model.arm
NAN, INF = math.nan, math.inf
NORMAL = (0.05, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2)
POSITIONS = [
    NORMAL, (0.055, 0.205, 0.095, 0.295, 1.005, 0.1, 0.2),
    (0.05, 0.195, 0.105, 0.3, 0.995, 0.105, 0.205), (0.0,) * 7,
    (-0.3, 0.5, -0.2, -1.0, 2.0, -0.4, 3.0), (9.0,) * 7, (5e-324,) * 7,
    (1e200,) * 7, (NAN,) * 7, (*NORMAL[:6], INF), (*NORMAL[:2], -INF, *NORMAL[3:]), NORMAL[:6],
    (*NORMAL, 0.0), (),
]  # fmt: skip
VELOCITIES = [
    (0.0,) * 7, (0.3, -0.5, 0.2, 1.0, -1.0, 0.1, 3.0), (-30.0,) * 7, (1e-310,) * 7, (1e300,) * 7,
    (), (NAN,) * 7, (0.0,) * 6 + (-INF,), (0.0,) * 3,
]  # fmt: skip
EFFORTS = [
    (0.1, 0.3, 0.1, 0.0, 0.02, -0.01, 0.0), (), (NAN,) * 7, (1e300,) * 7, (-9.0,) * 7, (0.0,) * 8,
]  # fmt: skip
NAMES = [
    JOINT_NAMES, JOINT_NAMES[::-1], JOINT_NAMES[:6], (*JOINT_NAMES[:6], "gripper"),
    (*JOINT_NAMES[:6], JOINT_NAMES[0]), ("gripper", *JOINT_NAMES), (),
]  # fmt: skip
GAPS = [0.001, 0.002, 0.0, 1e-9, 0.004, 0.009, 0.03, 0.09, 0.15, 20.0]
# Stamps: how they go on from the last one, ns; "clock" as time does, None for a zero.
STAMPS = ["clock", 0, None, -1, -50_000_000, 10**15, -(10**15)]
BUILTIN = [(0.0,) * 7, (0.1,) * 7, (NAN,) * 7, ()]
OBSTACLES = [
    ("others", "somebody commands"), ("hold", "nobody listens"), ("others", ""), ("hold", ""),
]  # fmt: skip


def mostly(values: Sequence[Any]) -> st.SearchStrategy:
    """The first value half the time: only good messages get anywhere."""
    return st.one_of(st.just(values[0]), st.just(values[0]), st.sampled_from(values))


MESSAGES = st.tuples(
    st.just("message"), st.sampled_from(GAPS[:3]) | st.sampled_from(GAPS), mostly(STAMPS),
    mostly(NAMES), mostly(POSITIONS), mostly(VELOCITIES), mostly(EFFORTS),
)  # fmt: skip
GOOD = st.tuples(
    st.just("message"), st.sampled_from([0.001, 0.002, 0.008]), st.just("clock"),
    st.just(JOINT_NAMES), st.sampled_from(POSITIONS[:3]), st.sampled_from(VELOCITIES[:3]),
    st.sampled_from(EFFORTS[:3]),
)  # fmt: skip
OTHERS = st.one_of(
    st.tuples(st.just("configure"), st.integers(0, len(SETTINGS) - 1)),
    st.tuples(st.just("look"), st.sampled_from(GAPS)),
    st.tuples(st.just("builtin"), st.sampled_from(BUILTIN)),
    st.sampled_from(OBSTACLES).map(lambda pair: ("obstruct", *pair)),
    st.tuples(st.sampled_from(["enable", "enable", "disable", "fail"])),
)
PRELUDE = [("message", 0.008, "clock", JOINT_NAMES, NORMAL, VELOCITIES[0], EFFORTS[0])] * 15
SEQUENCES = st.lists(st.one_of(GOOD, GOOD, MESSAGES, OTHERS), min_size=1, max_size=60)


# --- the judge -------------------------------------------------------------------------------


@dataclass
class Judge:
    """Plays a sequence into a supervisor, checks every answer, and counts what came."""

    supervisor: Supervisor
    messages: int = 0
    commands: int = 0
    holds: int = 0
    now: float = 50.0
    stamp: int = 10**17
    last: np.ndarray | None = None  # last command of an uninterrupted run of commands
    last_time: float = -INF
    good_time: float = -INF  # when the last message came that was answered
    fresh_time: float = -INF  # when the stamp of the last readable message was first seen
    good_stamp: int | None = None
    builtin: bool = False
    obstacles: set[str] = field(default_factory=set)
    excess: float = 0.0  # N·m by which the command passed new limits when they came
    enabled: bool = True
    fault: str = ""  # "input" or "own": what has to end before commands may come again
    reader: SampleReader = field(default_factory=lambda: SampleReader(ARM))

    def play(self, sequence: list[tuple[Any, ...]]) -> None:
        """Play the events of a sequence, checking each answer."""
        self.enabled = self.supervisor.settings.enabled
        for action, *arguments in sequence:
            before = self.supervisor.active
            if action == "fail":
                self.supervisor.fail("made up")
            else:
                getattr(self, f"_{action}")(*arguments)
            self._after(before)

    def _message(
        self, gap: float, step: Any, names: Any, position: Any, velocity: Any, effort: Any
    ) -> None:
        self.messages += 1
        self.now += gap
        if step == "clock":
            self.stamp += int(gap * 1e9)
        elif step is not None:
            self.stamp += step
        stamp = 0 if step is None else self.stamp
        good = stamp != 0 and self._readable(names, position, velocity)
        if good and stamp != self.good_stamp:
            self.good_stamp, self.fresh_time = stamp, self.now
        try:
            sample = self.reader.read(stamp, names, position, velocity, effort)
            command = self.supervisor.command(sample, self.now, clock=self.stamp)
        except DroppedSampleError as error:
            self.supervisor.drop(error)
            return
        finally:
            assert {*self.supervisor.dropped} == {*CAUSES}
        if command is not None:
            assert good, "a message that cannot be used was answered"
            order = [names.index(joint) for joint in JOINT_NAMES]
            self._check(command, np.array(position)[order])
            self.good_time = self.now

    def _readable(self, names: Any, position: Any, velocity: Any) -> bool:
        counts = [names.count(joint) for joint in JOINT_NAMES]
        lengths = len(position) == len(names) and len(velocity) in (0, len(names))
        if counts != [1] * 7 or not lengths:
            return False
        at = [names.index(joint) for joint in JOINT_NAMES]
        values = [position[i] for i in at] + [velocity[i] for i in at if velocity]
        return bool(np.isfinite(values).all())

    def _check(self, command: np.ndarray, position: np.ndarray) -> None:
        self.commands += 1
        chosen = self.supervisor.settings
        assert np.isfinite(command).all()
        assert self.supervisor.active
        assert not self.supervisor.hold_due, "a command and a hold at once"
        assert not self.builtin, "commanded on top of the arm's own compensation"
        assert self.enabled, "commanded while switched off"
        assert self.fault != "own", "commanded after an error"
        assert not self.fault or chosen.resume_automatically, "resumed by itself"
        assert self.now - self.fresh_time <= chosen.timeout, "answered a stamp that stands still"
        assert not self.obstacles, "commanded against an obstacle"
        assert beyond(command, ARM.effort_limit, ARM.actuator_effort_limit) <= TOLERANCE, "ceiling"
        above = beyond(command, chosen.limits.joint, chosen.limits.actuator)
        if self.last is None:
            self._check_first(command, position)
        else:
            elapsed = self.now - self.last_time
            assert self.now - self.good_time <= chosen.timeout, "answered after a silence"
            largest = chosen.slew_limit * max(elapsed, 1e-6)
            assert (np.abs(command - self.last) <= largest + TOLERANCE).all(), "faster than slew"
        # Limits may have been lowered below the last command: then nothing gets worse.
        assert above <= max(TOLERANCE, self.excess), "beyond its limits"
        self.last, self.last_time = command.copy(), self.now

    def _check_first(self, command: np.ndarray, position: np.ndarray) -> None:
        """A start is near the model's torque, whatever the arm says of its efforts."""
        chosen = self.supervisor.settings
        self.excess = 0.0
        model = chosen.model.torque(position)
        # 0.2 N·m: what the model's friction may add.
        largest = (chosen.start_tolerance + 0.1) * ARM.effort_limit + 0.2
        assert (np.abs(command - model) <= largest).all(), "a start far from the model"

    def _configure(self, index: int) -> None:
        before, chosen = self.supervisor.settings.enabled, SETTINGS[index]
        self.supervisor.configure(chosen, self.now)
        if self.last is not None:
            self.excess = beyond(self.last, chosen.limits.joint, chosen.limits.actuator)
        if chosen.enabled != before:
            self.enabled, self.fault = chosen.enabled, ""

    def _look(self, gap: float) -> None:
        self.now += gap
        limit = self.supervisor.settings.timeout
        self.supervisor.check_input(self.now)
        if self.last is not None and self.now - self.good_time > limit:
            assert not self.supervisor.active, "a silence went unnoticed"

    def _builtin(self, effort: Sequence[float]) -> None:
        self.supervisor.observe_builtin(np.array(effort))
        self.builtin = any(value != 0.0 for value in effort)

    def _obstruct(self, cause: str, reason: str) -> None:
        self.supervisor.obstruct(cause, reason)
        self.obstacles.add(cause) if reason else self.obstacles.discard(cause)

    def _enable(self) -> None:
        self.supervisor.enable()
        self.enabled, self.fault = True, ""

    def _disable(self) -> None:
        self.supervisor.disable()
        self.enabled, self.fault = False, ""

    def _after(self, was_active: bool) -> None:
        supervisor = self.supervisor
        assert supervisor.reason
        assert supervisor.hold_due == (was_active and not supervisor.active), "hold"
        self.holds += supervisor.hold_due
        supervisor.hold_due = False
        self.fault = ""
        if supervisor.status is Status.FAULT:
            self.fault = "input" if "measured_js" in supervisor.reason else "own"
        if not supervisor.active:
            self.last = None


def beyond(torque: np.ndarray, joint: np.ndarray, actuator: np.ndarray) -> float:
    """How far the worst joint or motor is above its limit, N·m; the coupling written out."""
    motor = torque.copy()
    motor[1] = torque[1] - torque[2] + 0.6697 * torque[3]
    motor[2] = torque[2] - 0.6697 * torque[3]
    return max(0.0, (np.abs(torque) - joint).max(), (np.abs(motor) - actuator).max())


def judge(start: int, sequence: list[tuple[Any, ...]]) -> Judge:
    """Play a sequence into a new supervisor and return the judge, content."""
    result = Judge(Supervisor(SETTINGS[start]))
    # Every other one has begun to command: what is drawn seldom stays good for so long.
    result.play(sequence if start % 2 else [*PRELUDE, *sequence])
    return result


def random_sequence(rng: np.random.Generator, length: int) -> list[tuple[Any, ...]]:
    """Events of every kind, one in fifty of them a nuisance; all is switched on again soon."""
    sequence: list[tuple[Any, ...]] = []

    def choice(values: Any) -> Any:
        return values[rng.integers(len(values))]

    while len(sequence) < length:
        draw = rng.random()
        event: tuple[Any, ...]
        if draw < 0.98:
            event = ("message", choice([0.001, 0.002, 0.004]), "clock", choice(NAMES[:2]),
                     choice(POSITIONS[:3]), choice([VELOCITIES[0], ()]),
                     choice(EFFORTS))  # fmt: skip
        elif draw < 0.985:
            event = ("message", choice(GAPS), choice(STAMPS), choice(NAMES), choice(POSITIONS),
                     choice(VELOCITIES), choice(EFFORTS))  # fmt: skip
        elif draw < 0.993:
            event = ("configure", int(rng.integers(len(SETTINGS))))
        else:
            event = choice([("look", choice(GAPS)), ("builtin", choice(BUILTIN)), ("disable",),
                            ("fail",), ("obstruct", *choice(OBSTACLES)), ("enable",)])  # fmt: skip
        sequence.append(event)
        if rng.random() < 0.02:
            sequence += [("builtin", (0.0,) * 7), ("obstruct", "others", ""),
                         ("obstruct", "hold", ""), ("enable",)]  # fmt: skip
    return sequence[:length]
