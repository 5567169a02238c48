"""The closed form against Pinocchio: torques, beta both ways, shapes, scaling, errors."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import (
    BETA_NAMES,
    COLUMNS,
    LENGTHS,
    LINKS,
    Arm,
    Lengths,
    LinkMass,
    beta_from_links,
    beta_from_pinocchio,
    build_tree,
    regressor,
    torque,
)
from dvrk_gravity.errors import ConfigError, ShapeError

DOWN = (0.0, 0.0, -9.81)
TILTED = (1.3, -2.1, -9.4)
OTHER_ARM = Lengths(arm=0.31, forearm=0.29, h=0.17, crank=0.08)


def dh_table(lengths: Lengths):
    """alpha deg, a, d, theta's offset deg."""
    return (
        (90, 0.0, 0.0, -90),
        (0, lengths.arm, 0.0, -90),
        (-90, lengths.forearm, 0.0, 90),
        (90, 0.0, lengths.h, 0),
        (-90, 0.0, 0.0, 0),
        (90, 0.0, 0.0, -90),
        (0, 0.0, 0.0, 90),
    )


def turn(axis: str, degrees: float) -> pin.SE3:
    return pin.SE3(pin.utils.rotate(axis, np.radians(degrees)), np.zeros(3))


def random_links(rng, names=LINKS) -> dict[str, LinkMass]:
    return {n: LinkMass(rng.uniform(0.05, 1.0), tuple(rng.normal(0, 0.1, 3))) for n in names}


class Oracle:
    """A Pinocchio tree: the DH chain, the crank on link 1 and the bar on link 3.

    The tree has nine joints. The parallelogram closes where the crank turns with q2 + q3 and
    the bar turns back by q3 on the forearm, so that the torques of the seven are those of
    the tree projected on that motion.
    """

    def __init__(self, links, lengths=LENGTHS, base_gravity=DOWN, shift=0.0):
        """Joint frames lie `shift` off the DH origins along their axes, which must not matter."""
        self.model = pin.Model()
        along = pin.SE3(np.eye(3), np.array([0.0, 0.0, shift]))
        before, joint = pin.SE3.Identity(), 0
        ids, distal = {}, {}
        for i, (alpha, a, d, offset) in enumerate(dh_table(lengths), start=1):
            joint = self.model.addJoint(
                joint, pin.JointModelRZ(), before * turn("z", offset) * along, f"joint{i}"
            )
            placement = pin.SE3(np.eye(3), np.array([a, 0.0, d])) * turn("x", alpha)
            before = along.inverse() * placement
            ids[f"link{i}"], distal[f"link{i}"] = joint, before
            if i == 1:
                shoulder = before
            if i == 3:
                on_forearm = before * pin.SE3(np.eye(3), np.array([lengths.crank - a, 0.0, 0.0]))
        if "crank" in links:
            # Crank: turned to lie along x3 when q2 + q3 = 0; its frame's x5' = z3, y5' = -x3.
            ids["crank"] = self.model.addJoint(ids["link1"], pin.JointModelRZ(), shoulder, "crank")
            tip = pin.SE3(np.eye(3), np.array([lengths.crank, 0.0, 0.0]))
            # x3 is the joint's x, z3 its y.
            axes = np.column_stack([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
            distal["crank"] = tip * pin.SE3(axes, np.zeros(3))
        if "bar" in links:
            # Joint axis is z2 = -y3; the joint's x is x3 at zero, the arm's x2 is then its -y.
            pivot = on_forearm * turn("x", 90)
            ids["bar"] = self.model.addJoint(ids["link3"], pin.JointModelRZ(), pivot, "bar")
            back = pin.SE3(np.eye(3), np.array([0.0, lengths.arm, 0.0]))
            # x4' = -x2 = y, y4' = -y2 = -x of the joint.
            axes = np.column_stack([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
            distal["bar"] = back * pin.SE3(axes, np.zeros(3))
        for name, link in links.items():
            inertia = pin.Inertia(link.mass, np.array(link.com), 1e-2 * np.eye(3))
            self.model.appendBodyToJoint(ids[name], inertia, distal[name])
        self.model.gravity.linear = np.array(base_gravity)
        self.data = self.model.createData()
        # Tree velocities from the seven: rows by the tree's own joint order.
        self.motion = np.zeros((self.model.nv, 7))
        for name, number in ids.items():
            row = self.model.idx_vs[number]
            if name.startswith("link"):
                self.motion[row, int(name[4:]) - 1] = 1.0
            else:
                self.motion[row] = {"crank": [0, 1, 1, 0, 0, 0, 0], "bar": [0, 0, -1, 0, 0, 0, 0]}[
                    name
                ]

    def torque(self, q):
        tree = np.asarray(q) @ self.motion.T
        compute, model, data = pin.computeGeneralizedGravity, self.model, self.data
        return np.array([compute(model, data, pose) for pose in tree]) @ self.motion

    def placement(self, joint: str, q) -> pin.SE3:
        pin.forwardKinematics(self.model, self.data, self.motion @ q)
        return self.data.oMi[self.model.getJointId(joint)]


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def poses(rng, count: int):
    return rng.uniform(-np.pi, np.pi, (count, 7)) * [1, 1, 1, 1, 1, 1, 2.6]


def test_the_oracles_parallelogram_closes(rng):
    oracle = Oracle(random_links(rng))
    for q in poses(rng, 5):
        tip = oracle.placement("crank", q) * np.array([0.1, 0.0, 0.0])
        np.testing.assert_allclose(
            oracle.placement("bar", q) * np.array([0.0, 0.2794, 0.0]), tip, atol=1e-14
        )


def test_torque_is_pinocchios_for_random_arms(rng):
    q = poses(rng, 2000).reshape(4, 5, 100, 7)
    for base_gravity, batches in zip((DOWN, TILTED, (0.0, 9.81, 0.0), (3.7, 0.0, 0.0)), q,
                                     strict=True):  # fmt: skip
        for batch in batches:
            links = random_links(rng)
            beta = beta_from_links(links, columns=14)
            expected = Oracle(links, base_gravity=base_gravity).torque(batch)
            bound = 1e-12 * abs(expected).max()
            assert abs(regressor(batch, base_gravity, 14) @ beta - expected).max() < bound
            assert abs(torque(batch, beta, base_gravity) - expected).max() < bound


def test_ten_columns_are_exact_when_link_7_is_on_its_axis_and_gravity_is_vertical(rng):
    links = random_links(rng)
    links["link7"] = LinkMass(0.3, (0.0, 0.0, 0.04))
    q = poses(rng, 200)
    expected = Oracle(links).torque(q)
    assert abs(expected).max() > 1.0
    np.testing.assert_allclose(regressor(q) @ beta_from_links(links), expected, atol=1e-12)
    assert not regressor(q)[:, [0, 6]].any()


def test_twelve_columns_are_needed_for_link_7_off_its_axis(rng):
    links = random_links(rng)
    q = poses(rng, 200)
    expected = Oracle(links).torque(q)
    twelve = beta_from_links(links, columns=12)
    np.testing.assert_allclose(torque(q, twelve), expected, atol=1e-12)
    assert abs(torque(q, twelve[:10]) - expected).max() > 0.05
    assert abs(expected[:, 6]).max() > 0.05


def test_fourteen_columns_are_needed_for_a_tilted_base(rng):
    links = random_links(rng)
    q = poses(rng, 200)
    expected = Oracle(links, base_gravity=TILTED).torque(q)
    fourteen = beta_from_links(links, columns=14)
    np.testing.assert_allclose(torque(q, fourteen, TILTED), expected, atol=1e-12)
    apart = abs(torque(q, fourteen[:12], TILTED) - expected)
    assert apart[:, 0].max() > 0.05
    assert apart[:, 1:].max() < 1e-12


def test_every_column_is_a_base_parameter_and_no_link_needs_another(rng):
    q = poses(rng, 300)
    assert np.linalg.matrix_rank(regressor(q).reshape(-1, 10)) == 10
    for base_gravity, columns in ((DOWN, 12), (TILTED, 14)):
        y = regressor(q, base_gravity, columns).reshape(-1, columns)
        assert np.linalg.matrix_rank(y) == columns
        for name in LINKS:
            tau = Oracle(random_links(rng, [name]), base_gravity=base_gravity).torque(q).ravel()
            beta, *_ = np.linalg.lstsq(y, tau, rcond=None)
            assert abs(y @ beta - tau).max() < 1e-12, name


def test_the_fewer_columns_are_the_first_of_the_more(rng):
    q = poses(rng, 20)
    for base_gravity in (DOWN, TILTED):
        most = regressor(q, base_gravity, 14)
        for columns in (10, 12):
            np.testing.assert_array_equal(regressor(q, base_gravity, columns), most[..., :columns])


def test_beta_from_links_is_what_least_squares_finds_in_pinocchios_torques(rng):
    q = poses(rng, 300)
    y = regressor(q, TILTED, 14).reshape(-1, 14)
    massless = dict.fromkeys(LINKS, LinkMass(0.0))
    cases = [(random_links(rng), Lengths()), (random_links(rng), OTHER_ARM)]
    cases += [(massless | random_links(rng, [name]), Lengths()) for name in LINKS]
    for links, lengths in cases:
        tau = Oracle(links, lengths, TILTED).torque(q)
        fitted, *_ = np.linalg.lstsq(y, tau.ravel(), rcond=None)
        np.testing.assert_allclose(beta_from_links(links, lengths, 14), fitted, atol=1e-11)


def test_beta_from_pinocchios_inertias_is_beta_from_links(rng):
    for lengths, shift, columns in itertools.product((Lengths(), OTHER_ARM), (0.0, 0.07),
                                                     (10, 12, 14)):  # fmt: skip
        links = random_links(rng)
        model = Oracle(links, lengths, shift=shift).model
        np.testing.assert_allclose(
            beta_from_pinocchio(model, lengths, columns),
            beta_from_links(links, lengths, columns),
            atol=1e-13,
        )


def test_beta_from_a_pinocchio_model_without_parallelogram(rng):
    links = random_links(rng, LINKS[:7])
    model = Oracle(links).model
    np.testing.assert_allclose(beta_from_pinocchio(model), beta_from_links(links), atol=1e-13)


def test_the_packages_own_tree_has_the_same_torques_and_beta(rng):
    links = random_links(rng)
    inertias = {n: pin.Inertia(x.mass, np.array(x.com), 0.01 * np.eye(3)) for n, x in links.items()}
    tree = build_tree(Arm.load("mtml"), inertias, np.array(TILTED))
    beta = beta_from_links(links, columns=14)
    np.testing.assert_allclose(beta_from_pinocchio(tree.model, columns=14), beta, atol=1e-13)
    for q in poses(rng, 20):
        np.testing.assert_allclose(torque(q, beta, TILTED), tree.gravity(q), atol=1e-12)


def test_a_pinocchio_model_of_another_arm_is_refused(rng):
    model = Oracle(random_links(rng, LINKS[:7])).model
    with pytest.raises(ConfigError, match=r"joint3.*z axis"):
        beta_from_pinocchio(model, OTHER_ARM)
    with pytest.raises(ConfigError, match="seven joints"):
        beta_from_pinocchio(pin.buildSampleModelManipulator())
    model.names[7] = "joint6"
    with pytest.raises(ConfigError, match="seven joints"):
        beta_from_pinocchio(model)


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


def test_any_leading_shape(rng):
    shapes = [(7,), (1, 7), (5, 7), (2, 3, 7), (0, 7), (2, 0, 7)]
    for shape, base_gravity in itertools.product(shapes, (DOWN, TILTED)):
        q = rng.uniform(-3, 3, shape)
        y = regressor(q, base_gravity, 12)
        assert y.shape == (*shape, 12)
        assert torque(q, np.ones(12), base_gravity).shape == shape
        for index in np.ndindex(*shape[:-1]):
            single = regressor(q[index], base_gravity, 12)
            np.testing.assert_allclose(y[index], single, rtol=0, atol=1e-15)


def test_many_poses_at_once_are_each_alone_in_any_memory_order_and_type(rng):
    """Many more than are computed in one block."""
    q = poses(rng, 5003)
    before = q.copy()
    beta = rng.normal(size=12)
    y, tau = regressor(q, columns=12), torque(q, beta)
    np.testing.assert_allclose(y @ beta, tau, atol=1e-13)
    for i in (*range(0, len(q), 97), len(q) - 1):
        np.testing.assert_allclose(y[i], regressor(q[i], columns=12), atol=1e-15)
    np.testing.assert_array_equal(regressor(np.asfortranarray(q), columns=12), y)
    np.testing.assert_array_equal(regressor(q[::-1], columns=12)[::-1][:5], y[:5])
    np.testing.assert_array_equal(q, before)
    whole = np.array([1, -2, 3, 0, 2, 1, -1])
    for given in (whole.astype(np.float32), whole, whole.tolist()):
        assert regressor(given).dtype == np.float64
        np.testing.assert_array_equal(regressor(given), regressor(whole.astype(float)))


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


def test_positions_of_another_length_are_refused():
    for q in (0.0, [1.0] * 6, np.zeros((7, 3)), []):
        with pytest.raises(ShapeError, match="q has shape"):
            regressor(q)
        with pytest.raises(ShapeError, match="q has shape"):
            torque(q, np.ones(10))


def test_bad_gravity_beta_and_columns_are_refused():
    q = np.zeros(7)
    for wrong in (-9.81, [0.0, -9.81], np.zeros((1, 3))):
        with pytest.raises(ShapeError, match="gravity has shape"):
            regressor(q, wrong)
    for wrong in ([0.0, np.nan, -9.81], [np.inf, 0.0, 0.0]):
        with pytest.raises(ConfigError, match=r"gravity.*finite"):
            torque(q, np.ones(10), wrong)
    for wrong in (np.ones(11), np.ones((10, 1)), 1.0):
        with pytest.raises(ShapeError, match="beta has shape"):
            torque(q, wrong)
    for wrong in (0, 11, 13):
        with pytest.raises(ConfigError, match=r"columns.*10, 12 or 14"):
            regressor(q, columns=wrong)
        with pytest.raises(ConfigError, match=r"columns.*10, 12 or 14"):
            beta_from_links({}, columns=wrong)


def test_links_that_cannot_be_used_are_named():
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
