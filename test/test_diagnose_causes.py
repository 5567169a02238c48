"""What is no effect must not pass for one: filters, noise, encoders, turning back, weights unseen.

The motions are given, and the efforts are the model's own torques: nothing is simulated.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy import signal

from dvrk_gravity import TorqueModel, diagnose, gravity
from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS
from dvrk_gravity.diagnosis import (
    UNREAD,
    CrossValidation,
    FilteredData,
    HeldOut,
    MeasuredMotion,
    load,
    try_readings,
)
from dvrk_gravity.effects import Gravity, TimeDelay
from dvrk_gravity.recording import Recording, check, prepare
from dvrk_gravity.report import diagnosis_page
from testing.world import World

MODEL = World.draw(5).model()
ARM = MODEL.arm
RATE = 200.0  # Hz
NOISE = np.array([0.02, 0.02, 0.02, 0.006, 0.003, 0.003, 0.001])  # N·m
HALF = np.array([0.4, 0.3, 0.3, 1.0, 0.8, 0.4, 1.0])  # rad, of the motions


def sines(
    duration: float, seed: int = 0, fastest: float = 0.6, rate: float = RATE
) -> tuple[np.ndarray, ...]:
    """Return (N,) times and (N, 7) positions, velocities and accelerations."""
    random = np.random.default_rng(seed)
    time = np.arange(int(duration * rate)) / rate
    middle = np.clip(0.5 * (ARM.lower + ARM.upper), -1.0, 1.0)
    q, qd, qdd = np.tile(middle, (len(time), 1)), *np.zeros((2, len(time), N_JOINTS))
    for frequencies in random.uniform(0.1, fastest, (2, N_JOINTS)):
        omega, phase = 2.0 * np.pi * frequencies, random.uniform(0.0, 6.0, N_JOINTS)
        angle = time[:, None] * omega + phase
        q += 0.5 * HALF * np.sin(angle)
        qd += 0.5 * HALF * omega * np.cos(angle)
        qdd -= 0.5 * HALF * omega**2 * np.sin(angle)
    return time, q, qd, qdd


def recording(time, q, effort, velocity=None, joints=JOINT_NAMES, **more) -> Recording:
    more.setdefault("arm", MODEL.arm)
    return Recording(joints=joints, time=time, position=q, velocity=velocity, effort=effort, **more)


def noise(count: int, seed: int = 1) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).normal(size=(count, N_JOINTS))


def test_a_velocity_that_a_filter_made_late_is_not_used():
    time, q, qd, qdd = sines(20.0)
    late = signal.sosfilt(signal.butter(1, 25.0, fs=RATE, output="sos"), qd - qd[0], axis=0) + qd[0]
    effort = MODEL.torque(q, qd, qdd)

    used = prepare(recording(time, q, effort, velocity=qd), 20.0)
    not_used = prepare(recording(time, q, effort, velocity=late), 20.0)

    assert not any("differentiated" in line for line in used.handling)
    assert any(f"position: {', '.join(JOINT_NAMES)}" in line for line in not_used.handling)


def test_noise_that_is_not_white_is_nothing_to_explain():
    time, q, qd, qdd = sines(20.0)
    pole = np.exp(-2.0 * np.pi * 4.0 / RATE)
    coloured = signal.lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], noise(len(q)), axis=0)
    coloured = 0.75 * coloured + 0.65 * noise(len(q), 2)

    result = diagnose(recording(time, q, MODEL.torque(q, qd, qdd) + coloured), MODEL)

    assert max(result.after[joint] / result.floor[joint] for joint in JOINT_NAMES) > 2.5
    assert result.verdict == "nothing_to_explain"


def test_a_slow_torque_without_a_cause_is_unknown():
    time, q, qd, qdd = sines(12.0, rate=100.0)
    slow = noise(len(q))
    slow[:, 1] += 0.1 * np.sin(2.0 * np.pi * 0.9 * time + 3.0 * np.sin(0.7 * time))

    result = diagnose(recording(time, q, MODEL.torque(q, qd, qdd) + slow), MODEL)

    assert {(finding.effect, finding.joints) for finding in result.findings} == {
        ("unknown", ("shoulder_pitch",))
    }


def test_noise_makes_no_delay_smaller():
    time, q, qd, qdd = sines(12.0, fastest=0.3, rate=100.0)
    delay = 0.05
    torque = MODEL.torque(q, qd, qdd)
    late = np.stack([np.interp(time - delay, time, column) for column in torque.T], axis=1)

    result = diagnose(recording(time, q, late + 2.0 * noise(len(q))), MODEL)

    (finding,) = result.findings
    assert finding.effect == "time_delay"
    assert finding.parameters["delay"].value == pytest.approx(delay, rel=0.1)


def test_a_tilted_base_shows_what_its_first_link_weighs():
    weight = MODEL.term(Gravity.NAME)
    assert isinstance(weight, Gravity)
    roll, pitch = 0.04, -0.03
    down = pin.rpy.rpyToMatrix(roll, pitch, 0.0).T @ weight.vector
    beta = np.pad(weight.beta, (0, 14 - len(weight.beta)))
    beta[12:] = (0.5, 0.4)  # N·m, of link 1, which no model of a level base can know
    random = np.random.default_rng(2)
    q = 0.5 * (ARM.lower + ARM.upper) + HALF * random.uniform(-1.0, 1.0, (120, N_JOINTS))
    still = replace(MODEL, terms=(replace(weight, beta=weight.beta[:12]),))
    effort = gravity.torque(q, beta, down) + 0.2 * noise(len(q))

    result = diagnose(recording(None, q, effort), still)

    (finding,) = result.findings
    assert finding.effect == "base_tilt"
    for name, true in (("roll", roll), ("pitch", pitch)):
        assert finding.parameters[name].low <= true <= finding.parameters[name].high
    assert np.abs(result.model.torque(q) - effort).max() < 0.05


def test_poses_of_one_angle_show_friction_if_approached_from_both_sides():
    random = np.random.default_rng(3)
    q = 0.5 * (ARM.lower + ARM.upper) + HALF * random.uniform(-1.0, 1.0, (90, N_JOINTS))
    q[:, 0] = 0.1
    side = np.where(random.random(q.shape) < 0.5, -1.0, 1.0)
    rubs = np.zeros(N_JOINTS)
    rubs[0] = 0.05
    effort = MODEL.torque(q, direction=side) + rubs * side + 0.5 * noise(len(q))

    result = diagnose(recording(None, q, effort, direction=side), MODEL)

    assert "coulomb_friction" in {
        claim.effect for finding in result.findings for claim in (finding, *finding.alternatives)
    }
    assert all(finding.joints == ("outer_yaw",) for finding in result.findings)


def test_where_a_motor_turns_back_the_joints_that_it_moves_say_nothing():
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    q = np.zeros((len(time), N_JOINTS))
    q[:, 1], q[:, 2] = 0.5 * time, -0.2 * np.sin(time) - 0.5 * time + 0.1 * time
    q[:, 0] = 0.3 * time
    qd = np.gradient(q, 1.0 / RATE, axis=0)
    motor = qd[:, 1] + qd[:, 2]
    nothing = np.zeros_like(q)

    motion = MeasuredMotion(MODEL, q, qd, nothing, nothing, None, time, (slice(0, len(q)),), RATE,
                    np.ones(7, dtype=bool), np.zeros(7))  # fmt: skip

    turning = np.flatnonzero(np.diff(np.sign(motor)))
    assert len(turning) > 1
    assert motion.stuck[turning][:, [1, 2]].all()
    assert not motion.stuck[turning - int(RATE), 1].any()
    assert not motion.stuck[:, 0].any()


def held_by_stiction(held: np.ndarray) -> Recording:
    """Record a motion of all joints but the last two, whose friction takes a part of their load."""
    time, q, qd, qdd = sines(12.0, rate=100.0)
    q[:, 5:] = q[0, 5:]
    qd[:, 5:] = qdd[:, 5:] = 0.0
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    effort[:, 5:] += held
    seen = q + 1e-5 * np.random.default_rng(3).normal(size=q.shape)
    return recording(time, seen, effort)


@pytest.mark.parametrize("held", [(0.02, -0.03), (0.1, 0.1)])
def test_torque_that_friction_holds_at_a_joint_that_stands_still_is_no_finding(held):
    result = diagnose(held_by_stiction(np.array(held)), MODEL)

    assert result.verdict == "nothing_to_explain"
    assert np.isnan([result.before[joint] for joint in JOINT_NAMES[5:]]).all()
    assert json.loads(result.to_json())["rmse"]["after"][JOINT_NAMES[6]] is None
    (line,) = [note for note in result.notes if note.startswith("not judged")]
    assert ", ".join(JOINT_NAMES[5:]) in line
    assert "unknown" in diagnosis_page(result, ["motion.csv"])


def test_a_joint_that_stands_still_bears_its_load_where_nothing_rubs_and_at_poses():
    arm = replace(ARM, frictionless=(JOINT_NAMES[6],))
    standing = held_by_stiction(np.zeros(2))
    moving = load([standing], MODEL).motion
    smooth = load([replace(standing, arm=arm)], replace(MODEL, arm=arm)).motion
    poses = load([replace(standing, time=None, velocity=None)], MODEL).motion

    np.testing.assert_array_equal(moving.stuck.all(axis=0), [False] * 5 + [True] * 2)
    assert not smooth.stuck[:, 6].any()
    assert not poses.stuck.any()


def test_a_load_is_told_by_the_joints_that_move_and_not_of_those_that_stand_still():
    time, q, qd, qdd = sines(12.0, rate=100.0)
    q[:, 3:] = q[0, 3:]
    qd[:, 3:] = qdd[:, 3:] = 0.0
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    effort += 2.0 * q[:, [1]] * np.array([0.0, 1.0, 0.0, 0.3, 0.0, 0.0, 0.0])

    result = diagnose(recording(time, q, effort), MODEL)

    (finding,) = result.findings
    assert finding.joints == ("shoulder_pitch",)
    assert "more joint" not in finding.sentence


def test_an_effort_that_is_no_longer_read_is_no_finding_and_left_out():
    time, q, qd, qdd = sines(20.0, rate=100.0)
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    effort[800:, 3] = effort[800, 3]

    result = diagnose(recording(time, q, effort), MODEL)

    assert result.verdict == "nothing_to_explain"
    (told,) = result.warnings
    assert (told.kind, told.joint) == ("effort_frozen", JOINT_NAMES[3])
    assert UNREAD in result.notes
    assert result.after[JOINT_NAMES[3]] < 2.0 * result.floor[JOINT_NAMES[3]]


def test_a_motor_that_is_not_read_leaves_open_every_joint_that_it_moves():
    time, q, qd, qdd = sines(20.0, rate=100.0)
    effort = ARM.actuator_effort(MODEL.torque(q, qd, qdd) + noise(len(q)))
    effort[800:1200, 2] = effort[800, 2]
    read = recording(time, ARM.actuator_position(q), effort, coordinates="actuator")
    motion = load([read], MODEL).motion
    felt = ARM.joint_effort(np.eye(N_JOINTS))[2] != 0.0

    np.testing.assert_array_equal(motion.unread.any(axis=0), felt)
    inside = (motion.time > 8.0) & (motion.time < 11.9)
    assert motion.unread[inside][:, felt].all()
    assert not motion.unread[(motion.time < 7.9) | (motion.time > 12.1)].any()


def test_a_coarse_encoder_does_not_show_the_direction_of_slow_motion():
    time, q, qd, qdd = sines(20.0)

    effort = MODEL.torque(q, qd, qdd)

    def motion(step: float) -> MeasuredMotion:
        return load([recording(time, np.round(q / step) * step, effort)], MODEL).motion

    coarse, fine = motion(0.004), motion(0.0001)

    np.testing.assert_allclose(coarse.step, 0.004, rtol=1e-6)
    assert coarse.stuck[:, 5].mean() > fine.stuck[:, 5].mean() + 0.05
    # Of motion that is fast beside its steps it shows it as well.
    assert coarse.stuck[:, 3].mean() < fine.stuck[:, 3].mean() + 0.05


@pytest.mark.parametrize(
    "start", [6.5, *(pytest.param(start, marks=pytest.mark.slow) for start in (6.0, 7.0))]
)
def test_a_push_is_found_wherever_its_edges_lie_among_the_blocks(start):
    time, q, qd, qdd = sines(12.0, rate=100.0)
    pushed = MODEL.torque(q, qd, qdd) + 0.5 * noise(len(q))
    inside = (time > start) & (time < start + 2.2)
    pushed[inside, 1] += 0.1

    result = diagnose(recording(time, q, pushed), MODEL)

    (finding,) = result.findings
    assert (finding.effect, finding.joints) == ("contact", ("shoulder_pitch",))
    for name, true in (("start", start), ("end", start + 2.2)):
        found = finding.parameters[name]
        assert found.low <= true <= found.high or found.value == pytest.approx(true, abs=0.1)


def test_drift_is_found_in_a_recording_whose_stamps_count_from_1970():
    time, q, qd, qdd = sines(20.0, rate=100.0)
    warming = MODEL.torque(q, qd, qdd) + 0.5 * noise(len(q))
    warming[:, 1] += 0.1 * (1.0 - np.exp(-time / 8.0))

    result = diagnose(recording(time + 1.7e9, q, warming), MODEL)

    (finding,) = result.findings
    assert (finding.effect, finding.joints) == ("thermal_drift", ("shoulder_pitch",))
    assert finding.parameters["torque"].value == pytest.approx(0.1, rel=0.2)


def test_a_wrong_sign_is_seen_although_the_joint_is_held_half_the_time():
    time, q, qd, qdd = sines(30.0)
    held = (time // 4.0) % 2 == 0.0
    # What the joint bears, and bears the other way round half the time, where friction holds it.
    effort = MODEL.torque(q, qd, qdd) + 0.5 * noise(len(q))
    effort[~held, 1] *= -1.0
    motion = load([recording(time, q, effort)], MODEL).motion
    plain = replace(motion, qd=np.where(held[: len(motion.q), None], 0.0, motion.qd))

    best = try_readings(plain)[0]

    assert best.reading.words == "the effort of shoulder_pitch has the wrong sign"
    assert best.passes


def test_exchanged_joints_are_not_taken_for_wrong_units():
    time, q, qd, qdd = sines(12.0)
    effort = MODEL.torque(q, qd, qdd)
    effort[:, 1] *= 1.2 / np.abs(effort[:, 1]).max()
    order = [0, 5, 2, 3, 4, 1, 6]

    exchanged = check(recording(time, q[:, order], effort[:, order]))
    further = q.copy()
    further[:, 6] *= 4.0 / np.abs(q[:, 6]).max()
    with_roll = check(recording(time, further[:, [0, 1, 2, 3, 4, 6, 5]], effort))
    milli = check(recording(time, q, 1e3 * effort))

    assert np.abs(effort[:, 1]).max() > 10.0 * 0.097
    assert not [warning for warning in exchanged if warning.kind == "effort_unit"]
    assert [w.joint for w in with_roll if w.kind == "exchanged_joints"] == ["wrist_yaw"]
    assert not [warning for warning in with_roll if warning.unusable]
    assert [warning for warning in milli if warning.kind == "effort_unit"]


@pytest.mark.parametrize(
    "exchanged", ["positions", pytest.param("efforts", marks=pytest.mark.slow)]
)
def test_two_joints_exchanged_in_one_quantity_alone_are_told(exchanged):
    time, q, qd, qdd = sines(12.0, rate=100.0)
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    order = [0, 1, 2, 5, 4, 3, 6]
    read = {
        "positions": recording(time, q[:, order], effort),
        "efforts": recording(time, q, effort[:, order]),
    }

    first, *others = diagnose(read[exchanged], MODEL).findings

    assert first.effect == "wrong_coordinates"
    assert f"the {exchanged} of wrist_platform and wrist_yaw are exchanged" in first.sentence
    assert not others


@pytest.mark.parametrize(
    ("turned", "told"),
    [pytest.param([2, 4], ["the effort of elbow_pitch has", "the effort of wrist_pitch has"],
                  marks=pytest.mark.slow),
     (range(7), ["the efforts of all joints have"])],
)  # fmt: skip
def test_wrong_signs_of_several_joints_are_told_each_or_as_one(turned, told):
    time, q, qd, qdd = sines(12.0, rate=100.0)
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    effort[:, turned] *= -1.0

    findings = diagnose(recording(time, q, effort), MODEL).findings

    assert {finding.place for finding in findings} == {f"{words} the wrong sign" for words in told}


@pytest.mark.parametrize(("what", "motor"), [
    ("effort", "shoulder_pitch"),
    pytest.param("effort", "elbow_pitch", marks=pytest.mark.slow),
    pytest.param("position", "elbow_pitch", marks=pytest.mark.slow),
])  # fmt: skip
def test_a_motor_s_column_of_the_wrong_sign_is_told_where_motors_move_joints_together(what, motor):
    time, q, qd, qdd = sines(12.0, rate=100.0)
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    arm, column = MODEL.arm, JOINT_NAMES.index(motor)
    motors = {"q": arm.actuator_position(q), "effort": effort @ arm.actuator_to_joint}
    motors["q" if what == "position" else what][:, column] *= -1.0

    read = recording(time, **motors, coordinates="actuator")
    (found,) = diagnose(read, MODEL).findings

    assert found.place == f"the {what} of {motor}'s motor has the wrong sign"


@pytest.mark.slow
def test_positions_of_three_joints_exchanged_are_told_as_two_exchanges():
    time, q, qd, qdd = sines(12.0)
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))

    diagnosis = diagnose(recording(time, q[:, [0, 1, 2, 5, 3, 4, 6]], effort), MODEL)

    assert [finding.effect for finding in diagnosis.findings] == 2 * ["wrong_coordinates"]
    assert all("the positions of" in finding.place for finding in diagnosis.findings)
    assert all(finding.gain.relative > 0.5 for finding in diagnosis.findings)


def test_motors_read_as_joints_are_warned_of_beside_a_reference_which_is_read_alike():
    time, q, qd, qdd = sines(12.0, rate=100.0)
    position = q @ ARM.joint_to_actuator.T
    effort = MODEL.torque(q, qd, qdd) @ ARM.actuator_to_joint
    bare, again = (recording(time, position, effort + noise(len(q), seed)) for seed in (1, 2))

    found = diagnose(again, arm=ARM, reference=bare)

    assert [warning.kind for warning in found.warnings].count("coordinates") == 1


def test_the_noise_of_the_joints_is_the_same_however_it_was_recorded():
    time, q, qd, qdd = sines(12.0)
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    there = recording(
        time, q @ ARM.joint_to_actuator.T, effort @ ARM.actuator_to_joint, coordinates="actuator"
    )

    here = load([recording(time, q, effort)], MODEL)

    np.testing.assert_allclose(load([there], MODEL).floor, here.floor, rtol=1e-6)
    np.testing.assert_allclose(here.floor, NOISE / np.sqrt(RATE / 2.0), rtol=0.15)


def test_the_model_of_these_tests_has_all_that_they_need():
    assert isinstance(MODEL, TorqueModel)
    assert {"gravity", "coulomb_friction"} <= {term.NAME for term in MODEL.terms}


def test_the_noise_of_joints_that_were_not_recorded_is_not_known():
    time, q, qd, qdd = sines(12.0)
    recorded = list(JOINT_NAMES[1:5])
    effort = MODEL.torque(q, qd, qdd) + noise(len(q))
    part = recording(time, q[:, 1:5], effort[:, 1:5], joints=tuple(recorded))
    still = {joint: 0.0 for joint in JOINT_NAMES if joint not in recorded}

    floor = load([part], MODEL, still).floor

    assert np.isfinite(floor).tolist() == [joint in recorded for joint in JOINT_NAMES]


@pytest.mark.parametrize("late", ["all", "friction"])
def test_friction_alone_that_is_late_is_no_delay_of_the_efforts(late):
    """What comes on over a way is late where a joint turns back; weight and inertia are not."""
    time, q, qd, qdd = sines(20.0, fastest=1.0)
    rubbing = np.full(N_JOINTS, 5.0)  # times what it is: as in the instrument of a PSM
    terms = [term.scaled(rubbing) if term.FRICTION else term for term in MODEL.terms]
    model = replace(MODEL, terms=tuple(terms))
    frictionless = tuple(term for term in terms if not term.FRICTION)
    whole = model.torque(q, qd, qdd)
    rest = replace(model, terms=frictionless).torque(q, qd, qdd)
    steps = round(0.08 * RATE)
    effort = whole if late == "all" else whole - rest
    effort = np.concatenate([effort[:1].repeat(steps, axis=0), effort[:-steps]])
    effort = effort if late == "all" else rest + effort

    motion = load([recording(time, q, effort + noise(len(q)), velocity=qd)], model).motion
    data = FilteredData.of(motion)
    claim = next(TimeDelay.hypotheses(motion))
    candidate = data.candidate(replace(claim, setting={"delay": 0.08}))
    validation = CrossValidation.of(data).weighted([candidate], final=True)

    gain = validation.score([candidate]).likelihood - validation.score([]).likelihood
    assert gain > 100.0  # as if all were late
    failed = HeldOut(validation).unconfirmed([candidate])
    assert [failure.partial for failure, _ in failed] == ([] if late == "all" else [True])
