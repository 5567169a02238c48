"""What `replay` compares the compensator's answers with: the model's compensated part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.cli.replay import TOLERANCE, Result, compensation
from dvrk_gravity.effects import Gravity, Payload
from dvrk_gravity.model import TorqueModel
from testing.world import World

WHOLE, NO_BAND = np.ones(7), np.zeros(7)
# What an identification leaves in a model beside the weights, and the compensator does not apply;
# and what a diagnosis adds.
EFFECTS = {
    "presliding_hysteresis.displacement": [0.02],
    "presliding_hysteresis.joint.elbow_pitch": [0.05],
    "torque_offset": [0.1] * 7,
    "contact.above": [2.0] * 7,
    "contact.above_position": [0.0] * 7,
    "joint_offset": [0.0, 0.03, -0.02, 0.0, 0.05, 0.0, 0.0],
    "gravity_vector": [0.4, -0.3, -9.8],
    "payload.mass": 0.2,
    "payload.first_moment": [0.01, 0.0, 0.02],
    "payload.link": "link4",
    "viscous_friction.motor": [0.0, 0.0, 0.02, 0.01, 0.0, 0.0, 0.0],
    "stribeck_friction.joint": [0.01, 0.02, 0.01, 0.01, 0.002, 0.002, 0.001],
    "stribeck_friction.joint_velocity": [0.2] * 7,
    "cogging.amplitude.outer_yaw": [0.01],
    "cogging.cycles_per_revolution.outer_yaw": [6.0],
    "cogging.phase.outer_yaw": [0.3],
}


@pytest.fixture(scope="module")
def model() -> TorqueModel:
    """Return a model with all that an identification writes and a diagnosis adds."""
    return TorqueModel.from_parameters(World.draw(5).model().parameters() | EFFECTS)


def test_the_reference_has_what_an_arm_is_compensated_with_and_nothing_else(model):
    random = np.random.default_rng(2)
    q, qd = random.uniform(-0.4, 0.4, (50, 7)), random.uniform(-1.0, 1.0, (50, 7))
    true_q = q - EFFECTS["joint_offset"]
    still = np.zeros((50, 7))
    # Weights as a model of them alone has them, at rest: no inertia of link, rotor or payload.
    weights = TorqueModel(
        model.arm, tuple(term for term in model.terms if isinstance(term, Gravity | Payload))
    )
    own = {"elastic_cable", "coulomb_friction", "viscous_friction", "stribeck_friction", "cogging"}
    others = TorqueModel(model.arm, tuple(term for term in model.terms if own & {term.NAME}))
    assert len(others.terms) == len(own)
    expected = weights.torque(true_q, still, still) + others.torque(true_q, qd)
    assert compensation(model, q, qd, WHOLE, NO_BAND) == pytest.approx(expected, abs=1e-12)
    # The rest is not small: a reference that held it could not pass.
    assert np.abs(model.torque(q, qd) - expected).max() > 0.1


def test_of_friction_the_reference_has_the_part_above_the_dead_band_that_is_asked_for():
    friction = {
        "beta": [0.0] * 10,
        "coulomb_friction.joint_positive": [0.2] * 7,
        "coulomb_friction.transition_velocity": [0.0] * 7,
        "viscous_friction.joint": [0.1] * 7,
    }
    model = TorqueModel.from_parameters(friction)
    qd = np.array([[0.04, -0.04, 0.05, -0.06, 1.0, -1.0, 0.0]])
    part = np.array([0.7, 0.7, 0.7, 0.7, 0.5, 0.0, 1.0])
    torque = compensation(model, np.zeros((1, 7)), qd, part, np.full(7, 0.05))
    assert torque[0] == pytest.approx(
        [0.0, 0.0, 0.7 * (0.2 + 0.005), -0.7 * (0.2 + 0.006), 0.5 * (0.2 + 0.1), 0.0, 0.0]
    )


def test_without_a_velocity_the_reference_has_no_friction(model):
    q = np.random.default_rng(3).uniform(-0.4, 0.4, (5, 7))
    smooth = replace(model, terms=tuple(term for term in model.terms if not term.FRICTION))
    assert compensation(model, q, None, WHOLE, NO_BAND) == pytest.approx(
        compensation(smooth, q, np.zeros((5, 7)), WHOLE, NO_BAND), abs=1e-12
    )


def test_a_replay_passes_if_all_was_answered_in_order_and_right():
    good = Result(5, 4, 4, True, 0.5 * TOLERANCE, 1.0, "N·m")
    assert good.passed
    for change in (
        {"answered": 3}, {"valid": 0, "answered": 0}, {"in_order": False},
        {"largest_difference": None}, {"largest_difference": 2.0 * TOLERANCE},
    ):  # fmt: skip
        assert not replace(good, **change).passed, change
