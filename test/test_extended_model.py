"""What a finding says of the torque, the extended model says too, once it is loaded again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np
import pytest

from dvrk_gravity import effects
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import (
    NO_TERM,
    NOT_AS_FOUND,
    FittedHypothesis,
    MeasuredMotion,
    every_hypothesis,
    extended,
    load,
)
from dvrk_gravity.effects import (
    CableHypothesis,
    Hypothesis,
    Kind,
    PushHypothesis,
    RippleHypothesis,
    Site,
    State,
    WallHypothesis,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import PlantFile
from testing.world import COARSE, World

CARRIED = {
    "coulomb_friction": [0.02, 0.03],
    "viscous_friction": [0.01],
    "stribeck_friction": [0.02],
    "presliding_hysteresis": [0.02],
    "elastic_cable": [0.01, 0.03, -0.02, 0.01],
    "joint_spring": [0.05, -0.01],
    "torque_offset": [0.02],
    "joint_offset": [0.05],
    "payload": [0.04, 0.0006, -0.0004, 0.0008],
    "link_com": [0.02],
    "base_tilt": [0.03, -0.02],
    "link_inertia": [0.001],
    "rotor_inertia": [0.01],
    "cogging": [0.01, -0.02],
    "contact": [0.1],
}
READ_WRONGLY = {
    "torque_scale": [0.1],
    "effort_saturation": [1.0],
    "joint_coupling": [0.1],
    "encoder_scale": [0.03],
    "time_delay": [0.01],
}
NOT_CARRIED = {
    "thermal_drift": [0.02, 0.0],
    "torque_saturation": [0.1],
    "joint_flexibility": [0.02],
}


@lru_cache(maxsize=1)
def motion() -> MeasuredMotion:
    world = World.draw(5, step=COARSE)
    return load([world.record(1, 2, duration=10.0)], world.model())


@lru_cache(maxsize=1)
def supposed() -> tuple[Hypothesis, ...]:
    """Return every hypothesis of that motion, and some that only a search would yield."""
    setting = {"start": 2.0, "end": 4.0}
    push = PushHypothesis(arm=motion().arm, site=Site.joint(3), joints=(3,), setting=setting)
    searched = (ripple(2, 25.0), wall(1.0, 0.2), wall(-1.0, 0.1), push)
    return (*every_hypothesis(motion()), *searched)


def ripple(motor: int, cycles: float) -> Hypothesis:
    return RippleHypothesis(
        arm=motion().arm, site=Site.motor(motor), joints=(motor,),
        setting={"cycles_per_revolution": cycles},
    )  # fmt: skip


def wall(side: float, position: float) -> Hypothesis:
    return WallHypothesis(
        arm=motion().arm, site=Site.joint(3), joints=(3,), setting={"position": position},
        side=side, form="above a position" if side > 0 else "below a position",
    )  # fmt: skip


def first_of(effect: str, place: str | None = None) -> Hypothesis:
    theta = (CARRIED | READ_WRONGLY | NOT_CARRIED)[effect]
    for hypothesis in supposed():
        if hypothesis.effect != effect or (
            place is not None and not hypothesis.place.startswith(place)
        ):
            continue
        if hypothesis.regressor(motion()).shape[2] == len(theta):
            return hypothesis
    raise AssertionError(f"no hypothesis of {effect} at {place}")


def at_its_point(hypothesis: Hypothesis, theta: np.ndarray) -> Hypothesis:
    """Its columns where its parameters are, as the search leaves them."""
    values = hypothesis.parameters(theta)
    return replace(
        hypothesis, setting={**hypothesis.setting, **{n: values[n] for n in hypothesis.fixed_point}}
    )


def added(hypothesis: Hypothesis, theta: np.ndarray) -> np.ndarray:
    return hypothesis.regressor(motion()) @ theta


def reloaded(tmp_path, *found) -> TorqueModel:
    """Return the model that is extended by findings, once it is loaded again."""
    model, left_out = extended(motion(), list(found))
    assert not any(left_out), left_out
    model.save(tmp_path / "extended_model.yaml")
    return TorqueModel.load(tmp_path / "extended_model.yaml")


def change_by(model: TorqueModel) -> np.ndarray:
    return motion().torque_at(motion().q, model) - motion().modelled


def compared() -> np.ndarray:
    """Samples in which friction has its sign and has forgotten how the recording began."""
    speed = np.hstack([motion().qd, motion().arm.actuator_position(motion().qd)])
    rows = np.all(np.abs(speed) > 0.021, axis=1)
    rows[: len(rows) // 2] = False
    assert rows.sum() > 100
    return rows


PLACES = {
    "coulomb_friction": ("joint", "motor", "all, by kind"),
    "viscous_friction": ("joint", "motor"),
    "stribeck_friction": ("joint", "motor"),
    "presliding_hysteresis": ("joint", "motor"),
    "joint_offset": ("joint", "motor"),
    "joint_spring": ("sum", "difference"),
    "link_com": ("link", "weight only"),
    "contact": ("above", "below"),
    "torque_scale": ("joint", "all", "motor"),
    "joint_coupling": ("torque",),
    "encoder_scale": ("joint", "motor"),
}


def found(effects_of: dict[str, list[float]]) -> Iterator[tuple[str, Hypothesis, np.ndarray]]:
    """Yield each effect at each kind of place, where its parameters are."""
    for effect, theta in effects_of.items():
        for place in PLACES.get(effect, (None,)):
            hypothesis = at_its_point(first_of(effect, place), np.array(theta))
            yield f"{effect} {place or ''}", hypothesis, np.array(theta)


def test_the_reloaded_model_has_the_base_s_torque_and_the_finding_s(tmp_path):
    rows = compared()
    for name, hypothesis, theta in found(CARRIED):
        model = reloaded(tmp_path, (hypothesis, theta))
        wanted, got = added(hypothesis, theta)[rows], change_by(model)[rows]
        assert np.abs(wanted).max() > 1e-3, name
        # A base's tilt is linearised half-way, right to second order; all else is exact.
        atol = 2e-4 if hypothesis.effect == "base_tilt" else 1e-9
        np.testing.assert_allclose(got, wanted, atol=atol, err_msg=name)
        Settings.from_parameters(model.parameters())


def test_every_effect_that_can_be_supposed_is_tried_here():
    tried = {hypothesis.effect for hypothesis in supposed()}
    assert tried == set(CARRIED | READ_WRONGLY | NOT_CARRIED)
    without = {"unknown", "time_scale", "velocity_scale"}
    assert {effect.NAME for effect in effects.effects() if effect.MEANINGS} - without <= tried


def test_every_hypothesis_is_read_from_json_as_it_was_written():
    """Infinite priors included; what happened once acts in no other motion."""
    random = np.random.default_rng(0)
    for number, given in enumerate(supposed()):
        size = given.regressor(motion()).shape[2]
        prior = (np.inf, *random.uniform(size=size - 1).tolist())
        hypothesis = replace(given, prior_std=prior) if number % 2 else given
        theta, root = random.normal(size=size), random.normal(size=(size, size))
        fit = FittedHypothesis(hypothesis, theta, root @ root.T, number / 7.0, number % 3 == 0)
        text = json.dumps(fit.to_dict(), allow_nan=False)
        again = FittedHypothesis.from_dict(json.loads(text), motion().arm, "findings.json")
        assert type(again.hypothesis) is type(hypothesis)
        assert all(name in str(again.hypothesis) for name in given.names or ("the arm",))
        for each in fields(hypothesis):
            one, other = (getattr(h, each.name) for h in (hypothesis, again.hypothesis))
            assert np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other
        for name in ("theta", "covariance", "evidence", "rejected"):
            np.testing.assert_array_equal(getattr(again, name), getattr(fit, name))
        wanted = 0.0 if given.transient else given.extrapolated.regressor(motion())
        np.testing.assert_array_equal(again.columns(motion()), np.broadcast_to(wanted, (
            *motion().q.shape, size)), err_msg=str(given))  # fmt: skip
        assert fit.known_elsewhere != given.refits_model
    entry = json.loads(text)
    for name, damaged in (
        ("covariance", [[np.inf]]), ("covariance", [[1.0], [1.0]]), ("theta", [np.nan]),
        ("theta", [[1.0]]), ("evidence", np.inf), ("hypothesis", "Hypothesis"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="findings"):
            FittedHypothesis.from_dict({**entry, name: damaged}, motion().arm, "findings.json")


def test_the_reloaded_model_reads_what_the_finding_says_and_has_the_same_torque(tmp_path):
    for name, hypothesis, theta in found(READ_WRONGLY):
        model = reloaded(tmp_path, (hypothesis, theta))
        wanted, got = added(hypothesis, theta), motion().read_by(model) - motion().modelled
        assert np.abs(wanted).max() > 1e-3, name
        np.testing.assert_allclose(got, wanted, atol=1e-9, err_msg=name)
        state = State.of(motion().q, motion().qd, motion().qdd, None, motion().arm.n)
        np.testing.assert_allclose(model.torque_at(state), motion().modelled, atol=1e-12)


def test_a_torque_beside_a_wrong_reading_of_efforts_is_that_which_acts(tmp_path):
    """By the reloaded model the arm reads what both findings say, whether of each other's torque
    or not."""
    rows = compared()
    for effect, reading, reads_others in (
        ("torque_offset", "torque_scale", False),
        ("viscous_friction", "torque_scale", True),
        ("elastic_cable", "joint_coupling", True),
    ):
        theta, part = np.array(CARRIED[effect]), np.array([0.25])
        cause = first_of(effect)
        of_efforts = (each for each in supposed() if each.effect == reading and each.EFFORT_READING)
        wrong = next(each for each in of_efforts if each.joints[0] == cause.joints[0])
        wrong = replace(wrong, reads_others=reads_others)
        model = reloaded(tmp_path, (cause, theta), (wrong, part))
        acts = added(cause, theta)
        beside = acts if reads_others else np.zeros_like(acts)
        read = wrong.regressor(replace(motion(), known_torque=beside)) @ part
        got = (motion().read_by(model) - motion().modelled)[rows]
        np.testing.assert_allclose(got, (acts + read)[rows], atol=1e-9, err_msg=effect)


def test_a_motion_that_leaks_is_read_with_its_velocity(tmp_path):
    leak = first_of("joint_coupling", "motion")
    model = reloaded(tmp_path, (leak, np.array([0.1])))
    target, source = leak.joints
    wanted = np.eye(7)
    wanted[target, source] = 0.1
    np.testing.assert_allclose(model.reading_errors.position, wanted, atol=1e-15)


def test_what_depends_on_time_stays_in_the_findings():
    time, joint = motion().time - motion().time[0], np.eye(7)[3]
    drift = next(
        each for each in supposed() if each.effect == "thermal_drift" and each.joints == (3,)
    )
    push = first_of("contact", "for a while")
    rise = 1.0 - np.exp(-time / drift.setting["time_constant"])
    while_pushed = ((motion().time >= 2.0) & (motion().time < 4.0)).astype(float)
    for hypothesis, theta, wanted in (
        (drift, [0.02, 0.3], 0.02 * rise + 0.3), (push, [0.1], 0.1 * while_pushed),
    ):  # fmt: skip
        np.testing.assert_allclose(added(hypothesis, np.array(theta)), wanted[:, None] * joint)
        model, why = extended(motion(), [(hypothesis, np.array(theta))])
        assert why == (NO_TERM,)
        # As the same sum in another order.
        np.testing.assert_allclose(change_by(model), 0.0, atol=1e-15)


def test_functions_of_measured_positions_stay_where_they_were_beside_an_encoder_s_zero(tmp_path):
    offset, joint = np.array([0.05]), Site.joint(3)
    zeros = (hypothesis for hypothesis in supposed() if hypothesis.effect == "joint_offset")
    shift = at_its_point(
        next(hypothesis for hypothesis in zeros if hypothesis.site == joint), offset
    )
    cable = CableHypothesis(
        arm=motion().arm, site=joint, joints=(3,), form="degree 3", degree=3, middle=0.2, half=1.0
    )
    others = [
        (cable, np.array(CARRIED["elastic_cable"])),
        (ripple(3, 8.0), np.array([0.01, 0.02])),
        (wall(1.0, 0.3), np.array([0.1])),
        (first_of("joint_spring", "difference"), np.array(CARRIED["joint_spring"])),
    ]
    model = reloaded(tmp_path, (shift, offset), *others)
    wanted = added(shift, offset) + sum(added(*other) for other in others)
    got = change_by(model)
    inside = np.abs(motion().q[:, 3] - 0.2) < 0.9
    assert inside.sum() > 100
    np.testing.assert_allclose(got[inside], wanted[inside], atol=1e-9)


def test_the_simulator_and_a_next_diagnosis_take_an_extended_model(tmp_path):
    first_places = {hypothesis.effect: (hypothesis, theta) for _, hypothesis, theta in
                    reversed(list(found(CARRIED)))}  # fmt: skip
    several = list(first_places.values())
    model = reloaded(tmp_path, *several)
    plant = PlantFile.load(tmp_path / "extended_model.yaml").plant()
    plant.reset(np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5]))
    for _ in range(300):
        plant.step(plant.smooth_torque())
    assert np.abs(plant.v).max() < 0.1
    # What the second diagnosis builds its hypotheses of the links from are true positions.
    again = replace(motion(), model=model)
    np.testing.assert_allclose(again.true_q, motion().q - model.joint_offset)
    assert extended(again, [])[0].parameters() == model.parameters()


def test_a_zero_that_no_model_file_may_have_is_told_and_not_carried():
    """The model's own zero and what is found beside it may be more together."""
    shifted = replace(motion(), model=replace(motion().model, joint_offset=np.full(7, 0.8)))
    (zero,) = [
        hypothesis
        for hypothesis in every_hypothesis(shifted)
        if hypothesis.effect == "joint_offset"
        and hypothesis.joints == (1,)
        and hypothesis.site.kind is Kind.JOINT
    ]
    for offset, fits in ((0.1, True), (0.4, False)):
        model, (why,) = extended(shifted, [(zero, np.array([offset]))])
        assert why == "" if fits else why.startswith("a model file refuses it: joint_offset")
        assert model.joint_offset[1] == pytest.approx(0.9 if fits else 0.8)


def test_a_cable_found_beyond_a_constants_range_is_carried_as_it_was_found():
    """A constant is the same wherever it is held; what is added to it need not end where it did."""
    joint, (middle, half) = 4, motion().travel
    held = {
        "elastic_cable.wrist_pitch": (0.01,),
        "elastic_cable.valid_lower": tuple((middle - 0.01).tolist()),
        "elastic_cable.valid_upper": tuple((middle + 0.01).tolist()),
    }
    narrow = TorqueModel.from_parameters(motion().model.parameters() | held, motion().arm)
    narrowed = replace(motion(), model=narrow)
    for theta in ([0.0, 0.03], [0.0, 0.01, 0.02]):
        cable = next(
            hypothesis
            for hypothesis in every_hypothesis(narrowed)
            if (hypothesis.effect, hypothesis.joints) == ("elastic_cable", (joint,))
            and hypothesis.place == f"degree {len(theta) - 1}"
        )
        powers = [name for name in cable.parameters(np.array(theta)) if name.startswith("k")]
        assert powers == [f"k{k}" for k in range(len(theta))]
        model, why = extended(narrowed, [(cable, np.array(theta))])
        assert why == ("",)
        got = narrowed.torque_at(narrowed.q, model) - narrowed.torque_at(narrowed.q)
        inside = np.abs(narrowed.q[:, joint] - middle[joint]) < half[joint]
        wanted = cable.regressor(narrowed) @ np.array(theta)
        np.testing.assert_allclose(got[inside], wanted[inside], atol=1e-9)


def test_less_rotor_than_none_ends_at_none():
    theta = np.array([-1.0])
    rotor = first_of("rotor_inertia")
    model, why = extended(motion(), [(rotor, theta)])
    assert why == ("",)
    known = dict(model.parameters()).get("rotor_inertia.motor") or (0.0,) * motion().arm.n
    assert min(known) >= 0.0
    assert known[rotor.site.index] == 0.0


def test_what_a_term_of_the_model_cannot_hold_is_not_carried():
    fading = first_of("presliding_hysteresis")
    assert extended(motion(), [(fading, np.array([-0.02]))])[1] == (NOT_AS_FOUND,)


def test_secants_of_wrong_positions_go_over_into_slopes():
    for hypothesis in (each for each in supposed() if each.shifts_positions and each.fixed_point):
        slopes = hypothesis.regressor(motion())
        away = hypothesis.relinearised(np.full(slopes.shape[2], 4e-3)).regressor(motion())
        off, size = (np.linalg.norm(each, axis=(0, 1)) for each in (away - slopes, slopes))
        assert np.all(off < 0.1 * size + 1e-9), hypothesis


def test_a_motor_that_saturates_loses_with_the_cube_of_its_torque():
    weak = first_of("torque_saturation")
    acting, largest = motion().applied_torque[:, weak.joints[0]], weak.setting["torque"]
    lost = added(weak, np.array([0.1]))[:, weak.joints[0]]
    np.testing.assert_allclose(lost, 0.1 * acting**3 / largest**2, atol=1e-12)
