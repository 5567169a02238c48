"""Friction compensation that is too large, in a passive hand; and one that is right, at work.

    PYTHONPATH=. python benchmark/passivity.py [--quick] [--json FILE]

The shipped plant with all its sensors' noise, the velocity rounded to steps of 0.05 rad/s and late
by 0, 10 or 30 ms. The model knows weight and cables and takes friction to be 0 to 100 % more than
it is; 70 % of that is compensated. Each joint is in a hand that is a spring, let go when displaced,
with or without damping and mass; or in none, and is pushed off. What 70 % of the model's friction
puts into the arm is too much from 43 % on.

A joint in a passive hand may not get faster than `growth` times what the right model makes of the
same hand (without an observer), or than its allowance, whichever is more; and twice that for what
the delay hides and coupled joints pass on. The last third of each run is told by itself: a motion
that grows is fastest there.

Then a hand that works: it moves all joints along, gently, evenly, or in uneven moves with and
without rests, with a right model. The factor, weighted by the power of friction, says how much of
the compensation is left. Status 1 if a bound is broken or too little is left.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.compensate import SETTINGS, PassivityObserver, Settings, slew
from dvrk_gravity.files import text_file
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.parameters import node_parameters
from dvrk_gravity.simulate import Plant, PlantFile, SimulatedArm

TRUTH = PlantFile.load("mtmr_28002")
ALLOWANCE = np.array(
    node_parameters(Arm.load("mtmr"))["friction_compensation.allowance"].default
)  # rad/s
POSE = np.array([-0.2, 0.15, 0.0, 0.5, 1.0, 0.0, 0.0])
SPEED = np.array([0.3, 0.2, 0.2, 1.2, 1.2, 0.5, 3.0])  # rad/s, that the hand gives
VELOCITY_STEP = 0.05  # rad/s
RATIO, HIDDEN, DT = 0.7, 2.0, 1e-3
# What was left when this was written (1.00, 0.99, 0.74, 0.63), rounded down: it may not get worse.
LEAST_FACTOR = {"gentle": 0.98, "even": 0.98, "uneven": 0.7, "uneven with rests": 0.6}
SCALED = ("coulomb_friction.", "viscous_friction.")


@dataclass(frozen=True)
class Hand:
    """A passive hand at every joint.

    Attributes:
        frequency: Of arm and spring, Hz; 0: no hand, the arm is pushed off.
        damping: Damping ratio.
        mass: Its inertia over the joint's own.
    """

    frequency: float
    damping: float = 0.0
    mass: float = 0.0


def model_with(excess: float) -> TorqueModel:
    """Return the true model but for friction, which is taken to be more by this part."""
    values = dict(TRUTH.model.parameters())
    for name, value in values.items():
        if name.startswith(SCALED) and "transition" not in name:
            values[name] = tuple((1.0 + excess) * np.array(value))
    for joint in JOINT_NAMES:
        both = [
            np.array(values[f"directional_cable.{way}.{joint}"]) for way in ("positive", "negative")
        ]
        mean, half = 0.5 * (both[0] + both[1]), 0.5 * (both[0] - both[1])
        for way, sign in (("positive", 1.0), ("negative", -1.0)):
            values[f"directional_cable.{way}.{joint}"] = tuple(mean + sign * (1.0 + excess) * half)
    return TorqueModel.from_parameters(values)


def settings_of(excess: float) -> Settings:
    """Return the compensator's settings with that model and the default caution."""
    values = {**model_with(excess).parameters(), "friction_compensation.ratio": [RATIO] * 7}
    return Settings.from_parameters(values)


class Compensator:
    """What the compensator does with a sample, without its states.

    Attributes:
        fed: (7,) power of friction at full factor, summed over the samples.
        applied: (7,) the same at the factor that was applied.
    """

    def __init__(self, settings: Settings, observed: bool) -> None:
        """Start; without an observer the factor stays one."""
        self.settings = settings
        self.fed, self.applied = np.zeros(7), np.zeros(7)
        self._observer = (
            PassivityObserver(settings.friction_ratio, ALLOWANCE, settings.limits.coupled)
            if observed
            else None
        )
        self._command: np.ndarray | None = None

    def command(self, q: np.ndarray, qd: np.ndarray, now: float) -> np.ndarray:
        """Return the effort that answers a sample."""
        settings = self.settings
        conservative, friction = settings.parts(q, qd)
        factor = np.ones(7) if self._observer is None else self._observer.update(qd, friction, now)
        self.fed += np.abs(friction * qd)
        self.applied += factor * np.abs(friction * qd)
        target = settings.limits.clip(conservative + factor * friction)
        previous = target if self._command is None else self._command
        self._command = slew(previous, target, settings.slew_limit * DT, settings.limits)
        return self._command


def run(
    compensator: Compensator,
    plant: Plant,
    push: Callable[[np.ndarray, np.ndarray, float], np.ndarray],
    delay: float,
    duration: float,
) -> np.ndarray:
    """Return the (N, 7) true speeds of an arm under compensation that is pushed by a hand."""
    arm = SimulatedArm(plant, TRUTH.sensors, builtin_compensation=False, dt=DT)
    first = (plant.q.copy(), np.round(plant.v / VELOCITY_STEP) * VELOCITY_STEP)
    late = deque([first] * (1 + round(delay / DT)), maxlen=1 + round(delay / DT))
    speeds = np.empty((round(duration / DT), 7))
    for step in range(len(speeds)):
        arm.servo_jf(compensator.command(*late[0], plant.time))
        arm.push(push(plant.q, plant.v, plant.time), 2 * DT)
        arm.step()
        measured = arm.measure()
        late.append(
            (measured.position, np.round(measured.velocity / VELOCITY_STEP) * VELOCITY_STEP)
        )
        speeds[step] = np.abs(plant.v)
    return speeds


def in_hand(hand: Hand, excess: float, delay: float, observed: bool, duration: float) -> np.ndarray:
    """Return the (N, 7) speeds of the arm in a passive hand."""
    probe = TRUTH.plant()
    probe.reset(POSE)
    inertia = np.diag(probe.mass_matrix())
    plant = Plant(TRUTH.model, TRUTH.links, TRUTH.rotor_inertia + hand.mass * inertia)
    omega = 2 * np.pi * hand.frequency
    inertia = (1.0 + hand.mass) * inertia
    stiffness, damping = inertia * omega**2, 2 * hand.damping * inertia * omega
    away = SPEED / omega if omega else np.zeros(7)
    plant.reset(POSE + away, np.zeros(7) if omega else 0.5 * SPEED)

    def push(q: np.ndarray, v: np.ndarray, now: float) -> np.ndarray:
        return stiffness * (POSE - q) - damping * v

    return run(Compensator(settings_of(excess), observed), plant, push, delay, duration)


def bound(hand: Hand, delay: float, duration: float) -> np.ndarray:
    """Return the (7,) speeds that a passive hand may see, from what the right model does in it."""
    right = in_hand(hand, 0.0, delay, False, duration).max(axis=0)
    return HIDDEN * np.maximum(SETTINGS.allowed_growth * right, ALLOWANCE)


def moves(
    kind: str, duration: float, seed: int
) -> Callable[[float], tuple[np.ndarray, np.ndarray]]:
    """Return (7,) position and velocity over time of a hand that moves all joints."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, duration, DT)
    if kind in ("gentle", "even"):
        speed = 0.4 * ALLOWANCE if kind == "gentle" else SPEED
        v = speed * np.sin(2 * np.pi * 0.8 * time[:, None])
    else:
        v = np.zeros((len(time), 7))
        for joint in range(7):
            start, sign = 0, 1.0
            while start < len(time):
                # Least jerk: the greatest speed is 15/8 of the mean one (Flash and Hogan 1985).
                way, speed = (
                    SPEED[joint] * random.uniform(0.3, 0.8),
                    SPEED[joint] * random.uniform(1, 2),
                )
                length = max(int(1.875 * way / speed / DT), 2)
                u = np.arange(length) / length
                piece = sign * way / (length * DT) * 30 * u**2 * (1 - u) ** 2
                end = min(start + length, len(time))
                v[start:end, joint] = piece[: end - start]
                start, sign = end, -sign
                if kind.endswith("rests"):
                    start += int(random.exponential(0.7) / DT)
    q = POSE + DT * np.cumsum(v, axis=0)
    return lambda now: (q[min(round(now / DT), len(q) - 1)], v[min(round(now / DT), len(v) - 1)])


def worked(kind: str, delay: float, duration: float, seed: int = 0) -> np.ndarray:
    """Return the (7,) part of friction compensation that is left where the model is right."""
    plant = TRUTH.plant()
    plant.reset(POSE)
    motion = moves(kind, duration, seed)
    inertia = np.diag(plant.mass_matrix())
    omega = 2 * np.pi * 6.0  # a firm grip

    def push(q: np.ndarray, v: np.ndarray, now: float) -> np.ndarray:
        position, velocity = motion(now)
        return inertia * (omega**2 * (position - q) + 2 * omega * (velocity - v))

    compensator = Compensator(settings_of(0.0), True)
    run(compensator, plant, push, delay, duration)
    return compensator.applied / np.maximum(compensator.fed, 1e-12)


def cases(quick: bool) -> Iterator[tuple[float, Hand, float]]:
    """Return excess of friction, hand and delay."""
    if quick:
        yield from product((0.5, 1.0), (Hand(0.0), Hand(3.0)), (0.03,))
        return
    hands = (
        Hand(0.0), Hand(0.5), Hand(1.0), Hand(1.0, damping=0.1), Hand(1.0, mass=3.0), Hand(3.0),
        Hand(8.0),
    )  # fmt: skip
    yield from product((0.0, 0.5, 1.0), hands, (0.0, 0.01, 0.03))
    yield from product((0.43, 0.75), (Hand(0.0), Hand(3.0)), (0.03,))


def main() -> int:
    """Print the tables; status 1 if a bound is broken."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few cases, seconds")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    duration = 3.0 if arguments.quick else 6.0
    bounds: dict[tuple[Hand, float], np.ndarray] = {}
    rows, broken = [], 0
    print("friction   hand: Hz  damping   mass  delay   greatest speed over what is allowed, joint")
    print(f"{'ms':>43}   {'without observer':<24}{'with':<22} last third")
    for excess, hand, delay in cases(arguments.quick):
        if (hand, delay) not in bounds:
            bounds[hand, delay] = bound(hand, delay, duration)
        speeds = [in_hand(hand, excess, delay, observed, duration) for observed in (False, True)]
        parts = [speed / bounds[hand, delay] for speed in speeds]
        late = parts[1][-len(parts[1]) // 3 :].max()
        without, observed = (part.max(axis=0) for part in parts)
        broken += bool(observed.max() > 1.0)
        told = (
            f"{part.max():6.2f} {JOINT_NAMES[part.argmax()]:<17}" for part in (without, observed)
        )
        print(
            f"{excess:+8.0%} {hand.frequency:10.1f} {hand.damping:8.1f} {hand.mass:6.1f}"
            f" {delay * 1e3:6.0f}   {''.join(told)}{late:6.2f}", flush=True,
        )  # fmt: skip
        rows.append({"excess": excess, **vars(hand), "delay_s": delay, "late": late,
                     "without": without.tolist(), "with": observed.tolist()})  # fmt: skip
    print(
        f"\n{'a hand that works, right model: part left':<44}"
        + "".join(f"{n:>15}" for n in JOINT_NAMES)
    )
    remaining, too_little = {}, 0
    for kind, least in LEAST_FACTOR.items():
        part = worked(kind, 0.01, 20.0)
        remaining[kind] = part.tolist()
        too_little += bool(part.min() < least)
        print(f"  {kind + f' (at least {least:g})':<42}" + "".join(f"{p:>15.2f}" for p in part))
    failed_before = sum(max(row["without"]) > 1.0 for row in rows)
    print(f"\nbeyond the bound, of {len(rows)}: without observer {failed_before}, with it {broken}")
    if arguments.json is not None:
        content = {"passive": rows, "left": remaining, "broken": broken}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 1 if broken or too_little or not failed_before else 0


if __name__ == "__main__":
    sys.exit(main())
