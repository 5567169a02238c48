"""A constant torque of a recording: a spring, a bias or a hand, and who settles which."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from known_mtm import ARM, truth
from support import MODEL_FILE

from dvrk_gravity import command_line
from dvrk_gravity.calibration import settle_constants
from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import ElasticCable
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import (
    Constant,
    HeldWeight,
    constants,
    identify,
    scale_in_words,
    settle,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

SHOULDER, NAME = 1, "shoulder_pitch"
BIAS = 0.3  # N·m, 9 % of its limit
TERMS = ["coulomb_friction", "viscous_friction", "elastic_cable"]
SHIPPED = TorqueModel.load(MODEL_FILE)
Q = np.random.default_rng(0).uniform(ARM.lower, ARM.upper, (20, 7))


def pushed(recording: Recording, torque: float = BIAS) -> Recording:
    """Return a recording whose shoulder reads too much, or is pushed by a hand throughout."""
    return replace(recording, effort=recording.effort + torque * np.eye(7)[SHOULDER])


@pytest.fixture(scope="module")
def recording():
    return pushed(truth(1, 24.0, 50.0))


@pytest.fixture(scope="module")
def fit(recording):
    return identify([recording], ARM, "joint", TERMS, physical=False)


@pytest.fixture(scope="module")
def clean():
    return identify([truth(1, 24.0, 50.0)], ARM, "joint", TERMS, physical=False)


def test_a_constant_in_the_efforts_caps_the_verdict_and_is_said_with_its_size(fit):
    found, verdict = fit.constants[NAME], fit.verdict.joints[NAME]
    assert found.value == pytest.approx(BIAS, abs=2.0 * found.error + 0.02)
    assert found.in_doubt
    assert found.share == pytest.approx(found.value / fit.holding[NAME].torque)
    assert verdict.level == fit.verdict.level == "usable"
    assert "constant" in verdict.reason
    assert "calibrate" in verdict.record
    assert "--bias-is" in verdict.record
    assert fit.to_json()["constants"][NAME]["in_doubt"]


def test_a_clean_recording_has_no_constant_where_there_is_none(clean):
    assert clean.verdict.joints[NAME].level == "good"
    assert not clean.constants[NAME].in_doubt
    assert not clean.model.constant[SHOULDER]
    # The mean torque of a spring that is relaxed elsewhere is one.
    assert clean.constants["wrist_pitch"].in_doubt


def test_a_model_s_file_carries_constants_in_doubt_as_part_of_the_model(fit, tmp_path):
    fit.model.save(tmp_path / "model.yaml")
    loaded = TorqueModel.load(tmp_path / "model.yaml")
    np.testing.assert_allclose(loaded.constant, fit.model.constant)
    assert loaded.constant[SHOULDER] > 0.25
    assert not loaded.foreign
    assert loaded.uncertainty is not None
    # Taken out by hand, it is another model than its uncertainty is of, and than its identity says.
    text = (tmp_path / "model.yaml").read_text().replace("      constant: [", "      #[")
    (tmp_path / "edited.yaml").write_text(text)
    with pytest.raises(ConfigError, match="identification"):
        TorqueModel.load(tmp_path / "edited.yaml")
    values = {**loaded.parameters(), "identification.identity": loaded.identity}
    Settings.from_parameters(values)
    with pytest.raises(ConfigError, match="identification"):
        Settings.from_parameters({**values, "identification.constant": [0.0] * 7})


def test_a_bias_of_the_reading_is_predicted_and_not_compensated(fit, tmp_path):
    model = settle(fit.model, fit.constants, {NAME: "reading"})
    np.testing.assert_allclose(model.torque(Q), fit.model.torque(Q), atol=1e-9)
    torque, with_it = (
        np.array([Settings.from_parameters(each.parameters()).torque(q, None) for q in Q])
        for each in (model, fit.model)
    )
    found = fit.constants[NAME].value * np.eye(7)[SHOULDER]
    np.testing.assert_allclose(with_it - torque, np.tile(found, (len(Q), 1)), atol=1e-9)
    assert NAME in model.constant_is
    model.save(tmp_path / "model.yaml")
    loaded = TorqueModel.load(tmp_path / "model.yaml")
    assert loaded.uncertainty is not None, loaded.why_no_uncertainty
    assert loaded.constant_is == model.constant_is


def test_what_is_stated_of_a_joint_is_in_doubt_no_longer(fit):
    found = constants(fit.model, fit.holding, {NAME: "torque"})
    assert not found[NAME].in_doubt
    assert found["wrist_pitch"].in_doubt, "of others nothing was stated"
    model = settle(fit.model, found, {NAME: "torque"})
    assert not model.constant[SHOULDER]
    assert model.constant[4] == fit.model.constant[4] != 0.0


def test_a_torque_that_is_stated_is_compensated_and_not_in_doubt(recording, tmp_path, capsys):
    recording.save(tmp_path / "run.csv")
    out, read = tmp_path / "model.yaml", tmp_path / "fit.json"
    arguments = [str(tmp_path / "run.csv"), "--arm", "mtmr", "--out", str(out), "--json", str(read),
                 "--terms", ",".join(TERMS), "--no-physical"]  # fmt: skip
    assert command_line.run("dvrk_gravity.cli.identify", [*arguments, "--bias-is", "torque"]) == 0
    model = TorqueModel.load(out)
    assert not model.constant.any()
    assert "torque" in model.constant_is
    assert json.loads(read.read_text())["constants"][NAME]["settled"] == "torque"
    shown = capsys.readouterr().out
    assert NAME in next(line for line in shown.splitlines() if line.startswith("constant torque"))
    assert command_line.run("dvrk_gravity.cli.identify", [*arguments, "--bias-is", "spring"]) == 2
    assert "--bias-is" in capsys.readouterr().err


def test_a_bias_that_weight_looks_like_is_not_taken_out():
    found = Constant(value=0.3, error=0.2, held=1.0, least=0.1)
    with pytest.raises(ConfigError, match=NAME):
        settle(SHIPPED, {NAME: found}, {NAME: "reading"})
    assert "torque" in settle(SHIPPED, {NAME: found}, {NAME: "torque"}).constant_is


@pytest.mark.parametrize(
    ("value", "error", "doubt"),
    [(0.05, 0.01, False), (0.3, 0.01, True), (-0.3, 0.01, True), (0.05, 0.04, True)],
)
def test_a_constant_is_in_doubt_where_it_may_move_the_joint(value, error, doubt):
    constant = Constant(value, error, held=1.0, least=0.1)
    assert constant.in_doubt is doubt
    assert abs(constant.most) == pytest.approx(abs(value) + 2.0 * error)
    assert not replace(constant, settled="torque").in_doubt


@pytest.mark.parametrize(
    ("side", "drift", "settled"),
    [((-0.3, 0.3), 0.001, True), ((0.1, 0.3), 0.001, False), ((-0.3, 0.3), 0.1, False)],
    ids=["both sides", "one side", "drifted"],
)
def test_a_release_on_both_sides_settles_a_constant(side, drift, settled):
    model = replace(SHIPPED, constant=BIAS * np.eye(7)[SHOULDER])
    middle = 0.5 * (ARM.lower + ARM.upper)
    poses = np.array([middle + by for by in side])
    found = settle_constants(model, poses, np.full((2, 7), drift), np.radians(0.5))
    assert found.constant.any() != settled
    assert (NAME in found.constant_is) is settled


def test_the_scale_of_a_recording_stays_on_the_verdict_where_no_masses_are_known(clean):
    whole = truth(1, 24.0, 50.0)
    small = identify(
        [replace(whole, effort=0.45 * whole.effort)], ARM, "joint", TERMS, physical=False
    )
    for fit in (clean, small):
        assert "weigh something" in fit.verdict.reason
        assert "weigh something" in fit.model.reason
    whole_weight, small_weight = (
        next(each.ratio for each in fit.weights if each.joint == NAME) for fit in (clean, small)
    )
    assert small_weight / whole_weight == pytest.approx(0.45, rel=0.02)


@pytest.mark.parametrize(("ratio", "said"), [(1.0, False), (0.9, False), (1.4, True), (0.5, True)])
def test_stated_masses_are_named_where_what_was_found_weighs_something_else(ratio, said):
    weights = (HeldWeight("shoulder", ratio, 0.01, 10.0, stated=True, believed=True),)
    assert (f"shoulder {ratio:g}" in scale_in_words(weights)) is said


def test_cables_of_a_constant_torque_pull_by_it_everywhere():
    torque = np.arange(7.0)
    cable = ElasticCable.constant(ARM, torque)
    np.testing.assert_allclose(replace(SHIPPED, terms=(cable,)).torque(Q), np.tile(torque, (20, 1)))
