"""The extended model predicts the motion, and the arm itself stays where it is let go."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_up_arm import made_up_arm
from robots import UR5

from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS, Arm
from dvrk_gravity.compensate import in_simulation, let_go
from dvrk_gravity.compensate import simulation_check as comparison
from dvrk_gravity.diagnosis import diagnose, load
from dvrk_gravity.effects import Gravity, LinkInertia, State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Multisine
from dvrk_gravity.simulate import ModelArm, PlantFile, SimulatedArm, record_motion
from testing.hide import hide
from testing.world import COARSE, World


@contextmanager
def let_go_once(duration: float = comparison.DURATION) -> Iterator[None]:
    """Show the drift from one pose, not three: a third of the time, where no size of it matters."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparison, "_POSES", 1)
        patch.setattr(comparison, "let_go", partial(let_go, duration=duration))
        yield


@pytest.fixture(scope="module")
def weighted():
    """Return the arm as its model knows it, with a weight that it does not know, diagnosed."""
    known = World.draw(5, step=COARSE)
    world, _ = hide(known, "payload", np.random.default_rng(5))
    recording = world.record(1, 2, 15.0, 100.0)
    with let_go_once():
        return known, world, diagnose(recording, known.model(), simulated=True)


def test_the_extended_model_predicts_where_measured_efforts_bring_the_arm(weighted):
    _, _, diagnosis = weighted
    said = diagnosis.to_dict()["simulation"]["motion"]
    joint = max(diagnosis.before, key=lambda name: diagnosis.before[name] - diagnosis.after[name])

    assert said["windows"] >= 20
    assert said["rmse_after"][joint] < 0.2 * said["rmse_before"][joint]
    for name in JOINT_NAMES:  # and no joint is the worse for it
        assert said["rmse_after"][name] < 1.1 * said["rmse_before"][name] + 1e-3


def test_the_arm_itself_drifts_less_under_the_extended_model(weighted):
    known, world, diagnosis = weighted
    for pose in ([0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2], [-0.3, 0.5, -0.4, 1.0, 0.2, -0.2, 1.0]):
        given, extended = (
            np.abs(let_go(world.plant(), model, np.array(pose), 1.0)).max()
            for model in (known.model(), diagnosis.model)
        )
        assert given > np.radians(5.0)
        assert extended < 0.05 * given


def test_an_arm_with_a_tenth_of_its_friction_is_compensated_for_a_tenth():
    """The roll, which weighs nothing, else runs away for what its friction is taken to be."""
    model = World.draw(6, step=COARSE).model()
    heavier = replace(
        model,
        terms=tuple(
            replace(term, beta=1.1 * term.beta) if isinstance(term, Gravity) else term
            for term in model.terms
        ),
    )
    plant, pose = ModelArm.of(model).plant(0.1), np.array([0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2])

    of_a_tenth, of_all = (
        np.degrees(np.abs(let_go(plant, heavier, pose, part=part)).max(axis=0))
        for part in (0.1, 1.0)
    )

    assert of_all[-1] > 100.0
    assert of_a_tenth[-1] < 2.0
    assert of_a_tenth[1:3].min() > 5.0  # shoulder and elbow fall, for they weigh


def test_an_arm_that_sticks_is_not_simulated_on_and_stays_where_it_is(monkeypatch):
    model = World.draw(6, step=COARSE).model()
    plant, pose = ModelArm.of(model).plant(), np.array([0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2])
    lighter = replace(
        model,
        terms=tuple(
            replace(term, beta=0.6 * term.beta) if isinstance(term, Gravity) else term
            for term in model.terms
        ),
    )

    def simulated(compensating):
        began = plant.time
        return let_go(plant, compensating, pose, 1.01), plant.time - began

    at_once, of_stuck = simulated(model)
    falls, _ = simulated(lighter)

    assert of_stuck < 0.2
    assert np.abs(at_once).max() < 1e-15
    assert at_once.shape == falls.shape == (51, N_JOINTS)
    assert falls.any()
    monkeypatch.setattr(comparison, "_REST", 2.0)
    whole, of_whole = simulated(lighter)
    assert of_whole == pytest.approx(1.01)
    assert (whole == falls).all()


def test_the_plant_of_identified_parameters_has_the_arm_s_mass_matrix():
    world = World.draw(6, step=COARSE)
    model = world.model()
    links = model.term(LinkInertia.NAME)
    # Identified parameters are right in what acts only: links may weigh less than nothing.
    random = np.random.default_rng(0)
    regressor = links.regressor(State(*random.uniform(-1.0, 1.0, (3, 100, N_JOINTS))))
    regressor = regressor.reshape(100 * N_JOINTS, -1)
    silent = np.linalg.svd(regressor)[2][np.linalg.matrix_rank(regressor) :]
    assert len(silent) == 48  # of 90
    odd = links.with_theta(links.theta + random.normal(0.0, 0.3, len(silent)) @ silent)
    assert odd.links[:, 0].min() < 0.0
    terms = tuple(odd if isinstance(term, LinkInertia) else term for term in model.terms)

    arm, found = world.plant(), ModelArm.of(replace(model, terms=terms)).plant()

    for q in random.uniform(model.arm.lower, model.arm.upper, (5, N_JOINTS)):
        arm.reset(q)
        found.reset(q)
        assert found.mass_matrix() == pytest.approx(arm.mass_matrix(), abs=1e-9)


def with_links(model: TorqueModel, change) -> TorqueModel:
    """Return a model with other link parameters, of (9, 10)."""
    terms = (replace(t, links=change(t.links)) if isinstance(t, LinkInertia) else t
             for t in model.terms)  # fmt: skip
    return replace(model, terms=tuple(terms))


def without_roll(links):
    """Return what noise identifies of the last link: less than no inertia about its axis."""
    changed = links.copy()
    changed[8, 4:] *= -1.5
    return changed


@pytest.mark.parametrize("change", [without_roll, np.negative, np.zeros_like])
def test_inertia_that_no_bodies_have_is_completed_to_an_arm_that_moves(change):
    model = with_links(World.draw(6).model(), change)

    plant = ModelArm.of(model).plant()

    for q in np.random.default_rng(2).uniform(model.arm.lower, model.arm.upper, (20, N_JOINTS)):
        plant.reset(q)
        assert np.linalg.eigvalsh(plant.mass_matrix()).min() > 1e-6


def test_the_completed_inertia_is_the_model_s_but_for_what_cannot_be():
    model = with_links(World.draw(6).model(), without_roll)
    found = ModelArm.of(model)

    # The last link's inertia shows at the roll: there and only there another must be simulated.
    assert found.off[:6].max() < 0.01
    assert found.off[6] > 0.3
    plant = found.plant()
    inertia = [model.term("link_inertia"), model.term("rotor_inertia")]
    for q in np.random.default_rng(2).uniform(model.arm.lower, model.arm.upper, (5, N_JOINTS)):
        plant.reset(q)
        still = State(np.tile(q, (N_JOINTS, 1)), np.zeros((N_JOINTS, N_JOINTS)), np.eye(N_JOINTS))
        of_model = sum(term.torque(still) for term in inertia)
        size = np.sqrt(np.diag(of_model)[:6])
        difference = (plant.mass_matrix() - of_model)[:6, :6] / np.outer(size, size)
        assert np.abs(difference).max() < 0.01


@pytest.fixture(scope="module")
def recorded():
    """Return a model and a short motion of its arm."""
    world = World.draw(6, step=COARSE)
    model = world.model()
    return model, load([world.record(1, 2, 9.0, 100.0)], model).motion


def test_a_comparison_with_completed_inertia_succeeds_and_says_so(recorded):
    model, motion = recorded
    with let_go_once():
        result = in_simulation(model, with_links(model, without_roll), motion, [(3.0, 3.5)])

    assert result.windows > 0
    assert np.isfinite([result.before, result.after]).all()
    assert len(result.drifts) == 2
    (note,) = result.notes
    assert note.startswith("the extended model has inertia that no rigid bodies can have")
    assert note.endswith("(wrist_roll)")


def test_a_comparison_that_fails_says_why_in_words(recorded):
    model, motion = recorded
    spans = [(3.0, 3.5)]
    stiff = {"contact.above": [1e6] * 7, "contact.above_position": [-3.0] * 7}
    weightless = tuple(t for t in model.terms if not isinstance(t, Gravity))

    with let_go_once(duration=0.3):
        absurd = in_simulation(model, with_links(model, lambda links: 1e85 * links), motion, spans)
        wild = in_simulation(
            model, TorqueModel.from_parameters(model.parameters() | stiff), motion, spans
        )
        bare = in_simulation(replace(model, terms=weightless), model, motion, spans)

    assert (absurd.before, absurd.drifts) == (None, ())
    assert "expected the inertia of an arm" in absurd.notes[0]
    assert (wild.before, wild.drifts) == (None, ())
    assert all("the arm runs away" in note for note in wild.notes)
    assert bare.before is not None
    assert bare.drifts == ()
    assert "no gravity term" in bare.notes[0]


MORE = np.array([0.5, 0.0, 0.0, 0.05])  # kg, kg·m


# The made-up arm turns and slides; a UR5 only turns.
@pytest.mark.slow
@pytest.mark.parametrize("name", ["made_up", "ur5"])
def test_another_arm_s_models_are_compared_in_the_simulator_in_its_own_units(name, tmp_path):
    arm = made_up_arm(tmp_path) if name == "made_up" else Arm.load(str(UR5))
    truth = PlantFile.of(arm)
    links = {
        f"link_inertia.{body.name}": tuple(
            body.frame.act(truth.links[body.name]).toDynamicParameters()
        )
        for body in arm.bodies
    }
    rotors = {"rotor_inertia.motor": tuple(truth.rotor_inertia)}
    right = TorqueModel.from_parameters(truth.model.parameters() | links | rotors)
    last = arm.body_names[-1]
    weight = np.array(right.parameters()[f"link_weight.{last}"])
    wrong = TorqueModel.from_parameters(
        right.parameters() | {f"link_weight.{last}": tuple(weight + MORE)}
    )
    simulated = SimulatedArm(truth.plant())
    motion = load([record_motion(simulated, Multisine.draw(arm, 2), 10.0, 100.0)], right).motion

    result = in_simulation(wrong, right, motion, [(2.0, 4.0), (6.0, 8.0)])

    assert result.notes == ()
    assert result.windows > 20
    # What half a kilogram does in a tenth of a second: m t^2 / 2 of the acceleration it causes.
    assert (result.before / arm.scale).max() > 3.0 * (result.after / arm.scale).max()
    little = result.drifts[1]
    assert np.abs(little.after / arm.scale).max() < 0.01
    assert np.abs(little.before / arm.scale).max() > 0.1
    said = result.to_dict()
    assert said["units"] == dict(zip(arm.joint_names, arm.units, strict=True))
    assert set(said["motion"]["rmse_before"]) == set(arm.joint_names)
