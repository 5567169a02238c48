"""A chain R-R-P-R made up for the tests, with links that follow and a transmission."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml

from dvrk_gravity.arms import Arm

FILE = {
    "name": "made_up",
    "joints": [
        {"name": "yaw", "alpha": 90, "a": 0.05, "d": 0.3, "offset": 20, "lower": -120,
         "upper": 120, "effort_limit": 40},
        {"name": "pitch", "alpha": -70, "a": 0.25, "d": -0.02, "offset": -15, "lower": -80,
         "upper": 95, "effort_limit": 35},
        {"name": "insertion", "type": "prismatic", "alpha": 35, "a": 0.03, "d": 0.1, "offset": 40,
         "lower": 0.02, "upper": 0.24, "effort_limit": 60},
        {"name": "roll", "alpha": 10, "a": 0.02, "d": 0.04, "offset": 90, "lower": -170,
         "upper": 170, "effort_limit": 5},
    ],
    "followers": [
        # A counterweight runs back half as far as the insertion goes out, and swings with yaw.
        {"name": "counterweight", "parent": "link2", "type": "prismatic", "xyz": [0.0, 0.05, 0.02],
         "rpy": [10, 90, 0], "follows": {"insertion": -0.5, "yaw": 0.02}},
        # A lever stays upright whatever pitch does, and a wheel on it rolls with the insertion.
        {"name": "lever", "parent": "link2", "xyz": [0.1, 0, 0], "follows": {"pitch": -1}},
        {"name": "wheel", "parent": "lever", "xyz": [0, 0.07, 0.01], "rpy": [90, 0, 30],
         "follows": {"insertion": 12.0}},
    ],
    "actuator_to_joint": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0.1, 0.02, 0], [0, 0, 0, 1]],
    "actuator_effort_limit": [40, 35, 2, 5],
    "base_rpy": [0, 0, 0],
}  # fmt: skip


def write(folder: Path, changes: dict | None = None) -> Path:
    """Write the arm's file, with some keys changed."""
    path = folder / "made_up.yaml"
    path.write_text(yaml.safe_dump(FILE | (changes or {})))
    return path


def made_up_arm(folder: Path) -> Arm:
    """The arm from its file."""
    return Arm.load(write(folder))


def random_inertia(rng: np.random.Generator) -> pin.Inertia:
    """That of a few point masses, which makes it physical."""
    masses, points = rng.uniform(0.02, 0.2, 6), rng.normal(0, 0.08, (6, 3))
    lever = masses @ points / masses.sum()
    away = points - lever
    inertia = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, away, strict=True)
    )
    return pin.Inertia(masses.sum(), lever, inertia)


def random_inertias(arm: Arm, seed: int) -> dict[str, pin.Inertia]:
    """One for every body of an arm, in its link frame."""
    rng = np.random.default_rng(seed)
    return {name: random_inertia(rng) for name in arm.body_names}


def random_motion(arm: Arm, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(count, n) positions within the limits, velocities and accelerations."""
    rng = np.random.default_rng(seed)
    lowest, highest = arm.range
    q = rng.uniform(lowest, highest, (count, arm.n))
    return q, rng.normal(0, 2, (count, arm.n)), rng.normal(0, 5, (count, arm.n))
