"""A driver of an arm that is only a path, and brief plans for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import CollectedRecording, CollectSettings, SimulatedDriver, collect
from dvrk_gravity.planning import Basis, FourierMotion, Plan, PlanLimits, slacks
from dvrk_gravity.recording import Recording, encode_joint_state
from dvrk_gravity.simulate import PlantFile

STEP = 5e-3  # s
WHOLE = 801  # samples of a motion of 4 s
BRIEF = CollectSettings(disturbed=0.3, mark=0.2)


def plan_of(name: str, duration: float = 4.0, seed: int = 1, size: float = 1.0) -> Plan:
    """Return a motion that uses all of its velocities or accelerations."""
    arm = Arm.load(name)
    limits = PlanLimits.of(arm)
    random = np.random.default_rng(seed)
    basis = Basis(np.array([0.5, 1.0]), 0.8, duration)
    middle = 0.5 * (limits.lower + limits.upper)
    coefficients = random.normal(size=(4, arm.n)) * arm.scale
    for _ in range(2):
        motion = FourierMotion(basis, middle, coefficients)
        most = max(slack.used for slack in slacks(motion, limits, arm))
        coefficients = (1.0 - 1e-6) * size * coefficients / most
    return Plan(arm, motion, limits)


@dataclass
class PathDriver:
    """An arm that is where it is commanded to be, until something stops it.

    ``stop`` returns the error that stops it, if any, by phase and s of the phase; ``torque`` (N, n)
    efforts. Each set point is a position, velocity and acceleration.
    """

    arm: Arm
    at: np.ndarray
    stop: Callable[[str, float], BaseException | None] = lambda phase, time: None
    torque: Callable[..., np.ndarray] | None = None
    topic: str = "/ARM/measured_js"
    step: float = STEP
    clock: int = 10**18
    phases: list[str] = field(default_factory=lambda: [""])
    commanded: list[np.ndarray] = field(default_factory=list)
    holds: int = 0

    def __enter__(self) -> PathDriver:
        return self

    def __exit__(self, *_: object) -> None:
        self.hold()

    def connect(self) -> np.ndarray:
        return self.at

    def follow(self, path, duration, record=None, progress=None, watch=None) -> float:
        time = np.append(np.arange(0.0, duration, self.step), duration)
        states = path(time)
        efforts = [] if self.torque is None else self.torque(*states).tolist()
        for k, (moment, *each) in enumerate(zip(time.tolist(), *states, strict=True)):
            error = self.stop(self.phases[-1], moment)
            if error is not None:
                raise error
            self.commanded.append(np.array(each))
            self.at = each[0]
            if progress is not None:
                progress(moment / duration)
            self.clock += round(self.step * 1e9)
            if record is not None:
                fields = (self.arm.joint_names, each[0].tolist(), each[1].tolist())
                record(encode_joint_state(self.clock, *fields, *efforts[k : k + 1]))
        return 0.0

    def hold(self) -> bool:
        self.holds += 1
        return True

    def report(self, line: str) -> None:
        self.phases.append(line.split(":")[0])


def at_beginning(plan: Plan, stop=lambda phase, time: None, away: float = 0.0) -> PathDriver:
    """Return an arm at the beginning of a plan, or ``away`` (`Arm.scale`) from it."""
    return PathDriver(plan.arm, plan.at(0.0)[0] + away * plan.arm.scale, stop)


def go(driver: PathDriver, out: Path, plans: Any, **how: Any) -> CollectedRecording:
    """Collect briefly."""
    return collect(plans, driver, out, report=driver.report, settings=BRIEF, **how)


def once(phase: str, moment: float, error: BaseException) -> Callable[..., BaseException | None]:
    """Stop the first time that a phase is so far, s of its own time."""
    left = [error]
    return lambda name, time: left.pop() if left and name == phase and time >= moment else None


def positions(out: Path) -> np.ndarray:
    """Return what was recorded."""
    return Recording.load(out).position


def driven(plant: PlantFile, out: Path, disturb: Callable | None = None) -> SimulatedDriver:
    """Go with a simulated ECM along a plan of 4 s, and return the driver."""
    plan = plan_of("ecm", size=0.9)
    with SimulatedDriver(plant, at=plan.at(0.0)[0] - 0.02 * Arm.load("ecm").scale) as driver:
        if disturb is not None:
            driver.disturb = lambda arm: disturb(driver)
        collect(
            plan, driver, out, rehearse=False, settings=BRIEF, report=lambda line: None,
            model=plant.model,
        )  # fmt: skip
    return driver
