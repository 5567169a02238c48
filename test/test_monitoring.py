"""The monitor: what it expects of an arm that is as its model says, and of one that is not."""

from __future__ import annotations

from dataclasses import replace

import diagnosed
import known_ecm as ecm
import numpy as np
import pytest
from monitored_ecm import ONSET, SECONDS, heard, later

from dvrk_gravity.effects import Payload, State
from dvrk_gravity.monitoring import (
    FASTEST,
    Band,
    ChangeTest,
    MomentumObserver,
    Monitor,
    RowMaker,
    Rows,
    Sampling,
    Sums,
    Tip,
    Window,
    gain_for,
    limits,
    local_noise,
    monitor,
    transients,
    whiten,
)
from dvrk_gravity.monitoring import window as windows

RATE = 50.0
LOAD = 1.5  # kg
FORCE = np.array([0.3, 0.3, -0.3])  # N


def rows_of(recording) -> Rows:
    samples = (recording.position, recording.velocity, recording.effort)
    return Rows.of(RATE, recording.time, *samples)


def test_rows_are_means_and_a_gap_stays_a_gap():
    maker = RowMaker(10.0)
    found = [
        maker.add(time, np.array([time]), None, np.array([2.0 * time]))
        for time in (0.01, 0.05, 0.11, 0.03, 0.51, 0.61, 0.71)
    ]
    rows = Rows.joined([row for row in found if row is not None])
    np.testing.assert_allclose(rows.time, [0.05, 0.15, 0.55])
    np.testing.assert_allclose(rows.q[:, 0], [0.03, 0.11, 0.51])
    np.testing.assert_allclose(rows.qd[:, 0], [0.8, 0.96, 1.0])  # to both sides


def test_the_residual_is_the_low_passed_torque_from_outside():
    recording = ecm.recorded(1, 12.0)
    model, n = ecm.model(), ecm.ARM.n
    pushed = np.zeros((len(recording.time), n))
    pushed[600:, ecm.PITCH] = 3.0
    alone, beside = (
        MomentumObserver(model, np.full(n, FASTEST), 1.0).advance(
            rows_of(replace(recording, effort=recording.effort - torque))
        )
        for torque in (0.0 * pushed, pushed)
    )
    external = alone.residual - beside.residual
    np.testing.assert_allclose(external[:299], 0.0, atol=1e-9)
    np.testing.assert_allclose(external[-1], pushed[-1], atol=1e-6)  # gain one at rest
    after = np.arange(1, 11) / RATE
    expected = 3.0 * (1.0 - np.exp(-FASTEST * (after - 0.5 / RATE)))
    np.testing.assert_allclose(external[300:310, ecm.PITCH], expected, atol=0.2)


def test_an_arm_as_its_model_leaves_noise_whatever_comes_at_a_time():
    rows, model = rows_of(ecm.recorded(1, 12.0)), ecm.model()
    whole = MomentumObserver(model, np.full(ecm.ARM.n, FASTEST), 1.0).advance(rows).residual
    observer = MomentumObserver(model, np.full(ecm.ARM.n, FASTEST), 1.0)
    pieces = [observer.advance(rows.at(slice(k, k + 7))).residual for k in range(0, len(rows), 7)]
    np.testing.assert_allclose(np.concatenate(pieces), whole, atol=1e-9)
    rms = np.sqrt(np.mean(whole[50:] ** 2, axis=0))
    assert (rms < 2.0 * ecm.NOISE).all()


def test_the_gain_balances_noise_of_torques_and_of_momenta():
    step, torque, momentum = 0.001, 0.1, 0.0004
    (gain,) = gain_for(step, np.array([torque]), np.array([momentum]))
    keep = 1.0 - gain * step
    # Sums over the recursion's impulse responses, of torques and of differences of momenta.
    response = gain * step * keep ** np.arange(20_000)
    of_torque = torque**2 * np.sum(response**2)
    differences = np.diff(np.concatenate([[0.0], response])) / step
    of_momentum = momentum**2 * np.sum(differences**2)
    assert of_momentum == pytest.approx(of_torque, rel=0.05)


def test_noise_is_known_around_each_sample_and_not_from_rests_and_motion_together():
    level = np.repeat([0.1, 0.4, 0.1], [300, 200, 300])[:, None]
    smooth = np.sin(np.arange(800) / 60.0)[:, None]
    noise = local_noise(smooth + level * np.random.default_rng(3).normal(size=level.shape), 51)
    away = np.abs(np.subtract.outer(np.arange(800), [300, 500])).min(axis=1) > 30
    for steady in (0.1, 0.4):
        rows = away & (level[:, 0] == steady)
        assert noise[rows].mean() == pytest.approx(steady, rel=0.15)


def test_whitening_leaves_independent_errors_of_unit_variance():
    kept, deviation, m = 0.6, 2.0, 30
    covariance = deviation**2 * kept ** np.abs(np.subtract.outer(np.arange(m), np.arange(m)))
    follows = np.ones((m, 1), dtype=bool)
    follows[[0, 12]] = False
    covariance[:12, 12:] = covariance[12:, :12] = 0.0  # a gap: another series
    errors = np.array([deviation]), np.array([kept])
    transform = whiten(np.eye(m)[:, None, :], follows, *errors)[:, 0, :]
    np.testing.assert_allclose(transform @ covariance @ transform.T, np.eye(m), atol=1e-12)


def test_the_evidence_of_a_change_is_that_of_least_squares():
    random = np.random.default_rng(5)
    m, n, d = 40, 2, 4
    uncertain, columns = random.normal(size=(m, n, d)), random.normal(size=(m, n, 3))
    residual, earlier = random.normal(size=(m, n)), random.normal(size=(25, d))
    known = random.normal(size=25)
    test = ChangeTest(uncertain, residual, Sums.of(earlier, known))
    found = list(test.evidence_by_onset(columns, [np.zeros(1), np.zeros(2)], [0, 13, 30]))

    prior = np.vstack([earlier, np.eye(d)])
    right = np.concatenate([known, np.zeros(d), residual.ravel()])
    for own, part in zip(found, (slice(0, 1), slice(1, 3)), strict=True):
        for evidence, first in zip(own, (0, 13, 30), strict=True):
            begun = columns[:, :, part].copy()
            begun[:first] = 0.0
            k = begun.shape[2]
            without = np.vstack([prior, uncertain.reshape(-1, d)])
            cause = np.vstack([np.zeros((len(prior), k)), begun.reshape(-1, k)])
            beside = np.hstack([without, cause])
            fits = [(x, np.linalg.lstsq(x, right)[0]) for x in (without, beside)]
            costs = [np.sum((right - x @ fit) ** 2) for x, fit in fits]
            assert evidence.gain == pytest.approx(costs[0] - costs[1])
            np.testing.assert_allclose(evidence.theta, fits[1][1][d:])


def friction(q, qd, qdd):
    torque = np.zeros_like(q)
    torque[:, ecm.PITCH] = 0.03 * ecm.ARM.effort_limit[ecm.PITCH] * np.sign(qd[:, ecm.PITCH])
    return torque


def hand(q, qd, qdd):
    torque = np.zeros_like(q)
    torque[: round((ONSET + 1.0) * 100.0), ecm.PITCH] = -0.1 * ecm.ARM.effort_limit[ecm.PITCH]
    return torque


def load(q, qd, qdd):
    moment, gravity = np.array([0.1 * LOAD, 0.0, 0.0]), ecm.model().gravity
    return Payload(ecm.ARM, "link3", LOAD, moment, gravity).torque(State(q, qd, qdd))


def test_nothing_is_reported_of_an_arm_as_its_model():
    assert heard() == ()


def test_friction_that_grows_while_the_arm_moves_is_named_and_dated():
    (event,) = heard(later(friction))
    assert (event.kind, event.effect, event.joints) == ("change", "coulomb_friction", ("pitch",))
    assert event.onset == pytest.approx(ONSET, abs=0.2)
    assert event.reported - ONSET < 10.0
    positive = event.values["positive"]
    assert positive.low < 0.03 * ecm.ARM.effort_limit[ecm.PITCH] < positive.high


def test_a_load_is_named_with_an_interval_over_all_bodies_and_places():
    (event,) = heard(later(load))
    assert (event.kind, event.effect) == ("change", "payload")
    assert event.onset == pytest.approx(ONSET, abs=0.2)
    assert event.values["mass"].low < LOAD < event.values["mass"].high
    assert event.reported < 31.0  # another link carries it as well, for which nobody waits


def test_the_push_of_a_hand_is_a_push():
    (event,) = heard(later(hand))
    assert (event.kind, event.joints) == ("push", ("pitch",))
    assert event.onset == pytest.approx(ONSET, abs=0.5)
    assert event.end == pytest.approx(ONSET + 1.0, abs=2.5)


def test_gains_of_moments_are_chi_squared_of_one_and_of_a_force_s_three():
    rows, random = rows_of(ecm.recorded(2, SECONDS)), np.random.default_rng(6)
    band = Band(np.full(ecm.ARM.n, 1e-6), np.full(ecm.ARM.n, 0.05), np.full(ecm.ARM.n, FASTEST))
    alone, force = [], []
    for _ in range(20):
        noise = ecm.NOISE * random.standard_normal(rows.q.shape)
        window = Window.of(ecm.model(), rows, noise, band, Sampling())
        window = replace(window, error=ecm.NOISE, error_factor=np.ones_like(window.error_factor))
        nothing = np.zeros_like(window.uncertain_torque)
        window = replace(window, torque=noise[: len(window.time)], uncertain_torque=nothing)
        known = ChangeTest(window.uncertain, window.residual)
        gain = transients.transient_torques(window, known, 0, Tip(ecm.ARM)).gain
        heard_whole = gain[(gain > 0.0).all(axis=1)]
        alone.append(heard_whole[:, :-1].mean())
        force.append(heard_whole[:, -1].mean())
    assert np.mean(alone) == pytest.approx(1.0, abs=0.1)
    assert np.mean(force) == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize(("size", "joint"), [(1.5, None), (4.0, None), (1.5, ecm.INSERTION)])
def test_a_force_that_no_joint_shows_alone_is_a_push_and_a_larger_one_no_friction(size, joint):
    def force(q, qd, qdd):
        torque = np.einsum("mkn,k->mn", Tip(ecm.ARM).velocity_jacobian(q), size * FORCE)
        torque[round((ONSET + 1.0) * 100.0) :] = 0.0
        return torque if joint is None else torque * (np.arange(ecm.ARM.n) == joint)

    found = [(event.kind, round(event.onset - ONSET)) for event in heard(later(force))]
    assert found == [("push", 0)] * (joint is None)


def events_at_rest(part: float, lasts: float, yields: float) -> list[str]:
    """Return the kinds of events when pitch's motor changes by a part of its Coulomb friction.

    Args:
        part: Of it, in the negative direction.
        lasts: For how long, s.
        yields: By how much pitch moves against that, rad/(N·m).
    """

    def changed(q, qd, qdd):
        torque, time = np.zeros_like(q), 0.01 * np.arange(len(q))
        acts = (time >= 27.0) & (time < 27.0 + lasts)
        torque[acts, ecm.PITCH] = -part * ecm.COULOMB[ecm.PITCH]
        return torque

    rested = ecm.recorded(2, 36.0, changed, rest=24.0)
    moved = rested.position - yields * changed(rested.position, None, None)
    return [event.kind for event in monitor(replace(rested, position=moved), ecm.model()).events]


@pytest.mark.parametrize(
    ("part", "lasts", "kinds"),
    [(0.1, 1.0, []), (1.0, 1.0, ["push"]), (1.0, np.inf, []), (8.0, np.inf, ["push"])],
)
def test_at_rest_what_comes_and_goes_is_a_push_and_what_stays_friction_may_hold(part, lasts, kinds):
    assert events_at_rest(part, lasts, 1e-4) == kinds


@pytest.mark.parametrize("yields", [0.0, -1e-4])  # held by friction; or it gives way to its motor
def test_a_motor_that_presses_and_does_not_feel_its_joint_yield_is_not_pushed(yields):
    assert events_at_rest(1.0, 1.0, yields) == []


def test_a_resting_joint_that_friction_holds_while_another_moves_is_not_pushed():
    model, resting = ecm.model(), ecm.recorded(2, 36.0, rest=24.0)
    bump = np.clip((resting.time - 27.0) / 1.5, 0.0, 1.0)
    q = resting.position.copy()
    q[:, ecm.INSERTION] += 0.033 * np.sin(np.pi * bump) ** 2
    qd = resting.velocity + np.gradient(q - resting.position, resting.time, axis=0)
    qdd = np.gradient(qd, resting.time, axis=0)
    needed = model.torque(q, qd, qdd) - model.torque(resting.position, resting.velocity)
    held = needed[resting.time > 26.0, ecm.PITCH]
    assert 4.0 * ecm.NOISE[ecm.PITCH] < np.abs(held).max() < ecm.COULOMB[ecm.PITCH]
    effort = resting.effort.copy()
    moves = (resting.time > 26.0)[:, None] & (np.arange(ecm.ARM.n) == ecm.INSERTION)
    effort += np.where(moves, needed, 0.0)
    moved = replace(resting, position=q, velocity=qd, effort=effort)
    assert [event.kind for event in monitor(moved, model).events] == []


def test_a_torque_that_grows_while_the_arm_rests_is_a_drift_and_noise_is_none():
    model, n = ecm.model(), ecm.ARM.n
    random = np.random.default_rng(4)
    time = np.arange(0.5 / RATE, 200.0, 1.0 / RATE)
    q = np.tile([0.1, 0.2, 0.1, 0.0], (len(time), 1))
    effort = model.torque(q) + ecm.NOISE * random.standard_normal(q.shape)
    found = []
    for ramp in (0.0, 0.05):
        listener, heard = Monitor(model), []
        grown = ramp * ecm.ARM.effort_limit * np.eye(n)[ecm.PITCH] * time[:, None] / time[-1]
        rows = Rows(time, q, np.zeros_like(q), effort + grown)
        for first in range(0, len(rows), 100):
            heard += listener.add(rows.at(slice(first, first + 100))).events
        found.append([(event.kind, event.joints) for event in heard])
    assert found == [[], [("drift", ("pitch",))]]


def test_where_a_motor_creeps_friction_is_error_at_each_joint_that_it_moves():
    model, time = diagnosed.identified().model, np.arange(1000) / RATE
    ratio = model.arm.actuator_to_joint[2, 1]
    angle, n = 2.0 * np.pi * 0.3 * time, model.arm.n
    still, moving = np.zeros((2, len(time), n))
    for q, part in ((still, ratio), (moving, 0.1)):
        q[:, 1], q[:, 2] = 0.3 * np.sin(angle), part * 0.3 * np.sin(angle)

    def deviation(q: np.ndarray) -> np.ndarray:
        rows = Rows(time, q, np.gradient(q, time, axis=0), model.torque(q))
        band = Band(model.uncertainty.error, np.full(n, 0.1), np.full(n, FASTEST))
        return np.median(Window.of(model, rows, 0.0 * q, band, Sampling()).error_factor, axis=0)

    rubs = windows.breakaway_torque(model, 0.0 * still[0])[1] / model.uncertainty.error[1]
    assert deviation(still)[1] > 0.9 * rubs  # insertion's motor may hold pitch
    assert (deviation(moving)[1:3] < 1.05).all()


@pytest.mark.parametrize(("smaller", "level"), [(0.5, 0.5**0.5), (0.05, 12.0**-0.5), (4.0, 1.0)])
def test_errors_that_are_smaller_than_known_lower_the_limits_of_causes(smaller, level):
    gain = smaller * np.random.default_rng(8).chisquare([1.0, 1.0, 3.0], (12000, 3))
    last = np.tile([4, 8, 16, 25], 3000)
    found = transients.TransientTorques(np.zeros(12000, dtype=int), last, gain, gain[:, :2])
    usual = transients.TypicalGains.begin(2).updated(found, np.full(3, 1e3), 1.0)
    np.testing.assert_allclose(usual.level, level, rtol=0.1)
    limit = limits.Limits(1e-6, level=np.array([usual.level[0], 1.0]))
    columns = np.array([[[1.0], [0.0]]])
    assert limit.typical_gain(columns) == pytest.approx(usual.level[0])
    columns[:, 1] = 1.0  # of another joint whose errors are as known
    assert limit.typical_gain(columns) == pytest.approx(0.5 * (1.0 + usual.level[0]))


@pytest.mark.parametrize(("times", "heard_of"), [(2.0, 1.0), (3.0, 0.0)])
def test_an_arm_is_judged_up_to_twice_the_speed_that_is_known(times, heard_of):
    model, time = diagnosed.identified().model, np.arange(1000) / RATE
    known, n = model.uncertainty, model.arm.n
    q = np.tile(0.5 * (known.lower + known.upper) + model.joint_offset, (1000, 1))
    rows = Rows(time, q, np.tile(times * known.speed, (1000, 1)), model.torque(q))
    band = Band(known.error, np.full(n, 0.1), np.full(n, FASTEST))
    assert np.mean(Window.of(model, rows, 0.0 * q, band, Sampling()).available[50:]) == heard_of
