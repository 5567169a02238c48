"""A reading that a diagnosis finds wrong is known to the model, and nobody commands by it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import known_ecm
import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import ReadingErrors
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import without_known_errors
from dvrk_gravity.recording import Recording, limited_efforts
from dvrk_gravity.simulate import PlantFile, SimulatedArm, simulate

Fault = Callable[[Recording], Recording]
ELBOW, SHOULDER = 2, 1
SHIPPED = TorqueModel.load(MODEL_FILE)
ARM = SHIPPED.arm


def unit(value: float, column: int = ELBOW, other: float = 1.0) -> list[float]:
    return [value if joint == column else other for joint in range(7)]


def knowing(model: TorqueModel = SHIPPED, **values: object) -> TorqueModel:
    """Return a model that knows errors of readings, by their names in a file after `reading.`."""
    named = {f"reading.{name.replace('__', '.')}": value for name, value in values.items()}
    return TorqueModel.from_parameters(model.parameters() | named, model.arm)


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Return a smooth motion with smooth efforts."""
    time = np.arange(800) / 100.0
    angle = np.outer(time, np.linspace(0.7, 2.0, 7))
    position, velocity = 0.3 * np.sin(angle), 0.3 * np.linspace(0.7, 2.0, 7) * np.cos(angle)
    effort = np.sin(3.0 * time[:, None] + np.arange(7))
    return Recording(ARM.joint_names, time, position, velocity, effort)


def put_right(model: TorqueModel, recording: Recording) -> Recording:
    ((right,), (note,)) = without_known_errors([recording], model)
    assert "reading." in note.text
    return right


def scaled(recording: Recording, name: str, column: int, factor: float) -> Recording:
    values = getattr(recording, name).copy()
    values[:, column] *= factor
    return replace(recording, **{name: values})


def wrong_scale(recording: Recording) -> Recording:
    return scaled(recording, "effort", ELBOW, 1.3)


def wrong_sign(recording: Recording) -> Recording:
    return scaled(recording, "effort", ELBOW, -1.0)


def clipped(limit: float, column: int = ELBOW) -> Fault:
    def clip(recording: Recording) -> Recording:
        effort = recording.effort.copy()
        effort[:, column] = np.clip(effort[:, column], -limit, limit)
        return replace(recording, effort=effort)

    return clip


def far(recording: Recording) -> Recording:
    recording = scaled(recording, "position", ELBOW, 1.08)
    return scaled(recording, "velocity", ELBOW, 1.08)


def in_degrees(recording: Recording) -> Recording:
    return replace(recording, velocity=np.degrees(recording.velocity))


def slow(recording: Recording) -> Recording:
    return replace(recording, time=1.5 * recording.time)


def leaking(recording: Recording) -> Recording:
    effort = recording.effort.copy()
    effort[:, SHOULDER] += 0.15 * recording.effort[:, ELBOW]
    return replace(recording, effort=effort)


# --- found, and known then -------------------------------------------------------------------


def test_several_wrong_readings_are_found_and_other_recordings_read_rightly_then(tmp_path):
    limit, pitch, yaw = 4.0, 1, 0

    def several(recording: Recording) -> Recording:
        return clipped(limit, pitch)(scaled(in_degrees(recording), "effort", yaw, 1.3))

    model, first, second = known_ecm.model(), known_ecm.recorded(1), known_ecm.recorded(2)
    diagnosis = diagnose(several(first), model)
    assert all(finding.in_model for finding in diagnosis.findings)
    found = {finding.effect for finding in diagnosis.findings}
    assert found == {"velocity_scale", "torque_scale", "effort_saturation"}
    diagnosis.model.save(tmp_path / "extended.yaml")
    extended = TorqueModel.load(tmp_path / "extended.yaml")
    values = extended.of_readings()
    assert values["reading.effort_scale"][yaw] == pytest.approx(1.3, rel=0.01)
    assert values["reading.velocity_scale"] == pytest.approx([np.degrees(1.0)] * 4)
    assert values["reading.effort_limit"][pitch] == pytest.approx(limit, rel=0.02)

    floor, rightly = evaluate(model, second), evaluate(extended, several(second))
    for name, error in rightly.joints.items():
        spread = np.std(second.effort[:, known_ecm.ARM.joint_names.index(name)])
        assert error.rmse < 1.1 * floor.joints[name].rmse + 0.005 * spread


# --- put right -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "known"),
    [
        (wrong_scale, {"effort_scale": unit(1.3)}),
        (wrong_sign, {"effort_scale": unit(-1.0)}),
        (far, {"encoder_scale": unit(1.08)}),
        (in_degrees, {"velocity_scale": [np.degrees(1.0)] * 7}),
        (slow, {"time_scale": 1.5}),
        (leaking, {"effort_from__shoulder_pitch": [0.0, 1.0, 0.15, 0.0, 0.0, 0.0, 0.0]}),
    ],
)
def test_a_recording_is_corrected_as_it_was_distorted(fault, known, recording):
    right = put_right(knowing(**known), fault(recording))
    for name, values in recording.arrays().items():
        np.testing.assert_allclose(getattr(right, name), values, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("delay", [0.025, -0.025])
def test_efforts_are_laid_over_their_positions(delay, recording):
    smooth = recording
    shifted = replace(smooth, effort=np.sin(3.0 * (smooth.time[:, None] - delay) + np.arange(7)))
    known = knowing(effort_delay=delay)
    right = put_right(known, shifted)
    assert len(right) in (len(smooth) - 2, len(smooth) - 3)
    wanted = smooth.rows(np.isin(smooth.time, right.time))
    np.testing.assert_allclose(right.effort, wanted.effort, atol=1e-6)
    np.testing.assert_array_equal(right.position, wanted.position)


def test_samples_at_a_known_limit_are_marked_in_trajectories_and_left_out_of_poses(recording):
    limit = float(np.percentile(np.abs(recording.effort[:, ELBOW]), 90.0))
    known = knowing(effort_limit=unit(limit, other=0.0))
    right = put_right(known, clipped(limit)(recording))
    marked = sum(span.rows[1] - span.rows[0] for span in limited_efforts(right))
    assert 0.08 * len(right) < marked < 0.2 * len(right)
    poses = replace(clipped(limit)(recording), time=None, velocity=None)
    assert len(put_right(known, poses)) == len(poses) - marked


def test_a_limit_is_where_the_scaled_reading_stops():
    known = knowing(effort_scale=unit(2.0), effort_limit=unit(0.5, other=0.0))
    assert known.reading_errors.true_limit()[ELBOW] == 0.25
    outer = replace(ReadingErrors.none(7), effort=2.0 * np.eye(7))
    inner = replace(ReadingErrors.none(7), limit=np.full(7, 0.25))
    np.testing.assert_array_equal(outer.after(inner).limit, np.full(7, 0.5))


@pytest.mark.parametrize(
    ("known", "still"),
    [({"effort_delay": 1.0}, False), ({"effort_limit": unit(1e-6, other=0.0)}, True)],
)
def test_a_recording_of_which_nothing_can_be_read_is_refused_by_the_name_of_the_reason(
    known, still, recording
):
    few = recording.rows(np.arange(len(recording)) < 50)
    few = replace(few, time=None, velocity=None) if still else few
    with pytest.raises(RecordingError, match=r"nothing is left .* reading\.effort_limit"):
        without_known_errors([few], knowing(**known))


def test_a_delay_in_true_time_is_shorter_where_the_clock_was_wrong_as_well():
    """Outer errors are divided out first: their delay is in the time that is left then."""
    outer = replace(ReadingErrors.none(7), delay=0.03)
    inner = replace(ReadingErrors.none(7), clock=1.5, delay=0.01)
    assert outer.after(inner).delay == pytest.approx(0.03 / 1.5 + 0.01)
    assert inner.after(outer).delay == pytest.approx(0.04)
    motors, right = replace(outer, coordinates="actuator"), inner
    assert motors.after(right).coordinates == right.after(motors).coordinates == "actuator"


def test_coordinates_that_are_given_go_before_those_that_the_model_states(recording):
    actuator = knowing(coordinates="actuator", effort_scale=unit(1.3))
    for coordinates, named in (("joint", False), ("actuator", True), (None, True)):
        _, (note,) = without_known_errors([recording], actuator, coordinates)
        assert "reading.effort_scale" in note.text
        assert ("reading.coordinates" in note.text) == named
    alone = knowing(coordinates="actuator")
    assert without_known_errors([recording], alone, "joint") == ([recording], ())


def test_a_recording_without_a_joint_that_leaks_into_another_is_refused(recording):
    row = [0.0, 1.0, 0.15, 0.0, 0.0, 0.0, 0.0]
    known = knowing(effort_from__shoulder_pitch=row)
    few = recording
    keep = [0, 1, 3, 4, 5, 6]
    without = Recording(
        tuple(few.joints[k] for k in keep), few.time, few.position[:, keep],
        effort=few.effort[:, keep],
    )  # fmt: skip
    with pytest.raises(RecordingError, match="elbow_pitch"):
        without_known_errors([without], known)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("effort_scale", unit(0.0), r"reading\.effort_scale\[2\]: got 0"),
        ("effort_scale", unit(1e-12), "a factor of elbow_pitch from 0.0001 to 10000"),
        ("encoder_scale", unit(-1e-9), "a factor of elbow_pitch from 0.0001 to 10000"),
        ("velocity_scale", unit(1e30), "a factor of elbow_pitch from 0.0001 to 10000"),
        ("effort_limit", unit(-1.0), "at least 0"),
        ("effort_from__elbow_pitch", [0.0] * 7, "rows that can be solved"),
        ("coordinates", "motor", "one of detected, joint, actuator"),
        ("time_scale", 0.0, "0.01 to 100"),
    ],
)
def test_a_reading_from_which_nothing_can_be_made_out_is_refused_in_one_line(name, value, message):
    with pytest.raises(ConfigError, match=message) as caught:
        knowing(**{name: value})
    assert "\n" not in str(caught.value)


# --- the compensator --------------------------------------------------------------------------

MISLEADING = {
    "effort_scale": unit(1.2),
    "effort_limit": unit(0.4, other=0.0),
    "effort_delay": -0.02,
    "encoder_scale": unit(1.1),
    "velocity_scale": unit(2.0),
    "position_from__elbow_pitch": [0.0, 0.1, 1.0, 0.0, 0.0, 0.0, 0.0],
    "coordinates": "actuator",
}


def test_the_compensator_refuses_a_reading_that_is_known_to_be_wrong_unless_it_is_accepted():
    at_rest, q = Settings.from_parameters(SHIPPED.parameters()), np.full(7, 0.2)
    for name, value in MISLEADING.items():
        wrong = knowing(**{name: value}).parameters()
        with pytest.raises(ConfigError) as caught:
            Settings.from_parameters(wrong)
        line = str(caught.value)
        assert "\n" not in line
        assert f"reading.{name.replace('__', '.')}" in line
        assert "accept_reading_errors: true" in line
        accepted = Settings.from_parameters(wrong | {"accept_reading_errors": True})
        np.testing.assert_array_equal(accepted.static_torque(q), at_rest.static_torque(q))


def test_the_compensator_takes_a_reading_that_misleads_no_command():
    for known in ({"effort_delay": 0.02}, {"time_scale": 1.5}, {"coordinates": "joint"}, {}):
        Settings.from_parameters(knowing(**known).parameters())


def test_a_change_in_flight_to_a_wrong_reading_is_refused_as_a_start_is():
    flying = Settings.from_parameters(SHIPPED.parameters())
    values = SHIPPED.parameters() | {"reading.effort_scale": tuple(unit(1.2))}
    with pytest.raises(ConfigError, match="accept_reading_errors: true"):
        Settings.from_parameters(values, flying)
    accepted = Settings.from_parameters(values | {"accept_reading_errors": True}, flying)
    with pytest.raises(ConfigError, match="accept_reading_errors: true"):
        Settings.from_parameters(values | {"accept_reading_errors": False}, accepted)


def test_a_simulated_arm_reads_as_its_model_says():
    def measured(model: TorqueModel) -> Recording:
        plant = PlantFile.of(ARM).plant()
        plant = replace_model(plant, model)
        plant.reset(np.full(7, 0.2))
        return simulate(SimulatedArm(plant), None, 0.05)

    known = {"effort_scale": unit(1.3), "encoder_scale": unit(0.9), "effort_delay": 0.01}
    right, wrong = measured(SHIPPED), measured(knowing(**known))
    np.testing.assert_allclose(wrong.position, right.position * unit(0.9), atol=1e-12)
    np.testing.assert_allclose(wrong.effort[10:], right.effort[:-10] * unit(1.3), atol=1e-12)


def replace_model(plant, model: TorqueModel):
    plant.model = replace(plant.model, reading_errors=model.reading_errors)
    return plant
