"""Limits far beyond an arm's defaults are a slip, unless they are stated to be meant."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.cli import calibrate, collect, plan
from dvrk_gravity.command_line import run
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.planning import Plan, PlanLimits, covering_plan, load_limits


@pytest.fixture
def fast(tmp_path):
    """A plan whose own limits say 900 deg/s for 90, by its path."""
    path = tmp_path / "fast.yaml"
    covering_plan(Arm.load("mtmr"), 30.0, 1).save(path)
    content = yaml_file.load(path)
    content["limits"]["joints"]["elbow_pitch"]["velocity"] = 900
    path.write_text(yaml_file.dump(content))
    return path


@pytest.mark.parametrize(
    ("rate", "value", "most"), [("velocity", 900, "180 deg/s"), ("acceleration", 200, "180 deg/s")]
)
def test_ten_times_a_default_is_refused(tmp_path, rate, value, most):
    arm, path = Arm.load("mtmr"), tmp_path / "limits.yaml"
    path.write_text(f"joints: {{elbow_pitch: {{{rate}: {value}}}}}")
    with pytest.raises(ConfigError, match="--beyond-defaults") as caught:
        load_limits(path, arm)
    assert all(token in str(caught.value) for token in ("elbow_pitch", str(value), most))
    limits = load_limits(path, arm, beyond_defaults=True)
    assert getattr(limits, rate)[2] == pytest.approx(np.radians(value))


def test_twice_the_defaults_and_the_defaults_are_taken(tmp_path):
    path = tmp_path / "limits.yaml"
    for name in ("mtmr", "psm", "ecm"):
        arm = Arm.load(name)
        covering_plan(arm, 30.0, 1).save(tmp_path / "plan.yaml")
        assert Plan.load(tmp_path / "plan.yaml").arm.name == name
        default = np.degrees(PlanLimits.of(arm).velocity[0])
        path.write_text(f"joints: {{{arm.joint_names[0]}: {{velocity: {2 * default}}}}}")
        load_limits(path, arm)


def test_a_plan_with_such_limits_moves_no_arm(tmp_path, fast, capsys):
    with pytest.raises(ConfigError, match="elbow_pitch"):
        Plan.load(fast)
    assert np.degrees(Plan.load(fast, beyond_defaults=True).limits.velocity[2]) > 899
    words = [str(fast), "--out", str(tmp_path / "bag"), "--simulated", "--yes"]
    assert run(collect.__name__, words) == 2
    said = capsys.readouterr().err
    assert "--beyond-defaults" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(
    ("verb", "words"),
    [
        (plan, ["--arm", "mtmr", "--out", "out.yaml"]),
        (calibrate, ["--arm", "mtmr", "--out", "out", "--simulated"]),
    ],
)
def test_what_takes_limits_refuses_them(tmp_path, monkeypatch, capsys, verb, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "limits.yaml").write_text("joints: {elbow_pitch: {velocity: 900}}")
    assert run(verb.__name__, [*words, "--limits", "limits.yaml"]) == 2
    assert "--beyond-defaults" in capsys.readouterr().err
