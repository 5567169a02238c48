"""Where nothing is wrong nothing is named; what is outside the vocabulary is unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed import (
    ARM,
    HALF,
    INSERTION,
    MIDDLE,
    NOISE,
    PITCH,
    RATE,
    ROLL,
    YAW,
    Motion,
    claims,
    clean,
    eye,
    model,
    moving,
    named,
    of_poses,
    only,
    poses,
    recorded,
)
from scipy import signal

from dvrk_gravity import effects
from dvrk_gravity.diagnosis import Diagnosis, FilteredData, diagnose, load
from dvrk_gravity.recording import Recording


def quiet(diagnosis: Diagnosis) -> None:
    """Require that nothing is named, and that what is left is about as large as noise."""
    assert diagnosis.verdict == "nothing_to_explain", diagnosis
    assert diagnosis.findings == ()
    assert diagnosis.sentence


# Nothing is there.
def test_an_arm_that_its_model_knows_is_quiet():
    diagnosis = diagnose(recorded(), model())

    quiet(diagnosis)
    for joint, floor in diagnosis.floor.items():
        assert 0.5 < diagnosis.after[joint] / floor < 2.5, joint


def test_another_motion_of_an_identified_arm_is_quiet_and_errs_as_the_model_expects():
    diagnosis = clean(3)

    quiet(diagnosis)
    for joint, after in diagnosis.after.items():
        assert after < 2.5 * diagnosis.expected[joint], joint
    # Of what is no finding every joint is told what the model expects.
    assert {known.joints for known in diagnosis.known} >= {(joint,) for joint in diagnosis.after}


def test_so_are_static_poses():
    q = poses()
    quiet(diagnose(of_poses(q, model().torque(q)), model()))


def test_noise_that_is_not_white_is_nothing_to_explain():
    motion, random = moving(0, 20.0), np.random.default_rng(1)
    pole = np.exp(-2.0 * np.pi * 4.0 / RATE)
    white = NOISE * random.normal(size=motion.q.shape)
    coloured = signal.lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white, axis=0)

    diagnosis = diagnose(motion.read(motion.torque() + 3.0 * coloured), model())

    assert max(diagnosis.after[j] / diagnosis.floor[j] for j in ARM.joint_names) > 2.5
    quiet(diagnosis)


def test_a_motion_that_repeats_shows_its_noise_by_that_and_stands_at_that_floor():
    motion = moving(0, 25.0)
    turns = 2.0 * np.pi * np.outer(motion.time, [0.2, 0.4, 0.3, 0.5])
    q, qd, qdd = MIDDLE + HALF * np.sin(turns), *np.zeros((2, *turns.shape))
    rates = 2.0 * np.pi * np.array([0.2, 0.4, 0.3, 0.5])
    qd, qdd = HALF * rates * np.cos(turns), -HALF * rates**2 * np.sin(turns)
    periodic = replace(motion, q=q, qd=qd, qdd=qdd)

    diagnosis = diagnose(periodic.read(periodic.torque()), model())

    quiet(diagnosis)
    assert diagnosis.floor_from == "repetition"
    assert clean(3).floor_from == "high_frequencies"
    for joint, floor in diagnosis.floor.items():
        assert 0.5 < diagnosis.after[joint] / floor < 2.0, joint


def test_an_effort_that_is_no_longer_read_is_a_warning_and_no_finding():
    effort = recorded(0, 20.0).effort.copy()
    effort[800:, ROLL] = effort[800, ROLL]

    diagnosis = diagnose(replace(recorded(0, 20.0), effort=effort), model())

    quiet(diagnosis)
    (warning,) = diagnosis.warnings
    assert (warning.kind, warning.joint) == ("effort_frozen", "roll")
    assert diagnosis.after["roll"] < 2.5 * diagnosis.floor["roll"]


def held(joint: int, torque: float) -> Recording:
    """Record a motion in which one joint stands still, where friction takes a part of its load."""
    motion, moves = moving(), 1.0 - eye(joint)
    q = np.where(moves > 0.0, motion.q, MIDDLE)
    still = replace(motion, q=q, qd=moves * motion.qd, qdd=moves * motion.qdd)
    seen = q + 1e-5 * np.random.default_rng(3).normal(size=q.shape)
    return still.read(still.torque() + torque * eye(joint), position=seen, velocity=None)


def test_torque_that_friction_holds_at_a_joint_that_stands_still_is_no_finding():
    diagnosis = diagnose(held(ROLL, 0.04), model())

    quiet(diagnosis)
    assert np.isnan(diagnosis.before["roll"])
    assert diagnosis.to_dict()["rmse"]["after"]["roll"] is None


def test_a_joint_that_stands_still_bears_its_load_where_nothing_rubs_and_at_poses():
    standing = held(ROLL, 0.0)
    smooth = replace(ARM, frictionless=("roll",))

    def stuck(recording: Recording, arm) -> list[bool]:
        motion = load([recording], replace(model(), arm=arm))
        return motion.stuck.all(axis=0).tolist()

    assert stuck(standing, ARM) == [False, False, False, True]
    assert stuck(replace(standing, arm=smooth), smooth) == [False] * 4
    assert stuck(replace(standing, time=None, velocity=None), ARM) == [False] * 4


def test_of_a_motor_that_stands_still_no_inertia_is_supposed():
    motion = load([held(ROLL, 0.0)], model())
    rotors = effects.named("rotor_inertia").hypotheses(motion)
    assert [rotor.site.index for rotor in rotors] == [YAW, PITCH, INSERTION]


def test_a_joint_that_slides_is_slow_at_a_tenth_of_the_speed_of_one_that_turns():
    """0.01 rad/s or 1 mm/s, of 31 or 3.1 at most."""
    motion = moving(0, 20.0)
    q, qd, qdd = (
        MIDDLE * (order == 0) + 0.1 * (0.1 * np.pi) ** order * wave[:, None] * ARM.scale
        for order, wave in enumerate(
            np.sin(0.1 * np.pi * motion.time + phase) for phase in (0.0, 0.5 * np.pi, np.pi)
        )
    )
    slow = replace(motion, q=q, qd=qd, qdd=qdd)

    read = load([slow.read(slow.torque())], model())

    for joint, slowest in ((YAW, 0.01), (INSERTION, 0.001)):
        turns = np.abs(read.qd[:, joint]) < slowest
        assert np.mean(read.stuck[:, joint] != turns) < 0.05, joint


# Something is there that has no name.
def slow(motion, joint: int = PITCH, size: float = 0.5) -> np.ndarray:
    """Return a torque that depends on time alone, and comes and goes."""
    wave = np.sin(2.0 * np.pi * 0.9 * motion.time + 3.0 * np.sin(0.7 * motion.time))
    return size * wave[:, None] * eye(joint)


def of_two_positions(motion) -> np.ndarray:
    """Return a force that no energy belongs to."""
    relative = (motion.q - MIDDLE) / HALF
    return (
        0.8
        * (np.sin(2.0 * relative[:, YAW]) * np.sin(2.0 * relative[:, PITCH]))[:, None]
        * eye(PITCH)
    )


@pytest.mark.parametrize("torque", [slow, of_two_positions])
def test_what_has_no_name_is_called_unknown_at_its_joint(torque):
    motion = moving()

    diagnosis = diagnose(motion.read(motion.torque() + torque(motion)), model())

    assert diagnosis.verdict in ("unexplained", "partly_explained")
    assert ("unknown", ("pitch",)) in named(diagnosis)
    assert {finding.effect for finding in diagnosis.findings if finding.certain} <= {"unknown"}


def test_beside_what_has_a_name_it_is_unknown_still():
    motion = moving()
    extra = slow(motion, YAW) + 0.05 * motion.qd[:, [ROLL]] * eye(ROLL)

    diagnosis = diagnose(motion.read(motion.torque() + extra), model())

    assert diagnosis.verdict == "partly_explained"
    assert set(named(diagnosis)) == {("viscous_friction", ("roll",)), ("unknown", ("yaw",))}


def test_a_name_is_not_certain_where_a_smooth_function_explains_what_it_leaves():
    """Drag that differs between the halves of a joint's range is perhaps viscous friction."""
    motion = moving(0, 30.0)
    half = np.sign(motion.q[:, PITCH] - np.median(motion.q[:, PITCH]))
    drag = 0.5 * motion.qd[:, PITCH] * (1.0 + 0.6 * half)

    diagnosis = diagnose(motion.read(motion.torque() + drag[:, None] * eye(PITCH)), model())

    first = diagnosis.findings[0]
    assert (first.effect, first.joints) == ("viscous_friction", ("pitch",))
    assert not first.certain
    assert first.doubt
    assert diagnosis.to_dict()["findings"][0]["certainty"] == "perhaps"


# What acts in no block that is held out.
def burst() -> tuple[Motion, np.ndarray]:
    """Return a motion in which yaw starts up once, where nothing is held out, and where that is."""
    motion, size, width = moving(0, 20.0), 0.25, 0.12
    u = (motion.time - 10.0) / width
    bell, of_yaw = size * np.exp(-0.5 * u**2)[:, None], eye(YAW)
    moved = replace(
        motion,
        q=motion.q + bell * of_yaw,
        qd=motion.qd - u[:, None] / width * bell * of_yaw,
        qdd=motion.qdd + (u**2 - 1.0)[:, None] / width**2 * bell * of_yaw,
    )
    inside = np.abs(u) < 0.4 / width
    blocks = FilteredData.of(load([moved.read(moved.torque())], model()))
    assert not [span for span in blocks.held_out_spans if span[1] > 9.6 and span[0] < 10.4]
    return moved, inside


def test_a_push_that_is_over_before_a_block_is_held_out_is_left_out():
    """A joint that slips once looks so, and does not come back."""
    motion, inside = burst()
    push = 1.0 * inside[:, None] * eye(PITCH)

    diagnosis = diagnose(motion.read(motion.torque() - push), model())

    assert diagnosis.findings == ()
    assert any("contact" in note and "held-out block" in note for note in diagnosis.notes)


def test_an_effort_that_is_clipped_there_alone_is_told_with_that_doubt():
    motion, inside = burst()
    effort = motion.read(motion.torque()).effort.copy()
    limit = 0.2 + np.abs(motion.torque()[~inside, YAW]).max()
    effort[:, YAW] = np.clip(effort[:, YAW], -limit, limit)

    finding = only(diagnose(replace(motion.read(effort), effort=effort), model()))

    assert (finding.effect, finding.joints) == ("effort_saturation", ("yaw",))
    assert not finding.certain
    assert finding.doubt
    assert finding.parameters["limit"].value == pytest.approx(limit, rel=0.05)


# Two that look alike.
def in_a_plane(offset: float, noise: float) -> Diagnosis:
    """Diagnose poses in which yaw stands still, where pitch reads an offset, rad."""
    q = poses(120, 1)
    q[:, YAW] = 0.0
    effort = model().torque(q) + noise * NOISE * np.random.default_rng(5).normal(size=q.shape)
    return diagnose(of_poses(q, effort, position=q + offset * eye(PITCH)), model())


def alike(diagnosis: Diagnosis) -> list:
    """Return the ambiguities between a tilted base and the zero of pitch."""
    return [
        each
        for each in diagnosis.ambiguities
        if {each.first.effect, each.second.effect} == {"base_tilt", "joint_offset"}
        and "pitch" in (*each.first.joints, *each.second.joints)
    ]


def test_a_tilt_and_the_zero_of_a_joint_are_alike_in_a_plane_and_apart_in_space():
    flat, q = in_a_plane(0.0, 0.0), poses(120, 1)

    (both,) = alike(flat)
    assert both.overlap > 0.9
    assert not alike(diagnose(of_poses(q, model().torque(q)), model()))
    # What there is no sign of is no task for a plan.
    content = flat.to_dict()
    assert not both.suspected
    assert content["unseparated"]["groups"] == []
    assert content["next"] is None


def test_what_two_causes_explain_as_well_is_ambiguous_and_a_task_for_a_plan():
    diagnosis = in_a_plane(0.01, 1.0)

    (finding,) = diagnosis.findings
    assert diagnosis.verdict == "ambiguous"
    assert ("joint_offset", ("pitch",)) in claims(diagnosis)
    assert finding.alternatives
    assert diagnosis.to_dict()["unseparated"]["groups"]
    assert "plan --separate" in diagnosis.to_dict()["next"]
