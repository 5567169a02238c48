"""What one meets in a Python session: paths and names, short reprs, one line for wrong types."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from urdf_texts import small

import dvrk_gravity
from dvrk_gravity import Arm, Recording, TorqueModel, diagnose, evaluate, identify
from dvrk_gravity.arms import JOINT_NAMES, nominal_inertias
from dvrk_gravity.errors import ArgumentError, DvrkGravityError
from dvrk_gravity.identification import Fit
from testing.plain_world import PlainWorld

FEW = ["coulomb_friction"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with the file of an arm and two recordings of it."""
    folder = tmp_path_factory.mktemp("session")
    arm = Arm.load(small(folder))
    world = PlainWorld.of(arm, nominal_inertias(arm))
    for seed, name in ((1, "run.csv"), (2, "other.csv")):
        replace(world.record(seed, 10.0), arm=None).save(folder / name)
    return folder


@pytest.fixture(scope="module")
def fit(folder) -> Fit:
    """What is fitted to a file, named by paths; its model is saved beside it."""
    run, other = folder / "run.csv", str(folder / "other.csv")
    fit = identify(run, folder / "robot.urdf", "joint", FEW[0], validate=other)
    fit.model.save(folder / "model.yaml")
    return fit


def test_paths_do_as_well_as_objects(folder, fit):
    run, model = folder / "run.csv", folder / "model.yaml"
    recording, other = Recording.load(run), Recording.load(folder / "other.csv")
    arm = Arm.load(folder / "robot.urdf")
    expected = identify([recording], arm, "joint", FEW, validate=[other])
    assert fit.held_out == expected.held_out
    evaluation = evaluate(str(model), str(run), "joint")
    assert evaluation.joints == evaluate(TorqueModel.load(model), [recording], "joint").joints
    found = diagnose(str(run), str(model))
    assert found.samples > 100
    assert found.model.arm.joint_names == arm.joint_names
    assert repr(found).startswith(f"<Diagnosis {found.verdict}: ")
    assert len(repr(found)) < 1000
    assert all("\n" not in repr(each) for each in (recording, arm, fit, evaluation))
    assert repr(pickle.loads(pickle.dumps(fit.model))) == repr(fit.model)  # noqa: S301
    for finding in found.findings:
        assert finding.effect in repr(finding)
        assert "array" not in repr(finding)


WRONG = {
    "recording is a number": lambda run, model, arm: identify(5, arm),
    "recordings hold a number": lambda run, model, arm: identify([run, 5], arm),
    "arm is a number": lambda run, model, arm: identify(run, 5),
    "arm is None": lambda run, model, arm: identify(run, None),
    "coordinates are unknown": lambda run, model, arm: identify(run, arm, "joints"),
    "effects hold a number": lambda run, model, arm: identify(run, arm, effects=[5]),
    "still is a list": lambda run, model, arm: identify(run, arm, still=[1.0]),
    "still names no joint": lambda run, model, arm: identify(run, arm, still={"nobody": 0.1}),
    "still has no number": lambda run, model, arm: diagnose(run, model, still={"one": "up"}),
    "nothing is diagnosed": lambda run, model, arm: diagnose([], model),
    "a known mass is text": lambda run, model, arm: diagnose(run, model, known_payload="100 g"),
    "a model is saved to a number": lambda run, model, arm: TorqueModel.load(model).save(5),
    "model and recording exchanged": lambda run, model, arm: evaluate(run, model),
    "diagnosed model is None": lambda run, model, arm: diagnose(run, None),
    "loaded model is None": lambda run, model, arm: TorqueModel.load(None),
    "loaded arm is a list": lambda run, model, arm: Arm.load(["mtmr"]),
    "parameters are a path": lambda run, model, arm: TorqueModel.from_parameters(str(model)),
    "torque of text": lambda run, model, arm: TorqueModel.load(model).torque("q"),
    "torque of ragged rows": lambda run, model, arm: TorqueModel.load(model).torque(
        [[0.0] * 2, [0.0]]
    ),
    "recording of one name": lambda run, model, arm: Recording("outer_yaw", None, [[0.0]]),
    "time is text": lambda run, model, arm: Recording(JOINT_NAMES, "now", np.zeros((1, 7))),
}


@pytest.mark.usefixtures("fit")
def test_a_wrong_type_gives_one_line_with_what_was_expected(folder):
    for case, call in WRONG.items():
        with pytest.raises(DvrkGravityError) as caught:
            call(folder / "run.csv", folder / "model.yaml", folder / "robot.urdf")
        text = str(caught.value)
        assert "expected" in text, case
        assert "\n" not in text, case
        assert len(text) < 500, case


def test_an_argument_of_a_wrong_type_is_a_type_error_too():
    with pytest.raises(TypeError, match=r"arm: got 5, expected mtml, mtmr"):
        Arm.load(5)
    assert issubclass(ArgumentError, DvrkGravityError)


def test_every_public_name_is_there_and_typed():
    for name in dvrk_gravity.__all__:
        assert getattr(dvrk_gravity, name)
    assert (Path(dvrk_gravity.__file__).parent / "py.typed").is_file()
