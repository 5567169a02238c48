"""Low-passed and decimated residuals, in blocks of which some are held out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, in_batches, not_zero
from dvrk_gravity.diagnosis.data.expectation import Expectation, expect, model_columns
from dvrk_gravity.diagnosis.data.motion import BAND, MeasuredMotion
from dvrk_gravity.effects import Effect, Hypothesis, effects
from dvrk_gravity.estimation import (
    Blocks,
    BlockSettings,
    CommonTime,
    NormalEquations,
    Repetition,
    band_noise,
    find_common_time,
    find_repetition,
    make_blocks,
    pairs_a_period_apart,
    repetition_noise,
)
from dvrk_gravity.recording import LowPass

# Values filtered at a time: the filter's copies of twice as many are new memory each time, and take
# 12 ns a value instead of 7.
_FILTERED = 48_000

FloorFrom = Literal["repetition", "high_frequencies", "nothing"]
"""Where the noise floor was seen."""


@dataclass(frozen=True)
class FilterSettings:
    """How torques are compared.

    Attributes:
        band: Hz; torques are compared below this.
        oversampling: Samples kept a second, in bands: at four the second-order low-pass, run twice,
            has let through 0.35 % of what would be aliased; chosen a little above.
        stuck: Part of a stuck sample that the low-pass may leave in a usable one. Chosen; see
            `make sensitivity`.
        near: s, by which two samples may miss a whole period and still show the same: one kept
            sample at the default rate.
        batch: Signals built at a time.
        blocks: How samples are divided into blocks.
    """

    band: float = BAND
    oversampling: float = 5.0
    stuck: float = 0.05
    near: float = 0.03
    batch: int = 32
    blocks: BlockSettings = field(default_factory=BlockSettings)


@dataclass(frozen=True, eq=False)
class FilteredData:
    """T samples of n joints, each in a block.

    Every third block is held out of fit and model selection. The others form folds for
    cross-validation. Where the motion repeats, a block is one phase of every period, since the
    next period shows the same again.

    Attributes:
        motion: The motion.
        band: Low-pass of residual and columns, Hz; ``None`` for static poses.
        decimation: Every so-maniest sample is kept.
        expectation: What should have been measured at these samples.
        residual: (T, n) measured minus expected torque, N·m.
        blocks: The block of each sample.
        repetition: How the motion repeats, if it does.
        common_time: (T,) s, increasing; the motion is the same whole periods apart.
        settings: Filter and blocks.
        bases: :attr:`search_bases`, as soon as they are asked for: of the motion, however its
            model is linearised.
    """

    motion: MeasuredMotion
    band: float | None
    decimation: int
    expectation: Expectation
    residual: Array
    blocks: Blocks
    repetition: Repetition | None
    common_time: Array
    settings: FilterSettings
    bases: dict[type[Effect], Any] = field(default_factory=dict)

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
        expected = expect(motion)
        data = cls(motion, band, decimation, expected, none, nothing, None, empty, settings)
        data = replace(data, residual=data.as_read, expectation=expected.filtered(data.reduce))
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
        """Low-pass and decimate (N, …) signals to (T, …)."""
        if self.band is None or self.motion.rate is None:
            return columns
        low = LowPass(self.band, self.motion.rate)
        flat = columns.reshape(len(columns), -1)
        live = np.flatnonzero(not_zero(flat))
        pieces = []
        for part in self.motion.parts:
            if part.stop - part.start <= 3 * low.edge:
                continue
            kept = range(part.stop - part.start)[low.edge : -low.edge : self.decimation]
            piece = np.zeros((len(kept), flat.shape[1]))
            width = max(1, _FILTERED // (part.stop - part.start))
            for first in range(0, len(live), width):
                batch = live[first : first + width]
                piece[:, batch] = low(flat[part, batch])[low.edge : -low.edge : self.decimation]
            pieces.append(piece)
        reduced = np.concatenate(pieces)
        return reduced.reshape(len(reduced), *columns.shape[1:])

    def below(self, values: Array, band: float) -> Array:
        """Low-pass reduced (T, n) signals further, to a lower band; as they are if it is no lower.

        The product of both filters' responses, 1 / (1 + (f / f_k)^4) each, is that of the lower
        band up to the order f^4 if 1 / f_1^4 + 1 / f_2^4 is 1 / band^4.

        Args:
            values: The signals.
            band: Hz.
        """
        if self.band is None or self.motion.rate is None or band >= self.band:
            return values
        rate = self.motion.rate / self.decimation
        further = (band**-4 - self.band**-4) ** -0.25
        if further >= 0.5 * rate:  # next to nothing is between the two
            return values
        low = LowPass(further, rate)
        lengths = [part.stop - part.start for part in self.motion.parts]
        number = np.repeat(np.arange(float(len(lengths))), lengths)
        part = self.reduce_state(number[:, None])[:, 0]
        pieces = (values[part == each] for each in np.unique(part))
        return np.concatenate([low(piece) if len(piece) > low.edge else piece for piece in pieces])

    def candidate(self, hypothesis: Hypothesis, motion: MeasuredMotion | None = None) -> Candidate:
        """Return one hypothesis with its columns."""
        return next(self.candidates([hypothesis], motion))

    def candidates(
        self, hypotheses: Iterable[Hypothesis], motion: MeasuredMotion | None = None
    ) -> Iterator[Candidate]:
        """Yield hypotheses with their filtered columns, by default in the data's own motion."""
        motion = motion or self.motion
        if motion.measured_twice:
            hypotheses = (replace(each, against_reference=True) for each in hypotheses)
        built = (
            Candidate.of(hypothesis, hypothesis.regressor(motion)) for hypothesis in hypotheses
        )
        for batch in in_batches(
            built, lambda candidate: candidate.values[0].size, self.settings.batch
        ):
            signals = [candidate.values.reshape(len(motion.q), -1) for candidate in batch]
            edges = np.cumsum([columns.shape[1] for columns in signals])[:-1]
            # The inertias of all links together are hundreds of signals: no copy of these.
            columns = np.hstack(signals) if len(signals) > 1 else signals[0]
            reduced = np.split(self.reduce(columns), edges, axis=1)
            for candidate, values in zip(batch, reduced, strict=True):
                yield candidate.with_values(values)

    def relinearised(self, acting: MeasuredMotion, parameters: Array) -> FilteredData:
        """Return the data linearised where a cause acts that changes the model's columns.

        Args:
            acting: The motion with the model on which the cause acts.
            parameters: (d,) the model's parameters, in standard deviations; their product with the
                change of the columns moves into the residual.
        """
        columns = self.reduce(model_columns(acting))
        product = (columns - self.model_columns) @ parameters
        expected = replace(self.expectation, columns=columns)
        return replace(self, residual=self.residual + product, expectation=expected)

    @property
    def model_columns(self) -> Array:
        """(T, n, d) torques by which the expected one may be off, of unit variance each."""
        return self.expectation.columns

    @cached_property
    def as_read(self) -> Array:
        """(T, n) measured minus modelled torque of the given model, N·m."""
        return self.reduce(self.motion.residual)

    @property
    def known_error(self) -> Array:
        """(n,) RMS error that the model had at calibration, N·m; zero if unknown."""
        return self.expectation.known_error

    @cached_property
    def torque_rms(self) -> Array:
        """(n,) RMS torque of the joints, N·m."""
        return np.asarray(np.sqrt(np.mean(self.motion.effort**2, axis=0)))

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """(T, n) samples of joints that were recorded and are not stuck.

        Friction holds a stuck joint at any torque between its two levels, so that its error means
        nothing.
        """
        silent = self.reduce(self.motion.silent.astype(float))
        return (silent < self.settings.stuck) & self.motion.present

    @property
    def block(self) -> NDArray[np.int64]:
        """(T,) block of each sample; -1 between blocks."""
        return self.blocks.label

    @property
    def count(self) -> int:
        """Number of blocks."""
        return self.blocks.count

    @property
    def held_out(self) -> NDArray[np.bool_]:
        """(T,) samples held out of fit and selection."""
        return self.blocks.held_out

    @property
    def fold(self) -> NDArray[np.int64]:
        """(T,) cross-validation fold of each sample; -1 if held out."""
        return self.blocks.fold

    @cached_property
    def held_out_spans(self) -> list[tuple[float, float]]:
        """Beginning and end of each held-out span of time, s."""
        edges = np.flatnonzero(np.diff(self.held_out, prepend=False, append=False))
        return [
            (float(self.time[first]), float(self.time[last - 1]))
            for first, last in zip(edges[::2], edges[1::2], strict=True)
        ]

    @cached_property
    def time(self) -> Array:
        """(T,) s."""
        return self.reduce_state(self.motion.time[:, None])[:, 0]

    @property
    def search_bases(self) -> Mapping[type[Effect], Any]:
        """What effects need to be searched for in a residual, by effect: large."""
        if not self.bases:
            self.bases.update((effect, effect.search_basis(self)) for effect in effects())
        return self.bases

    def release(self) -> None:
        """Drop what is large and can be computed again."""
        self.bases.clear()
        self.motion.release()

    def reduce_state(self, values: Array) -> Array:
        """Decimate (N, …) values to (T, …) without filtering."""
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
        """(T,) number of each sample's recording."""
        motion = self.motion
        number = np.repeat(motion.clocks, [part.stop - part.start for part in motion.parts])
        return self.reduce_state(number[:, None].astype(float))[:, 0].astype(np.int64)

    @property
    def samples_per_independent(self) -> float:
        """Samples per independent one, were the residual white below the band of B Hz: of 2 B."""
        return 1.0 if self.band is None else self.settings.oversampling / 2.0

    @property
    def copies(self) -> float:
        """Number of periods of a motion that repeats, at least 1."""
        return 1.0 if self.repetition is None else self.repetition.copies

    def noise_source(self, noise: Array) -> FloorFrom:
        """Return where (n,) noise RMS was seen."""
        if not np.isfinite(noise).any():
            return "nothing"
        return "high_frequencies" if self.repetition is None else "repetition"

    def noise_rms(self, density: Array, residual: Array | None = None) -> Array:
        """Return (n,) noise RMS, N·m: what differs between periods, where the motion repeats.

        It is at least the rounding of the efforts, step / sqrt(12) (Bennett 1948), which is the
        same in every period.

        Args:
            density: (n,) effort noise density at high frequencies, N·m/sqrt(Hz), for motion that
                does not repeat.
            residual: (T, n) residual of the best model so far, N·m; default: of the given one.
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


@dataclass(frozen=True, eq=False)
class ChoiceSamples:
    """The samples that fit and choice may see, fold by fold.

    Attributes:
        rows: (R,) which of all samples these are.
        folds: Those of each fold.
        block: (R,) number of the block.
        residual: (R, n) N·m.
        usable: (R, n) of which something can be said.
        model: (R, n, d) columns of the model's own parameters.
        pairs: (P,) and (P,) samples that are whole periods apart.
    """

    rows: NDArray[np.int64]
    folds: tuple[slice, ...]
    block: NDArray[np.int64]
    residual: Array
    usable: NDArray[np.bool_]
    model: Array
    pairs: tuple[NDArray[np.int64], NDArray[np.int64]]

    @classmethod
    def of(cls, data: FilteredData) -> ChoiceSamples:
        """Take the samples of all folds."""
        order = np.argsort(data.fold, kind="stable")  # in time within a fold
        rows = order[np.searchsorted(data.fold[order], 0) :]
        edges = np.searchsorted(data.fold[rows], np.arange(data.blocks.settings.folds + 1))
        return cls(
            rows, tuple(slice(int(a), int(b)) for a, b in pairwise(edges) if b > a),
            data.block[rows], data.residual[rows], data.usable[rows], data.model_columns[rows],
            pairs_a_period_apart(data.common_time[rows], data.repetition, data.settings.near),
        )  # fmt: skip

    @cached_property
    def counts(self) -> Array:
        """(n,) usable samples, at least one."""
        return np.asarray(np.maximum(self.usable.sum(axis=0), 1))

    @cached_property
    def values(self) -> list[slice]:
        """Which of R n values, those of n joints in turn, are each fold's."""
        n = self.usable.shape[1]
        return [slice(rows.start * n, rows.stop * n) for rows in self.folds]

    @cached_property
    def of_model(self) -> list[NormalEquations]:
        """Sums of the model's columns over each fold, joint by joint."""
        usable = self.usable.astype(float)
        return [
            NormalEquations.of(self.model[rows], self.residual[rows], usable[rows])
            for rows in self.folds
        ]

    def design(self, candidates: Sequence[Candidate], weights: Array) -> Array:
        """Return (R n, k) columns of candidates with (R, n) weights."""
        width = sum(candidate.size for candidate in candidates)
        columns, first = np.zeros((*weights.shape, width)), 0
        for candidate in candidates:
            own = slice(first, first + candidate.size)
            weight = weights[:, candidate.joints, None]
            columns[:, candidate.joints, own] = candidate.values[self.rows] * weight
            first = own.stop
        return columns.reshape(weights.size, width)
