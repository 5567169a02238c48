"""What the document on recursive inverse dynamics prints of its ten exercise results."""

from __future__ import annotations

from pathlib import Path

import numpy as np

EXERCISES = Path(__file__).resolve().parents[2] / "config" / "exercises"

# File name -> rows of joint 1, 2, …: Fx, Fy, Fz in N, Mx, My, Mz in N·m.
REACTIONS = {
    "2_1_without_gravity": [
        [-2.82, 3.48, 0.00, 0.00, 0.00, 0.00],
        [-0.29, 3.35, 0.00, 0.00, 0.00, 0.00],
    ],
    "2_2_with_gravity": [
        [383.53, -14.70, 0.00, 0.00, 0.00, 0.00],
        [116.29, -130.85, 0.00, 0.00, 0.00, 0.00],
    ],
    "3_2_with_gravity": [
        [134.69, -78.84, -0.00, -11.71, -20.21, 0.00],
        [0.00, -29.29, 0.00, -17.57, -20.21, -11.71],
    ],
    "4_1_without_gravity": [
        [-2.99, 4.11, 1.18, 0.53, -1.82, 0.00],
        [0.02, 1.18, -4.05, -0.01, 2.33, 0.00],
        [-0.07, 0.52, -1.20, 0.00, 0.22, 0.00],
    ],
    "4_1_with_gravity": [
        [-2.99, 4.11, 452.44, 87.76, -458.95, 0.00],
        [0.02, 256.24, -4.05, -0.01, 2.33, 0.00],
        [10.15, 58.48, -1.20, 0.00, 0.22, 0.00],
    ],
}

# Half a unit of the last printed decimal, and what binary rounding adds to it.
HALF_DECIMAL = 0.005 + 1e-9

NAMES = [
    f"{exercise}_{gravity}_gravity"
    for exercise in ("2_1", "2_2", "3_1", "3_2", "4_1")
    for gravity in ("without", "with")
]


def reactions(name: str) -> np.ndarray:
    """Return the printed reactions of one exercise, (n, 6)."""
    return np.array(REACTIONS[name])
