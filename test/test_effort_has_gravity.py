"""An arm's file says whether efforts hold its weight, as they are read and as they are sent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from robots import UR5
from test_weights import FEW, recorded

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import SampleReader, Settings, Status, Supervisor
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel, stated_weight
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm

POSE = np.array([0.2, -0.8, 1.1, -0.4, 0.5, 0.1])
STEP = 1e-3


def stating(folder: Path, **said: bool) -> Arm:
    """Return a UR5 whose file says whether efforts hold its weight."""
    path = folder / "arm.yaml"
    path.write_text(yaml.safe_dump({"urdf": str(UR5), "effort_has_gravity": said}))
    return Arm.load(path)


def without_gravity() -> Recording:
    recording = recorded()
    weight = stated_weight(Arm.load(UR5), recording.position)
    return replace(recording, effort=recording.effort - weight, arm=None)


def test_an_arm_reads_and_takes_gravity_unless_its_file_says_otherwise(tmp_path):
    for arm in (Arm.load("mtmr"), Arm.load(UR5), stating(tmp_path)):
        assert arm.gravity_in_reading
        assert arm.gravity_in_command
    arm = stating(tmp_path, command=False)
    assert (arm.gravity_in_reading, arm.gravity_in_command) == (True, False)


@pytest.mark.parametrize(
    "said", [{"reads": True}, {"read": "no"}, {"read": 1}, [True, False], True]
)
def test_what_says_nothing_of_gravity_is_refused_in_a_line(tmp_path, said):
    path = tmp_path / "arm.yaml"
    path.write_text(yaml.safe_dump({"urdf": str(UR5), "effort_has_gravity": said}))
    with pytest.raises(ConfigError, match=r"effort_has_gravity: got .*expected {read: true or fal"):
        Arm.load(path)


@pytest.mark.parametrize("beside", [{"effort_unit": "A"}, {"actuator_to_joint": 2 * np.eye(6)}])
def test_what_masses_do_not_complete_is_refused(tmp_path, beside):
    if "actuator_to_joint" in beside:
        beside = {"actuator_to_joint": (2 * np.eye(6)).tolist(), "actuator_effort_limit": [9.0] * 6}
    path = tmp_path / "arm.yaml"
    content = {"urdf": str(UR5), "effort_has_gravity": {"read": False}, **beside}
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match=r"effort_has_gravity\.read: got False"):
        Arm.load(path)


def test_a_model_file_carries_it(tmp_path):
    arm = stating(tmp_path, read=False, command=False)
    TorqueModel.stated(arm).save(tmp_path / "model.yaml")
    # Whatever has become of the arm's file, as for its gains.
    stating(tmp_path)
    loaded = TorqueModel.load(tmp_path / "model.yaml").arm
    assert (loaded.gravity_in_reading, loaded.gravity_in_command) == (False, False)
    written = (tmp_path / "model.yaml").read_text()
    assert "effort_has_gravity:\n" in written


def test_the_weight_of_efforts_without_it_is_what_the_file_states(tmp_path):
    arm = stating(tmp_path, read=False)

    fit = identify(without_gravity(), arm, effects=FEW)

    assert fit.verdict.level == "usable"
    (line,) = fit.verdict.findings
    assert line.startswith("gravity is that of the masses in the arm's file, and was not measured")
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 6))
    held, stated = fit.model.torque(q), stated_weight(arm, q)
    assert np.abs(held - stated).max() < 0.05 * np.abs(stated).max()
    errors = evaluate(fit.model, without_gravity()).joints
    assert max(error.nrmse for error in errors.values()) < 0.1


def test_efforts_without_gravity_complete_and_written_are_as_they_were(tmp_path):
    arm, given = stating(tmp_path, read=False), without_gravity()
    given.of(arm).save(tmp_path / "again.csv")
    again = Recording.load(tmp_path / "again.csv")
    np.testing.assert_allclose(again.effort, given.effort, atol=1e-6)


def test_an_arm_without_masses_says_nothing_of_the_weight_that_is_not_read():
    arm = replace(Arm.load(UR5), inertial_parameters=None, gravity_in_reading=False)
    with pytest.raises(ConfigError, match="an arm's file with masses: efforts without gravity"):
        identify(without_gravity(), arm, effects=FEW)


def test_joints_that_were_not_recorded_leave_open_what_efforts_lack(tmp_path):
    arm, whole = stating(tmp_path, read=False), without_gravity()
    some = replace(
        whole, joints=whole.joints[1:2], position=whole.position[:, 1:2],
        velocity=whole.velocity[:, 1:2], effort=whole.effort[:, 1:2],
    )  # fmt: skip
    with pytest.raises(RecordingError, match="has shoulder_lift_joint only: expected all joints"):
        identify([whole, some], arm, effects=FEW, still=dict.fromkeys(whole.joints, 0.0))


# --- the compensator ---------------------------------------------------------------------


@pytest.mark.parametrize("read", [True, False])
def test_what_the_arm_holds_itself_is_not_commanded(tmp_path, read):
    model = TorqueModel.stated(stating(tmp_path, read=read, command=False))
    settings = Settings.from_parameters(model.parameters())
    np.testing.assert_allclose(settings.torque(POSE, np.zeros(6)), np.zeros(6), atol=1e-12)
    carrying = Settings.from_parameters(
        model.parameters() | {"payload.mass": 1.0, "payload.link": "wrist_3_link"}
    )
    assert np.abs(carrying.torque(POSE, None)[1]) > 1.0, "of a payload the arm knows nothing"


def moved(arm: Arm, part: float = 1.0, pose: np.ndarray = POSE) -> tuple[float, Supervisor]:
    """Start a compensator on a simulated arm, and return how far a joint gets in 2 s, deg."""
    model = TorqueModel.stated(arm)
    values = model.parameters() | {
        name: tuple(part * np.array(value))
        for name, value in model.parameters().items()
        if name.startswith("link_weight.")
    }
    plant = PlantFile.of(arm).plant()
    plant.reset(pose)
    simulated = SimulatedArm(plant, builtin_compensation=False, dt=STEP)
    supervisor = Supervisor(Settings.from_parameters(values))
    reader, farthest = SampleReader(arm.joint_names), 0.0
    for k in range(300, 2800):
        simulated.step()
        if k % 5 or k < 600:
            continue
        measured, stamp = simulated.measure(), int(k * STEP * 1e9)
        sample = reader.read(
            stamp, arm.joint_names, measured.position, measured.velocity, measured.effort
        )
        command = supervisor.command(sample, k * STEP, stamp)
        if command is not None:
            simulated.servo_jf(command)
        farthest = max(farthest, float(np.abs(plant.q - pose).max()))
    return float(np.degrees(farthest)), supervisor


@pytest.mark.parametrize("read", [True, False])
@pytest.mark.parametrize("command", [True, False])
def test_an_arm_starts_without_a_jump_however_it_has_gravity(tmp_path, read, command):
    distance, supervisor = moved(stating(tmp_path, read=read, command=command))
    assert supervisor.status is Status.COMMANDING, supervisor.reason
    assert distance < 2.0


@pytest.mark.parametrize("part", [0.01, 0.1, 0.32, 3.0, 10.0])
@pytest.mark.parametrize("read", [True, False])
def test_a_model_of_another_weight_than_the_masses_is_refused(tmp_path, read, part):
    distance, supervisor = moved(stating(tmp_path, read=read), part)
    assert supervisor.status is Status.FAULT
    assert f"the model holds {part:g} times what the masses in the arm's file" in supervisor.reason
    assert distance < 0.5


@pytest.mark.parametrize("part", [-1.0, 0.0, 0.3, 3.0])
def test_near_balance_the_weight_elsewhere_is_compared(tmp_path, part):
    upright = np.array([0.0, -np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0])
    _, supervisor = moved(stating(tmp_path), part, upright)
    assert supervisor.status is Status.FAULT
    assert f"over the arm's range the model's weight is {part:g} times" in supervisor.reason
    _, supervisor = moved(stating(tmp_path), 1.2, upright)
    assert supervisor.status is Status.COMMANDING, supervisor.reason


def test_a_model_of_masses_that_are_off_by_some_part_starts(tmp_path):
    for part in (0.75, 1.3):
        _, supervisor = moved(stating(tmp_path), part)
        assert "times what the masses" not in supervisor.reason
