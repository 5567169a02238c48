"""Stribeck friction, payload, zeros and biases, cogging, walls: as formulas, in files, moved."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from dvrk_gravity.arm import Arm
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import PlantFile
from dvrk_gravity.simulate.plant import Plant
from dvrk_gravity.terms import CoulombFriction, StribeckFriction, Term, ViscousFriction

ARM = Arm.load("mtmr")
ZERO = np.zeros(7)


def one(joint: int, value: float) -> np.ndarray:
    return np.eye(7)[joint] * value


def moving(*terms: Term) -> Plant:
    """A plant without weight."""
    truth = PlantFile.load("mtmr_28002")
    return Plant(TorqueModel(ARM, terms), truth.links, truth.rotor_inertia)


def stribeck(place: str, joint: int, level: float, velocity: float) -> StribeckFriction:
    values = {f"stribeck_friction.{place}": one(joint, level)}
    values[f"stribeck_friction.{place}_velocity"] = one(joint, velocity)
    term = StribeckFriction.from_parameters(ARM, {k: tuple(v) for k, v in values.items()})
    assert term is not None
    return term


@pytest.mark.parametrize("velocity", [0.02, -0.1, 0.25, 1.0])
def test_stribeck_friction_falls_with_the_square_of_the_speed(velocity):
    term = stribeck("joint", 3, 0.04, 0.2)
    expected = 0.04 * np.exp(-((velocity / 0.2) ** 2)) * np.sign(velocity)
    np.testing.assert_allclose(
        TorqueModel(ARM, (term,)).torque(ZERO, one(3, velocity)), one(3, expected), atol=1e-15
    )


def test_stribeck_friction_of_the_elbow_s_motor_follows_q2_plus_q3():
    term = stribeck("motor", 2, 0.04, 0.2)
    model = TorqueModel(ARM, (term,))
    turning = model.torque(ZERO, one(1, 0.05) + one(2, 0.05))
    np.testing.assert_allclose(turning[[1, 2]], 0.04 * np.exp(-0.25))
    np.testing.assert_allclose(model.torque(ZERO, one(1, 0.5) - one(2, 0.5)), ZERO, atol=1e-15)


def test_a_stribeck_level_wants_a_velocity():
    with pytest.raises(ConfigError, match="joint_velocity of wrist_pitch.*beside a level of 0.01"):
        TorqueModel.from_parameters({"stribeck_friction.joint": list(one(4, 0.01))})


@pytest.mark.parametrize("place", ["joint", "motor"])
def test_the_plant_breaks_away_at_the_level_and_runs_where_the_sum_of_friction_is_the_effort(place):
    level, coulomb, viscous, velocity = 0.004, 0.003, 0.001, 0.8
    rock = np.r_[np.full(6, 9.0), 0.0]
    plant = moving(
        CoulombFriction(ARM, rock + one(6, coulomb), rock + one(6, coulomb), ZERO, ZERO, ZERO),
        ViscousFriction(ARM, one(6, viscous), ZERO),
        stribeck(place, 6, level, velocity),
    )
    for sign in (1.0, -1.0):
        plant.reset(ZERO)
        for _ in range(50):
            plant.step(one(6, 0.0069 * sign))
        assert not plant.v.any()
        effort = 0.0071
        for _ in range(4000):
            plant.step(one(6, effort * sign))
            plant.q[6] = 0.0  # it may turn for ever
        # Beyond the hump of level exp(-(v / velocity)^2), viscous friction balances the effort.
        speed = brentq(
            lambda v: coulomb + viscous * v + level * np.exp(-((v / velocity) ** 2)) - effort, 2, 9
        )
        assert plant.v[6] * sign == pytest.approx(speed, rel=1e-4)


def test_the_compensator_applies_its_part_of_stribeck_friction():
    values = {
        "beta": [0.0] * 10,
        "stribeck_friction.joint": one(3, 0.04).tolist(),
        "stribeck_friction.joint_velocity": [0.2] * 7,
        "friction_compensation.ratio": [0.5] * 7,
        "friction_compensation.dead_band": [0.05] * 7,
    }
    settings = Settings.from_parameters(values)
    assert settings.torque(ZERO, one(3, 0.1))[3] == pytest.approx(0.02 * np.exp(-0.25))
    assert settings.torque(ZERO, one(3, 0.04))[3] == 0.0
