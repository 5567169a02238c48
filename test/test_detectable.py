"""What a diagnosis would have found, and what it answers where nothing could have been seen."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import another, eye, identified, lab, seen

from dvrk_gravity.arrays import Array
from dvrk_gravity.command_line import run
from dvrk_gravity.diagnosis import Diagnosis, diagnose
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import diagnosis_page, diagnosis_text

WORN, MOTION = 1, 4  # the joint that rubs more; of the arm in the laboratory
WHY = "its second joint was not moved"


def recording(friction: float = 0.0) -> Recording:
    """Return another motion of it, with more dry friction at a joint, N·m."""
    sign = np.sign(another(MOTION).qd[:, WORN])
    return seen(another(MOTION), MOTION, friction * np.outer(sign, eye(WORN)))


def good(model: TorqueModel) -> TorqueModel:
    return model


def inflated(model: TorqueModel) -> TorqueModel:
    """Return a model that claims to be thirty times as uncertain as it is."""
    its = model.uncertainty
    assert its is not None
    deviations = {name: 30.0 * each for name, each in its.deviations.items()}
    wide = replace(
        its, deviations=deviations, offset=30.0 * its.offset, gravity=30.0 * its.gravity,
        error=30.0 * its.error,
    )  # fmt: skip
    return replace(model, uncertainty=wide)


def unfit(model: TorqueModel) -> TorqueModel:
    return replace(model, verdict="do_not_compensate", reason=WHY)


@cache
def found(spoil: Callable[[TorqueModel], TorqueModel], friction: float = 0.0) -> Diagnosis:
    return diagnose(recording(friction), spoil(identified().model))


def stated(diagnosis: Diagnosis) -> Array:
    """(n,) the least Coulomb friction that would have been found, N·m; NaN: none."""
    by_joint = json.loads(diagnosis.to_json())["detectable"]
    sizes = [by_joint[joint]["coulomb_friction"] for joint in diagnosis.after]
    return np.array(sizes, dtype=float)


def test_a_clean_recording_says_what_would_have_been_found():
    clean = found(good)
    sizes = clean.to_dict()["detectable"]

    assert (clean.verdict, clean.cannot_judge) == ("nothing_to_explain", ())
    assert (stated(clean) < 0.2 * clean.model.arm.effort_limit).all()
    for joint in clean.after:
        assert set(sizes[joint]) == {"coulomb_friction", "joint_offset", "torque_scale"}
    assert sizes["yaw"]["joint_offset"] is None  # about the vertical: no torque shows its zero
    assert 0.01 < sizes["payload"] < 1.0
    assert 0.002 < sizes["base_tilt"] < 0.2
    assert clean.model_verdict == identified().model.verdict != "unknown"


def test_twice_what_would_have_been_found_is_found_and_a_third_of_it_is_not():
    size = float(stated(found(good))[WORN])
    names = [
        [(each.effect, each.joints) for each in found(good, part * size).findings]
        for part in (2.0, 1.0 / 3.0)
    ]

    assert names == [[("coulomb_friction", (lab().arm.joint_names[WORN],))], []]


@pytest.mark.parametrize(("spoil", "times"), [(inflated, 0.0), (unfit, 2.0)])
def test_a_model_that_hides_everything_gives_no_clean_answer(spoil, times):
    answer = found(spoil, times * float(stated(found(good))[WORN]))

    certain = any(finding.certain for finding in answer.findings)
    assert answer.verdict == ("partly_explained" if certain else "cannot_judge")
    assert answer.to_dict()["cannot_judge"]
    shown = "\n".join(diagnosis_text(answer)), diagnosis_page(answer, ["motion.csv"])
    for text in shown:
        assert spoil is inflated or WHY in text
        assert ("do not compensate" if spoil is unfit else identified().model.verdict) in text


def test_the_less_certain_a_model_the_more_it_would_miss():
    wide, usual = stated(found(inflated)), stated(found(good))

    assert (np.nan_to_num(wide, nan=np.inf) > 3.0 * usual).all()


def test_no_answer_is_status_1(tmp_path, capsys):
    recording().save(tmp_path / "motion.csv")
    unfit(identified().model).save(tmp_path / "model.yaml")
    words = [str(tmp_path / "motion.csv"), "--model", str(tmp_path / "model.yaml")]

    status = run("dvrk_gravity.cli.diagnose", [*words, "--out", str(tmp_path / "out")])

    content = json.loads((tmp_path / "out" / "findings.json").read_text())
    assert (status, content["verdict"]) == (1, "cannot_judge")
    assert content["model_verdict"] == "do_not_compensate"
    assert WHY in capsys.readouterr().out
