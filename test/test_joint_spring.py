"""A spring between two joints: against MuJoCo's tendons, in files, compensated, moved and found."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from conftest import few_folds
from made_up_arm import made_up_arm

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import Diagnosis, diagnose, extended, load
from dvrk_gravity.effects import JointSpring, SpringHypothesis, State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing.lab_effects import Setting, left_by
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld
from testing.world import COARSE, World

ARM = Arm.load("mtmr")
FIRST, SECOND = 2, 4  # elbow_pitch, wrist_pitch
STIFFNESS, RATIO, SLACK = 0.3, -0.7, 0.2  # at the first joint, N·m/rad; rad
ROW = np.eye(ARM.n)[FIRST] + RATIO * np.eye(ARM.n)[SECOND]
SPRING = JointSpring(ARM, STIFFNESS * np.outer(ROW, ROW), -STIFFNESS * SLACK * ROW)


def tendon(n: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A chain whose joints all turn about one axis, with a spring over two of them."""
    bodies = "".join(
        f'<body pos="0.1 0 0"><joint name="j{i}" axis="0 0 1"/><geom size="0.02"/>'
        for i in range(n)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/><worldbody>{bodies}{"</body>" * n}</worldbody>
        <tendon><fixed stiffness="{STIFFNESS}" springlength="{SLACK}">
        <joint joint="j{FIRST}" coef="1"/><joint joint="j{SECOND}" coef="{RATIO}"/>
        </fixed></tendon></mujoco>"""
    )
    return model, mujoco.MjData(model)


def test_its_torque_is_that_of_a_tendon_of_mujoco_over_two_joints():
    model, data = tendon(ARM.n)
    for q in np.random.default_rng(1).normal(size=(20, ARM.n)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        # The actuators apply what holds the arm against it.
        np.testing.assert_allclose(SPRING.torque(State(q)), -data.qfrc_spring, atol=1e-12)


def test_no_work_is_left_after_any_closed_way():
    """Its torque on both joints is from one potential."""
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)[:, None]
    q = np.sin(angle + np.arange(ARM.n)) + 0.3
    torque = SPRING.torque(State(q))
    work = 0.5 * (torque[1:] + torque[:-1]) * np.diff(q, axis=0)
    assert abs(work.sum()) < 1e-9
    assert np.abs(work.sum(axis=0)).max() > 0.1, "each joint alone gives and takes"


def values(**changes: object) -> dict[str, object]:
    model = TorqueModel.load("config/mtmr_28002.yaml")
    return {**model.parameters(), **SPRING.parameters(), **changes}


def test_one_that_pulls_at_one_of_its_joints_only_is_refused_by_name():
    row = [0.0] * ARM.n
    with pytest.raises(
        ConfigError,
        match=r"joint_spring.elbow_pitch\[4\].*-0.21.*expected 0, as joint_spring.wrist_pitch\[2\]",
    ):
        TorqueModel.from_parameters(values(**{"joint_spring.wrist_pitch": row}))


def test_its_units_are_those_of_the_joints_that_it_spans(tmp_path):
    arm = made_up_arm(tmp_path)  # R-R-P-R
    declared = {entry.name: entry for entry in JointSpring.schema(arm)}
    assert declared["joint_spring.pitch"].units == ("N·m/rad", "N·m/rad", "N·m/m", "N·m/rad")
    assert declared["joint_spring.insertion"].units == ("N/rad", "N/rad", "N/m", "N/rad")


def test_it_is_compensated():
    plain = TorqueModel.load("config/mtmr_28002.yaml").parameters()
    q = np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5])
    with_it, without = (Settings.from_parameters(v).torque(q, None) for v in (values(), plain))
    expected = STIFFNESS * (q @ ROW - SLACK) * ROW
    np.testing.assert_allclose(with_it - without, expected, atol=1e-12)


def test_a_simulated_arm_rests_where_the_spring_is_slack():
    """Without weight, with damping alone, it comes to where nothing pulls."""
    damping = {"viscous_friction.joint": [0.05] * ARM.n, "arm": "mtmr"}
    model = TorqueModel.from_parameters({**damping, **SPRING.parameters()})
    plant = replace(PlantFile.load("mtmr_28002"), model=model).plant()
    plant.reset(np.zeros(ARM.n))
    for _ in range(6000):
        plant.step(np.zeros(ARM.n), dt=1e-3)
    assert plant.q @ ROW == pytest.approx(SLACK, abs=1e-3)


def test_static_poses_show_it():
    known = World.draw(4, step=COARSE)

    def pull(time: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return 0.06 * (q @ ROW - SLACK) * ROW

    recording = replace(known, extra=(pull,)).record_poses(5, 6, count=120)

    first = diagnose(recording, known.model()).findings[0]

    assert (first.effect, first.joints) == ("joint_spring", ("elbow_pitch", "wrist_pitch"))
    assert first.place == "difference"
    told = first.parameters["stiffness"]
    assert told.low <= 0.06 <= told.high
    assert told.low > 0.03


def sprung(setting: Setting, first: int, second: int, ratio: float, size: float) -> np.ndarray:
    """Return (T, n) torques of a spring, some times what the model leaves at the second joint."""
    row = np.zeros(setting.n)
    row[first], row[second] = 1.0, ratio
    stretch = setting.truth.q @ row
    torque = (stretch - np.quantile(stretch, 0.3))[:, None] * row
    return torque * size / setting.ratio(torque)


@pytest.fixture(
    scope="module",
    params=[
        ("ur5", 2, 3, 1.0, 10.0),
        pytest.param(("mtml", 3, 5, -0.8, 8.0), marks=pytest.mark.slow),
    ],
    ids=lambda case: case[0],
)
def found(request) -> tuple[tuple, MujocoWorld, Recording, Diagnosis]:
    """A spring in an arm that was identified without it, and what a diagnosis makes of it."""
    name, *where = request.param
    world = MujocoWorld.draw(name, 31)
    calibration = draw_calibration(world.arm, 31)
    with few_folds():
        model = identify(world.record(world.truth(calibration, 20.0), 1), world.arm, "joint").model
    truth = world.truth(draw_other(world.arm, 7, calibration), 20.0)
    setting = world.setting(truth, left_by(model, world.record(truth, 2)))
    torque = sprung(setting, *where)
    recording = world.record(replace(truth, effort=truth.effort + torque), 2)
    return request.param, world, recording, diagnose(recording, model)


def test_in_an_identified_arm_it_is_found_at_its_two_joints(found):
    (_, first, second, ratio, _), world, _, diagnosis = found
    best = diagnosis.findings[0]
    names = world.arm.joint_names
    assert (best.effect, best.joints) == ("joint_spring", (names[first], names[second]))
    assert best.place == ("sum" if ratio > 0.0 else "difference")
    assert best.parameters["ratio"].value == pytest.approx(abs(ratio), rel=0.25)
    assert best.certain


def test_the_extended_model_has_it_and_explains_the_recording(found, tmp_path):
    _, _, recording, diagnosis = found
    assert diagnosis.findings[0].in_model
    diagnosis.model.save(tmp_path / "extended.yaml")
    again = diagnose(recording, TorqueModel.load(tmp_path / "extended.yaml"))
    assert "joint_spring" not in [finding.effect for finding in again.findings]


def test_what_is_merged_adds_to_the_springs_that_the_model_has_already():
    world = World.draw(5, step=COARSE)
    base = TorqueModel.from_parameters(
        {**world.model().parameters(), **SPRING.parameters(), "joint_offset": [0.02] * ARM.n}
    )
    motion = load([world.record(1, 2, duration=10.0)], base).motion
    hypothesis = next(
        each for each in JointSpring.hypotheses(motion)
        if isinstance(each, SpringHypothesis) and each.joints == (FIRST, SECOND)
    )  # fmt: skip
    theta = np.array([0.05, -0.01])
    model, why = extended(motion, [(hypothesis, theta)])
    assert why == ("",)
    wanted = hypothesis.regressor(motion) @ theta
    np.testing.assert_allclose(motion.torque_at(motion.q, model) - motion.modelled, wanted,
                               atol=1e-9)  # fmt: skip


def test_springs_are_supposed_between_a_joint_and_the_next_two_only():
    world = World.draw(5, step=COARSE)
    motion = load([world.record(1, 2, duration=10.0)], world.model()).motion
    away = [second - first for first, second in
            (hypothesis.joints for hypothesis in JointSpring.hypotheses(motion))]  # fmt: skip
    assert set(away) == {1, 2}
    assert len(away) == 2 * (6 + 5)
