"""Held-out error on static poses: the fit of this package against a refit of the console's columns.

``python benchmark/static_cv.py POSES.csv…`` prints RMSE in mN·m on poses that neither had seen:

- *one level*: one of a joint's inner positions left out, for each of them in turn;
- *some of each*: one inner position of every joint left out, with all poses that have one of them;
- *every other*: only the odd positions of every joint seen (3 of 5), tested on all other poses;
- *blocks*: 25 blocks of poses that followed each other left out in turn, no position of a joint
  being new;
- *edge*: a joint's outermost position left out, where predictions are held.

The console's columns are ten of gravity and five powers of each of six joints, fitted to each
direction alone by least squares, and again with each joint weighted by what that leaves of it.
Where fewer than five positions of a joint are left, its powers go only as far as these determine
them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation import inner_slabs, masks, sequential, slabs
from dvrk_gravity.identification import Poses, predict_unseen, read_poses
from dvrk_gravity.recording import Recording

SHOWN = slice(1, 6)  # the joints that were posed
ROUNDS = 10  # of fits and weights; later ones change nothing that is printed
STEP = 1e-4  # N·m, about the resolution of the smallest joint's effort


def console_refit(poses: Poses, unseen: Mask, arm: Arm, weighted: bool = False) -> Array:
    """Return (n, 7) predictions of the console's structure at unseen poses, N·m."""
    del arm
    degrees = [
        min(4, len(np.unique(slabs(poses.q[~unseen, joint]))) - 1) if joint in poses.moving else 0
        for joint in range(6)
    ]
    predicted = np.zeros((int(unseen.sum()), 7))
    for sign in (-1.0, 1.0):
        train = ~unseen & (poses.direction[:, 1] == sign)
        test = poses.direction[unseen, 1] == sign
        x, y = _console(poses.q[train], degrees), poses.effort[train]
        theta = _least_squares(x, y, np.ones(y.shape[1]))
        for _ in range(ROUNDS if weighted else 0):
            theta = _least_squares(x, y, np.maximum(np.std(y - x @ theta, axis=0), STEP))
        predicted[test] = _console(poses.q[unseen][test], degrees) @ theta
    return predicted


def _least_squares(x: Array, y: Array, unit: Array) -> Array:
    """Return (p,) coefficients that fit (n, 7) efforts, each joint in its own unit."""
    rows = (x / unit[:, None]).reshape(-1, x.shape[-1])
    return np.asarray(np.linalg.lstsq(rows, (y / unit).ravel(), rcond=None)[0])


def _console(q: Array, degrees: Sequence[int]) -> Array:
    parts = [gravity.regressor(q)]
    for joint, degree in enumerate(degrees):
        part = np.zeros((len(q), 7, degree + 1))
        part[:, joint] = np.vander(q[:, joint], degree + 1, increasing=True)
        parts.append(part)
    return np.concatenate(parts, axis=2)


def schemes(poses: Poses) -> Iterator[tuple[str, list[Mask]]]:
    """Yield the name and the sets of held-out poses of each scheme."""
    levels = np.stack([slabs(poses.q[:, joint]) for joint in poses.moving], axis=1)
    top = levels.max(axis=0)
    yield "one level", inner_slabs(poses.q, poses.moving)
    random = np.random.default_rng(0)
    dropped = [random.integers(1, top) for _ in range(4)]
    yield "some of each", [(levels == drop).any(axis=1) for drop in dropped]
    yield "every other", [(levels % 2 == 1).any(axis=1)]
    yield "blocks", masks(sequential(len(poses), 25))
    yield "edge", [levels[:, k] == edge for k in range(levels.shape[1]) for edge in (0, top[k])]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("poses", nargs="+", help="CSV of static poses with a direction column")
    parser.add_argument("--arm", default="mtmr")
    given = parser.parse_args()
    arm = Arm.load(given.arm)
    poses, _ = read_poses([Recording.load(path) for path in given.poses], arm, "joint")
    methods: dict[str, Callable[[Poses, Mask, Arm], Array]] = {
        "console": console_refit,
        "weighted": partial(console_refit, weighted=True),
        "fit_static": predict_unseen,
    }
    print(f"{'left out':<14}{'fit':<12}" + "".join(f"joint {j + 1:<4}" for j in range(1, 6)))
    for name, unseen in schemes(poses):
        for method, predict in methods.items():
            error = np.concatenate([poses.effort[m] - predict(poses, m, arm) for m in unseen])
            rmse = 1e3 * np.sqrt(np.mean(error[:, SHOWN] ** 2, axis=0))
            print(
                f"{name:<14}{method:<12}" + "".join(f"{value:<10.1f}" for value in rmse), flush=True
            )


if __name__ == "__main__":
    main()
