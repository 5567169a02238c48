"""The closed form of the master arms' gravity: against MuJoCo, beta both ways, shapes, refusals.

The coefficients and the document's table are checked exactly in ``test_gravity_symbolic.py``.
"""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import (
    BETA_NAMES,
    COLUMNS,
    LINKS,
    Arm,
    Lengths,
    LinkMass,
    beta_from_links,
    beta_from_pinocchio,
    beta_tree,
    build_tree,
    regressor,
    torque,
)
from dvrk_gravity.errors import ConfigError, ShapeError
from testing.mujoco_arms import mtm

DOWN = (0.0, 0.0, -9.81)
TILTED = (1.3, -2.1, -9.4)


def random_links(rng, names=LINKS) -> dict[str, LinkMass]:
    return {n: LinkMass(rng.uniform(0.05, 1.0), tuple(rng.normal(0, 0.1, 3))) for n in names}


def bodies(links) -> dict[str, pin.Inertia]:
    return {n: pin.Inertia(x.mass, np.array(x.com), 0.01 * np.eye(3)) for n, x in links.items()}


def in_mujoco(links, q, base_gravity=DOWN) -> np.ndarray:
    """Torques that hold the arm in MuJoCo, its parallelogram closed."""
    light = dict.fromkeys(LINKS, pin.Inertia(1e-9, np.zeros(3), 1e-9 * np.eye(3)))
    rest = np.zeros_like(q)
    return mtm("mtml", light | bodies(links), base_gravity).torque(q, rest, rest)


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def poses(rng, count: int):
    return rng.uniform(-np.pi, np.pi, (count, 7)) * [1, 1, 1, 1, 1, 1, 2.6]


def test_torque_is_mujoco_s_and_pinocchio_s_for_random_arms(rng):
    for base_gravity in (DOWN, TILTED, (0.0, 9.81, 0.0), (3.7, 0.0, 0.0)):
        for _ in range(3):
            q, links = poses(rng, 100), random_links(rng)
            beta = beta_from_links(links, columns=14)
            expected = in_mujoco(links, q, base_gravity)
            bound = 1e-7 * abs(expected).max()
            assert abs(regressor(q, base_gravity, 14) @ beta - expected).max() < bound
            tau = torque(q, beta, base_gravity)
            assert abs(tau - expected).max() < bound
            tree = build_tree(Arm.load("mtml"), bodies(links), np.array(base_gravity))
            np.testing.assert_allclose(tau, [tree.gravity(pose) for pose in q], atol=1e-12)


def test_fewer_columns_are_exact_where_they_are_enough_and_only_there(rng):
    q, links = poses(rng, 200), random_links(rng)
    on_axis = links | {"link7": LinkMass(0.3, (0.0, 0.0, 0.04))}
    exact = torque(q, beta_from_links(on_axis, columns=14), DOWN)
    np.testing.assert_allclose(regressor(q) @ beta_from_links(on_axis), exact, atol=1e-12)
    assert not regressor(q)[:, [0, 6]].any()
    beta = beta_from_links(links, columns=14)
    exact = torque(q, beta, DOWN)
    np.testing.assert_allclose(torque(q, beta[:12]), exact, atol=1e-12)
    assert abs(torque(q, beta[:10]) - exact).max() > 0.05  # link 7 off its axis needs twelve
    apart = abs(torque(q, beta[:12], TILTED) - torque(q, beta, TILTED))
    assert apart[:, 0].max() > 0.05  # and a tilted base fourteen
    assert apart[:, 1:].max() < 1e-12
    for base_gravity, columns in itertools.product((DOWN, TILTED), (10, 12)):
        most = regressor(q, base_gravity, 14)
        np.testing.assert_array_equal(regressor(q, base_gravity, columns), most[..., :columns])


def test_every_column_is_a_base_parameter_and_no_link_needs_another(rng):
    q = poses(rng, 300)
    assert np.linalg.matrix_rank(regressor(q).reshape(-1, 10)) == 10
    for base_gravity, columns in ((DOWN, 12), (TILTED, 14)):
        y = regressor(q, base_gravity, columns).reshape(-1, columns)
        assert np.linalg.matrix_rank(y) == columns
        for name in LINKS:
            tau = in_mujoco(random_links(rng, [name]), q, base_gravity).ravel()
            beta, *_ = np.linalg.lstsq(y, tau, rcond=None)
            assert abs(y @ beta - tau).max() < 1e-6, name


def test_beta_from_pinocchios_inertias_is_beta_from_links(rng):
    for names, columns in itertools.product((LINKS, LINKS[:7]), (10, 12, 14)):
        links = random_links(rng, names)  # LINKS[:7]: without a parallelogram
        model = build_tree(Arm.load("mtml"), bodies(links), np.array(TILTED)).model
        expected = beta_from_links(links, columns=columns)
        found = beta_from_pinocchio(model, columns=columns)
        np.testing.assert_allclose(found, expected, atol=1e-13)
    with pytest.raises(ConfigError, match="z axis"):
        beta_from_pinocchio(model, Lengths(arm=0.31))
    with pytest.raises(ConfigError, match="seven joints"):
        beta_from_pinocchio(pin.buildSampleModelManipulator())


def test_torque_scales_with_gravity_and_beta_holds_981(rng):
    q = poses(rng, 10)
    for base_gravity in (DOWN, TILTED):
        weak = np.multiply(base_gravity, 1.62 / 9.81)
        np.testing.assert_allclose(
            regressor(q, weak, 14), regressor(q, base_gravity, 14) * 1.62 / 9.81, atol=1e-15
        )
    assert not regressor(q, (0.0, 0.0, 0.0), 14).any()
    # A kilogram a metre out on the horizontal arm holds 9.81 N·m.
    beta = beta_from_links({"link2": LinkMass(1.0)}, Lengths(arm=1.0))
    assert torque([0, np.pi / 2, 0, 0, 0, 0, 0], beta)[1] == pytest.approx(9.81)


def test_many_poses_at_once_are_each_alone_in_any_shape_order_and_type(rng):
    """Many more than are computed in one block."""
    q = poses(rng, 5003)
    before, beta = q.copy(), rng.normal(size=12)
    y = regressor(q, columns=12)
    np.testing.assert_allclose(y @ beta, torque(q, beta), atol=1e-13)
    for i in (*range(0, len(q), 97), len(q) - 1):
        np.testing.assert_allclose(y[i], regressor(q[i], columns=12), atol=1e-15)
    np.testing.assert_array_equal(regressor(np.asfortranarray(q), columns=12), y)
    np.testing.assert_array_equal(q, before)
    whole = np.array([1, -2, 3, 0, 2, 1, -1])
    for given in (whole.astype(np.float32), whole, whole.tolist()):
        np.testing.assert_array_equal(regressor(given), regressor(whole.astype(float)))
    shapes = [(7,), (1, 7), (2, 3, 7), (0, 7), (2, 0, 7)]
    for shape, base_gravity in itertools.product(shapes, (DOWN, TILTED)):
        q = rng.uniform(-3, 3, shape)
        y = regressor(q, base_gravity, 12)
        assert y.shape == (*shape, 12)
        assert torque(q, np.ones(12), base_gravity).shape == shape
        for index in np.ndindex(*shape[:-1]):
            np.testing.assert_allclose(y[index], regressor(q[index], base_gravity, 12), atol=1e-15)


def test_sines_stay_exact_where_the_half_angles_tangent_is_steep():
    angle = np.array([0.0, np.pi, -np.pi, np.nextafter(np.pi, 4), np.pi / 2, 8.4, -1e3, 3e-9])
    q = np.zeros((len(angle), 7))
    q[:, 1] = angle
    y = regressor(q)
    assert abs(y[:, 1, 0] - np.sin(angle)).max() < 5e-16
    assert abs(y[:, 1, 1] - np.cos(angle)).max() < 5e-16


def test_a_pose_that_is_not_a_number_spoils_only_itself(rng):
    q = poses(rng, 3)
    clean = regressor(q)
    q[1, 3] = np.nan
    y = regressor(q)
    assert np.isnan(y[1, 3, 4])
    np.testing.assert_array_equal(y[[0, 2]], clean[[0, 2]])


def test_arguments_of_another_shape_or_without_a_number_are_refused():
    q = np.zeros(7)
    for wrong in (0.0, [1.0] * 6, np.zeros((7, 3)), []):
        for call in (lambda q: regressor(q), lambda q: torque(q, np.ones(10))):
            with pytest.raises(ShapeError, match="q has shape"):
                call(wrong)
    for wrong in (-9.81, [0.0, -9.81], np.zeros((1, 3))):
        with pytest.raises(ShapeError, match="gravity has shape"):
            regressor(q, wrong)
    with pytest.raises(ConfigError, match=r"gravity.*finite"):
        torque(q, np.ones(10), [0.0, np.nan, -9.81])
    for wrong in (np.ones(11), np.ones((10, 1)), 1.0):
        with pytest.raises(ShapeError, match="beta has shape"):
            torque(q, wrong)
    for wrong in (0, 11, 13):
        for call in (lambda n: regressor(q, columns=n), lambda n: beta_from_links({}, columns=n)):
            with pytest.raises(ConfigError, match=r"columns.*10, 12 or 14"):
                call(wrong)
    for name, link in (
        ("link8", LinkMass(1.0)), ("link2", LinkMass(np.nan)),
        ("link3", LinkMass(1.0, (0.0, np.inf, 0.0))), ("link4", LinkMass(1.0, (0.0, 0.0))),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=name):
            beta_from_links({name: link})


def test_names_and_columns_belong_together():
    assert len(BETA_NAMES) == len(set(BETA_NAMES)) == max(COLUMNS) == 14
    roll = beta_from_links({"link7": LinkMass(1.0, (1.0, 2.0, 0.0))}, columns=14)
    assert dict(zip(BETA_NAMES, roll / 9.81, strict=True))["roll_y"] == pytest.approx(2.0)


def test_gravity_of_beta_s_tree_is_the_closed_form(rng):
    for length, vector in itertools.product((10, 12, 14), (DOWN, TILTED, (0.0, 3.0, 0.5))):
        beta = rng.normal(0, 0.5, length)
        tree = beta_tree(Arm.load("mtmr"), beta, np.array(vector))
        for q in poses(rng, 10):
            np.testing.assert_allclose(tree.gravity(q), torque(q, beta, vector), atol=1e-13)
