"""Gains on held-out blocks, and estimates with their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS
from dvrk_gravity.diagnosis.bench import BLOCK
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.contest import Contest
from dvrk_gravity.diagnosis.findings import Gain
from dvrk_gravity.effects.effect import Hypothesis
from dvrk_gravity.effects.meaning import Estimate

Array = NDArray[np.float64]

_ALPHA = 0.05  # of one effect, chosen elsewhere, on held-out blocks
_LEAST_REMOVED = 0.03  # of a joint's held-out error, below which nothing is worth a finding
_WHOLE_BLOCK = 0.8  # of its samples, that must be usable
_ACTS = 0.03  # of the energy in the block where an effect acts most
_NOTABLE = 0.5  # of what is removed at the joint that gains most
_RESAMPLED = 1000
_DRAWN = 400


@dataclass(frozen=True)
class Unconfirmed:
    """What was chosen, and is not there on the blocks that the choice had not seen.

    Attributes:
        hypothesis: The claim.
        joint: Name of the joint where it does best.
        gain: What it removes there.
    """

    hypothesis: Hypothesis
    joint: str
    gain: Gain

    def __str__(self) -> str:
        """Say so."""
        return (
            f"chosen, but not confirmed on the held-out blocks, and left out: {self.hypothesis} "
            f"(removes {100 * self.gain.relative:.0f} % of the error at {self.joint}, "
            f"95 %: {100 * self.gain.low:.0f} to {100 * self.gain.high:.0f})"
        )


class Judge:
    """Errors on the blocks that neither fit nor choice has seen.

    Attributes:
        rows: (H,) held-out samples.
    """

    def __init__(self, contest: Contest) -> None:
        """Take the held-out samples."""
        bench = contest.bench
        self._contest = contest
        self._held = bench.held_out
        self._block = bench.block[self._held]
        self._time = bench.time[self._held]
        self._usable = bench.usable[self._held]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self._contest.bench.motion.arm.joint_names

    @property
    def samples(self) -> int:
        """Number of held-out samples."""
        return int(self._held.sum())

    @property
    def rows(self) -> NDArray[np.bool_]:
        """(T,) which samples are held out."""
        return self._held

    def error(self, candidates: Sequence[Candidate]) -> Array:
        """Return (H, 7) errors of a fit to the samples of choice; NaN where nothing can be said."""
        residual = self._contest.bench.residual[self._held].copy()
        if candidates:
            theta = self._contest.parameters(candidates)
            residual -= self._predicted(candidates, theta)
        return np.where(self._usable, residual, np.nan)

    def _predicted(self, candidates: Sequence[Candidate], theta: Array) -> Array:
        columns = np.concatenate([one.columns(self._held) for one in candidates], axis=2)
        return columns @ theta

    def rmse(self, error: Array) -> Array:
        """Return (7,) root mean squares over the usable held-out samples, N·m."""
        count = np.maximum(self._usable.sum(axis=0), 1)
        return np.sqrt(np.where(self._usable, error**2, 0.0).sum(axis=0) / count)

    def lasting(self, error: Array) -> Array:
        """Return (7,) which part of the squared errors is that of their means over the blocks.

        What a torque owes to the motion lasts as long as the motion does; noise, of whatever
        colour above a hertz or two, comes and goes within a block. Blocks of which little is
        usable are left out: there the one looks like the other.
        """
        shape = (self._block.max(initial=0) + 1, N_JOINTS)
        size = np.bincount(self._block, minlength=shape[0])[:, None]
        count, total, square = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        known = np.where(self._usable, error, 0.0)
        for sums, values in ((count, self._usable), (total, known), (square, known**2)):
            np.add.at(sums, self._block, values)
        whole = count > _WHOLE_BLOCK * size
        part = np.where(whole, total**2 / np.maximum(count, 1), 0.0).sum(axis=0)
        return np.asarray(part / np.maximum(np.where(whole, square, 0.0).sum(axis=0), 1e-300))

    def main_joints(self, one: Candidate, before: Array, after: Array) -> list[int]:
        """Return the joints by which a candidate is judged, the one that gains most first."""
        removed = 1.0 - self.rmse(after) / np.maximum(self.rmse(before), 1e-12)
        acts = np.flatnonzero(one.acts).tolist()
        joints = [j for j in one.hypothesis.judged_at if j in acts] or acts
        if np.max(removed[joints]) <= 0.0:
            joints = acts  # a motor's friction, say, is felt by other joints
        least = max(_NOTABLE * float(np.max(removed[joints])), 0.0)
        better = [j for j in joints if removed[j] > least] or joints
        return sorted(better, key=lambda j: -float(removed[j]))

    def unconfirmed(self, chosen: Sequence[Candidate], one: Candidate) -> Unconfirmed | None:
        """Return a chosen candidate's failure on the held-out blocks; ``None`` if it holds there.

        It fails if, of the blocks in which it acts, it helps neither most nor, beyond doubt, their
        sum, or removes next to nothing there; where it acts in none it cannot.
        """
        before = self.error([other for other in chosen if other is not one])
        after = self.error(chosen)
        joints = self.main_joints(one, before, after)
        theta = self._contest.parameters(chosen)
        first = sum(
            other.size for other in chosen[: [other is one for other in chosen].index(True)]
        )
        torque = one.columns(self._held) @ theta[first : first + one.size]
        power = (np.where(self._usable, torque, 0.0)[:, joints] ** 2).sum(axis=1)
        least = _ACTS * np.bincount(self._block, power).max(initial=0.0)
        settings = one.hypothesis.setting
        for edge in (settings[name] for name in one.hypothesis.edges):
            # Of an edge within a held-out block the choice could not know where it is.
            near = np.abs(self._time - edge) < BLOCK
            before[near] = after[near] = power[near] = 0.0
        blocks = np.flatnonzero(np.bincount(self._block, power) > least)
        if not len(blocks):
            return None
        gain = self.gain(before, after, joints, blocks)
        if gain.relative > _LEAST_REMOVED and (gain.low > 0.0 or gain.p_value < _ALPHA):
            return None
        return Unconfirmed(one.hypothesis, JOINT_NAMES[joints[0]], gain)

    def gain(
        self,
        before: Array,
        after: Array,
        joints: Sequence[int],
        blocks: NDArray[np.int64] | None = None,
    ) -> Gain:
        """Return what is gained on some joints, with interval and p-value over the blocks.

        Args:
            before: (H, 7) errors.
            after: (H, 7) errors.
            joints: Indices of the joints.
            blocks: Numbers of the blocks that count; by default all that are held out.
        """
        from scipy import stats

        scale = np.maximum(self.rmse(before)[list(joints)], 1e-12)
        blocks = np.unique(self._block) if blocks is None else blocks

        def losses(error: Array) -> Array:
            square = np.where(self._usable, error**2, 0.0)[:, list(joints)] / scale**2
            return np.asarray(np.bincount(self._block, square.sum(axis=1))[blocks], dtype=float)

        old, new = losses(before), losses(after)
        relative = 1.0 - np.sqrt(new.sum() / old.sum())
        random = np.random.default_rng(0)
        drawn = random.integers(len(blocks), size=(_RESAMPLED, len(blocks)))
        ratios = 1.0 - np.sqrt(new[drawn].sum(axis=1) / np.maximum(old[drawn].sum(axis=1), 1e-300))
        low, high = np.percentile(ratios, [2.5, 97.5])
        gains = old - new
        gains = gains[gains != 0.0]  # blocks in which nothing could be said decide nothing
        p_value = 1.0
        if gains.size:
            p_value = float(stats.wilcoxon(gains, alternative="greater").pvalue)
        return Gain(float(relative), float(low), float(high), p_value)


def estimates(
    hypothesis: Hypothesis, theta: Array, covariance: Array, spread: Mapping[str, float]
) -> dict[str, Estimate]:
    """Return the named parameters with 95 % intervals.

    Args:
        hypothesis: The hypothesis.
        theta: (k,) linear parameters.
        covariance: (k, k) of them.
        spread: Standard deviations of the settings that were searched for.
    """
    random = np.random.default_rng(0)
    drawn = random.multivariate_normal(theta, covariance, _DRAWN, method="eigh")
    middle = hypothesis.describe(theta, hypothesis.setting)
    draws = [hypothesis.describe(one, hypothesis.setting) for one in drawn]
    result = {}
    for name, value in middle.items():
        if not hypothesis.meaning(name).reported:
            continue
        if name in spread and name in hypothesis.refine:
            low, high = value - 1.96 * spread[name], value + 1.96 * spread[name]
        else:
            low, high = np.percentile([draw[name] for draw in draws], [2.5, 97.5])
        unit = hypothesis.unit(name)
        result[name] = Estimate(value, float(min(low, value)), float(max(high, value)), unit)
    return result


def setting_columns(
    contest: Contest, one: Candidate, theta: Array
) -> tuple[list[str], list[Candidate]]:
    """Return slopes of a candidate's torque by its searched settings, as further columns."""
    names, slopes = [], []
    hypothesis = one.hypothesis
    for name in hypothesis.refine:
        value = hypothesis.setting[name]
        step = 0.05 if name in hypothesis.edges else 0.02 * abs(value)
        if step == 0.0:
            continue
        up, down = (contest.rebuilt(hypothesis, name, value + s) for s in (step, -step))
        slope = (up.columns() - down.columns()) @ theta / (2.0 * step)
        if np.any(slope != 0.0):
            names.append(name)
            slopes.append(Candidate.of(hypothesis, slope.reshape(-1, N_JOINTS, 1)))
    return names, slopes
