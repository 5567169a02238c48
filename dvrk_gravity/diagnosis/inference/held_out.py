"""Gains on held-out blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import ACTIVE, CrossValidation
from dvrk_gravity.diagnosis.inference.selection import SELECTION
from dvrk_gravity.effects import AbsorbedByModel, Hypothesis, RequiresParts
from dvrk_gravity.estimation import NORMAL_95, evidence

# Part by which a joint's error may grow, RMS. Chosen: parameters that fit noise add their number
# over that of independent samples to the mean square, a few per cent.
_GROWN = 0.05


@dataclass(frozen=True)
class JudgementSettings:
    """What counts on held-out blocks.

    Attributes:
        least_removed: Part of a joint's held-out error, below which nothing is worth a finding.
            Half of what the choice asks for: so far a gain may fall by chance.
        whole_block: Part of a block's samples that must be usable. Chosen; see `make sensitivity`.
        active: Part of the energy in the block where an effect acts most, held out or not, from
            which on it acts in a block. Chosen.
        notable: Part of what is removed at the joint that gains most. Chosen.
    """

    least_removed: float = 0.03
    whole_block: float = 0.8
    active: float = ACTIVE
    notable: float = 0.5


JUDGEMENT = JudgementSettings()


@dataclass(frozen=True)
class Gain:
    """Part of the error that an effect removes on held-out data.

    Attributes:
        relative: Relative reduction of the RMS error.
        low: Lower end of its 95 % interval (block bootstrap).
        high: Upper end.
        p_value: One-sided p-value of a paired test over the held-out blocks.
    """

    relative: float
    low: float
    high: float
    p_value: float


@dataclass(frozen=True)
class Unconfirmed:
    """What was chosen, and is not there on the blocks that the choice had not seen.

    Attributes:
        hypothesis: The claim.
        joint: Name of the joint where it does best.
        gain: What it removes there; ``None``: it acts in no held-out block, where it might fail.
        partial: Of all that it claims only a part shows, see ``RequiresParts.required_parts``.
    """

    hypothesis: Hypothesis
    joint: str
    gain: Gain | None
    partial: bool = False


class HeldOut:
    """Errors on the blocks that neither fit nor choice has seen.

    Attributes:
        rows: (H,) held-out samples.
    """

    def __init__(self, validation: CrossValidation) -> None:
        """Take the held-out samples."""
        data = validation.data
        self._validation = validation
        self._held = data.held_out
        self._block = data.block[self._held]
        self._time = data.time[self._held]
        self._usable = data.usable[self._held]

    @property
    def motion(self) -> MeasuredMotion:
        """The motion that was diagnosed."""
        return self._validation.data.motion

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self._validation.data.motion.arm.joint_names

    @property
    def samples(self) -> int:
        """Number of held-out samples."""
        return int(self._held.sum())

    @property
    def known_error(self) -> Array:
        """(n,) RMS error that the model is known to have, N·m; zero if unknown."""
        return self._validation.known_error

    @property
    def rows(self) -> NDArray[np.bool_]:
        """(T,) which samples are held out."""
        return self._held

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(n,) joints of which held-out samples say something."""
        return np.asarray(self._usable.any(axis=0))

    def error(
        self, candidates: Sequence[Candidate], fitted_with: Sequence[Candidate] | None = None
    ) -> Array:
        """Return (H, n) errors of a fit to the samples of choice; NaN where nothing can be said.

        Args:
            candidates: The candidates.
            fitted_with: See ``CrossValidation.residual``.
        """
        residual = self._validation.residual(candidates, fitted_with)[self._held]
        return np.where(self._usable, residual, np.nan)

    def error_below(self, candidates: Sequence[Candidate], band: float) -> Array:
        """Return the same below a band that is lower than the data's, Hz."""
        data = self._validation.data
        residual = data.below(self._validation.residual(candidates), band)[self._held]
        return np.where(self._usable, residual, np.nan)

    def as_read(self) -> Array:
        """Return (H, n) errors of the given model; NaN where nothing can be said."""
        return np.where(self._usable, self._validation.data.as_read[self._held], np.nan)

    def rmse(self, error: Array) -> Array:
        """Return (n,) root mean squares over the usable held-out samples, N·m."""
        return np.sqrt(_mean_square(error, self._usable))

    def lasting(self, error: Array) -> Array:
        """Return (n,) which part of the squared errors is that of their means over the blocks.

        What a torque owes to the motion lasts as long as the motion does; noise, of whatever
        colour above a hertz or two, comes and goes within a block. Blocks of which little is
        usable are left out: there the one looks like the other.
        """
        shape = (self._block.max(initial=0) + 1, error.shape[1])
        size = np.bincount(self._block, minlength=shape[0])[:, None]
        count, total, square = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        known = np.where(self._usable, error, 0.0)
        for sums, values in ((count, self._usable), (total, known), (square, known**2)):
            np.add.at(sums, self._block, values)
        whole = count > JUDGEMENT.whole_block * size
        part = np.where(whole, total**2 / np.maximum(count, 1), 0.0).sum(axis=0)
        return np.asarray(part / np.maximum(np.where(whole, square, 0.0).sum(axis=0), 1e-300))

    def worse(self, chosen: Sequence[Candidate], before: Array, noise: Array) -> list[int]:
        """Return the joints at which what was chosen adds to the error.

        There the error is larger than before, and than what the model's own parameters leave that
        move without it: where they fit noise, that is none of its doing.

        Args:
            chosen: The candidates.
            before: (H, n) errors of the given model.
            noise: (n,) RMS that noise alone leaves, N·m; NaN where it is not known: as much as what
                was there.
        """
        after = self.rmse(self.error(chosen))
        least = np.fmax(self.rmse(before), self.rmse(self.error([])))
        # Less does not matter, and less than the noise may be chance: seen of true causes, up to
        # .45 of it (test_diagnose_hidden.py).
        known = SELECTION.consequence * self.known_error
        harm = np.maximum(known, np.where(np.isnan(noise), least, noise))
        added = np.sqrt(np.maximum(after**2 - least**2, 0.0))
        grown = after > (1.0 + _GROWN) * least
        return np.flatnonzero(grown & (added > harm)).tolist()

    def main_joints(self, candidate: Candidate, before: Array, after: Array) -> list[int]:
        """Return the joints by which a candidate is judged, the one that gains most first."""
        removed = 1.0 - self.rmse(after) / np.maximum(self.rmse(before), 1e-12)
        acts = np.flatnonzero(candidate.acts & self.seen).tolist()
        acts = acts or np.flatnonzero(candidate.acts).tolist()
        joints = [j for j in candidate.hypothesis.judged_at if j in acts] or acts
        if np.max(removed[joints]) <= 0.0:
            joints = acts  # a motor's friction, say, is felt by other joints
        least = max(JUDGEMENT.notable * float(np.max(removed[joints])), 0.0)
        better = [j for j in joints if removed[j] > least] or joints
        return sorted(better, key=lambda j: -float(removed[j]))

    def unconfirmed(
        self,
        chosen: Sequence[Candidate],
        tested: Sequence[Candidate] | None = None,
        significant: Callable[[Candidate], bool] = lambda candidate: False,
    ) -> list[tuple[Unconfirmed, Candidate]]:
        """Return the chosen candidates that the held-out blocks do not confirm.

        One fails if it removes next to nothing in the blocks in which it acts, or no more than
        chance would, by the tests of the choice and at its level, Holm's correction for the number
        of those under test included; or if it acts in no held-out block, and is not
        significant without.

        Args:
            chosen: All of them, as they are fitted together.
            tested: Those that are tested; by default all.
            significant: Whether one that acts in no held-out block is significant without any.
        """
        trials = [
            (self._in_active_blocks(chosen, candidate), candidate)
            for candidate in (chosen if tested is None else tested)
        ]
        gains = [found.gain for found, _ in trials if found.gain is not None]
        # Corrected for their number (Holm 1979), no more: what is tested here was chosen elsewhere.
        corrected = iter(evidence.holm([gain.p_value for gain in gains]))

        def fails(gain: Gain | None, candidate: Candidate) -> bool:
            if gain is None:
                return not significant(candidate)
            chance = next(corrected)
            return chance >= SELECTION.alpha or gain.relative <= JUDGEMENT.least_removed

        failed = [(found, candidate) for found, candidate in trials if fails(found.gain, candidate)]
        return failed or [
            (replace(found, partial=True), candidate)
            for found, candidate in trials
            if not self._shows(chosen, candidate)
        ]

    def shows_nothing_of(
        self, chosen: Sequence[Candidate], candidate: Candidate, joints: Sequence[int]
    ) -> str:
        """Return that one acts in no held-out block, if so, else ``""``; judged by some joints."""
        blocks, _ = self._active(chosen, candidate, joints)
        return "" if len(blocks) else "it hardly acts in the held-out blocks that could confirm it"

    def _shows(self, chosen: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether the part of a claim of one parameter shows that must."""
        validation = self._validation
        claim = candidate.hypothesis
        parts = (
            claim.required_parts(validation.data.motion) if isinstance(claim, RequiresParts) else ()
        )
        if not parts:
            return True
        first, *others = validation.data.candidates(parts)
        fitted = split(chosen, validation.parameters(chosen))
        claimed = next(theta for other, theta in fitted if other is candidate)
        rest = [other for other in chosen if other is not candidate]
        theta, covariance = validation.fit([*rest, *others, first])
        unseen = 0.0
        if isinstance(claim, AbsorbedByModel):
            unseen = claim.absorbed_variance(validation.data.motion)
        deviation = np.sqrt(max(float(covariance[-1, -1]), 0.0) + unseen)
        return bool(np.sign(claimed[0]) * theta[-1] > NORMAL_95 * deviation)

    def _in_active_blocks(self, chosen: Sequence[Candidate], candidate: Candidate) -> Unconfirmed:
        """Return what a chosen candidate gains in the held-out blocks where it acts."""
        before = self.error([other for other in chosen if other is not candidate], chosen)
        after = self.error(chosen)
        joints = self.main_joints(candidate, before, after)
        blocks, edges = self._active(chosen, candidate, joints)
        before[edges] = after[edges] = 0.0
        gain = self.gain(before, after, joints, blocks, candidate) if len(blocks) else None
        return Unconfirmed(candidate.hypothesis, self.joint_names[joints[0]], gain)

    def _active(
        self, chosen: Sequence[Candidate], candidate: Candidate, joints: Sequence[int]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return held-out blocks where one acts on some joints, and (H,) samples at its edges.

        Of an edge within a held-out block the choice could not know where it is.
        """
        fitted = split(chosen, self._validation.parameters(chosen))
        torque = candidate.columns() @ next(theta for other, theta in fitted if other is candidate)
        data = self._validation.data
        square = (np.where(data.usable, torque, 0.0)[:, joints] ** 2).sum(axis=1)
        inside = data.block >= 0
        most = np.bincount(data.block[inside], square[inside]).max(initial=0.0)
        settings, near = candidate.hypothesis.setting, np.zeros(self.samples, dtype=bool)
        for edge in (settings[name] for name in candidate.hypothesis.edges):
            near |= np.abs(self._time - edge) < data.blocks.settings.duration
        power = np.where(near, 0.0, square[self._held])
        least = JUDGEMENT.active * most
        return np.flatnonzero(np.bincount(self._block, power) > least), near

    def gain(
        self,
        before: Array,
        after: Array,
        joints: Sequence[int],
        blocks: NDArray[np.int64] | None = None,
        candidate: Candidate | None = None,
    ) -> Gain:
        """Return what is gained on some joints, with interval over the blocks, and p-value.

        The p-value is of all joints that a candidate acts on: what it does to one of them, however
        little is gained there, is evidence of it.

        Args:
            before: (H, n) errors.
            after: (H, n) errors.
            joints: Indices of the joints.
            blocks: Numbers of the blocks that count; by default all that are held out.
            candidate: What gains; by default something of one parameter at these joints.
        """
        shown = list(joints)
        tested = shown if candidate is None else np.flatnonzero(candidate.acts).tolist()
        scale = np.maximum(self.rmse(before), 1e-12)
        blocks = np.unique(self._block) if blocks is None else blocks
        counted = self._usable & np.isin(self._block, blocks)[:, None]

        def losses(error: Array, at: list[int]) -> Array:
            square = np.where(self._usable, error**2, 0.0)[:, at] / scale[at] ** 2
            return np.asarray(np.bincount(self._block, square.sum(axis=1))[blocks], dtype=float)

        def relative(new: Array, old: Array, axis: int) -> Array:
            total = old.sum(axis=axis)  # where nothing was seen nothing is gained
            ratio = new.sum(axis=axis) / np.where(total > 0.0, total, 1.0)
            return np.where(total > 0.0, 1.0 - np.sqrt(ratio), 0.0)

        old, new = losses(before, shown), losses(after, shown)
        low, high = evidence.bootstrap_interval(relative, (new, old))
        significance = self._validation.significance
        samples = counted.sum(axis=0) / self._validation.redundancy
        product = np.where(counted, after * (before - after), 0.0)
        samples /= significance.inflation(product, samples)
        without, with_it = (_mean_square(error, counted) for error in (before, after))
        gained = significance.gain(without, with_it, samples)[tested].sum()
        p_value = significance.p_value(
            losses(before, tested) - losses(after, tested),
            float(gained),
            1 if candidate is None else candidate.size,
            transient=candidate is not None and candidate.hypothesis.transient,
        )
        return Gain(float(relative(new, old, 0)), low, high, p_value)


def _mean_square(error: Array, counted: NDArray[np.bool_]) -> Array:
    """Return (n,) mean squares of (H, n) errors that count."""
    return np.where(counted, error**2, 0.0).sum(axis=0) / np.maximum(counted.sum(axis=0), 1)
