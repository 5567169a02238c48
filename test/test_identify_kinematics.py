"""A zero that is off and a base that is tilted are found, and not where there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from known_mtm import ARM, parameter, truth

from dvrk_gravity.arms import BODIES as TREE_LINKS
from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS, build_tree, link_frames
from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import Fit, evaluate, identify
from dvrk_gravity.model import Columns, KinematicCalibration, TorqueModel, offset_joints
from dvrk_gravity.observation import observe

TERMS = ("coulomb_friction", "viscous_friction", "elastic_cable", "base_tilt", "joint_offset")
ZERO = 0.09  # rad, of wrist_platform
ROLL, PITCH = 0.06, -0.05  # rad
TILTED = pin.rpy.rpyToMatrix(ROLL, PITCH, 0.0).T @ ARM.gravity


def off(recording, joint=3, zero=ZERO):
    """Return a recording one of whose encoders, the fourth, reads too much."""
    position = recording.position + zero * (np.arange(N_JOINTS) == joint)
    return replace(recording, position=position)


@pytest.fixture(scope="module")
def fits() -> dict[str, Fit]:
    """An arm with a zero that is off on a tilted base, and one with neither."""
    leaning = off(truth(1, 16.0, 50.0, TILTED))
    recordings = {"leaning": leaning, "upright": truth(1, 16.0, 50.0)}
    return {
        name: identify([each], ARM, "joint", TERMS, physical=False)
        for name, each in recordings.items()
    }


def zeros(fit: Fit) -> list[str]:
    return [p.name for p in fit.parameters if p.name.startswith(("joint_offset", "base_tilt"))]


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


def test_a_zero_that_is_off_and_a_tilted_base_are_found_and_nothing_of_an_upright_arm(fits):
    zero = parameter(fits["leaning"], "joint_offset[wrist_platform]")
    assert zero.ci95[0] <= ZERO <= zero.ci95[1]
    assert fits["leaning"].model.joint_offset[3] == pytest.approx(zero.value)
    for name, value in (("base_tilt.roll", ROLL), ("base_tilt.pitch", PITCH)):
        tilt = parameter(fits["leaning"], name)
        assert tilt.ci95[0] <= value <= tilt.ci95[1]
    assert len(zeros(fits["leaning"])) == 3
    assert not zeros(fits["upright"])
    rejected = {choice.term for choice in fits["upright"].choices if not choice.kept}
    assert {"base_tilt", "joint_offset wrist_platform"} <= rejected


def test_what_was_found_goes_with_the_model_file_to_another_motion(fits, tmp_path):
    other = off(truth(2, gravity=TILTED))
    fits["leaning"].model.save(tmp_path / "model.yaml")
    loaded = TorqueModel.load(tmp_path / "model.yaml")
    result = evaluate(loaded, [other])
    for joint in JOINT_NAMES[:6]:
        assert result.joints[joint].r2 > 0.95, joint
    at_rest = Settings.from_parameters(loaded.parameters()).torque(
        other.position[0], np.zeros(N_JOINTS)
    )
    assert at_rest == pytest.approx(fits["leaning"].model.torque(other.position[0]), abs=1e-9)


def test_zeros_that_torque_hardly_shows_are_named(fits):
    said = " ".join(fits["upright"].identifiability.statements)
    for joint in ("shoulder_pitch", "wrist_yaw"):
        assert f"joint_offset[{joint}]" in said


def test_slopes_between_knots_are_those_at_every_sample():
    """Of 200 Hz every third sample is enough for a motion that went through the low-pass."""
    motion = next(observe([truth(3, 4.0, 1000.0)], ARM)[0].split())
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


def test_terms_that_are_found_elsewhere_are_refused():
    with pytest.raises(ConfigError, match="payload"):
        identify([truth(1, 2.0)], ARM, "joint", ["payload"])
