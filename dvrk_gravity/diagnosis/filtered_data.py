"""Residuals behind a low-pass, thinned out, in blocks, some of which are held out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.candidate import Candidate, in_batches
from dvrk_gravity.diagnosis.findings import FloorFrom
from dvrk_gravity.diagnosis.model_error import changed_friction, friction_torque, model_columns
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.effects import Hypothesis
from dvrk_gravity.estimation import (
    Blocks,
    BlockSettings,
    CommonTime,
    Repetition,
    band_noise,
    find_common_time,
    find_repetition,
    make_blocks,
    pairs_a_period_apart,
    repetition_noise,
)
from dvrk_gravity.recording import LowPass


@dataclass(frozen=True)
class FilterSettings:
    """How torques are compared.

    Attributes:
        band: Hz; torques are compared below this. Chosen; see `make sensitivity`.
        oversampling: Samples kept a second, in bands: at four the second-order low-pass, run twice,
            has let through 0.35 % of what would be aliased; chosen a little above.
        stuck: Part of a stuck sample that the low-pass may leave in a usable one. Chosen; see
            `make sensitivity`.
        near: s, by which two samples that show the same may miss a period: one kept sample, at the
            default rate.
        together: Signals filtered at a time: the filter makes copies.
        blocks: How samples are cut.
    """

    band: float = 8.0
    oversampling: float = 5.0
    stuck: float = 0.05
    near: float = 0.03
    together: int = 32
    blocks: BlockSettings = field(default_factory=BlockSettings)

    @property
    def samples_per_independent(self) -> float:
        """Samples kept that count as one: of a band of B Hz, 2 B a second are independent."""
        return self.oversampling / 2.0


BAND = FilterSettings().band
"""Hz: torques are compared below this."""


@dataclass(frozen=True, eq=False)
class FilteredData:
    """The reduced problem: T samples of n joints, each in a block.

    Every third block is held out: neither fit nor choice sees it. The others make folds for
    cross-validation. Where the motion repeats, a block is one phase of every period: what one
    period shows is no news in the next.

    Attributes:
        motion: Where it comes from.
        band: Low-pass over residual and columns, Hz; ``None`` for static poses.
        decimation: One of so many samples is kept.
        residual: (T, n) measured minus modelled torque, N·m.
        model_columns: (T, n, d) changes of the model's torque by its parameters, of unit variance
            each.
        blocks: Which samples belong together.
        repetition: How the motion repeats, if it does.
        common_time: (T,) s, increasing; whole periods apart the motion shows the same.
        settings: How torques are compared.
    """

    motion: MeasuredMotion
    band: float | None
    decimation: int
    residual: Array
    model_columns: Array
    blocks: Blocks
    repetition: Repetition | None
    common_time: Array
    settings: FilterSettings

    @classmethod
    def of(cls, motion: MeasuredMotion, settings: FilterSettings | None = None) -> FilteredData:
        """Reduce a motion."""
        settings = settings or FilterSettings()
        rate = motion.rate
        band = None if rate is None else min(settings.band, rate / 6.0)
        decimation = 1
        if rate is not None and band is not None:
            decimation = max(1, int(rate / (settings.oversampling * band)))
        nothing = Blocks(np.zeros(0, dtype=np.int64), 0, settings.blocks)
        empty, none = np.zeros(0), np.zeros((0, 0))
        data = cls(motion, band, decimation, none, none, nothing, None, empty, settings)
        data = replace(
            data, residual=data.as_read, model_columns=data.reduce(model_columns(motion))
        )
        if rate is None:
            blocks = make_blocks(CommonTime.single_clock(data.time), None, settings.blocks)
            return replace(data, blocks=blocks, common_time=data.time)
        part = np.repeat(np.arange(len(motion.parts)), [p.stop - p.start for p in motion.parts])
        seen = find_common_time(motion.time, part, motion.q, rate, motion.clocks)
        again = find_repetition(seen, part, motion.q, rate)
        repetition, common = again or (None, motion.time)
        columns = np.column_stack([common if again else seen.time, seen.group])
        thinned = data.reduce_state(columns)
        blocks = make_blocks(seen.at(*thinned.T), rate / decimation, settings.blocks)
        return replace(data, blocks=blocks, repetition=repetition, common_time=thinned[:, 0])

    def reduce(self, columns: Array) -> Array:
        """Low-pass and thin out (N, …) signals to (T, …)."""
        if self.band is None or self.motion.rate is None:
            return columns
        low = LowPass(self.band, self.motion.rate)
        flat = columns.reshape(len(columns), -1)
        live = np.flatnonzero(_not_zero(flat))
        together = self.settings.together
        pieces = []
        for part in self.motion.parts:
            if part.stop - part.start <= 3 * low.edge:
                continue
            kept = range(part.stop - part.start)[low.edge : -low.edge : self.decimation]
            piece = np.zeros((len(kept), flat.shape[1]))
            for first in range(0, len(live), together):
                batch = live[first : first + together]
                piece[:, batch] = low(flat[part, batch])[low.edge : -low.edge : self.decimation]
            pieces.append(piece)
        reduced = np.concatenate(pieces)
        return reduced.reshape(len(reduced), *columns.shape[1:])

    def candidate(self, hypothesis: Hypothesis, motion: MeasuredMotion | None = None) -> Candidate:
        """Return a hypothesis with its columns; see :meth:`candidates`."""
        return next(self.candidates([hypothesis], motion))

    def candidates(
        self, hypotheses: Iterable[Hypothesis], motion: MeasuredMotion | None = None
    ) -> Iterator[Candidate]:
        """Yield hypotheses with their columns, many of which are filtered together.

        Args:
            hypotheses: The hypotheses.
            motion: The motion; by default as it is, no other cause acting.
        """
        motion = motion or self.motion
        if motion.reference is not None:
            hypotheses = (replace(each, against_reference=True) for each in hypotheses)
        built = (
            Candidate.of(hypothesis, hypothesis.regressor(motion)) for hypothesis in hypotheses
        )
        for batch in in_batches(
            built, lambda candidate: candidate.values[0].size, self.settings.together
        ):
            signals = [candidate.values.reshape(len(motion.q), -1) for candidate in batch]
            edges = np.cumsum([columns.shape[1] for columns in signals])[:-1]
            # The inertias of all links together are hundreds of signals: no copy of these.
            together = np.hstack(signals) if len(signals) > 1 else signals[0]
            reduced = np.split(self.reduce(together), edges, axis=1)
            for candidate, columns in zip(batch, reduced, strict=True):
                yield candidate.with_values(columns)

    def relinearised(self, acting: MeasuredMotion, parameters: Array) -> FilteredData:
        """Return the same with the model's columns as they are beside a cause that changes them.

        Linear in the parameters and in the cause, at these: the residual has what their product
        adds.

        Args:
            acting: The motion with the model on which the cause acts.
            parameters: (d,) the model's parameters, in units of their standard deviations.
        """
        columns = self.reduce(model_columns(acting))
        product = (columns - self.model_columns) @ parameters
        return replace(self, residual=self.residual + product, model_columns=columns)

    @cached_property
    def as_read(self) -> Array:
        """(T, n) measured minus modelled torque of the given model, N·m."""
        return self.reduce(self.motion.residual)

    @cached_property
    def known_error(self) -> Array:
        """(n,) RMS error that the model is known to have, N·m; zero where it does not tell."""
        known = self.motion.model.uncertainty
        return np.zeros(self.motion.arm.n) if known is None else np.nan_to_num(known.error)

    @cached_property
    def torque_rms(self) -> Array:
        """(n,) RMS torque of the joints, N·m."""
        return np.asarray(np.sqrt(np.mean(self.motion.effort**2, axis=0)))

    @cached_property
    def friction(self) -> Array:
        """(T, n) torque of the model's friction, N·m; see :func:`model_error.friction_torque`."""
        return self.reduce(friction_torque(self.motion))

    @cached_property
    def expected_on_another_day(self) -> Array:
        """(n,) the same with what friction may change by from one day to another."""
        return np.hypot(self.known_error, changed_friction(self.motion))

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """(T, n) samples that say something: recorded, and not of a joint that is stuck.

        A joint that friction holds is held by anything between the two levels: no model can
        tell which, and neither can its error.
        """
        silent = self.reduce(self.motion.silent.astype(float))
        return (silent < self.settings.stuck) & self.motion.present

    @property
    def block(self) -> NDArray[np.int64]:
        """(T,) number of the block; -1 for samples between blocks."""
        return self.blocks.label

    @property
    def count(self) -> int:
        """Number of blocks."""
        return self.blocks.count

    @property
    def held_out(self) -> NDArray[np.bool_]:
        """(T,) samples that neither fit nor choice sees."""
        return self.blocks.held_out

    @property
    def fold(self) -> NDArray[np.int64]:
        """(T,) fold of the samples that choice may see, -1 of the others."""
        return self.blocks.fold

    @cached_property
    def held_out_spans(self) -> list[tuple[float, float]]:
        """Beginnings and ends of the pieces of time that are held out, s."""
        edges = np.flatnonzero(np.diff(self.held_out, prepend=False, append=False))
        return [
            (float(self.time[first]), float(self.time[last - 1]))
            for first, last in zip(edges[::2], edges[1::2], strict=True)
        ]

    @cached_property
    def time(self) -> Array:
        """(T,) s."""
        return self.reduce_state(self.motion.time[:, None])[:, 0]

    def reduce_state(self, values: Array) -> Array:
        """Thin out (N, …) values to (T, …) without filtering."""
        if self.band is None or self.motion.rate is None:
            return values
        low = LowPass(self.band, self.motion.rate)
        pieces = [
            values[part][low.edge : -low.edge : self.decimation]
            for part in self.motion.parts
            if part.stop - part.start > 3 * low.edge
        ]
        return np.concatenate(pieces)

    @cached_property
    def recording(self) -> NDArray[np.int64]:
        """(T,) number of the recording that a sample is of."""
        motion = self.motion
        number = np.repeat(motion.clocks, [part.stop - part.start for part in motion.parts])
        return self.reduce_state(number[:, None].astype(float))[:, 0].astype(np.int64)

    @property
    def samples_per_independent(self) -> float:
        """Samples that count as one where the residual is white below the band."""
        return 1.0 if self.band is None else self.settings.samples_per_independent

    @property
    def copies(self) -> float:
        """How often the motion shows the same, at least 1."""
        return 1.0 if self.repetition is None else self.repetition.copies

    def pairs(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return (P,) and (P,) which of some samples show the same, a period apart.

        Args:
            rows: (R,) indices of the samples.
        """
        return pairs_a_period_apart(self.common_time[rows], self.repetition, self.settings.near)

    def noise_source(self, noise: Array) -> FloorFrom:
        """Return where (n,) noise RMS come from."""
        if not np.isfinite(noise).any():
            return "nothing"
        return "high_frequencies" if self.repetition is None else "repetition"

    def noise_rms(self, density: Array, residual: Array | None = None) -> Array:
        """Return (n,) noise, N·m: what does not come back with the motion, where that repeats.

        It is no less than what the steps of the efforts leave: rounding to step / sqrt(12) (Bennett
        1948) comes back with a motion that repeats, and so does not show there.

        Args:
            density: (n,) effort noise density as high frequencies show it, N·m/sqrt(Hz); for
                motion that does not repeat.
            residual: (T, n) what the best model so far leaves, N·m; by default what the given one
                does.
        """
        if self.band is None:
            return np.full(self.residual.shape[1], np.nan)
        noise = band_noise(density, self.band)
        if self.repetition is None:
            return noise
        residual = self.residual if residual is None else residual
        differs = repetition_noise(self.repetition, self.common_time, residual, self.usable)
        differs = np.where(np.isfinite(differs), differs, noise)
        return np.fmax(differs, band_noise(self.motion.rounding, self.band))


def _not_zero(signals: Array) -> NDArray[np.bool_]:
    """Return (k,) which columns of (N, k) signals are not zero throughout: most soon show it."""
    found = np.asarray(np.any(signals[::100], axis=0))
    silent = np.flatnonzero(~found)
    found[silent] = np.any(signals[:, silent], axis=0)
    return found
