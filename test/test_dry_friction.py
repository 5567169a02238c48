"""Friction that builds up over a milliradian after a reversal."""

import numpy as np
import pytest
from robots import UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import CoulombFriction, State
from dvrk_gravity.model import TorqueModel

GIVES = 1.4e-3  # rad: between two of the settings that a fit chooses from


@pytest.mark.parametrize("kind", ["joint", "motor"])
def test_after_a_reversal_it_goes_to_the_other_side_by_the_way_alone(kind):
    arm = Arm.load(UR5)
    values = {f"coulomb_friction.{kind}_positive": (2.0,) * 6,
              f"coulomb_friction.{kind}_displacement": (GIVES,) * 6}  # fmt: skip
    way = 10.0 * GIVES - np.abs(np.linspace(-10.0, 5.0, 301))[:, None] * GIVES * np.ones(6)
    qd = np.where(np.arange(301) < 200, 0.01, -0.3)[:, None] * np.ones(6)  # whatever the speed
    model = TorqueModel(arm, (CoulombFriction.from_parameters(arm, values),))
    back = np.linspace(0.0, 5.0, 101)[:, None]
    after = model.torque_at(State(way, qd))[200:]
    np.testing.assert_allclose(after, (4.0 * np.exp(-back) - 2.0) * np.ones(6), atol=1e-3)
    alone = model.torque_at(State(way[-1:], qd[-1:]))  # a sample without a past
    np.testing.assert_allclose(alone, -2.0)


def test_what_is_compensated_needs_no_past():
    arm = Arm.load(UR5)
    values = {"coulomb_friction.joint_positive": (2.0,) * 6,
              "coulomb_friction.joint_displacement": (0.5,) * 6}  # fmt: skip
    _, friction = CoulombFriction.from_parameters(arm, values).split(np.full(6, 0.7))
    random = np.random.default_rng(3)
    q, qd = random.normal(size=(2, 20, 6))  # in no order
    np.testing.assert_allclose(friction.torque(State(q, qd)), 1.4 * np.clip(qd / 0.02, -1, 1))
