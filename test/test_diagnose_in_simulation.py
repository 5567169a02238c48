"""The extended model predicts the motion, and the arm itself stays where it is let go."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import (
    ARM,
    HALF,
    INSERTION,
    MIDDLE,
    PITCH,
    ROLL,
    YAW,
    loaded,
    model,
    moving,
    of_seven,
    seven,
)

from dvrk_gravity.arms import N_JOINTS
from dvrk_gravity.compensate import in_simulation, simulate_release, with_simulation
from dvrk_gravity.diagnosis import Diagnosis, diagnose, load
from dvrk_gravity.effects import Gravity, LinkInertia, State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import ModelArm

POSE = np.array([0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2])


MASS, COM = 0.5, (0.03, -0.02, 0.05)


@cache
def weighted() -> Diagnosis:
    """Return the diagnosis of the small arm with a load that its model does not know."""
    motion = moving()
    torque = motion.torque(loaded(MASS, COM))
    return with_simulation(diagnose(motion.read(torque), model()))


def test_the_extended_model_predicts_where_measured_efforts_bring_the_arm():
    diagnosis = weighted()
    said = diagnosis.to_dict()["simulation"]["motion"]
    joint = max(diagnosis.before, key=lambda name: diagnosis.before[name] - diagnosis.after[name])

    assert said["windows"] >= 10
    assert said["rmse_after"][joint] < 0.3 * said["rmse_before"][joint]
    for name, after in said["rmse_after"].items():  # and no joint is the worse for it
        assert after < 1.1 * said["rmse_before"][name] + 1e-3


def test_the_arm_itself_drifts_less_under_the_extended_model():
    load = {"payload.mass": MASS, "payload.first_moment": tuple(MASS * np.array(COM))}
    truth = TorqueModel.from_parameters(model().parameters() | load, ARM)
    plant, pose = ModelArm.of(truth).plant(), MIDDLE + 0.5 * HALF
    given, extended = (
        (np.abs(simulate_release(plant, each, pose, 0.5)) / ARM.scale).max()
        for each in (model(), weighted().model)
    )
    assert given > np.radians(1.0)
    assert extended < 0.1 * given


def with_weight(factor: float) -> TorqueModel:
    """Return the model of the master arm with a factor on its weight."""
    return replace(
        seven().model(),
        terms=tuple(
            replace(term, beta=factor * term.beta) if isinstance(term, Gravity) else term
            for term in seven().model().terms
        ),
    )


def test_an_arm_with_a_tenth_of_its_friction_is_compensated_for_a_tenth():
    """The roll, which weighs nothing, else runs away for what its friction is taken to be."""
    plant = ModelArm.of(seven().model()).plant(0.1)

    of_a_tenth, of_all = (
        np.degrees(np.abs(simulate_release(plant, with_weight(1.1), POSE, part=part)).max(axis=0))
        for part in (0.1, 1.0)
    )

    assert of_all[-1] > 100.0
    assert of_a_tenth[-1] < 2.0
    assert of_a_tenth[1:3].min() > 5.0  # shoulder and elbow fall, for they weigh


def test_an_arm_that_sticks_is_not_simulated_on_and_stays_where_it_is():
    plant = ModelArm.of(seven().model()).plant()

    def simulated(compensating: TorqueModel) -> tuple[np.ndarray, float]:
        began = plant.time
        return simulate_release(plant, compensating, POSE, 1.01), plant.time - began

    at_once, of_stuck = simulated(seven().model())
    falls, _ = simulated(with_weight(0.6))

    assert of_stuck < 0.2
    assert np.abs(at_once).max() < 1e-15
    assert at_once.shape == falls.shape == (51, N_JOINTS)
    assert falls.any()


def with_links(change) -> TorqueModel:
    """Return the model of the master arm with other link parameters, of (9, 10)."""
    terms = (
        replace(term, links=change(term.links)) if isinstance(term, LinkInertia) else term
        for term in seven().model().terms
    )
    return replace(seven().model(), terms=tuple(terms))


def without_roll(links: np.ndarray) -> np.ndarray:
    """Return what noise identifies of the last link: less than no inertia about its axis."""
    changed = links.copy()
    changed[8, 4:] *= -1.5
    return changed


def positions(count: int) -> np.ndarray:
    arm = seven().arm
    return np.random.default_rng(2).uniform(arm.lower, arm.upper, (count, N_JOINTS))


def test_the_plant_of_identified_parameters_has_the_arm_s_mass_matrix():
    """Identified parameters are right in what acts only: links may weigh less than nothing."""
    links, random = seven().model().term(LinkInertia.NAME), np.random.default_rng(0)
    regressor = links.regressor(State(*random.uniform(-1.0, 1.0, (3, 100, N_JOINTS))))
    regressor = regressor.reshape(100 * N_JOINTS, -1)
    silent = np.linalg.svd(regressor)[2][np.linalg.matrix_rank(regressor) :]
    odd = links.with_theta(links.theta + random.normal(0.0, 0.3, len(silent)) @ silent)
    assert odd.links[:, 0].min() < 0.0

    arm, found = seven().plant(), ModelArm.of(with_links(lambda _: odd.links)).plant()

    for q in positions(5):
        arm.reset(q)
        found.reset(q)
        assert found.mass_matrix() == pytest.approx(arm.mass_matrix(), abs=1e-9)


def test_inertia_that_no_bodies_have_is_completed_to_an_arm_that_moves():
    for change in (without_roll, np.negative, np.zeros_like):
        plant = ModelArm.of(with_links(change)).plant()
        for q in positions(20):
            plant.reset(q)
            assert np.linalg.eigvalsh(plant.mass_matrix()).min() > 1e-6, change


def test_the_completed_inertia_is_the_model_s_but_for_what_cannot_be():
    model_ = with_links(without_roll)
    found = ModelArm.of(model_)

    # The last link's inertia shows at the roll: there and only there another must be simulated.
    assert found.inertia_error[:6].max() < 0.01
    assert found.inertia_error[6] > 0.3
    plant = found.plant()
    inertia = [model_.term("link_inertia"), model_.term("rotor_inertia")]
    for q in positions(5):
        plant.reset(q)
        still = State(np.tile(q, (N_JOINTS, 1)), np.zeros((N_JOINTS, N_JOINTS)), np.eye(N_JOINTS))
        of_model = sum(term.torque(still) for term in inertia)
        size = np.sqrt(np.diag(of_model)[:6])
        difference = (plant.mass_matrix() - of_model)[:6, :6] / np.outer(size, size)
        assert np.abs(difference).max() < 0.01


def test_a_comparison_that_cannot_be_made_says_so_and_is_no_failure():
    given, motion = seven().model(), load([of_seven()], seven().model())
    weightless = replace(given, terms=tuple(t for t in given.terms if not isinstance(t, Gravity)))

    absurd = in_simulation(given, with_links(lambda links: 1e85 * links), motion, [(3.0, 3.5)])
    bare = in_simulation(weightless, given, motion, [(3.0, 3.5)])

    assert (absurd.before, absurd.drifts) == (None, ())
    assert len(absurd.notes) == 1
    assert bare.before is not None
    assert bare.drifts == ()
    assert "gravity" in bare.notes[0]


def test_another_arm_s_models_are_compared_where_each_of_its_joints_went_furthest():
    """A cable pulls at both ends of the insertion, where a few centimetres are its whole way."""
    time = np.arange(1000) / 100.0
    part = np.zeros((1000, ARM.n))
    for k, joints in enumerate(((YAW,), (ROLL,), (PITCH, INSERTION))):
        part[100 + 300 * k : 400 + 300 * k, joints] = np.sin(2.0 * np.pi * time[:300] / 3.0)[
            :, None
        ]
    q = MIDDLE + HALF * part
    qd = np.gradient(q, 0.01, axis=0)
    motion = replace(moving(), time=time, q=q, qd=qd, qdd=np.gradient(qd, 0.01, axis=0))
    measured = load([motion.read(motion.torque())], model())
    cubic = np.polynomial.Polynomial.fromroots([MIDDLE[INSERTION]] * 3)
    force = 10.0 / HALF[INSERTION] ** 3 * cubic.coef  # 10 N at the ends, of 1 N of friction
    cable = {"elastic_cable.insertion": tuple(force.tolist())}
    right = TorqueModel.from_parameters(model().parameters() | cable, ARM)

    result = in_simulation(right, model(), measured, [(2.0, 3.0), (7.4, 8.2)])

    drift = result.drifts[0]
    assert drift.before[:, :, INSERTION].max() > 0.02
    assert drift.before[:, :, INSERTION].min() < -0.02
    assert np.abs(drift.after[:, :, INSERTION]).max() < 1e-3
    assert result.windows > 10
    assert (result.before / ARM.scale).max() > 3.0 * (result.after / ARM.scale).max()
    said = result.to_dict()
    assert said["units"] == dict(zip(ARM.joint_names, ARM.units, strict=True))
    assert set(said["motion"]["rmse_before"]) == set(ARM.joint_names)
