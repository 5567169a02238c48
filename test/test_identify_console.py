"""``identify --for-console``: what it writes, the console's file holds."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import first_slab
from known_mtm import ARM, SIZES, SPRING
from known_mtm import truth as motion
from known_poses import NOISE, RECORDED, between, grid, record
from known_poses import truth as arm_of_poses
from test_console import console_torque, convert

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES, build_tree
from dvrk_gravity.model import TorqueModel

pytestmark = pytest.mark.usefixtures("four_folds", "blank_pictures")


def written(files, folder):
    """Identify for the console and convert; return the model, the file and its cost."""
    words = [*map(str, files), "--arm", "mtmr", "--for-console", "--out", str(folder / "m.yaml")]
    with first_slab():
        assert command_line.run("dvrk_gravity.cli.identify", words) == 0
    path = folder / "gc-MTMR-3.json"
    assert convert(folder / "m.yaml", path, "--json", folder / "cost.json") == 0
    cost = json.loads((folder / "cost.json").read_text())
    return TorqueModel.load(folder / "m.yaml"), json.loads(path.read_text()), cost


@pytest.fixture(scope="module")
def from_motion(tmp_path_factory):
    folder = tmp_path_factory.mktemp("motion")
    motion(1, 12.0, 50.0).save(folder / "run.csv")
    return written([folder / "run.csv"], folder)


@pytest.fixture(scope="module")
def from_poses(tmp_path_factory):
    folder = tmp_path_factory.mktemp("poses")
    files = []
    for name, recording in zip(("pos", "neg"), record(arm_of_poses(), grid(4)), strict=True):
        files.append(folder / f"{name}.csv")
        # The roll axis carries nothing here: all that it shows is noise, of a size for its motor.
        effort = recording.effort * [1, 1, 1, 1, 1, 1, 0.05]
        replace(recording, effort=effort).save(files[-1])
    return written(files, folder)


def test_a_model_from_motion_loses_nothing_at_rest(from_motion):
    model, document, cost = from_motion
    assert len(model.term("gravity").beta) == 10
    assert max(joint["rest_max"] for joint in cost["joints"].values()) < 1e-9
    lower, upper = np.array([cost["range_rad"][name] for name in JOINT_NAMES]).T
    for q in np.random.default_rng(1).uniform(lower, upper, (100, 7)):
        expected = model.torque(q)
        np.testing.assert_allclose(console_torque(document, q, np.zeros(7)), expected, atol=1e-9)


def test_the_file_from_motion_holds_the_arm_that_was_recorded(from_motion):
    import pinocchio as pin

    _, document, cost = from_motion
    bodies = {body: pin.Inertia.FromSphere(mass, 0.05) for body, (mass, _) in SIZES.items()}
    for body, (_, centre) in SIZES.items():
        bodies[body].lever = np.array(centre)
    tree = build_tree(ARM, bodies, ARM.gravity)
    lower, upper = np.array([cost["range_rad"][name] for name in JOINT_NAMES]).T
    still = np.zeros(7)
    errors = []
    for q in np.random.default_rng(2).uniform(lower, upper, (200, 7)):
        weight = tree.inverse_dynamics(q, still, still)
        weight[4] += SPRING * q[4]
        errors.append(console_torque(document, q, still) - weight)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (rms < 0.003 * ARM.effort_limit).all(), rms


def test_a_model_from_poses_is_in_the_console_s_form(from_poses):
    model, _, cost = from_poses
    assert cost["exact"]
    assert {term.NAME for term in model.terms} == {"gravity", "directional_cable", "shown_torque"}
    assert model.term("directional_cable").positive.shape == (5, 7)
    assert max(joint["moving_max"] for joint in cost["joints"].values()) < 1e-9


def test_the_file_from_poses_says_what_both_directions_showed(from_poses):
    _, document, _ = from_poses
    document["GC_controller"]["fric_comp_ratio_vec"] = [1.0] * 7
    q = between(200)
    for sign in (1.0, -1.0):
        direction = np.full(7, sign)
        expected = arm_of_poses().torque(q, direction=np.tile(direction, (len(q), 1)))
        found = [console_torque(document, pose, 10.0 * direction) for pose in q]
        assert np.sqrt(np.mean(np.subtract(found, expected) ** 2, axis=0)).max() < 0.75 * NOISE


def test_real_poses_of_the_console_become_a_console_file(measured_data, tmp_path):
    model, document, cost = written([measured_data / name for name in RECORDED], tmp_path)
    assert cost["exact"]
    assert cost["findings"] == []
    q = between(50)
    for pose in q:
        expected = model.torque(pose, direction=np.ones(7))
        document["GC_controller"]["fric_comp_ratio_vec"] = [1.0] * 7
        found = console_torque(document, pose, np.full(7, 10.0))
        np.testing.assert_allclose(found[:6], expected[:6], atol=2e-3)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--terms", "viscous_friction"], "--terms"),
        (["--arm", "tilted.yaml"], "upright"),
        (["--arm", "other.yaml"], "an arm of the console"),
    ],
)
def test_what_does_not_go_with_the_console_is_refused(
    options, named, tmp_path, monkeypatch, capsys
):
    from support import CONFIG

    monkeypatch.chdir(tmp_path)
    text = (CONFIG / "arms" / "mtmr.yaml").read_text()
    for name, old, new in (
        ("tilted", "base_rpy: [0, 0, 0]", "base_rpy: [5, 0, 0]"),
        ("other", "name: mtmr", "name: mine"),
    ):
        assert old in text
        (tmp_path / f"{name}.yaml").write_text(text.replace(old, new))
    motion(1, 2.0).save(tmp_path / "run.csv")
    words = ["run.csv", "--for-console", "--arm", "mtmr", "--out", "m.yaml", *options]
    assert command_line.run("dvrk_gravity.cli.identify", words) == 2
    error = capsys.readouterr().err
    assert named in error
    assert error.count("\n") == 1
    assert not (tmp_path / "m.yaml").exists()
