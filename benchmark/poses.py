"""Static poses of a simulated ECM, PSM and UR5: how well weight, and a load on it, are known.

    python benchmark/poses.py --seeds 0 5

Every seed identifies an arm from as many poses as are given. Printed are: how many combinations of
the links' weights act; by joint the RMS error of the models' torques at 300 other poses, as a part
of what noise and sticking friction leave at one pose; the verdicts; how often a diagnosis of 200
other poses is silent, and how often it names a load as the first cause where there is one; the mean
of its mass; and how often the mass is within its interval. Arms are those of testing/posed_arms.py.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import weight_directions
from dvrk_gravity.identification import identify
from testing.posed_arms import POSED, Posed


def line(name: str, posed: Posed, count: int, seeds: range) -> str:
    """Return what is printed of an arm identified from so many poses."""
    q, first = posed.positions(5000, 300), slice(posed.posed)
    weight = posed.weight(q, 0.0)[:, first]
    errors, masses, verdicts, weights = [], [], Counter[str](), 0
    silent = named = inside = 0
    for seed in seeds:
        model = identify(posed.record(10 * seed, count), posed.arm).model
        weights = weight_directions(model.arm).shape[1]
        verdicts[model.verdict] += 1
        errors.append(np.mean((model.torque(q[:, first]) - weight) ** 2, axis=0))
        silent += not diagnose(posed.record(10 * seed + 1, 200), model).findings
        found = diagnose(posed.record(10 * seed + 2, 200, posed.load), model).findings
        if not found or (found[0].effect, found[0].joints) != ("payload", (posed.carries,)):
            continue
        named += 1
        mass = found[0].parameters["mass"]
        masses.append(mass.value)
        inside += mass.low <= posed.load <= mass.high
    shares = " ".join(
        f"{share:.2f}" for share in np.sqrt(np.mean(errors, axis=0)) / posed.irreducible_error()
    )
    told = ", ".join(f"{number} {level}" for level, number in sorted(verdicts.items()))
    mean = np.mean(masses) if masses else np.nan
    return (
        f"{name:<5}{count:>6}{weights:>9}  {shares:<21}{told:<30}{silent:>3}/{len(seeds):<7}"
        f"{named}/{len(seeds):<6}{mean:.3f} of {posed.load} kg, {inside}/{named} in its interval"
    )


def main() -> None:
    """Print a line for each arm and number of poses."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 5), metavar=("FIRST", "END"))
    parser.add_argument("--arms", nargs="*", choices=POSED, default=list(POSED))
    parser.add_argument("--poses", type=int, nargs="*", default=[60, 120])
    args = parser.parse_args()
    print(
        f"{'arm':<5}{'poses':>6}{'weights':>9}  {'error by joint':<21}{'verdicts':<31}"
        f"{'silent':<10}{'named':<8}mass"
    )
    for name in args.arms:
        posed = POSED[name]()
        for count in args.poses:
            print(line(name, posed, count, range(*args.seeds)), flush=True)


if __name__ == "__main__":
    main()
