"""A master arm with a known truth is identified: parameters, other motions, wrong efforts."""

from __future__ import annotations

import json
from dataclasses import replace

import fitted
import numpy as np
import pytest
from fitted import FEW
from known_mtm import ARM, COULOMB, NOISE, SPRING, parameter, truth

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.effects import Site
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification import Fit, build_problem, estimate, evaluate, identify
from dvrk_gravity.model import start_columns
from dvrk_gravity.observation import decide_coordinates, observe, stands
from dvrk_gravity.recording import Recording, clipped_efforts

# --- all that there is -------------------------------------------------------------------


@pytest.fixture(scope="module")
def fit() -> Fit:
    return fitted.mtm()


def test_another_motion_is_predicted_to_its_noise_in_joint_and_in_motor_coordinates(fit):
    assert fit.coordinates == "joint"
    other = truth(2)
    motor = replace(
        other,
        position=ARM.actuator_position(other.position),
        velocity=ARM.actuator_position(other.velocity),
        effort=ARM.actuator_effort(other.effort),
    )
    for recording, coordinates in ((other, "joint"), (motor, "actuator")):
        result = evaluate(fit.model, [recording])
        assert result.coordinates == coordinates
        for name, error in result.joints.items():
            assert error.r2 > 0.95, (name, coordinates)


def test_known_parameters_come_out(fit):
    assert parameter(fit, "elastic_cable.wrist_pitch[1]").value == pytest.approx(SPRING, rel=0.1)
    for j in (0, 1, 3, 4, 5, 6):
        found = parameter(fit, f"coulomb_friction.joint[{JOINT_NAMES[j]}]")
        assert found.value == pytest.approx(COULOMB[j], rel=0.15), found.name
    elbow = parameter(fit, "coulomb_friction.motor[elbow_pitch]")
    assert elbow.value == pytest.approx(COULOMB[2], rel=0.15)
    for each in fit.parameters:
        if each.name.startswith(("coulomb", "viscous", "presliding", "rotor")):
            assert each.value >= 0.0, each.name


def test_what_does_not_improve_is_left_out(fit):
    dropped = {choice.term for choice in fit.choices if not choice.kept}
    assert any(term.startswith("presliding_hysteresis wrist_pitch") for term in dropped)
    doubtful = {name for name, each in fit.verdict.joints.items() if each.level != "good"}
    assert doubtful == {"wrist_pitch"}, "which has a spring: is its mean a bias?"
    assert fit.verdict.level == fit.model.verdict == "usable"


def test_elastic_torque_is_held_at_the_edge_of_the_data(fit):
    valid, q = fit.model.term("elastic_cable").valid, truth(1).position
    tolerance = 0.02  # rad: the filter rounds the extremes
    np.testing.assert_allclose(valid.lower, q.min(axis=0), atol=tolerance)
    np.testing.assert_allclose(valid.upper, q.max(axis=0), atol=tolerance)


# --- what data leave open ----------------------------------------------------------------


def test_friction_that_presliding_shares_is_not_called_identifiable():
    problem = build_problem(observe([truth(1)], ARM), ARM)
    element = problem.design.columns.select("presliding_hysteresis", Site.joint(4), index=0)
    found = estimate(problem, sorted({*start_columns(problem.design.columns), *element}))
    names = ("coulomb_friction", "presliding_hysteresis")
    friction = [p for p in found.parameters if p.name.startswith(names)]
    shared = [p for p in friction if "wrist_pitch" in p.name]
    assert len(shared) == 2
    assert [p for p in friction if not p.identifiable] == shared
    both = sum(p.value for p in shared)
    assert both == pytest.approx(COULOMB[4], rel=0.15)
    assert any(f"{both:.3g} N·m" in each for each in found.identifiability.statements)


def test_torque_that_friction_held_at_a_joint_that_stood_still_is_not_in_the_model():
    moving = truth(1, 12.0)
    held = np.array([1, 1, 1, 1, 1, 1, 0])
    position = held * moving.position + 0.3 * (1 - held)
    stiction = held * moving.effort + 0.01 * (1 - held)
    stiction += NOISE[6] * np.random.default_rng(3).normal(size=(len(stiction), 1)) * (1 - held)
    standing = replace(moving, position=position, velocity=held * moving.velocity, effort=stiction)
    effects = ["coulomb_friction", "elastic_cable"]
    found = identify([standing], ARM, "joint", effects, physical=False, bias_is="torque")
    cable = found.model.term("elastic_cable")
    assert cable is None or not cable.coefficients[:, 6].any()
    assert abs(found.model.torque(position[0])[6]) < 0.005
    assert found.verdict.level == found.verdict.joints["wrist_roll"].level == "do_not_compensate"
    assert "wrist_roll" in found.verdict.joints["wrist_roll"].record
    assert found.verdict.joints["shoulder_pitch"].level == "good"
    json.dumps(found.to_json(), allow_nan=False)


def test_a_joint_stands_where_it_rubs_and_moves_too_little():
    lower, upper = np.zeros(7), np.array([1.0, 1, 1, 1, 1, 1, 0.001])
    assert stands(lower, upper, ARM).tolist() == [False] * 6 + [True]
    assert not stands(lower, upper, replace(ARM, frictionless=("wrist_roll",))).any()


# --- efforts that are no measurement -----------------------------------------------------


def test_efforts_that_are_no_longer_read_are_fitted_and_compared_without(fit):
    clean = truth(1, 16.0)
    effort = clean.effort.copy()
    effort[800:, 5] = effort[800, 5]
    frozen = replace(clean, effort=effort)
    found = identify([frozen], ARM, "joint", FEW, physical=False)
    friction = parameter(found, "coulomb_friction.joint[wrist_yaw]").value
    assert friction == pytest.approx(COULOMB[5], rel=0.3)
    (warned,) = [warning for warning in found.warnings if warning.kind == "effort_frozen"]
    assert warned.joint == "wrist_yaw"
    compared = evaluate(fit.model, [frozen], "joint")
    assert compared.samples < 0.6 * evaluate(fit.model, [clean], "joint").samples
    assert compared.joints["wrist_yaw"].nrmse < 2.0 * fit.held_out["wrist_yaw"].nrmse


def test_clipped_efforts_are_found_and_the_rest_makes_a_model_that_holds_the_arm():
    known, joint = fitted.chain(), 1
    assert clipped_efforts(known.recording) == []
    effort = known.recording.effort.copy()
    limit = 0.8 * np.abs(effort[:, joint]).max()
    effort[:, joint] = np.clip(effort[:, joint], -limit, limit)
    clipped = replace(known.recording, effort=effort)

    spans = clipped_efforts(clipped)
    found = identify([clipped], known.arm, "joint", FEW, physical=False)

    assert {(span.joint, abs(span.value)) for span in spans} == {(joint, limit)}
    inside = np.zeros(len(clipped), dtype=bool)
    for span in spans:
        inside[slice(*span.rows)] = True
    at_limit = np.abs(effort[:, joint]) == limit
    assert at_limit[inside].all()
    assert np.mean(inside[at_limit]) > 0.8
    q = known.recording.position[::50]
    whole, part = (model.torque(q)[:, joint] for model in (known.fit.model, found.model))
    assert np.abs(part - whole).max() < 0.05 * np.abs(whole).max()


# --- coordinates -------------------------------------------------------------------------


def test_an_arm_without_transmission_has_one_kind_of_coordinates():
    direct = replace(ARM, actuator_to_joint=np.eye(7))
    decision = decide_coordinates(truth(1), direct, None)
    assert (decision.coordinates, decision.reason) == ("joint", "")


# --- recordings that judge ---------------------------------------------------------------


def test_validation_recordings_judge_the_model_and_are_not_fitted():
    first, second = truth(5, 12.0, 50.0), truth(6, 12.0, 50.0)
    effects = ["coulomb_friction"]
    found = identify([first], ARM, "joint", effects, validate=[second], physical=False)
    assert found.held_out == evaluate(found.model, [second], "joint").joints
    assert found.model.term("viscous_friction") is None
    with pytest.raises(RecordingError, match="fitted or already validated"):
        identify([first], ARM, validate=[second, replace(first, source="copy.csv")])


# --- command line ------------------------------------------------------------------------


def run(verb: str, *words: object) -> int:
    return command_line.run(f"dvrk_gravity.cli.{verb}", [str(word) for word in words])


def test_command_lines_write_model_report_and_json(tmp_path):
    known = fitted.chain()
    data, out, told = (tmp_path / name for name in ("run.csv", "model.yaml", "told.json"))
    known.recording.rows(slice(1000)).save(data)
    options = ("--json", told, "--terms", ",".join(FEW), "--verbose")
    assert run("identify", data, "--arm", known.arm.source, "--out", out, *options) == 0
    content = json.loads(told.read_text())
    assert list(content["joints"]) == list(known.arm.joint_names)
    assert set(content["joints"]["yaw"]) == {"rmse", "floor", "nrmse", "r2"}
    assert "http" not in (tmp_path / "model.html").read_text().replace("http-equiv", "")
    told.unlink()
    page = tmp_path / "e.html"
    assert run("evaluate", data, "--model", out, "--json", told, "--report", page) == 0
    result = json.loads(told.read_text())
    assert result["samples"] > 800
    assert result["joints"]["yaw"]["nrmse"] < 0.2
    assert "<h1" in page.read_text()


def without(recording: Recording, joint: int) -> Recording:
    keep = [j for j in range(7) if j != joint]
    return Recording(
        tuple(JOINT_NAMES[j] for j in keep), recording.time, recording.position[:, keep],
        recording.velocity[:, keep], recording.effort[:, keep],
    )  # fmt: skip


GOOD = truth(8, 6.0)
BAD = {
    "wrist_roll": without(GOOD, 6),
    "no joint moves": replace(GOOD, position=0.0 * GOOD.position, velocity=0.0 * GOOD.position),
    "expected rad": replace(GOOD, position=np.degrees(GOOD.position)),
    "no effort": replace(GOOD, effort=None),
    "samples in a row": GOOD.rows(slice(0, 60)),
    "expected N·m, not mN·m": replace(GOOD, effort=1e3 * GOOD.effort),
    "efforts of elbow_pitch are all the same (0.3)": replace(
        GOOD, effort=np.where(np.arange(7) == 2, 0.3, GOOD.effort)
    ),
    "expected seconds, not ms": replace(GOOD, time=1e3 * GOOD.time),
    "sampling rate of 10 Hz": replace(GOOD, time=10.0 * GOOD.time),
    "expected N·m": replace(GOOD, effort=GOOD.effort[:, ::-1].copy()),
}


def test_a_bad_recording_gives_one_line_and_no_model(tmp_path, capsys):
    path, out = tmp_path / "bad.csv", tmp_path / "model.yaml"
    for says, recording in BAD.items():
        recording.save(path)
        assert run("identify", path, "--arm", "mtmr", "--out", out) == 2, says
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert "bad.csv" in line
        assert says in line
        assert not out.exists(), says
        path.unlink()


def test_an_unknown_term_is_named(tmp_path, capsys):
    GOOD.save(tmp_path / "run.csv")
    words = (
        tmp_path / "run.csv",
        "--arm",
        "mtmr",
        "--out",
        tmp_path / "m.yaml",
        "--terms",
        "magic",
    )
    assert run("identify", *words) == 2
    assert "magic" in capsys.readouterr().err
