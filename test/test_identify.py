"""From recordings to models: the command lines, known truth, measured data, bad recordings."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from conftest import few_folds
from known_mtm import ARM, COULOMB, NOISE, SPRING, parameter, truth

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification import estimate, evaluate, identify, pose
from dvrk_gravity.intake import LOOKED_AT, decide_coordinates, read_motions, stands
from dvrk_gravity.model import TorqueModel, start_columns
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import fit_text
from testing.lab_motion import draw_calibration
from testing.mujoco_world import DURATION, MujocoWorld

pytestmark = pytest.mark.usefixtures("four_folds", "blank_pictures")


@pytest.fixture(scope="module")
def fit():
    return identify([truth(1)], ARM)


def test_torque_that_friction_held_at_a_joint_that_stood_still_is_not_in_the_model():
    moving = truth(1)
    held = np.array([1, 1, 1, 1, 1, 1, 0])
    position = held * moving.position + 0.3 * (1 - held)
    stiction = held * moving.effort + 0.01 * (1 - held)
    stiction += NOISE[6] * np.random.default_rng(3).normal(size=(len(stiction), 1)) * (1 - held)
    standing = replace(moving, position=position, velocity=held * moving.velocity, effort=stiction)
    found = identify([standing], ARM, "joint", ["coulomb_friction", "elastic_cable"])
    cable = found.model.term("elastic_cable")
    assert cable is None or not cable.coefficients[:, 6].any()
    assert abs(found.model.torque(position[0])[6]) < 0.005
    assert found.verdict.level == "do_not_compensate"
    assert "stood still all the time" in found.verdict.joints["wrist_roll"].reason
    assert found.verdict.joints["wrist_roll"].record == "a motion of wrist_roll, too"
    assert found.verdict.joints["shoulder_pitch"].level == "good"
    assert any("not fitted: efforts of wrist_roll," in line for line in found.handling)
    json.dumps(found.to_json(), allow_nan=False)


def test_where_nothing_rubs_a_joint_that_stood_still_is_fitted():
    lower, upper = np.zeros(7), np.array([1.0, 1, 1, 1, 1, 1, 0.001])
    assert stands(lower, upper, ARM).tolist() == [False] * 6 + [True]
    assert not stands(lower, upper, replace(ARM, frictionless=("wrist_roll",))).any()


def test_efforts_that_are_no_longer_read_are_fitted_and_compared_without(fit):
    clean = truth(1)
    effort = clean.effort.copy()
    effort[1200:, 5] = effort[1200, 5]
    frozen = replace(clean, effort=effort)
    found = identify([frozen], ARM, "joint")
    friction = parameter(found, "coulomb_friction.joint[wrist_yaw]").value
    assert friction == pytest.approx(COULOMB[5], rel=0.3)
    assert found.held_out["wrist_yaw"].nrmse < 2.0 * fit.held_out["wrist_yaw"].nrmse
    (told,) = [warning for warning in found.warnings if warning.kind == "effort_frozen"]
    assert told.joint == "wrist_yaw"
    compared = evaluate(fit.model, [frozen], "joint")
    assert compared.samples < 0.6 * evaluate(fit.model, [clean], "joint").samples
    assert compared.joints["wrist_yaw"].nrmse < 2.0 * fit.held_out["wrist_yaw"].nrmse


def test_another_motion_is_predicted_to_its_noise(fit):
    result = evaluate(fit.model, [truth(2)])
    assert result.coordinates == "joint"
    for name, error in result.joints.items():
        assert error.r2 > 0.95, name


def test_coordinates_of_both_kinds_are_recognised(fit):
    assert fit.coordinates == "joint"
    recording = truth(1)
    motor = replace(
        recording,
        position=ARM.actuator_position(recording.position),
        velocity=ARM.actuator_position(recording.velocity),
        effort=ARM.actuator_effort(recording.effort),
    )
    result = evaluate(fit.model, [motor])
    assert result.coordinates == "actuator"
    assert decide_coordinates(motor, ARM, None).coordinates == "actuator"


def recorded_in(world: MujocoWorld, seed: int, coordinates: str, duration: float = DURATION):
    """Return a calibration of another engine's arm, in some coordinates."""
    recording = world.record(world.truth(draw_calibration(world.arm, seed), duration), seed)
    if coordinates == "joint":
        return recording
    arm = world.arm
    return replace(
        recording,
        position=arm.actuator_position(recording.position),
        velocity=None,
        effort=arm.actuator_effort(recording.effort),
    )


@pytest.mark.parametrize("coordinates", ["joint", "actuator"])
@pytest.mark.parametrize(("name", "seed"), [("mtmr", 1576), ("psm", 3031), ("psm", 3002)])
def test_coordinates_are_told_by_errors_of_what_was_recorded(name, seed, coordinates):
    """Of this MTM two weights all but cancel at a motor: read wrongly it seems to bear both, and
    the same error is a smaller part of more torque. Errors of a PSM's joints hang together.
    """
    world = MujocoWorld.draw(name, seed)
    recording = recorded_in(world, seed, coordinates)
    assert decide_coordinates(recording, world.arm, None).coordinates == coordinates


def test_coordinates_of_a_longer_recording_are_told_by_its_beginning():
    world = MujocoWorld.draw("mtmr", 3001)
    longer = LOOKED_AT + 5.0
    recording = recorded_in(world, 3001, "actuator", longer)
    assert decide_coordinates(recording, world.arm, None).coordinates == "actuator"


def test_of_an_arm_without_transmission_nothing_is_said_of_coordinates():

    direct = replace(ARM, actuator_to_joint=np.eye(7))
    decision = decide_coordinates(truth(1), direct, None)
    assert (decision.coordinates, decision.reason) == ("joint", "")
    assert evaluate(TorqueModel(direct, ()), [truth(1)]).detected == ""


def test_known_parameters_come_out(fit):
    assert parameter(fit, "elastic_cable.wrist_pitch[1]").value == pytest.approx(SPRING, rel=0.1)
    for j in (0, 1, 3, 4, 5, 6):
        found = parameter(fit, f"coulomb_friction.joint[{JOINT_NAMES[j]}]")
        assert found.value == pytest.approx(COULOMB[j], rel=0.15), found.name
    elbow = parameter(fit, "coulomb_friction.motor[elbow_pitch]")
    assert elbow.value == pytest.approx(COULOMB[2], rel=0.15)


def test_friction_has_its_sign(fit):
    for fitted in fit.parameters:
        if fitted.name.startswith(("coulomb", "viscous", "presliding", "rotor")):
            assert fitted.value >= 0.0, fitted.name


def test_a_burst_of_wrong_efforts_hardly_moves_the_parameters():
    recording = truth(1)
    effort = recording.effort.copy()
    effort[600:612, 3] += 1.0  # fifty times the joint's Coulomb friction
    clean, hit = (_plain_estimate(case) for case in (recording, replace(recording, effort=effort)))
    for name in ("coulomb_friction.joint[wrist_platform]", "beta[3]"):
        before, after = parameter(clean, name), parameter(hit, name)
        half = 0.5 * (before.ci95[1] - before.ci95[0])
        assert abs(after.value - before.value) < half, name
        assert 0.5 * (after.ci95[1] - after.ci95[0]) < 1.5 * half, name


def _plain_estimate(recording: Recording, arm: Arm = ARM):
    problem = pose(read_motions([recording], arm, "joint").parts, arm)
    return estimate(problem, start_columns(problem.design.columns))


def test_what_does_not_pay_is_left_out_and_said(fit):
    dropped = [choice for choice in fit.choices if not choice.kept]
    assert any(choice.term.startswith("presliding_hysteresis wrist_pitch") for choice in dropped)
    assert any("does not improve" in choice.reason for choice in dropped)
    assert all("does not improve" in c.reason or "not by enough" in c.reason for c in dropped)


def test_the_model_goes_unchanged_to_the_compensator(fit, tmp_path):
    fit.model.save(tmp_path / "model.yaml")
    model = TorqueModel.load(tmp_path / "model.yaml")
    settings = Settings.from_parameters(model.parameters())
    assert (settings.friction_ratio < 1.0).all()
    assert (settings.friction_dead_band > 0.0).all()
    recording = truth(3, 1.0)
    np.testing.assert_allclose(
        model.torque(recording.position, recording.velocity),
        fit.model.torque(recording.position, recording.velocity),
        atol=1e-12,
    )


def test_elastic_torque_is_held_at_the_edge_of_the_data(fit):
    term = fit.model.term("elastic_cable")
    recording = truth(1)
    tolerance = 0.02  # rad: the filter rounds the extremes
    np.testing.assert_allclose(term.valid.lower, recording.position.min(axis=0), atol=tolerance)
    np.testing.assert_allclose(term.valid.upper, recording.position.max(axis=0), atol=tolerance)


def test_a_short_range_cannot_tell_gravity_from_a_spring():
    """The shoulder within a few degrees: sin q2 and q2 are the same line."""
    recording = truth(4)
    small = recording.position.copy()
    middle = small[:, 1].mean()
    small[:, 1] = middle + 0.1 * (small[:, 1] - middle)
    velocity = recording.velocity * np.array([1, 0.1, 1, 1, 1, 1, 1])
    narrow = replace(recording, position=small, velocity=velocity)
    found = identify([narrow], ARM, "joint", ["coulomb_friction", "elastic_cable"])
    text = " ".join(found.identifiability.statements)
    assert "shoulder_pitch moves over" in text
    assert "most of its range" in text
    # Combinations and parameters by name are two counts: neither line may deny the other.
    printed = list(fit_text(found, verbose=True))
    assert not any("identifiable:" in line for line in printed)
    counted = next(line for line in printed if "independent combinations of parameters" in line)
    assert f"{found.identifiability.rank} of {found.identifiability.columns}" in counted
    leaning = next(line for line in printed if "named parameters depend on the prior" in line)
    open_ = [p.name for p in found.parameters if not p.identifiable]
    assert leaning.strip().startswith(f"{len(open_)} of {len(found.parameters)} ")
    assert "; ".join(open_[:6]) in leaning
    assert leaning.endswith(f"{len(open_) - 6} more (grey in the report's table)")


def test_a_spring_left_out_that_gravity_could_replace_is_named():
    """The shoulder over 13 deg, and no spring in the model: beta[0] holds the sum of both."""
    recording = truth(4)
    part = np.array([1, 0.3, 1, 1, 1, 1, 1])
    middle = recording.position.mean(axis=0)
    small = middle + part * (recording.position - middle)
    found = _plain_estimate(replace(recording, position=small, velocity=part * recording.velocity))
    text = " ".join(found.identifiability.statements)
    assert "beta[0] (arm_x) includes any linear elastic torque of shoulder_pitch" in text
    assert "a wider range of shoulder_pitch would separate them" in text
    assert "elastic torque outer_yaw" not in text  # its axis is upright: no weight to confuse
    # An arm that cannot go further is not asked to.
    stops = small[:, 1].min() - 0.01, small[:, 1].max() + 0.01
    joints = list(ARM.joints)
    joints[1] = replace(joints[1], lower=float(stops[0]), upper=float(stops[1]))
    there = replace(recording, position=small, velocity=part * recording.velocity)
    text = " ".join(_plain_estimate(there, replace(ARM, joints=tuple(joints)))
                    .identifiability.statements)  # fmt: skip
    assert "the two cannot be separated; the limits of shoulder_pitch leave no more" in text
    assert "a wider range of shoulder_pitch" not in text


def test_friction_that_presliding_shares_is_not_called_identifiable():
    motions = read_motions([truth(1)], ARM, "joint")
    problem = pose(motions.parts, ARM)
    element = problem.design.columns.select(
        effect="presliding_hysteresis", site_kind="joint", joint=4, index=0
    )
    found = estimate(problem, sorted({*start_columns(problem.design.columns), *element}))
    names = ("coulomb_friction", "presliding_hysteresis")
    friction = [p for p in found.parameters if p.name.startswith(names)]
    shared = [p for p in friction if "wrist_pitch" in p.name]
    assert len(shared) == 2
    assert [p for p in friction if not p.identifiable] == shared
    assert sum(p.value for p in shared) == pytest.approx(COULOMB[4], rel=0.15)
    said = next(s for s in found.identifiability.statements if s.startswith("dry friction of"))
    assert f"{sum(p.value for p in shared):.3g} N·m together" in said


def test_validation_recordings_judge_the_model():
    recordings = [truth(5, 16.0), truth(6, 16.0)]
    found = identify(recordings[:1], ARM, "joint", effects=["coulomb_friction"],
                     validate=recordings[1:])  # fmt: skip
    expected = evaluate(found.model, recordings[1:], "joint")
    assert found.held_out == expected.joints
    assert found.model.term("viscous_friction") is None


def test_what_was_fitted_cannot_be_held_out():
    recordings = [truth(5, 16.0), truth(6, 16.0)]
    with pytest.raises(RecordingError, match="800 of 800 samples are those of a recording that"):
        identify(recordings[:1], ARM, validate=[recordings[1], recordings[0].rows(slice(800))])


def write(recording: Recording, path) -> str:
    recording.save(path)
    return str(path)


def test_command_lines_write_model_report_and_json(tmp_path, capsys):
    data = write(truth(7, 12.0), tmp_path / "run.csv")
    out = tmp_path / "model.yaml"
    arguments = [data, "--arm", "mtmr", "--out", str(out), "--json", str(tmp_path / "fit.json"),
                 "--terms", "coulomb_friction,elastic_cable", "--verbose"]  # fmt: skip
    assert command_line.run("dvrk_gravity.cli.identify", arguments) == 0
    shown = capsys.readouterr().out
    assert "read as joint coordinates" in shown
    assert "Butterworth" in shown
    content = json.loads((tmp_path / "fit.json").read_text())
    assert set(content["joints"]) == set(JOINT_NAMES)
    assert set(content["joints"]["outer_yaw"]) == {"rmse", "nrmse", "r2"}
    page = (tmp_path / "model.html").read_text()
    assert "http" not in page.replace("http-equiv", "")
    report = tmp_path / "e.html"
    arguments = [
        data, "--model", str(out), "--json", str(tmp_path / "e.json"), "--report", str(report),
    ]  # fmt: skip
    assert command_line.run("dvrk_gravity.cli.evaluate", arguments) == 0
    result = json.loads((tmp_path / "e.json").read_text())
    assert result["samples"] > 1000
    assert "<h1" in report.read_text()
    assert result["joints"]["outer_yaw"]["nrmse"] < 0.2


def bad(kind: str, path) -> None:
    good = truth(8, 6.0)
    if kind == "empty":
        path.write_text("")
    elif kind == "joint missing":
        keep = slice(0, 6)
        write(
            Recording(JOINT_NAMES[:6], good.time, good.position[:, keep],
                      good.velocity[:, keep], good.effort[:, keep]),
            path,
        )  # fmt: skip
    elif kind == "still":
        write(replace(good, position=np.zeros_like(good.position),
                      velocity=np.zeros_like(good.position)), path)  # fmt: skip
    elif kind == "nan":
        write(good, path)
        lines = path.read_text().splitlines()
        rows = [line.split(",") for line in lines[1:]]
        path.write_text(
            "\n".join([lines[0], *(",".join([*row[:3], "nan", *row[4:]]) for row in rows)])
        )
    elif kind == "degrees":
        write(replace(good, position=np.degrees(good.position)), path)
    elif kind == "no effort":
        write(replace(good, effort=None), path)
    elif kind == "short":
        write(good.rows(slice(0, 60)), path)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("empty", "empty"),
        ("joint missing", "wrist_roll"),
        ("still", "no joint moves"),
        ("nan", "elbow_pitch"),
        ("degrees", "expected rad"),
        ("no effort", "no effort"),
        ("short", "samples in a row"),
    ],
)
def test_a_bad_recording_gives_one_clear_line_and_no_model(kind, said, tmp_path, capsys):
    path = tmp_path / "bad.csv"
    bad(kind, path)
    out = tmp_path / "model.yaml"
    status = command_line.run(
        "dvrk_gravity.cli.identify", [str(path), "--arm", "mtmr", "--out", str(out)]
    )
    lines = capsys.readouterr().err.strip().splitlines()
    assert status == 2
    assert len(lines) == 1
    assert "bad.csv" in lines[0]
    assert said in lines[0]
    assert not out.exists()


def test_an_unknown_term_is_named(tmp_path, capsys):
    data = write(truth(8, 6.0), tmp_path / "run.csv")
    status = command_line.run(
        "dvrk_gravity.cli.identify",
        [data, "--arm", "mtmr", "--out", str(tmp_path / "m.yaml"), "--terms", "magic"],
    )
    assert status == 2
    assert "magic" in capsys.readouterr().err


@pytest.mark.slow
def test_measured_trajectory_is_explained_on_phases_that_were_held_out(measured_data):
    """Best published errors on another trajectory: .077 .149 .170 .209 .259 .234 .339."""
    fit = identify([Recording.load(measured_data / "mtm_dynamic_30s_200hz.csv")], ARM)
    assert fit.coordinates == "actuator"
    assert "repeats every 11.6" in fit.validation
    errors = [error.nrmse for error in fit.held_out.values()]
    limits = [0.08, 0.20, 0.16, 0.16, 0.25, 0.24, 0.33]
    assert all(error < limit for error, limit in zip(errors, limits, strict=True)), errors
    levels = {name: verdict.level for name, verdict in fit.verdict.joints.items()}
    assert levels.pop("outer_yaw") == "usable"  # its range was not covered
    assert set(levels.values()) == {"good"}


def test_physical_links_are_certified_and_cost_little():
    with few_folds(2):
        found = identify([truth(1, 16.0)], ARM, "joint", ["coulomb_friction"], physical=True)
    assert len(found.physical) == 9
    assert min(found.physical.values()) > 0.0
    links = found.model.term("link_inertia").links
    for row in links:
        assert pin.PseudoInertia.FromDynamicParameters(row).toMatrix()[3, 3] > 0.0
        assert np.linalg.eigvalsh(pin.PseudoInertia.FromDynamicParameters(row).toMatrix())[0] > 0.0
    for name, error in found.held_out.items():
        assert error.nrmse < 0.4, name
