"""How much of the error in holding torque is friction that differs by direction.

    PYTHONPATH=. python benchmark/peers/constants.py [--arm ur5] [--seed 5200] [--four-minutes]

While an arm moves both ways, friction that is larger one way acts as a constant torque. No motion
distinguishes it from a torque that acts at rest as well, as a spring's does. Printed by joint, N·m:
the mean of the simulated friction over the two directions, then each method's error in holding
torque, its mean and its standard deviation. The docs' case of four minutes is that of ``--four-
minutes``.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from cases import SEED, laboratory
from outcome import METHODS, US
from run import PEERS, output, tried

from testing.mujoco_world import MujocoWorld


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--arm", default="ur5")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--four-minutes", action="store_true")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=[US, "least squares"])
    given = parser.parse_args()
    world = MujocoWorld.draw(given.arm, given.seed)
    joint, motor = world.joint_friction, world.motor_friction
    uneven = joint.level * joint.uneven + world.arm.joint_effort(motor.level * motor.uneven)
    long = {"rate": 1000.0, "duration": 240.0} if given.four_minutes else {}
    with TemporaryDirectory() as folder:
        case = laboratory(Path(folder) / given.arm, given.arm, given.seed, **long)
        print(f"{'':32s}" + " ".join(f"{name[-14:]:>14s}" for name in case.case.joints))
        print(f"{'friction, mean of two ways':32s}" + " ".join(f"{u:+14.3f}" for u in uneven))
        for method in given.methods:
            outcome = tried(case, method, PEERS)
            if outcome.failure:
                print(f"{method}: {outcome.failure}")
                continue
            held = np.load(output(case, method).with_suffix(".npz"))["holding"]
            assert case.true_holding is not None
            wrong = held - case.true_holding
            for what, values in (("mean", wrong.mean(axis=0)), ("deviation", wrong.std(axis=0))):
                print(f"{method + ', ' + what:32s}" + " ".join(f"{v:+14.3f}" for v in values))


if __name__ == "__main__":
    main()
