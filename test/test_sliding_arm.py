"""An arm whose joints all slide: its weight is the same everywhere, and all of it is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_folds

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

GANTRY = """
<robot name="gantry"><link name="base"/>
<link name="beam"><inertial><mass value="1.5"/><origin xyz="0.05 0.02 0.1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="hand"><inertial><mass value="1.3"/><origin xyz="0.05 0 0.1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="beam"/>
<axis xyz="0 0 1"/><limit lower="0" upper="0.3" effort="60" velocity="0.4"/>
<dynamics damping="0.4" friction="0.7"/></joint>
<joint name="slide" type="prismatic"><parent link="beam"/><child link="hand"/>
<origin xyz="0.1 0 0.2" rpy="0.3 0.2 0.1"/><axis xyz="1 1 0"/>
<limit lower="0" upper="0.3" effort="60" velocity="0.4"/></joint></robot>
"""


def recorded(model: TorqueModel, seed: int) -> Recording:
    random, time = np.random.default_rng(seed), np.arange(2000) / 100.0
    pace = 2.0 * np.pi * random.uniform(0.1, 0.6, (2, 3))
    phase = pace * time[:, None, None] + random.uniform(0.0, 6.0, (2, 3))
    q = 0.15 + 0.04 * np.sin(phase).sum(axis=2)
    qd, qdd = 0.04 * (pace * np.cos(phase)).sum(2), -0.04 * (pace**2 * np.sin(phase)).sum(2)
    effort = model.torque(q, qd, qdd) + 0.02 * random.normal(size=q.shape)
    return Recording(model.arm.joint_names, time, q, qd, effort)


@pytest.fixture(scope="module")
def gantry(tmp_path_factory) -> Arm:
    path = tmp_path_factory.mktemp("gantry") / "gantry.urdf"
    path.write_text(GANTRY)
    return Arm.load(str(path))


def test_it_is_identified_evaluated_and_diagnosed(gantry, tmp_path):
    truth = TorqueModel.stated(gantry)
    first, second = recorded(truth, 0), recorded(truth, 1)
    with few_folds():
        fit = identify(first, gantry)
        assert fit.verdict.level == "good"
        fit.model.save(tmp_path / "model.yaml")
        model = TorqueModel.load(tmp_path / "model.yaml")
        assert set(evaluate(model, second).expected) == {"lift", "slide"}
        assert diagnose(second, model).findings == ()
        bias = second.effort + np.array([3.0, 0.0])
        (finding,) = diagnose(replace(second, effort=bias), model).findings
    assert finding.joints == ("lift",)
