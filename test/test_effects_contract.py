"""What every registered term promises to those who compensate, simulate, fit and file it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from made_up_arm import made_up_arm
from quadratic_drag import QuadraticDrag

from dvrk_gravity import TorqueModel, effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import LinearTerm, Range, Site, State, Term, ViscousHypothesis
from dvrk_gravity.effects.base import registry
from dvrk_gravity.errors import EffectError

ARM = Arm.load("mtmr")
LEVELS = [0.01 * (j + 1) for j in range(ARM.n)]
BETA = {"beta": [0.3, -0.2, 0.4, 0.1, 0.05, 0.02, -0.03, 0.01, 0.02, 0.04]}
EDGES = {"valid_lower": [-0.8] * ARM.n, "valid_upper": [0.9] * ARM.n}
# Plausible parameters of each term, on the MTM or, of a term that an MTM has not, on a chain
# R-R-P-R; a new term needs an entry.
PARAMETERS: Mapping[str, Mapping[str, object]] = {
    "gravity": BETA,
    "link_weight": {
        "link_weight.link2": [0.6, -0.1, 0.01, 0.02],
        "link_weight.counterweight": [0.3, 0.0, 0.01, 0.0],
    },
    "coulomb_friction": {
        "coulomb_friction.joint_positive": LEVELS,
        "coulomb_friction.joint_negative": LEVELS[::-1],
        "coulomb_friction.motor_positive": [0.02] * ARM.n,
        "coulomb_friction.motor_negative": LEVELS,
    },
    "viscous_friction": {"viscous_friction.joint": LEVELS, "viscous_friction.motor": LEVELS},
    "torque_offset": {"torque_offset": LEVELS},
    "elastic_cable": {
        "elastic_cable.elbow_pitch": [0.1, -0.2, 0.3],
        "elastic_cable.wrist_pitch": [0.02, 0.03],
        **{f"elastic_cable.{name}": value for name, value in EDGES.items()},
    },
    "joint_spring": {
        "joint_spring.elbow_pitch": [0.0, 0.0, 0.3, 0.0, -0.2, 0.0, 0.0],
        "joint_spring.wrist_pitch": [0.0, 0.0, -0.2, 0.0, 0.1, 0.0, 0.0],
        "joint_spring.constant": LEVELS,
    },
    "directional_cable": {
        "directional_cable.positive.elbow_pitch": [0.1, 0.2],
        "directional_cable.negative.elbow_pitch": [-0.1, 0.3],
        "directional_cable.ratio": [0.5] * ARM.n,
        **{f"directional_cable.{name}": value for name, value in EDGES.items()},
    },
    "payload": {"payload.mass": 0.2, "payload.first_moment": [0.01, 0.0, 0.02]},
    "rotor_inertia": {"rotor_inertia.motor": LEVELS},
    "link_inertia": {
        "link_inertia.link2": [0.6, -0.1, 0.01, 0.0, 0.01, 0.0, 0.02, 0.0, 0.0, 0.02],
        "link_inertia.crank": [0.1, 0.01, 0.0, 0.0, 0.001, 0.0, 0.001, 0.0, 0.0, 0.001],
    },
    "stribeck_friction": {
        "stribeck_friction.joint": LEVELS,
        "stribeck_friction.joint_velocity": [0.3] * ARM.n,
        "stribeck_friction.motor": [0.01] * ARM.n,
        "stribeck_friction.motor_velocity": [0.2] * ARM.n,
    },
    "presliding_hysteresis": {
        "presliding_hysteresis.displacement": [0.02, 0.2],
        "presliding_hysteresis.joint.wrist_yaw": [0.01, 0.02],
        "presliding_hysteresis.motor.elbow_pitch": [0.03, 0.01],
    },
    "cogging": {
        "cogging.amplitude.outer_yaw": [0.02, 0.01],
        "cogging.cycles_per_revolution.outer_yaw": [6.0, 9.0],
        "cogging.phase.outer_yaw": [0.3, -1.0],
    },
    "contact": {"contact.above": [2.0] * ARM.n, "contact.above_position": [0.1] * ARM.n},
    "held_load": {
        "held_load.orders": [0, 0, 0, 1, 2, 0, 0],
        "held_load.mean.elbow_pitch": [0.1],
        "held_load.difference.elbow_pitch": [0.02],
        **{f"held_load.{name}": value for name, value in EDGES.items()},
    },
    "load_friction": BETA | {"load_friction": [0.1 * (j + 1) for j in range(ARM.n)]},
    "shown_torque": BETA
    | {"shown_torque.lower": [-0.05] * ARM.n, "shown_torque.upper": [0.1] * ARM.n},
}


LINEAR = [effect for effect in effects.terms() if issubclass(effect, LinearTerm)]


@dataclass(frozen=True)
class Case:
    """An effect, a model with its parameters, of some beside others', and a motion."""

    effect: type[Term]
    model: TorqueModel
    term: Term
    state: State


@pytest.fixture(scope="module")
def cases(tmp_path_factory) -> list[Case]:
    """Every term that there is and that has parameters above."""
    chain = made_up_arm(tmp_path_factory.mktemp("arm"))
    return [case_of(effect, chain) for effect in effects.terms() if effect.NAME in PARAMETERS]


def test_every_term_has_an_entry_in_the_table_of_parameters_above():
    assert set(PARAMETERS) == {effect.NAME for effect in effects.terms()}


def case_of(effect: type[Term], chain: Arm) -> Case:
    arm = ARM if effect.schema(ARM) else chain
    model = TorqueModel.from_parameters({"arm": arm.source, **PARAMETERS[effect.NAME]})
    term = model.term(effect.NAME)
    assert term is not None, effect.NAME
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 40, arm.n))
    return Case(effect, model, term, State(np.cumsum(0.1 * q, axis=0), qd, qdd))


def linear(cases: list[Case]) -> Iterator[Case]:
    return (case for case in cases if case.effect in LINEAR)


def same(case: Case, got, wanted, atol: float = 1e-12, rtol: float = 1e-7) -> None:
    np.testing.assert_allclose(got, wanted, rtol=rtol, atol=atol, err_msg=case.effect.NAME)


def test_it_is_named_and_documented_and_its_parameters_have_units(cases):
    for case in cases:
        effect, declared = case.effect, case.effect.schema(case.model.arm)
        assert effect.__doc__
        assert effect.NAME.isidentifier()
        assert declared
        for entry in declared:
            assert entry.meaning
            if entry.kind.startswith("double"):
                assert entry.unit or entry.name.endswith("ratio"), entry.name
        assert effect.from_parameters(case.model.arm, {}) is None, "absent, but mentioned nowhere"


def test_its_torque_is_finite_and_there(cases):
    for case in cases:
        state = case.state
        directed = State(state.q, direction=np.sign(state.qd))
        shown = [case.term.torque(motion) for motion in (state, State(state.q), directed)]
        for torque in shown:
            assert torque.shape == state.q.shape
            assert np.isfinite(torque).all()
        assert max(np.abs(torque).max() for torque in shown) > 1e-3, case.effect.NAME


def test_a_saved_and_loaded_model_has_the_same_torque(cases, tmp_path):
    for case in cases:
        case.model.save(tmp_path / "model.yaml")
        loaded = TorqueModel.load(tmp_path / "model.yaml")
        again = loaded.term(case.effect.NAME)
        same(case, again.torque(case.state), case.term.torque(case.state))
        same(case, loaded.torque_at(case.state), case.model.torque_at(case.state))
        assert again.parameters() == case.term.parameters()


def test_its_columns_times_its_coefficients_are_its_torque(cases):
    for case in linear(cases):
        term, state = case.term, case.state
        given = term.torque(state)
        same(case, term.regressor(state) @ term.theta, given, 1e-11)
        same(case, term.with_theta(term.theta).torque(state), given, 0.0, 0.0)
        same(case, term.reduced().torque(state), given)
        theta = np.abs(np.random.default_rng(0).normal(size=len(term.theta)))
        other = term.with_theta(theta)
        same(case, other.theta, theta, 0.0, 0.0)
        same(case, other.torque(state), term.regressor(state) @ theta, 1e-10)


def test_its_evaluator_of_one_sample_is_its_torque(cases):
    for case in cases:
        evaluate = case.term.prepare()
        rubs = case.term.friction_part(np.ones(case.state.q.shape[1])).any()
        for q, qd in zip(case.state.q, case.state.qd, strict=True):
            same(case, evaluate(q, None), case.term.torque(State(q)))
            if rubs:  # of others a compensator asks for no more than what holds them at rest
                same(case, evaluate(q, qd), case.term.torque(State(q, qd)))


def test_friction_does_not_depend_on_where_joints_are_unless_it_says_so(cases):
    elsewhere = [case for case in cases if not case.term.OF_POSITION]
    assert elsewhere
    for case in elsewhere:
        moved = replace(case.state, q=case.state.q + 0.3)
        same(case, case.term.torque(moved), case.term.torque(case.state), 1e-9)


def test_one_pose_gives_what_many_give(cases):
    for case in cases:
        q, qd = case.state.q[:6], case.state.qd[:6]
        for known in ({}, {"direction": np.sign(qd)}):
            many = case.term.torque(State(q, **known))
            for row in range(len(q)):
                one = State(q[row], **{name: each[row] for name, each in known.items()})
                same(case, case.term.torque(one), many[row])


def test_its_parts_with_and_without_friction_make_up_the_whole(cases):
    for case in cases:
        state, all_of_it = State(case.state.q, case.state.qd), np.ones(case.state.q.shape[1])
        parts = [part for part in case.term.split(all_of_it) if part is not None]
        total = sum(part.torque(state) for part in parts)
        same(case, total, case.term.torque(state))
        fused = case.term.prepare_parts(all_of_it)
        assert (fused is None) == (len(parts) == 1)
        if fused is not None:
            first, second = fused(state.q[0], state.qd[0])
            same(case, first, parts[0].torque(State(state.q[0])))
            same(case, first + second, total[0])


def test_below_its_full_speed_friction_is_not_whole(cases):
    for case in cases:
        full = case.term.full_speed
        if full is None:
            continue
        slow, fast = (
            sum(
                sign * (case.term.torque(State(case.state.q[:1], sign * part * full[None])) @ full)
                for sign in (1.0, -1.0)
            )
            for part in (0.25, 0.5)
        )
        assert fast > slow, case.effect.NAME


def test_its_friction_scales_with_the_part_and_never_drives(cases):
    for case in cases:
        part = np.full(case.state.q.shape[1], 0.3)
        if not case.effect.FRICTION:
            if case.effect.NAME != "directional_cable":  # whose console's ratio is scaled
                with pytest.raises(NotImplementedError, match=f"{case.effect.NAME} is no friction"):
                    case.term.scaled(part)
            continue
        whole = case.term.torque(case.state)
        same(case, case.term.scaled(part).torque(case.state), 0.3 * whole)
        if case.effect.COMPENSATED:  # what remembers the past may give back what it has stored
            assert ((whole * case.state.qd).sum(axis=1) >= -1e-12).all(), case.effect.NAME


def test_a_joint_rubs_as_its_larger_level_and_its_motor_s_do(cases):
    (friction,) = (case.term for case in cases if case.effect.NAME == "coulomb_friction")
    assert friction.at(Site.joint(0)) == pytest.approx(0.07 + 0.02)
    assert friction.at(Site.motor(6)) == pytest.approx(0.07)


def test_half_as_much_friction_again_as_the_model_has_may_be_missing_and_no_more():
    at = {"arm": ARM, "site": Site.joint(0), "joints": (0,), "removable": 0.2}
    found = {size: ViscousHypothesis(**at).removed_fraction(np.array([size]))
             for size in (0.1, -0.1, -0.4)}  # fmt: skip
    assert found == {0.1: 0.0, -0.1: pytest.approx(0.5), -0.4: pytest.approx(2.0)}
    assert ViscousHypothesis(**at, against_reference=True).removed_fraction(np.array([-0.4])) == 0.0
    plausible = [ViscousHypothesis(**at).plausible(np.array([size])) for size in (-0.29, -0.31)]
    assert plausible == [True, False]


@pytest.mark.parametrize(("line", "refused"), [
    ("bad = no_such_module:Bad", "'no_such_module:Bad' of stirred: .*no_such_module"),
    ("bad = :::", "'bad' of stirred: .*':::'"), ("garbage", "entry_points.txt"),
])  # fmt: skip
def test_a_wrong_entry_point_of_a_package_is_refused(line, refused, tmp_path, monkeypatch):
    info = tmp_path / "stirred-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stirred\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[dvrk_gravity.effects]\n{line}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(registry, "_load_entry_points", registry._load_entry_points.__wrapped__)
    with pytest.raises(EffectError, match=refused):
        effects.effects()


@pytest.mark.parametrize(
    ("no_effect", "why"),
    [
        (QuadraticDrag(np.zeros(7)), "is no class derived from"),
        (type("Other", (QuadraticDrag,), {}), "quadratic_drag: is registered already"),
        (dict, "is no class derived from"),
        (type("Nameless", (effects.Effect,), {}), "Nameless: NAME is '', expected an identifier"),
        (type("Bad", (QuadraticDrag,), {"NAME": "two words"}), "NAME is 'two words'"),
        (type("Half", (effects.Term,), {"NAME": "half"}), "Half does not define from_parameters, "),
        (
            type("Rub", (QuadraticDrag,), {"NAME": "rub", "scaled": effects.Term.scaled}),
            "rub: FRICTION is True, which needs a method `scaled`",
        ),
        (
            type("Mute", (QuadraticDrag,), {"NAME": "mute", "COEFFICIENTS": ()}),
            "mute: Mute does not define COEFFICIENTS",
        ),
    ],
)  # fmt: skip
def test_what_is_no_whole_effect_is_refused(no_effect, why, monkeypatch):
    before = dict(registry._effects) | {QuadraticDrag.NAME: QuadraticDrag}
    monkeypatch.setattr(registry, "_effects", dict(before))
    with pytest.raises(EffectError, match=why):
        effects.register(no_effect)
    assert registry._effects == before


def test_what_a_fit_finds_of_it_is_what_its_columns_make(cases):
    for case in linear(cases):
        unknowns = case.effect.unknowns(ARM, Range(ARM.lower, ARM.upper))
        if not unknowns:
            continue
        scale = np.array([column.scale for column in unknowns.columns])
        coefficients = scale * np.random.default_rng(2).uniform(0.1, 1.0, len(scale))
        if hasattr(case.effect, "SETTINGS"):  # of which a site has one
            coefficients *= [column.index == 2 for column in unknowns.columns]
        state = case.state
        made = unknowns.regressor(state, unknowns.memory(state)) @ coefficients
        same(case, unknowns.found(coefficients).torque(state), made, 1e-9, 1e-9)
        assert unknowns.found(np.zeros(len(scale))) is None
        assert len({column.key for column in unknowns.columns}) == len(scale)
