"""An arm is data: a made-up chain, a UR5 and a Panda are identified, diagnosed and compensated.

The simulated arms move by Pinocchio's dynamics of links and friction that no effect of the package
computes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pytest
from made_up_arm import made_up_arm, random_inertias
from robots import PANDA, ROBOTS, UR5

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.cli.replay import replay
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.estimation import FoldSettings, make_folds
from dvrk_gravity.identification import Fit, certificate, estimate, evaluate, identify
from dvrk_gravity.identification.trajectories import problem
from dvrk_gravity.intake import read_motions
from dvrk_gravity.model import TorqueModel, identified, start_columns
from dvrk_gravity.recording import BagReader, Recording
from dvrk_gravity.ros import NodeProcess
from dvrk_gravity.simulate import PlantFile
from testing.mujoco_arms import KINOVA
from testing.plain_world import NOISE, PlainWorld

pytestmark = pytest.mark.usefixtures("four_folds")
FINGER = ROBOTS / "finger_edu_description" / "robots" / "finger_edu.urdf"
MASS, COM = 0.3, (0.02, -0.01, 0.05)  # kg, m in the last link's frame


@dataclass(frozen=True, eq=False)
class Identified:
    """A simulated arm, what was identified of it, the file, and the last link of its chain."""

    world: PlainWorld
    fit: Fit
    file: Path
    last: str

    @property
    def arm(self) -> Arm:
        return self.world.arm

    @cached_property
    def model(self) -> TorqueModel:
        return TorqueModel.load(self.file)


def of_chain(folder: Path) -> tuple[PlainWorld, str]:
    arm = made_up_arm(folder)
    return PlainWorld.of(arm, random_inertias(arm, 3)), "link4"


def of_urdf(name: str) -> tuple[PlainWorld, str]:
    arm = Arm.load(name)
    links = nominal_inertias(arm)
    return PlainWorld.of(arm, links), arm.body_names[-1]


# Every arm's payload is looked for; what else may be there, in trials.
CHAIN_FIRST = pytest.mark.parametrize(
    "known",
    ["chain", *(pytest.param(name, marks=pytest.mark.slow) for name in ("panda", "ur5"))],
    indirect=True,
)


@pytest.fixture(scope="module", params=["chain", "ur5", "panda"])
def known(request, tmp_path_factory) -> Identified:
    folder = tmp_path_factory.mktemp(request.param)
    if request.param == "chain":
        world, last = of_chain(folder)
    else:  # the Panda's fingers are held
        world, last = of_urdf(str(UR5) if request.param == "ur5" else f"{PANDA}#panda_hand")
    fit = identify(world.record(1, 20.0), world.arm)
    file = folder / "model.yaml"
    fit.model.save(file)
    return Identified(world, fit, file, last)


def error_beyond_noise(known: Identified, model: TorqueModel, recording: Recording) -> np.ndarray:
    """(n,) RMS error at the joints as a part of the noise of the measured effort."""
    arm = known.arm
    noise = arm.joint_effort(np.diag(NOISE * arm.actuator_effort_limit))
    found = evaluate(model, [recording], "joint").joints
    rmse = np.array([found[name].rmse for name in arm.joint_names])
    return rmse / np.linalg.norm(noise, axis=0)


def test_an_identified_arm_is_fit_to_be_compensated_and_names_its_own_bodies(known):
    assert known.fit.verdict.level == "good"
    names = [parameter.name for parameter in known.fit.parameters]
    assert not any("beta" in name or "outer_yaw" in name for name in names)
    assert any(known.last in name for name in names)


def test_an_effort_limit_far_above_the_torques_changes_nothing(tmp_path):
    """As the finger's own file has it: 1000 N·m, where it takes a tenth of one."""
    shipped = FINGER.read_text()
    urdfs = [tmp_path / f"limit_{limit}.urdf" for limit in (1, 1000, 1_000_000)]
    for urdf in urdfs:
        effort = f'effort="{urdf.stem.removeprefix("limit_")}"'
        urdf.write_text(
            shipped.replace('effort="1000"', effort).replace('velocity="1000"', 'velocity="4"')
        )
    world, _ = of_urdf(str(urdfs[0]))
    recording = replace(world.record(1, 15.0), arm=None)
    tight, *wide = (identify([recording], Arm.load(urdf)) for urdf in urdfs)
    for fit in wide:
        assert fit.identifiability.rank == tight.identifiability.rank
        for name, error in tight.held_out.items():
            assert fit.held_out[name].rmse == pytest.approx(error.rmse, rel=0.01)


def test_friction_comes_out_with_the_unit_of_its_joint(known):
    found = {parameter.name: parameter for parameter in known.fit.parameters}
    for joint, coulomb, viscous in zip(
        known.arm.joints, known.world.coulomb, known.world.viscous, strict=True
    ):
        slide = joint.kind == "prismatic"
        dry = found[f"coulomb_friction.joint[{joint.name}]"]
        damping = found[f"viscous_friction.joint[{joint.name}]"]
        assert (dry.unit, damping.unit) == (("N", "N·s/m") if slide else ("N·m", "N·m·s/rad"))
        assert dry.value == pytest.approx(coulomb, rel=0.1), joint.name
        assert damping.value == pytest.approx(viscous, rel=0.2), joint.name


@CHAIN_FIRST
def test_another_motion_is_predicted_and_nothing_is_found_in_it(known):
    recording = known.world.record(2, 16.0)
    assert (error_beyond_noise(known, known.model, recording) < 1.0).all()
    assert diagnose(recording, known.model).verdict == "nothing_to_explain"


def test_a_hidden_payload_is_found_weighed_and_taken_into_the_model(known, tmp_path):
    loaded = known.world.with_payload(known.last, MASS, COM)
    found = diagnose(loaded.record(2, 14.0), known.model)
    payload = next(iter(found.findings))
    assert (payload.effect, payload.joints) == ("payload", (known.arm.joint_names[-1],))
    assert payload.parameters["mass"].value == pytest.approx(MASS, rel=0.05)
    # Across the last joint's axis that joint weighs it; along it the arm before does, whose
    # torques are known less well.
    for axis, coordinate, within in zip("xyz", COM, (0.002, 0.002, 0.01), strict=True):
        moment = payload.parameters[f"first_moment_{axis}"].value
        assert moment == pytest.approx(MASS * coordinate, abs=within), axis
    found.model.save(tmp_path / "extended.yaml")
    extended = TorqueModel.load(tmp_path / "extended.yaml")
    other = loaded.record(3, 8.0)
    before, after = (error_beyond_noise(known, model, other) for model in (known.model, extended))
    assert before.max() > 3.0
    assert after.max() < 1.5


@CHAIN_FIRST
def test_added_dry_friction_is_found_at_its_joint(known):
    joint = known.arm.n // 2  # of the chain the one that slides
    added = float(known.world.coulomb[joint])
    found = diagnose(known.world.with_friction(joint, added).record(2, 12.0), known.model)
    friction = next(iter(found.findings))
    assert (friction.effect, friction.joints) == (
        "coulomb_friction", (known.arm.joint_names[joint],),
    )  # fmt: skip
    for way in ("positive", "negative"):
        assert friction.parameters[way].value == pytest.approx(added, rel=0.1)
        assert friction.parameters[way].unit == known.arm.effort_units[joint]


def test_a_model_of_any_arm_moves_in_the_simulator_and_balances(known):
    plant = PlantFile.load(known.file).plant()
    lowest, highest = known.arm.range
    plant.reset(0.5 * (lowest + highest))
    start = plant.q.copy()
    for _ in range(200):
        plant.step(known.model.torque(plant.q), dt=1e-3)
    np.testing.assert_allclose(plant.q, start, atol=1e-6)
    for _ in range(200):
        plant.step(np.zeros(known.arm.n), dt=1e-3)
    assert np.abs(plant.q - start).max() > 0.01


def test_joints_that_turn_without_an_end_are_fitted_with_the_same_effects():
    endless = Arm.load(KINOVA)
    assert np.isinf(endless.upper).any()
    assert identified(endless) == identified(Arm.load(UR5))


def test_links_that_can_exist_are_found_when_they_are_asked_for(tmp_path, monkeypatch):
    world, _ = of_chain(tmp_path)
    motions = read_motions([world.record(1, 12.0)], world.arm, "joint")
    # Bodies are searched for anew for each block that is held out: two instead of twelve.
    few = partial(make_folds, settings=FoldSettings(count=2))
    monkeypatch.setattr(problem, "make_folds", few)
    posed = problem.pose(motions.parts, world.arm)
    found = estimate(posed, start_columns(posed.design.columns), physical=True)
    assert found.links is not None
    eigenvalues = certificate(world.arm, found.links)
    assert set(eigenvalues) == set(world.arm.body_names)
    assert min(eigenvalues.values()) > 0.0


LITTLE = 0.1  # of the arm's friction: with all of it, even a wrong model would hold
SECONDS, RATE = 2.0, 200.0
FALLEN = 0.6  # of what counts as much as a rad


def bag_topics(arm: Arm) -> tuple[str, str]:
    """Return what a replay writes for an arm."""
    namespace = arm.name.upper()
    return f"/{namespace}/measured_js", f"/{namespace}/servo_jf"


def under_compensation(known: Identified, start: np.ndarray, listen: bool) -> Recording:
    """Let a simulated arm go at a pose, under the commands of the compensator's process.

    The two take turns: the arm waits for the command that answers its last message, and both begin
    anew where the machine stood still for longer than the compensator's time-out. Until the first
    command the arm's servo holds it; with ``listen`` false it then gets no effort at all, until it
    has fallen far enough: before long the compensator would notice that it runs away.
    """
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Empty, Float64MultiArray

    from dvrk_gravity.ros import Client

    step = 1e-3
    arm = known.world.simulated(5, LITTLE, step)
    arm.plant.reset(start)
    arm.hold()
    commands: list[np.ndarray] = []
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    # What little friction there is must not be taken for the whole of it.
    none = f"friction_compensation.ratio:={[0.0] * known.arm.n}"
    settings = ("output:=array", "timeout:=1.0", "max_stamp_age:=0.0", none)
    arguments = [part for setting in settings for part in ("-p", setting)]
    files = ("--params-file", str(known.file))
    with (
        Client() as client,
        NodeProcess("compensator", *files, *arguments) as node,
    ):
        client.node.declare_parameter("joints", list(known.arm.joint_names))
        measured = client.node.create_publisher(JointState, "measured_js", 10)
        client.node.create_subscription(
            Float64MultiArray, "commands", lambda m: commands.append(np.array(m.data)), 10
        )
        holds: list[object] = []
        client.node.create_subscription(Empty, "hold", holds.append, 10)
        client.watch_state("compensator")
        client.wait(
            lambda: client.state("compensator") != "" and client.connected(measured), "the node"
        )

        def fault() -> str:
            said = client.state("compensator")
            return said if said.startswith("fault") else ""

        def moved() -> float:
            return float((np.abs(arm.plant.q - start) / known.arm.scale).max())

        stamp, let_go, attempts = time.time_ns(), -1, 1
        while let_go < 0 or (len(rows) < let_go + SECONDS * RATE and (listen or moved() < FALLEN)):
            assert len(rows) < 20.0 * RATE, f"no command: {client.state('compensator')}"
            for _ in range(round(1.0 / (RATE * step))):
                arm.step()
            sample = arm.measure()
            rows.append((sample.position, sample.velocity, sample.effort))
            message = JointState(
                name=known.arm.joint_names, position=sample.position.tolist(),
                velocity=sample.velocity.tolist(), effort=sample.effort.tolist(),
            )  # fmt: skip
            stamp += round(1e9 / RATE)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
            answered = len(commands)
            measured.publish(message)
            if let_go < 0:
                client.spin(1.0 / RATE)
            else:
                client.wait(lambda n=answered: len(commands) > n or fault() != "", "a command")
            if let_go >= 0 and fault():  # this machine stood still: begin anew, as a person would
                assert "measured_js" in fault()
                assert attempts < 3, fault()
                attempts, let_go = attempts + 1, -1
                arm.plant.reset(start)
                arm.hold()
                client.wait(lambda: bool(holds), "the hold")
                holds.clear()
                assert client.enable(True).success
                rows.clear()
                commands.clear()
            elif commands:
                let_go = let_go if let_go >= 0 else len(rows)
                arm.servo_jf(commands[-1] if listen else 0.0 * commands[-1])
        assert not holds
    assert "Traceback" not in node.output
    position, velocity, effort = (np.array(column) for column in zip(*rows[let_go:], strict=True))
    now = np.arange(len(position)) / RATE
    return Recording(known.arm.joint_names, now, position, velocity, effort, source="let go")


def test_the_compensator_holds_the_arm_and_a_replay_says_what_it_is_to_say(known, domain, tmp_path):
    lowest, highest = known.arm.range
    pose = 0.5 * (lowest + highest) + 0.15 * np.clip(highest - lowest, 0.0, 3.0)
    held = under_compensation(known, pose, listen=True)
    moved = np.abs(held.position - pose).max(axis=0) / known.arm.scale
    fallen = under_compensation(known, pose, listen=False)
    would = np.abs(fallen.position - pose).max(axis=0) / known.arm.scale
    assert moved.max() < 1e-3
    assert would.max() > 0.5
    held.save(tmp_path / "bag", topic="/arm/measured_js")
    result = replay(tmp_path / "bag", known.file, tmp_path / "answers")
    assert result.passed
    with BagReader(tmp_path / "answers") as bag:
        topics = {topic for topic, _, _ in bag.raw(*bag_topics(known.arm))}
    assert topics == set(bag_topics(known.arm))
    assert result.answered == len(held)


def test_a_compensator_without_the_weight_of_its_arm_is_refused_in_one_line(tmp_path):
    arm = made_up_arm(tmp_path)
    given = {"arm": arm.source}
    with pytest.raises(ConfigError, match=r"^link_weight\.\*: got \[\], expected weight of link1"):
        Settings.from_parameters(given)
    assert Settings.from_parameters({**given, "link_weight.link4": (0.5, 0.0, 0.0, 0.02)})
