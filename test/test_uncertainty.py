"""A model knows how sure it is: the file that says so, and what it allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_folds

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import LinearTerm, State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import ModelUncertainty, TorqueModel, uncertainty_file
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import evaluation_text
from testing.world import COARSE, World

STEP = 0.1  # of a standard deviation; torque is linear in coefficients


def recorded(seed: int) -> Recording:
    """Return 15 s of an arm by its seed."""
    return World.draw(seed, step=COARSE).record(3, 4, 15.0, 100.0)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return recorded(5)


@pytest.fixture(scope="module")
def model(recording) -> TorqueModel:
    return identify(recording, World.draw(5).arm).model


@pytest.fixture
def saved(model, tmp_path):
    model.save(tmp_path / "model.yaml")
    return tmp_path / "model.yaml"


def test_it_lies_beside_the_model_which_names_it(model, saved):
    again = TorqueModel.load(saved).uncertainty

    assert f"uncertainty: {uncertainty_file(saved).name}" in saved.read_text()
    assert again.size == model.uncertainty.size > 50
    for name, change in model.uncertainty.deviations.items():
        np.testing.assert_array_equal(again.deviations[name], change)
    for name in ("offset", "gravity", "error", "correlation_time", "lower", "upper", "speed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model.uncertainty, name))


def test_a_model_without_the_file_works_and_does_not_tell(saved):
    uncertainty_file(saved).unlink()

    model = TorqueModel.load(saved)

    assert model.uncertainty is None
    assert model.unsure == f"{uncertainty_file(saved).name} is not beside {saved}"
    assert np.isfinite(model.torque(np.zeros(7))).all()


def test_coefficients_changed_by_hand_are_no_longer_what_it_is_about(saved):
    text = saved.read_text()
    beta = next(line for line in text.splitlines() if line.strip().startswith("beta:"))
    saved.write_text(text.replace(beta, beta.replace("[", "[1.0, ", 1).rsplit(",", 1)[0] + "]"))

    model = TorqueModel.load(saved)

    assert model.uncertainty is None
    assert model.unsure.endswith(f"is of other coefficients than {saved} has")


@pytest.mark.parametrize(
    ("content", "got"),
    [(b"", "truncated"), (b"no arrays", "else"), (b"PK\x03\x04 cut off", "truncated")],
)
def test_a_file_of_something_else_is_one_line_that_names_it(saved, content, got):
    uncertainty_file(saved).write_bytes(content)

    with pytest.raises(ConfigError, match=rf"^[^\n]*model\.uncertainty\.npz[^\n]*{got}[^\n]*$"):
        TorqueModel.load(saved)


def test_arrays_of_another_arm_are_refused(saved, model):
    wrong = replace(model.uncertainty, error=np.zeros(3))
    wrong.save(uncertainty_file(saved))

    with pytest.raises(ConfigError, match=r"error of shape \(7,\)"):
        TorqueModel.load(saved)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            lambda known: {"offset": known.offset.ravel()[1:]},
            r"offset of shape \(joints, directions\)",
        ),
        (lambda known: {"offset": np.nan * known.offset}, "finite offset"),
        (lambda known: {"lower": np.nan * known.lower}, "finite lower"),
        (lambda known: {"lower": known.upper, "upper": known.lower}, "lower no greater than upper"),
        (lambda known: {"error": -known.error}, "error of at least 0"),
        (lambda known: {"speed": -known.speed}, "speed of at least 0"),
        (lambda known: {"error": np.inf + known.error}, "finite error"),
        (lambda known: {"correlation_time": np.inf + known.correlation_time}, "finite together"),
        (lambda known: {"speed": np.inf + known.speed}, "finite speed"),
        (lambda known: {"band": 0.0}, "finite band above 0"),
        (lambda known: {"band": -8.0}, "finite band above 0"),
        (lambda known: {"band": np.inf}, "finite band above 0"),
    ],
)
def test_an_array_that_cannot_be_is_refused_by_its_name(saved, model, change, expected):
    known = model.uncertainty
    replace(known, **change(known)).save(uncertainty_file(saved))

    with pytest.raises(ConfigError, match=f"{uncertainty_file(saved).name}.*expected {expected}"):
        TorqueModel.load(saved)


@pytest.mark.parametrize("kind", ["complex128", "U8", "bool", "datetime64[s]"])
def test_what_are_no_real_numbers_are_refused(saved, kind):
    path = uncertainty_file(saved)
    with np.load(path) as arrays:
        changed = {**arrays, "error": np.ones(7, int).astype(kind)}
    np.savez(path, **changed)

    with pytest.raises(ConfigError, match=rf"{path.name}: error: .*expected real numbers$"):
        TorqueModel.load(saved)


def test_a_coefficient_without_a_length_is_refused(saved):
    path = uncertainty_file(saved)
    with np.load(path) as arrays:
        changed = {**arrays, "coefficients/coulomb_friction": np.array(1.0)}
    np.savez(path, **changed)

    with pytest.raises(ConfigError, match=f"{path.name}.*deviations of coulomb_friction"):
        TorqueModel.load(saved)


def test_deviations_of_coefficients_that_are_not_there_are_refused(saved):
    path = uncertainty_file(saved)
    with np.load(path) as arrays:
        kept = {name: arrays[name] for name in arrays if name != "coefficients/coulomb_friction"}
    np.savez(path, **kept)

    with pytest.raises(ConfigError, match=f"{path.name}.*coefficients of coulomb_friction"):
        TorqueModel.load(saved)


def test_an_evaluation_tells_which_joints_are_outside_what_was_identified(model, recording):
    inside = evaluate(model, recording, "joint")
    low, high = (
        np.degrees(bound[4]) for bound in (model.uncertainty.lower, model.uncertainty.upper)
    )
    away = recording.position + np.radians(high - low + 1.0) * np.eye(7)[4]
    slower = replace(model.uncertainty, speed=0.5 * model.uncertainty.speed)

    outside = evaluate(model, replace(recording, position=away), "joint")
    faster = evaluate(replace(model, uncertainty=slower), recording, "joint")

    name, speed = model.arm.joint_names[4], np.degrees(slower.speed[4])
    assert inside.outside == ()
    assert outside.outside == (
        f"{name} is outside the identified {low:.0f} to {high:.0f} deg for 100 % of the time",
    )
    assert len(faster.outside) == 7
    assert faster.outside[4].startswith(f"{name} is faster than the identified {speed:.0f} deg/s")
    told = list(evaluation_text(outside, model, verbose=True))
    assert f"{outside.outside[0]}: extrapolated there" in told
    (said,) = [line for line in told if line.startswith("outside its range errors say little")]
    (short,) = [line for line in evaluation_text(outside, model) if line.startswith(said)]
    assert outside.outside[0] in short
    assert not any(line.startswith("outside") for line in evaluation_text(inside, model))


def test_of_joints_that_slide_it_tells_millimetres_and_of_poses_no_speed():
    joints = Arm.load("psm").joints
    zeros, none = np.zeros(7), np.zeros((7, 0))
    of_poses = ModelUncertainty(
        coefficients={}, deviations={}, offset=none, gravity=np.zeros((3, 0)), error=zeros,
        band=np.nan, correlation_time=zeros, lower=zeros - 0.1, upper=zeros + 0.2,
        speed=np.full(7, np.nan),
    )  # fmt: skip
    q = np.zeros((4, 7))
    q[0, 2], q[1:, 0] = 0.21, -0.2
    told = list(of_poses.outside(joints, q, None, np.arange(7) > 0))
    assert told == ["insertion is outside the identified -100 to 200 mm for 25 % of the poses"]


def test_its_torques_are_those_of_models_whose_coefficients_are_changed(model):
    random = np.random.default_rng(0)
    q, qd, qdd = random.uniform(-0.5, 0.5, (3, 40, 7))
    state = State(q, qd, qdd)
    columns = model.uncertainty.torque(model.terms, state)

    for direction in range(0, model.uncertainty.size, 7):

        def changed(term, direction=direction):
            change = model.uncertainty.deviations.get(term.NAME)
            if change is None or not isinstance(term, LinearTerm):
                return term
            return term.with_theta(term.theta + STEP * change[:, direction])

        other = replace(model, terms=tuple(changed(term) for term in model.terms))
        slope = (other.torque_at(state) - model.torque_at(state)) / STEP
        np.testing.assert_allclose(columns[:, :, direction], slope, atol=1e-9)


def test_friction_that_a_motion_cannot_place_is_uncertain_at_joint_and_motor_alike():
    """The fit has one of them; where shoulder and elbow go to and fro together either would do."""
    world = World.draw(5, step=COARSE)
    time = np.arange(0.0, 25.0, 0.01)
    shares = 2.0 * np.pi * np.array([0.13, 0.17, 0.17, 0.23, 0.29, 0.31, 0.37])
    middle, way = np.array([0.0, 0.3, 0.1, 0.5, 1.0, 0.0, 1.0]), 0.2
    q = middle + way * np.sin(time[:, None] * shares)
    qd = way * shares * np.cos(time[:, None] * shares)
    qdd = -way * shares**2 * np.sin(time[:, None] * shares)
    noise = np.random.default_rng(1).normal(scale=2e-3, size=q.shape)
    recording = Recording(
        world.arm.joint_names, time, q, qd, world.model().torque(q, qd, qdd) + noise
    )

    with few_folds():
        fitted = identify(recording, world.arm).model

    level = fitted.term("coulomb_friction").theta.reshape(4, 7)[[0, 2], 2].sum()
    changes = fitted.uncertainty.deviations["coulomb_friction"].reshape(4, 7, -1)[:, 2]
    at_joint, at_motor = changes[0], changes[2]
    assert level > 0.01
    assert min(np.linalg.norm(at_joint), np.linalg.norm(at_motor)) > 0.3 * level
    assert np.linalg.norm(at_joint + at_motor) < 0.1 * level


def test_another_motion_lies_within_what_the_model_expects_of_itself(model):
    """Its prediction's error, in units of its own standard deviation, is about one."""
    ratios = []
    other = World.draw(6, step=COARSE)
    with few_folds():
        second = identify(recorded(6), other.arm).model
    for seed, fitted in ((5, model), (6, second)):
        exact = World.draw(seed).model()
        random = np.random.default_rng(seed)
        low, high = fitted.uncertainty.lower, fitted.uncertainty.upper
        state = State(random.uniform(low, high, (500, 7)), *random.normal(size=(2, 500, 7)) * 0.3)
        spread = np.sqrt((fitted.uncertainty.torque(fitted.terms, state) ** 2).sum(axis=2))
        error = fitted.torque_at(state) - exact.torque_at(state)
        allowed = np.hypot(spread, fitted.uncertainty.error)
        ratios.append(np.sqrt(np.mean((error / allowed) ** 2, axis=0)))

    assert np.median(ratios) < 1.0
    assert np.max(ratios) < 2.5
