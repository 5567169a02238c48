"""What estimation promises, counted in repeated draws: p-values, intervals, independent samples."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats
from scipy.signal import lfilter

from dvrk_gravity.estimation import (
    PRIOR_SHARE,
    NormalEquations,
    Repetition,
    RobustSettings,
    RobustState,
    autocorrelated_scores,
    band_noise,
    block_jackknife,
    clustered_scores,
    correlation_time,
    design_effect,
    evidence,
    fit,
    intraclass_correlation,
    omitted_columns,
    pairs_a_period_apart,
    repetition_noise,
    reweighted,
    robust_scale,
    robust_weights,
    sandwich,
    sequential,
)


def coloured(random: np.random.Generator, shape: tuple[int, ...], a: float) -> np.ndarray:
    """Draw AR(1) noise of variance one along the first axis."""
    noise = random.normal(size=(shape[0] + 200, *shape[1:]))
    return lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], noise, axis=0)[200:]


def band(share: float, count: int) -> tuple[float, float]:
    """Return within which a count's share lies in 99.9 % of all cases."""
    low, high = stats.binom.interval(0.999, count, share)
    return low / count, high / count


def test_paired_p_values_are_uniform_where_there_is_no_gain():
    random = np.random.default_rng(0)
    found = np.array([evidence.paired(random.normal(size=25)) for _ in range(600)])
    for p_values in found.T:
        assert stats.kstest(p_values, "uniform").pvalue > 0.001
        for level in (0.01, 0.05, 0.3):
            low, high = band(level, len(p_values))
            assert low <= np.mean(p_values <= level) <= high


def test_likelihood_ratio_p_values_are_uniform_in_the_sample_and_no_smaller_out_of_it():
    random = np.random.default_rng(1)
    inside, outside = [], []
    for _ in range(1500):
        x, y, new = random.normal(size=(3, 400))
        theta = x @ y / (x @ x)
        inside.append(
            evidence.likelihood_ratio(0.5 * (y @ y - (y - theta * x) @ (y - theta * x)), 1)
        )
        blind = 0.5 * (new @ new - (new - theta * x) @ (new - theta * x))
        outside.append(evidence.likelihood_ratio(blind, 1))
    assert stats.kstest(inside, "uniform").pvalue > 0.001
    assert np.mean(np.array(outside) <= 0.05) <= band(0.05, 1500)[1]


@pytest.mark.parametrize("parameters", [1, 3])
def test_p_values_are_uniform_in_units_of_a_variance_estimated_from_few_and_chi_square_s_are_not(
    parameters,
):
    random, freedom = np.random.default_rng(3), 20
    estimated = (random.normal(size=(4000, freedom)) ** 2).mean(axis=1)
    gains = 0.5 * (random.normal(size=(4000, parameters)) ** 2).sum(axis=1) / estimated

    told = [evidence.variance_ratio(gain, parameters, freedom) for gain in gains]
    as_if_known = [evidence.likelihood_ratio(gain, parameters) for gain in gains]

    assert stats.kstest(told, "uniform").pvalue > 0.001
    assert np.mean(np.array(as_if_known) <= 0.001) > 3.0 * 0.001


def test_the_best_of_many_in_units_of_one_estimated_variance_is_told_no_more_often_than_is_said():
    """And never less often than by each alone times the trials, which is stricter than it says."""
    random, freedom, trials = np.random.default_rng(4), 20, 300
    estimated = (random.normal(size=(3000, freedom)) ** 2).mean(axis=1)
    best = 0.5 * (random.normal(size=(3000, trials)) ** 2).max(axis=1) / estimated

    told = np.array([evidence.variance_ratio(gain, 1, freedom, trials) for gain in best])
    apart = np.array([evidence.variance_ratio(gain, 1, freedom) for gain in best]) * trials

    for level in (0.01, 0.05, 0.2):
        assert 0.5 * level < np.mean(told <= level) <= band(level, len(told))[1]
    assert np.all(told <= apart * (1.0 + 1e-6))
    assert np.mean(apart <= 0.2) < 0.7 * np.mean(told <= 0.2)


def test_errors_beyond_a_variance_known_before_are_student_s_and_smaller_ones_gaussian():
    """Against SciPy's densities of n errors of one size."""
    size, known, freedom = 12, 0.3, 7.0
    scale = np.sqrt(known)

    def told(mean):
        arguments = (np.array([mean * known]), np.array([known]), np.array([float(size)]))
        return evidence.log_likelihood(*arguments, freedom)[0]

    student = stats.multivariate_t(np.zeros(size), known * np.eye(size), df=freedom)
    for mean in (1.5, 4.0, 30.0):
        above = student.logpdf(np.full(size, np.sqrt(mean) * scale))
        expected = above - student.logpdf(np.full(size, scale))
        assert told(mean) - told(1.0) == pytest.approx(expected)
    for mean in (0.1, 0.9):
        below = stats.norm.logpdf(np.array([np.sqrt(mean), 1.0]) * scale, scale=scale)
        assert told(mean) - told(1.0) == pytest.approx(size * (below[0] - below[1]))


def test_of_a_variance_that_is_not_known_the_most_likely_counts():
    """Against the likelihood maximised by SciPy."""
    for mean, samples in ((4.0, 30.0), (0.01, 20.0)):
        best = optimize.minimize_scalar(
            lambda log, m=mean, n=samples: 0.5 * n * (log + m * np.exp(-log)),
            bounds=(-20.0, 5.0), method="bounded", options={"xatol": 1e-10},
        ).fun  # fmt: skip
        told = evidence.log_likelihood(np.array([mean, 1.0]), np.zeros(2), np.full(2, samples), 9.0)
        assert told[0] - told[1] == pytest.approx(0.5 * samples - best)


def test_the_variance_of_a_torque_s_size_grows_by_the_correlation_of_errors_times_torque():
    """A slow error is in the way of a slow torque, and hardly of a fast one."""
    random = np.random.default_rng(0)
    size, draws, memory = 3000, 400, np.exp(-1.0 / 8.0)
    white = np.sqrt(1.0 - memory**2) * random.normal(size=(size, draws))
    errors = lfilter([1.0], [1.0, -memory], white, axis=0)

    def growth(period: float) -> tuple[float, float]:
        torque = np.sin(2.0 * np.pi * np.arange(size) / period)[:, None]
        told = correlation_time(errors * torque, np.zeros(size, dtype=int), size // 4).mean()
        return told, np.var((errors * torque).sum(axis=0)) / np.sum(torque**2)

    slow, true = growth(400.0)
    assert true > 10.0
    assert slow == pytest.approx(true, rel=0.2)
    fast, true = growth(12.0)
    assert true < 1.5
    assert true < fast < slow / 3.0  # never less than true: no negative correlations count


def test_large_deviations_of_what_was_estimated_surprise_as_student_says():
    """Of ratios to an estimated standard deviation, against SciPy's density."""
    for freedom in (5.0, 20.0):
        for deviation in (0.5, 3.0, 9.0):
            density = stats.t(freedom).logpdf([0.0, deviation])
            told = evidence.of_student(0.5 * deviation**2, freedom)
            assert told == pytest.approx(density[0] - density[1])
            assert evidence.of_student(-0.5 * deviation**2, freedom) == -told


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_the_best_of_many_is_called_significant_no_more_often_than_is_said(correlation):
    random = np.random.default_rng(2)
    shared = np.sqrt(correlation) * random.normal(size=(4000, 1))
    z = shared + np.sqrt(1.0 - correlation) * random.normal(size=(4000, 40))
    p_values = stats.norm.sf(z)
    for corrected in (
        np.array([evidence.bonferroni(row.min(), 40) for row in p_values]),
        np.array([evidence.holm(row).min() for row in p_values]),
    ):
        rate = np.mean(corrected <= 0.05)
        assert rate <= band(0.05, 4000)[1]
        if correlation == 0.0:
            assert rate >= band(0.05, 4000)[0] - 0.0012  # 1 - (1 - 0.05/40)^40 is 0.0488


def test_the_square_root_of_the_number_searched_would_be_no_correction():
    """Of 240 frequencies, one in eight draws of pure noise would pass a test at 1 %."""
    random = np.random.default_rng(3)
    least = stats.norm.sf(random.normal(size=(2000, 240))).min(axis=1)
    assert np.mean(least * 240**0.5 <= 0.01) > 0.1
    assert np.mean([evidence.bonferroni(p, 240) <= 0.01 for p in least]) <= band(0.01, 2000)[1]


def test_holm_is_as_in_the_textbook():
    np.testing.assert_allclose(
        evidence.holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02], atol=1e-12
    )


def test_bootstrap_intervals_of_a_ratio_hold_their_share():
    random = np.random.default_rng(4)

    def ratio(new, old, axis):
        return 1.0 - np.sqrt(new.sum(axis=axis) / old.sum(axis=axis))

    truth, hits = 1.0 - np.sqrt(0.8), 0
    for _ in range(300):
        old = random.gamma(4.0, size=40)
        new = 0.8 * old * random.gamma(20.0, 1.0 / 20.0, size=40)
        low, high = evidence.bootstrap_interval(ratio, (new, old), 400)
        hits += low <= truth <= high
    # Percentile intervals of 40 blocks are a little short (Efron 1979): 93 % or so.
    assert band(0.93, 300)[0] <= hits / 300 <= band(0.95, 300)[1]


def test_correlation_time_of_an_autoregression():
    """Of AR(1) with coefficient a it is (1 + a) / (1 - a): the mean's variance grows by that."""
    for a in (0.0, 0.5, 0.9):
        noise = coloured(np.random.default_rng(5), (4000, 60), a)
        part = np.zeros(len(noise), dtype=np.int64)
        expected = (1.0 + a) / (1.0 - a)
        assert correlation_time(noise, part, 100).mean() == pytest.approx(expected, rel=0.12)
        counted = len(noise) * noise.mean(axis=0).var()
        assert counted == pytest.approx(expected, rel=0.45)


def test_design_effect_of_copies_is_how_much_the_variance_of_a_mean_grows():
    random = np.random.default_rng(6)
    for share in (0.0, 0.3, 0.8):
        # 3000 draws of 50 states, each seen four times.
        common = np.sqrt(share) * random.normal(size=(50, 1, 3000))
        seen = common + np.sqrt(1.0 - share) * random.normal(size=(50, 4, 3000))
        grown = 200.0 * seen.mean(axis=(0, 1)).var()
        assert design_effect(4.0, np.array([share]))[0] == pytest.approx(grown, rel=0.1)
        usable = np.ones((50, 3000), dtype=bool)
        found = intraclass_correlation(seen[:, 0], seen[:, 1], usable).mean()
        assert found == pytest.approx(share, abs=0.06)  # at least 0, so a little high there


def test_noise_by_repetition_and_by_high_frequencies_are_the_same_noise():
    random = np.random.default_rng(7)
    time = np.arange(6000) / 200.0
    repeating = np.sin(2.0 * np.pi * time / 7.0)[:, None] * np.array([1.0, 0.1])
    noise = np.array([0.02, 0.3]) * coloured(random, (6000, 2), 0.6)
    usable = np.ones(noise.shape, dtype=bool)
    repetition = Repetition(7.0, 4.3)
    found = repetition_noise(repetition, time, repeating + noise, usable)
    np.testing.assert_allclose(found, [0.02, 0.3], rtol=0.06)
    first, second = pairs_a_period_apart(time, repetition, 0.001)
    np.testing.assert_allclose(time[second] - time[first], 7.0, atol=1e-9)


def test_the_density_of_noise_tells_how_much_is_left_behind_a_low_pass():
    from dvrk_gravity.recording import LowPass

    white = 0.05 * np.random.default_rng(8).normal(size=(20_000, 2))
    narrow = LowPass(8.0, 200.0)
    density = np.full(2, 0.05 / np.sqrt(100.0))
    passed = narrow(white)[narrow.edge : -narrow.edge].std(axis=0)
    np.testing.assert_allclose(band_noise(density, 8.0), passed, rtol=0.06)


def test_robust_scale_is_the_standard_deviation_of_normal_noise_and_no_outliers():
    noise = np.random.default_rng(9).normal(size=(20_000, 2)) * [1.0, 3.0]
    noise[:1000] = 100.0
    np.testing.assert_allclose(robust_scale(noise), [1.07, 3.2], rtol=0.02)
    used = np.arange(20_000) >= 1000
    found = robust_scale(noise, np.stack([used, ~used & False], axis=1))
    np.testing.assert_allclose(found, [1.0, 0.0], rtol=0.02)


@pytest.mark.parametrize(("huber", "efficiency"), [(1.345, 0.95), (2.0, 0.990), (2.5, 0.998)])
def test_huber_weights_cost_normal_noise_no_more_than_is_said(huber, efficiency):
    """The asymptotic efficiency, by numerical integration."""
    z = np.linspace(-10.0, 10.0, 200_001)
    pull = np.clip(z, -huber, huber)
    density = stats.norm.pdf(z) * (z[1] - z[0])
    inside = density[np.abs(z) < huber].sum()
    assert inside**2 / (pull**2 @ density) == pytest.approx(efficiency, abs=0.0015)
    weight = robust_weights(z[:, None], np.ones(1), RobustSettings(huber))[:, 0]
    np.testing.assert_allclose(weight * z, pull, atol=1e-12)


def test_outliers_do_not_move_a_robust_fit():
    random = np.random.default_rng(10)
    x = random.normal(size=(300, 1, 2))
    y = (x @ [1.0, -2.0]) + 0.1 * random.normal(size=(300, 1))
    y[::10] += 50.0

    def fitted(state: RobustState) -> tuple[np.ndarray, np.ndarray]:
        solution = fit(NormalEquations.of(x, y, state.weight), np.ones(1), np.full(2, 1e3))
        return solution.theta, y - x @ solution.theta

    start = RobustState(np.ones_like(y), np.ones(1))
    found = reweighted(fitted, start, RobustSettings(outlier=8.0, rounds=10))
    solution = fit(NormalEquations.of(x, y, found.weight), np.ones(1), np.full(2, 1e3))
    np.testing.assert_allclose(solution.theta, [1.0, -2.0], atol=0.03)
    assert (found.weight[::10] == 0.0).all()
    assert found.scale == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize("a", [0.0, 0.9])
def test_intervals_hold_their_share_in_white_and_in_coloured_noise(a):
    """White-noise formulas would hold it in about half the cases where a is 0.9."""
    random = np.random.default_rng(11)
    time = np.arange(1500) / 50.0
    x = np.stack([np.ones_like(time), np.sin(0.9 * time), np.cos(2.3 * time)], axis=1)[:, None]
    truth, part = np.array([1.0, -2.0, 0.5]), np.zeros(1500, dtype=np.int64)
    hits = []
    for _ in range(300):
        y = x @ truth + coloured(random, (1500, 1), a)
        solution = fit(NormalEquations.of(x, y), np.ones(1), np.full(3, 1e3))
        residual = y - x @ solution.theta
        meat = autocorrelated_scores(
            x, residual, residual, part, 50.0, np.ones(1), np.ones(y.shape, dtype=bool)
        )
        spread = sandwich(solution, meat)
        for k, unit in enumerate(np.eye(3)):
            low, high = spread.interval(solution.theta[k], unit)
            hits.append(low <= truth[k] <= high)
    # 30 s hold some 40 independent samples where a is 0.9: a per cent or two is lost.
    assert band(0.935, len(hits))[0] <= np.mean(hits) <= band(0.95, len(hits))[1]


def test_autocorrelated_scores_are_those_of_the_whole_matrix():
    random = np.random.default_rng(12)
    x, residual = random.normal(size=(90, 2, 3)), coloured(random, (90, 2), 0.5)
    part = np.repeat([0, 1], [50, 40])
    weight, measured = np.array([1.0, 2.0]), np.ones((90, 2), dtype=bool)
    meat = autocorrelated_scores(x, residual, residual, part, 20.0, weight, measured, 0.4)
    from dvrk_gravity.estimation import autocorrelation

    u = np.arange(9) / 9.0
    taper = np.where(u <= 0.5, 1.0 - 6.0 * u**2 + 6.0 * u**3, 2.0 * (1.0 - u) ** 3)
    rho = autocorrelation(residual, part, 8) * taper[:, None]
    lag = np.abs(np.subtract.outer(np.arange(90), np.arange(90)))
    near = (lag <= 8) & (part[:, None] == part)
    expected = sum(
        weight[j] ** 2 * np.mean(residual[:, j] ** 2)
        * x[:, j].T @ np.where(near, rho[np.minimum(lag, 8), j], 0.0) @ x[:, j]
        for j in range(2)
    )  # fmt: skip
    np.testing.assert_allclose(meat, expected, rtol=1e-9)


def test_a_bias_of_half_a_deviation_costs_three_per_cent():
    bias = PRIOR_SHARE
    held = stats.norm.cdf(1.96 - bias) - stats.norm.cdf(-1.96 - bias)
    assert held == pytest.approx(0.92, abs=0.005)


def test_the_block_jackknife_and_clusters_give_the_covariance_that_was_drawn():
    """Noise that is constant within a block: its covariance is known exactly."""
    random = np.random.default_rng(13)
    label = sequential(600, 60)
    x = np.stack([np.ones(600), np.sin(np.arange(600) / 47.0), random.normal(size=600)], axis=1)
    known = np.linalg.inv(x.T @ x)
    sums = np.array([x[label == k].sum(axis=0) for k in range(60)])
    expected = known @ (sums.T @ sums + 0.25 * x.T @ x) @ known
    jackknife, clustered = [], []
    for _ in range(150):
        y = random.normal(size=60)[label] + 0.5 * random.normal(size=600)
        rows = [label == k for k in range(60)]
        grams, sides = [x[r].T @ x[r] for r in rows], [x[r].T @ y[r] for r in rows]
        theta, covariance = block_jackknife(grams, sides, np.zeros((3, 3)), 0.0)
        np.testing.assert_allclose(theta, np.linalg.lstsq(x, y)[0], atol=1e-9)
        jackknife.append(covariance)
        solution = fit(NormalEquations.of(x[:, None], y[:, None]), np.ones(1), np.full(3, 1e6))
        scores = np.array([x[r].T @ (y - x @ theta)[r] for r in rows])
        clustered.append(sandwich(solution, clustered_scores(scores)).covariance)
    for found in (jackknife, clustered):
        mean = np.mean(found, axis=0)
        np.testing.assert_allclose(np.diag(mean), np.diag(expected), rtol=0.12)


def fit_without(
    amplitude: float, random: np.random.Generator
) -> tuple[list[bool], list[bool], float, float, NDArray[np.float64]]:
    """Return whether intervals hold without and with what was omitted, and their mean widths.

    Then (2, 2) squared errors and their second moment with it. Two of forty columns are fitted; the
    others have random amplitudes, and all are correlated.
    """
    time = np.arange(1000) / 50.0
    waves = [f(k * 0.37 * time) for k in range(1, 21) for f in (np.sin, np.cos)]
    mixed = np.stack(waves, axis=1) @ (np.eye(40) + 0.2 * random.normal(size=(40, 40)))
    x, inside, outside = mixed[:, None], np.arange(2), np.arange(2, 40)
    truth = np.concatenate([[1.0, -2.0], amplitude * random.normal(size=38)])
    y = x @ truth + random.normal(size=(1000, 1))
    whole = NormalEquations.of(x, y)
    gram, side = whole.combined(np.ones(1))
    solution = fit(whole.select(inside), np.ones(1), np.full(2, 1e3))
    score = side - gram[:, inside] @ solution.theta
    level = float(np.mean((y - x[..., inside] @ solution.theta) ** 2))
    bare = sandwich(solution, level * gram[:2, :2])
    added = omitted_columns(solution, gram, score, level * gram, inside, outside, np.full(40, 1e3))
    full = replace(bare, omitted=added[:2, :2])
    held, widths = ([], []), ([], [])
    for k, unit in enumerate(np.eye(2)):
        for number, spread in enumerate((bare, full)):
            low, high = spread.interval(solution.theta[k], unit)
            held[number].append(low <= truth[k] <= high)
            widths[number].append(high - low)
    squares = np.array([(solution.theta - truth[:2]) ** 2, np.diag(full.total)])
    return *held, float(np.mean(widths[0])), float(np.mean(widths[1])), squares


@pytest.mark.parametrize("amplitude", [0.2, 1.0])
def test_intervals_hold_their_share_where_a_model_lacks_columns(amplitude):
    """What the scores show of the omitted ones is no random error: its square is its moment.

    So more than 95 % may be held, and intervals be no wider than errors are.
    """
    random = np.random.default_rng(21)
    bare, full, squares = [], [], []
    for _ in range(200):
        without, with_them, _, _, both = fit_without(amplitude, random)
        bare += without
        full += with_them
        squares.append(both)
    assert np.mean(bare) < 0.75
    assert np.mean(full) >= band(0.95, len(full))[0]
    error, moment = np.mean(squares, axis=(0, 2))
    assert moment == pytest.approx(error, rel=0.1)


def test_intervals_of_a_model_that_lacks_nothing_hardly_widen():
    random = np.random.default_rng(22)
    held, widths = [], []
    for _ in range(200):
        _, with_them, before, after, _ = fit_without(0.0, random)
        held += with_them
        widths.append(after / before)
    assert np.median(widths) < 1.05
    assert band(0.95, len(held))[0] <= np.mean(held)


@pytest.mark.parametrize("amplitude", [0.5, -2.0])
@pytest.mark.parametrize("others", [3, 12])
def test_one_column_that_is_missing_counts_though_all_others_leave_nothing(amplitude, others):
    """Noise of blocks has the missing column in it, too: its own score is the least certain one."""
    random = np.random.default_rng(25)
    x = random.normal(size=(400, 3 + others))
    y = x[:, :2].sum(axis=1) + amplitude * x[:, 2] + 0.1 * random.normal(size=400)
    equations = x[:, :2].T @ x[:, :2]
    residual = y - x[:, :2] @ np.linalg.solve(equations, x[:, :2].T @ y)
    blocks = np.einsum("bni,bn->bi", x.reshape(20, 20, -1), residual.reshape(20, 20))
    solution = SimpleNamespace(precision=equations, data=equations, free=np.ones(2, dtype=bool))

    moment = omitted_columns(
        solution, x.T @ x, x.T @ residual, blocks.T @ blocks, np.arange(2),
        np.arange(2, 3 + others), np.full(3 + others, 10.0),
    )  # fmt: skip

    shown = np.sqrt(np.diag(moment))
    assert shown[2] == pytest.approx(abs(amplitude), rel=0.1)
    assert (shown[3:] < 0.15 * abs(amplitude)).all()


def test_what_a_model_lacks_moves_no_coefficient_held_by_its_sign_and_none_apart_from_it():
    """The first column is held at zero; the second overlaps with what is outside, the third not."""
    time = np.arange(400) / 20.0
    x = np.stack([np.ones(400), np.sin(time), np.repeat([1.0, 0.0], 200)], axis=1)
    x[:, 1] *= x[:, 2]
    outside = np.cos(3.0 * time) * (1.0 - x[:, 2])
    both = np.concatenate([x, outside[:, None]], axis=1)[:, None]
    y = both @ [-5.0, 1.0, 0.0, 2.0]
    whole, inside = NormalEquations.of(both, y), np.arange(3)
    gram, side = whole.combined(np.ones(1))
    positive = np.array([True, False, False])
    solution = fit(whole.select(inside), np.ones(1), np.full(3, 1e3), positive)
    score = side - gram[:, inside] @ solution.theta
    added = omitted_columns(
        solution, gram, score, 0.01 * gram, inside, np.array([3]), np.full(4, 1e3)
    )
    np.testing.assert_allclose(added[:3], 0.0, atol=1e-12)
    assert added[3, 3] > 0.0


def test_a_torque_that_the_fit_reproduces_is_missing_nowhere():
    """Of a cable that looks like weight the weight has the bias, their sum hardly any."""
    random, held, moments = np.random.default_rng(24), [], []
    time, both = np.arange(1000) / 50.0, np.array([1.0] * 2 + [0.0] * 8)
    for _ in range(100):
        waves = [np.sin(k * 0.37 * time + 0.3 * k) for k in range(1, 11)]
        x = np.stack(waves, axis=1)[:, None]
        x[:, 0, 1] = x[:, 0, 0] + 0.2 * x[:, 0, 1]
        truth = np.concatenate([[1.0], random.normal(size=9)])
        whole = NormalEquations.of(x, x @ truth + random.normal(size=(1000, 1)))
        inside, outside = np.arange(1), np.arange(1, 10)
        gram, side = whole.combined(np.ones(1))
        solution = fit(whole.select(inside), np.ones(1), np.full(1, 1e3))
        score = side - gram[:, inside] @ solution.theta
        added = omitted_columns(solution, gram, score, gram, inside, outside, np.full(10, 1e3))
        off = both @ (np.append(solution.theta, np.zeros(9)) - truth)
        total = added.copy()
        total[0, 0] += sandwich(solution, gram[:1, :1]).total[0, 0]
        moments.append((both @ total @ both, total[0, 0]))
        held.append(off**2 < 1.96**2 * both @ total @ both)
    of_both, of_weight = np.mean(moments, axis=0)
    assert of_both < 0.1 * of_weight
    assert np.mean(held) >= 0.9


def test_what_the_scores_show_of_an_omitted_column_is_in_the_interval_of_what_it_shifts():
    """Of two recordings that lack one column of ten, it is large in one: there intervals widen."""
    random, time = np.random.default_rng(25), np.arange(1000) / 50.0
    x = np.stack([np.sin(k * 0.37 * time + 0.3 * k) for k in range(1, 12)], axis=1)[:, None]
    x[:, 0, 1] += x[:, 0, 0]
    inside, outside, widths = np.arange(1), np.arange(1, 11), []
    noise = random.normal(size=(1000, 1))
    for size in (0.0, 1.0):
        truth = np.zeros(11)
        truth[[0, 1]] = 1.0, size
        whole = NormalEquations.of(x, x @ truth + noise)
        gram, side = whole.combined(np.ones(1))
        solution = fit(whole.select(inside), np.ones(1), np.full(1, 1e3))
        score = side - gram[:, inside] @ solution.theta
        added = omitted_columns(solution, gram, score, gram, inside, outside, np.full(11, 1e3))
        widths.append(float(np.sqrt(added[0, 0])))
        assert abs(solution.theta[0] - 1.0) < 1.96 * np.sqrt(added[0, 0] + 1.0 / gram[0, 0])
    assert widths[1] > 0.9 * abs(solution.theta[0] - 1.0) > 10.0 * widths[0]


def test_a_column_that_the_fit_reproduces_says_nothing_of_the_others():
    """Alone outside, it leaves no score of its own: there is no error to estimate from it."""
    x = np.random.default_rng(23).normal(size=(300, 1, 2))
    both = np.concatenate([x, x.sum(axis=2, keepdims=True)], axis=2)
    y = both @ [1.0, 2.0, 3.0]
    whole, inside = NormalEquations.of(both, y), np.arange(2)
    gram, side = whole.combined(np.ones(1))
    solution = fit(whole.select(inside), np.ones(1), np.full(2, 1e3))
    score = side - gram[:, inside] @ solution.theta
    added = omitted_columns(solution, gram, score, gram, inside, np.array([2]), np.ones(3))
    np.testing.assert_array_equal(added, 0.0)


def test_a_parameter_that_its_prior_decides_is_not_called_identifiable():
    random = np.random.default_rng(14)
    x = random.normal(size=(300, 1, 2)) * [1.0, 1e-3]
    y = x @ [2.0, 3.0] + random.normal(size=(300, 1))
    solution = fit(NormalEquations.of(x, y), np.ones(1), np.ones(2))
    residual = y - x @ solution.theta
    meat = autocorrelated_scores(
        x, residual, residual, np.zeros(300, dtype=np.int64), 50.0, np.ones(1),
        np.ones(y.shape, dtype=bool),
    )  # fmt: skip
    spread = sandwich(solution, meat)
    assert spread.identifiable(np.array([1.0, 0.0]))
    assert not spread.identifiable(np.array([0.0, 1.0]))
    assert abs(solution.theta[1]) < 0.5  # near its prior, not at the 3 that nobody can see
