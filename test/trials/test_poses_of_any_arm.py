"""Static poses of arms that are no MTM: identified, predicted elsewhere, diagnosed, compensated.

Their efforts are Pinocchio's and MuJoCo's, with friction that sticks (testing/posed_arms.py).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import rigid_body
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import Fit, base_weights, evaluate, gravity_of, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing import mujoco_arms
from testing.posed_arms import POSED, Posed, ecm


@dataclass(frozen=True, eq=False)
class Identified:
    """An arm, what was identified from its poses, and the model's file."""

    posed: Posed
    fit: Fit
    file: Path

    @property
    def model(self) -> TorqueModel:
        return TorqueModel.load(self.file)


# Poses: of the one both directions are known, of the other not.
COUNTS = {"ecm": 80, "ur5": 120}


@pytest.fixture(scope="module", params=COUNTS)
def known(request, tmp_path_factory) -> Identified:
    posed, folder = POSED[request.param](), tmp_path_factory.mktemp(request.param)
    posed.record(1, COUNTS[request.param]).save(folder / "poses.csv")
    fit = identify(folder / "poses.csv", posed.arm)
    fit.model.save(folder / "model.yaml")
    return Identified(posed, fit, folder / "model.yaml")


def test_weight_at_other_poses_is_known_better_than_one_pose_shows_it_and_as_well_as_said(known):
    """Within three standard deviations: an arm's weights are off in a few directions only."""
    q = known.posed.positions(50, 300)
    true = known.posed.weight(q, 0.0)[:, : known.posed.posed]
    state, model = State(q[:, : known.posed.posed]), known.model
    error = model.torque(state.q) - true
    assert (np.sqrt(np.mean(error**2, axis=0)) < 0.5 * known.posed.irreducible_error()).all()
    spread = np.linalg.norm(model.uncertainty.torque(model.terms, state), axis=2)
    rms = np.sqrt(np.mean((error / spread) ** 2, axis=0))
    assert (rms < 3.0).all()
    assert rms.max() > 0.3


def test_held_out_error_is_what_other_poses_show_and_that_is_what_sticks(known):
    other = evaluate(known.model, known.posed.record(2, 300)).joints
    rmse = np.array([other[name].rmse for name in known.posed.names])
    assert (rmse < 1.1 * known.posed.irreducible_error()).all()
    for name, error in known.fit.held_out.items():
        assert error.rmse == pytest.approx(other[name].rmse, rel=0.25), name


def test_far_from_the_poses_the_model_is_off_by_about_as_much_as_it_says():
    posed = ecm()
    fit = identify(posed.record(1, 100, used=0.25), "ecm")
    q = posed.positions(50, 300, used=1.0)
    error = fit.model.torque(q[:, :3]) - posed.weight(q, 0.0)[:, :3]
    said = np.array([fit.holding[name].error_anywhere for name in posed.names])
    rmse = np.sqrt(np.mean(error**2, axis=0))
    assert (rmse > posed.irreducible_error()).any()  # much is open there
    assert (rmse < 2.0 * said).all(), (rmse, said)


def test_the_model_has_the_arm_s_own_links_and_units(known):
    of = {parameter.name: parameter for parameter in known.fit.parameters}
    assert not any("beta" in name for name in of)
    assert known.model.term("link_weight").carries_arm
    assert list(known.model.arm.joint_names) == list(known.posed.names)
    for joint in known.model.arm.joints:
        first = f"directional_cable.positive.{joint.name}"
        units = [of[f"{first}[{power}]"].unit for power in (0, 2) if f"{first}[{power}]" in of]
        slides = joint.kind == "prismatic"
        assert units == (["N", "N/m^2"] if slides else ["N·m", "N·m/rad^2"]), joint.name


def test_friction_is_separated_where_directions_are_known(known):
    q = known.posed.positions(40, 100)[:, : known.posed.posed]
    up, down = (known.model.torque(q, direction=np.full(q.shape, way)) for way in (1.0, -1.0))
    if known.posed.directed:
        assert known.fit.verdict.level == "good"
        mean = 0.75 * known.posed.friction[: known.posed.posed]
        np.testing.assert_allclose(np.mean(0.5 * (up - down), axis=0), mean, rtol=0.1)
    else:
        assert (up == down).all()
        assert known.fit.verdict.level in ("good", "usable")


def test_the_compensator_takes_the_model_and_sends_what_holds_the_links(known):
    settings = Settings.from_parameters(known.model.parameters())
    for q in known.posed.positions(70, 20):
        first = q[: known.posed.posed]
        sent = settings.torque(first, np.zeros(known.posed.posed))
        true = known.posed.weight(q[None], 0.0)[0, : known.posed.posed]
        # What friction would hold anyway.
        assert (np.abs(sent - true) < known.posed.friction[: known.posed.posed]).all()


def test_an_untouched_arm_is_quiet_and_a_load_is_found_weighed_and_taken_into_the_model(known):
    quiet = diagnose(known.posed.record(4, 200), known.model)
    assert (quiet.verdict, quiet.findings) == ("nothing_to_explain", ())
    diagnosis = diagnose(known.posed.record(5, 200, known.posed.load), known.model)
    payload = diagnosis.findings[0]
    assert (payload.effect, payload.joints) == ("payload", (known.posed.carries,))
    mass = payload.parameters["mass"]
    assert mass.value == pytest.approx(known.posed.load, rel=0.2)
    assert mass.low <= known.posed.load <= mass.high
    again = known.posed.record(6, 200, known.posed.load)
    errors = [evaluate(model, again).joints for model in (known.model, diagnosis.model)]
    before, after = ([error[name].rmse for name in known.posed.names] for error in errors)
    assert np.max(np.divide(before, known.posed.irreducible_error())) > 1.5
    assert (np.array(after) < 1.25 * known.posed.irreducible_error()).all()


def test_three_of_four_joints_go_through_the_command_lines_the_fourth_held_where_it_is_said(
    tmp_path, capsys
):
    poses, model, told = (str(tmp_path / name) for name in ("p.csv", "m.yaml", "told.json"))
    ecm().record(1, 80, 0.0).save(poses)
    assert main(["identify", poses, "--arm", "ecm", "--out", model]) == 0
    assert TorqueModel.load(model).arm.held == {"roll": 0.0}
    assert main(["evaluate", poses, "--model", model, "--json", told]) == 0
    assert list(json.loads(Path(told).read_text())["joints"]) == list(ecm().names)
    elsewhere = str(tmp_path / "elsewhere.yaml")
    assert main(["identify", poses, "--arm", "ecm", "--at", "roll=0.3rad", "--out", elsewhere]) == 0
    assert TorqueModel.load(elsewhere).arm.held == {"roll": 0.3}
    assert "roll at 0.3" in capsys.readouterr().out


def test_efforts_in_amperes_give_a_model_in_amperes():
    posed, gain = ecm(), 4.0  # N·m/A and N/A
    recording = posed.record(1, 80)
    currents = replace(recording, effort=recording.effort / gain, arm=None)
    fit = identify(currents, posed.arm.with_effort_unit("A", 1.0 / gain))
    assert {each.unit for each in fit.parameters if each.name.startswith("m")} == {
        "kg·A/(N·m)", "kg·m·A/(N·m)",
    }  # fmt: skip
    q = posed.positions(50, 300)
    error = gain * fit.model.torque(q[:, :3]) - posed.weight(q, 0.0)[:, :3]
    assert (np.sqrt(np.mean(error**2, axis=0)) < 0.5 * posed.irreducible_error()).all()


def test_base_weights_span_what_torque_at_rest_depends_on():
    for name in ("ecm", "psm", "ur5"):
        arm = mujoco_arms.arm_of(name)
        q = np.random.default_rng(7).uniform(*arm.range, (200, arm.n))
        whole = rigid_body.regressor(arm, q, None, None, arm.gravity)
        full = whole.reshape(-1, len(arm.bodies), 10)[..., :4].reshape(200 * arm.n, -1)
        combinations = np.array([combination for _, _, combination in base_weights(arm)])
        rank = np.linalg.matrix_rank(full, tol=1e-9 * np.linalg.norm(full))
        assert len(combinations) == rank, name
        residual = full - full @ np.linalg.pinv(combinations) @ combinations
        assert np.abs(residual).max() < 1e-6 * np.abs(full).max(), name


def test_coefficients_become_parameters_of_the_same_torque():
    for name, sprung in (("mtmr", ("wrist_pitch",)), ("psm", ()), ("ur5", ())):
        arm = mujoco_arms.arm_of(name)
        columns = gravity_of(arm)
        assert columns.sprung == sprung, name
        q = np.random.default_rng(8).uniform(*arm.range, (50, arm.n))
        theta = np.random.default_rng(9).normal(size=columns.count)
        model = TorqueModel.from_parameters({"arm": arm.source, **columns.parameters(theta)}, arm)
        np.testing.assert_allclose(model.torque_at(State(q)), columns.at(q) @ theta, atol=1e-9)


def test_fewer_poses_than_the_columns_of_the_largest_joint_need_are_refused():
    arm, expected = mujoco_arms.arm_of("panda"), 24
    q = np.random.default_rng(0).uniform(*arm.range, (expected - 1, arm.n))
    recording = Recording(arm.joint_names, None, q, effort=np.sin(q), source="few.csv")
    says = f"^few.csv: holds {expected - 1} static poses, expected at least {expected}$"
    with pytest.raises(RecordingError, match=says):
        identify(recording, arm)


def test_what_poses_cannot_give_is_refused_in_one_line():
    posed = ecm()
    for options, says in (
        ({"for_console": True}, "^--for console: got 'ecm'"),
        ({"physical": True}, "^--physical: got True"),
        ({"effects": ["payload"]}, "^--terms: got 'payload'"),
    ):
        with pytest.raises(ConfigError, match=says) as caught:
            identify(posed.record(1, 40), posed.arm, **options)
        assert "\n" not in str(caught.value)
