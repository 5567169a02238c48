"""A model knows how sure it is: the file that says so, and what it allows."""

from __future__ import annotations

from dataclasses import replace

import known_ecm
import numpy as np
import pytest
from known_ecm import PITCH

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import LinearTerm, State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import evaluate, held_by_terms, identify
from dvrk_gravity.model import Columns, ModelUncertainty, TorqueModel, uncertainty_file
from dvrk_gravity.recording import Recording

STEP = 0.1  # of a standard deviation; torque is linear in coefficients


@pytest.fixture(scope="module")
def recording() -> Recording:
    return known_ecm.recorded(5, 15.0)


@pytest.fixture(scope="module")
def model(recording) -> TorqueModel:
    return identify(recording, known_ecm.ARM).model


@pytest.fixture
def saved(model, tmp_path):
    model.save(tmp_path / "model.yaml")
    return tmp_path / "model.yaml"


def test_it_lies_beside_the_model_which_names_it(model, saved):
    again = TorqueModel.load(saved).uncertainty

    assert f"uncertainty: {uncertainty_file(saved).name}" in saved.read_text()
    assert again.size == model.uncertainty.size > 5
    for name, change in model.uncertainty.deviations.items():
        np.testing.assert_array_equal(again.deviations[name], change)
    for name in ("offset", "gravity", "error", "correlation_time", "lower", "upper", "speed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model.uncertainty, name))


def test_a_model_without_the_file_works_and_does_not_tell(saved):
    uncertainty_file(saved).unlink()

    model = TorqueModel.load(saved)

    assert model.uncertainty is None
    assert uncertainty_file(saved).name in model.why_no_uncertainty
    assert np.isfinite(model.torque(np.zeros(4))).all()


def test_coefficients_changed_by_hand_are_refused_beside_their_former_uncertainty(saved):
    text = saved.read_text()
    line = next(each for each in text.splitlines() if each.strip().startswith("joint_positive:"))
    saved.write_text(text.replace(line, line.replace("[", "[1.0, ", 1).rsplit(",", 1)[0] + "]"))

    with pytest.raises(ConfigError, match=r"identification\.uncertainty.*coulomb_friction"):
        TorqueModel.load(saved)


IMPOSSIBLE = [
    ("offset", lambda known: {"offset": known.offset.ravel()[1:]}),
    ("offset", lambda known: {"offset": np.nan * known.offset}),
    ("lower", lambda known: {"lower": np.nan * known.lower}),
    ("lower", lambda known: {"lower": known.upper, "upper": known.lower}),
    (r"error of shape \(4,\)", lambda known: {"error": np.zeros(3)}),
    ("error", lambda known: {"error": -known.error}),
    ("error", lambda known: {"error": np.inf + known.error}),
    ("speed", lambda known: {"speed": -known.speed}),
    ("together", lambda known: {"correlation_time": np.inf + known.correlation_time}),
    ("band", lambda known: {"band": 0.0}),
    ("band", lambda known: {"band": np.inf}),
]


def test_an_array_that_cannot_be_is_refused_by_its_name(saved, model):
    known = model.uncertainty
    for name, change in IMPOSSIBLE:
        replace(known, **change(known)).save(uncertainty_file(saved), "")
        with pytest.raises(ConfigError, match=f"{uncertainty_file(saved).name}.*expected .*{name}"):
            TorqueModel.load(saved)


def test_what_are_no_real_numbers_or_not_of_the_coefficients_are_refused(saved):
    path, friction = uncertainty_file(saved), "coefficients/coulomb_friction"
    with np.load(path) as file:
        arrays = dict(file)
    kept = {name: each for name, each in arrays.items() if name != friction}
    for changed, named in (
        *(
            ({"error": np.ones(4, int).astype(kind)}, "error")
            for kind in ("complex128", "U8", "bool")
        ),
        ({friction: np.array(1.0)}, "deviations of coulomb_friction"),
        (None, "coefficients of coulomb_friction"),
    ):
        np.savez(path, **(kept if changed is None else arrays | changed))
        with pytest.raises(ConfigError, match=f"{path.name}.*{named}"):
            TorqueModel.load(saved)


def test_an_evaluation_tells_which_joints_are_outside_what_was_identified(model, recording):
    low, high = (
        np.degrees(bound[PITCH]) for bound in (model.uncertainty.lower, model.uncertainty.upper)
    )
    away = recording.position + np.radians(high - low + 1.0) * np.eye(4)[PITCH]
    slower = replace(model.uncertainty, speed=0.5 * model.uncertainty.speed)

    outside = evaluate(model, replace(recording, position=away), "joint").outside
    faster = evaluate(replace(model, uncertainty=slower), recording, "joint").outside

    assert evaluate(model, recording, "joint").outside == ()
    (said,) = outside
    for token in ("pitch", f"{low:.0f} to {high:.0f} deg", "100 %"):
        assert token in said
    assert len(faster) == 4
    assert f"{np.degrees(slower.speed[PITCH]):.0f} deg/s" in faster[PITCH]


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
    q, qd, qdd = random.uniform(-0.5, 0.5, (3, 40, 4))
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


def test_another_motion_lies_within_what_the_model_expects_of_itself(model):
    """Its prediction's error, in units of its own standard deviation, is about one."""
    known, exact, random = model.uncertainty, known_ecm.model(), np.random.default_rng(5)
    q = random.uniform(known.lower, known.upper, (500, 4))
    qd = known.speed * random.choice([-1.0, 1.0], (500, 4)) * random.uniform(0.2, 1.0, (500, 4))
    state = State(q, qd, 0.3 * known.speed * random.normal(size=(500, 4)))
    spread = np.sqrt((known.torque(model.terms, state) ** 2).sum(axis=2))
    error = model.torque_at(state) - exact.torque_at(state)
    ratio = np.sqrt(np.mean((error / np.hypot(spread, known.error)) ** 2, axis=0))
    assert np.median(ratio) < 1.0
    assert np.max(ratio) < 2.5


# --- which coefficients it is about: those that the terms can hold ---------------------------


@pytest.fixture(scope="module")
def columns() -> Columns:
    arm = Arm.load("ecm")
    return Columns(arm, arm.lower, arm.upper)


def of(columns: Columns, effect: str) -> list[int]:
    return [i for i, column in enumerate(columns.columns) if column.effect == effect]


def test_an_element_that_a_term_does_not_have_is_no_parameter_of_the_model(columns):
    elements = of(columns, "presliding_hysteresis")
    theta = np.zeros(len(columns.columns))
    assert held_by_terms(columns, theta, elements) == []
    theta[elements[0]] = 0.1
    held = held_by_terms(columns, theta, elements)
    assert elements[0] in held
    assert len(held) < len(elements)
    for column in held:
        there = theta.copy()
        there[column] = 0.2
        sizes = [[len(term.theta) for term in columns.terms(at)] for at in (there, theta)]
        assert sizes[0] == sizes[1]


def test_friction_that_is_zero_is_a_parameter_all_the_same(columns):
    friction = of(columns, "coulomb_friction")
    theta = np.zeros(len(columns.columns))
    theta[friction[0]] = 0.1
    assert held_by_terms(columns, theta, friction) == friction
