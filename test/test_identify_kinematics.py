"""A zero that is off and a base that is tilted are found, and not where there are none."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from conftest import few_folds
from known_mtm import ARM, parameter, truth

from dvrk_gravity.arms import BODIES as TREE_LINKS
from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS, Arm, build_tree, link_frames
from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.identification.trajectories import kinematics as search
from dvrk_gravity.intake import read_motions
from dvrk_gravity.model import Columns, KinematicCalibration, TorqueModel, offset_joints

TERMS = ("coulomb_friction", "viscous_friction", "elastic_cable", "base_tilt", "joint_offset")
ZERO = 0.09  # rad, of wrist_platform
ROLL, PITCH = 0.06, -0.05  # rad
TILTED = pin.rpy.rpyToMatrix(ROLL, PITCH, 0.0).T @ ARM.gravity


def off(recording, joint=3, zero=ZERO):
    """Return a recording one of whose encoders, the fourth, reads too much."""
    position = recording.position + zero * (np.arange(N_JOINTS) == joint)
    return replace(recording, position=position)


@pytest.fixture(scope="module")
def displaced():
    return identify([off(truth(1))], ARM, "joint", TERMS)


@pytest.fixture(scope="module")
def leaning():
    return identify([truth(1, gravity=TILTED)], ARM, "joint", TERMS)


def test_slopes_are_those_of_pinocchios_torques():
    random = np.random.default_rng(0)
    bodies = {name: pin.Inertia.Random() for name in TREE_LINKS}
    frames = link_frames(ARM)
    links = np.concatenate([frames[n].act(bodies[n]).toDynamicParameters() for n in TREE_LINKS])
    q, qd, qdd = random.uniform(-1.0, 1.0, (3, 20, N_JOINTS))
    kinematics = KinematicCalibration(
        0.1 * random.normal(size=N_JOINTS), np.array([0.1, -0.2]), links
    )

    def torque(offset, tilt):
        tree = build_tree(ARM, bodies, pin.rpy.rpyToMatrix(*tilt, 0.0).T @ ARM.gravity)
        states = zip(q - offset, qd, qdd, strict=True)
        return np.array([tree.inverse_dynamics(*state) for state in states])

    slopes = kinematics.slopes(ARM, State(q, qd, qdd))

    for column, joint in enumerate(offset_joints(ARM)):
        step = 1e-5 * np.eye(N_JOINTS)[joint]
        up, down = (torque(kinematics.offset + s, kinematics.tilt) for s in (step, -step))
        assert slopes[..., column] == pytest.approx((up - down) / 2e-5, rel=1e-4, abs=1e-4)
    for axis in range(2):
        step = 1e-5 * np.eye(2)[axis]
        up, down = (torque(kinematics.offset, kinematics.tilt + s) for s in (step, -step))
        assert slopes[..., 5 + axis] == pytest.approx((up - down) / 2e-5, rel=1e-4, abs=1e-4)


def test_a_zero_that_is_off_is_found(displaced):
    found = parameter(displaced, "joint_offset[wrist_platform]")
    assert found.ci95[0] <= ZERO <= found.ci95[1]
    assert displaced.model.joint_offset[3] == pytest.approx(found.value)
    assert zeros(displaced) == ["joint_offset[wrist_platform]"]


def test_a_tilted_base_is_found(leaning):
    for name, value in (("base_tilt.roll", ROLL), ("base_tilt.pitch", PITCH)):
        found = parameter(leaning, name)
        assert found.ci95[0] <= value <= found.ci95[1]
    assert not any(p.name.startswith("joint_offset") for p in leaning.parameters)


def test_what_was_found_goes_with_the_model_file_to_another_motion(displaced, leaning, tmp_path):
    for fit, other in ((displaced, off(truth(2))), (leaning, truth(2, gravity=TILTED))):
        fit.model.save(tmp_path / "model.yaml")
        loaded = TorqueModel.load(tmp_path / "model.yaml")
        result = evaluate(loaded, [other])
        for name in JOINT_NAMES[:6]:
            assert result.joints[name].r2 > 0.95, name
        # The compensator's parameters are the file's.
        q = other.position[0]
        settings = Settings.from_parameters(loaded.parameters())
        at_rest = settings.torque(q, np.zeros(N_JOINTS))
        assert at_rest == pytest.approx(fit.model.torque(q), abs=1e-9)


@pytest.fixture(scope="module")
def upright():
    return identify([truth(1)], ARM, "joint", TERMS)


def zeros(fit):
    return [p.name for p in fit.parameters if p.name.startswith(("joint_offset", "base_tilt"))]


def test_an_arm_that_stands_right_acquires_neither(upright):
    assert not zeros(upright)
    rejected = {choice.term for choice in upright.choices if not choice.kept}
    assert {"base_tilt", "joint_offset wrist_platform"} <= rejected


def test_a_zero_that_would_be_off_by_more_than_one_can_be_is_not_taken(monkeypatch):
    monkeypatch.setattr(search, "FARTHEST", 0.8)  # of 0.1 rad; it is off by 0.09
    with few_folds():
        fit = identify([off(truth(1))], ARM, "joint", TERMS)
    assert not fit.model.joint_offset.any()
    (said,) = [
        statement for statement in fit.identifiability.statements if "implausible" in statement
    ]
    assert said.startswith("the encoder offset of wrist_platform would have to be 0.0")


def test_zeros_that_look_alike_are_named(upright):
    said = " ".join(upright.identifiability.statements)
    expected = r"joint_offset\[shoulder_pitch\] is known to .* most strongly correlated with joint_"
    assert re.search(expected, said)


def test_a_zero_that_is_said_not_to_show_does_not_show(upright):
    said = " ".join(upright.identifiability.statements)
    half = re.search(r"joint_offset\[wrist_yaw\] \(±([0-9.]+) deg\)", said)
    assert half is not None
    zero = 0.5 * np.radians(float(half[1]))
    assert zero > np.radians(0.5)
    hidden = identify([off(truth(1), 5, zero)], ARM, "joint", TERMS)
    assert not zeros(hidden)
    error = hidden.held_out["wrist_yaw"].rmse
    assert error == pytest.approx(upright.held_out["wrist_yaw"].rmse, rel=0.01)


def test_slopes_between_knots_are_those_at_every_sample():
    """Of 200 Hz every third sample is enough for a motion that went through the low-pass."""
    motion = read_motions([truth(3, 4.0, 1000.0)], ARM, "joint").parts[0]
    assert motion.filter.rate == pytest.approx(200.0)
    links = Columns(ARM, ARM.lower, ARM.upper).base.sum(axis=1)
    columns = Columns(ARM, ARM.lower, ARM.upper, KinematicCalibration(links=links))
    history = columns.history(motion.state)
    exact, between = (columns.regressor(motion.state, history, s) for s in (1, 3))
    kinematics = columns.select(effect="joint_offset") + columns.select(effect="base_tilt")
    assert len(kinematics) == 7
    inside = slice(motion.filter.edge, -motion.filter.edge)  # what a fit uses
    rough = np.abs(between - exact)[inside].max(axis=(0, 1))
    assert 0.0 < rough.max() < 1e-3 * np.abs(exact[:, :, kinematics]).max()
    assert not np.delete(rough, kinematics).any()


def test_terms_that_are_found_elsewhere_say_where():
    with pytest.raises(ConfigError, match="parameters of links"):
        identify([truth(1, 2.0)], ARM, "joint", ["payload"])


@pytest.mark.parametrize("name", ["mtmr", "psm"])
def test_columns_by_motion_are_the_same_at_other_kinematics(name):
    arm = Arm.load(name)
    random = np.random.default_rng(0)
    q, qd, qdd = np.cumsum(random.normal(size=(3, 60, arm.n)), axis=1) / 50.0
    state = State(q, qd, qdd)
    links = Columns(arm, arm.lower, arm.upper).base.sum(axis=1)
    springs = np.zeros(0)
    here = Columns(arm, arm.lower, arm.upper, KinematicCalibration(links=links, springs=springs))
    offset = random.uniform(0.05, 0.1, arm.n) * arm.scale
    there = here.at(KinematicCalibration(offset, np.array([0.1, -0.1]), links, springs))
    numbers = {column.key: i for i, column in enumerate(there.columns)}
    x, y = (columns.regressor(state, columns.history(state)) for columns in (here, there))
    changed = {
        i for i, c in enumerate(here.columns)
        if np.abs(x[..., i] - y[..., numbers[c.key]]).max() > 1e-9
    }  # fmt: skip
    assert here.by_motion
    assert changed
    assert not changed & set(here.by_motion)
    chosen = [*range(3), *here.by_motion[:2], x.shape[2] - 1]
    few = here.regressor(state, here.history(state), chosen=chosen)
    np.testing.assert_array_equal(few, x[..., chosen])
