"""Identify any arm with a URDF, and export the result for MuJoCo and other simulators.

    python any_arm.py robot.urdf motion.csv

Efforts in A: add ``drive_gains`` (docs/own_arm.md).
"""

from __future__ import annotations

import sys

from dvrk_gravity import Arm, identify


def main(urdf: str, recording: str) -> None:
    """Fit a model, print the errors that it has on what it had not seen, and write it."""
    arm = Arm.from_urdf(urdf)
    fit = identify(recording, arm)
    for joint, error in fit.held_out.items():
        print(f"{joint:<24}{error.rmse:>9.4f}{100 * error.nrmse:>7.1f} % of the torque")
    print(fit.verdict.words, fit.verdict.reason)
    fit.model.save("model.yaml")
    print("next: python -m dvrk_gravity convert model.yaml identified.urdf (or .mjcf)")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
