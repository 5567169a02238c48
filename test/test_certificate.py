"""What a certificate requires and says, and the further motions that it may take."""

from __future__ import annotations

import json
from dataclasses import replace
from html import escape
from math import nan

import numpy as np
import pytest
from finished_calibration import BRIEF, RELEASED, Finished, finished_calibration

from dvrk_gravity.calibration import certify, format_drift, hold_ratio, largest_drift, random_poses
from dvrk_gravity.identification import POOR, identify
from dvrk_gravity.planning import Plan, PlanLimits


@pytest.fixture(scope="session")
def finished() -> Finished:
    return finished_calibration()


def certified(finished: Finished, diagnosis=None, motion=RELEASED, settings=BRIEF, **changed):
    """Return the certificate with other values in some of the files."""
    fit, check, release = (
        finished.content(name) for name in ("model_0.json", "check.json", "release.json")
    )
    fit["verdict"] |= {"overall": "good", **changed.pop("verdict", {})}
    check["levels"] = dict.fromkeys(finished.arm.joint_names, "good") | changed.pop("levels", {})
    release |= {"drift": [[0.0] * finished.arm.n] * 3} | changed.pop("release", {})
    fit["held"]["joints"] |= changed.pop("held", {})
    assert not changed
    return certify(
        finished.arm, settings, fit, check, release,
        diagnosis or {"findings": [], "ambiguities": []}, motion, namespace="/SMALL", simulated="",
        date="", versions={}, files={}, model="model.yaml",
    )  # fmt: skip


def test_a_certificate_is_refused_for_each_of_its_reasons_alone(finished):
    assert certified(finished).certified

    def drifted(*degrees: float) -> dict:
        away = [[0.0, np.radians(each)] for each in degrees]
        return {"release": {"drift": away}}

    assert certified(finished, **drifted(0.499, 0.0, 0.0)).certified
    assert certified(finished, motion=replace(RELEASED, seconds=600.0)).certified
    for changed, tokens in (
        (drifted(0.501, 0.0, 3.0), ("2 of 3", "0.5 deg", "3.00 deg", "pitch")),
        (drifted(0.0, nan, 0.0), ("1 of 3", "0.5 deg")),
        (drifted(0.0, 0.0), ("2 of 3",)),
        ({"release": {"drift": [], "why": "a hand"}}, ("0 of 3", "a hand")),
        ({"levels": {"pitch": POOR}}, ("pitch",)),
        ({"verdict": {"overall": POOR, "reason": "noise"}}, ("noise",)),
        ({"motion": replace(RELEASED, seconds=700.0)}, ("11.7 min", "10")),
    ):
        found = certified(finished, **changed)
        assert not found.certified, changed
        (said,) = found.reasons
        assert all(token in said for token in tokens), said
        assert said in found.verdict


def test_held_poses_and_the_largest_drift_of_each_joint_are_counted(finished):
    drift = [[0.0, np.radians(0.4)], [np.radians(0.6), 0.0], [np.radians(0.2), np.radians(0.1)]]
    found = certified(finished, release={"drift": drift})
    assert (found.held, found.poses) == (2, 3)
    assert [joint.drift for joint in found.joints] == pytest.approx(np.radians([0.6, 0.4]))


def test_what_there_is_no_sign_of_was_not_found_but_stays_unknown(finished):
    pairs = [
        {"sentence": "a zero and a tilt", "suspected": False},
        {"sentence": "a zero or another", "suspected": True},
    ]
    findings = [{"sentence": "a load", "certainty": "certain"}]
    found = certified(finished, {"findings": findings, "ambiguities": pairs})
    assert found.findings == ("a load", "a zero or another")
    assert "a zero and a tilt" in found.unknown
    assert "a zero or another" not in found.unknown


def test_a_joint_that_less_friction_may_not_hold_is_among_what_is_unknown(finished):
    for sure, said in ((1.0, False), (0.98, True)):
        found = certified(finished, held={"pitch": sure})
        lines = [line for line in found.unknown if line.startswith("pitch: with 10 %")]
        assert bool(lines) == said
        assert not said or "2.0 % of poses" in lines[0]


def test_a_drift_is_no_more_exact_than_it_is():
    for drift, unit, text in (
        (0.0, "rad", "0.00 deg"), (8e-5, "rad", "< 0.01 deg"), (2e-4, "rad", "0.01 deg"),
        (np.radians(14.44), "rad", "14.44 deg"), (1e-6, "m", "< 0.01 mm"), (9e-4, "m", "0.90 mm"),
    ):  # fmt: skip
        assert format_drift(drift, unit) == text
    assert largest_drift(0.0) == "< 0.01 deg"  # none of zero is claimed
    assert largest_drift(2e-4) == "at most 0.01 deg"


def test_the_certificate_of_a_calibration_has_what_its_files_say(finished):
    found = finished.content("certificate.json")
    last = max(path.name for path in finished.folder.glob("model_*.json"))
    fit, check = finished.content(last), finished.content("check.json")
    assert found["certified"] == (not found["reasons"])
    assert found["poses"] == BRIEF.poses
    assert found["motion"]["used"] <= 1.0 + 1e-9
    moved = BRIEF.motion_duration + BRIEF.check_duration
    assert found["motion"]["commands"] > 1000.0 * moved
    assert found["motion"]["seconds"] > moved + BRIEF.poses * BRIEF.release_duration
    for joint in found["joints"]:
        name = joint["name"]
        assert joint["sure"] == fit["held"]["joints"][name]
        assert joint["nrmse"] == check["joints"][name]["nrmse"]
        assert joint["level"] == check["levels"][name]
    page = (finished.folder / "certificate.html").read_text()
    assert escape(found["verdict"][1:]) in page
    assert "Simulated: a path" in (finished.folder / "model.yaml").read_text()


def test_the_band_of_what_holds_a_joint_counts_what_the_model_lacks(finished):
    """A cable that the fit may not have: its own columns do not show it, omitted ones do."""
    arm = finished.arm
    fit = identify(str(finished.folder / "motion"), arm, effects=["coulomb_friction"])
    poses = np.random.default_rng(0).uniform(*arm.range, (200, arm.n))
    error = np.sqrt(np.mean(fit.rest_error(poses) ** 2, axis=0))
    known = [fit.holding[name].error_anywhere for name in arm.joint_names]
    np.testing.assert_allclose(error, known)  # the same poses, and the same function
    ratio = hold_ratio(fit, poses, 0.1)
    friction = np.array([fit.holding[name].friction for name in arm.joint_names])
    np.testing.assert_allclose(ratio * 0.1 * friction, 1.96 * fit.rest_error(poses))
    # At which poses friction holds is counted among those within limits and identified range.
    held, limits = finished.content("model_0.json")["held"], PlanLimits.of(arm)
    own = random_poses(arm, limits, fit.model, 1)
    for lower, upper in (
        (limits.lower, limits.upper),
        (fit.model.uncertainty.lower, fit.model.uncertainty.upper),
    ):
        offset = 0.0 if lower is limits.lower else fit.model.joint_offset
        assert ((own >= lower + offset - 1e-12) & (own <= upper + offset + 1e-12)).all()
    assert held["part"] <= min(held["joints"].values()) == held["joints"][held["least"]]


@pytest.fixture
def further(finished, tmp_path):
    """Return what plans the first further motion, of other findings and with less friction."""
    folder = finished.before("plan further_1", tmp_path / "again")

    def plan(part: float = 1.0, following: str | None = None, unseparated=None, settings=BRIEF):
        left = {"model": "model_0.yaml", **(unseparated or {"groups": []})}
        for name, change in (
            ("diagnosis_0.json", {"next": following, "unseparated": left}),
            ("model_0.json", {"held": {"part": part, "least": "pitch"}}),
        ):
            content = json.loads((finished.folder / name).read_text())
            (folder / name).write_text(json.dumps(content | change))
        # What they contain is changed: the step is asked alone.
        return finished.take("plan further_1", folder, settings=settings, changed=True)

    return plan


def test_a_joint_that_friction_may_not_hold_is_measured_further_while_time_is_left(further):
    sure = 0.95 ** (1.0 / BRIEF.poses)  # of the arms 95 % are to hold themselves at all poses
    assert not further(sure + 1e-6).paths
    outcome = further(sure - 1e-6)
    assert [path.name for path in outcome.paths] == ["further_1.yaml", "further_1.png"]
    assert "pitch" in outcome.summary
    assert Plan.load(outcome.paths[0]).duration == BRIEF.further_duration
    late = further(0.5, settings=replace(BRIEF, max_duration=30.0))
    assert not late.paths
    assert "0.5 min" in late.summary


def test_without_a_want_there_is_no_further_motion(further):
    assert further(1.0, settings=replace(BRIEF, max_duration=1.0)).summary == ""
