"""The diagnosis with an identified model, of an arm whose friction no model has exactly."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from diagnosed import (
    INSERTION,
    LAB_SEED,
    PITCH,
    ROLL,
    YAW,
    another,
    claims,
    eye,
    holds,
    identified,
    lab,
    named,
    only,
    seen,
)

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import (
    FRICTION_BY_LOAD,
    Diagnosis,
    beyond_range,
    diagnose,
    friction_by_load,
    load,
)
from dvrk_gravity.effects import (
    THE_ARM,
    AllFrictionHypothesis,
    Hypothesis,
    OffsetHypothesis,
    RippleHypothesis,
    Site,
    State,
    TimeDelay,
    ViscousHypothesis,
    WallHypothesis,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import CalibrationSamples, KeptSettings, TorqueModel, uncertainty_file
from dvrk_gravity.recording import DEFAULT_CUTOFF, LowPass, Recording
from testing import lab_effects
from testing.lab_motion import draw_calibration, draw_other

FRICTION = 0.4  # N·m at pitch, that a model lacks
JOINTS = lab().arm.joint_names


@cache
def hidden(effect: str, seed: int) -> tuple[Recording, Diagnosis, lab_effects.Hiding]:
    """Hide an effect in another motion of the arm and diagnose it."""
    world, fit, random = lab(), identified(), np.random.default_rng(seed)
    residual = np.array([error.rmse for error in fit.held_out.values()])
    truth = world.truth(draw_other(world.arm, int(random.integers(1 << 30))), 12.0)
    hiding = lab_effects.hide(world.setting(truth, residual), effect, random)
    recording = world.record(hiding.truth, seed)
    return recording, diagnose(recording, fit.model), hiding


def test_what_is_hidden_is_named_or_listed_and_nothing_beside_it():
    effect = "coulomb_friction"
    _, diagnosis, hiding = hidden(effect, 7)

    assert hiding.ratio > 2.0
    assert (effect, hiding.hidden.joints) in claims(diagnosis)
    assert len(diagnosis.findings) == 1
    first = diagnosis.findings[0]
    if first.effect == effect:
        for name in hiding.hidden.parameters.keys() & first.parameters.keys():
            assert holds(first, name, hiding.hidden.parameters[name], 0.2), name
    assert first.remedy


def test_the_extended_model_knows_how_sure_it_is_and_finds_nothing_more(tmp_path):
    recording, diagnosis, _ = hidden("coulomb_friction", 7)
    assert all(finding.in_model for finding in diagnosis.findings)
    assert diagnosis.in_simulation is None, "nobody asked for it"

    diagnosis.model.save(tmp_path / "extended.yaml")
    again = TorqueModel.load(tmp_path / "extended.yaml")

    assert diagnose(recording, again).findings == ()
    evaluation = evaluate(again, recording)
    assert set(evaluation.expected) == set(evaluation.joints)
    for joint, expected in evaluation.expected.items():
        assert evaluation.joints[joint].rmse < expected.high, joint


def test_where_the_model_was_not_identified_a_function_of_a_joint_s_position_may_be_its_error():
    recording, model = seen(another(3)), identified().model
    least, upper = np.quantile(recording.position[:, YAW], (0.0, 0.7))
    at = {"arm": lab().arm, "site": Site.joint(YAW)}
    wall = partial(WallHypothesis, **at, side=1.0)
    ripple = RippleHypothesis(
        arm=lab().arm, site=Site.motor(YAW), setting={"cycles_per_revolution": 0.1}
    )

    def doubt(hypothesis: Hypothesis, edge: float, **changes: object) -> str:
        narrow = replace(model.uncertainty, upper=np.array([edge, *model.uncertainty.upper[1:]]))
        motion = load([recording], replace(model, **{"uncertainty": narrow} | changes))
        return beyond_range(motion, hypothesis, np.ones(hypothesis.regressor(motion).shape[2]))

    above = wall(setting={"position": upper})
    assert JOINTS[YAW] in doubt(above, upper)
    assert doubt(above, upper, uncertainty=None) == ""
    assert JOINTS[YAW] in doubt(OffsetHypothesis(**at), least)
    for elsewhere in (ViscousHypothesis(**at), ripple):
        assert doubt(elsewhere, least) == ""
    assert doubt(wall(setting={"position": least}), upper) == "", "most of it acts inside"


def test_the_extended_model_s_range_grows_where_it_is_right_and_only_there():
    """Beyond the range of two joints pitch has a slope that no term of the model has."""
    truth, model = another(3), identified().model
    known = model.uncertainty
    upper = np.array([*np.quantile(truth.q[:, :2], 0.8, axis=0), *known.upper[2:]])
    extra = 5.0 * np.maximum(truth.q - upper, 0.0) * eye(PITCH)
    extra += 0.05 * np.tanh(truth.qd / 0.02) * eye(ROLL)
    recording = seen(truth, 3, extra)
    narrow = replace(model, uncertainty=replace(known, upper=upper, band=4.0))

    diagnosis = diagnose(recording, narrow)

    finding, now = only(diagnosis), diagnosis.model.uncertainty
    assert (finding.effect, finding.joints) == ("coulomb_friction", (JOINTS[ROLL],))
    q = recording.position
    right = np.maximum(upper, q.max(axis=0)) * (1.0 - eye(PITCH)) + upper * eye(PITCH)
    assert now.upper == pytest.approx(right, abs=0.01)
    assert now.lower == pytest.approx(np.minimum(known.lower, q.min(axis=0)), abs=0.01)
    assert now.band == DEFAULT_CUTOFF, "of errors as `evaluate` compares them"


@cache
def doubtful(times: float) -> TorqueModel:
    """Return a model that says it is so much less certain than it is, and everywhere alike."""
    known = identified().model.uncertainty
    wide = replace(
        known, deviations={name: times * each for name, each in known.deviations.items()},
        offset=times * known.offset, gravity=times * known.gravity, calibration=None,
        lower=known.lower - 9.0, upper=known.upper + 9.0, speed=known.speed + 9.0,
    )  # fmt: skip
    return replace(identified().model, uncertainty=wide)


def state() -> State:
    return State(another(6).q, another(6).qd, another(6).qdd)


def torques(model: TorqueModel) -> Array:
    """Return (d, T, n) torques of a motion by which a model may be off, a deviation each."""
    known = model.uncertainty
    each = (tuple(known.shift_terms(model.terms, way)) for way in np.eye(known.size))
    there = [replace(model, terms=terms).torque_at(state()) for terms in each]
    return np.array(there) - model.torque_at(state())


def rms(torque: Array) -> Array:
    """Return that of (…, T, n) torques; of several, of all together."""
    return np.sqrt(np.mean(np.atleast_3d(torque.T) ** 2, axis=1).sum(axis=-1))


def largest(times: float) -> Array:
    """Return that of them of which insertion has most."""
    return max(torques(doubtful(times)), key=lambda torque: rms(torque)[INSERTION])


@pytest.mark.parametrize("deviations", [2.0, 3.0])
def test_what_the_model_s_own_parameters_explain_is_more_than_expected_beyond_1_96(deviations):
    torque, bound = deviations * largest(8.0), 1.96 * rms(torques(doubtful(8.0)))[INSERTION]
    size = rms(torque)[INSERTION]

    diagnosis = diagnose(seen(another(6), 6, torque), doubtful(8.0))

    (moved,) = (one for one in diagnosis.known if one.effect == "model_parameters")
    assert (diagnosis.findings, moved.joints) == ((), (JOINTS[INSERTION],))
    assert moved.parameters["rms"].value == pytest.approx(size, rel=0.05)
    shown = re.search(r"up to ([\d.]+) N RMS", moved.sentence)
    assert float(shown[1]) == pytest.approx(bound, rel=0.03)
    assert ("explained by" in moved.sentence) == (size < bound) == (deviations < 3.0)


def test_an_extended_model_has_moved_to_the_truth_and_is_no_farther_off_than_it_says():
    """Its own friction at roll may be off by 0.05 N·m, and is by 0.5: only the sum is known."""
    values, known = dict(identified().model.parameters()), doubtful(3.0).uncertainty
    levels = {side: f"coulomb_friction.joint_{side}" for side in ("positive", "negative")}
    for level in levels.values():
        values[level] = tuple(values[level] + 0.5 * eye(ROLL))
    own = known.deviations["coulomb_friction"].copy()
    own[[ROLL, lab().arm.n + ROLL], 0] += 0.05
    uncertain = replace(known, deviations={**known.deviations, "coulomb_friction": own})
    given = replace(identified().model, uncertainty=uncertain)
    own_torque = 0.3 * largest(3.0)
    effort = TorqueModel.from_parameters(values, lab().arm).torque_at(state()) + own_torque

    diagnosis = diagnose(seen(replace(another(6), effort=effort), 6), given)

    assert only(diagnosis).joints == (JOINTS[ROLL],)
    missed = rms(diagnosis.model.torque_at(state()) - effort)
    before, after = (rms(torques(each)) for each in (given, diagnosis.model))
    assert (after < 0.5 * before).all()
    assert (missed < after).all()
    assert (missed > 0.1 * after).all()
    assert missed[INSERTION] < 0.25 * rms(own_torque)[INSERTION]


# What the calibration shows already.
def rubbed(motion: int, friction: float) -> Recording:
    """Record a motion of the arm, with friction at pitch that its model does not have."""
    truth = another(motion)
    extra = np.zeros_like(truth.effort)
    extra[:, PITCH] = friction * np.tanh(truth.qd[:, PITCH] / 0.02)
    return seen(truth, motion, extra)


@cache
def exact() -> TorqueModel:
    """Identified without that friction; at pitch it states half of it as its error."""
    known = identified().model.uncertainty
    error = known.error.copy()
    error[PITCH] = 0.5 * FRICTION
    return replace(identified().model, uncertainty=replace(known, error=error, calibration=None))


@cache
def rubbing() -> TorqueModel:
    """The same, with samples of its calibration that show the friction."""
    motion = load([rubbed(3, FRICTION)], exact())
    low = LowPass(exact().uncertainty.band, motion.rate)
    kept = CalibrationSamples.of(
        [(motion.q, motion.qd, motion.qdd, low(motion.effort))], motion.rate
    )
    return replace(exact(), uncertainty=replace(exact().uncertainty, calibration=kept))


def test_what_recurs_of_the_calibration_is_known_and_no_finding():
    recording = rubbed(4, FRICTION)

    finding = only(diagnose(recording, exact()))
    diagnosis = diagnose(recording, rubbing())

    assert (finding.effect, finding.joints) == ("coulomb_friction", (JOINTS[PITCH],))
    assert diagnosis.verdict == "nothing_to_explain"
    assert (JOINTS[PITCH],) in [known.joints for known in diagnosis.known]


def test_more_of_it_is_a_finding_and_its_interval_holds_what_came():
    finding = only(diagnose(rubbed(4, 4 * FRICTION), rubbing()))

    assert (finding.effect, finding.joints) == ("coulomb_friction", (JOINTS[PITCH],))
    size = finding.parameters["positive"]
    assert size.low < 3 * FRICTION < size.high
    assert size.value == pytest.approx(4 * FRICTION, rel=0.1)


def test_an_extended_model_that_lacks_what_was_found_keeps_no_samples_that_show_it():
    recording = rubbed(4, FRICTION)
    scaled = replace(recording, effort=recording.effort * np.array([1.3, 1.0, 1.0, 1.0]))

    diagnosis = diagnose(scaled, rubbing())

    assert "torque_scale" in [effect for effect, _ in named(diagnosis)]
    assert diagnosis.model.uncertainty.calibration is None


def test_a_delay_of_the_calibration_may_be_in_a_model_that_was_identified():
    """Up to a sample early or late, uniformly; nothing where the model was written down."""
    recording = rubbed(4, 0.0)

    def absorbed(model: TorqueModel) -> float:
        motion = load([recording], model)
        return next(TimeDelay.hypotheses(motion)).absorbed_variance(motion)

    sample = float(np.median(np.diff(recording.time)))
    assert absorbed(identified().model) == pytest.approx(sample**2 / 3.0)
    assert absorbed(replace(identified().model, uncertainty=None)) == 0.0


def test_identify_keeps_samples_unless_terms_were_left_out_by_request():
    calibration = lab().truth(draw_calibration(lab().arm, LAB_SEED), 15.0)
    model = identified().model
    few = identify(
        lab().record(calibration, LAB_SEED), lab().arm, effects=["coulomb_friction"]
    ).model

    kept = model.uncertainty.calibration
    assert len(kept.q) > 0.9 * kept.rate * 30.0
    left = kept.effort - model.torque(kept.q, kept.qd, kept.qdd)
    assert np.abs(left).mean() < 0.1 * np.abs(kept.effort).mean()
    assert few.uncertainty.calibration is None


def test_a_file_gives_the_samples_back_and_of_a_long_motion_the_first_minute(tmp_path):
    rubbing().save(tmp_path / "model.yaml")
    kept, again = (
        each.uncertainty.calibration
        for each in (rubbing(), TorqueModel.load(tmp_path / "model.yaml"))
    )
    assert (again.rate, again.parts) == (kept.rate, kept.parts)
    for name in ("q", "qd", "qdd", "effort"):
        assert getattr(again, name) == pytest.approx(getattr(kept, name), rel=1e-6, abs=1e-9)

    parts = [tuple(np.full((50, 2), float(number)) for _ in range(4)) for number in range(3)]
    first = CalibrationSamples.of(parts, 10.0, KeptSettings(longest=8.0))
    assert [part.stop - part.start for part in first.parts] == [50, 30]
    assert first.effort[-1] == pytest.approx(1.0)
    assert CalibrationSamples.of([], 10.0) is None


def test_samples_that_cannot_be_are_refused_by_name(tmp_path):
    path = tmp_path / "model.yaml"
    rubbing().save(path)
    beside = uncertainty_file(path)
    with np.load(beside) as stored:
        arrays = dict(stored)
    kept = {
        name.removeprefix("calibration/"): array
        for name, array in arrays.items()
        if name.startswith("calibration/")
    }
    for name, array, expected in (
        ("q", kept["q"][:-1], "finite calibration/q of shape"),
        ("effort", np.nan * kept["effort"], "finite calibration/effort of shape"),
        ("part", kept["part"] + 1, "calibration/part that counts from 0"),
        ("part", kept["part"][0], "calibration/part with one number a sample"),
        ("rate", 0.001 * kept["rate"], "finite calibration/rate above 11.3 Hz"),
        ("qd", None, "an array calibration/qd"),
    ):
        changed = arrays | {f"calibration/{name}": array}
        np.savez(beside, **{each: value for each, value in changed.items() if value is not None})
        with pytest.raises(ConfigError, match=f"{beside.name}.*expected {expected}"):
            TorqueModel.load(path)


# Friction of another day.
def on_a_day(seed: int, change) -> Diagnosis:
    """Diagnose a motion, its efforts with a change of the model's friction, kind by kind."""
    truth, model = another(seed, 15.0), identified().model
    state = State(truth.q, truth.qd, truth.qdd)
    kinds = {term.NAME: term.torque(state) for term in model.terms if term.FRICTION}
    return diagnose(seen(truth, seed, change(kinds)), model)


def all_kinds(part: float):
    return lambda kinds: part * sum(kinds.values())


def test_all_friction_that_has_grown_is_known_and_no_scale_of_all_efforts():
    diagnosis = on_a_day(7, all_kinds(0.3))

    assert diagnosis.findings == ()
    known = diagnosis.known[0]
    assert known.joints == JOINTS
    factors = [factor for name, factor in known.parameters.items() if name.endswith("factor")]
    assert factors
    for factor in factors:
        assert factor.value == pytest.approx(1.3, abs=0.1)
        assert factor.low < 1.3 < factor.high
    assert known.remedy
    assert "friction_compensation.ratio" not in known.remedy


def test_of_all_friction_that_has_shrunk_no_more_is_compensated_than_is_left():
    known = on_a_day(7, all_kinds(-0.4)).known[0]

    ratio = re.search(r"friction_compensation\.ratio (0\.\d+)", known.remedy)
    assert 0.5 < float(ratio[1]) <= 0.6


def test_no_factor_has_friction_drive_the_arm():
    factor = AllFrictionHypothesis(
        arm=lab().arm, site=THE_ARM, joints=(0, 1), kinds=("coulomb_friction",)
    )
    assert factor.plausible(np.array([-1.0]))
    assert not factor.plausible(np.array([-1.3]))


def test_friction_by_load_is_the_load_beyond_that_of_calibration_against_the_motion():
    model = identified().model
    motion, samples = load([seen(another(7))], model), model.uncertainty.calibration
    rigid = replace(model, terms=tuple(term for term in model.terms if not term.FRICTION))
    then = np.abs(rigid.torque(samples.q, samples.qd, samples.qdd)).mean(axis=0)
    now = np.abs(rigid.torque(motion.q, motion.qd, motion.qdd))
    fast = np.abs(motion.qd) > 3.0 * np.median(np.abs(motion.qd), axis=0)

    columns = friction_by_load(motion)

    expected = FRICTION_BY_LOAD * (now - then) * np.sign(motion.qd)
    for index, joint in enumerate(np.flatnonzero(motion.moves)):
        rows = fast[:, joint]
        np.testing.assert_allclose(columns[rows, joint, index], expected[rows, joint], atol=1e-9)
        assert not np.delete(columns[:, :, index], joint, axis=1).any()
    bare = replace(model, uncertainty=replace(model.uncertainty, calibration=None))
    assert friction_by_load(load([seen(another(7))], bare)).shape[2] == 0
