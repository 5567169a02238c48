"""Static poses of arms that are no MTM: identified, predicted elsewhere, diagnosed, compensated.

Their efforts are Pinocchio's and MuJoCo's, with friction that sticks (testing/posed_arms.py).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from made_results import Page

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.compensate import Settings, simulation_check
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import Fit, base_weights, evaluate, gravity_of, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing import mujoco_arms
from testing.posed_arms import POSED, Posed, ecm

pytestmark = pytest.mark.usefixtures("blank_pictures")


@dataclass(frozen=True, eq=False)
class Identified:
    """An arm, what was identified from its poses, and the model's file."""

    posed: Posed
    fit: Fit
    file: Path

    @property
    def model(self) -> TorqueModel:
        return TorqueModel.load(self.file)


COUNTS = {"ecm": 80, "psm": 120, "ur5": 120}  # poses


@pytest.fixture(scope="module", params=COUNTS)
def known(request, tmp_path_factory) -> Identified:
    posed, folder = POSED[request.param](), tmp_path_factory.mktemp(request.param)
    posed.record(1, COUNTS[request.param]).save(folder / "poses.csv")
    fit = identify(folder / "poses.csv", posed.arm)
    fit.model.save(folder / "model.yaml")
    return Identified(posed, fit, folder / "model.yaml")


def test_weight_at_poses_elsewhere_is_known_twice_as_well_as_one_pose_tells_it(known):
    q = known.posed.positions(50, 300)
    true = known.posed.weight(q, 0.0)[:, : known.posed.posed]
    error = known.model.torque(q[:, : known.posed.posed]) - true
    assert (np.sqrt(np.mean(error**2, axis=0)) < 0.5 * known.posed.irreducible_error()).all()


def test_weight_at_poses_elsewhere_is_off_by_what_the_model_is_unsure_of(known):
    """Within three standard deviations: an arm's weights are off in a few directions only."""
    q = known.posed.positions(50, 300)
    true = known.posed.weight(q, 0.0)[:, : known.posed.posed]
    state = State(q[:, : known.posed.posed])
    model = known.model
    assert model.uncertainty is not None
    spread = np.linalg.norm(model.uncertainty.torque(model.terms, state), axis=2)
    deviate = (model.torque(state.q) - true) / spread
    rms = np.sqrt(np.mean(deviate**2, axis=0))
    assert (rms < 3.0).all()
    assert rms.max() > 0.3


def test_other_poses_are_off_by_no_more_than_what_sticks(known):
    found = evaluate(known.model, known.posed.record(2, 200)).joints
    rmse = np.array([found[name].rmse for name in known.posed.names])
    assert (rmse < 1.1 * known.posed.irreducible_error()).all()


def test_held_out_error_is_what_other_poses_show(known):
    """Within a quarter, as slabs of few poses tell it."""
    other = evaluate(known.model, known.posed.record(3, 300)).joints
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
    names = [parameter.name for parameter in known.fit.parameters]
    assert not any("beta" in name for name in names)
    assert known.model.term("gravity") is None
    weights = known.model.term("link_weight")
    assert weights is not None
    assert weights.carries_arm
    assert list(known.model.arm.joint_names) == list(known.posed.names)
    of = {parameter.name: parameter for parameter in known.fit.parameters}
    for joint in known.model.arm.joints:
        first = f"directional_cable.positive.{joint.name}"
        units = [of[f"{first}[{power}]"].unit for power in (0, 2) if f"{first}[{power}]" in of]
        slides = joint.kind == "prismatic"
        assert units == (["N", "N/m^2"] if slides else ["N·m", "N·m/rad^2"]), joint.name
    cable = known.model.parameters()
    assert cable["directional_cable.dead_band"] == pytest.approx(0.02 * known.model.arm.scale)


def test_weights_that_the_poses_determine_lie_in_their_intervals(known):
    """Every combination of the links' weights, as the plant's own efforts give it."""
    arm = known.model.arm
    q = known.posed.positions(60, 200)
    first = slice(known.posed.posed)
    gravity = gravity_of(arm)
    columns = gravity.at(q[:, first])
    true = known.posed.weight(q, 0.0)[:, first].ravel()
    theta, _, rank, _ = np.linalg.lstsq(columns.reshape(-1, columns.shape[-1]), true, rcond=None)
    assert rank == gravity.count
    values = gravity.parameters(theta)
    links = np.concatenate([values[f"link_weight.{body}"] for body in arm.body_names])
    found = {parameter.name: parameter for parameter in known.fit.parameters}
    inside = [
        found[name].ci95[0] <= combination @ links <= found[name].ci95[1]
        for name, _, combination in base_weights(arm)
    ]
    assert np.mean(inside) >= 0.8


def test_friction_is_told_apart_where_directions_are_known_and_else_this_is_said(known):
    said = " ".join(known.fit.identifiability.statements)
    q = known.posed.positions(40, 100)[:, : known.posed.posed]
    up, down = (known.model.torque(q, direction=np.full(q.shape, way)) for way in (1.0, -1.0))
    friction = np.mean(0.5 * (up - down), axis=0)
    if known.posed.directed:
        assert known.fit.verdict.level == "good"
        assert "approached from one direction" not in said
        mean = 0.75 * known.posed.friction[: known.posed.posed]
        np.testing.assert_allclose(friction, mean, rtol=0.1)
    else:
        assert (up == down).all()
        assert f"{', '.join(known.posed.names)}: approached from one direction only" in said
        assert "cannot be separated" in said
        assert known.fit.verdict.level in ("good", "usable")


def test_an_untouched_arm_is_quiet(known):
    diagnosis = diagnose(known.posed.record(4, 200), known.model)
    assert (diagnosis.verdict, diagnosis.findings) == ("nothing_to_explain", ())


def test_a_load_is_found_and_weighed_at_other_poses(known):
    loaded = known.posed.record(5, 200, known.posed.load)
    diagnosis = diagnose(loaded, known.model)
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


def test_the_compensator_takes_the_model_and_sends_what_holds_the_links(known):
    settings = Settings.from_parameters(known.model.parameters())
    for q in known.posed.positions(70, 20):
        first = q[: known.posed.posed]
        sent = settings.torque(first, np.zeros(known.posed.posed))
        true = known.posed.weight(q[None], 0.0)[0, : known.posed.posed]
        # What friction would hold anyway.
        assert (np.abs(sent - true) < known.posed.friction[: known.posed.posed]).all()


def test_from_a_file_of_three_joints_to_a_load_on_the_command_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(simulation_check.let_go, "__defaults__", (0.1, 1.0))  # s; of friction
    posed, model, out = ecm(), tmp_path / "model.yaml", tmp_path / "diagnosis"
    for name, seed, load in (("poses", 1, 0.0), ("other", 7, 0.0), ("loaded", 8, posed.load)):
        posed.record(seed, 80, load).save(tmp_path / f"{name}.csv")
    poses, other, loaded = (str(tmp_path / f"{name}.csv") for name in ("poses", "other", "loaded"))

    assert main(["identify", poses, "--arm", "ecm", "--out", str(model)]) == 0
    shown = capsys.readouterr().out
    assert "assumed held (rad, m): roll at 0" in shown
    assert main(["evaluate", other, "--model", str(model)]) == 0
    shown = capsys.readouterr().out
    assert "(RMSE in N)" in shown
    assert "verdict in the model file: good" in shown
    assert main(["diagnose", loaded, "--model", str(model), "--out", str(out)]) == 0
    found = json.loads((out / "findings.json").read_text())
    first = found["findings"][0]
    assert (first["effect"], first["joints"]) == ("payload", ["insertion"])
    # What a compensator does with both models is shown, though the ECM's plant has a joint more.
    assert found["simulation"]["drift"]
    assert TorqueModel.load(out / "extended_model.yaml").term("payload") is not None

    page = model.with_suffix(".html").read_text()
    assert Page(page).open == []
    for said in ("RMSE, N·m (insertion N)", "m(link3) +1 m(link4)", "N/m^2"):
        assert said in page
    assert "beta" not in page


def test_where_a_joint_stood_that_poses_do_not_hold_can_be_said(tmp_path, capsys):
    poses, model = str(tmp_path / "poses.csv"), tmp_path / "model.yaml"
    ecm().record(1, 80, 0.0).save(poses)

    said = ["identify", poses, "--arm", "ecm", "--at", "roll=0.3rad", "--out", str(model)]
    assert main(said) == 0

    assert "held as given (rad, m): roll at 0.3: not joints" in capsys.readouterr().out
    assert TorqueModel.load(model).arm.held == {"roll": 0.3}


def test_a_joint_that_slides_is_told_in_its_own_units_where_it_was_not_posed():
    posed = ecm()
    still = posed.record(9, 60)
    position = still.position.copy()
    position[:, 2] = 0.1 + 0.004 * np.random.default_rng(9).uniform(-1.0, 1.0, 60)
    q = np.column_stack([position, np.zeros(60)])
    recording = replace(still, position=position, effort=posed.weight(q, 0.0)[:, :3])
    said = identify(recording, "ecm").identifiability.statements
    expected = "insertion was posed at 100 mm only: a constant is all of its torque"
    assert any(line.startswith(expected) for line in said)


def test_efforts_in_amperes_give_a_model_in_amperes():
    posed, gain = ecm(), 4.0  # N·m/A and N/A
    recording = posed.record(1, 80)
    currents = replace(recording, effort=recording.effort / gain, arm=None)
    fit = identify(currents, posed.arm.with_effort_unit("A", 1.0 / gain))
    assert {parameter.unit for parameter in fit.parameters if parameter.name.startswith("m")} == {
        "kg·A/(N·m)", "kg·m·A/(N·m)",
    }  # fmt: skip
    q = posed.positions(50, 300)
    error = gain * fit.model.torque(q[:, :3]) - posed.weight(q, 0.0)[:, :3]
    assert (np.sqrt(np.mean(error**2, axis=0)) < 0.5 * posed.irreducible_error()).all()


@pytest.mark.parametrize("name", ["ecm", "psm", "ur5", "panda", "chain"])
def test_base_weights_span_what_torque_at_rest_depends_on(name):
    arm = mujoco_arms.arm_of(name)
    q = np.random.default_rng(7).uniform(*arm.range, (200, arm.n))
    whole = rigid_body.regressor(arm, q, None, None, arm.gravity).reshape(-1, len(arm.bodies), 10)
    full = whole[..., :4].reshape(len(whole), -1)
    combinations = np.array([combination for _, _, combination in base_weights(arm)])
    assert len(combinations) == np.linalg.matrix_rank(full, tol=1e-9 * np.linalg.norm(full))
    residual = full - full @ np.linalg.pinv(combinations) @ combinations
    assert np.abs(residual).max() < 1e-6 * np.abs(full).max()


@pytest.mark.parametrize("name", ["mtmr", "ecm", "psm", "ur5"])
def test_coefficients_become_parameters_of_the_same_torque(name):
    arm = mujoco_arms.arm_of(name)
    columns = gravity_of(arm)
    q = np.random.default_rng(8).uniform(*arm.range, (50, arm.n))
    theta = np.random.default_rng(9).normal(size=columns.count)
    model = TorqueModel.from_parameters({"arm": arm.source, **columns.parameters(theta)}, arm)
    expected = columns.at(q) @ theta
    np.testing.assert_allclose(model.torque_at(State(q)), expected, atol=1e-9)


def test_only_an_mtm_s_wrist_pitch_has_a_spring():
    assert gravity_of(Arm.load("mtml")).sprung == ("wrist_pitch",)
    assert gravity_of(Arm.load("psm")).sprung == ()


@pytest.mark.parametrize(("name", "expected"), [("ecm", 20), ("panda", 24)])
def test_too_few_poses_are_refused(name, expected):
    arm = mujoco_arms.arm_of(name)
    q = np.random.default_rng(0).uniform(*arm.range, (expected - 1, arm.n))
    recording = Recording(arm.joint_names, None, q, effort=np.sin(q), source="few.csv")
    with pytest.raises(
        RecordingError,
        match=f"^few.csv: holds {expected - 1} static poses, expected at least {expected}$",
    ):
        identify(recording, arm)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"for_console": True}, "^--for-console: got 'ecm', expected an arm of the console"),
        ({"physical": True}, "^--physical: got True, expected trajectories: static poses"),
        ({"effects": ["payload"]}, "^--terms: got 'payload', expected no --terms with static"),
    ],
)
def test_what_poses_cannot_give_is_refused_in_one_line(options, says):
    posed = ecm()
    with pytest.raises(ConfigError, match=says) as caught:
        identify(posed.record(1, 40), posed.arm, **options)
    assert "\n" not in str(caught.value)
