"""Efforts at another scale: in another unit, or with a gain that is far off.

The factor is in every sample and dominates all other error: nothing is identifiable beside it.
Clipped efforts stay at a level; these do not.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import ANY_UNIT
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects import Estimate, Reading, TorqueScale
from dvrk_gravity.estimation import NORMAL_95

# Read over true efforts, between which a scale is looked for: N·mm for N·m, and as much the other
# way; and scales of a first grid: then a step is 3 %.
_SCALES = (0.5e-3, 2e3)
_GRID = 500
# Correlation of a joint's efforts with the model's, from which on they are these at some scale.
# Chosen: less than a third of them is then left, and a square wave, to which clipping takes a sine,
# has .90.
_LIKE = 0.95
# Part of the squared residual of clipping that a scale may leave. Chosen: where a joint's effort is
# dry friction alone, both leave the same.
_LEVEL = 0.5
_SPANS = 8  # parts of the recording, each of which is left out in turn for the interval


def effort_scales(few: MeasuredMotion, usable: Mask, least: Array) -> Iterator[Reading]:
    """Yield the scales by which efforts are the model's, of all joints and of each alone.

    Only those beyond the range of ``torque_scale``, a cause beside others.

    Args:
        few: Samples of a motion.
        usable: (N, n) their usable efforts.
        least: (n,) mean square of the model's known error, (N·m)².
    """
    arm = few.arm
    if few.reference is not None or arm.read_in == ANY_UNIT:
        return
    products = _products(few, usable)
    read, both, modelled = products.sum(axis=0).T
    like = both > _LIKE * np.sqrt(read * modelled)
    like &= (modelled > 0.0) & ~_clipped(few, usable)
    count = np.maximum(usable.sum(axis=0), 1)
    groups = [np.array([joint]) for joint in np.flatnonzero(like & few.moves)]
    if 2 * like.sum() > few.moves.sum():
        groups.insert(0, np.arange(arm.n))
    meaning = TorqueScale.meaning("factor")
    for joints in groups:
        used = joints[like[joints]]
        scale = _estimate(products[:, used], count[used], least[used])
        if meaning.least <= scale.value <= meaning.greatest:
            continue
        own = tuple(joints.tolist()) if len(joints) == 1 < arm.n else ()
        factors = np.ones(arm.n)
        factors[joints] = 1.0 / scale.value
        where = f"the effort of {arm.joint_names[own[0]]} reads" if own else "all efforts read"
        words = (
            f"{where} {scale.shown} times the true ones"
            if not own
            else (f"{where} {scale.shown} times the true one")
        )
        yield Reading(words, own, np.eye(arm.n), np.diag(factors), scale=scale)


def _products(few: MeasuredMotion, usable: Mask) -> Array:
    """Return (S, n, 3) sums over each span: of squares of the efforts, of the model's, and between.

    In the order effort², effort times model, model². Beside a constant, and beside friction and a
    rotor where the model comes from a file that states neither.
    """
    span = np.arange(len(few.q)) * _SPANS // len(few.q)
    result = np.zeros((_SPANS, few.arm.n, 3))
    for joint in range(few.arm.n):
        rows = usable[:, joint]
        columns = [np.ones(len(few.q))]
        if few.model.of_file and not few.static:
            speed = few.qd[:, joint]
            columns += [np.sign(speed), speed, few.qdd[:, joint]]
        beside = np.stack(columns, axis=1)[rows]
        pair = np.stack([few.effort[rows, joint], few.modelled[rows, joint]], axis=1)
        pair = pair - beside @ np.linalg.lstsq(beside, pair, rcond=None)[0]
        each = np.stack([pair[:, 0] ** 2, pair[:, 0] * pair[:, 1], pair[:, 1] ** 2], axis=1)
        np.add.at(result[:, joint], span[rows], each)
    return result


def _clipped(few: MeasuredMotion, usable: Mask) -> Mask:
    """Return (n,) joints whose efforts are the model's, clipped, as well as at another scale."""
    read, modelled = (np.where(usable, torque, 0.0) for torque in (few.effort, few.modelled))
    level = np.abs(read).max(axis=0)
    size = np.maximum((modelled**2).sum(axis=0), 1e-300)
    scaled = read - (read * modelled).sum(axis=0) / size * modelled
    clipped = read - np.clip(modelled, -level, level)
    left = _LEVEL * (clipped**2).sum(axis=0)
    return np.asarray((scaled**2).sum(axis=0) > left)


def _estimate(products: Array, count: NDArray[np.int_], least: Array) -> Estimate:
    """Return the common scale of some joints' efforts, most likely: (S, m, 3), (m,), (m,)."""
    from scipy.optimize import minimize_scalar

    # Efforts may be predicted to a hundredth; less is the noise of few joints.
    least = least + 1e-4 * products[..., 2].sum(axis=0) / count

    def best(kept: Mask) -> float:
        read, both, modelled = products[kept].sum(axis=0).T / count

        def misfit(log: float) -> float:
            part = np.exp(-log)
            error = part**2 * read - 2.0 * part * both + modelled
            return float((0.5 * np.log(np.maximum(error, 0.0) + least) + log).sum())

        least_log, most_log = np.log(_SCALES).tolist()
        grid = np.linspace(least_log, most_log, _GRID)
        middle = grid[int(np.argmin([misfit(log) for log in grid]))]
        step = grid[1] - grid[0]
        bounds = middle - step, middle + step
        options = {"xatol": 1e-5}
        found = minimize_scalar(misfit, bounds=bounds, method="bounded", options=options)
        return float(found.x)

    spans = np.arange(_SPANS)
    whole = best(spans >= 0)
    # Efron and Tibshirani (1993), An Introduction to the Bootstrap, chapter 11: the jackknife.
    without = np.array([best(spans != number) for number in spans])
    error = np.sqrt((_SPANS - 1) * np.mean((without - without.mean()) ** 2))
    low, value, high = (float(np.exp(whole + z * NORMAL_95 * error)) for z in (-1.0, 0.0, 1.0))
    return Estimate(value, low, high, "")
