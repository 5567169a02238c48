"""Static poses of a simulated ECM, PSM and UR5: how well weight, and a load on it, are known.

    python benchmark/poses.py --seeds 0 5

Every seed identifies an arm from as many poses as are given, and prints by joint the RMS error of
the model's torque at 300 other poses, as a part of what noise and sticking friction leave at one
pose; then what a diagnosis of 200 other poses says, without and with a load. The arms are those of
testing/posed_arms.py.
"""

from __future__ import annotations

import argparse

import numpy as np

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects.base.link_prior import weight_directions
from dvrk_gravity.identification import identify
from testing.posed_arms import POSED


def main() -> None:
    """Print a line for each arm, number of poses and seed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 5), metavar=("FIRST", "END"))
    parser.add_argument("--arms", nargs="*", choices=POSED, default=list(POSED))
    parser.add_argument("--poses", type=int, nargs="*", default=[60, 120])
    args = parser.parse_args()
    print(f"{'arm':<5}{'poses':>6}{'seed':>5}  {'verdict':<18}{'error':<26}{'untouched':<20}loaded")
    for name in args.arms:
        posed = POSED[name]()
        q = posed.positions(5000, 300)
        first = slice(posed.posed)
        weight = posed.weight(q, 0.0)[:, first]
        combinations = weight_directions(posed.arm).shape[1]
        print(f"{name}: {combinations} combinations of its links' weights act")
        for count in args.poses:
            for seed in range(*args.seeds):
                model = identify(posed.record(10 * seed, count), posed.arm).model
                error = np.sqrt(np.mean((model.torque(q[:, first]) - weight) ** 2, axis=0))
                shares = " ".join(f"{share:.2f}" for share in error / posed.left())
                quiet = diagnose(posed.record(10 * seed + 1, 200), model)
                found = diagnose(posed.record(10 * seed + 2, 200, posed.load), model)
                told = [f"{one.effect} {', '.join(one.joints)}" for one in found.findings]
                for one in found.findings:
                    if mass := one.parameters.get("mass"):
                        told.append(f"{mass.value:.2f} ({mass.low:.2f} to {mass.high:.2f}) kg")
                print(
                    f"{name:<5}{count:>6}{seed:>5}  {model.verdict:<18}{shares:<26}"
                    f"{quiet.verdict:<20}{posed.load} kg: {'; '.join(told) or 'nothing'}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
