"""Normal equations, splits and selection against independent answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from dvrk_gravity.estimation import (
    BlockSettings,
    CommonTime,
    Folds,
    FoldSums,
    HeldOutSums,
    NormalEquations,
    Regression,
    SignedFits,
    SingularError,
    Trial,
    combined_folds,
    eliminate_backward,
    fit,
    fit_folds,
    inner_slabs,
    make_blocks,
    make_folds,
    normal_equations,
    relative_gain,
    select,
    sequential,
    slabs,
    solve,
    solve_signed,
)


def test_a_fit_is_that_of_all_samples_at_once_with_its_prior_as_further_rows():
    random = np.random.default_rng(0)
    x, y = random.normal(size=(50, 3, 4)), random.normal(size=(50, 3))
    sample, weight = random.uniform(0.2, 1.0, (50, 3)), np.array([1.0, 4.0, 0.5])
    scale, mean = np.array([0.3, 1.0, 5.0, 0.1]), random.normal(size=4)
    root = np.sqrt(sample * weight)
    rows = np.vstack([(x * root[:, :, None]).reshape(-1, 4), np.diag(1.0 / scale)])
    whole = NormalEquations.of(x, y, sample)
    solution = fit(whole, weight, scale)
    (about_mean,) = fit_folds(*combined_folds([whole], weight), np.arange(4), scale, mean)
    for theta, prior in ((solution.theta, np.zeros(4)), (about_mean, mean)):
        right = np.concatenate([(y * root).ravel(), prior / scale])
        np.testing.assert_allclose(theta, np.linalg.lstsq(rows, right)[0], atol=1e-10)
    np.testing.assert_allclose(solution.precision, rows.T @ rows, atol=1e-9)


@pytest.mark.parametrize("first", [0, 2, 5])
def test_further_columns_give_the_fit_of_all_columns_at_once(first):
    random = np.random.default_rng(2)
    design, y = random.normal(size=(150, 5)), random.normal(size=150)
    prior = np.diag([1.0, 2.0, 0.5, 3.0, 1.0])
    part = Regression(design[:, :first], prior[:first, :first], 0.0)
    whole = part.extended(design[:, first:], prior[first:, first:])
    rows = np.vstack([design, np.sqrt(prior)])
    expected = np.linalg.lstsq(rows, np.append(y, np.zeros(5)))[0]
    np.testing.assert_allclose(whole.coefficients(y), expected, atol=1e-10)
    np.testing.assert_allclose(whole.residual(y), y - design @ expected, atol=1e-10)
    np.testing.assert_allclose(whole.inverse, np.linalg.inv(rows.T @ rows), atol=1e-10)


def test_what_is_left_out_is_subtracted():
    random = np.random.default_rng(1)
    x, y = random.normal(size=(50, 2, 5)), random.normal(size=(50, 2))
    whole, part = NormalEquations.of(x, y), NormalEquations.of(x[:20], y[:20])
    chosen = [0, 2, 4]
    theta = fit((whole - part).select(chosen), np.ones(2), np.full(3, 1e4)).theta
    expected = np.linalg.lstsq(x[20:][:, :, chosen].reshape(-1, 3), y[20:].ravel())[0]
    np.testing.assert_allclose(theta, expected, atol=1e-6)
    error = ((y[20:] - x[20:, :, chosen] @ theta) ** 2).sum(axis=0)
    np.testing.assert_allclose((whole - part).select(chosen).error(theta), error, atol=1e-9)


def test_every_sample_is_predicted_by_a_fit_that_saw_neither_it_nor_its_neighbours():
    random = np.random.default_rng(9)
    x, y = random.normal(size=(60, 2, 5)), random.normal(size=(60, 2))
    weight, chosen = random.uniform(0.2, 1.0, (60, 2)), [0, 2, 3]
    tested = sequential(60, 4) == np.arange(4)[:, None]
    excluded = np.array([np.convolve(mask, np.ones(5), "same") > 0.0 for mask in tested])
    sums = FoldSums(x, y, Folds(tested, excluded), weight, np.ones_like(y))

    predicted = sums.predicted(lambda seen: fit(seen, np.ones(2), np.full(3, 1e4)).theta, chosen)

    root, part = np.sqrt(weight), x[:, :, chosen]
    for rows, unseen, test in zip(tested, ~excluded, sums.test, strict=True):
        columns = (part * root[:, :, None])[unseen].reshape(-1, 3)
        theta = np.linalg.lstsq(columns, (y * root)[unseen].ravel())[0]
        np.testing.assert_allclose(predicted[rows], part[rows] @ theta, atol=1e-8)
        error = ((y - part @ theta)[rows] ** 2).sum(axis=0)
        np.testing.assert_allclose(test.select(chosen).error(theta), error, atol=1e-10)


def test_a_gain_counts_every_channel_by_its_own_error():
    before = np.array([[1.0, 100.0, 0.0], [3.0, 100.0, 0.0]])
    after = before * [0.5, 1.0, 1.0]
    gain, deviation = relative_gain(before, after)
    assert gain == pytest.approx(0.25)  # half of one of two channels; the third was not measured
    assert deviation == pytest.approx(np.std([0.0625, 0.1875], ddof=1) * np.sqrt(2.0))


def test_columns_of_any_size_that_say_nothing_or_the_same_get_finite_coefficients():
    random = np.random.default_rng(2)
    x = random.normal(size=(40, 4)) * [1e-4, 1.0, 1e4, 0.0]
    x = np.column_stack([x, x[:, 1]])
    theta = solve(x.T @ x, x.T @ (x @ [2e4, 1.0, -3e-4, 0.0, 1.0]), 1e-9)
    np.testing.assert_allclose(theta, [2e4, 1.0, -3e-4, 0.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize("positive", [False, True])
def test_columns_that_repeat_each_other_are_shared_by_a_prior_however_wide(positive):
    random = np.random.default_rng(4)
    x = 1e4 * random.normal(size=(40, 1, 3))
    x = np.concatenate([x, x[:, :, :2] + x[:, :, 1:]], axis=2)
    y = x @ [1.0, 2.0, 3.0, 0.0, 0.0]
    sums, weight, width = NormalEquations.of(x, y), np.ones(1), np.full(5, 1e9)
    signs, seen = np.full(5, positive), combined_folds([sums], weight)
    for theta in (
        fit(sums, weight, width, signs).theta,
        fit_folds(*seen, np.arange(5), width, np.zeros(5))[0],
        SignedFits(*seen, width, signs).fit(range(5))[0],
    ):
        np.testing.assert_allclose(x @ theta, y, atol=1e-6 * np.abs(y).max())
        assert np.abs(theta).max() < 5.0


def test_a_prior_that_counts_is_left_as_it_is():
    gram = np.diag([4.0, 1e6, 0.0])
    kept = normal_equations.prior_precision(gram, np.array([1.0, 10.0, 1e3]))
    np.testing.assert_allclose(kept, np.diag([1.0, 0.01, 1e-6]), rtol=1e-12)


def test_signed_least_squares_are_scipys():
    random = np.random.default_rng(3)
    for _ in range(20):
        x, y = random.normal(size=(40, 12)), random.normal(size=40)
        positive = random.random(12) < 0.7
        theta, free = solve_signed(x.T @ x, x.T @ y, positive)
        lower = np.where(positive, 0.0, -np.inf)
        expected = lsq_linear(x, y, (lower, np.full(12, np.inf)), method="bvls").x
        np.testing.assert_allclose(theta, expected, atol=1e-7)
        assert (theta[~free] == 0.0).all()


def test_a_signed_problem_of_any_difficulty_meets_its_conditions_of_optimality():
    """Nearly collinear columns made the former loop go in circles and stop at its 20th round."""
    for seed in range(10):
        random = np.random.default_rng(seed)
        common = random.normal(size=(200, 3))
        x = common @ random.normal(size=(3, 60)) + 1e-3 * random.normal(size=(200, 60))
        precision = x.T @ x + 1e-6 * np.eye(60)
        right = x.T @ random.normal(size=200)
        positive = random.random(60) < 0.8
        theta, free = solve_signed(precision, right, positive)
        gradient = right - precision @ theta
        assert (theta[positive] >= 0.0).all()
        assert np.abs(gradient[free]).max() < 1e-6 * np.abs(right).max()
        assert (gradient[~free] < 1e-6 * np.abs(right).max()).all()


def some_folds(random, columns=10, samples=40):
    """Return columns of unequal size and values of three folds, and their sums."""
    x = random.normal(size=(3, samples, 2, columns)) * 10.0 ** random.uniform(-2, 2, columns)
    x[..., 1] += 0.99 * x[..., 0]
    y = random.normal(size=(3, samples, 2)) + 0.3 * x.mean(axis=-1)
    return x, y, [NormalEquations.of(*fold) for fold in zip(x, y, strict=True)]


def test_fits_near_another_are_scipys_signs_and_prior_included():
    """A column that comes in, that goes, both, several, and none at all; held at zero or not."""
    for seed in range(4):
        random = np.random.default_rng(seed)
        x, y, sums = some_folds(random)
        scale, weight = random.uniform(0.1, 10.0, 10), np.array([1.0, 3.0])
        positive = random.random(10) < 0.6
        fits = SignedFits(*combined_folds(sums, weight), scale, positive)
        subset = [0, 1, 2, 3, 4, 5]
        others = [
            [*subset, 7],
            subset[1:],
            [0, 1, 2, 3, 8, 9],
            [*subset, 6, 7, 8, 9],
            subset,
            [5, 9],
        ]
        near = fits.fit_near(subset, others)
        root = np.sqrt(weight)
        for found, chosen in zip(near, others, strict=True):
            unchosen = np.setdiff1d(np.arange(10), chosen)
            assert (found[:, unchosen] == 0.0).all()
            for fold in range(3):
                data = (x[fold][:, :, chosen] * root[:, None]).reshape(-1, len(chosen))
                rows = np.vstack([data, np.diag(1.0 / scale[chosen])])
                right = np.concatenate([(y[fold] * root).ravel(), np.zeros(len(chosen))])
                size = np.linalg.norm(rows, axis=0)  # in units in which SciPy's tolerance is fair
                lower = np.where(positive[chosen], 0.0, -np.inf)
                bounds = (lower, np.full(len(chosen), np.inf))
                expected = lsq_linear(rows / size, right, bounds, method="bvls").x / size
                np.testing.assert_allclose(
                    found[fold, chosen] * size, expected * size, atol=1e-8 * np.linalg.norm(right)
                )


def test_held_out_errors_of_many_fits_are_sums_over_the_samples():
    random = np.random.default_rng(5)
    x, y, sums = some_folds(random)
    theta = random.normal(size=(4, 3, 10))
    expected = ((y - np.einsum("fnmp,cfp->cfnm", x, theta)) ** 2).sum(axis=2)
    np.testing.assert_allclose(HeldOutSums(sums).error(theta), expected)
    np.testing.assert_allclose(HeldOutSums(sums).error(theta[0]), expected[0])


@pytest.mark.parametrize("positive", [[True, True], [True, False], [False, False]])
def test_a_singular_problem_is_refused(positive):
    with pytest.raises(SingularError, match="2 coefficients"):
        solve_signed(np.diag([1.0, -1.0]), np.ones(2), np.array(positive))


def test_a_period_is_found_and_noise_has_none():
    time = np.arange(1500) / 50.0
    phase = 2.0 * np.pi * time[:, None] / 11.66
    joint = np.arange(1, 8)
    q = np.sin(phase * (1 + joint % 3) + joint) + 0.3 * np.cos(phase * 5)
    part = np.zeros(1500, dtype=np.int64)
    assert make_folds(time, part, q, 50.0).periods == pytest.approx((11.66,), abs=0.03)
    drifting = np.cumsum(np.random.default_rng(6).normal(size=(1500, 7)), axis=0)
    assert make_folds(time, part, drifting, 50.0).periods == ()


def test_equal_phases_are_held_out_together_and_a_gap_is_kept():
    time = np.arange(1500) / 50.0
    q = np.sin(2.0 * np.pi * time[:, None] / 10.0 * np.arange(1, 8))
    folds = make_folds(time, np.zeros(1500, dtype=np.int64), q, 50.0)
    assert folds.periods == (10.0,)
    assert (folds.tested.sum(axis=0) == 1).all()
    np.testing.assert_array_equal(folds.tested[:, :500], folds.tested[:, 500:1000])
    for fold in range(12):
        held, fitted = np.flatnonzero(folds.tested[fold]), np.flatnonzero(~folds.excluded[fold])
        assert np.abs(held[:, None] - fitted).min() / 50.0 >= 0.3 - 0.021


@pytest.mark.parametrize("period", [None, 6.0])
def test_a_third_of_the_blocks_is_held_out_and_the_others_are_dealt_into_folds(period):
    time = np.arange(800) / 40.0
    blocks = make_blocks(CommonTime.single_clock(time, period), 40.0)
    assert 0.3 < blocks.held_out.sum() / (blocks.label >= 0).sum() < 0.37
    for fold in range(BlockSettings().folds):
        labels = set(blocks.label[blocks.fold == fold])
        assert labels
        assert not labels & set(blocks.label[blocks.held_out])
        assert not labels & set(blocks.label[(blocks.fold >= 0) & (blocks.fold != fold)])
    if period is not None:
        phase = np.round(time % 6.0, 6)
        assert not set(phase[blocks.held_out]) & set(phase[blocks.fold >= 0])


@pytest.mark.parametrize("count", [40, 80, 1000])
def test_no_pose_is_left_out_between_blocks(count):
    blocks = make_blocks(CommonTime.single_clock(np.arange(float(count))), None)
    assert (blocks.held_out | (blocks.fold >= 0)).all()


def test_levels_of_a_grid_are_slabs_and_scattered_positions_are_cut_into_five():
    random = np.random.default_rng(7)
    grid = np.repeat(np.linspace(-1.0, 1.0, 5), 20) + 0.001 * random.normal(size=100)
    np.testing.assert_array_equal(slabs(grid), np.repeat(np.arange(5), 20))
    scattered = random.uniform(size=100)
    assert (np.bincount(slabs(scattered)) == 20).all()
    masks = inner_slabs(np.stack([grid, scattered], axis=1), (0, 1))
    assert len(masks) == 6
    assert np.sum(masks) == 120


class Subset:
    """Ordinary least squares of some columns, scored on held-out blocks."""

    def __init__(self, x: np.ndarray, y: np.ndarray, errors_of: float) -> None:
        self.size, self.standard_errors = x.shape[1], errors_of
        label = sequential(len(y), 10)
        parts = [NormalEquations.of(x[label == k, None], y[label == k, None]) for k in range(10)]
        whole = NormalEquations.of(x[:, None], y[:, None])
        self.folds = [(whole - part, part) for part in parts]

    def errors(self, chosen):
        index = sorted(chosen)
        return np.array(
            [
                test.select(index).error(
                    fit(train.select(index), np.ones(1), np.full(len(index), 1e3)).theta
                )[0]
                for train, test in self.folds
            ]
        )

    def moves(self, state):
        return [k for k in range(self.size) if k not in state]

    def attempt(self, state, moves):
        before = self.errors(state)
        trials = []
        for move in moves:
            gain = (before - self.errors(state | {move})) / before.sum()
            error = gain.std(ddof=1) * np.sqrt(len(gain))
            trials.append(Trial(move, gain.sum(), gain.sum() > self.standard_errors * error))
        return trials

    def choose(self, trials):
        return max((t for t in trials if t.passes), key=lambda t: t.worth, default=None)

    def take(self, state, trial):
        return state | {trial.move}


def test_selection_finds_what_is_there_lazily_or_not():
    random = np.random.default_rng(8)
    x = random.normal(size=(600, 20))
    y = x[:, [3, 7, 11]] @ [1.0, -0.8, 0.6] + random.normal(size=600)
    for lazy in (None, 0.9):
        found, vain = select(Subset(x, y, 3.0), frozenset(), 20, lazy)
        assert found == {3, 7, 11}
        assert {trial.move for trial in vain} == set(range(20)) - found


class Fickle(Subset):
    """A search in which every move passes among others, and none when it is tried again alone."""

    def attempt(self, state, moves):
        return [Trial(move, 1.0, len(moves) > 1) for move in moves]


def test_a_selection_ends_though_nothing_that_passed_does_so_again():
    """Moves that are told by less than what they do are tried in one another's place."""
    search = Fickle(np.ones((60, 6)), np.ones(60), 3.0)
    found, vain = select(search, frozenset(), 20, 0.9)
    assert found == frozenset()
    assert len(vain) == 6
    assert not any(trial.passes for trial in vain)


def test_the_weakest_goes_first_for_the_others_may_take_its_place():
    kept = ["a", "b", "c"]

    def failing(rest):
        # Of two that stand for one another each fails beside the other, alone neither does.
        return [(1.0, "a"), (2.0, "b")] if {"a", "b"} <= set(rest) else []

    gone = []
    assert eliminate_backward(kept, failing, gone.append) == ["b", "c"]
    assert gone == ["a"]
