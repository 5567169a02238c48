"""Motion that repeats, causes that a recording cannot tell apart, and the real recordings."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from recording_samples import shared_data

from dvrk_gravity import diagnose, identify
from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS
from dvrk_gravity.command_line import run
from dvrk_gravity.diagnosis import FilteredData, load
from dvrk_gravity.estimation import Repetition, find_common_time, find_repetition, repetition_noise
from dvrk_gravity.model import KINEMATIC, identified
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import SimulatedArm, record_motion
from testing.hide import hide
from testing.world import COARSE, World

pytestmark = pytest.mark.usefixtures("brief_simulation")

KNOWN = World.draw(5, step=COARSE)
PERIOD = 10.0
MOTION = "mtm_dynamic_30s_200hz.csv"


@pytest.fixture(scope="module")
def periodic() -> Recording:
    """25 s of an arm that repeats a motion of 10 s."""
    drawn = Multisine.draw(KNOWN.arm, 3)
    motion = replace(drawn, frequency=np.round(drawn.frequency * PERIOD) / PERIOD)
    return record_motion(
        SimulatedArm(KNOWN.plant(), KNOWN.sensors, 4, dt=COARSE), motion, 25.0, 100.0
    )


def test_what_differs_between_periods_is_the_noise_whatever_repeats():
    random = np.random.default_rng(0)
    time = np.arange(1200) / 40.0
    wave = np.sin(2.0 * np.pi * time / 11.665)[:, None] * np.linspace(0.1, 1.0, N_JOINTS)
    level = np.linspace(0.001, 0.05, N_JOINTS)
    # Smooth over a few samples, as everything is that has been through a low-pass.
    noise = np.apply_along_axis(
        np.convolve, 0, random.normal(size=(1206, N_JOINTS)), np.hanning(9), "same"
    )[3:-3]
    noise *= level / noise.std(axis=0)

    found = repetition_noise(
        Repetition(11.665, 2.57), time, wave + noise, np.ones(wave.shape, dtype=bool)
    )

    np.testing.assert_allclose(found, level, rtol=0.15)


def test_too_little_seen_twice_is_no_floor():
    time = np.arange(440) / 40.0

    found = repetition_noise(
        Repetition(10.0, 1.1), time, np.ones((440, 7)), np.ones((440, 7), dtype=bool)
    )

    assert np.isnan(found).all()


@pytest.mark.parametrize("missed", [1.0, 0.37], ids=["a period", "some of a period"])
def test_the_period_is_found_across_a_gap_and_phases_agree_on_either_side(missed):
    time = np.arange(5000) / 200.0
    phase = np.outer(2.0 * np.pi * time / PERIOD, [1.0, 2.0, 3.0, 1.0, 2.0, 1.0, 4.0])
    q = np.sin(phase + np.arange(7))
    part = (np.arange(5000) >= 3200).astype(np.int64)

    seen = find_common_time(time + part * missed * PERIOD, part, q, 200.0, [0, 0])
    found = find_repetition(seen, part, q, 200.0)

    assert found is not None
    repetition, common = found
    assert repetition.period == pytest.approx(PERIOD, abs=0.01)
    assert (np.diff(common) > 0.0).all()
    off = (repetition.phase(common) - time / PERIOD + 0.5) % 1.0 - 0.5
    np.testing.assert_allclose(off, 0.0, atol=1e-3)


def test_a_floor_of_repetition_is_no_less_than_the_steps_of_the_efforts_leave():
    """A motion without noise, read in steps of an effort, comes back to the same steps."""
    drawn = Multisine.draw(KNOWN.arm, 3)
    motion = replace(drawn, frequency=np.round(drawn.frequency * PERIOD) / PERIOD)
    time = np.arange(5000) / 200.0
    q, qd = motion.at(time + motion.ramp)
    exact = KNOWN.model().torque(q, qd)
    step = np.array([0.1, 0.1, 0.1, 0.02, 0.01, 0.01, 0.005])
    read = step * np.round(exact / step)
    data = FilteredData.of(load([Recording(JOINT_NAMES, time, q, qd, read)], KNOWN.model()).motion)
    unknown = np.full(N_JOINTS, np.nan)

    assert data.repetition is not None
    bearing = slice(1, 6)  # the others bear no weight: what is always the same has no steps
    floor = data.noise_rms(unknown)[bearing]
    step = step[bearing]
    # White up to 100 Hz, of which the band lets through somewhat less than 8 Hz.
    np.testing.assert_allclose(floor, step / np.sqrt(12.0) * np.sqrt(8.0 / 100.0), rtol=0.1)
    # It is about what rounding did to the torque, at least.
    assert (floor < 1.2 * np.std(data.reduce(read - exact), axis=0)[bearing]).all()
    repeated = replace(data, motion=replace(data.motion, rounding=np.zeros(N_JOINTS)))
    assert (repeated.noise_rms(unknown)[bearing] < 0.2 * floor).all()


def test_no_held_out_phase_is_seen_in_another_period(periodic):
    data = FilteredData.of(load([periodic], KNOWN.model()).motion)

    assert data.repetition is not None
    # Same phase, other period: both held out or neither.
    phase = np.round(data.time % PERIOD, 3)
    seen = set(phase[data.fold >= 0])
    assert data.held_out.sum() > 100
    assert not seen & set(phase[data.held_out])
    copies = [np.sum(phase[data.held_out] == value) for value in np.unique(phase[data.held_out])]
    assert max(copies) > 1


def test_a_known_model_of_a_repeated_motion_stands_at_its_floor(periodic):
    result = diagnose(periodic, KNOWN.model())

    assert result.verdict == "nothing_to_explain"
    assert result.floor_from == "repetition"
    for joint in JOINT_NAMES:
        assert 0.5 < result.after[joint] / result.floor[joint] < 2.0, joint


def test_a_motion_that_does_not_repeat_says_where_its_floor_comes_from():
    result = diagnose(KNOWN.record(3, 4, 12.0, 100.0), KNOWN.model())

    assert result.floor_from == "high_frequencies"


def test_wrong_coordinates_are_found_before_what_else_is_wrong():
    world, _ = hide(KNOWN, "viscous_friction", np.random.default_rng(2))
    right = world.record(3, 4, 14.0, 100.0)
    back = KNOWN.arm.joint_to_actuator
    motors = replace(
        right,
        position=right.position @ back.T,
        velocity=right.velocity @ back.T,
        effort=KNOWN.arm.actuator_effort(right.effort),
    )

    first, second, *_ = diagnose(motors, KNOWN.model()).findings

    assert (first.effect, second.effect) == ("wrong_coordinates", "viscous_friction")
    assert first.remedy.startswith("pass --coordinates actuator; or use the extended model")


def _poses(moving: tuple[int, ...]) -> Recording:
    """Return 200 poses of an arm of which some joints move."""
    random = np.random.default_rng(1)
    model, arm = KNOWN.model(), KNOWN.arm
    q = np.tile(np.clip(0.0, arm.lower, arm.upper), (200, 1))
    low, high = np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0)
    q[:, moving] = random.uniform(low, high, (200, N_JOINTS))[:, moving]
    effort = model.torque(q) + 0.002 * random.normal(size=q.shape)
    return Recording(JOINT_NAMES, None, q, None, effort, source="poses")


def _without_last(recording: Recording) -> Recording:
    """Return a recording of the first six joints."""
    assert recording.velocity is not None
    assert recording.effort is not None
    return replace(
        recording,
        joints=JOINT_NAMES[:6],
        position=recording.position[:, :6],
        velocity=recording.velocity[:, :6],
        effort=recording.effort[:, :6],
    )


def _tilt_and_shoulder(result) -> list[str]:
    return [
        ambiguity.sentence
        for ambiguity in result.ambiguities
        if {ambiguity.first.effect, ambiguity.second.effect} == {"joint_offset", "base_tilt"}
        and "shoulder_pitch" in (*ambiguity.first.joints, *ambiguity.second.joints)
    ]


def test_a_tilt_and_the_shoulders_zero_are_alike_in_a_plane_and_apart_in_space():
    flat = diagnose(_poses((1, 2, 4)), KNOWN.model())
    full = diagnose(_poses(tuple(range(N_JOINTS))), KNOWN.model())

    (sentence,) = _tilt_and_shoulder(flat)
    assert "mN·m" in sentence
    assert "held still at" in sentence
    assert "no sign of either" in sentence
    assert not _tilt_and_shoulder(full)


def test_what_there_is_no_sign_of_is_no_task_for_a_plan():
    """Also not where nothing else was found; a sign of one makes it a task."""
    poses = _poses((1, 2, 4))
    off = poses.position + np.radians([0.0, 0.09, 0.0, 0.0, 0.0, 0.0, 0.0])
    for position, asked in ((poses.position, False), (off, True)):
        found = diagnose(replace(poses, position=position), KNOWN.model()).to_dict()
        assert bool(found["unseparated"]["pairs"]) == asked
        assert bool(found["next"]) <= asked
        (both,) = [
            each
            for each in found["ambiguities"]
            if {"joint_offset", "base_tilt"} == {cause["effect"] for cause in each["between"]}
            and "shoulder_pitch" in each["between"][0]["joints"] + each["between"][1]["joints"]
        ]
        assert both["suspected"] == asked


def test_of_two_that_are_alike_sizes_are_told_where_there_is_a_sign_of_them():
    poses = _poses((1, 2, 4))
    off = poses.position + np.radians([0.0, 0.09, 0.0, 0.0, 0.0, 0.0, 0.0])

    (sentence,) = _tilt_and_shoulder(diagnose(replace(poses, position=off), KNOWN.model()))

    assert "offset 0.09" in sentence
    assert "no sign" not in sentence


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: r.between(0.0, 5.0), "at least 8 s"),
        (lambda r: replace(r, position=np.zeros_like(r.position)), "no joint moves"),
        (_without_last, "has no wrist_roll"),
    ],
    ids=["short", "no motion", "a joint missing"],
)
def test_what_is_missing_is_said_in_one_line_with_status_2(
    periodic, tmp_path, capsys, change, words
):
    KNOWN.model().save(tmp_path / "model.yaml")
    change(periodic).save(tmp_path / "bad.csv")

    arguments = [str(tmp_path / "bad.csv"), "--model", str(tmp_path / "model.yaml")]
    status = run("dvrk_gravity.cli.diagnose", [*arguments, "--out", str(tmp_path / "out")])

    assert status == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def measured():
    return Recording.load(shared_data(MOTION), coordinates="actuator")


@pytest.fixture(scope="module")
def good(measured):
    """Return a model with all terms; its base is tilted."""
    return identify([measured], KNOWN.arm, "actuator").model


def _nothing_but_the_yaw(result) -> None:
    assert result.floor_from == "repetition"
    assert not [finding for finding in result.findings if finding.effect != "unknown"]
    told = {joint for finding in result.findings for joint in finding.joints}
    assert told <= {"wrist_yaw"}  # its noise floor is 0.6 mN·m
    assert all(result.after[j] < 2.5 * result.floor[j] for j in JOINT_NAMES if j not in told)
    assert json.loads(result.to_json())["ambiguities"]


@pytest.mark.slow
def test_a_good_model_of_the_real_motion_has_nothing_to_explain_but_an_ambiguity(measured):
    level = [effect for effect in identified(KNOWN.arm) if effect not in KINEMATIC]
    result = diagnose(measured, identify([measured], KNOWN.arm, "actuator", level).model)

    _nothing_but_the_yaw(result)
    assert _tilt_and_shoulder(result)


@pytest.mark.slow
def test_once_the_real_arms_base_is_tilted_outer_yaws_zero_looks_like_more_of_it(measured, good):
    result = diagnose(measured, good)

    _nothing_but_the_yaw(result)
    pairs = [
        ({ambiguity.first.effect, ambiguity.second.effect}, ambiguity.first.joints)
        for ambiguity in result.ambiguities
    ]
    assert ({"joint_offset", "base_tilt"}, ("outer_yaw",)) in pairs


@pytest.mark.slow
def test_the_real_motion_read_as_joint_coordinates_is_read_wrongly(measured, good):
    result = diagnose(replace(measured, coordinates="joint"), good)

    assert result.findings[0].effect == "wrong_coordinates"
    assert "actuator coordinates" in result.findings[0].sentence


@pytest.mark.slow
def test_from_the_rigid_body_alone_the_real_arms_friction_and_spring_are_named():
    recording = Recording.load(shared_data(MOTION), coordinates="actuator")
    rigid = identify([recording], KNOWN.arm, "actuator", ("gravity", "link_inertia")).model
    sweep = shared_data("mtm_wrist_platform_sweep_200hz.csv")

    def named(result) -> set[tuple[str, str, bool]]:
        return {
            (finding.effect, finding.joints[0], finding.place == "motor")
            for finding in result.findings
            if finding.joints
        }

    motion = named(diagnose(recording, rigid))
    still = dict.fromkeys(JOINT_NAMES, 0.0) | {"shoulder_pitch": 0.044, "elbow_pitch": 0.044}
    # Where the motion has not been, nobody knows the cable: the rigid body is taken as exact.
    exact = replace(rigid, uncertainty=None)
    alone = named(diagnose(Recording.load(sweep, coordinates="actuator"), exact, still=still))

    assert ("elastic_cable", "wrist_pitch", False) in motion
    assert motion & {
        ("coulomb_friction", "elbow_pitch", True),
        ("presliding_hysteresis", "elbow_pitch", True),
    }
    assert {finding for finding in motion if finding[:2] == ("coulomb_friction", "wrist_platform")}
    assert ("presliding_hysteresis", "wrist_platform", False) in alone
    assert ("elastic_cable", "wrist_platform", False) in alone
    assert not [
        finding for finding in (*motion, *alone) if finding[0] in ("contact", "joint_coupling")
    ]
