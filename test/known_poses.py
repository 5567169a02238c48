"""Static poses of a master arm whose gravity, cables and friction are known."""

from __future__ import annotations

from itertools import product

import numpy as np

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

ARM = Arm.load("mtmr")
POSED = (1, 2, 3, 4, 5)
LOWER = np.radians([0.0, -10.0, -25.0, -75.0, -80.0, -35.0, 0.0])
UPPER = np.radians([0.0, 40.0, 25.0, 185.0, 170.0, 35.0, 0.0])
BETA = (0.6, 0.4, 0.25, 0.12, 0.01, 0.18, -0.1, -0.01, 0.04, 0.005)
NOISE = 0.004  # N·m
RECORDED = ("mtmr28002_static_pos.csv", "mtmr28002_static_neg.csv")


def truth(**more: tuple[float, ...]) -> TorqueModel:
    """Return an arm with gravity, smooth cables and friction, held at the edges of the grid."""
    cable = {
        "shoulder_pitch": (0.2, 0.15),
        "elbow_pitch": (0.05, 0.06, 0.02),
        "wrist_platform": (-0.01, 0.03, -0.01, 0.004),
        "wrist_pitch": (0.03, -0.02),
        "wrist_yaw": (0.002, 0.004),
    }
    friction = dict(zip(cable, (0.04, 0.015, 0.03, 0.006, 0.004), strict=True))
    values: dict[str, object] = {"arm": "mtmr", "beta": BETA}
    for side, sign in (("positive", 1.0), ("negative", -1.0)):
        for joint, (first, *rest) in cable.items():
            values[f"directional_cable.{side}.{joint}"] = (first + sign * friction[joint], *rest)
    for term in ("directional_cable", *({"held_load"} if more else ())):
        values[f"{term}.valid_lower"] = tuple(LOWER)
        values[f"{term}.valid_upper"] = tuple(UPPER)
    return TorqueModel.from_parameters(values | more)


def grid(levels: int) -> np.ndarray:
    """Return the poses of a grid over the posed joints, the last one quickest."""
    axes = [np.linspace(LOWER[j], UPPER[j], levels) for j in POSED]
    q = np.zeros((levels ** len(POSED), 7))
    q[:, POSED] = list(product(*axes))
    return q


def between(count: int = 3000, seed: int = 1) -> np.ndarray:
    """Return poses anywhere in the range of the grid."""
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 7))


def record(model: TorqueModel, q: np.ndarray, noise: float = NOISE, seed: int = 0):
    """Return what a model's poses would look like, approached from below and from above."""
    random = np.random.default_rng(seed)
    recordings = []
    for sign in (1.0, -1.0):
        direction = np.full(q.shape, sign)
        effort = model.torque(q, direction=direction) + noise * random.standard_normal(q.shape)
        recordings.append(
            Recording(
                JOINT_NAMES, None, q, effort=effort, direction=direction, source=f"poses {sign:+g}"
            )
        )
    return recordings


def worst(model: TorqueModel, other: TorqueModel, q: np.ndarray) -> float:
    """Return the largest rms difference of any joint over both directions, N·m."""
    difference = [
        model.torque(q, direction=np.full(q.shape, sign))
        - other.torque(q, direction=np.full(q.shape, sign))
        for sign in (1.0, -1.0)
    ]
    return float(np.sqrt(np.mean(np.square(difference), axis=(0, 1))).max())
