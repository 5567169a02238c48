"""Any arm is simulated, and falls, floats, is pushed and held in the demonstration."""

from __future__ import annotations

import signal
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_up_arm import made_up_arm
from robots import PANDA, UR5
from std_msgs.msg import Bool
from support import MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.cli.demo import draw
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import BagReader
from dvrk_gravity.report import shown_position
from dvrk_gravity.ros import (
    BEARABLE,
    COMMANDS,
    MODEL,
    PRIVATE,
    Client,
    Phase,
    Scenario,
    Schedule,
    Stage,
)
from dvrk_gravity.simulate import PlantFile, SimulatedArm

NAMES = ("made_up", "ur5", "panda", "mtml", "mtmr")


@pytest.fixture(params=NAMES)
def arm(request, tmp_path) -> Arm:
    files = {"ur5": str(UR5), "panda": str(PANDA)}
    if request.param == "made_up":
        return made_up_arm(tmp_path)
    return Arm.load(files.get(request.param, request.param))


def test_the_plant_of_any_arm_balances_under_its_own_terms_and_falls_without(arm):
    plant = PlantFile.of(arm).plant(friction_scale=0.0)
    model = PlantFile.of(arm).model
    start = np.mean(arm.range, axis=0)
    plant.reset(start)
    for _ in range(200):
        plant.step(model.torque(plant.q), dt=1e-3)
    np.testing.assert_allclose(plant.q, start, atol=1e-6)
    for _ in range(200):
        plant.step(np.zeros(arm.n), dt=1e-3)
    assert (np.abs(plant.q - start) / arm.scale).max() > 0.01


def test_the_plant_s_terms_are_a_model_file_of_the_arm(arm, tmp_path):
    model = PlantFile.of(arm).model
    model.save(tmp_path / "model.yaml")
    again = TorqueModel.load(tmp_path / "model.yaml")
    q = np.mean(arm.range, axis=0)
    np.testing.assert_array_equal(again.torque(q, arm.scale), model.torque(q, arm.scale))


def test_a_simulated_arm_gets_to_every_pose_of_its_demonstration(arm, tmp_path):
    stage = Stage.of(arm, "", None, tmp_path)
    simulated = SimulatedArm(PlantFile.of(arm).plant())
    for pose in stage.poses:
        assert (pose > arm.lower).all()
        assert (pose < arm.upper).all()
        simulated.move_jp(pose)
        for _ in range(12000):
            simulated.step()
            away, speed = np.abs([simulated.plant.q - pose, simulated.plant.v]) / arm.scale
            if max(away) < np.radians(0.5) and max(speed) < 1e-3:
                break  # it is there, and stays
        assert (np.abs(simulated.plant.q - pose) / arm.scale).max() < np.radians(1.0)
        weight = np.abs(simulated.plant.smooth_torque()) / arm.effort_limit
        assert weight.max() <= BEARABLE
    assert (np.abs(stage.push) <= arm.effort_limit).all()


def test_the_model_that_comes_with_the_package_is_taken_and_otherwise_the_plant_s(tmp_path):
    assert Stage.of(Arm.load("mtmr"), "", None, tmp_path).model.name == "mtmr_28002.yaml"
    assert not (tmp_path / MODEL).exists()
    assert Stage.of(Arm.load("mtml"), "", None, tmp_path).model == tmp_path / MODEL
    with pytest.raises(ConfigError, match=r"^plant: got .*, expected one with the joints of ur5"):
        Stage.of(Arm.load(str(UR5)), "mtmr_28002", None, tmp_path)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"reading.effort_scale": (1.3,) * 7}, "reading.effort_scale: .* right readings"),
        ({"identification.verdict": "do_not_compensate"}, "verdict: .* fit for compensation"),
    ],
)
def test_a_model_that_the_compensator_refuses_is_refused_before_anything_starts(
    given, message, tmp_path
):
    model = TorqueModel.load(MODEL_FILE)
    changed = TorqueModel.from_parameters(model.parameters() | given, model.arm)
    changed.save(tmp_path / "model.yaml")
    with pytest.raises(ConfigError, match=f"model.yaml: .*{message}"):
        Stage.of(model.arm, "", tmp_path / "model.yaml", tmp_path)


def test_a_urdf_named_as_a_shipped_arm_is_shown_with_its_own_masses(tmp_path):
    text = UR5.read_text().replace('<robot name="ur5"', '<robot name="mtmr"')
    (tmp_path / "arm.urdf").write_text(text)
    named = Arm.load(str(tmp_path / "arm.urdf"))
    assert named.name == "mtmr"
    assert Stage.of(named, "", None, tmp_path).own_model


def farthest(phase: Phase, arm: Arm) -> float:
    """Return the largest distance of any joint, rad or a tenth of it in m."""
    return float((phase.drift / arm.scale).max())


# Twenty seconds of three processes each. Quick are an MTM's demonstration (test_installed), the
# poses that a simulated arm of any kind gets to, and what each process does with either output.
@pytest.mark.slow
@pytest.mark.parametrize("output", ["servo_jf", "array"])
def test_a_demonstration_of_a_made_up_arm(output, domain, tmp_path):
    arm = made_up_arm(tmp_path)
    stage = Stage.of(arm, "", None, tmp_path)
    stage = replace(stage, poses=stage.poses[:1])
    schedule = Schedule(fall=0.7, floating=1.0, rest=0.5)
    with Scenario(stage, tmp_path / "bag", output=output, schedule=schedule) as scenario:
        fall = scenario.fall()
        (first,) = floats = list(scenario.floats())
        pushed, rest = scenario.push()
        # The arm stands still for longer than the compensator waits: it gives up, unheard yet.
        scenario.simulator.signal(signal.SIGSTOP)
        time.sleep(0.3)
        scenario.simulator.signal(signal.SIGCONT)
        kill = scenario.kill()
    assert farthest(fall, arm) > 0.5
    assert max(farthest(phase, arm) for phase in (*floats, rest, kill.after)) < np.radians(0.5)
    assert farthest(pushed, arm) > 0.1
    assert kill.hold_after > 0.0
    assert any(reason.startswith("fault") for reason in scenario.interruptions)
    namespace = f"{PRIVATE}/MADE_UP"
    command = {"servo_jf": f"{namespace}/servo_jf", "array": f"{namespace}/commands"}[output]
    with BagReader(tmp_path / "bag") as bag:
        topics = {
            topic
            for topic, _, _ in bag.raw(command, f"{namespace}/measured_js", f"{namespace}/hold")
        }
    assert len(topics) == 3
    draw(tmp_path / "demo.png", arm, fall, floats, pushed, rest, kill)
    assert (tmp_path / "demo.png").stat().st_size > 10_000
    assert first.position.shape[1] == arm.n


def test_a_console_that_comes_into_its_domain_gets_nothing_of_a_demonstration(domain, tmp_path):
    stage = Stage.of(Arm.load("mtmr"), "", None, tmp_path)
    stage = replace(stage, poses=stage.poses[:1])
    schedule = Schedule(fall=0.1, floating=0.1, push=0.1, coast=0.1, rest=0.1)
    heard: list[str] = []
    with (
        Client("/MTMR", "console") as console,
        Scenario(stage, tmp_path / "bag", schedule=schedule) as scenario,
    ):
        for name, kind in (*COMMANDS, ("use_gravity_compensation", Bool)):
            hear = partial(lambda name, _: heard.append(name), name)
            console.node.create_subscription(kind, name, hear, 100)
        console.wait(lambda: "compensator" in console.node.get_node_names(), "the demonstration")
        scenario.fall()
        assert len(list(scenario.floats())) == 1
        scenario.push()
        assert scenario.kill().hold_after > 0.0
        console.spin(0.2)
    assert not heard


def test_distances_are_shown_in_the_joints_own_units(tmp_path):
    arm = made_up_arm(tmp_path)
    assert [unit for _, unit in shown_position(arm)] == ["deg", "deg", "mm", "deg"]
    position = np.zeros((3, 4))
    position[1] = [0.1, 0.0, 0.02, 0.0]
    phase = Phase("", np.arange(3.0), position)
    shown = [
        factor * way for (factor, _), way in zip(shown_position(arm), phase.drift, strict=True)
    ]
    assert shown == pytest.approx([np.degrees(0.1), 0.0, 20.0, 0.0])


@pytest.mark.parametrize("scale", ["-0.1", "1e9", "nan"])
def test_a_friction_that_the_simulator_would_refuse_is_refused_before_it_starts(scale, capsys):
    assert main(["demo", f"--friction-scale={scale}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
