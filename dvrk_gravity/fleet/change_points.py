r"""When a series changed, and how: a break, a slope, a season, by likelihood on a grid of dates.

Values x_i at times t_i have standard errors e_i, and vary from day to day besides: of

    x_i = f(t_i) + noise,    var(noise_i) = phi (e_i^2 + s^2)

f is a constant, a constant with a step at tau, with a slope from tau on, or with a slope from
before the first value; each with or without a season, a sine of one year. The ratio s^2 to the
errors is taken from a grid, phi and f in closed form (generalised least squares). The stated errors
count for phi = 1 as three more values: of few, some lie on a line by chance.

Shapes are compared by BIC with tau as a parameter (Schwarz 1978; for change points Yao 1988). The
p-value is that of the F test of the shape against no change, at the best tau, times the number of
dates and shapes tried (Bonferroni): right for few values, whatever phi is, and on the safe side.
The interval of tau is that of its posterior with a flat prior over the time span, steps and slopes
equally probable before the data, all other parameters integrated: a step is anywhere in its gap
with equal probability, and a slow step may have been a slope. That of a step goes from a value to
a value.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from dvrk_gravity.arrays import Array, Mask

Shape = Literal["break", "slope", "drift"]
"""A step at a date; a slope from a date on; a slope from before the first value."""

_SHAPES: tuple[Shape, ...] = ("break", "slope", "drift")

YEAR = 365.25  # days
MONTH = YEAR / 12.0
FEWEST = 5
"""Values that a series must have: one more than a step with its date and a variance. Chosen."""

_SIDE = 2  # values on either side of a date: one alone is an outlier
_RATIOS = np.concatenate([[0.0], np.logspace(-1.0, 3.0, 9)])  # of s^2 to the mean square error
_BETWEEN = 4  # dates tried in each gap, at which a slope may begin
_SEASONS = 1.5  # years that a series must span, to have a season
_SEASON_FEWEST = 12  # and values: with a slope six parameters, and as many again. Chosen
_STATED = 3.0  # values for which the stated errors count, where a variance is needed. Chosen
_BOTH_ENDS = (0.025, 0.975)


@dataclass(frozen=True)
class Change:
    """What a series did besides vary.

    Attributes:
        shape: How it changed.
        since: Beginning and end of the 95 % interval of when, days; both the first value's of a
            drift.
        at: The likeliest date, days.
        size: Of a break the step, of the others the slope, a month.
        error: Its standard error, as if the date were known.
        p_value: Of no change at all, for all dates and shapes compared.
        gain: Log-likelihood that it brings, less BIC's costs.
        now: Value at the last date less that at the beginning, by the fit.
    """

    shape: Shape
    since: tuple[float, float]
    at: float
    size: float
    error: float
    p_value: float
    gain: float
    now: float


@dataclass(frozen=True, eq=False)
class FittedSeries:
    """A series with what was fitted to it.

    Attributes:
        curve: (N,) the best shape at the values' times.
        scatter: Standard deviation of a value around it that its error does not explain.
        season: Amplitude of the season; 0: there is none.
        change: What changed; ``None``: nothing that BIC prefers to no change.
        p_value: Of no change, of whichever shape is the best.
    """

    curve: Array
    scatter: float
    season: float
    change: Change | None
    p_value: float


def daily(time: Array, value: Array, error: Array) -> tuple[Array, Array, Array]:
    """Return one value a day: what varies from day to day is common to a day's recordings.

    Args:
        time: (N,) days, increasing.
        value: (N,).
        error: (N,) standard errors.
    """
    day = np.floor(time)
    days, first = np.unique(day, return_inverse=True)
    weight = 1.0 / error**2
    total = np.bincount(first, weight)
    mean = np.bincount(first, weight * value) / total
    when = np.bincount(first, weight * time) / total
    return (time, value, error) if len(days) == len(time) else (when, mean, 1.0 / np.sqrt(total))


def fit(time: Array, value: Array, error: Array, given: Array | None = None) -> FittedSeries:
    """Fit season and change to a series.

    Args:
        time: (N,) days, increasing, at least :data:`FEWEST`.
        value: (N,).
        error: (N,) standard errors, positive.
        given: (N,) a course that it may have in any size, and that is no change of its own.
    """
    columns = [np.ones_like(time)]
    if given is not None and np.ptp(given) > 0.0:
        columns.append((given - given.mean()) / np.ptp(given))
    series = _Series(time, value, error, np.column_stack(columns))
    plain = series.best_of(series.shapes(False, None))
    nulls = [plain]
    if series.may_have_season:
        nulls.append(series.best_of(series.shapes(True, None)))
    null = min(nulls, key=lambda each: each.bic)
    seasonal = null is not plain
    changed = [
        series.best_of(group)
        for shape in _SHAPES
        if len(group := list(series.shapes(seasonal, shape)))
    ]
    best = min(changed, key=lambda each: each.bic)
    comparisons = sum(each.n_comparisons for each in changed)
    p_value = min(1.0, comparisons * series.p_value(best, null))
    chosen = best if best.bic < null.bic else null
    change = None
    if chosen is best:
        assert best.shape is not None
        slope = best.coefficients[best.columns.shape[1] - 1]
        size = slope if best.shape == "break" else slope * MONTH
        scale = 1.0 if best.shape == "break" else MONTH
        fitted = best.columns[:, -1] * slope
        since = series.interval(best, seasonal)
        change = Change(
            best.shape, since, best.tau, float(size), float(scale * best.error), p_value,
            0.5 * (null.bic - best.bic), float(fitted[-1] - fitted[0]),
        )  # fmt: skip
    first = series.base.shape[1]
    season = float(np.hypot(*chosen.coefficients[first : first + 2])) if seasonal else 0.0
    return FittedSeries(
        chosen.columns @ chosen.coefficients, chosen.scatter, season, change, p_value
    )


@dataclass(frozen=True, eq=False)
class _Form:
    """One shape at one date: its columns, the last one the change's."""

    shape: Shape | None
    tau: float
    columns: Array
    width: float = 1.0  # days that it stands for


@dataclass(frozen=True, eq=False)
class _BestForm:
    """The best of some forms, at its best ratio of variances."""

    shape: Shape | None
    tau: float
    columns: Array
    coefficients: Array
    error: float
    likelihood: float
    bic: float
    scatter: float
    weight: Array
    n_comparisons: int


@dataclass(frozen=True, eq=False)
class _Series:
    time: Array
    value: Array
    error: Array
    base: Array

    @property
    def may_have_season(self) -> bool:
        span = self.time[-1] - self.time[0]
        return bool(span >= _SEASONS * YEAR and len(self.time) >= _SEASON_FEWEST)

    @cached_property
    def weights(self) -> Array:
        """(S, N) inverse variances but for phi, one row for each ratio."""
        square = float(np.mean(self.error**2))
        return 1.0 / (self.error**2 + square * _RATIOS[:, None])

    def shapes(self, seasonal: bool, shape: Shape | None) -> Iterator[_Form]:
        """Yield the forms of a shape, one for each date."""
        time = self.time
        base = list(self.base.T)
        if seasonal:
            base += [np.cos(2.0 * np.pi * time / YEAR), np.sin(2.0 * np.pi * time / YEAR)]
        if shape is None or shape == "drift":
            more = [] if shape is None else [time - time[0]]
            yield _Form(shape, float(time[0]), np.column_stack(base + more))
            return
        first, last = _SIDE - 1, len(time) - _SIDE
        for before in range(first, last):
            begin, end = float(time[before]), float(time[before + 1])
            if shape == "break":
                step = (np.arange(len(time)) > before).astype(float)
                yield _Form(shape, 0.5 * (begin + end), np.column_stack([*base, step]), end - begin)
                continue
            for part in (np.arange(_BETWEEN) + 0.5) / _BETWEEN:
                tau = begin + part * (end - begin)
                ramp = np.maximum(time - tau, 0.0)
                yield _Form(
                    shape, tau, np.column_stack([*base, ramp]), (end - begin) / _BETWEEN
                )  # fmt: skip

    def best_of(self, forms: Iterator[_Form] | Sequence[_Form]) -> _BestForm:
        """Return the likeliest of some forms of as many parameters."""
        forms = list(forms)
        likelihood, theta, covariance, phi, _ = self._fits(forms)
        which, ratio = np.unravel_index(np.argmax(likelihood), likelihood.shape)
        form, n = forms[which], len(self.time)
        # A date is a parameter; the two variances every shape has.
        parameters = form.columns.shape[1] + (form.shape in ("break", "slope"))
        most = float(likelihood[which, ratio])
        freedom = n - form.columns.shape[1] + _STATED
        scale = float(phi[which, ratio]) * (n + _STATED) / freedom
        scatter = np.sqrt(scale * float(np.mean(self.error**2)) * _RATIOS[ratio])
        return _BestForm(
            form.shape, form.tau, form.columns, theta[which, ratio],
            float(np.sqrt(scale * covariance[which, ratio])), most,
            -2.0 * most + parameters * np.log(n), float(scatter), self.weights[ratio], len(forms),
        )  # fmt: skip

    def p_value(self, best: _BestForm, null: _BestForm) -> float:
        """Return the p-value of the F test of a form against no change, with the form's weights."""
        from scipy.special import fdtrc

        root = np.sqrt(best.weight)
        left = [
            float(np.sum((root * self.value - root[:, None] * columns @ np.linalg.lstsq(
                root[:, None] * columns, root * self.value, rcond=None)[0]) ** 2))
            for columns in (null.columns, best.columns)
        ]  # fmt: skip
        more = best.columns.shape[1] - null.columns.shape[1]
        freedom = len(self.time) - best.columns.shape[1]
        if left[1] <= 0.0:
            return 1.0  # values that do not vary at all
        ratio = (left[0] - left[1]) / more / (left[1] / freedom)
        return float(fdtrc(more, freedom, max(ratio, 0.0)))

    def interval(self, best: _BestForm, seasonal: bool) -> tuple[float, float]:
        """Return the 95 % interval of the date of a change."""
        if best.shape == "drift":
            return float(self.time[0]), float(self.time[0])
        shapes: tuple[Shape, Shape] = ("break", "slope")
        forms = [form for shape in shapes for form in self.shapes(seasonal, shape)]
        evidence = self._fits(forms)[4]
        width = np.array([form.width for form in forms])
        mass = np.exp(evidence - evidence.max()).sum(axis=1) * width
        gaps = len(forms) // (1 + _BETWEEN)
        # Of a step its gap's probability is spread over the dates that a slope is tried at.
        mass = mass[gaps:] + np.repeat(mass[:gaps], _BETWEEN) / _BETWEEN
        middle, width = np.array([form.tau for form in forms[gaps:]]), width[gaps:]
        edges = np.concatenate([[0.0], np.cumsum(mass / mass.sum())])
        ends = np.concatenate([middle - 0.5 * width, [middle[-1] + 0.5 * width[-1]]])
        low, high = np.interp(_BOTH_ENDS, edges, ends)
        if best.shape == "break":  # from a recording to a recording
            low = self.time[np.searchsorted(self.time, low, side="right") - 1]
            high = self.time[np.searchsorted(self.time, high)]
        return float(low), float(high)

    def _fits(self, forms: Sequence[_Form]) -> tuple[Array, Array, Array, Array, Array]:
        """Return what forms have in closed form, for each of the S ratios.

        Returns:
            (F, S) log-likelihoods, (F, S, k) coefficients, (F, S) variance of the last but for phi,
            (F, S) phi, and (F, S) log-likelihoods integrated over all of these, with the last
            column at unit height.
        """
        columns = np.stack([form.columns for form in forms])  # (F, N, k)
        weight, n = self.weights, len(self.time)
        gram = np.einsum("fnk,sn,fnl->fskl", columns, weight, columns, optimize=True)
        cross = np.einsum("fnk,sn->fsk", columns, weight * self.value, optimize=True)
        k = columns.shape[2]
        scale = np.sqrt(np.einsum("fskk->fsk", gram))
        scale = np.where(scale > 0.0, scale, 1.0)
        scaled = gram / (scale[..., :, None] * scale[..., None, :]) + 1e-12 * np.eye(k)
        inverse = np.linalg.inv(scaled) / (scale[..., :, None] * scale[..., None, :])
        theta = np.einsum("fskl,fsl->fsk", inverse, cross)
        left = self.value - np.einsum("fnk,fsk->fsn", columns, theta)
        square = np.einsum("fsn,sn->fs", left**2, weight)
        phi = (square + _STATED) / (n + _STATED)
        likelihood = -0.5 * (n + _STATED) * np.log(phi) + 0.5 * np.log(weight).sum(axis=1)
        height = np.abs(columns[:, :, -1]).max(axis=1)[:, None]
        evidence = -0.5 * (n - k + _STATED) * np.log(square + _STATED)
        evidence += 0.5 * np.log(weight).sum(axis=1)
        evidence -= 0.5 * np.linalg.slogdet(scaled)[1] + np.log(scale).sum(axis=2) - np.log(height)
        return likelihood, theta, inverse[..., -1, -1], phi, evidence


def usable(value: Array, error: Array) -> Mask:
    """Return (N,) which values of a series have an error."""
    return np.isfinite(value) & np.isfinite(error) & (error > 0.0)
