"""A torque evaluated for one sample is the model's own, term by term and as a whole."""

from __future__ import annotations

import numpy as np
from supervisor_loop import BASE

from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import State

# All of the friction is compensated: the torque to apply is the model's.
WHOLE = BASE | {
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
    "as shipped": WHOLE,
    "everything": WHOLE | FRICTION | {"elastic_cable.wrist_pitch": [0.1, -0.2, 0.3]},
    "console version 1": WHOLE | {"directional_cable.blend": "sine"},
    "constant cable": WHOLE | {"elastic_cable.outer_yaw": [0.1]},
    "tilted": WHOLE | {"gravity_vector": [1.0, -2.0, -9.0]},
    "no gravity": WHOLE | FRICTION | {"gravity_enabled": False},
}


def test_one_sample_has_the_model_s_torque():
    rng = np.random.default_rng(0)
    edges = np.array([0.0, -0.0, 0.02, -0.02, 0.2, 1e-300, -5.0])
    states = [(np.full(7, 9.0), None), (np.zeros(7), edges), (rng.uniform(-10, 10, 7), edges[::-1])]
    states += [(rng.uniform(-10, 10, 7), rng.uniform(-1, 1, 7)) for _ in range(12)]
    for name, values in MODELS.items():
        settings = Settings.from_parameters(values)
        for q, qd in states:
            whole = settings.model.torque(q, qd)
            np.testing.assert_allclose(settings.torque(q, qd), whole, 1e-12, 1e-12, err_msg=name)
            for term in settings.model.terms:
                alone = term.torque(State(q, qd))
                np.testing.assert_allclose(term.prepare()(q, qd), alone, rtol=1e-12, atol=1e-12)


def test_answers_do_not_share_memory_with_one_another():
    evaluate = Settings.from_parameters(MODELS["everything"]).torque
    q, qd = np.full(7, 0.1), np.full(7, 0.3)
    first = evaluate(q, qd)
    kept = first.copy()
    evaluate(2 * q, -qd)
    np.testing.assert_array_equal(first, kept)
