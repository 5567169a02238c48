"""A torque evaluated for one sample is the model's own, term by term and as a whole."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.compensate import Settings, prepare_sum
from dvrk_gravity.effects import State, Term

# All of the friction is compensated: the torque to apply is the model's.
BASE = TorqueModel.load(MODEL_FILE).parameters() | {
    "friction_compensation.ratio": [1.0] * 7,
    "friction_compensation.dead_band": [0.0] * 7,
}
FRICTION = {
    "coulomb_friction.joint_positive": [0.01 * (j + 1) for j in range(7)],
    "coulomb_friction.joint_negative": [0.02] * 7,
    "coulomb_friction.motor_positive": [0.03] * 7,
    "coulomb_friction.motor_negative": [0.005 * j for j in range(7)],
    "stribeck_friction.joint": [0.01] * 7,
    "stribeck_friction.joint_velocity": [0.1] * 7,
    "viscous_friction.joint": [0.01] * 7,
    "viscous_friction.motor": [0.002 * j for j in range(7)],
}
MODELS = {
    "as shipped": BASE,
    "everything": BASE | FRICTION | {"elastic_cable.wrist_pitch": [0.1, -0.2, 0.3]},
    "console version 1": BASE | {"directional_cable.blend": "sine"},
    "constant cable": BASE | {"elastic_cable.outer_yaw": [0.1]},
    "tilted": BASE | {"gravity_vector": [1.0, -2.0, -9.0]},
    "no gravity": BASE | FRICTION | {"gravity_enabled": False},
}
POSITION = arrays.arrays(float, 7, elements=st.floats(-10.0, 10.0))
VELOCITY = st.none() | arrays.arrays(
    float, 7, elements=st.floats(-5.0, 5.0) | st.sampled_from([0.0, -0.0, 0.02, -0.02, 0.2, 1e-300])
)


@pytest.mark.parametrize("name", MODELS)
@given(q=POSITION, qd=VELOCITY)
def test_one_sample_has_the_model_s_torque(name, q, qd):
    compensated = Settings.from_parameters(MODELS[name])
    np.testing.assert_allclose(
        compensated.torque(q, qd), compensated.model.torque(q, qd), rtol=1e-12, atol=1e-12
    )
    for term in compensated.model.terms:
        np.testing.assert_allclose(
            term.prepare()(q, qd), term.torque(State(q, qd)), rtol=1e-12, atol=1e-12
        )


def test_answers_do_not_share_memory_with_one_another():
    evaluate = prepare_sum(Settings.from_parameters(MODELS["everything"]).model.terms)
    q, qd = np.full(7, 0.1), np.full(7, 0.3)
    first = evaluate(q, qd)
    kept = first.copy()
    evaluate(2 * q, -qd)
    np.testing.assert_array_equal(first, kept)


def test_no_terms_make_no_torque():
    np.testing.assert_array_equal(prepare_sum([])(np.ones(7), None), np.zeros(7))


def test_a_term_that_only_has_a_torque_is_evaluated_all_the_same():
    class Double(Term):
        NAME = "double"

        @classmethod
        def schema(cls, arm):
            return ()

        @classmethod
        def from_parameters(cls, arm, values):
            return cls()

        def parameters(self):
            return {}

        def torque(self, state):
            return 2.0 * state.q

    np.testing.assert_array_equal(prepare_sum([Double()])(np.ones(7), None), np.full(7, 2.0))
