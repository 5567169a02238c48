"""What every registered term promises to those who compensate, simulate, fit and file it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from made_up_arm import made_up_arm

from dvrk_gravity import TorqueModel, effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import LinearTerm, Range, State, Term

ARM = Arm.load("mtmr")
LEVELS = [0.01 * (j + 1) for j in range(ARM.n)]
BETA = {"beta": [0.3, -0.2, 0.4, 0.1, 0.05, 0.02, -0.03, 0.01, 0.02, 0.04]}
EDGES = {"valid_lower": [-0.8] * ARM.n, "valid_upper": [0.9] * ARM.n}
# Plausible parameters of each term, on the MTM or, of a term that an MTM has not, on a chain
# R-R-P-R; a new term needs an entry.
PARAMETERS: Mapping[str, Mapping[str, object]] = {
    "gravity": BETA,
    "link_weight": {
        "link_weight.link2": [0.6, -0.1, 0.01, 0.02],
        "link_weight.counterweight": [0.3, 0.0, 0.01, 0.0],
    },
    "coulomb_friction": {
        "coulomb_friction.joint_positive": LEVELS,
        "coulomb_friction.joint_negative": LEVELS[::-1],
        "coulomb_friction.motor_positive": [0.02] * ARM.n,
        "coulomb_friction.motor_negative": LEVELS,
    },
    "viscous_friction": {"viscous_friction.joint": LEVELS, "viscous_friction.motor": LEVELS},
    "torque_offset": {"torque_offset": LEVELS},
    "elastic_cable": {
        "elastic_cable.elbow_pitch": [0.1, -0.2, 0.3],
        "elastic_cable.wrist_pitch": [0.02, 0.03],
        **{f"elastic_cable.{name}": value for name, value in EDGES.items()},
    },
    "joint_spring": {
        "joint_spring.elbow_pitch": [0.0, 0.0, 0.3, 0.0, -0.2, 0.0, 0.0],
        "joint_spring.wrist_pitch": [0.0, 0.0, -0.2, 0.0, 0.1, 0.0, 0.0],
        "joint_spring.constant": LEVELS,
    },
    "directional_cable": {
        "directional_cable.positive.elbow_pitch": [0.1, 0.2],
        "directional_cable.negative.elbow_pitch": [-0.1, 0.3],
        "directional_cable.ratio": [0.5] * ARM.n,
        **{f"directional_cable.{name}": value for name, value in EDGES.items()},
    },
    "payload": {"payload.mass": 0.2, "payload.first_moment": [0.01, 0.0, 0.02]},
    "rotor_inertia": {"rotor_inertia.motor": LEVELS},
    "link_inertia": {
        "link_inertia.link2": [0.6, -0.1, 0.01, 0.0, 0.01, 0.0, 0.02, 0.0, 0.0, 0.02],
        "link_inertia.crank": [0.1, 0.01, 0.0, 0.0, 0.001, 0.0, 0.001, 0.0, 0.0, 0.001],
    },
    "stribeck_friction": {
        "stribeck_friction.joint": LEVELS,
        "stribeck_friction.joint_velocity": [0.3] * ARM.n,
        "stribeck_friction.motor": [0.01] * ARM.n,
        "stribeck_friction.motor_velocity": [0.2] * ARM.n,
    },
    "presliding_hysteresis": {
        "presliding_hysteresis.displacement": [0.02, 0.2],
        "presliding_hysteresis.joint.wrist_yaw": [0.01, 0.02],
        "presliding_hysteresis.motor.elbow_pitch": [0.03, 0.01],
    },
    "cogging": {
        "cogging.amplitude.outer_yaw": [0.02, 0.01],
        "cogging.cycles_per_revolution.outer_yaw": [6.0, 9.0],
        "cogging.phase.outer_yaw": [0.3, -1.0],
    },
    "contact": {"contact.above": [2.0] * ARM.n, "contact.above_position": [0.1] * ARM.n},
    "held_load": {
        "held_load.orders": [0, 0, 0, 1, 2, 0, 0],
        "held_load.mean.elbow_pitch": [0.1],
        "held_load.difference.elbow_pitch": [0.02],
        **{f"held_load.{name}": value for name, value in EDGES.items()},
    },
    "shown_torque": BETA
    | {"shown_torque.lower": [-0.05] * ARM.n, "shown_torque.upper": [0.1] * ARM.n},
}


def each(chosen):
    return pytest.mark.parametrize("effect", chosen, ids=lambda effect: effect.NAME)


EVERY = each(effects.terms())
LINEAR = [effect for effect in effects.terms() if issubclass(effect, LinearTerm)]
WHOLE_RANGE = Range(ARM.lower, ARM.upper)


@pytest.fixture(scope="module")
def chain(tmp_path_factory) -> Arm:
    return made_up_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture
def model(effect, chain) -> TorqueModel:
    """The model with a term's parameters; of some terms there are others' in it."""
    if effect.NAME not in PARAMETERS:
        pytest.fail(f"{effect.NAME} has no plausible parameters in this file: add an entry")
    arm = ARM if effect.schema(ARM) else chain
    return TorqueModel.from_parameters({"arm": arm.source, **PARAMETERS[effect.NAME]})


@pytest.fixture
def term(effect, model) -> Term:
    found = model.term(effect.NAME)
    assert found is not None
    return found


@pytest.fixture
def state(model) -> State:
    return motion(model.arm)


def motion(arm: Arm, count: int = 40) -> State:
    random = np.random.default_rng(1)
    q, qd, qdd = random.normal(size=(3, count, arm.n))
    return State(np.cumsum(0.1 * q, axis=0), qd, qdd)


def test_no_entry_of_this_file_is_of_a_term_that_there_is_not():
    assert set(PARAMETERS) == {effect.NAME for effect in effects.terms()}


@EVERY
def test_it_is_named_and_documented_and_its_parameters_have_units(effect, model):
    assert effect.__doc__
    assert effect.NAME.isidentifier()
    declared = effect.schema(model.arm)
    assert declared
    for entry in declared:
        assert entry.meaning
        if entry.kind.startswith("double"):
            assert entry.unit or entry.name.endswith("ratio"), entry.name


@EVERY
def test_it_is_absent_where_nothing_mentions_it(effect, model):
    assert effect.from_parameters(model.arm, {}) is None


@EVERY
def test_its_torque_is_finite_and_there(term, state):
    directed = State(state.q, direction=np.sign(state.qd))
    shown = [term.torque(motion) for motion in (state, State(state.q), directed)]
    for torque in shown:
        assert torque.shape == state.q.shape
        assert np.isfinite(torque).all()
    assert max(np.abs(torque).max() for torque in shown) > 1e-3


@EVERY
def test_a_saved_and_loaded_model_has_the_same_torque(effect, model, state, tmp_path):
    model.save(tmp_path / "model.yaml")
    loaded = TorqueModel.load(tmp_path / "model.yaml")
    np.testing.assert_allclose(
        loaded.term(effect.NAME).torque(state), model.term(effect.NAME).torque(state), atol=1e-12
    )
    np.testing.assert_allclose(loaded.torque_at(state), model.torque_at(state), atol=1e-12)


@each(LINEAR)
def test_its_columns_times_its_coefficients_are_its_torque(term, state):
    expected = term.torque(state)
    np.testing.assert_allclose(term.regressor(state) @ term.theta, expected, atol=1e-11)
    same = term.with_theta(term.theta)
    np.testing.assert_array_equal(same.torque(state), expected)
    np.testing.assert_allclose(term.reduced().torque(state), expected, atol=1e-12)


@EVERY
def test_its_evaluator_of_one_sample_is_its_torque(term, state):
    evaluate = term.prepare()
    rubs = term.friction_part(np.ones(state.q.shape[1])).any()
    for q, qd in zip(state.q, state.qd, strict=True):
        np.testing.assert_allclose(evaluate(q, None), term.torque(State(q)), atol=1e-12)
        if rubs:  # of others a compensator asks for no more than what holds them at rest
            np.testing.assert_allclose(evaluate(q, qd), term.torque(State(q, qd)), atol=1e-12)


@EVERY
def test_its_parts_with_and_without_friction_make_up_the_whole(term, state):
    all_of_it = np.ones(state.q.shape[1])
    moving = State(state.q, state.qd)
    parts = [part for part in term.split(all_of_it) if part is not None]
    total = sum(part.torque(moving) for part in parts)
    np.testing.assert_allclose(total, term.torque(moving), atol=1e-12)
    fused = term.prepare_parts(all_of_it)
    assert (fused is None) == (len(parts) == 1)
    if fused is not None:
        first, second = fused(state.q[0], state.qd[0])
        np.testing.assert_allclose(first, parts[0].torque(State(state.q[0])), atol=1e-12)
        np.testing.assert_allclose(first + second, total[0], atol=1e-12)


@each([effect for effect in effects.terms() if effect.full_speed is not Term.full_speed])
def test_below_its_full_speed_friction_is_not_whole(effect, term, state):
    pose = state.q[:1]
    slow, fast = (
        sum(
            sign * (term.torque(State(pose, sign * part * term.full_speed[None])) @ term.full_speed)
            for sign in (1.0, -1.0)
        )
        for part in (0.25, 0.5)
    )
    assert fast > slow


@each([effect for effect in effects.terms() if effect.FRICTION])
def test_its_friction_scales_with_the_part_and_never_drives(effect, term, state):
    whole = term.torque(state)
    part = np.full(state.q.shape[1], 0.3)
    np.testing.assert_allclose(term.scaled(part).torque(state), 0.3 * whole, atol=1e-12)
    if effect.COMPENSATED:  # what remembers the past may give back what it has stored
        assert ((whole * state.qd).sum(axis=1) >= -1e-12).all()


@each([effect for effect in LINEAR if effect.unknowns(ARM, WHOLE_RANGE)])
def test_what_a_fit_finds_of_it_is_what_its_columns_make(effect, state):
    unknowns = effect.unknowns(ARM, WHOLE_RANGE)
    scale = np.array([column.scale for column in unknowns.columns])
    coefficients = scale * np.random.default_rng(2).uniform(0.1, 1.0, len(scale))
    memory = unknowns.term.memory(state)
    made = unknowns.regressor(state, memory) @ coefficients
    found = unknowns.found(coefficients)
    np.testing.assert_allclose(found.torque(state), made, rtol=1e-9, atol=1e-9)
    assert unknowns.found(np.zeros(len(scale))) is None
    assert len({column.key for column in unknowns.columns}) == len(scale)
