"""Encoders that read too far, springs between joints, a base that leans: columns, and found once.

The columns are checked against sympy, MuJoCo's tendons and rotations of Pinocchio; then each effect
is hidden in a small arm, found by a diagnosis, and explained by its extended model.
"""

from __future__ import annotations

from dataclasses import replace

import diagnosed
import known_ecm
import mujoco
import numpy as np
import pinocchio as pin
import pytest
import sympy
from known_ecm import INSERTION, PITCH, ROLL
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from unresolved_causes import passed

from dvrk_gravity import effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import Diagnosis, MeasuredMotion, diagnose, extended, load
from dvrk_gravity.effects import (
    JointCoupling,
    JointFlexibility,
    JointSpring,
    ReadingHypothesis,
    Site,
    State,
    base_tilt,
)
from dvrk_gravity.model import ModelUncertainty, TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile

PENDULUM = """
name: pendulum
joints:
  - {name: swing, alpha: 90, a: 0.0, d: 0.0, offset: 0, lower: -170, upper: 170, effort_limit: 5}
base_rpy: [90, 0, 0]
"""


@pytest.fixture(scope="module")
def motion() -> MeasuredMotion:
    return load([known_ecm.recorded(1)], known_ecm.model())


def first_of(diagnosis: Diagnosis, effect: str, *joints: int):
    """Return the only finding, if it is of this effect at these joints and in the model."""
    (found,) = diagnosis.findings
    assert (found.effect, found.joints) == (
        effect, tuple(known_ecm.ARM.joint_names[joint] for joint in joints),
    )  # fmt: skip
    assert found.in_model
    assert found.certain
    return found.parameters


def unexplained(model: TorqueModel, seed: int, **truth) -> np.ndarray:
    """Return (n,) RMS of what a model misses of another recording, in units of its noise."""
    recording = known_ecm.recorded(seed, 6.0, **truth)
    _, q, qd, qdd = known_ecm.motion(seed, 6.0)
    error = recording.effort - model.torque(q, qd, qdd)
    return np.sqrt(np.mean(error**2, axis=0)) / known_ecm.NOISE


# --- encoders --------------------------------------------------------------------------------


def test_an_encoder_s_column_is_the_derivative_of_a_pendulum_s_torque_by_its_factor(tmp_path):
    """tau = m g l sin(q / f) + I qdd / f + d qd / f, differentiated by hand and by sympy."""
    path = tmp_path / "pendulum.yaml"
    path.write_text(PENDULUM)
    moment, inertia, damping = 0.3, 0.04, 0.02
    model = TorqueModel.from_parameters(
        {
            "arm": str(path),
            "link_weight.link1": [1.0, moment, 0.0, 0.0],
            "link_inertia.link1": [1.0, moment, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, inertia],
            "viscous_friction.joint": [damping],
        }
    )
    time = np.arange(900) / 100.0
    q = 0.9 * np.sin(2.0 * time)[:, None]
    qd, qdd = 1.8 * np.cos(2.0 * time)[:, None], -3.6 * np.sin(2.0 * time)[:, None]
    bare = load([Recording(("swing",), time, q, qd, 0.0 * q + 1e-3 * qd)], model)
    made = replace(bare, q=q, qd=qd, qdd=qdd, time=time, parts=(slice(0, len(q)),), effort=0.0 * q)
    hypothesis = ReadingHypothesis(
        arm=model.arm, site=Site.joint(0), joints=(0,), setting={"factor": 1.0}
    )
    column = hypothesis.regressor(made)[:, 0, 0]
    f, x, v, a, c, i, d, phase = sympy.symbols("f x v a c i d phase")
    torque = c * sympy.cos(x / f + phase) + i * a / f + d * v / f
    slope = sympy.lambdify((x, v, a, c, i, d, phase), sympy.diff(torque, f).subs(f, 1))
    # Amplitude and phase of the weight, from the model at rest.
    weight = [float(model.torque(np.array([angle]))[0]) for angle in (0.0, -0.5 * np.pi)]
    size, turn = np.hypot(*weight), np.arctan2(weight[1], weight[0])
    pushed = float(model.torque([0.0], [0.0], [1.0])[0]) - weight[0]
    expected = slope(q[:, 0], qd[:, 0], qdd[:, 0], size, pushed, damping, turn)
    np.testing.assert_allclose(column, expected, atol=1e-5 * np.abs(expected).max())


def test_where_a_fit_on_its_way_asks_for_no_encoder_its_column_is_finite(motion):
    for factor, plausible in ((-3.0, False), (0.0, False), (1e9, False), (0.6, True), (1.9, True)):
        supposed = ReadingHypothesis(
            arm=motion.arm, site=Site.joint(PITCH), setting={"factor": factor}
        )
        assert np.isfinite(supposed.regressor(motion)).all()
        assert supposed.plausible(np.array([factor - 1.0])) == plausible, factor


def test_an_encoder_that_was_homed_elsewhere_is_found_with_its_offset():
    """An incremental encoder is set where the arm is switched on, and counts wrongly from there."""
    factor, home = 1.08, 0.5
    unit, right = np.eye(4)[PITCH], known_ecm.recorded(1)
    offset = (1.0 - factor) * home
    scale = 1.0 + (factor - 1.0) * unit
    read = replace(
        right, position=right.position * scale + offset * unit, velocity=right.velocity * scale
    )
    diagnosis = diagnose(read, known_ecm.model())
    found = first_of(diagnosis, "encoder_scale", PITCH)
    for name, truth in (("factor", factor), ("offset", offset)):
        assert found[name].low <= truth <= found[name].high
    assert found["factor"].value == pytest.approx(factor, abs=0.005)
    known = diagnosis.model.of_readings()["reading.encoder_scale"]
    assert known == pytest.approx(1.0 + (found["factor"].value - 1.0) * unit)
    # Of the true position: the reading at the encoder's zero, divided by the factor.
    zero = found["offset"].value / found["factor"].value
    assert diagnosis.model.joint_offset == pytest.approx(zero * unit)


# --- springs between joints ------------------------------------------------------------------

ARM = Arm.load("mtmr")
FIRST, SECOND = 2, 4  # elbow_pitch, wrist_pitch
STIFFNESS, RATIO, SLACK = 0.3, -0.7, 0.2  # at the first joint, N·m/rad; rad
ROW = np.eye(ARM.n)[FIRST] + RATIO * np.eye(ARM.n)[SECOND]
SPRING = JointSpring(ARM, STIFFNESS * np.outer(ROW, ROW), -STIFFNESS * SLACK * ROW)


def test_a_spring_s_torque_is_that_of_a_tendon_of_mujoco_over_two_joints():
    """A chain whose joints all turn about one axis."""
    bodies = "".join(
        f'<body pos="0.1 0 0"><joint name="j{i}" axis="0 0 1"/><geom size="0.02"/>'
        for i in range(ARM.n)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/><worldbody>{bodies}{"</body>" * ARM.n}</worldbody>
        <tendon><fixed stiffness="{STIFFNESS}" springlength="{SLACK}">
        <joint joint="j{FIRST}" coef="1"/><joint joint="j{SECOND}" coef="{RATIO}"/>
        </fixed></tendon></mujoco>"""
    )
    data = mujoco.MjData(model)
    for q in np.random.default_rng(1).normal(size=(20, ARM.n)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        # The actuators apply what holds the arm against it.
        np.testing.assert_allclose(SPRING.torque(State(q)), -data.qfrc_spring, atol=1e-12)


def test_a_simulated_arm_rests_where_a_spring_between_joints_is_slack():
    damping = {"viscous_friction.joint": [0.05] * ARM.n, "arm": "mtmr"}
    weightless = TorqueModel.from_parameters(damping | SPRING.parameters())
    plant = replace(PlantFile.load("mtmr_28002"), model=weightless).plant()
    plant.reset(np.zeros(ARM.n))
    for _ in range(2000):
        plant.step(np.zeros(ARM.n), dt=3e-3)
    assert plant.q @ ROW == pytest.approx(SLACK, abs=1e-3)


def test_a_spring_that_is_found_adds_to_those_that_the_model_has():
    held = 2.0 * np.outer(*2 * (np.eye(4)[PITCH] - np.eye(4)[ROLL],))
    names = known_ecm.ARM.joint_names
    springs = {f"joint_spring.{names[joint]}": held[joint].tolist() for joint in (PITCH, ROLL)}
    base = TorqueModel.from_parameters(
        known_ecm.model().parameters() | springs | {"joint_offset": [0.0, 0.02, 0.001, 0.01]}
    )
    motion = load([known_ecm.recorded(1)], base)
    every = list(JointSpring.hypotheses(motion))
    assert {b - a for a, b in (hypothesis.joints for hypothesis in every)} == {1, 2}
    assert len(every) == 2 * (3 + 2)
    hypothesis = next(each for each in every if each.joints == (PITCH, INSERTION))
    theta = np.array([0.05, -0.01])
    model, why = extended(motion, [(hypothesis, theta)])
    assert why == ("",)
    added = motion.torque_at(motion.q, model) - motion.modelled
    np.testing.assert_allclose(added, hypothesis.regressor(motion) @ theta, atol=1e-9)


def test_a_spring_is_found_at_its_two_joints_and_the_extended_model_has_it():
    row = np.eye(4)[PITCH] - 0.8 * np.eye(4)[ROLL]

    def pull(q, qd, qdd):
        return 3.0 * (q @ row - 0.2)[:, None] * row

    diagnosis = diagnose(known_ecm.recorded(2, more=pull), known_ecm.model())
    found = first_of(diagnosis, "joint_spring", PITCH, ROLL)
    assert diagnosis.findings[0].place == "difference"
    assert found["stiffness"].value == pytest.approx(3.0, rel=0.01)
    assert found["ratio"].value == pytest.approx(0.8, rel=0.01)
    assert unexplained(known_ecm.model(), 5, more=pull)[PITCH] > 10.0
    assert (unexplained(diagnosis.model, 5, more=pull) < 1.1).all()


# --- a base that leans -----------------------------------------------------------------------


@pytest.mark.parametrize("before", [(0.0, 0.0, -1.0), (0.3, -0.8, 0.5)])
def test_roll_and_pitch_take_gravity_from_one_direction_to_another(before):
    random = np.random.default_rng(0)
    for _ in range(200):
        turn = pin.rpy.rpyToMatrix(*random.uniform(-np.pi, np.pi, 2), 0.0)
        after = turn.T @ np.array(before)
        roll, pitch = base_tilt._angles(np.array(before), after)
        again = pin.rpy.rpyToMatrix(roll, pitch, 0.0).T @ np.array(before)
        np.testing.assert_allclose(again, after, atol=1e-6)
        assert abs(pitch) <= np.pi


@pytest.mark.parametrize("tilt", [(0.05, -0.04), (2.2, 0.3)], ids=["leans", "hangs"])
def test_a_tilt_is_found_with_its_angles_however_large(tilt):
    gravity = pin.rpy.rpyToMatrix(*tilt, 0.0).T @ known_ecm.ARM.gravity
    diagnosis = diagnose(known_ecm.recorded(3, gravity=gravity), known_ecm.model())
    found = first_of(diagnosis, "base_tilt")
    for name, angle in zip(("roll", "pitch"), tilt, strict=True):
        assert found[name].value == pytest.approx(angle, abs=0.005)
        assert found[name].low < angle < found[name].high
    np.testing.assert_allclose(diagnosis.model.gravity, gravity, atol=0.05)
    assert (unexplained(diagnosis.model, 5, gravity=gravity) < 1.2).all()


def test_what_link_1_weighs_is_open_by_its_plausible_moment_in_a_base_that_leans():
    """About a shaft that leans by 0.1 rad: of a kilogram a link, as far out as the next joint."""
    arm, none = diagnosed.ARM, np.zeros((4, 0))
    known = ModelUncertainty(
        {}, {}, none, none[:3], diagnosed.NOISE, 8.0, np.full(4, 0.1), *arm.range, np.full(4, 9.0)
    )
    motion = passed(replace(diagnosed.model(), uncertainty=known))
    lengths = [np.linalg.norm(body.placement.translation) for body in arm.bodies[1:]]

    tilt = next(effects.named("base_tilt").hypotheses(motion))

    expected = 0.1 * 9.81 * np.linalg.norm([*lengths, 0.1])
    np.testing.assert_allclose(tilt.prior_std, [np.inf, np.inf, expected, expected], rtol=1e-3)


# --- links behind springs --------------------------------------------------------------------


def test_a_joint_that_gives_has_the_effort_of_two_masses_with_a_spring_between(tmp_path):
    """A rotor that is moved, and a pendulum behind it, integrated."""
    path = tmp_path / "pendulum.yaml"
    path.write_text(PENDULUM)
    moment, inertia, rotor, damping, stiffness = 0.1, 0.02, 0.01, 0.02, 60.0
    model = TorqueModel.from_parameters(
        {
            "arm": str(path),
            "link_weight.link1": [1.0, moment, 0.0, 0.0],
            "link_inertia.link1": [1.0, moment, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, inertia],
            "rotor_inertia.motor": [rotor],
            "viscous_friction.joint": [damping],
        }
    )
    cosine, sine = (float(model.torque([angle])[0]) for angle in (0.0, 0.5 * np.pi))
    time = np.arange(1200) / 100.0
    turned = make_interp_spline(time, (1.0 - np.exp(-((time / 2.0) ** 4))) * np.sin(3.0 * time), 7)

    def of_link(t: float, state: np.ndarray) -> list[float]:
        weight = cosine * np.cos(state[0]) + sine * np.sin(state[0])
        return [state[1], (stiffness * (turned(t) - state[0]) - weight) / inertia]

    begin = [-cosine / stiffness, 0.0]
    link = solve_ivp(of_link, time[[0, -1]], begin, t_eval=time, rtol=1e-8, atol=1e-10).y[0]
    q, qd, qdd = (turned(time, order)[:, None] for order in range(3))
    effort = stiffness * (q - link[:, None]) + rotor * qdd + damping * qd
    bare = load([Recording(("swing",), time, q, qd, effort)], model)
    made = replace(bare, q=q, qd=qd, qdd=qdd, effort=effort, time=time, parts=(slice(0, len(q)),))
    (hypothesis,) = JointFlexibility.hypotheses(made)
    settled = slice(200, -100)
    missing = (made.effort - made.modelled)[settled]
    for compliance in (0.0, 1.0 / stiffness):
        supposed = replace(hypothesis, setting={"compliance": compliance})
        torque = supposed.regressor(made)[settled, :, 0] / stiffness
        assert np.abs(missing).max() > 0.01
        assert np.abs(missing - torque).max() < 0.1 * np.abs(missing).max()


# --- joints that leak ------------------------------------------------------------------------


def test_more_than_the_whole_of_another_joint_s_reading_is_no_leak(motion):
    scale = motion.arm.scale
    every = list(JointCoupling.hypotheses(motion))
    assert {each.what for each in every} == {"torque", "motion"}
    for each in every:
        target, source = scale[list(each.joints)]
        whole = source / target if each.what == "torque" else target / source
        for way in (-1.0, 1.0):
            assert each.plausible(np.array([0.9 * way * whole])), each
            assert not each.plausible(np.array([1.1 * way * whole])), each
