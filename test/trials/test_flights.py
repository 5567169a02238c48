"""Flights for judging a monitor: their physics by other means, and the judge."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dvrk_gravity.monitoring import Alternative, Event
from testing.flight_motion import PausedMotion
from testing.flight_mtm import MtmBench
from testing.flight_mujoco import MujocoBench
from testing.flights import Flight
from testing.happening import Happening
from testing.hidden_parts import Hidden
from testing.lab_motion import draw_calibration
from testing.monitor_judge import Verdict, judge, most_an_hour
from testing.mujoco_arms import MujocoArm

ONSET = 4.0


def tip(engine: MujocoArm, q: np.ndarray, point: np.ndarray, joint: int) -> np.ndarray:
    data = mujoco.MjData(engine.model)
    data.qpos = engine.expand @ q
    mujoco.mj_kinematics(engine.model, data)
    body = int(engine.bodies[joint])
    at = (engine.frames[joint] @ np.append(point, 1.0))[:3]
    return data.xpos[body] + data.xmat[body].reshape(3, 3) @ at


def slopes(engine: MujocoArm, q: np.ndarray, point: np.ndarray, joint: int) -> np.ndarray:
    """Return the (3, n) derivatives of a point's place by differences."""
    steps = 1e-6 * np.eye(len(q))
    columns = [
        tip(engine, q + step, point, joint) - tip(engine, q - step, point, joint) for step in steps
    ]
    return np.stack(columns, axis=1) / 2e-6


@pytest.mark.parametrize("even", [False, True])
def test_the_force_of_a_push_integrates_to_its_impulse(even: bool) -> None:
    way = np.array([0.6, 0.0, 0.8])
    push = Happening("push", 0, 1.0, 2.5, way, 0.7, even)
    time = np.arange(0.0, 3.0, 1e-4)
    np.testing.assert_allclose(push.force(time).sum(axis=0) * 1e-4, 2.5 * way, rtol=1e-3)
    assert not push.force(time[(time < 1.0) | (time > 1.7001)]).any()


def test_a_motion_with_a_pause_has_the_derivatives_that_it_says_and_stands_still_in_it() -> None:
    motion = PausedMotion(draw_calibration(MtmBench.draw(0).arm, 0), ((3.0, 5.0),))
    time, step = np.arange(1.0, 7.0, 0.01), 1e-4
    q, qd, qdd = motion.at(time)
    ahead, behind = motion.at(time + step), motion.at(time - step)
    np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * step), qd, atol=1e-5)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * step), qdd, atol=1e-3)
    rest = (time >= 3.0) & (time <= 5.0)
    np.testing.assert_allclose(q[rest], np.broadcast_to(q[rest][0], q[rest].shape), atol=1e-9)
    assert motion.moved(0.0, 7.0) == pytest.approx(7.0 - 2.0 - 2 * 0.29, abs=0.05)


def test_arms_in_mujoco_have_the_jacobian_and_the_inertia_of_differences() -> None:
    engine = MujocoBench.draw("ur5", 1).engine
    q, point = np.random.default_rng(0).uniform(-1.0, 1.0, 6), np.array([0.0, 0.05, 0.1])
    jacobian = engine.tip_jacobian(q[None], point)[0]
    np.testing.assert_allclose(jacobian, slopes(engine, q, point, 5), atol=1e-6)
    still, rows = np.zeros((6, 6)), np.tile(q, (6, 1))
    columns = engine.torque(rows, still, np.eye(6)) - engine.torque(rows, still, still)
    np.testing.assert_allclose(engine.mass_matrix(q[None])[0], columns.T, atol=1e-9)


def test_a_long_push_holds_an_arm_where_its_controller_balances_it() -> None:
    bench, force = MujocoBench.draw("ur5", 1), 20.0
    motion = PausedMotion(bench.calibration, ((2.0, 60.0),))
    push = Happening("push", 5, ONSET, 4.0 * force * 0.75, np.array([0.0, 0.0, 1.0]), 4.0, True)
    with_push, without = (bench.truth(motion, 9.0, happening) for happening in (push, None))
    rows = (with_push.time > 5.5) & (with_push.time < 6.5)  # where the force is even
    q, off = without.q[rows][0], (with_push.q - without.q)[rows].mean(axis=0)
    torque = slopes(bench.engine, q, np.zeros(3), 5).T @ np.array([0.0, 0.0, force])
    inertia = bench.engine.mass_matrix(q[None])[0] + np.diag(bench.world.rotors)
    np.testing.assert_allclose(
        inertia @ off * bench.stiffness**2, torque, atol=0.02 * np.abs(torque).max()
    )
    before = with_push.time < ONSET
    np.testing.assert_array_equal(with_push.effort[before], without.effort[before])
    for values, rate in ((with_push.q, with_push.qd), (with_push.qd, with_push.qdd)):
        steps = np.diff(values, axis=0) - 0.5 * 2e-3 * (rate[1:] + rate[:-1])
        assert np.abs(steps).max() < 2e-4


def test_a_payload_of_a_master_arm_weighs_what_its_height_says_from_its_moment_on() -> None:
    bench, mass, place = MtmBench.draw(0), 0.05, np.array([0.01, -0.02, 0.03])
    motion = PausedMotion(bench.calibration)
    load = Happening("payload", 5, ONSET, mass, place)
    with_load, without = (bench.record(motion, 8.0, happening, 3) for happening in (load, None))
    before = with_load.time < ONSET
    np.testing.assert_array_equal(with_load.effort[before], without.effort[before])
    np.testing.assert_array_equal(with_load.position[before], without.position[before])
    rows = np.flatnonzero(with_load.time > ONSET + 0.5)
    added = (with_load.effort - without.effort)[rows]
    heights = [slopes(bench.engine, q, place, 5) for q in with_load.position[rows[::20]]]
    weight = np.array([-mass * bench.world.gravity @ height for height in heights])
    for joint in (1, 2, 4):  # those that carry it
        share = np.polyfit(weight[:, joint], added[::20, joint], 1)[0]
        assert share == pytest.approx(1.0, abs=0.15)
    steps = np.abs(np.diff(with_load.position, axis=0)).max(axis=0)
    assert (steps <= 1.5 * np.abs(np.diff(without.position, axis=0)).max(axis=0) + 1e-4).all()


NAMED = Event("change", 31.0, 36.0, ("elbow_pitch",), "coulomb_friction")
PERHAPS = Event("change", 31.0, 36.0, ("wrist_yaw",), "payload", certainty="perhaps")
OTHER = Alternative("coulomb_friction", ("elbow_pitch",), "elbow_pitch")
PUSHED = Event("push", 31.0, 32.0, ("elbow_pitch",))


@pytest.mark.parametrize(
    ("events", "place"),
    [
        ([NAMED], "named"),
        ([Event("change", 31.0, 45.0, ("elbow_pitch",), "coulomb_friction")], "late"),
        ([Event("change", 31.0, 36.0, ("wrist_yaw",), "coulomb_friction")], "wrong"),
        ([NAMED, Event("change", 31.0, 40.0, ("wrist_yaw",), "payload")], "wrong"),
        ([NAMED, PERHAPS], "named"),
        ([replace(PERHAPS, alternatives=(OTHER,))], "alternative"),
        ([PUSHED], "push"),
        ([Event("unexplained", 31.0, 36.0, ("elbow_pitch",))], "unnamed"),
        ([], "missed"),
    ],
)
def test_a_change_is_named_by_effect_and_joint_in_time_and_nothing_else(
    events: list[Event], place: str
) -> None:
    assert verdict_on(Hidden("coulomb_friction", ("elbow_pitch",), {}), events) == place


@pytest.mark.parametrize(
    ("events", "place"),
    [
        ([PUSHED], "named"),
        ([NAMED], "wrong"),
        ([PUSHED, PERHAPS], "wrong"),
        ([], "missed"),
    ],
)
def test_a_push_is_a_push_and_never_a_payload(events: list[Event], place: str) -> None:
    assert verdict_on(Hidden("push", (), {}), events, end=32.0) == place


def test_hours_without_an_alarm_bound_its_rate() -> None:
    assert most_an_hour(0, 30.0) == pytest.approx(-np.log(0.05) / 30.0)


def verdict_on(hidden: Hidden, events: list[Event], end: float = np.inf) -> str:
    bench = MtmBench.draw(0)
    model, none = bench.world.model(), np.zeros(7)
    flight = Flight("mtm", 0, "coulomb_friction", None, model, hidden, 30.5, end, None, none, none)
    verdict = Verdict("mtm", 0, 0, "coulomb_friction")
    judge(verdict, flight, events)
    return verdict.place
