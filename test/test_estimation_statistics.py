"""Evidence, noise, robust weights and covariance against SciPy, brute force and fixed draws."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from drawn_noise import coloured
from scipy import integrate, optimize, stats

from dvrk_gravity.estimation import (
    PRIOR_SHARE,
    NormalEquations,
    Repetition,
    RobustSettings,
    RobustState,
    Uncertainty,
    autocorrelated_scores,
    autocorrelation,
    band_noise,
    block_jackknife,
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
    solve_scales,
    squared_distance,
)

# --- evidence ----------------------------------------------------------------------------


def test_paired_p_values_are_scipys_without_the_blocks_that_say_nothing():
    gains = np.append(np.random.default_rng(0).normal(0.3, size=15), np.zeros(4))
    expected = [
        stats.ttest_1samp(gains[:15], 0.0, alternative="greater").pvalue,
        stats.wilcoxon(gains[:15], alternative="greater").pvalue,
    ]
    assert evidence.paired(gains) == pytest.approx(expected, rel=1e-9)
    assert len(evidence.paired(gains[:10])) == 2
    assert evidence.paired(gains[:9]) == evidence.paired(np.ones(20)) == []


def test_a_gain_in_likelihood_has_the_p_value_of_chi_square_or_of_fisher():
    for parameters, gain in ((1, 2.0), (3, 5.0)):
        chi = stats.chi2.sf(2.0 * gain, parameters)
        assert evidence.likelihood_ratio(gain, parameters) == pytest.approx(chi)
        fisher = stats.f.sf(2.0 * gain / parameters, parameters, 20)
        assert evidence.variance_ratio(gain, parameters, 20) == pytest.approx(fisher, rel=2e-3)
    assert evidence.likelihood_ratio(-1.0, 1) == 1.0
    assert evidence.variance_ratio(-1.0, 1, 20) == pytest.approx(1.0)


def test_the_best_of_many_gains_is_bounded_for_each_true_variance():
    freedom, trials, gain = 20, 300, 9.0

    def weighted(ratio: float) -> float:
        alone = stats.chi2.sf(2.0 * gain * ratio, 1)
        return min(trials * alone, 1.0) * freedom * stats.chi2.pdf(freedom * ratio, freedom)

    expected = integrate.quad(weighted, 0.0, 5.0, limit=200)[0]
    found = evidence.variance_ratio(gain, 1, freedom, trials)
    assert found == pytest.approx(expected, rel=0.01)
    assert found < trials * evidence.variance_ratio(gain, 1, freedom)


def test_of_three_tests_of_a_gain_the_best_counts_three_times():
    gains = np.random.default_rng(1).normal(0.5, size=12)
    three = [evidence.likelihood_ratio(1.0, 2), *evidence.paired(gains)]
    assert evidence.of_gain(gains, 1.0, 2) == pytest.approx(3.0 * min(three))
    assert evidence.of_gain(gains[:5], 8.0, 2) == pytest.approx(3.0 * stats.chi2.sf(16.0, 2))


def test_corrections_for_multiplicity_are_as_in_the_textbook():
    assert evidence.bonferroni(0.01, 7) == pytest.approx(0.07)
    assert evidence.bonferroni(0.3, 7) == 1.0
    np.testing.assert_allclose(
        evidence.holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02], atol=1e-12
    )
    np.testing.assert_allclose(evidence.holm([0.6, 0.7]), [1.0, 1.0])


def test_a_bootstrap_interval_of_a_mean_is_about_normal_and_of_one_block_a_point():
    values = np.random.default_rng(4).normal(size=60)
    low, high = evidence.bootstrap_interval(lambda x, axis: x.mean(axis=axis), (values,))
    half = 1.96 * values.std() / np.sqrt(60)
    assert (low, high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.03)
    one = evidence.bootstrap_interval(lambda x, axis: x.mean(axis=axis), (values[:1],))
    assert one == (values[0], values[0])


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


def test_large_deviations_of_what_was_estimated_surprise_as_student_says():
    """Of ratios to an estimated standard deviation, against SciPy's density."""
    for freedom in (5.0, 20.0):
        for deviation in (0.5, 3.0, 9.0):
            density = stats.t(freedom).logpdf([0.0, deviation])
            told = evidence.of_student(0.5 * deviation**2, freedom)
            assert told == pytest.approx(density[0] - density[1])
            assert evidence.of_student(-0.5 * deviation**2, freedom) == -told


# --- noise -------------------------------------------------------------------------------


def test_correlation_time_of_an_autoregression():
    """Of AR(1) with coefficient a it is (1 + a) / (1 - a): the mean's variance grows by that."""
    for a in (0.0, 0.5, 0.9):
        noise = coloured(np.random.default_rng(5), (4000, 60), a)
        part = np.zeros(len(noise), dtype=np.int64)
        expected = (1.0 + a) / (1.0 - a)
        assert correlation_time(noise, part, 100).mean() == pytest.approx(expected, rel=0.12)
        counted = len(noise) * noise.mean(axis=0).var()
        assert counted == pytest.approx(expected, rel=0.45)


def test_copies_of_a_state_count_by_how_alike_they_are():
    first, second = np.array([[1.0, 2.0], [-1.0, 1.0], [9.0, 9.0]]), np.array([[1.0, 0.0]] * 3)
    usable = np.array([[True, True], [True, True], [False, False]])
    expected = [0.0, 0.0]  # (1 - 1) / 2, no product
    np.testing.assert_allclose(intraclass_correlation(first, second, usable), expected)
    second = np.array([[1.0, 1.0], [-0.5, 2.0], [0.0, 0.0]])
    expected = [1.5 / 1.625, 4.0 / 5.0]
    np.testing.assert_allclose(intraclass_correlation(first, second, usable), expected)
    np.testing.assert_allclose(design_effect(4.0, np.array([0.0, 0.3, 1.0])), [1.0, 1.9, 4.0])


def test_noise_by_repetition_and_by_high_frequencies_are_the_same_noise():
    random = np.random.default_rng(7)
    time = np.arange(6000) / 200.0
    repeating = np.sin(2.0 * np.pi * time / 7.0)[:, None] * np.array([1.0, 0.1])
    noise = np.array([0.02, 0.3]) * coloured(random, (6000, 2), 0.6)
    usable = np.ones(noise.shape, dtype=bool)
    repetition = Repetition(7.0, 4.3)
    found = repetition_noise(repetition, time, repeating + noise, usable)
    np.testing.assert_allclose(found, [0.02, 0.3], rtol=0.06)
    np.testing.assert_allclose(repetition.phase(np.array([1.75, 8.75])), 0.25)
    first, second = pairs_a_period_apart(time, repetition, 0.001)
    np.testing.assert_allclose(time[second] - time[first], 7.0, atol=1e-9)


def test_robust_scale_is_the_standard_deviation_of_normal_noise_and_no_outliers():
    noise = np.random.default_rng(9).normal(size=(20_000, 2)) * [1.0, 3.0]
    noise[:1000] = 100.0
    np.testing.assert_allclose(robust_scale(noise), [1.07, 3.2], rtol=0.02)
    used = np.arange(20_000) >= 1000
    found = robust_scale(noise, np.stack([used, ~used & False], axis=1))
    np.testing.assert_allclose(found, [1.0, 0.0], rtol=0.02)


@pytest.mark.parametrize(("huber", "efficiency"), [(1.345, 0.95), (2.5, 0.998)])
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


def test_autocorrelated_scores_are_those_of_the_whole_matrix():
    random = np.random.default_rng(12)
    x, residual = random.normal(size=(90, 2, 3)), coloured(random, (90, 2), 0.5)
    part = np.repeat([0, 1], [50, 40])
    weight, measured = np.array([1.0, 2.0]), np.ones((90, 2), dtype=bool)
    meat = autocorrelated_scores(x, residual, residual, part, 20.0, weight, measured, 0.4)
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


@pytest.mark.parametrize(("amplitude", "others"), [(0.5, 12), (-2.0, 3)])
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


# --- covariance --------------------------------------------------------------------------


def test_white_noise_behind_a_low_pass_is_what_scipy_s_filter_leaves():
    frequency = np.linspace(0.0, 400.0, 400_001)
    passes = np.abs(1.0 / (1.0 + 1j * np.sqrt(2.0) * frequency / 8.0 - (frequency / 8.0) ** 2)) ** 4
    expected = 0.3 * np.sqrt(integrate.trapezoid(passes, frequency))
    np.testing.assert_allclose(band_noise(np.array([0.3, 0.0]), 8.0), [expected, 0.0], rtol=1e-3)


def test_a_covariance_is_that_of_the_weighted_ridge():
    random = np.random.default_rng(15)
    x, y, meat = random.normal(size=(40, 1, 3)), random.normal(size=(40, 1)), np.diag([1.0, 2, 3])
    solution = fit(NormalEquations.of(x, y), np.full(1, 2.0), np.array([0.5, 1.0, 2.0]))
    gram = 2.0 * x[:, 0].T @ x[:, 0]
    prior = np.diag([4.0, 1.0, 0.25])
    inverse = np.linalg.inv(gram + prior)
    spread = sandwich(solution, meat)
    np.testing.assert_allclose(spread.covariance, inverse @ meat @ inverse)
    np.testing.assert_allclose(spread.bias, inverse @ prior @ inverse, atol=1e-12)


def test_intervals_correlations_and_distances_are_of_all_that_is_uncertain():
    covariance = np.array([[4.0, 1.0], [1.0, 1.0]])
    bias, omitted = np.diag([1.0, 0.0]), np.diag([0.0, 3.0])
    spread = Uncertainty(covariance, bias, omitted)
    total, both = covariance + bias + omitted, np.array([1.0, -1.0])
    half = 1.959964 * np.sqrt(both @ total @ both)
    assert spread.interval(2.0, both) == pytest.approx((2.0 - half, 2.0 + half))
    first, second = np.eye(2)
    assert spread.correlation(first, second) == pytest.approx(1.0 / np.sqrt(20.0))
    assert spread.correlation(first, 0.0 * second) == 0.0
    # Half a deviation by the ridge, no more.
    assert spread.identifiable(first)
    assert not Uncertainty(covariance, 1.01 * bias).identifiable(first)
    assert not Uncertainty(0.0 * covariance, 0.0 * bias).identifiable(first)
    theta = np.array([2.0, -1.0])
    expected = theta @ np.linalg.inv(covariance) @ theta
    assert squared_distance(theta, covariance) == pytest.approx(expected)
    assert squared_distance(theta, np.diag([4.0, 0.0])) == pytest.approx(1.0)


def test_a_jackknife_leaves_out_one_block_at_a_time():
    random = np.random.default_rng(13)
    x, y, ridge = random.normal(size=(5, 20, 2)), random.normal(size=(5, 20)), np.diag([0.1, 0.2])
    grams = [each.T @ each for each in x]
    sides = [each.T @ target for each, target in zip(x, y, strict=True)]
    theta, covariance = block_jackknife(grams, sides, ridge, 0.0)

    def solved(used):
        rows, targets = x[used].reshape(-1, 2), y[used].ravel()
        return np.linalg.solve(rows.T @ rows + ridge, rows.T @ targets)

    whole = solved(np.arange(5))
    apart = np.array([solved(np.delete(np.arange(5), k)) for k in range(5)]) - whole
    np.testing.assert_allclose(theta, whole)
    np.testing.assert_allclose(covariance, 0.8 * apart.T @ apart)


# --- scales of channels by a torque that is known ----------------------------------------

GAIN, RATE, COUNT = np.array([10.0, 4.0]), 50.0, 600


def problem(seed: int):
    """Readings of two channels that share one unknown coefficient, as noisy as they are large."""
    random = np.random.default_rng(seed)
    time = np.arange(COUNT) / RATE
    known = np.column_stack([np.sin(time), np.cos(0.7 * time)])
    shared = np.column_stack([np.cos(1.3 * time), np.sin(2.1 * time)])[:, :, None]
    own = np.sign(np.sin(3.0 * time))[:, None, None] * np.ones((1, 2, 1))
    clean = (known + 0.8 * shared[:, :, 0]) / GAIN + 0.05 * own[:, :, 0]
    reading = clean + clean.std(axis=0) * random.normal(size=clean.shape)
    return reading, known, shared, own


def solved(seed: int):
    reading, known, shared, own = problem(seed)
    return solve_scales(
        reading, known, shared, np.array([5.0]), own, np.full((2, 1), 1.0), RATE, np.full(2, 7.0)
    )


def test_noise_does_not_pull_a_scale_towards_zero_as_regressing_on_readings_does():
    found = np.mean([solved(seed).gain for seed in range(20)], axis=0)
    np.testing.assert_allclose(found, GAIN, rtol=0.03)
    reading, known, shared, _ = problem(0)
    naive = (known + 0.8 * shared[:, :, 0]).T @ reading / (reading.T @ reading)
    assert (np.diag(naive) < 0.7 * GAIN).all()


def test_the_intervals_of_scales_hold_the_truth():
    inside = []
    for seed in range(60):
        found = solved(seed)
        # Of the inverse the noise is Gaussian.
        off = (1.0 / found.gain - 1.0 / GAIN) * found.gain
        inside += (np.abs(off) < 1.96 * found.error).tolist()
    assert 0.9 < np.mean(inside) < 0.99


def test_a_channel_that_shows_nothing_of_the_known_torque_has_no_certain_scale():
    reading, known, shared, own = problem(0)
    reading[:, 1] -= (known + 0.8 * shared[:, :, 0])[:, 1] / GAIN[1]
    known[:, 1] = shared[:, 1] = 0.0
    found = solve_scales(
        reading, known, shared, np.array([5.0]), own, np.full((2, 1), 1.0), RATE, np.full(2, 7.0)
    )
    assert found.error[1] > 1.0
    assert found.error[0] < 0.1
