"""Recordings as users have them: in files, of some joints, at several rates, in coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fitted import FEW
from known_mtm import ARM, truth

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.observation import log_of, motors_measured, observe
from dvrk_gravity.recording import Recording

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
        source="run.csv",
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


@pytest.mark.parametrize(("coordinates", "joint"), [("joint", 2), ("actuator", 2), ("actuator", 3)])
def test_a_recording_of_one_joint_is_that_joints_part_of_the_whole(coordinates, joint):
    """In actuator coordinates motors of joints that stand still turn: they are completed."""
    held, still = frozen(truth(3, 6.0), joint)
    read = held if coordinates == "joint" else motor_side(held)
    read = replace(read, coordinates=coordinates)
    part = replace(only(read, [joint]), coordinates=coordinates)
    full = next(observe([read], ARM)[0].split())
    ours = next(observe([part], ARM, fixed_positions=still)[0].split())
    for name in ("q", "qd", "qdd"):
        np.testing.assert_allclose(getattr(ours.state, name), getattr(full.state, name), atol=2e-3)
    assert ours.measured[joint] or (coordinates == "joint" and joint == 2)
    part, whole = (each.motor_effort(ARM) for each in (ours, full))
    np.testing.assert_allclose(part[:, ours.measured], whole[:, ours.measured], atol=1e-9)
    assert not part[:, ~ours.measured].any()


def test_a_motor_is_measured_if_all_joints_are_that_it_adds_to():
    # Motor 2 adds to joints 2, 3 and 4 (q3 = a3 - a2, q4 = a4 + .67 (a2 - a3)).
    assert np.flatnonzero(motors_measured([3], ARM, "joint")).tolist() == [3]
    assert np.flatnonzero(motors_measured([2, 3], ARM, "joint")).tolist() == [2, 3]
    assert np.flatnonzero(motors_measured([1, 2, 3], ARM, "joint")).tolist() == [1, 2, 3]
    assert np.flatnonzero(motors_measured([2], ARM, "actuator")).tolist() == [2]


def test_rates_that_differ_come_to_the_lowest():
    slow, fast = truth(1, 12.0, 50.0), truth(2, 12.0, 200.0)
    motions = observe([slow, fast], ARM)
    assert motions[0].filter.rate == motions[1].filter.rate
    assert any("50 Hz" in line for line in log_of(motions))
    np.testing.assert_allclose(np.diff(motions[1].time), 0.02, atol=1e-9)
    alone = next(observe([fast], ARM)[0].split())
    np.testing.assert_allclose(motions[1].q, alone.q[::4], atol=1e-6)


def test_coordinates_that_are_given_wrongly_are_warned_of_and_each_may_have_its_own():
    motor, joint = motor_side(truth(2, 9.0, 50.0)), truth(1, 9.0, 50.0)
    warnings = identify([motor], ARM, "joint", FEW, physical=False).warnings
    (warning,) = [each for each in warnings if each.kind == "coordinates"]
    assert "run.csv" in str(warning)
    both = identify([motor, joint], ARM, ["actuator", "joint"], FEW, physical=False)
    assert "coordinates" not in [each.kind for each in both.warnings]
    other = evaluate(both.model, [truth(3, 8.0)], "joint").joints
    assert min(other[name].r2 for name in JOINT_NAMES[:4]) > 0.9
    with pytest.raises(ConfigError, match="one for all recordings, or 2"):
        identify([motor, joint], ARM, ["actuator", "joint", "joint"], FEW)


# --- joints that are not recorded, on the command line ------------------------------------


def test_where_joints_stood_must_be_said_in_full(tmp_path, capsys):
    path, out = tmp_path / "some.csv", tmp_path / "model.yaml"
    only(truth(8, 6.0), [0, 1, 2, 3, 4, 5]).save(path)
    for options, says in (
        ([], "some.csv: has no wrist_roll: expected all joints, or `--at wrist_roll="),
        (["--at", "elbow_pitch=0"], "elbow_pitch"),
        (["--at", "elbow=0"], "'elbow=0', expected JOINT=ANGLE"),
        (["--at", "wrist_roll=2"], "expected an angle with its unit"),
        (["--at", "wrist_roll=1e4deg"], "two turns"),
        (["--at", "wrist_roll=0,wrist_roll=0"], "wrist_roll once"),
        (["--at", "wrist_roll=0", "--coordinates", "motor"], "--coordinates: got 'motor'"),
        (["--at", "others=0deg"], "expected a recording of all joints"),
    ):
        words = (str(path), *options, "--arm", "mtmr", "--out", str(out))
        assert command_line.run("dvrk_gravity.cli.identify", words) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert says in line
        assert not out.exists()


def test_a_joint_alone_does_not_determine_gravity():
    held, still = frozen(truth(3, 6.0), WRIST)
    with pytest.raises(RecordingError, match="wrist_platform only: expected a recording of all"):
        identify([only(held, [WRIST])], ARM, still=still)
