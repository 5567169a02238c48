"""A motion that comes back in another recording is held out of all of them together."""

from __future__ import annotations

import time as clock_of_day
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from recording_samples import shared_data

from dvrk_gravity.diagnosis import FilteredData, load
from dvrk_gravity.estimation import (
    BlockSettings,
    CommonTime,
    FoldSettings,
    find_common_time,
    find_period,
    make_blocks,
    make_folds,
)
from dvrk_gravity.identification import Problem, how_validated
from dvrk_gravity.identification.trajectories import problem
from dvrk_gravity.intake import read_motions
from dvrk_gravity.model import start_columns
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Coordinates, Recording
from dvrk_gravity.simulate import SimulatedArm, record_motion
from testing.world import COARSE, World

RATE, PERIOD = 45.0, 11.67
MOTION = "mtm_dynamic_30s_200hz.csv"


def moving(time: np.ndarray, period: float | None = PERIOD, seed: int = 0) -> np.ndarray:
    """Return positions of seven joints, with a little noise; without a period they never repeat."""
    random = np.random.default_rng(seed)
    q = 1e-3 * random.normal(size=(len(time), 7))
    for _ in range(4):
        rate = random.uniform(0.1, 0.6, 7)
        if period is not None:
            rate = np.maximum(np.round(rate * period), 1.0) / period
        q += 0.3 * np.sin(2.0 * np.pi * time[:, None] * rate + random.uniform(0.0, 6.3, 7))
    return q


def recordings(*spans: tuple[float, float], period: float | None = PERIOD):
    """Return (time on its own clock, part, positions, true time) of recordings of one motion."""
    truth = [np.arange(first, last, 1.0 / RATE) for first, last in spans]
    own = [time - time[0] for time in truth]
    part = np.repeat(np.arange(len(spans)), [len(time) for time in truth])
    q = moving(np.concatenate(truth), period)
    return np.concatenate(own), part.astype(np.int64), q, np.concatenate(truth)


def around(phase: np.ndarray) -> np.ndarray:
    """Return phases off zero, in -0.5 to 0.5."""
    return (phase + 0.5) % 1.0 - 0.5


@pytest.mark.parametrize(
    "spans",
    [
        ((0.0, 15.0), (15.0, 30.0)),
        ((4.0, 19.0), (9.3, 24.3)),
        ((20.0, 33.0), (3.0, 18.0)),
        ((0.0, 30.0), (2.0, 8.0), (7.77, 15.0)),
    ],
    ids=[
        "halves",
        "halves of another beginning",
        "the later first",
        "short ones beside a long one",
    ],
)
def test_phases_of_recordings_of_one_periodic_motion_agree(spans):
    time, part, q, truth = recordings(*spans)
    seen = find_common_time(time, part, q, RATE)
    (period,) = seen.periods
    assert period == pytest.approx(PERIOD, abs=0.03)
    off = around((seen.time - truth) / PERIOD)
    np.testing.assert_allclose(around(off - off[0]), 0.0, atol=2e-3)


def nearest_states(folds, truth: np.ndarray, period: float | None) -> float:
    """Return the least time, s, by which fitted states are from those that are tested."""
    least = np.inf
    for tested, excluded in zip(folds.tested, folds.excluded, strict=True):
        apart = np.abs(truth[tested][:, None] - truth[~excluded])
        if period is not None:
            apart = period * np.abs(around(apart / period))
        least = min(least, float(apart.min()))
    return least


@pytest.mark.parametrize("spans", [((0.0, 15.0), (15.0, 30.0)), ((4.0, 19.0), (9.3, 24.3))])
def test_no_phase_that_one_file_tests_is_fitted_to_in_another_and_the_gap_is_kept(spans):
    time, part, q, truth = recordings(*spans)
    folds = make_folds(time, part, q, RATE)
    assert (folds.tested.sum(axis=0) == 1).all()
    assert nearest_states(folds, truth, PERIOD) > FoldSettings().gap - 0.05


def test_a_motion_without_a_period_that_was_recorded_twice_is_held_out_in_common_time():
    time, part, q, truth = recordings((0.0, 20.0), (8.0, 28.0), period=None)
    seen = find_common_time(time, part, q, RATE)
    assert seen.periods == (None,)
    np.testing.assert_allclose(np.ptp(seen.time - truth), 0.0, atol=0.01)
    folds = make_folds(time, part, q, RATE)
    assert nearest_states(folds, truth, None) > FoldSettings().gap - 0.05


def test_parts_of_one_recording_with_gaps_show_its_period_together_on_their_clock():
    """None of 9 s shows a period of 11.67 s alone."""
    _, part, q, truth = recordings((0.0, 9.0), (10.0, 19.0), (20.5, 30.0), (31.0, 40.0))
    seen = find_common_time(truth, part, q, RATE, [0] * 4)
    assert seen.periods == pytest.approx((PERIOD,), abs=0.03)
    np.testing.assert_allclose(around((seen.time - truth) / PERIOD), 0.0, atol=5e-3)


def test_motions_that_coincide_with_nothing_keep_their_own_blocks():
    time, part, q, _ = recordings((0.0, 20.0), (100.0, 130.0), (400.0, 412.0), period=None)
    folds = make_folds(time, part, q, RATE)
    assert folds.periods == ()
    for number in range(3):
        rows = np.flatnonzero(part == number)
        alone = make_folds(time[rows], part[rows], q[rows], RATE)
        np.testing.assert_array_equal(folds.tested[:, rows], alone.tested)
        np.testing.assert_array_equal(folds.excluded[:, rows], alone.excluded)
        # Twelve blocks of time, as long as each other.
        length = time[rows][-1] + 1.0 / RATE
        np.testing.assert_array_equal(alone.label, (time[rows] / length * 12).astype(int))


def test_a_period_is_told_the_better_the_more_often_it_is_seen():
    time = np.arange(0.0, 600.0, 1.0 / 40.0)
    assert find_period(moving(time), 40.0) == pytest.approx(PERIOD, abs=6e-4)
    assert find_period(moving(time[:1200]), 40.0) == pytest.approx(PERIOD, abs=0.013)


def test_arms_that_rest_in_one_place_before_and_after_are_not_of_one_motion():
    time = np.arange(0.0, 30.0, 1.0 / RATE)
    window = np.clip((time - 7.0) / 2.0, 0.0, 1.0) * np.clip((23.0 - time) / 2.0, 0.0, 1.0)
    first, second = (moving(time + shift, None) * window[:, None] + 1e-4 for shift in (0.0, 200.0))
    part = np.repeat(np.arange(2), len(time))
    seen = find_common_time(np.tile(time, 2), part, np.concatenate([first, second]), RATE)
    assert seen.periods == (None, None)


def test_blocks_hold_out_the_same_states_of_all_recordings_guard_included():
    time, part, q, truth = recordings((0.0, 20.0), (8.01, 28.0), period=None)
    seen = find_common_time(time, part, q, RATE)
    blocks = make_blocks(seen, RATE)
    apart = np.abs(truth[blocks.held_out][:, None] - truth[blocks.fold >= 0])
    assert apart.min() * RATE > BlockSettings().guard
    assert 0.2 < blocks.held_out.mean() < 0.4


def test_blocks_of_motions_that_share_nothing_follow_each_other_as_samples_do():
    time, part, q, _ = recordings((0.0, 20.0), (100.0, 113.0), period=None)
    blocks = make_blocks(find_common_time(time, part, q, RATE), RATE)
    whole = make_blocks(CommonTime.single_clock(np.arange(len(time)) / RATE), RATE)
    np.testing.assert_array_equal(blocks.label, whole.label)


@pytest.mark.parametrize(
    ("duration", "rate", "count", "most"), [(30.0, 200.0, 2, 0.2), (600.0, 40.0, 3, 1.0)]
)
def test_finding_a_common_time_is_quick(duration, rate, count, most):
    time = np.arange(0.0, duration, 1.0 / rate)
    part = np.arange(len(time)) * count // len(time)
    q = moving(time, None)
    begin = clock_of_day.process_time()
    find_common_time(time, part, q, rate)
    assert clock_of_day.process_time() - begin < most


KNOWN = World.draw(5, step=COARSE)


@pytest.fixture(scope="module")
def periodic() -> Recording:
    """30 s of an arm that repeats a motion of 11.67 s."""
    drawn = Multisine.draw(KNOWN.arm, 3)
    motion = replace(drawn, frequency=np.round(drawn.frequency * PERIOD) / PERIOD)
    return record_motion(
        SimulatedArm(KNOWN.plant(), KNOWN.sensors, 4, dt=COARSE), motion, 30.0, 200.0
    )


def halves(recording: Recording) -> list[Recording]:
    """Return the halves as two recordings, each of its own time."""
    found = []
    for number, half in enumerate(recording.blocks(2)):
        assert half.time is not None
        found.append(replace(half, time=half.time - half.time[0], source=f"half {number}"))
    return found


def posed(recordings: list[Recording], coordinates: Coordinates) -> Problem:
    return problem.pose(read_motions(recordings, KNOWN.arm, coordinates).parts, KNOWN.arm)


def mean_error(asked: Problem, columns: Sequence[int]) -> float:
    """Return the held-out |e|/|tau| of a fit of some columns."""
    errors = asked.selection.score(columns).sum(axis=0)
    power = np.sum([test.power for test in asked.selection.sums.test], axis=0)
    return float(np.exp(0.5 * np.mean(np.log(errors / power))))


@pytest.mark.slow
def test_halves_of_a_simulated_motion_do_not_look_better_than_the_whole(periodic):
    whole, both = (posed(given, "joint") for given in ([periodic], halves(periodic)))
    few = start_columns(whole.design.columns)
    assert mean_error(both, few) == pytest.approx(mean_error(whole, few), rel=0.05)
    assert "repeats every 11.6" in how_validated(both.folds)
    assert "held out of all of them" in how_validated(both.folds)
    assert "held out of all of them" not in how_validated(whole.folds)


def richest_error(recordings: list[Recording]) -> float:
    """Return the error of a fit of all columns: to what it has seen it bends most."""
    asked = posed(recordings, "actuator")
    return mean_error(asked, range(len(asked.design.columns.columns)))


def test_halves_of_the_measured_motion_look_no_better_than_the_whole(monkeypatch):
    measured = Recording.load(shared_data(MOTION), coordinates="actuator")
    whole = richest_error([measured])
    assert richest_error(halves(measured)) > 0.95 * whole
    # Were what the halves have in common not known, they would.
    folds = problem.make_folds

    def apart(time, part, q, rate, clock):
        return folds(time, part, np.random.default_rng(0).normal(size=q.shape), rate, clock=clock)

    monkeypatch.setattr(problem, "make_folds", apart)
    assert richest_error(halves(measured)) < 0.8 * whole


def test_a_diagnosis_of_halves_knows_the_period_and_the_noise_of_the_whole(periodic):
    whole, both = (
        FilteredData.of(load(given, KNOWN.model()).motion) for given in
        ([periodic], halves(periodic))
    )  # fmt: skip
    assert find_period(periodic.position, 200.0) == pytest.approx(PERIOD, abs=0.02)
    assert both.repetition is not None
    assert both.repetition.period == pytest.approx(PERIOD, abs=0.02)
    unknown = np.full(7, np.nan)
    np.testing.assert_allclose(both.noise_rms(unknown), whole.noise_rms(unknown), rtol=0.2)
    # Phases of both: held out together or not at all.
    second = both.recording == 1  # whose clock began anew, and was taken to go on later
    truth = both.time + (15.0 + both.time[0] - both.time[second][0]) * second
    apart = truth[both.held_out][:, None] - truth[both.fold >= 0]
    assert PERIOD * np.abs(around(apart / PERIOD)).min() > 1.0 / 41.0
