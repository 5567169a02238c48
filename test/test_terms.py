"""Each physical term as a formula: what it claims about torque, and that friction dissipates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from made_up_arm import made_up_arm

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import (
    SLOWEST,
    CoulombFriction,
    DirectionalCable,
    ElasticCable,
    PreslidingHysteresis,
    State,
    StribeckFriction,
    Term,
    ViscousFriction,
    secant_damping,
)
from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.model import TorqueModel

ARM = Arm.load("mtmr")
SHOULDER, ELBOW, PLATFORM = 1, 2, 3
VELOCITIES = arrays(float, 7, elements=st.floats(-20, 20))
LEVELS = arrays(float, 7, elements=st.floats(0, 5))
RATIOS = arrays(float, 7, elements=st.floats(0, 1))


def only(joint: int, value: float) -> np.ndarray:
    return np.eye(7)[joint] * value


def built(term: type[Term], **values) -> Term:
    """Return the term from parameters named without its own name in front."""
    named = {f"{term.NAME}.{name.replace('__', '.')}": v for name, v in values.items()}
    return term_of(**named)


def term_of(**values) -> Term:
    """Return the only term of a model with these parameters."""
    listed = {k: v if isinstance(v, str) else np.ravel(v).tolist() for k, v in values.items()}
    (term,) = TorqueModel.from_parameters({"arm": "mtmr", **listed}).terms
    return term


def torque(term, q=None, qd=None, direction=None) -> np.ndarray:
    return term.torque(State.of(np.zeros(7) if q is None else q, qd, direction=direction))


def test_arrays_whose_shape_is_not_that_of_the_positions_are_refused():
    for shape in [(), (6,), (8,), (7, 3), (2, 0)]:
        with pytest.raises(ShapeError, match=r"^q has shape"):
            State.of(np.zeros(shape), joints=7)
    for name in ("qd", "qdd", "direction"):
        for shape in [(7,), (5, 6), (4, 7), (1, 7), ()]:
            with pytest.raises(ShapeError, match=rf"^{name} has shape .*, expected \(5, 7\)"):
                State.of(np.zeros((5, 7)), **{name: np.zeros(shape)})


# --- cables ----------------------------------------------------------------------------------


def test_elastic_torque_is_the_polynomial_of_its_own_joint_only():
    term = built(ElasticCable, elbow_pitch=[1.0, 2.0, 3.0], wrist_roll=[0.5])
    q = np.random.default_rng(0).uniform(-2, 2, (20, 7))
    expected = np.zeros((20, 7))
    expected[:, ELBOW] = 1.0 + 2.0 * q[:, ELBOW] + 3.0 * q[:, ELBOW] ** 2
    expected[:, 6] = 0.5
    np.testing.assert_allclose(torque(term, q), expected, atol=1e-14)


@pytest.mark.parametrize("term", [ElasticCable, DirectionalCable])
def test_outside_the_fitted_range_the_torque_is_that_of_the_edge(term):
    coefficients = [0.1, -0.7, 2.0, 5.0, -9.0]
    names = ["elbow_pitch"] if term is ElasticCable else ["positive.elbow_pitch"]
    if term is DirectionalCable:
        names.append("negative.elbow_pitch")
    lower, upper = np.full(7, -0.6), np.full(7, 0.5)
    cable = built(term, valid_lower=lower, valid_upper=upper, **dict.fromkeys(names, coefficients))
    at_edges = [np.polyval(coefficients[::-1], edge) for edge in (-0.6, 0.5)]
    for q, expected in ((-0.6, 0), (-0.7, 0), (-40.0, 0), (0.5, 1), (0.50001, 1), (1e6, 1)):
        assert torque(cable, only(ELBOW, q))[ELBOW] == pytest.approx(at_edges[expected])
    assert torque(cable, only(ELBOW, 0.2))[ELBOW] == pytest.approx(
        np.polyval(coefficients[::-1], 0.2)
    )


def cable(**values) -> DirectionalCable:
    """Cable whose half difference is 1 N·m and whose mean is 3 N·m, on every joint."""
    sets = {f"positive.{joint}": [4.0] for joint in JOINT_NAMES}
    sets |= {f"negative.{joint}": [2.0] for joint in JOINT_NAMES}
    given_values = {"dead_band": [0.1] * 7, "saturation_velocity": [0.5] * 7} | values
    return built(DirectionalCable, **sets, **given_values)


@pytest.mark.parametrize("blend", ["linear", "sine"])
def test_blend_is_odd_in_velocity_and_never_more_than_the_ratio(blend):
    ratio = np.linspace(0, 1, 7)
    term = cable(ratio=ratio, blend=blend)
    qd = np.random.default_rng(1).normal(0, 0.4, (500, 7))
    q = np.zeros_like(qd)
    forth, back = torque(term, q, qd) - 3.0, torque(term, q, -qd) - 3.0
    np.testing.assert_allclose(forth, -back, atol=1e-14)
    assert (np.abs(forth) <= ratio + 1e-14).all()
    assert (forth * qd >= 0).all()


@pytest.mark.parametrize("blend", ["linear", "sine"])
def test_blend_is_nothing_in_the_dead_band_and_the_ratio_from_saturation_on(blend):
    ratio = np.linspace(0.1, 1, 7)
    term = cable(ratio=ratio, blend=blend)
    for speed in (0.0, 0.05, 0.0999, -0.0999):
        np.testing.assert_allclose(torque(term, qd=np.full(7, speed)), 3.0)
    for speed in (0.5, 0.6, 100.0):
        np.testing.assert_allclose(torque(term, qd=np.full(7, speed)), 3.0 + ratio)
        np.testing.assert_allclose(torque(term, qd=np.full(7, -speed)), 3.0 - ratio)


def test_blend_rises_as_the_console_s_two_versions_have_it():
    """Version 2.0: linear. Version 1.0: a quarter of a sine from speed zero on, ratio one."""
    qd = np.full(7, 0.2)
    np.testing.assert_allclose(torque(cable(), qd=qd), 3.25)
    first = cable(dead_band=[0.0] * 7, saturation_velocity=[0.6] * 7, blend="sine")
    np.testing.assert_allclose(torque(first, qd=qd), 3.5)  # sin(pi/2 · 1/3) = 1/2


def test_a_pose_s_direction_overrides_the_velocity_and_the_ratio():
    term = cable(ratio=[0.3] * 7)
    direction = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    for qd in (None, np.zeros(7), -10 * direction):
        np.testing.assert_allclose(torque(term, qd=qd, direction=direction), 3.0 + direction)


def test_the_arm_itself_has_the_whole_difference_whatever_the_console_applies():
    model = TorqueModel(ARM, (cable(ratio=[0.3] * 7),)).physical()
    np.testing.assert_allclose(model.torque(np.zeros(7), np.full(7, 2.0)), 4.0)


def test_a_blend_that_cannot_rise_is_refused_with_the_joint_s_name():
    with pytest.raises(ConfigError, match=r"dead_band of elbow_pitch: got .*, expected less than"):
        cable(dead_band=only(ELBOW, 0.5))
    with pytest.raises(ConfigError, match=r"ratio: got .*1\.5.*, expected 0 to 1"):
        cable(ratio=only(ELBOW, 1.5))


# --- friction --------------------------------------------------------------------------------


def test_joint_friction_acts_along_its_joint_s_motion_with_a_level_for_each_direction():
    term = built(CoulombFriction, joint_positive=[0.3] * 7, joint_negative=[0.1] * 7)
    np.testing.assert_allclose(torque(term, qd=np.full(7, 0.5)), 0.3)
    np.testing.assert_allclose(torque(term, qd=np.full(7, -0.5)), -0.1)


def test_the_elbow_motor_s_friction_follows_q2_plus_q3_and_loads_both_joints():
    term = built(CoulombFriction, motor_positive=only(ELBOW, 0.2))
    expected = only(SHOULDER, 0.2) + only(ELBOW, 0.2)
    # The elbow moves up, but its motor turns down.
    qd = only(SHOULDER, -0.9) + only(ELBOW, 0.5)
    np.testing.assert_allclose(torque(term, qd=qd), -expected)
    np.testing.assert_allclose(torque(term, qd=-qd), expected)
    # Both move, the motor does not.
    np.testing.assert_allclose(torque(term, qd=only(SHOULDER, -0.5) + only(ELBOW, 0.5)), 0.0)


def test_friction_rises_linearly_up_to_the_transition_velocity():
    term = built(CoulombFriction, joint_positive=[0.4] * 7, transition_velocity=[0.1] * 7)
    for speed, part in ((0.0, 0.0), (0.025, 0.25), (-0.05, -0.5), (0.1, 1.0), (3.0, 1.0)):
        np.testing.assert_allclose(torque(term, qd=np.full(7, speed)), 0.4 * part)


@pytest.mark.parametrize("transition", [0.0, 0.02, 5.0])
def test_a_pose_s_direction_has_full_friction_whatever_the_velocity(transition):
    term = built(
        CoulombFriction,
        joint_positive=[0.3] * 7,
        joint_negative=[0.1] * 7,
        transition_velocity=[transition] * 7,
    )
    direction = np.array([1.0, -1.0, 1.0, -1.0, 0.0, 1.0, -1.0])
    expected = np.where(direction > 0, 0.3, np.where(direction < 0, -0.1, 0.0))
    for qd in (None, np.zeros(7), -direction):
        np.testing.assert_allclose(torque(term, qd=qd, direction=direction), expected)


@given(LEVELS, LEVELS, LEVELS, LEVELS, LEVELS, VELOCITIES)
def test_coulomb_friction_never_gives_power_back(up, down, motor_up, motor_down, transition, qd):
    at_once = np.zeros(ARM.n)
    term = CoulombFriction(ARM, up, down, motor_up, motor_down, transition, at_once, at_once)
    assert qd @ torque(term, qd=qd) >= -1e-12


@given(LEVELS, LEVELS, VELOCITIES)
def test_viscous_friction_is_linear_and_never_gives_power_back(joint, motor, qd):
    term = ViscousFriction(ARM, joint, motor)
    friction = torque(term, qd=qd)
    assert qd @ friction >= -1e-10
    np.testing.assert_allclose(torque(term, qd=-2.5 * qd), -2.5 * friction, atol=1e-10)
    motor_velocity = ARM.actuator_position(qd)
    power = joint @ qd**2 + motor @ motor_velocity**2
    assert qd @ friction == pytest.approx(power, abs=1e-9)


def test_friction_that_nobody_measured_is_a_part_of_what_a_joint_can():
    psm = Arm.load("psm")
    for effect, part in ((CoulombFriction, 0.02), (ViscousFriction, 0.01)):
        rubs = effect.nominal(psm).torque(State(np.zeros(psm.n), psm.scale))
        np.testing.assert_allclose(rubs, part * psm.effort_limit)


def stribeck(site: str, joint: int, level: float, velocity: float) -> Term:
    values = {site: only(joint, level), f"{site}_velocity": only(joint, velocity)}
    return built(StribeckFriction, **values)


def test_stribeck_friction_falls_with_the_square_of_the_speed():
    term = stribeck("joint", PLATFORM, 0.04, 0.2)
    for speed in (0.02, -0.1, 0.25, 1.0):
        expected = 0.04 * np.exp(-((speed / 0.2) ** 2)) * np.sign(speed)
        np.testing.assert_allclose(
            torque(term, qd=only(PLATFORM, speed)), only(PLATFORM, expected), atol=1e-15
        )
    for way in (1.0, -1.0):
        assert torque(term, direction=only(PLATFORM, way))[PLATFORM] == way * 0.04
    of_motor = stribeck("motor", ELBOW, 0.04, 0.2)
    turning = torque(of_motor, qd=only(SHOULDER, 0.05) + only(ELBOW, 0.05))
    np.testing.assert_allclose(turning, 0.04 * np.exp(-0.25) * (only(SHOULDER, 1) + only(ELBOW, 1)))
    assert not torque(of_motor, qd=only(SHOULDER, 0.5) - only(ELBOW, 0.5)).any()


def test_of_a_joint_that_slides_a_speed_that_is_not_given_is_a_tenth(tmp_path):
    arm = made_up_arm(tmp_path)  # its third joint slides
    given = {"stribeck_friction.joint": (1.0, 0.0, 0.0, 0.0)}
    given |= {"stribeck_friction.joint_velocity": (0.3, 0.0, 0.0, 0.0)}
    term = StribeckFriction.from_parameters(arm, given)
    speeds = term.with_theta(np.ones(2 * arm.n)).parameters()["stribeck_friction.joint_velocity"]
    np.testing.assert_allclose(np.array(speeds) / speeds[1], [0.3 / speeds[1], 1.0, 0.1, 1.0])


def presliding(displacement: float, level: float) -> PreslidingHysteresis:
    joint = only(PLATFORM, level)[None]
    return PreslidingHysteresis(ARM, np.array([displacement]), joint, np.zeros((1, 7)))


def test_presliding_builds_up_over_its_displacement():
    level, displacement = 0.02, 0.03
    way = np.linspace(0.0, 0.3, 400)
    there_and_back = np.concatenate([way, way[-2::-1]])
    q = there_and_back[:, None] * only(PLATFORM, 1.0)
    motion = State(q, np.gradient(q, 0.005, axis=0))
    friction = presliding(displacement, level).torque(motion)[:, PLATFORM]
    assert friction[399] == pytest.approx(level)
    back = 0.3 - there_and_back[399:]
    # Dahl 1968, solved: from +level towards -level.
    expected = level * (2.0 * np.exp(-back / displacement) - 1.0)
    np.testing.assert_allclose(friction[399:], expected, atol=1e-9)
    # A simulator's stiffness is the slope of the torque: steepest where the way turns back.
    elements, back = presliding(displacement, level).plant().memory, -1e-7 * only(PLATFORM, 1.0)
    elements.go(0.02 * only(PLATFORM, 1.0))
    begin, stiffness = elements.torque(back)
    elements.go(back)
    np.testing.assert_allclose(elements.torque(back)[0] - begin, stiffness @ back, rtol=2e-6)


def test_presliding_is_full_where_a_pose_was_approached_and_relaxed_at_rest():
    term = presliding(0.02, 0.01)
    direction = np.array([[1.0] * 7, [-1.0] * 7])
    np.testing.assert_allclose(
        torque(term, np.zeros((2, 7)), direction=direction), direction * only(PLATFORM, 0.01)
    )
    assert not torque(term).any()
    q = np.linspace(0.0, 0.001, 50)[:, None] * np.ones(7)
    for first, slides in ((0.1, 1.0), (-0.1, -1.0), (0.0, 0.0), (1e-16, 0.0), (-1e-16, 0.0)):
        qd = np.full_like(q, 0.1)
        qd[0] = first
        assert term.torque(State(q, qd))[0, PLATFORM] == pytest.approx(0.01 * slides, abs=1e-15)


# --- what the compensator takes of it --------------------------------------------------------


def all_terms() -> TorqueModel:
    seven = [0.1 * k for k in range(1, 8)]
    values = {"arm": "mtmr", "beta": [0.3, -0.2, 0.4, 0.1, 0.05, 0.02, -0.03, 0.01, 0.02, 0.04]}
    values |= {f"elastic_cable.{joint}": [0.1, 0.2] for joint in JOINT_NAMES}
    values |= {f"directional_cable.positive.{joint}": [0.3, 0.1] for joint in JOINT_NAMES}
    values |= {f"directional_cable.negative.{joint}": [0.1, 0.2] for joint in JOINT_NAMES}
    values |= {"coulomb_friction.joint_positive": seven, "coulomb_friction.motor_positive": seven}
    values |= {"joint_spring.constant": seven}
    values |= {"viscous_friction.joint": seven, "viscous_friction.motor": seven}
    values |= {"stribeck_friction.joint": seven, "stribeck_friction.joint_velocity": [0.5] * 7}
    return TorqueModel.from_parameters(values)


def test_the_gravity_flag_leaves_out_gravity_and_nothing_else():
    model = all_terms()
    q, qd = np.full(7, 0.2), np.full(7, 0.4)
    weight = model.term("gravity").torque(State(q))
    assert np.abs(weight).max() > 0.1
    without = TorqueModel.from_parameters(model.parameters() | {"gravity_enabled": False})
    np.testing.assert_allclose(without.torque(q, qd), model.torque(q, qd) - weight, atol=1e-14)
    batch = np.tile(q, (3, 1))
    np.testing.assert_array_equal(without.term("gravity").torque(State(batch)), np.zeros((3, 7)))


def compensated(ratio, dead_band=(0.0,) * 7) -> Settings:
    values = all_terms().parameters()
    values["friction_compensation.ratio"] = tuple(np.asarray(ratio, dtype=float).tolist())
    values["friction_compensation.dead_band"] = tuple(dead_band)
    return Settings.from_parameters(values)


FULL, NONE = compensated(np.ones(7)), compensated(np.zeros(7))


def test_at_full_ratio_the_compensator_applies_the_model():
    q, qd = np.random.default_rng(2).uniform(-1, 1, (2, 50, 7))
    for position, velocity in zip(q, qd, strict=True):
        np.testing.assert_allclose(
            FULL.torque(position, velocity), FULL.model.torque(position, velocity), atol=1e-14
        )
        np.testing.assert_allclose(
            FULL.torque(position, None), FULL.model.torque(position), atol=1e-14
        )


@given(RATIOS, VELOCITIES)
def test_compensation_never_pushes_with_more_power_than_friction_takes(ratio, qd):
    """Whatever the ratios: with more the arm would run away on its own."""
    q = np.full(7, 0.2)
    without = NONE.torque(q, qd)
    friction = FULL.torque(q, qd) - without
    terms = (term.scaled(ratio) for term in FULL.model.terms if term.FRICTION)
    pushed = sum(term.torque(State(q, qd)) for term in terms)
    assert -1e-10 <= qd @ pushed <= qd @ friction + 1e-10


def test_below_the_dead_band_no_friction_is_compensated():
    banded = compensated(np.ones(7), (0.3,) * 7)
    q = np.full(7, 0.2)
    for speed in (0.0, 0.1, -0.29):
        qd = np.full(7, speed)
        np.testing.assert_allclose(banded.torque(q, qd), NONE.torque(q, qd), atol=1e-14)
    qd = np.full(7, 0.31)
    np.testing.assert_allclose(banded.torque(q, qd), FULL.torque(q, qd), atol=1e-14)


def test_the_compensator_applies_neither_inertia_nor_what_needs_a_past():
    values = {
        "arm": "mtmr",
        "beta": [0.1] * 10,
        "link_inertia.link2": [1.0] * 10,
        "rotor_inertia.motor": [0.1] * 7,
        "presliding_hysteresis.displacement": [0.1],
        "presliding_hysteresis.joint.wrist_platform": [0.02],
    }
    plain = Settings.from_parameters({"arm": "mtmr", "beta": [0.1] * 10})
    q, qd = np.random.default_rng(8).normal(size=(2, 7))
    np.testing.assert_array_equal(
        Settings.from_parameters(values).torque(q, qd), plain.torque(q, qd)
    )


def test_any_friction_is_a_damping_that_makes_it_and_gives_no_energy_however_slow():
    random, n = np.random.default_rng(0), 3
    root = random.normal(size=(n, n))
    for torque, coupled in (
        (lambda q, v: np.array([0.3, 0.1, 2.0]) * np.sign(v) + 0.5 * v, False),
        (lambda q, v: root @ root.T @ v, True),
    ):
        for speed in (3.0, 0.05, 1e-9):
            v = speed * np.array([1.0, -0.3, 0.01])
            friction = torque(np.zeros(n), v)
            taken, damping = secant_damping(torque)(np.zeros(n), v)
            assert not taken.any()
            assert bool(np.any(damping - np.diag(np.diag(damping)))) == coupled
            values = np.linalg.eigvalsh(damping)
            assert values.min() >= -1e-12 * values.max()
            most = np.linalg.norm(friction) / SLOWEST
            assert values.max() <= most * (1.0 + 1e-9)
            if speed > 1e-3:
                np.testing.assert_allclose(damping @ v, friction, rtol=1e-5)
            elif coupled:
                assert values.max() == pytest.approx(most)
    explicit, damping = secant_damping(lambda q, v: -v)(np.zeros(n), np.ones(n))
    assert (explicit.tolist(), damping.any()) == ([-1.0] * n, False)
