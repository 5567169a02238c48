"""What one meets in a Python session: paths and names, short reprs, sentences for wrong types."""

from __future__ import annotations

import ast
import pickle
from pathlib import Path

import numpy as np
import pytest
from known_mtm import ARM, truth
from support import MODEL_FILE, REPOSITORY

import dvrk_gravity
from dvrk_gravity import Arm, Recording, TorqueModel, diagnose, evaluate, identify
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import ArgumentError, DvrkGravityError
from dvrk_gravity.identification import Fit
from dvrk_gravity.recording import RecordingFile

pytestmark = pytest.mark.usefixtures("four_folds")

FEW = ["coulomb_friction"]


@pytest.fixture(scope="module")
def fit(tmp_path_factory) -> Fit:
    """Return what is fitted to the recording in a file."""
    folder = tmp_path_factory.mktemp("recording")
    truth(1, 12.0).save(folder / "run.csv")
    return identify(folder / "run.csv", "mtmr", "joint", FEW)


@pytest.fixture(scope="module")
def files(fit, tmp_path_factory) -> tuple[Path, Path]:
    """Return the paths of a recording and of the model that was fitted to it."""
    folder = tmp_path_factory.mktemp("files")
    truth(1, 12.0).save(folder / "run.csv")
    fit.model.save(folder / "model.yaml")
    return folder / "run.csv", folder / "model.yaml"


def test_paths_and_names_do_as_well_as_objects(files, fit, tmp_path):
    run, model = files
    recording = Recording.load(run)
    expected = identify([recording], ARM, "joint", FEW)
    assert fit.held_out == expected.held_out
    evaluation = evaluate(str(model), str(run), "joint")
    assert evaluation.joints == evaluate(TorqueModel.load(model), [recording], "joint").joints
    truth(2, 12.0).save(tmp_path / "other.csv")
    listed = identify([str(run)], ARM, "joint", FEW[0], validate=str(tmp_path / "other.csv"))
    assert "other.csv" in listed.validation
    assert {name: e.nrmse for name, e in listed.training.items()} == pytest.approx(
        {name: e.nrmse for name, e in expected.training.items()}
    )


def test_reprs_are_short_and_say_what_it_is(files, fit):
    run, model_file = files
    recording, model = Recording.load(run), TorqueModel.load(model_file)
    evaluation = evaluate(model, recording, "joint")
    poses = Recording(JOINT_NAMES, None, np.zeros((3, 7)), effort=np.zeros((3, 7)))
    for shown, says in (
        (recording, "1200 samples, 11.99 s, 7 joints, joint coordinates"),
        (poses, "3 static poses"),
        (RecordingFile(run), "run.csv"),
        (Arm.load("mtmr"), "mtmr"),
        (model, "mtmr: gravity, "),
        (TorqueModel.load(MODEL_FILE), "gravity, directional_cable"),
        (fit, "held-out |e|/|tau| outer_yaw 0."),
        (fit.traces[0], "samples"),
        (evaluation, "|e|/|tau| outer_yaw 0."),
    ):
        assert says in repr(shown)
        assert len(repr(shown)) < 300 + len(str(run))
        assert "\n" not in repr(shown)
    assert fit.verdict.words in repr(fit)
    assert repr(pickle.loads(pickle.dumps(fit.model))) == repr(fit.model)


def test_diagnose_takes_paths_and_is_told_in_short(files):
    run, model = files
    found = diagnose(str(run), str(model))
    assert found.samples > 100
    assert found.model.arm.name == "mtmr"
    assert repr(found).startswith(f"<Diagnosis {found.verdict}: ")
    assert len(repr(found)) < 1000
    for finding in found.findings:
        assert finding.effect in repr(finding)
        assert "array" not in repr(finding)


WRONG = {
    "recording is a number": lambda run, model: identify(5, "mtmr"),
    "recording is None": lambda run, model: identify(None, "mtmr"),
    "recordings hold a number": lambda run, model: identify([run, 5], "mtmr"),
    "recording is an array": lambda run, model: identify(np.zeros((5, 7)), "mtmr"),
    "arm is a number": lambda run, model: identify(run, 5),
    "arm is None": lambda run, model: identify(run, None),
    "arm is a model": lambda run, model: identify(run, TorqueModel.load(model)),
    "coordinates are a number": lambda run, model: identify(run, "mtmr", 5),
    "coordinates are unknown": lambda run, model: identify(run, "mtmr", "joints"),
    "effects hold a number": lambda run, model: identify(run, "mtmr", effects=[5]),
    "effects are a number": lambda run, model: identify(run, "mtmr", effects=5),
    "still is a list": lambda run, model: identify(run, "mtmr", still=[1.0]),
    "still names no joint": lambda run, model: identify(run, "mtmr", still={"nobody": 0.1}),
    "still has no number": lambda run, model: diagnose(run, model, still={"outer_yaw": "up"}),
    "nothing is diagnosed": lambda run, model: diagnose([], model),
    "a known mass is text": lambda run, model: diagnose(run, model, known_payload="100 g"),
    "a model is saved to a number": lambda run, model: TorqueModel.load(model).save(5),
    "a recording is saved to a number": lambda run, model: Recording.load(run).save(5),
    "a URDF is a number": lambda run, model: Arm.from_urdf(5),
    "validate is a number": lambda run, model: identify(run, "mtmr", validate=5),
    "model and recording exchanged": lambda run, model: evaluate(run, model),
    "model is a number": lambda run, model: evaluate(5, run),
    "evaluated coordinates": lambda run, model: evaluate(model, run, "joints"),
    "diagnosed recording is a number": lambda run, model: diagnose(5, model),
    "diagnosed model is None": lambda run, model: diagnose(run, None),
    "diagnosed coordinates": lambda run, model: diagnose(run, model, coordinates="joints"),
    "loaded recording is a number": lambda run, model: Recording.load(5),
    "loaded model is None": lambda run, model: TorqueModel.load(None),
    "loaded arm is a list": lambda run, model: Arm.load(["mtmr"]),
    "parameters are a path": lambda run, model: TorqueModel.from_parameters(str(model)),
    "torque of text": lambda run, model: TorqueModel.load(model).torque("q"),
    "torque of None": lambda run, model: TorqueModel.load(model).torque(None),
    "torque of ragged rows": lambda run, model: TorqueModel.load(model).torque([[0.0] * 7, [0.0]]),
    "recording without arrays": lambda run, model: Recording(JOINT_NAMES, None, "positions"),
    "recording of one name": lambda run, model: Recording("outer_yaw", None, [[0.0]]),
    "recording of no names": lambda run, model: Recording(5, None, [[0.0]]),
    "time is text": lambda run, model: Recording(JOINT_NAMES, "now", np.zeros((1, 7))),
}


@pytest.mark.parametrize("call", WRONG.values(), ids=WRONG)
def test_a_wrong_type_gives_a_sentence(call, files):
    with pytest.raises(DvrkGravityError) as caught:
        call(*files)
    assert "expected" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_an_argument_of_a_wrong_type_is_a_type_error_too():
    with pytest.raises(TypeError, match=r"arm: got 5, expected mtml, mtmr"):
        Arm.load(5)
    assert issubclass(ArgumentError, DvrkGravityError)


def test_the_package_says_that_it_is_typed_and_installs_that():
    assert (Path(dvrk_gravity.__file__).parent / "py.typed").is_file()
    (call,) = (
        node
        for node in ast.walk(ast.parse((REPOSITORY / "setup.py").read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setup"
    )
    data = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
    assert data["package_data"] == "{NAME: ['py.typed', '*/__init__.pyi', 'ros/parameters/*.txt']}"
    assert data["zip_safe"] == "False"  # type checkers do not look into archives


def test_every_public_name_is_there():
    for name in dvrk_gravity.__all__:
        assert getattr(dvrk_gravity, name)
