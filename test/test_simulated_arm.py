"""The simulated arm as a console has it: modes, commands, sensors, recordings, plant files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_arm import made_up_arm
from robots import ROBOTS, UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.files.resources import config_path
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import Mode, PlantFile, Sensors, SimulatedArm, simulate

# Motor angles from joint angles, written out: a3 = q2 + q3, a4 = q4 + 0.6697 q3.
MOTORS = np.eye(7)
MOTORS[2, 1], MOTORS[3, 2] = 1.0, 0.6697


@pytest.fixture(scope="module")
def truth() -> PlantFile:
    return PlantFile.load("mtmr_28002")


def joint_vector(joint: int, value: float) -> np.ndarray:
    return np.eye(7)[joint] * value


# --- the console -------------------------------------------------------------------------

POSE = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])


def arm_at(truth: PlantFile, pose: np.ndarray = POSE, **options: object) -> SimulatedArm:
    plant = truth.plant()
    plant.reset(pose)
    return SimulatedArm(plant, **options)


def steps(mtm: SimulatedArm, count: int) -> SimulatedArm:
    for _ in range(count):
        mtm.step()
    return mtm


def test_a_command_that_cannot_be_is_refused_and_changes_nothing(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    for bad in (np.zeros(6), np.zeros(8), np.zeros(0), np.full(7, np.nan)):
        for command in (mtm.servo_jf, mtm.servo_jp, mtm.move_jp):
            with pytest.raises((ShapeError, ConfigError)):
                command(bad)
    assert mtm.mode is Mode.HOLD
    assert (steps(mtm, 10).plant.q == POSE).all()


def test_the_builtin_compensation_adds_to_commands(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    weight = mtm.plant.smooth_torque()
    mtm.servo_jf(weight)
    mtm.step()
    np.testing.assert_allclose(mtm.compensation, weight)
    np.testing.assert_allclose(mtm.commanded, 2 * weight)
    mtm.plant.reset(POSE)
    mtm.use_gravity_compensation(False)
    mtm.step()
    assert not mtm.compensation.any()
    np.testing.assert_allclose(mtm.commanded, weight)


def test_hold_keeps_the_set_point_of_an_arm_that_does_not_follow(truth: PlantFile) -> None:
    """As a console's: what is in its way is pressed on until another position is commanded."""
    mtm = arm_at(truth)
    mtm.servo_jp(POSE + joint_vector(0, 0.2))
    mtm.push(joint_vector(0, -1.5), duration=60.0)
    steps(mtm, 1000)
    pressed = mtm.effort[0]
    assert pressed > 1.0
    mtm.hold()
    steps(mtm, 1000)
    assert mtm.effort[0] == pytest.approx(pressed, rel=1e-3)
    mtm.servo_jp(mtm.measure().position)
    mtm.hold()


def test_motors_saturate(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    mtm.servo_jf(np.full(7, 50.0))
    mtm.step()
    limit = truth.model.arm.actuator_effort_limit
    # Motor torques, written out: the transposed inverse of the motor angles' matrix.
    np.testing.assert_allclose(np.linalg.inv(MOTORS).T @ mtm.effort, limit)


def test_moves_smoothly_to_a_goal(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    goal = np.array([0.2, 0.3, -0.2, 1.0, 0.5, 0.3, -1.0])
    mtm.move_jp(goal)
    speed = []
    for _ in range(3000):
        mtm.step()
        speed.append(np.abs(mtm.plant.v))
    assert (np.max(speed, axis=0) < [0.9, 0.9, 0.9, 1.7, 2.3, 2.3, 4.5]).all()
    np.testing.assert_allclose(mtm.plant.q, goal, atol=0.03)
    assert np.abs(mtm.plant.v).max() < 1e-6
    mtm.servo_jp(goal + 100.0)
    np.testing.assert_array_equal(mtm.target, truth.model.arm.upper)


def test_a_push_moves_the_arm_for_its_time_and_no_sensor_sees_it(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    mtm.free()
    mtm.push(joint_vector(0, 0.5), duration=0.1)
    steps(mtm, 100)
    speed = mtm.plant.v[0]
    assert speed > 0.5
    assert abs(mtm.measure().effort[0] - mtm.compensation[0]) < 1e-12
    steps(mtm, 20)
    assert mtm.plant.v[0] < speed


def test_an_arm_that_is_pushed_beyond_all_that_can_be_computed_holds_where_it_was(
    truth: PlantFile,
) -> None:
    mtm = arm_at(truth)
    mtm.free()
    mtm.push(joint_vector(0, 1e300), duration=1.0)
    went = [mtm.step() for _ in range(100)]
    assert not all(went)
    assert mtm.mode is Mode.HOLD
    assert np.isfinite(np.stack([mtm.plant.q, mtm.plant.v, mtm.measure().effort])).all()
    rested = steps(mtm, 10).plant.q.copy()
    np.testing.assert_array_equal(steps(mtm, 10).plant.q, rested)


def test_an_arm_with_drive_gains_takes_efforts_in_amperes(tmp_path: Path) -> None:
    gains = np.array([2.0, 4.0, 5.0, 10.0])
    arm = made_up_arm(tmp_path).with_drive_gains(gains)
    simulated = SimulatedArm(PlantFile.of(arm).plant(), builtin_compensation=False)
    weight = simulated.plant.smooth_torque()
    for command, as_read in ((weight, False), (weight / gains, True)):
        simulated.servo_jf(command, as_read=as_read)
        simulated.step()
        np.testing.assert_allclose(simulated.effort, weight, rtol=1e-6)


# --- sensors and recordings --------------------------------------------------------------


def noisy_run(truth: PlantFile, seed: int) -> object:
    mtm = arm_at(truth, sensors=truth.sensors, seed=seed)
    mtm.move_jp(np.array([0.2, 0.3, 0.2, 0.5, 1.0, 0.1, 1.0]))
    return simulate(mtm, None, duration=0.5, rate=200.0)


def test_sensors_count_in_steps_at_the_motors(truth: PlantFile) -> None:
    recording = noisy_run(truth, 5)
    assert len(recording) == 100
    assert recording.rate == pytest.approx(200.0)
    for values, step in (
        (recording.position @ MOTORS.T, truth.sensors.position_step),
        (recording.effort @ np.linalg.inv(MOTORS), truth.sensors.effort_step),
    ):
        counts = values / step
        assert np.abs(counts - np.rint(counts)).max() < 1e-6
        assert np.ptp(counts, axis=0).min() > 3


def test_noise_has_its_size_and_perfect_sensors_show_the_truth(truth: PlantFile) -> None:
    noise = np.linspace(0.01, 0.07, 7)
    mtm = arm_at(truth, sensors=Sensors(velocity_noise=noise), seed=1)
    velocity = simulate(mtm, None, 2.0).velocity @ MOTORS.T
    np.testing.assert_allclose(velocity.std(axis=0), noise, rtol=0.1)
    mtm = arm_at(truth)
    mtm.move_jp(np.zeros(7))
    steps(mtm, 100)
    before = mtm.plant.q, mtm.plant.v
    steps(mtm, 1)
    measured = mtm.measure()
    np.testing.assert_allclose(measured.position, before[0], atol=1e-15)
    np.testing.assert_allclose(measured.velocity, 0.5 * (before[1] + mtm.plant.v), atol=1e-15)
    np.testing.assert_allclose(measured.effort, mtm.effort, atol=1e-15)


def test_efforts_can_come_late(truth: PlantFile) -> None:
    runs = []
    for delay in (0.0, 0.02):
        mtm = arm_at(truth, sensors=Sensors(effort_delay=delay))
        mtm.move_jp(np.zeros(7))
        runs.append(simulate(mtm, None, 0.3))
    np.testing.assert_array_equal(runs[0].position, runs[1].position)
    np.testing.assert_array_equal(runs[0].effort[:-20], runs[1].effort[20:])
    assert (runs[0].effort[20:] != runs[1].effort[20:]).any()


# --- plant files -------------------------------------------------------------------------


WRONG_PLANTS = [
    ("rotor_inertia: [0.0043", "rotor_inertia: [-0.0043", "rotor_inertia[0]"),
    ("mass: 0.65,", "mass: heavy,", "links.link2.mass"),
    ("inertia: [0.0008, 0.012,", "inertia: [0.1, 0.012,", "links.link2.inertia"),
    ("effort_delay: 0.0", "effort_lag: 0.0", "sensors.effort_lag"),
    ("  arm: mtmr", "  arm: mtmx", "mtmx"),
]


def test_a_wrong_plant_file_is_refused_in_one_line(tmp_path: Path) -> None:
    text = config_path("plants/mtmr_28002.yaml").read_text()
    path = tmp_path / "plant.yaml"
    for old, new, named in WRONG_PLANTS:
        assert old in text
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(ConfigError) as error:
            PlantFile.load(path)
        assert named in str(error.value)
        assert "plant.yaml" in str(error.value)
        assert "\n" not in str(error.value)


def test_the_plants_weight_and_cables_are_those_of_the_identified_model(truth: PlantFile) -> None:
    model = TorqueModel.load(config_path("mtmr_28002.yaml"))
    share = np.random.default_rng(4).uniform(0.05, 0.95, (50, 7))
    poses = model.arm.lower + share * (model.arm.upper - model.arm.lower)
    np.testing.assert_allclose(truth.model.torque(poses), model.torque(poses), atol=1e-12)
    plant = truth.plant()
    for pose in poses:
        plant.reset(pose)
        np.testing.assert_allclose(plant.smooth_torque(), model.torque(pose), atol=1e-12)


def test_an_arm_has_the_friction_of_its_urdf_and_of_the_model_that_it_is_converted_to(tmp_path):
    """As its file states where it does (xArm: both), or as is usual (UR5)."""
    for file in (ROBOTS / "xarm_description/urdf/xarm7.urdf", UR5):
        TorqueModel.load(file).save(tmp_path / "model.yaml")
        plants = [PlantFile.load(file), PlantFile.load(tmp_path / "model.yaml")]
        arm = plants[0].model.arm
        moving = State(np.zeros(arm.n), np.full(arm.n, 0.5))
        by_urdf, by_model = (
            sum(term.torque(moving) for term in plant.model.terms if term.FRICTION)
            for plant in plants
        )
        np.testing.assert_allclose(by_urdf, by_model)
        assert (by_urdf > 0.0).all()
        if file is not UR5:
            stated = [0.5 * joint.damping + joint.friction for joint in arm.joints]
            np.testing.assert_allclose(by_urdf, stated)


def test_an_arm_that_gets_a_load_goes_on_from_where_it_is_and_carries_it():
    bare = PlantFile.of(Arm.load("ecm"))
    values = bare.model.parameters() | {"payload.mass": 0.5}
    loaded = replace(bare, model=TorqueModel.from_parameters(values, bare.model.arm))
    arm = SimulatedArm(bare.plant())
    simulate(arm, None, 0.2)
    before, time, effort = arm.plant.q, arm.plant.time, arm.effort
    arm.replace_plant(loaded.plant())
    assert arm.plant.time == time
    simulate(arm, None, 0.2)
    assert arm.plant.q == pytest.approx(before, abs=1e-4)
    more = loaded.model.torque(before) - bare.model.torque(before)
    assert arm.effort - effort == pytest.approx(more, abs=0.02 * np.abs(more).max())
