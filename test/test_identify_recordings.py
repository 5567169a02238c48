"""Recordings as users have them: in files, of some joints, at several rates, bad ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_mtm import ARM, truth

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.intake import motors_measured, read_motions
from dvrk_gravity.recording import Recording, RecordingFile, read_trajectory, trajectory

pytestmark = pytest.mark.usefixtures("four_folds")

FEW = ["coulomb_friction", "viscous_friction"]  # effects, for quick fits
WRIST = 3


def only(recording: Recording, columns: list[int]) -> Recording:
    """Return some joints of a recording."""
    return Recording(
        tuple(JOINT_NAMES[column] for column in columns),
        recording.time,
        recording.position[:, columns],
        recording.velocity[:, columns],
        recording.effort[:, columns],
        source="some joints",
    )


def motor_side(recording: Recording) -> Recording:
    """Return a recording in actuator coordinates."""
    return replace(
        recording,
        position=ARM.actuator_position(recording.position),
        velocity=ARM.actuator_position(recording.velocity),
        effort=ARM.actuator_effort(recording.effort),
    )


def frozen(recording: Recording, moving: int) -> tuple[Recording, dict[str, float]]:
    """Return a recording whose other joints stand still, efforts as they were, and where."""
    still = recording.position[0]
    here = np.arange(7) == moving
    held = replace(
        recording,
        position=np.where(here, recording.position, still),
        velocity=np.where(here, recording.velocity, 0.0),
    )
    return held, dict(zip(JOINT_NAMES, still.tolist(), strict=True))


def test_a_file_is_fitted_as_the_recording_in_memory(tmp_path):
    recording = truth(1, 12.0)
    recording.save(tmp_path / "run.csv")
    file = RecordingFile(tmp_path / "run.csv")
    from_memory, from_file = (identify([given], ARM, "joint", FEW) for given in (recording, file))
    assert from_memory.held_out == from_file.held_out
    assert (
        evaluate(from_memory.model, [recording]).joints
        == evaluate(from_memory.model, [file]).joints
    )


@pytest.mark.slow
def test_thinning_a_fast_recording_changes_no_prediction_by_a_hundredth(monkeypatch):
    """At 1 kHz one sample in five is kept."""
    fast, other = truth(1, 8.0, 1000.0), truth(2, 12.0)
    thin = identify([fast], ARM, "joint", FEW)
    assert any("one of 5 low-passed samples kept: 200 Hz" in line for line in thin.handling)
    monkeypatch.setattr(trajectory, "OVERSAMPLING", 1e9)
    full = identify([fast], ARM, "joint", FEW)
    assert not any("samples kept" in line for line in full.handling)
    for model in (full.model, thin.model):
        assert model.term("viscous_friction") is not None
    torque = [fit.model.torque(other.position, other.velocity) for fit in (thin, full)]
    size = np.sqrt(np.mean(torque[1] ** 2, axis=0))
    assert (np.sqrt(np.mean((torque[0] - torque[1]) ** 2, axis=0)) < 0.01 * size).all()


@pytest.mark.parametrize("coordinates", ["joint", "actuator"])
@pytest.mark.parametrize("joint", [2, 3])
def test_a_recording_of_one_joint_is_that_joints_part_of_the_whole(coordinates, joint):
    """In actuator coordinates motors of joints that stand still turn: they are completed."""
    held, still = frozen(truth(3, 6.0), joint)
    told = held if coordinates == "joint" else motor_side(held)
    part = replace(read_trajectory([only(told, [joint])]), coordinates=coordinates, still=still)
    full = read_motions([told], ARM, coordinates).parts[0]
    ours = read_motions([part], ARM, coordinates).parts[0]
    for name in ("q", "qd", "qdd"):
        np.testing.assert_allclose(getattr(ours.state, name), getattr(full.state, name), atol=2e-3)
    assert ours.measured[joint] or (coordinates == "joint" and joint == 2)
    np.testing.assert_allclose(
        ours.effort[:, ours.measured], full.effort[:, ours.measured], atol=1e-9
    )
    assert not ours.effort[:, ~ours.measured].any()


def test_a_motor_is_measured_if_all_joints_are_that_it_adds_to():
    # Motor 2 adds to joints 2, 3 and 4 (q3 = a3 - a2, q4 = a4 + .67 (a2 - a3)).
    assert np.flatnonzero(motors_measured([3], ARM, "joint")).tolist() == [3]
    assert np.flatnonzero(motors_measured([2, 3], ARM, "joint")).tolist() == [2, 3]
    assert np.flatnonzero(motors_measured([1, 2, 3], ARM, "joint")).tolist() == [1, 2, 3]
    assert np.flatnonzero(motors_measured([2], ARM, "actuator")).tolist() == [2]


def test_a_sweep_of_one_joint_helps_where_the_motion_of_all_did_not_go():
    """Wrist platform within a third of its range in the one, through all of it in the other."""
    wide = truth(5, 16.0)
    narrow_q = wide.position.copy()
    middle = narrow_q[:, WRIST].mean()
    narrow_q[:, WRIST] = middle + 0.1 * (narrow_q[:, WRIST] - middle)
    narrow_qd = wide.velocity * np.where(np.arange(7) == WRIST, 0.1, 1.0)
    alone = replace(wide, position=narrow_q, velocity=narrow_qd)
    alone = replace(alone, effort=wide.effort * 0 + torque_of(alone))
    held, still = frozen(truth(6, 16.0), WRIST)
    cable = 0.05 * np.sin(held.position[:, WRIST])
    held = replace(held, effort=torque_of(held) + np.eye(7)[WRIST] * cable[:, None])
    alone_cable = 0.05 * np.sin(alone.position[:, WRIST])
    alone = replace(alone, effort=alone.effort + np.eye(7)[WRIST] * alone_cable[:, None])
    effects = [*FEW, "elastic_cable"]
    without = identify([alone], ARM, "joint", effects, physical=False).model
    fit = identify([alone, only(held, [WRIST])], ARM, "joint", effects, still=still, physical=False)
    assert any("wrist_platform only, joint coordinates" in line for line in fit.handling)
    error = [
        np.std(held.effort[:, WRIST] - model.torque(held.position, held.velocity)[:, WRIST])
        for model in (without, fit.model)
    ]
    assert error[1] < 0.5 * error[0]


def torque_of(recording: Recording) -> np.ndarray:
    """Return the friction of the wrist and the gravity of a fixed model, N·m."""
    from dvrk_gravity.model import TorqueModel

    beta = (0.6, 0.4, 0.25, 0.12, 0.01, 0.18, -0.1, -0.01, 0.04, 0.005)
    model = TorqueModel.from_parameters({"arm": "mtmr", "beta": beta})
    friction = 0.01 * np.tanh(recording.velocity / 0.01)
    noise = 1e-3 * np.random.default_rng(0).normal(size=recording.position.shape)
    return model.torque(recording.position) + friction + noise


def test_rates_that_differ_come_to_the_lowest():
    slow, fast = truth(1, 12.0, 50.0), truth(2, 12.0, 200.0)
    motions = read_motions([slow, fast], ARM, "joint")
    assert {part.filter.rate for part in motions.parts} == {motions.parts[0].filter.rate}
    assert any("several rates, resampled to 50 Hz" in line for line in motions.handling)
    np.testing.assert_allclose(np.diff(motions.parts[1].time), 0.02, atol=1e-9)
    alone = read_motions([fast], ARM, "joint").parts[0]
    np.testing.assert_allclose(motions.parts[1].state.q, alone.state.q[::4], atol=1e-6)


def test_coordinates_that_are_given_wrongly_are_warned_of():
    recording = replace(motor_side(truth(1, 16.0)), source="run.csv")
    fit = identify([recording], ARM, "joint", FEW)
    assert "run.csv was given as joint coordinates, but looks like actuator" in str(fit.warnings[0])
    right = identify([recording], ARM, "actuator", FEW)
    assert not any(warning.kind == "coordinates" for warning in right.warnings)


def test_the_other_arm_is_warned_of_by_its_limits():
    """The wrist platforms of the two arms turn to opposite sides."""
    recording = truth(1, 6.0)
    far = recording.position + np.where(np.arange(7) == WRIST, 0.7, 0.0)
    recording = replace(recording, position=far)
    other = read_motions([recording], Arm.load("mtml"), "joint").warnings
    assert [warning.kind for warning in other] == ["other_hand"]
    assert "looks like a recording of mtmr, not mtml: wrist_platform goes from" in str(other[0])
    assert not read_motions([recording], ARM, "joint").warnings


def test_coordinates_may_be_given_for_each():
    joint = truth(1, 12.0)
    both = [motor_side(truth(2, 12.0)), joint]
    fit = identify(both, ARM, ["actuator", "joint"], FEW)
    assert fit.coordinates == "actuator"
    assert not any(warning.kind == "coordinates" for warning in fit.warnings)
    with pytest.raises(ConfigError, match="one for all recordings, or 2"):
        identify(both, ARM, ["actuator", "joint", "joint"], FEW)


def test_a_joint_alone_cannot_tell_gravity():
    held, still = frozen(truth(3, 6.0), WRIST)
    with pytest.raises(
        RecordingError, match="wrist_platform only: expected a recording of all joints as well"
    ):
        identify([only(held, [WRIST])], ARM, still=still)


def run(tmp_path, capsys, *arguments: str) -> tuple[int, list[str]]:
    """Return status and error lines of `identify`."""
    out = tmp_path / "model.yaml"
    status = command_line.run(
        "dvrk_gravity.cli.identify", [*arguments, "--arm", "mtmr", "--out", str(out)]
    )
    assert out.exists() == (status < 2)
    return status, capsys.readouterr().err.strip().splitlines()


def bad_file(kind: str, path) -> None:
    """Write a recording that a user may come with."""
    good = truth(8, 6.0)
    changed = {
        "mN·m": {"effort": 1e3 * good.effort},
        "zero efforts": {"effort": 0.0 * good.effort},
        "one effort zero": {"effort": good.effort * (np.arange(7) != 2)},
        "one sensor dead": {"effort": np.where(np.arange(7) == 2, 0.3, good.effort)},
        "milliseconds": {"time": 1e3 * good.time},
        "slow": {"time": 10.0 * good.time},
        "swapped": {"effort": good.effort[:, ::-1].copy()},
    }
    if kind in changed:
        replace(good, **changed[kind]).save(path)
        return
    good.save(path)
    lines = path.read_text().splitlines()
    text = {
        "header only": lines[:1],
        "five samples": lines[:6],
        "one sample": lines[:2],
        "backwards": [*lines[:300], *lines[100:]],
    }[kind]
    path.write_text("\n".join(text) + "\n")


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("mN·m", "expected N·m, not mN·m"),
        ("zero efforts", "wrist_roll are all zero"),
        ("one effort zero", "efforts of elbow_pitch are all zero"),
        ("one sensor dead", "efforts of elbow_pitch are all the same (0.3)"),
        ("milliseconds", "expected seconds, not ms"),
        ("slow", "half the sampling rate of 10 Hz"),
        ("swapped", "expected N·m"),
        ("header only", "has a header but no rows"),
        ("five samples", "samples in a row"),
        ("one sample", "holds one sample"),
        ("backwards", "line 301: time goes back by 1.99 s and stays there"),
    ],
)
def test_bad_files_give_one_clear_line(kind, says, tmp_path, capsys):
    bad_file(kind, tmp_path / "bad.csv")
    status, lines = run(tmp_path, capsys, str(tmp_path / "bad.csv"))
    assert status == 2
    assert len(lines) == 1
    assert "bad.csv" in lines[0]
    assert says in lines[0]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "some.csv: has no wrist_roll: expected all joints, or `--at wrist_roll=0deg"),
        (["--at", "elbow_pitch=0"], "expected a joint that is not recorded: elbow_pitch is"),
        (["--at", "elbow=0"], "'elbow=0', expected JOINT=ANGLE"),
        (["--at", "wrist_roll=2"], "expected an angle with its unit"),
        (["--at", "wrist_roll=nandeg"], "expected an angle with its unit"),
        (["--at", "wrist_roll=1e4deg"], "two turns"),
        (["--at", "wrist_roll=0,wrist_roll=0"], "wrist_roll once"),
        (["--at", "wrist_roll=0", "--coordinates", "motor"], "--coordinates: got 'motor'"),
        (["--at", "wrist_roll=0", "--coordinates", "joint,joint"], "one for all recordings, or 1"),
        (["--at", "others=0deg"], "expected a recording of all joints as well"),
    ],
)
def test_where_joints_stood_must_be_said_in_full(options, says, tmp_path, capsys):
    path = tmp_path / "some.csv"
    only(truth(8, 6.0), [0, 1, 2, 3, 4, 5]).save(path)
    status, lines = run(tmp_path, capsys, str(path), *options)
    assert status == 2
    assert len(lines) == 1
    assert says in lines[0]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--physical"], "--physical: got True, expected trajectories: static poses"),
        (["--terms", "held_load"], "no --terms with static poses"),
    ],
)
def test_options_for_trajectories_are_refused_with_poses(options, says, tmp_path, capsys):
    good = truth(8, 6.0)
    replace(good, time=None, velocity=None).save(tmp_path / "poses.csv")
    status, lines = run(tmp_path, capsys, str(tmp_path / "poses.csv"), *options)
    assert status == 2
    assert len(lines) == 1
    assert says in lines[0]


def test_poses_need_all_joints(tmp_path, capsys):
    poses = replace(only(truth(8, 6.0), [0, 1, 2, 3, 4, 5]), time=None, velocity=None)
    poses.save(tmp_path / "poses.csv")
    status, lines = run(tmp_path, capsys, str(tmp_path / "poses.csv"), "--at", "wrist_roll=0")
    assert status == 2
    assert lines == [
        f"dvrk_gravity identify: {tmp_path / 'poses.csv'}: has no wrist_roll: expected all joints"
    ]


@pytest.mark.slow
def test_a_measured_sweep_is_used_beside_a_measured_motion(measured_data, tmp_path, capsys):
    files = [
        str(measured_data / name)
        for name in ("mtm_dynamic_30s_200hz.csv", "mtm_wrist_platform_sweep_200hz.csv")
    ]
    at = "shoulder_pitch=2.5deg,elbow_pitch=2.5deg,others=0"
    status, _ = run(tmp_path, capsys, *files, "--at", at, "--terms", ",".join(FEW))
    assert status == 1  # a model, but with so few terms none to compensate with
