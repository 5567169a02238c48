"""Causes that a diagnosis could not separate, made up: a constant torque, or a spring."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.diagnosis import FittedHypothesis
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import PlannedMotion, UnresolvedPairs, unresolved_pairs


def passed(model: TorqueModel, count: int = 300, part: float = 0.02) -> PlannedMotion:
    """Return a slow motion about the middle of all joints."""
    lower, upper = model.arm.range
    time = np.linspace(0.0, 10.0, count)
    omega = 2.0 * np.pi * np.arange(1, model.arm.n + 1) / 10.0
    size = part * np.minimum(upper - lower, 1.0)
    waves = np.sin(np.outer(time, omega)), np.cos(np.outer(time, omega))
    middle = 0.5 * (lower + upper) + 0.1 * size / part
    state = State(middle + size * waves[0], size * omega * waves[1], -size * omega**2 * waves[0])
    return PlannedMotion.of(model, state, time)


def cause(motion: PlannedMotion, effect: str, joint: int, theta, spread: float) -> FittedHypothesis:
    """Return an effect's simplest hypothesis at a joint, as if it had been found."""
    found = (
        each
        for each in effects.named(effect).hypotheses(motion)
        if each.joints == (joint,) and each.place in ("joint", "degree 1")
    )
    hypothesis = min(found, key=lambda each: each.regressor(motion).shape[2])
    theta = np.resize(np.asarray(theta, float), hypothesis.regressor(motion).shape[2])
    return FittedHypothesis(hypothesis, theta, spread**2 * np.eye(len(theta)))


@dataclass(frozen=True, eq=False)
class MadeUp:
    """A model and causes that a diagnosis of it could not separate."""

    model: TorqueModel
    groups: tuple[tuple[FittedHypothesis, ...], ...]

    @property
    def left(self) -> np.ndarray:
        return 0.01 * self.model.arm.effort_limit

    def pairs(self, model: TorqueModel | None = None) -> UnresolvedPairs:
        return unresolved_pairs(model or self.model, self.groups, self.left, False, 10.0)

    def content(self) -> dict:
        """Return what findings.json has of them."""
        joints = self.model.arm.joint_names
        errors = dict(zip(joints, self.left.tolist(), strict=True))
        groups = [[each.to_dict() for each in group] for group in self.groups]
        entry = {"model": "model.yaml", "joints": list(joints), "poses": False, "lasted": 10.0}
        entry["groups"] = groups
        return {"verdict": "ambiguous", "rmse": {"after": errors}, "unseparated": entry}


def made_up(model: TorqueModel, *groups: tuple[FittedHypothesis, ...]) -> MadeUp:
    return MadeUp(model, groups)


def offset_or_spring(model: TorqueModel, stiffness: float = 1e-3) -> MadeUp:
    """Return a constant torque, or a spring (of limit/rad): in a narrow motion all but the same."""
    motion = passed(model)
    limit = float(model.arm.effort_limit[1])
    spring = cause(motion, "elastic_cable", 1, 0.0, 0.0)
    # The constant part of the spring's torque is the offset's.
    theta, error = limit * np.array([0.1, stiffness]), limit * np.array([0.02, 0.2 * stiffness])
    spring = replace(spring, theta=theta, covariance=np.diag(error**2))
    return made_up(model, (cause(motion, "torque_offset", 1, 0.1 * limit, 0.02 * limit), spring))


def twins(model: TorqueModel) -> tuple[FittedHypothesis, FittedHypothesis]:
    """Return two causes of the same torque."""
    offset = cause(passed(model), "torque_offset", 1, 1.0, 0.1)
    return offset, replace(offset, hypothesis=replace(offset.hypothesis, joints=(0,)))


def written(of: MadeUp, folder: Path, **changes: object) -> Path:
    """Write a model, and what a diagnosis of it could not separate."""
    of.model.save(folder / "model.yaml")
    content = of.content()
    content["unseparated"] |= changes
    path = folder / "findings.json"
    path.write_text(json.dumps(content))
    return path
