"""Whether a difference from a peer on one simulated arm is one on others of its kind.

    PYTHONPATH=. python benchmark/peers/seeds.py --arms panda mtmr ur5 --seeds 6

Each seed draws another arm of the kind (masses, friction, cables, sensors) and other motions, as
for docs/peers.md. Printed is the held-out error by joint, mean over the seeds, and how much a
peer's is larger, mean and standard error over the same seeds. Hold: the torque that holds the arm.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from cases import SEED, laboratory
from outcome import METHODS, US
from run import PEERS, tried

FIRST = SEED + 100  # none of the page's


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--arms", nargs="+", default=["panda", "mtmr", "ur5"])
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--methods", nargs="+", choices=METHODS[1:], default=METHODS[1:])
    given = parser.parse_args()
    methods = [US, *given.methods]
    for arm in given.arms:
        errors: dict[str, list[list[float]]] = {method: [] for method in methods}
        for seed in range(FIRST, FIRST + given.seeds):
            with TemporaryDirectory() as folder:
                case = laboratory(Path(folder) / arm, arm, seed)
                found = {method: tried(case, method, PEERS) for method in methods}
            for method, outcome in found.items():
                if outcome.failure:
                    print(f"{arm}, seed {seed}, {method}: {outcome.failure}")
                nothing = [np.nan] * len(case.case.joints)
                held = np.nan if outcome.holding is None else outcome.holding
                errors[method].append([*(outcome.errors or nothing), held])
        print(
            f"{arm:24s}" + " ".join(f"{joint[-14:]:>14s}" for joint in (*case.case.joints, "hold"))
        )
        ours = np.array(errors[US])
        print(f"{US:24s}" + " ".join(f"{e:14.3f}" for e in np.nanmean(ours, axis=0)))
        for method in given.methods:
            more = np.array(errors[method]) - ours
            mean, spread = np.nanmean(more, axis=0), np.nanstd(more, axis=0, ddof=1)
            answered = np.isfinite(more).sum(axis=0)
            shown = zip(mean, spread / np.sqrt(answered), strict=True)
            print(f"{method:24s}" + " ".join(f"{m:+6.3f} ± {d:.3f}" for m, d in shown), flush=True)


if __name__ == "__main__":
    main()
