"""An encoder that reads too far or too short: its torque, and that it is found as what it is."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import sympy
from conftest import few_folds

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import Diagnosis, MeasuredMotion, diagnose, load
from dvrk_gravity.effects import EncoderScale, Kind, ReadingHypothesis, Site
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.lab_effects import Hiding, hide, left_by
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld
from testing.world import COARSE, World

ARM = Arm.load("mtmr")
PENDULUM = """
name: pendulum
joints:
  - {name: swing, alpha: 90, a: 0.0, d: 0.0, offset: 0, lower: -170, upper: 170, effort_limit: 5}
base_rpy: [0, 0, 0]
"""


def scaled(recording: Recording, matrix: np.ndarray) -> Recording:
    """Return a recording whose encoders read ``matrix`` times the joints' true positions."""
    assert recording.velocity is not None
    return replace(
        recording, position=recording.position @ matrix.T, velocity=recording.velocity @ matrix.T
    )


def at_joint(n: int, joint: int, factor: float) -> np.ndarray:
    return np.diag(np.where(np.arange(n) == joint, factor, 1.0))


@lru_cache
def known() -> World:
    return World.draw(7, step=COARSE)


@lru_cache
def moved() -> Recording:
    return known().record(1, 2, 12.0, 100.0)


def motion() -> MeasuredMotion:
    return load([moved()], known().model()).motion


def supposed(where: Site, factor: float = 1.0) -> ReadingHypothesis:
    return ReadingHypothesis(arm=ARM, site=where, joints=(where.index,), setting={"factor": factor})


def test_its_column_is_the_derivative_of_a_pendulum_s_torque_by_the_factor(tmp_path):
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
    bare = load([Recording(("swing",), time, q, qd, 0.0 * q + 1e-3 * qd)], model).motion
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


@pytest.mark.parametrize("where", [Site.joint(4), Site.motor(2)], ids=["joint", "motor"])
@pytest.mark.parametrize("factor", [0.9, 1.0005, 1.2])
def test_times_its_parameter_the_column_is_what_the_reading_changes(where, factor):
    """The model at what the encoder would have read were it right, against the model as it is."""
    read = at_joint(ARM.n, where.index, factor)
    if where.kind is Kind.MOTOR:
        read = ARM.actuator_to_joint @ read @ ARM.joint_to_actuator
    back = np.linalg.inv(read).T
    here, model = motion(), known().model()
    true = model.torque(here.q @ back, here.qd @ back, here.qdd @ back)
    column = replace(supposed(where, factor), setting={"factor": factor}).regressor(here)[:, :, 0]
    change = true - here.modelled
    # Friction that begins to turn round between two samples of a slope is in neither's middle.
    missed = (factor - 1.0) * column - change
    assert np.linalg.norm(missed) < 0.02 * np.linalg.norm(change)


@pytest.mark.parametrize("factor", [-3.0, 0.0, 1e9])
def test_where_a_fit_on_its_way_asks_for_no_encoder_its_column_is_finite(factor):
    column = replace(supposed(Site.joint(4)), setting={"factor": factor}).regressor(motion())
    assert np.isfinite(column).all()
    assert not supposed(Site.joint(4)).plausible(np.array([factor - 1.0]))


def test_of_what_does_not_move_none_is_supposed():
    moves = motion().moves
    q = motion().q.copy()
    q[:, 3] = 0.4
    still = replace(motion(), q=q)
    every, fewer = (
        {h.joints[0] for h in EncoderScale.hypotheses(m) if h.site.kind is Kind.JOINT}
        for m in (motion(), still)
    )
    assert every - fewer == {3}
    assert every == set(np.flatnonzero(moves).tolist())


@pytest.mark.parametrize(("joint", "factor"), [(1, 0.95), (4, 1.1)])
def test_it_is_found_and_is_no_zero_and_no_clock(joint, factor):
    diagnosis = diagnose(scaled(moved(), at_joint(ARM.n, joint, factor)), known().model())
    first = diagnosis.findings[0]
    assert (first.effect, first.joints) == ("encoder_scale", (ARM.joint_names[joint],))
    told = first.parameters["factor"]
    assert told.low <= factor <= told.high
    assert told.value == pytest.approx(factor, abs=0.01)
    assert ("too far" if factor > 1.0 else "too short") in first.sentence
    assert not {"joint_offset", "time_scale", "velocity_scale"} & {
        finding.effect for finding in diagnosis.findings
    }


def test_one_that_was_homed_elsewhere_is_right_there_and_is_found_with_its_offset():
    """An incremental encoder is set where the arm is switched on, and counts wrongly from there."""
    joint, factor, home = 4, 1.08, 1.0
    recording = scaled(moved(), at_joint(ARM.n, joint, factor))
    offset = (1.0 - factor) * home
    read = replace(recording, position=recording.position + offset * np.eye(ARM.n)[joint])
    (finding,) = diagnose(read, known().model()).findings
    assert (finding.effect, finding.joints) == ("encoder_scale", ("wrist_pitch",))
    for name, truth in (("factor", factor), ("offset", offset)):
        assert finding.parameters[name].low <= truth <= finding.parameters[name].high


def test_a_zero_that_is_off_is_no_scale():
    shifted = replace(moved(), position=moved().position + 0.1 * np.eye(ARM.n)[4])
    first = diagnose(shifted, known().model()).findings[0]
    assert (first.effect, first.joints) == ("joint_offset", ("wrist_pitch",))


def test_static_poses_show_it():
    poses = known().record_poses(5, 6, count=90)
    read = replace(poses, position=poses.position @ at_joint(ARM.n, 4, 1.15))
    first = diagnose(read, known().model()).findings[0]
    assert (first.effect, first.joints) == ("encoder_scale", ("wrist_pitch",))
    assert first.parameters["factor"].value == pytest.approx(1.15, abs=0.03)


@pytest.fixture(scope="module")
def identified() -> tuple[MujocoWorld, TorqueModel, Hiding, Diagnosis]:
    """A UR5 that was identified with the right encoders; then that of a joint reads otherwise."""
    world = MujocoWorld.draw("ur5", 31)
    calibration = draw_calibration(world.arm, 31)
    with few_folds():
        model = identify(world.record(world.truth(calibration, 20.0), 1), world.arm, "joint").model
    truth = world.truth(draw_other(world.arm, 7, calibration), 14.0)
    setting = world.setting(truth, left_by(model, world.record(truth, 2)))
    hiding = hide(setting, "encoder_scale", np.random.default_rng(1), joint=2, sizes=(5.0, 8.0))
    return world, model, hiding, diagnose(world.record(hiding.truth, 2), model)


def test_in_an_identified_arm_it_is_found_with_its_size(identified):
    _, _, hiding, diagnosis = identified
    first = diagnosis.findings[0]
    assert (first.effect, first.joints) == ("encoder_scale", hiding.hidden.joints)
    told, factor = first.parameters["factor"], hiding.hidden.parameters["factor"]
    assert told.low <= factor <= told.high
    assert told.value - 1.0 == pytest.approx(factor - 1.0, rel=0.15)


def test_it_is_to_be_put_right_where_it_is_read_or_known_to_the_extended_model(identified):
    _, model, _, diagnosis = identified
    first = diagnosis.findings[0]
    assert first.in_model
    assert first.remedy.startswith("check the counts per turn")
    assert first.remedy.endswith("which reads recordings correctly in spite of it")
    joint = model.arm.joint_names.index(first.joints[0])
    factor = diagnosis.model.of_readings()["reading.encoder_scale"][joint]
    assert factor == pytest.approx(first.parameters["factor"].value)
    assert diagnosis.model.joint_offset.tolist() == model.joint_offset.tolist()
