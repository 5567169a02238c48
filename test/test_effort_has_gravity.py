"""An arm's file says whether efforts hold its weight, as they are read and as they are sent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from fitted import FEW, ur5_motion
from robots import UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import SampleReader, Settings, Status, Supervisor
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm

POSE = np.array([0.2, -0.8, 1.1, -0.4, 0.5, 0.1])
UPRIGHT = np.array([0.0, -np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0])
STEP = 1e-3


def stating(folder: Path, said: object, **beside: object) -> Arm:
    """Return a UR5 whose file says whether efforts hold its weight."""
    path = folder / "arm.yaml"
    path.write_text(yaml.safe_dump({"urdf": str(UR5), "effort_has_gravity": said, **beside}))
    return Arm.load(path)


def without_gravity() -> Recording:
    recording = ur5_motion()
    weight = stated_weight(Arm.load(UR5), recording.position)
    return replace(recording, effort=recording.effort - weight, arm=None)


def test_an_arm_reads_and_takes_gravity_unless_its_file_says_otherwise(tmp_path):
    for arm in (Arm.load("mtmr"), Arm.load(UR5), stating(tmp_path, {})):
        assert arm.gravity_in_reading
        assert arm.gravity_in_command
    arm = stating(tmp_path, {"command": False})
    assert (arm.gravity_in_reading, arm.gravity_in_command) == (True, False)


def test_what_says_nothing_of_gravity_or_no_masses_complete_is_refused(tmp_path):
    for said in ({"reads": True}, {"read": "no"}, {"read": 1}, [True, False], True):
        with pytest.raises(ConfigError, match=r"effort_has_gravity: got .*expected {read: true"):
            stating(tmp_path, said)
    motors = {"actuator_to_joint": (2 * np.eye(6)).tolist(), "actuator_effort_limit": [9.0] * 6}
    for beside in ({"effort_unit": "A"}, motors):
        with pytest.raises(ConfigError, match=r"effort_has_gravity\.read: got False"):
            stating(tmp_path, {"read": False}, **beside)


def test_a_model_file_carries_it_whatever_has_become_of_the_arm_s(tmp_path):
    arm = stating(tmp_path, {"read": False, "command": False})
    TorqueModel.from_arm(arm).save(tmp_path / "model.yaml")
    stating(tmp_path, {})
    loaded = TorqueModel.load(tmp_path / "model.yaml").arm
    assert (loaded.gravity_in_reading, loaded.gravity_in_command) == (False, False)


def test_the_weight_of_efforts_without_it_is_what_the_file_states(tmp_path):
    arm, given = stating(tmp_path, {"read": False}), without_gravity()
    fit = identify(given, arm, effects=FEW)
    assert fit.verdict.level == "usable"
    assert len(fit.verdict.findings) == 1
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 6))
    held, stated = fit.model.torque(q), stated_weight(arm, q)
    assert np.abs(held - stated).max() < 0.05 * np.abs(stated).max()
    errors = evaluate(fit.model, given).joints
    assert max(error.nrmse for error in errors.values()) < 0.1
    given.of(arm).save(tmp_path / "again.csv")
    again = Recording.load(tmp_path / "again.csv")
    np.testing.assert_allclose(again.effort, given.effort, atol=1e-6)


def test_a_weight_that_no_masses_or_not_all_joints_give_is_refused(tmp_path):
    whole = without_gravity()
    arm = replace(Arm.load(UR5), inertial_parameters=None, gravity_in_reading=False)
    with pytest.raises(ConfigError, match="arm's file with masses"):
        identify(whole, arm, effects=FEW)
    some = replace(
        whole, joints=whole.joints[1:2], position=whole.position[:, 1:2],
        velocity=whole.velocity[:, 1:2], effort=whole.effort[:, 1:2],
    )  # fmt: skip
    arm = stating(tmp_path, {"read": False})
    with pytest.raises(RecordingError, match="has shoulder_lift_joint only: expected all joints"):
        identify([whole, some], arm, effects=FEW, still=dict.fromkeys(whole.joints, 0.0))


def test_what_the_arm_holds_itself_is_not_commanded_but_a_payload_is(tmp_path):
    for read in (True, False):
        model = TorqueModel.from_arm(stating(tmp_path, {"read": read, "command": False}))
        settings = Settings.from_parameters(model.parameters())
        np.testing.assert_allclose(settings.torque(POSE, np.zeros(6)), np.zeros(6), atol=1e-12)
        loaded = model.parameters() | {"payload.mass": 1.0, "payload.link": "wrist_3_link"}
        assert np.abs(Settings.from_parameters(loaded).torque(POSE, None)[1]) > 1.0


def moved(arm: Arm, part: float = 1.0, pose: np.ndarray = POSE) -> tuple[float, Supervisor]:
    """Start a compensator on a simulated arm, and return how far a joint gets in 1 s, deg."""
    model = TorqueModel.from_arm(arm)
    values = model.parameters() | {
        name: tuple(part * np.array(value))
        for name, value in model.parameters().items()
        if name.startswith("link_weight.")
    }
    plant = PlantFile.of(arm).plant()
    plant.reset(pose)
    simulated = SimulatedArm(plant, builtin_compensation=False, dt=STEP)
    supervisor = Supervisor(Settings.from_parameters(values))
    reader, farthest = SampleReader(arm), 0.0
    for k in range(300, 1800):
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
        if supervisor.status is Status.FAULT:
            break
    return float(np.degrees(farthest)), supervisor


@pytest.mark.parametrize("read", [True, False])
@pytest.mark.parametrize("command", [True, False])
def test_an_arm_starts_without_a_jump_however_it_has_gravity(tmp_path, read, command):
    distance, supervisor = moved(stating(tmp_path, {"read": read, "command": command}))
    assert supervisor.status is Status.COMMANDING, supervisor.reason
    assert distance < 2.0


def test_a_model_of_another_weight_than_the_masses_is_refused(tmp_path):
    for read, part in ((True, 0.32), (True, 3.0), (False, 0.01), (False, 3.0)):
        distance, supervisor = moved(stating(tmp_path, {"read": read}), part)
        assert supervisor.status is Status.FAULT, (read, part)
        assert f"holds {part:g} times what the masses" in supervisor.reason
        assert distance < 0.5
    # Masses that are off by some part are no such weight.
    for part in (0.75, 1.3):
        _, supervisor = moved(stating(tmp_path, {}), part)
        assert "times what the masses" not in supervisor.reason


def test_near_balance_the_weight_elsewhere_is_compared(tmp_path):
    for part in (-1.0, 0.0, 0.3, 3.0):
        _, supervisor = moved(stating(tmp_path, {}), part, UPRIGHT)
        assert supervisor.status is Status.FAULT, part
        assert f"weight is {part:g} times" in supervisor.reason
    _, supervisor = moved(stating(tmp_path, {}), 1.2, UPRIGHT)
    assert supervisor.status is Status.COMMANDING, supervisor.reason
