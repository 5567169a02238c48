"""Whether a difference from a peer on one simulated arm is one on others of its kind.

    PYTHONPATH=. python benchmark/peers/seeds.py --arms panda mtmr ur5 --seeds 6

Each seed draws another arm of the kind (masses, friction, cables, sensors) and other motions, as
for docs/peers.md. Printed is the held-out error by joint, mean over the seeds, and how much a
peer's is larger, mean and standard error over the same seeds; then the same of the torque that
holds the arm at rest.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from cases import SEED, laboratory
from outcome import METHODS, US
from run import PEERS, error, output, tried

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
        moving: dict[str, list[list[float]]] = {method: [] for method in methods}
        holding: dict[str, list[list[float]]] = {method: [] for method in methods}
        for seed in range(FIRST, FIRST + given.seeds):
            with TemporaryDirectory() as folder:
                case = laboratory(Path(folder) / arm, arm, seed)
                for method in methods:
                    outcome = tried(case, method, PEERS)
                    if outcome.failure:
                        print(f"{arm}, seed {seed}, {method}: {outcome.failure}", flush=True)
                        moving[method].append([np.nan] * len(case.case.joints))
                        holding[method].append([np.nan] * len(case.case.joints))
                        continue
                    moving[method].append(outcome.errors)
                    found = np.load(output(case, method).with_suffix(".npz"))["holding"]
                    assert case.true_holding is not None
                    holding[method].append(error(case, found, case.true_holding))
        for what, errors in (("", moving), (", holding", holding)):
            names = " ".join(f"{name[-14:]:>14s}" for name in case.case.joints)
            print(f"{arm + what:24s}{names}")
            table(errors)


def table(errors: dict[str, list[list[float]]]) -> None:
    """Print means over the seeds, ours and what a peer's is larger."""
    ours = np.array(errors[US])
    print(f"{US:24s}" + " ".join(f"{e:14.3f}" for e in np.nanmean(ours, axis=0)))
    for method, theirs in errors.items():
        if method == US:
            continue
        more = np.array(theirs) - ours
        mean, spread = np.nanmean(more, axis=0), np.nanstd(more, axis=0, ddof=1)
        shown = zip(mean, spread / np.sqrt(np.isfinite(more).sum(axis=0)), strict=True)
        print(f"{method:24s}" + " ".join(f"{m:+6.3f} ± {d:.3f}" for m, d in shown), flush=True)


if __name__ == "__main__":
    main()
