"""What reads a recording wrongly is one cause, found first; what cannot be judged is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import (
    ARM,
    DURATION,
    INSERTION,
    MIDDLE,
    NOISE,
    PITCH,
    ROLL,
    YAW,
    eye,
    model,
    moving,
    named,
    of_seven,
    only,
    recorded,
    seven,
)

from dvrk_gravity.arms import ANY_UNIT
from dvrk_gravity.diagnosis import (
    CrossValidation,
    FilteredData,
    HeldOut,
    correct_recordings,
    diagnose,
    load,
    require_gravity,
    require_predictable,
    try_readings,
)
from dvrk_gravity.effects import State, TimeDelay
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.model import ModelUncertainty
from dvrk_gravity.observation import velocity_fault
from dvrk_gravity.recording import Recording

DEGREES = 180.0 / np.pi
EVERY = 1.0 * np.ones(ARM.n)


def with_effort(change) -> Recording:
    """Return a right recording but for its efforts."""
    return replace(recorded(), effort=change(recorded().effort))


def turned(joint: int) -> np.ndarray:
    """Return (n,) factors that turn one joint's sign."""
    return EVERY - 2.0 * eye(joint)


# Signs and order.
def test_wrong_signs_of_all_efforts_are_told_as_one():
    finding = only(diagnose(with_effort(lambda effort: -effort), model()))

    assert finding.effect == "wrong_coordinates"
    assert finding.place == "the efforts of all joints have the wrong sign"


def test_a_position_of_the_wrong_sign_is_no_other_cause():
    sign, recording = turned(PITCH), recorded()
    read = replace(
        recording, position=sign * recording.position, velocity=sign * recording.velocity
    )

    finding = only(diagnose(read, model()))

    assert (finding.effect, finding.joints) == ("wrong_coordinates", ("pitch",))
    assert finding.place == "the position of pitch has the wrong sign"


def test_no_reading_takes_an_arm_beyond_its_limits():
    """An insertion that is read from the middle the other way round cannot slide as minus that."""
    sign, recording = turned(INSERTION), recorded()

    def better(middle: float) -> list[str]:
        position = sign * recording.position + 2.0 * middle * MIDDLE * eye(INSERTION)
        read = replace(recording, position=position, velocity=sign * recording.velocity)
        return [score.reading.words for score in try_readings(load([read], model()))]

    assert "the position of insertion has the wrong sign" in better(0.0)
    assert "the position of insertion has the wrong sign" not in better(1.0)


def test_another_reading_of_positions_removes_what_is_beyond_the_error_that_the_model_states():
    none, right, sign = np.zeros((4, 0)), recorded(), turned(PITCH)
    read = replace(right, position=sign * right.position, velocity=sign * right.velocity)
    for error in (1.0, 3.0):  # N·m at pitch
        known = ModelUncertainty(
            {}, {}, none, none[:3], error * EVERY, 8.0, np.full(4, 0.1), *ARM.range, np.full(4, 9.0)
        )
        motion = load([read], replace(model(), uncertainty=known))
        before = np.mean(motion.residual[~motion.silent[:, PITCH], PITCH] ** 2)
        removed = 1.0 - np.sqrt(error**2 / (before + error**2))
        assert try_readings(motion)[0].removed == pytest.approx(removed, rel=0.1)


def test_two_joints_exchanged_in_one_quantity_alone_are_told():
    order, recording = [PITCH, YAW, INSERTION, ROLL], recorded()
    read = replace(
        recording, position=recording.position[:, order], velocity=recording.velocity[:, order]
    )

    finding = only(diagnose(read, model()))

    assert (finding.effect, finding.joints) == ("wrong_coordinates", ("yaw", "pitch"))
    assert finding.place == "the positions of yaw and pitch are exchanged"


def test_motors_read_as_joints_are_told_before_what_else_is_wrong():
    """Of a master arm, whose second and third motors move joints together."""
    arm, recording = seven().arm, of_seven()
    rubbing = 0.1 * recording.velocity[:, [0]] * np.eye(7)[0]
    motors = replace(
        recording,
        position=arm.actuator_position(recording.position),
        velocity=arm.actuator_position(recording.velocity),
        effort=arm.actuator_effort(recording.effort + rubbing),
    )

    first, second = diagnose(motors, seven().model()).findings

    assert (first.effect, second.effect) == ("wrong_coordinates", "viscous_friction")
    assert "--coordinates actuator" in first.remedy
    assert second.joints == ("outer_yaw",)
    assert second.parameters["coefficient"].value == pytest.approx(0.1, rel=0.1)


# Scales of efforts.
def test_a_scale_of_all_efforts_is_the_one_cause():
    factor = 1e-3
    finding = only(diagnose(with_effort(lambda effort: factor * effort), model()))

    assert (finding.effect, finding.joints) == ("torque_scale", ARM.joint_names)
    assert finding.certain
    assert finding.parameters["factor"].value == pytest.approx(factor, rel=0.02)


def test_a_scale_far_off_at_one_joint_is_its_own():
    factors = EVERY + 7.0 * eye(PITCH)

    finding = only(diagnose(with_effort(lambda effort: factors * effort), model()))

    assert (finding.effect, finding.joints) == ("torque_scale", ("pitch",))
    assert finding.parameters["factor"].value == pytest.approx(8.0, rel=0.02)


def test_scales_of_two_joints_are_not_said_to_be_of_all():
    factors = EVERY - 0.2 * eye(YAW) - 0.2 * eye(PITCH)

    diagnosis = diagnose(with_effort(lambda effort: factors * effort), model())

    assert sorted(named(diagnosis)) == [("torque_scale", ("pitch",)), ("torque_scale", ("yaw",))]
    for finding in diagnosis.findings:
        assert finding.parameters["factor"].value == pytest.approx(0.8, abs=0.02)


def test_a_scale_is_no_wrong_reading_where_the_unit_is_arbitrary_or_beside_another_recording():
    """The first may read in any unit; a reference reads as wrongly itself."""
    motion = load([with_effort(lambda effort: 0.02 * effort)], model())
    joints = tuple(replace(joint, read_in=ANY_UNIT) for joint in ARM.joints)
    arbitrary = replace(motion, model=replace(model(), arm=replace(ARM, joints=joints)))
    beside = replace(motion, reference=np.zeros_like(motion.q))

    for of, scaled in ((motion, True), (arbitrary, False), (beside, False)):
        assert any(score.reading.scale is not None for score in try_readings(of)) is scaled


def test_newton_millimetres_are_refused():
    with pytest.raises(RecordingError, match="expected N·m, not mN·m"):
        diagnose(replace(of_seven(), effort=1e3 * of_seven().effort), seven().model())


# Clocks and velocities.
def stamped(factor: float, velocities: bool = True, duration: float = DURATION) -> Recording:
    recording = recorded(0, duration)
    read = replace(recording, time=factor * recording.time)
    return read if velocities else replace(read, velocity=None)


def scaled(recording: Recording, factors: np.ndarray | float) -> Recording:
    """Return a recording with velocities that are factors too large."""
    return replace(recording, velocity=factors * recording.velocity)


def test_a_clock_that_runs_wrong_is_the_one_cause_in_a_file_as_in_memory(tmp_path):
    factor = 0.503
    stamped(factor, duration=18.0).save(tmp_path / "fast.csv")

    finding = only(diagnose(tmp_path / "fast.csv", model()))

    assert (finding.effect, finding.joints, finding.certain) == ("time_scale", (), True)
    assert finding.parameters["factor"].value == pytest.approx(factor, rel=2e-3)


def test_without_velocities_the_model_s_torques_show_the_clock():
    """Inertia by its square, viscous friction by the factor, weight and Coulomb's not at all."""
    factor = 1.6
    finding = only(diagnose(stamped(factor, velocities=False), model()))

    found = finding.parameters["factor"]
    assert finding.effect == "time_scale"
    assert found.low <= factor <= found.high
    assert found.high / found.low < 1.05


def test_the_rest_is_judged_by_the_true_clock():
    motion = moving(0, 12.0)
    right = motion.read(motion.torque() + 0.3 * motion.qd[:, [YAW]] * eye(YAW))

    clock, friction = diagnose(replace(right, time=0.7 * right.time), model()).findings

    assert (clock.effect, friction.effect) == ("time_scale", "viscous_friction")
    assert friction.joints == ("yaw",)
    assert friction.parameters["coefficient"].value == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize(
    ("joints", "factor", "unit"),
    [(ARM.joint_names, DEGREES, "deg/s"), (("pitch",), 30.0 / np.pi, "rpm")],
)
def test_velocities_in_another_unit_are_named_and_no_wrong_clock(joints, factor, unit):
    turns = np.array(ARM.units) == "rad"
    wrong = np.isin(ARM.joint_names, joints)
    if len(joints) == ARM.n and unit == "deg/s":
        wrong = turns

    diagnosis = diagnose(scaled(recorded(), np.where(wrong, factor, 1.0)), model())

    assert {finding.effect for finding in diagnosis.findings} == {"velocity_scale"}
    told = [joint for finding in diagnosis.findings for joint in finding.joints]
    assert sorted(told) == sorted(np.array(ARM.joint_names)[wrong])
    for finding in diagnosis.findings:
        assert finding.place == unit
        assert finding.parameters["factor"].value == pytest.approx(factor, rel=5e-3)


def test_a_unit_that_joints_show_by_different_multiples_is_as_uncertain_as_these_differ():
    """The standard error of the mean of three: a part d less, as much, and d more, d/sqrt(3)."""
    part, angle = 0.01, np.pi * np.arange(2000)[:, None] / 200.0
    velocity = np.pi * np.cos(angle) * DEGREES * (1.0 + part * np.array([-1.0, 0.0, 1.0]))
    q = np.sin(angle) * np.ones(3)
    read = Recording(("a", "b", "c"), angle[:, 0] / np.pi, q, velocity, np.zeros_like(q))
    factor = velocity_fault(read).factor
    wide = 1.96 * part / np.sqrt(3.0) * DEGREES
    assert [factor.low, factor.high] == pytest.approx([DEGREES - wide, DEGREES + wide], rel=1e-6)


def test_a_wrong_clock_and_a_velocity_in_another_unit_are_told_apart():
    clock, factor = 1.5, DEGREES
    recording = scaled(stamped(clock), EVERY + (factor - 1.0) * eye(ROLL))

    diagnosis = diagnose(recording, model())

    assert named(diagnosis) == [("time_scale", ()), ("velocity_scale", ("roll",))]
    time, velocity = (finding.parameters["factor"].value for finding in diagnosis.findings)
    assert time == pytest.approx(clock, rel=5e-3)
    assert velocity == pytest.approx(factor, rel=5e-3)


def test_a_model_without_inertia_does_not_tell_a_clock_from_velocities():
    """Then both are named; it is weight alone that it knows."""
    weight = replace(model(), terms=tuple(t for t in model().terms if t.NAME == "link_weight"))

    (first,) = correct_recordings([stamped(0.503, duration=18.0)], weight, None, {}).faults

    assert first.effect == "time_scale"
    assert first.alternatives[0][0] == "velocity_scale"


# What a filter or a friction that is late makes of efforts is no delay of theirs.
def test_friction_alone_that_is_late_is_no_delay_of_the_efforts():
    """What comes on over a way is late where a joint turns back; weight and inertia are not."""
    motion, delay = moving(), 0.08
    terms = [term.scaled(5.0 * EVERY) if term.FRICTION else term for term in model().terms]
    rubbing = replace(model(), terms=tuple(terms))
    smooth = replace(model(), terms=tuple(term for term in terms if not term.FRICTION))
    whole, rest = (each.torque(motion.q, motion.qd, motion.qdd) for each in (rubbing, smooth))

    def shifted(torque: np.ndarray) -> np.ndarray:
        columns = [np.interp(motion.time - delay, motion.time, column) for column in torque.T]
        return np.column_stack(columns)

    def unconfirmed(effort: np.ndarray) -> list[bool]:
        """Return whether of a delay that fits well only a part shows."""
        loaded = load([motion.read(effort)], rubbing)
        data = FilteredData.of(loaded)
        claim = replace(next(TimeDelay.hypotheses(loaded)), setting={"delay": delay})
        found = [data.candidate(claim)]
        validation = CrossValidation.of(data).weighted(found, final=True)
        assert validation.score(found).likelihood - validation.score([]).likelihood > 100.0
        return [failure.partial for failure, _ in HeldOut(validation).unconfirmed(found)]

    assert unconfirmed(shifted(whole)) == []
    assert unconfirmed(rest + shifted(whole - rest)) == [True]


# What cannot be judged.
@cache
def weight() -> np.ndarray:
    """Return the torques of the weights in the recording."""
    state = State.of(recorded().position)
    return sum(term.torque(state) for term in model().terms if term.WEIGHT_OF_ARM)


def noise(seed: int, width: float = 0.0) -> np.ndarray:
    """Return noise as large as the efforts, a running mean over some time, s."""
    effort = recorded().effort
    white = np.random.default_rng(seed).normal(
        effort.mean(axis=0), effort.std(axis=0), effort.shape
    )
    window = np.ones(max(round(100.0 * width), 1))
    return np.apply_along_axis(np.convolve, 0, white, window / len(window), mode="same")


@pytest.mark.parametrize(
    "effort",
    [lambda e: noise(1), lambda e: noise(7, 0.3), lambda e: recorded(2).effort],
    ids=["white", "slow", "of another motion"],
)
def test_noise_and_efforts_of_another_motion_are_refused(effort):
    with pytest.raises(RecordingError, match="predicted better than by a constant"):
        diagnose(with_effort(effort), model())


def test_efforts_without_gravity_are_refused_by_name_of_joints():
    for factor in (1.0, -1.0, 0.1):  # and so they are at another scale or sign
        without = replace(recorded(), effort=factor * (recorded().effort - weight()))
        with pytest.raises(RecordingError, match=r"gravity is not in the efforts of.*pitch"):
            diagnose(without, model())


def test_efforts_that_a_model_can_judge_are_not_refused():
    """At another scale or sign, of exchanged joints, or of which one joint alone is right.

    Nor those beside so much noise that nobody could say whether weight is in them.
    """
    effort, some = recorded().effort, noise(1)
    some[:, PITCH] = effort[:, PITCH]
    order = [PITCH, YAW, INSERTION, ROLL]
    white = np.random.default_rng(16).normal(size=effort.shape)
    noisy = effort - weight() + 8.0 * weight().std(axis=0) * white
    others = (-effort, 0.01 * effort, effort[:, order], effort - weight() * eye(YAW))
    for read in (*others, some, noisy):
        recording = replace(recorded(), effort=read)
        motion = load([recording], model())
        if read is not noisy:
            require_predictable(motion, [recording])
        if read is not some:
            require_gravity(motion, "recording")


def test_a_recording_that_shows_too_little_is_refused_with_what_is_missing():
    right = recorded()
    for bad, words in (
        (right.between(0.0, 5.0), "at least 8 s"),
        (replace(right, effort=None), "no effort"),
        (replace(right, position=np.zeros_like(right.position)), "no joint moves"),
        (replace(right, time=None, velocity=None).rows(slice(0, 900, 30)), "at least 40"),
    ):
        with pytest.raises(RecordingError, match=words):
            diagnose(bad, model())


def test_noise_of_joints_is_the_same_however_it_was_recorded_and_unknown_where_it_was_not():
    arm, motion = ARM, moving()
    recording = motion.read(model().torque(motion.q, motion.qd, motion.qdd))
    there = replace(
        recording,
        position=arm.actuator_position(recording.position),
        velocity=arm.actuator_position(recording.velocity),
        effort=arm.actuator_effort(recording.effort),
        coordinates="actuator",
    )
    part = replace(
        recording,
        joints=ARM.joint_names[:3],
        **{name: getattr(recording, name)[:, :3] for name in ("position", "velocity", "effort")},
    )

    here = load([recording], model()).noise

    np.testing.assert_allclose(load([there], model()).noise, here, rtol=1e-6)
    white = NOISE / np.sqrt(50.0)  # below 1 of 50 Hz
    assert ((0.8 * white < here) & (here < 1.6 * white)).all()
    floor = load([part], model(), {"roll": 0.0}).noise
    assert np.isfinite(floor).tolist() == [True, True, True, False]
