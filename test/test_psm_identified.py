"""PSM and ECM from recording to weighed load: simulated, and as measured on a real PSM."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import few_folds

from dvrk_gravity.diagnosis import Finding, diagnose
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion
from testing.world import COARSE

# Of a PSM on another trajectory than the fit's, |e|/|tau| by motor: the physically consistent model
# of the authors of WPI-AIM/dvrk_dynamics_identification.
PUBLISHED = (0.093, 0.178, 0.191, 0.134, 0.239, 0.213, 0.264)


def recorded(plant: PlantFile, seed: int, duration: float = 30.0) -> Recording:
    arm = SimulatedArm(plant.plant(), plant.sensors, seed, dt=COARSE)
    return record_motion(arm, Multisine.draw(plant.model.arm, seed), duration)


def changed(plant: PlantFile, values: dict) -> PlantFile:
    return replace(plant, model=TorqueModel.from_parameters({**plant.model.parameters(), **values}))


@cache
def identified(name: str) -> TorqueModel:
    plant = PlantFile.load(name)
    with few_folds():
        return identify(recorded(plant, 1, 20.0), plant.model.arm, "joint").model


@pytest.mark.parametrize("name", ["psm", "ecm"])
def test_the_weight_of_a_plant_is_that_of_the_links_that_move(name):
    plant = PlantFile.load(name)
    for body in plant.model.arm.bodies:
        moved = body.frame.act(plant.links[body.name]).toDynamicParameters()[:4]
        given = plant.model.parameters()[f"link_weight.{body.name}"]
        np.testing.assert_allclose(given, moved, atol=1e-6)


@pytest.mark.parametrize("name", ["psm", "ecm"])
def test_another_motion_of_a_simulated_arm_is_predicted(name):
    plant, model = PlantFile.load(name), identified(name)
    errors = evaluate(model, recorded(plant, 2, 12.0), "joint").joints
    for joint in plant.model.arm.joints:
        # Of the effort limit: an error that moves no joint, see VerdictSettings.negligible.
        assert errors[joint.name].rmse < 0.01 * joint.effort_limit, joint.name


@pytest.mark.slow
def test_a_load_on_a_simulated_psm_is_weighed_and_placed():
    com = np.array([0.02, 0.4, 0.0])
    load = {"payload.mass": 0.2, "payload.link": "link2"}
    plant = changed(
        PlantFile.load("psm"), {**load, "payload.first_moment": tuple((0.2 * com).tolist())}
    )

    first = diagnose(recorded(plant, 101), identified("psm")).findings[0]

    assert (first.effect, first.joints, first.place) == ("payload", ("pitch",), "link2")
    for name, truth in zip(("mass", "x", "y", "z"), (0.2, *com), strict=True):
        estimate = first.parameters[name]
        assert estimate.low <= truth <= estimate.high, name
    assert first.parameters["mass"].value == pytest.approx(0.2, rel=0.05)
    assert first.parameters["y"].value == pytest.approx(0.4, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["psm", "ecm"])
def test_another_motion_of_a_simulated_arm_is_no_news(name):
    assert diagnose(recorded(PlantFile.load(name), 101), identified(name)).findings == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "joint", "more", "unit"),
    [("psm", "insertion", 0.8, "N"), ("ecm", "pitch", 1.2, "N·m")],
)
def test_friction_that_a_simulated_joint_gained_is_named_in_its_unit(name, joint, more, unit):
    plant = PlantFile.load(name)
    level = np.array(plant.model.parameters()["coulomb_friction.joint_positive"])
    level[plant.model.arm.joint_names.index(joint)] += more
    both = ("coulomb_friction.joint_positive", "coulomb_friction.joint_negative")
    rubbing = changed(plant, dict.fromkeys(both, tuple(level.tolist())))

    first = diagnose(recorded(rubbing, 101), identified(name)).findings[0]

    assert (first.effect, first.joints) == ("coulomb_friction", (joint,))
    assert first.parameters["positive"].unit == unit
    assert first.parameters["positive"].value == pytest.approx(more, rel=0.1)


@cache
def of_real_psm(folder) -> tuple[TorqueModel, dict[str, float]]:
    fit = identify(folder / "psm" / "psm_one.csv", "psm", "actuator")
    return fit.model, {name: error.nrmse for name, error in fit.held_out.items()}


def test_phases_of_a_real_psm_s_motion_are_predicted_better_than_published(measured_data):
    _, held_out = of_real_psm(measured_data)
    for (motor, error), published in zip(held_out.items(), PUBLISHED, strict=True):
        assert error < published, motor


@pytest.mark.slow
def test_the_same_motion_of_a_real_psm_on_another_day_is_no_news(measured_data):
    """Though its wrist rubs by a third more then."""
    model, _ = of_real_psm(measured_data)
    path = measured_data / "psm" / "psm_one_bare.csv"

    diagnosis = diagnose(path, model, coordinates="actuator")

    assert (diagnosis.verdict, diagnosis.findings) == ("nothing_to_explain", ())


@pytest.mark.slow
def test_a_real_psm_s_motor_coordinates_read_as_joints_are_read_rightly(measured_data):
    """Although they would take the jaw where the model has never been and says nothing."""
    model, _ = of_real_psm(measured_data)

    diagnosis = diagnose(measured_data / "psm" / "psm_one_bare.csv", model)

    assert [finding.effect for finding in diagnosis.findings] == ["wrong_coordinates"]
    assert "these are actuator coordinates" in diagnosis.sentence


@cache
def weight_on_a_real_psm(folder) -> Finding:
    """What is told of 105 g, 535 mm from the remote centre along the insertion, 24 mm beside it."""
    model, _ = of_real_psm(folder)
    path = folder / "psm" / "psm_one_105g_insertion.csv"
    return diagnose(path, model, coordinates="actuator").findings[0]


@pytest.mark.slow
def test_a_real_weight_on_a_psm_is_weighed_and_placed(measured_data):
    """The effort of the insertion does not feel it: it is on the rail, which is link 2's."""
    first = weight_on_a_real_psm(measured_data)

    assert (first.effect, first.joints, first.place) == ("payload", ("pitch",), "link2")
    mass, beside, along = (first.parameters[name] for name in ("mass", "x", "y"))
    assert along.value == pytest.approx(0.535, abs=0.02)
    for estimate, truth in ((mass, 0.105), (along, 0.535), (beside, 0.024)):
        assert estimate.low <= truth <= estimate.high


@pytest.mark.slow
@pytest.mark.parametrize("reference", ["psm_one_bare", "psm_one"])
def test_a_real_weight_on_a_psm_is_in_its_interval_against_either_day(measured_data, reference):
    folder = measured_data / "psm"
    first = diagnose(
        folder / "psm_one_105g_insertion.csv", arm="psm", coordinates="actuator",
        reference=folder / f"{reference}.csv",
    ).findings[0]  # fmt: skip
    moment = first.parameters["first_moment_y"]
    assert first.effect == "payload"
    for name, truth in (("mass", 0.105), ("y", 0.535), ("x", 0.024)):
        assert first.parameters[name].low <= truth <= first.parameters[name].high
    assert moment.low <= 0.105 * 0.535 <= moment.high


@pytest.mark.slow
@pytest.mark.parametrize("by_model", [True, False])
def test_a_real_weight_on_a_psm_is_weighed_at_its_place(measured_data, by_model):
    """Within five per cent by a model of another day, three by difference."""
    folder = measured_data / "psm"
    compared = {"arm": "psm", "reference": folder / "psm_one_bare.csv"}
    if by_model:
        compared = {"model": of_real_psm(measured_data)[0]}
    found = diagnose(
        folder / "psm_one_105g_insertion.csv", coordinates="actuator",
        payload_at="link2:0.024,0.535,0", **compared,
    ).findings  # fmt: skip
    mass = next(each for each in found if each.effect == "payload").parameters["mass"]
    assert mass.value == pytest.approx(0.105, rel=0.05 if by_model else 0.03)
    assert mass.low <= 0.105 <= mass.high
