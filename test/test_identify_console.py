"""``identify --for``: what it writes, the console's file holds, or a URDF, or an MJCF."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from known_mtm import ARM, SIZES, SPRING
from known_mtm import truth as motion
from known_poses import NOISE, between, grid, record
from known_poses import truth as arm_of_poses
from support import CONFIG

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES, build_tree
from dvrk_gravity.model import TorqueModel


def run(verb: str, *words: object) -> int:
    return command_line.run(f"dvrk_gravity.cli.{verb}", [str(word) for word in words])


def written(files, folder):
    """Identify for the console and convert, there and back.

    Return the model, the console's as a model, and what the conversion costs.
    """
    model, console, cost = (folder / name for name in ("m.yaml", "gc-MTMR-3.json", "cost.json"))
    assert run("identify", *files, "--arm", "mtmr", "--for-console", "--out", model) == 0
    assert run("convert", model, console, "--json", cost) == 0
    assert run("convert", console, folder / "back.yaml") == 0
    back = TorqueModel.load(folder / "back.yaml")
    return TorqueModel.load(model), back, json.loads(cost.read_text())


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


def test_a_model_from_motion_loses_nothing_at_rest_and_holds_the_arm_that_was_recorded(from_motion):
    model, back, cost = from_motion
    assert max(joint["rest_max"] for joint in cost["joints"].values()) < 1e-9
    last = model.term("link_inertia").links[-1]
    np.testing.assert_array_equal(last[[1, 2]], 0.0)  # balanced about its axis
    lower, upper = np.array([cost["range_rad"][name] for name in JOINT_NAMES]).T
    q = np.random.default_rng(1).uniform(lower, upper, (200, 7))
    np.testing.assert_allclose(back.torque(q), model.torque(q), atol=1e-9)
    bodies = {body: pin.Inertia.FromSphere(mass, 0.05) for body, (mass, _) in SIZES.items()}
    for body, (_, centre) in SIZES.items():
        bodies[body].lever = np.array(centre)
    tree, still = build_tree(ARM, bodies, ARM.gravity), np.zeros(7)
    weight = np.array([tree.inverse_dynamics(pose, still, still) for pose in q])
    weight[:, 4] += SPRING * q[:, 4]
    rms = np.sqrt(np.mean((back.torque(q) - weight) ** 2, axis=0))
    assert (rms < 0.003 * ARM.effort_limit).all(), rms


def test_a_file_from_poses_says_what_both_directions_showed(from_poses):
    model, back, cost = from_poses
    assert cost["exact"]
    assert max(joint["moving_max"] for joint in cost["joints"].values()) < 1e-9
    assert model.term("directional_cable").positive.shape == (5, 7)
    q = between(200)
    for sign in (1.0, -1.0):
        direction = np.full(q.shape, sign)
        expected = arm_of_poses().torque(q, direction=direction)
        found = back.torque(q, direction=direction)
        assert np.sqrt(np.mean((found - expected) ** 2, axis=0)).max() < 0.75 * NOISE


def test_a_model_for_a_urdf_loses_nothing_there_nor_in_an_mjcf(tmp_path, capsys):
    recording, model, cost = (tmp_path / name for name in ("run.csv", "m.yaml", "cost.json"))
    motion(1, 12.0, 50.0).save(recording)
    assert run("identify", recording, "--arm", "mtmr", "--for", "urdf", "--out", model) == 0
    for kind in ("urdf", "mjcf"):
        assert run("convert", model, tmp_path / f"arm.{kind}", "--json", cost) == 0
        assert json.loads(cost.read_text())["left_out"] == []
    assert "coulomb_friction" in model.read_text()
    assert run("replay", recording, "--model", model) == 2
    assert f"convert {recording} {tmp_path / 'run_bag'}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--for", "urdf", "--terms", "viscous_friction"], "--terms"),
        (["--terms", "viscous_friction"], "--terms"),
        (["--arm", "tilted.yaml"], "upright"),
        (["--arm", "other.yaml"], "an arm of the console"),
    ],
)
def test_what_does_not_go_with_the_console_is_refused(
    options, named, tmp_path, monkeypatch, capsys
):
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
    assert run("identify", *words) == 2
    error = capsys.readouterr().err
    assert named in error
    assert error.count("\n") == 1
    assert not (tmp_path / "m.yaml").exists()


def test_a_solver_that_is_missing_is_said_before_the_fit(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    motion(1, 2.0).save(tmp_path / "run.csv")
    assert run("identify", tmp_path / "run.csv", "--arm", "mtmr", "--out", tmp_path / "m.yaml") == 2
    assert "pip install clarabel" in capsys.readouterr().err
