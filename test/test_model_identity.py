"""A model's file says which parameters belong together: no two models are mixed unnoticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import UR5
from support import CONFIG, MODEL_FILE

from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import terms
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.model import TorqueModel, model_parameters
from dvrk_gravity.parameters import flatten
from testing.world import COARSE, World


def parameters(path) -> dict:
    """Return a file's parameters as ROS reads them."""
    return flatten(yaml_file.load(path)["/**"]["ros__parameters"])


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[dict, dict]:
    """Return the parameters of two models of one arm, with other terms."""
    folder = tmp_path_factory.mktemp("models")
    World.draw(6, step=COARSE).model().save(folder / "a.yaml")
    return parameters(folder / "a.yaml"), parameters(MODEL_FILE)


def refused(values: dict, before: Settings | None = None) -> str:
    """Return the field of a refusal, "" if there is none."""
    try:
        Settings.from_parameters(values, before)
    except ConfigError as error:
        return error.field
    return ""


def test_one_model_is_accepted_and_two_that_are_merged_are_refused_by_name(files):
    first, second = files
    assert refused(first) == refused(second) == ""
    assert refused(first | second) == "coulomb_friction"  # which the second model lacks
    assert refused(second | first) == "directional_cable"
    assert refused(second | {"beta": first["beta"]}) == "beta"
    assert refused(second | {"beta": [1.0001 * value for value in second["beta"]]}) == "beta"


def test_a_verdict_of_another_model_is_no_verdict_of_this_one(files):
    _, second = files
    assert refused(second | {"identification.verdict": "good"}) == "identification"


def test_what_a_person_may_change_is_accepted_at_the_start_and_in_flight(files):
    running = Settings.from_parameters(files[1])
    for change in (
        {"payload.mass": 0.1},
        {"gravity_vector": [0.0, 1.0, -9.7]},
        {"gravity_enabled": False},
        {"effort_limit": [0.5] * 7},
        {"reading.effort_delay": 0.001, "accept_reading_errors": True},
    ):
        assert refused(files[1] | change) == refused(files[1] | change, running) == ""
    assert refused(files[1] | {"beta": files[0]["beta"]}, running) == "beta"


def test_a_model_changed_by_hand_is_accepted_without_its_identity(files):
    values = files[1] | {"beta": files[0]["beta"]}
    assert refused({k: v for k, v in values.items() if k != "identification.identity"}) == ""


def test_every_effect_s_parameters_keep_their_identity_in_a_file(tmp_path):
    model = replace(World.draw(6, step=COARSE).model(), verdict="usable", reason="made up")
    loaded = TorqueModel.load(MODEL_FILE)
    for each in (model, replace(loaded, joint_offset=np.full(7, 0.1))):
        each.save(tmp_path / "model.yaml")
        again = TorqueModel.load(tmp_path / "model.yaml")
        assert again.foreign == ()
        again.save(tmp_path / "again.yaml")
        assert parameters(tmp_path / "again.yaml") == parameters(tmp_path / "model.yaml")


def test_no_parameter_of_a_term_of_the_arm_itself_is_adjustable():
    table = model_parameters(TorqueModel.load(MODEL_FILE).arm)
    adjustable = {name.partition(".")[0] for name, entry in table.items() if entry.adjustable}
    assert adjustable <= {
        "arm", "arm_geometry", "console", "effort_has_gravity", "effort_unit", "gravity_enabled",
        "gravity_vector", "identification", "payload", "reading",
    }  # fmt: skip
    assert {term.NAME for term in terms()} & adjustable == {"payload"}


def test_the_shipped_model_has_its_identity():
    for path in CONFIG.glob("mtm*.yaml"):
        assert TorqueModel.load(path).identity == parameters(path)["identification.identity"]


def test_another_model_s_uncertainty_is_refused(tmp_path):
    path = tmp_path / "model.yaml"
    replace(TorqueModel.from_arm(UR5), of_file=False).save(path)
    assert TorqueModel.load(path).uncertainty is not None
    values = parameters(path)
    heavier = [1.25 * value for value in values["link_weight.forearm_link"]]
    content = yaml_file.load(path)
    content["/**"]["ros__parameters"]["link_weight"]["forearm_link"] = heavier
    path.write_text(yaml_file.dump(content))
    with pytest.raises(ConfigError, match=r"identification\.uncertainty"):
        TorqueModel.load(path)
