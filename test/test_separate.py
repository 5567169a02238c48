"""What separates causes that a diagnosis could not: the evidence expected, the plan, its files."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_results import example_diagnosis
from support import MODEL_FILE
from unresolved_causes import MadeUp, cause, made_up, offset_or_spring, passed, twins, written

from dvrk_gravity import effects
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import Files, FittedHypothesis
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import ModelUncertainty, TorqueModel
from dvrk_gravity.planning import (
    STRONG,
    Plan,
    PlanLimits,
    Prediction,
    SeparationSettings,
    SolverSettings,
    TrueHypothesis,
    design_separation,
    load_unresolved,
    make_pair,
    rediagnosis_command,
)
from dvrk_gravity.simulate import PlantFile

BRIEF = SeparationSettings(
    duration=12.0, candidates=60,
    solver=SolverSettings(draws=8, starts=1, first=8, rounds=2, iterations=8, stiffness=3.0),
)  # fmt: skip


@pytest.fixture(scope="module")
def model() -> TorqueModel:
    return PlantFile.load("ecm").model


@pytest.fixture(scope="module")
def unclear(model) -> MadeUp:
    return offset_or_spring(model)


# --- the evidence that is expected


def test_the_expected_evidence_is_half_the_distance_from_all_that_the_other_explains():
    random = np.random.default_rng(0)
    columns = random.normal(size=(40, 7))
    first, second = np.zeros((7, 5)), np.zeros((7, 5))
    first[:3, :3] = second[:3, :3] = np.eye(3)
    first[3:5, 3:], second[5:, 3:] = random.normal(size=(2, 2, 2))
    apart = np.array([0.0, 0.0, 0.0, 1.0, 2.0, -1.0, 0.5])
    there = np.eye(40) + (y := columns @ second) @ y.T
    mean, gram = columns @ apart, columns.T @ columns

    def expects(gram):
        return TrueHypothesis(
            *(Prediction.of(gram, root) for root in (first, second)), apart
        ).expected_evidence(gram)

    value, slope = expects(gram)
    assert value == pytest.approx(0.5 * mean @ np.linalg.solve(there, mean))
    way = random.normal(size=(7, 7))
    way += way.T
    sides = [expects(gram + sign * 1e-6 * way)[0] for sign in (1, -1)]
    assert np.sum(slope * way) == pytest.approx((sides[0] - sides[1]) / 2e-6, rel=1e-5)


def test_the_gradient_of_the_evidence_is_its_slope_by_every_part_of_the_state(unclear):
    arm, random = unclear.model.arm, np.random.default_rng(0)
    # So short that more evidence still counts.
    limits, weight = PlanLimits.of(arm), np.full(30, 1e-3)
    objective = unclear.pairs().objective(9.0).over(np.arange(30.0))
    states = [random.uniform(limits.lower, limits.upper, (30, arm.n))]
    states += [random.normal(size=(30, arm.n)) * arm.scale for _ in range(2)]
    _, gradient = objective.gradient(State(*states), weight)
    way = random.normal(size=states[0].shape) * arm.scale
    sides = [
        objective.value(State(states[0] + sign * 1e-6 * way, *states[1:]), weight)
        for sign in (1.0, -1.0)
    ]
    assert np.sum(gradient[0] * way) == pytest.approx((sides[0] - sides[1]) / 2e-6, rel=1e-3)


def promised(of: MadeUp, *either: bool, evidence: float = 0.0) -> tuple[float, float]:
    """Return the evidence and the chance of a wider motion, with that for a spring before it."""
    unresolved = of.pairs()
    (pair,) = unresolved.pairs
    pair = replace(pair, second=replace(pair.second, evidence=evidence), required=either)
    motion, weight = passed(of.model, part=0.1), np.full(300, 10.0 / 300)
    objective = replace(unresolved, pairs=(pair,)).objective(10.0).over(motion.time)
    (found,) = objective.expected(objective.gram(State(motion.q, motion.qd, motion.qdd), weight))
    return found


def test_evidence_that_the_diagnosed_recordings_hold_counts_for_and_against(unclear):
    even, chance = promised(unclear, False, True)
    more, surer = promised(unclear, False, True, evidence=2.0)
    less, doubtful = promised(unclear, False, True, evidence=-2.0)
    assert less < even < more
    assert doubtful <= chance <= surer


def test_the_lesser_evidence_of_both_senses_is_promised(unclear):
    for evidence in (2.0, -2.0):
        senses = [
            promised(unclear, *either, evidence=evidence)
            for either in ((True, False), (False, True))
        ]
        both = promised(unclear, True, True, evidence=evidence)
        assert both == tuple(map(min, zip(*senses, strict=True)))


def test_that_a_simpler_cause_is_contained_in_another_at_its_place_need_not_be_shown(unclear):
    """A diagnosis takes the simpler one; but an offset at another joint is another cause."""
    ((offset, spring),) = unclear.groups
    assert make_pair(unclear.model, offset, spring).required == (False, True)
    assert make_pair(unclear.model, spring, offset).required == (True, False)
    elsewhere = cause(passed(unclear.model), "torque_offset", 0, 1.0, 0.1)
    assert make_pair(unclear.model, elsewhere, spring).required == (True, True)


# --- the plan


def test_the_plan_is_expected_to_separate_what_the_diagnosed_motion_does_not(unclear):
    limits = PlanLimits.of(unclear.model.arm)
    design = design_separation(unclear.pairs(), limits, settings=BRIEF)
    (expected,) = design.expected
    assert expected.planned > STRONG
    assert expected.separates
    assert expected.chance > 0.95
    assert not expected.why
    assert all(slack.left >= 0.0 for slack in design.slacks)


def test_the_plan_stays_where_the_model_was_identified(unclear):
    """Beyond, a diagnosis cannot tell a cause's torque from the model's own."""
    limits, none = PlanLimits.of(unclear.model.arm), np.zeros((4, 0))
    lower, upper = 0.7 * limits.lower + 0.3 * limits.upper, limits.upper - 0.1
    lower[3] = upper[3] = 0.0  # was not moved
    known = ModelUncertainty(
        {}, {}, none, none[:3], 0.01 * limits.effort, 8.0, np.full(4, 0.1), lower, upper,
        limits.velocity,
    )  # fmt: skip
    unresolved = unclear.pairs(replace(unclear.model, uncertainty=known))
    plan = design_separation(unresolved, limits, settings=BRIEF).plan
    q, _, _ = plan.motion.at(np.linspace(0.0, plan.duration, 400))
    assert ((q >= lower) & (q <= upper))[:, :3].all()
    assert np.ptp(q[:, 3]) > 0.0
    assert (plan.limits.lower == limits.lower).all()


def test_poses_are_chosen_where_two_springs_differ_at_rest(unclear):
    limits = PlanLimits.of(unclear.model.arm)
    design = design_separation(unclear.pairs(), limits, 30.0, poses=True, settings=BRIEF)
    assert design.separates
    pitch = design.plan.motion.poses[:, 1]
    assert np.ptp(pitch) > 0.5 * (limits.upper - limits.lower)[1]


def test_a_joint_that_stands_still_shows_nothing_for_friction_holds_it(model):
    """So a plan moves it, where its torques at rest alone differ most."""
    standing = passed(model)
    standing = replace(standing, qd=standing.qd * (np.arange(model.arm.n) != 1))
    offset, rest = (cause(standing, "torque_offset", joint, 1.0, 0.0) for joint in (1, 2))

    def gram_of(arm: Arm) -> np.ndarray:
        pairs = made_up(replace(model, arm=arm), (offset, rest)).pairs()
        objective = pairs.objective(10.0).over(standing.time)
        state = State(standing.q, standing.qd, standing.qdd)
        return np.diag(objective.gram(state, np.full(len(standing.q), 0.03)))

    rubbing, smooth = gram_of(model.arm), gram_of(replace(model.arm, frictionless=("pitch",)))
    assert rubbing[0] == 0.0
    assert smooth[0] > 0.0
    assert rubbing[1] == pytest.approx(smooth[1])
    assert rubbing[1] > 0.0


def test_what_is_the_same_torque_everywhere_is_not_separated(model):
    unresolved = made_up(model, twins(model)).pairs()
    design = design_separation(unresolved, PlanLimits.of(model.arm), settings=BRIEF)
    (expected,) = design.expected
    assert not design.separates
    assert expected.planned == pytest.approx(0.0, abs=1e-6)
    assert "same torque" in expected.why


def test_a_curve_that_bends_like_a_weight_is_never_shown_beside_it(model):
    """Of small errors a motion may show it: a parabola is no sine, but over a wide range."""
    motion = passed(model, part=0.2)
    spring = cause(motion, "elastic_cable", 1, [0.5, 0.02], 0.05)
    offset = cause(motion, "torque_offset", 1, 0.5, 0.05)
    both = made_up(model, (offset, spring)).pairs()
    limits = PlanLimits.of(model.arm)
    coarse, fine = (replace(both, coherent=error * np.ones(model.arm.n)) for error in (10.0, 1e-4))
    assert coarse.hidden(limits) == [(False, True)]  # the spring contains the offset
    assert fine.hidden(limits) == [(False, False)]


def test_a_curve_goes_on_beyond_the_way_that_it_was_fitted_on(model):
    """Fitted on both recordings it will not be held where the first one ended."""
    narrow, wide = passed(model), passed(model, part=0.2)
    curve, held = (
        next(
            FittedHypothesis(each, np.array([0.0, 0.0, 1.0]), np.eye(3))
            for each in effects.named("elastic_cable").hypotheses(narrow)
            if each.joints == (1,) and each.place == "degree 2"
        )
        for _ in range(2)
    )
    planned = curve.columns(wide)[:, 1, 2]
    assert np.ptp(planned) > 3.0 * np.ptp(held.hypothesis.regressor(wide)[:, 1, 2])


def test_a_cause_is_known_in_other_motions_where_a_file_holds_all_of_it(model):
    offset, _ = twins(model)

    def of(**setting: object) -> FittedHypothesis:
        return replace(offset, hypothesis=replace(offset.hypothesis, setting=setting))

    assert of(rest=0.1, of=None, at=("a", np.ones(2))).known_elsewhere
    for unknown in (of(shape=np.sin), of(at=[np.sin]), replace(offset, theta=np.array([np.inf]))):
        assert not unknown.known_elsewhere


# --- its files


def test_a_diagnosis_names_what_plans_the_separation_of_each_of_its_causes(model, unclear):
    diagnosis = example_diagnosis()
    files = Files.of(Path("out dir/findings.json"), Path("model.yaml"), [Path("run 1")])

    def following(causes: tuple[FittedHypothesis, ...], **changes: object) -> list[str | None]:
        """Return what comes next of all, of a finding, of an ambiguity."""
        (finding,), (ambiguity,) = diagnosis.findings, diagnosis.ambiguities
        content = replace(
            diagnosis, files=files, findings=(replace(finding, unresolved=causes),),
            ambiguities=(replace(ambiguity, unresolved=pair),), **changes,
        ).to_dict()  # fmt: skip
        return [content["next"], content["findings"][0]["next"], content["ambiguities"][0]["next"]]

    (pair,) = unclear.groups
    command, *rest = following(pair)
    assert shlex.split(command)[:4] == ["dvrk_gravity", "plan", "--separate", files.findings]
    assert rest == [command, None], "there is no sign of either of the ambiguity's causes"
    assert " --poses " in following(pair, motion=replace(diagnosis.motion, rate=None))[1]
    assert following(pair[:1]) == [None] * 3, "a clear finding"
    assert following(pair, against_reference=True) == [None] * 3
    said = replace(diagnosis, files=files, misplaced="link2").to_dict()
    assert (said["misplaced_payload"], said["unseparated"]["model"]) == ("link2", files.model)


def test_findings_are_read_again_with_the_model_that_they_name(unclear, tmp_path):
    before, path = unclear.pairs(), written(unclear, tmp_path)
    after = load_unresolved(path)
    assert [each.names for each in after.pairs] == [each.names for each in before.pairs]
    assert [each.required for each in after.pairs] == [each.required for each in before.pairs]
    np.testing.assert_allclose(after.noise, before.noise)
    motion = passed(before.model)
    for pairs in zip(after.pairs, before.pairs, strict=True):
        columns = [each.second.columns(motion) @ each.second.theta for each in pairs]
        np.testing.assert_allclose(*columns)


def test_findings_of_the_last_version_state_pairs(unclear, tmp_path):
    content = unclear.content()
    ((first, second),) = content["unseparated"].pop("groups")
    pair = {"between": [first, second], "either": [False, True], "again": 0.1}
    unclear.model.save(tmp_path / "model.yaml")
    content["unseparated"] |= {"pairs": [pair], "noise": [1.0], "coherent": [0.0]}
    (path := tmp_path / "findings.json").write_text(json.dumps(content))
    (found,) = load_unresolved(path).pairs
    assert found.required == (False, True)
    assert found.names == unclear.pairs().pairs[0].names


def test_findings_that_say_too_little_and_other_files_are_refused_by_name(unclear, tmp_path):
    for changes, words in (
        ({"groups": []}, "clear"),
        ({"model": None}, "--model"),
        ({"joints": ["yaw"]}, "ecm"),
        ({"groups": [[{"effect": "magic"}, {}]]}, r"groups\[0\]"),
        ({"groups": [[{}]]}, "two causes"),
        ({"lasted": -1.0}, "lasted"),
    ):
        path = written(unclear, tmp_path, **changes)
        with pytest.raises(ConfigError, match=words) as caught:
            load_unresolved(path)
        assert str(caught.value).startswith(f"{path}: ")
    with pytest.raises(ConfigError, match=r"unseparated\.joints"):
        load_unresolved(written(unclear, tmp_path), MODEL_FILE)
    for text in ('{"verdict": "ambiguous"}', "{}"):  # of an earlier version; of something else
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"findings\.json: "):
            load_unresolved(path)


def test_the_further_recording_is_diagnosed_together_with_the_first(unclear, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for first, poses, words in (
        (["../first bag"], False, "'{}/first bag' further --model {}/out/model.yaml"),
        (["a.csv"], True, "diagnose further --model"),  # poses beside a motion: by themselves
        ([], False, "diagnose RECORDING further --model"),
    ):
        command = rediagnosis_command(written(unclear, out, recordings=first), "further", poses)
        assert words.replace("{}", str(tmp_path)) in command
        assert command.endswith(f" --out {out}/both")


def test_the_verb_plans_what_separates_and_ends_with_status_1_where_nothing_does(
    model, unclear, tmp_path, capsys
):
    out = tmp_path / "separate.yaml"
    words = ["plan", "--duration", "12", "--time", "1", "--out", str(out)]
    assert main([*words, "--separate", str(written(unclear, tmp_path))]) == 0
    assert "torque_offset at pitch or elastic_cable at pitch" in capsys.readouterr().out
    assert Plan.load(out).duration == pytest.approx(12.0)
    assert out.with_suffix(".png").exists()
    out.unlink()
    same = written(made_up(model, twins(model)), tmp_path)
    assert main([*words, "--separate", str(same)]) == 1
    printed = capsys.readouterr().out
    assert " 0 %" in printed
    assert "Next" not in printed
