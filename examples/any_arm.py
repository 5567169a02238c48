"""Identify any arm with a URDF, and export the result for MuJoCo and other simulators.

    python any_arm.py                           # arm.urdf beside it, simulated
    python any_arm.py robot.urdf motion.csv     # yours

Efforts in A: add ``drive_gains`` (docs/own_arm.md).
"""

from __future__ import annotations

import sys
from pathlib import Path

from simulated_lab import record

from dvrk_gravity import Arm, identify


def main(urdf: str | Path, recording: str | None = None) -> None:
    """Fit a model, print the errors that it has on what it had not seen, and write it."""
    arm = Arm.from_urdf(urdf)
    fit = identify(record(seed=1, arm=arm) if recording is None else recording, arm)
    for joint, error in fit.held_out.items():
        print(f"{joint:<24}{error.rmse:>9.4f}{100 * error.nrmse:>7.1f} % of the torque")
    print(fit.verdict.words, fit.verdict.reason)
    fit.model.save("model.yaml")
    print("next: python -m dvrk_gravity convert model.yaml identified.urdf (or .mjcf)")


if __name__ == "__main__":
    given = sys.argv[1:] or [str(Path(__file__).with_name("arm.urdf"))]
    if len(given) > 2 or len(sys.argv) == 2:
        sys.exit(__doc__)
    main(*given)
