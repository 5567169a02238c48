"""Files of plans and of limits, and the verb that plans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from path_driver import plan_of
from support import MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.planning import Box, Plan, PlanLimits, PosePath, load_limits, slacks

ECM, MTMR = Arm.load("ecm"), Arm.load("mtmr")


def poses_of(plan: Plan) -> Plan:
    """Return a plan of two poses, and a box to stay out of."""
    poses = plan.motion.middle + 0.1 * plan.arm.scale * np.array([[0.0], [1.0]])
    limits = replace(plan.limits, boxes=(Box("panel", (9.0,) * 3, (10.0,) * 3, ("link4",)),))
    path = PosePath(poses, 0.02 * plan.arm.scale, 0.3, 0.9, limits)
    return replace(plan, motion=path, limits=limits)


# --- plans ---------------------------------------------------------------------------------


def test_a_plan_that_is_read_again_is_the_same(tmp_path):
    path = tmp_path / "plan.yaml"
    for plan in (plan_of("ecm"), poses_of(plan_of("ecm"))):
        plan.save(path, "a comment")
        again = Plan.load(path)
        time = np.linspace(0.0, plan.duration, 55)
        for here, there in zip(plan.at(time), again.at(time), strict=True):
            np.testing.assert_allclose(here, there, atol=1e-12)
        np.testing.assert_allclose(again.limits.upper, plan.limits.upper, rtol=1e-12)
        assert again.limits.boxes == plan.limits.boxes
        assert again.arm.joint_names == plan.arm.joint_names


def test_a_plan_with_a_wrong_entry_is_refused_by_name(tmp_path):
    path, motion = tmp_path / "plan.yaml", plan_of("ecm")
    none = dict.fromkeys(ECM.joint_names, 0.0)
    for plan, where, value, words in (
        (motion, ("kind",), "dance", "kind: got 'dance'"),
        (motion, ("motion", "duration"), -1.0, "motion.duration: "),
        (motion, ("motion", "ramp"), 100.0, "motion.ramp: "),
        (motion, ("motion", "sine", "yaw"), [1.0], "motion.sine.yaw: "),
        (motion, ("limits", "joints", "yaw", "velocity"), 0.0, "yaw.velocity: "),
        (poses_of(motion), ("poses", "part"), 2.0, "poses.part: "),
        (poses_of(motion), ("poses", "positions"), {name: [] for name in none}, "poses.positions"),
    ):
        plan.save(path)
        content = yaml.safe_load(path.read_text())
        entry = content
        for key in where[:-1]:
            entry = entry[key]
        entry[where[-1]] = value
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        with pytest.raises(ConfigError) as caught:
            Plan.load(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert words in str(caught.value)


def test_the_csv_has_positions_and_velocities_at_1_khz(tmp_path):
    plan, path = plan_of("ecm"), tmp_path / "motion.csv"
    plan.write_csv(path)
    head, *rows = path.read_text().splitlines()
    assert head.split(",")[:2] == ["time", "yaw.position"]
    assert head.split(",")[-1] == "roll.velocity"
    values = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(np.diff(values[:, 0]), 1e-3, atol=1e-6)
    assert values[-1, 0] == plan.duration
    q, qd, _ = plan.at(values[:, 0])
    np.testing.assert_allclose(values[:, 1:], np.hstack([q, qd]), atol=1e-7)


# --- limits --------------------------------------------------------------------------------


def limits_of(folder: Path, text: str, arm: Arm = ECM) -> PlanLimits:
    (folder / "limits.yaml").write_text(text)
    return load_limits(folder / "limits.yaml", arm)


def test_limits_are_read_in_degrees_and_metres_and_the_rest_is_the_arms(tmp_path):
    text = """
joints:
  yaw: {position: [-20, 30], velocity: 10, effort: 5}
  insertion: {position: [0.05, 0.2], velocity: 0.02}
combinations:
  - {of: {yaw: 1, pitch: -0.5}, position: [-30, 20]}
boxes:
  - {lower: [-1, 0.5, -1], upper: [1, 1, 1]}
"""
    limits, own = limits_of(tmp_path, text), PlanLimits.of(ECM)
    np.testing.assert_allclose(limits.upper, [np.radians(30), own.upper[1], 0.2, own.upper[3]])
    np.testing.assert_allclose(limits.lower, [np.radians(-20), own.lower[1], 0.05, own.lower[3]])
    np.testing.assert_allclose(limits.velocity[[0, 2]], [np.radians(10), 0.02])
    assert limits.velocity[1] == own.velocity[1]
    assert limits.effort[0] == 5.0
    (combination,) = limits.combinations
    assert combination.name == "yaw - 0.5 pitch"
    assert np.degrees([combination.lower, combination.upper]) == pytest.approx([-30, 20])
    assert limits.boxes[0].links == ("link4",)


@pytest.mark.parametrize(
    ("entry", "degrees"),
    [
        ("{of: {shoulder_pitch: 1, elbow_pitch: 1}, position: [-60, 120]}", (-9, 39, 90)),
        ("{of: {shoulder_pitch: 1, elbow_pitch: 1}, velocity: 30}", (-9, 39, 30)),
        ("{of: {elbow_pitch: 1, shoulder_pitch: 1}, position: [-60, 20]}", (-9, 20, 90)),
        ("{of: {shoulder_pitch: -2, elbow_pitch: -2}, position: [-60, 4], velocity: 40}",
         (-2, 30, 20)),
    ],
)  # fmt: skip
def test_of_a_combination_that_the_arm_limits_itself_the_stricter_limits_hold(
    tmp_path, entry, degrees
):
    limits = limits_of(tmp_path, f"combinations:\n  - {entry}\n", MTMR)
    (both,) = limits.combinations
    assert np.degrees([both.lower, both.upper, both.velocity]) == pytest.approx(degrees)
    assert limits.pair is not None


def test_an_mtms_shoulder_and_elbow_stay_limited_together_beside_another_combination(tmp_path):
    limits = limits_of(
        tmp_path,
        "combinations:\n  - {of: {shoulder_pitch: 1, elbow_pitch: -1}, velocity: 30}\n"
        "  - {of: {shoulder_pitch: -2, elbow_pitch: 2}, velocity: 40}\n", MTMR,
    )  # fmt: skip
    own, difference = limits.combinations
    assert np.degrees([own.lower, own.upper, difference.velocity]) == pytest.approx([-9, 39, 20])
    assert limits.and_those(PlanLimits.of(MTMR)).combinations == limits.combinations


def test_a_wrong_entry_of_a_limits_file_is_refused_by_name(tmp_path):
    for text, words in (
        ("speeds: 1", "got 'speeds'"),
        ("joints: {yaw: {speed: 1}}", "joints.yaw: got 'speed'"),
        ("joints: {yaw: {position: [30, -20]}}", "joints.yaw.position: "),
        ("joints: {yaw: {position: [-200, 20]}}", "joints.yaw.position: "),
        (f"joints: {{yaw: {{velocity: {10**400}}}}}", "joints.yaw.velocity: "),
        ("joints: {yaw: {velocity: 50, acceleration: 1e5}}", "yaw.acceleration: got 100000.0"),
        ("joints: {yaw: {effort: 1000}}", "joints.yaw.effort: "),
        ("combinations: [{of: {yaw: 1}, velocity: 1}]", "at least two joints"),
        ("combinations: [{of: {yaw: 1, pitch: 0}, velocity: 1}]", "not zero"),
        ("combinations: [{of: {yaw: 1, pitch: 1.0e+300}, velocity: 1}]", "1e-06 to 1e+06"),
        ("boxes: [{lower: [-1.0e+300, 0, 0], upper: [1, 1, 1]}]", "up to 1e+09"),
        ("boxes: [{lower: [0, 0, 0], upper: [1, 1, 0]}]", "along z"),
        ("boxes: [{lower: [0, 0, 0], upper: [1, 1, 1], links: [elbow]}]", "link1"),
    ):
        with pytest.raises(ConfigError) as caught:
            limits_of(tmp_path, text)
        assert words in str(caught.value), text
        assert str(caught.value).startswith(f"{tmp_path / 'limits.yaml'}: ")
    for lower in (50, 39):  # nothing is left of the arm's own, or a single value
        text = f"{{of: {{shoulder_pitch: 1, elbow_pitch: 1}}, position: [{lower}, 60]}}"
        words = rf"combinations\[0\].position: got \[{lower}, 60\], .* -9 to 39 deg"
        with pytest.raises(ConfigError, match=words):
            limits_of(tmp_path, f"combinations: [{text}]", MTMR)


# --- the verb ------------------------------------------------------------------------------


def plan(*words: str | Path | float) -> int:
    return main(["plan", *map(str, words)])


def test_the_verb_writes_plan_picture_and_motion_within_limits(tmp_path, capsys):
    out, motion = tmp_path / "plan.yaml", tmp_path / "motion.csv"
    assert plan("--arm", "ecm", "--duration", 8, "--time", 1, "--out", out, "--csv", motion) == 0
    printed = capsys.readouterr().out
    assert "coulomb_friction.joint[yaw]" in printed
    head = [line for line in out.read_text().splitlines() if line.startswith("# ")]
    assert len(head) == 2 + 3 * ECM.n  # every limit, with what is left of it
    loaded = Plan.load(out)
    assert all(each.left >= 0.0 for each in slacks(loaded.motion, loaded.limits, ECM))
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert motion.exists()


def test_the_verb_plans_poses(tmp_path, capsys):
    out = tmp_path / "plan.yaml"
    assert plan("--arm", "ecm", "--poses", "--duration", 40, "--out", out) == 0
    assert "coulomb_friction.joint[yaw]" in capsys.readouterr().out
    assert len(Plan.load(out).motion.poses) > 2


def test_a_wrong_option_or_limits_that_nothing_keeps_are_one_line(tmp_path, capsys):
    out, limits = tmp_path / "plan.yaml", tmp_path / "limits.yaml"
    limits.write_text("combinations: [{of: {yaw: 1, pitch: 1}, position: [400, 500]}]")
    ecm = ("--arm", "ecm")
    for words, expected in (
        ((*ecm, "--duration", 3), "--duration: got 3.0, expected 8 to 600"),
        ((*ecm, "--time", 0), "--time: got 0.0"),
        ((*ecm, "--model", MODEL_FILE), "a model of ecm"),
        ((*ecm, "--limits", limits), "yaw + pitch"),
        ((), "--separate"),
        ((*ecm, "--separate", "findings.json"), "--separate"),
    ):
        assert plan(*words, "--out", out) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert expected in line
    assert not out.exists()
