"""The arms that are shipped: geometry, limits, transmission, tilt."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from support import CONFIG

from dvrk_gravity.arms import JOINT_NAMES, Arm, gravity_in_base
from dvrk_gravity.errors import ConfigError
from testing.mujoco_arms import dh_table

DH = (  # alpha, a, d, offset [deg, m]
    (90, 0.0, 0.0, -90),
    (0, 0.2794, 0.0, -90),
    (-90, 0.3645, 0.0, 90),
    (90, 0.0, 0.1506, 0),
    (-90, 0.0, 0.0, 0),
    (90, 0.0, 0.0, -90),
    (0, 0.0, 0.0, 90),
)
LOWER = {
    "mtml": [-40, -15, -50, -205, -95, -45, -480],
    "mtmr": [-65, -18, -50, -95, -95, -45, -480],
}
UPPER = {"mtml": [65, 65, 35, 95, 185, 45, 450], "mtmr": [40, 65, 35, 205, 185, 45, 450]}


@pytest.fixture(params=["mtml", "mtmr"])
def arm(request) -> Arm:
    return Arm.load(request.param)


def test_shipped_arms_have_the_published_geometry_and_limits(arm):
    assert arm.joint_names == JOINT_NAMES
    table = [(joint.alpha, joint.a, joint.d, joint.offset) for joint in dh_table(arm.name)]
    expected = [(np.radians(alpha), a, d, np.radians(offset)) for alpha, a, d, offset in DH]
    np.testing.assert_allclose(table, expected, atol=1e-15)
    np.testing.assert_allclose(np.degrees(arm.lower), LOWER[arm.name])
    np.testing.assert_allclose(np.degrees(arm.upper), UPPER[arm.name])
    np.testing.assert_array_equal(
        arm.actuator_effort_limit, [1.861, 1.464, 1.753, 0.309, 0.097, 0.097, 0.023]
    )
    np.testing.assert_array_equal(
        arm.effort_limit, [1.861, 3.217, 1.96, 0.309, 0.097, 0.097, 0.023]
    )
    assert arm.body("crank").frame.translation @ arm.body("crank").frame.translation == 0.1**2
    np.testing.assert_allclose(arm.gravity, [0, 0, -9.81])


def test_motors_of_shoulder_elbow_and_platform_are_coupled_as_published():
    arm = Arm.load("mtml")
    motor = np.random.default_rng(0).uniform(-2, 2, (50, 7))
    joint = motor.copy()
    joint[:, 2] = motor[:, 2] - motor[:, 1]
    joint[:, 3] = motor[:, 3] + 0.6697 * (motor[:, 1] - motor[:, 2])
    np.testing.assert_allclose(arm.joint_position(motor), joint, atol=1e-14)
    np.testing.assert_allclose(arm.actuator_position(joint), motor, atol=1e-14)
    # Hence the elbow's motor turns with q2 + q3.
    np.testing.assert_allclose(motor[:, 2], joint[:, 1] + joint[:, 2], atol=1e-14)


def test_gravity_in_a_tilted_base_is_the_world_s_turned_into_it():
    for rpy in np.random.default_rng(2).uniform(-np.pi, np.pi, (50, 3)):
        world_from_base = Rotation.from_euler("ZYX", rpy[::-1])
        expected = world_from_base.inv().apply([0, 0, -9.81])
        np.testing.assert_allclose(gravity_in_base(*rpy), expected, atol=1e-14)


def test_an_arm_s_file_tilts_its_gravity(tmp_path):
    content = yaml.safe_load((CONFIG / "arms" / "mtmr.yaml").read_text())
    content["base_rpy"] = [0, 90, 45]  # degrees: the base's x axis points down
    file = tmp_path / "tilted.yaml"
    file.write_text(yaml.safe_dump(content))
    np.testing.assert_allclose(Arm.load(file).gravity, [9.81, 0, 0], atol=1e-14)


def test_constants_of_an_arm_cannot_be_written():
    arm = Arm.load("mtmr")
    for array in (arm.actuator_to_joint, arm.actuator_effort_limit):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_a_name_that_is_no_shipped_arm_is_refused():
    for name in ("psm1", "", "../../../arm", "/etc/passwd", "a\0b", "x" * 5000):
        with pytest.raises(ConfigError, match=r"arm: got .*, expected mtml, mtmr, psm, ecm, or "):
            Arm.load(name)
