"""The comparison with other packages, as far as it needs none of them."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.identification import identify
from testing import mujoco_arms
from testing.lab_motion import draw_calibration

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmark" / "peers"))
import least_squares
from cases import SEED, forward
from exchange import Case, Fitted, Parameter, changed, least_eigenvalue
from forward import ForwardWorld
from outcome import METHODS, US, Outcome, Row
from page import SECTIONS, TITLE, better, page
from run import SCRIPTS, user_lines
from urdfs import write

REPOSITORY = Path(__file__).resolve().parents[1]
FOLDER = REPOSITORY / "benchmark" / "peers"
LINES = dict.fromkeys(METHODS, 10)
GOOD = Outcome([0.1, 0.2], 0.1, 0.1, 1.0, 0.2, (95, 100, 100), (2, 2),
               diagnoses=[{"cpu": 1.0, "found": [{"effect": "payload", "joint": "b"}]},
                          {"cpu": 1.0, "found": []}])  # fmt: skip
BAD = Outcome([0.2, 0.3], 0.2, 0.2, 9.0, 0.9, (50, 100, 120), (0, 2),
              diagnoses=[{"cpu": 9.0, "found": []},
                         {"cpu": 9.0, "found": [{"effect": "payload", "joint": "a"}]}])  # fmt: skip


def row(ours: Outcome, peers: Outcome) -> Row:
    outcomes = {method: ours if method == US else peers for method in METHODS}
    return Row("arm", "an arm", ["a", "b"], [("payload", "b"), ("nothing", "")], outcomes)


@pytest.fixture(scope="module")
def ur5(tmp_path_factory) -> Case:
    folder = tmp_path_factory.mktemp("ur5")
    arm = mujoco_arms.arm_of("ur5")
    assert write(arm, folder / "arm.urdf") == ""
    return Case(folder, list(arm.joint_names), arm.source, f"{folder / 'arm.urdf'}",
                arm.effort_limit.tolist(), 100.0)  # fmt: skip


def test_a_page_has_its_sections_in_order_and_a_peer_s_advantages_first():
    text = page([row(BAD, GOOD)], LINES, ["a real arm: no data"], "How.")
    assert text.startswith(TITLE)
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    assert headings == list(SECTIONS)
    ahead = "least squares 0.100, figaroh 0.100, figaroh LMI 0.100, mujoco.sysid 0.100, ours 0.200"
    assert f"arm, a: {ahead}. Why is not known." in " ".join(text.split())
    assert "Left out: a real arm: no data." in text
    assert "| figaroh | 1 of 1 | 1.0 | 0 of 1, 0 names | 1.00 |" in text
    assert f"| {US} | 0 of 1 | 0.0 | 1 of 1, 1 names | 9.00 |" in text


def test_the_first_table_sums_up_all_cases():
    text = page([row(GOOD, BAD), replace(row(GOOD, BAD), name="arm_four_minutes")], LINES, [], "")
    first = text[text.index(f"## {SECTIONS[0]}") : text.index(f"## {SECTIONS[1]}")]
    for line in (
        "| joints with the smallest error | 4 of 4 | 0 of 4 |",
        "| 95 % intervals that hold the truth | 95 % of 200 | 50 % of 200, 40 infinite |",
        "| links that a body can have | 4 of 4 | 0 of 4 |",
        "| hidden effects named first | 2 of 2 | 0 of 2 |",
        "| false alarms where nothing is hidden | 0 of 2 | 2 of 2 |",
        "| identification of four minutes at 1 kHz | 1.0 s, 0.20 GiB | 9.0 s, 0.90 GiB |",
    ):
        assert line in first


def test_nothing_is_called_better_that_is_worse_or_the_same():
    assert better([row(GOOD, BAD)], LINES) == []
    assert better([row(GOOD, GOOD)], LINES) == []


def test_a_peer_without_an_answer_is_listed_with_its_reason():
    text = page([row(GOOD, Outcome(failure="no optimal solution"))], LINES, [], "How.")
    assert "## Without an answer" in text
    assert "- arm, figaroh LMI: no optimal solution" in text


def test_the_page_in_the_documentation_is_what_the_command_writes():
    text = (REPOSITORY / "docs" / "peers.md").read_text()
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    assert headings[: len(SECTIONS)] == list(SECTIONS)
    assert text.startswith(f"{TITLE}\n\nWritten by `make peers` (seed ")
    for heading in ("of an identification", "mean of joints", "hidden"):
        assert f"| {heading} | {' | '.join(METHODS)} |" in text
    assert "Why is not known." not in text


def test_least_squares_recovers_the_links_of_a_known_arm(ur5):
    model = pin.buildModelFromUrdf(ur5.urdf)
    data, random = model.createData(), np.random.default_rng(1)
    time = np.arange(0.0, 15.0, 0.01)
    q, qd, qdd = draw_calibration(mujoco_arms.arm_of("ur5"), 1).at(time)
    viscous = np.array([3.0, 3.0, 2.0, 0.5, 0.5, 0.5])
    effort = np.array([pin.rnea(model, data, *s) for s in zip(q, qd, qdd, strict=True)])
    effort += viscous * qd + 0.01 * random.standard_normal(q.shape)
    header = ["time", *(f"{j}.position" for j in ur5.joints), *(f"{j}.effort" for j in ur5.joints)]
    np.savetxt(ur5.folder / "train.csv", np.column_stack([time, q, effort]), delimiter=",",
               header=",".join(header), comments="")  # fmt: skip
    fitted = least_squares.fit(ur5, "train.csv")
    left = (fitted.predict(q, qd, qdd) - effort)[100:-100]
    assert np.sqrt(np.mean(left**2, axis=0)) == pytest.approx(0.01, abs=0.03)
    values = {p.name: p.value for p in fitted.parameters}
    found = [values[f"fv_{joint}"] for joint in ur5.joints]
    assert found == pytest.approx(viscous, abs=0.1)
    assert np.abs(changed(fitted, fitted)).size == 0


def test_a_parameter_has_changed_whose_new_interval_excludes_the_old_value():
    old = Fitted(lambda *_: np.zeros(0), [Parameter("fs_a", 1.0, 0.1), Parameter("Ia_a", 1.0, 0.1)])
    new = replace(old, parameters=[Parameter("fs_a", 1.3, 0.1), Parameter("Ia_a", 1.05, 0.1)])
    assert [(c["effect"], c["joint"]) for c in changed(old, new)] == [("coulomb_friction", "a")]


def test_links_are_consistent_whose_pseudo_inertia_is_positive():
    body = pin.Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.01 * np.eye(3)).toDynamicParameters()
    assert least_eigenvalue(body) > 0.0
    assert least_eigenvalue(body * np.array([1, 1, 1, 1, 9, 1, 1, 1, 1, 1])) < 0.0


def test_mujoco_moves_an_arm_by_the_friction_and_rotors_that_are_called_its_own(ur5):
    world = ForwardWorld.draw("ur5", "friction", 3, Path(ur5.urdf).read_text())
    truth = world.truth(draw_calibration(world.arm, 3), 0.0, 2.0, 0.0)
    viscous, dry, rotors = world.parameters
    _, qd, qdd = truth.motion
    sure = np.abs(qd) > 0.1  # elsewhere MuJoCo's soft friction creeps
    expected = world.rigid.torque(*truth.motion) + viscous * qd + dry * np.sign(qd) + rotors * qdd
    left = np.where(sure, truth.effort - expected, 0.0)[500:]
    assert np.sqrt(np.mean(left**2, axis=0)) == pytest.approx(0.0, abs=0.05 * dry.max())
    assert sure.mean() > 0.3


def test_a_wrist_that_rubs_by_mujoco_s_law_gets_no_spring(tmp_path):
    """Where it turned round, a spring once removed 11 % of its held-out squared error."""
    case = forward(tmp_path / "ur5", "ur5", "friction", SEED).case
    cable = identify(tmp_path / "ur5" / "train.csv", case.arm, "joint").model.term("elastic_cable")
    assert cable is None or not cable.coefficients[1:].any()


def test_a_user_s_lines_are_counted_in_every_method():
    counts = {method: user_lines(script) for method, script in SCRIPTS.items()}
    assert 0 < counts[US] < 10
    assert all(20 < counts[method] < 120 for method in METHODS[1:])


def test_the_peers_environment_is_pinned_and_no_dependency_of_the_package():
    wanted = (FOLDER / "requirements.in").read_text().split()
    pins = (FOLDER / "requirements.lock").read_text().splitlines()[1:]
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", line) for line in pins)
    assert pins == sorted(pins, key=str.lower)
    names = {line.split("==")[0].lower() for line in pins}
    assert {name.split("[")[0] for name in wanted} <= names
    for file in ("setup.py", "requirements.in", "requirements.lock"):
        assert "figaroh" not in (REPOSITORY / file).read_text()
