"""URDFs as people find them, from the file to a fit and a diagnosis."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robots import PANDA, ROBOTS, UR5
from urdf_texts import small

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.compensate import with_simulation
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.plain_world import PlainWorld

KINOVA = ROBOTS / "kinova_description" / "robots" / "kinova.urdf"
XARM = ROBOTS / "xarm_description" / "urdf" / "xarm7.urdf"
PLACEHOLDER = '<limit lower="-1" upper="2" effort="0" velocity="0"/>'
NONE = '<limit lower="-1" upper="2"/>'


@pytest.fixture(scope="module")
def motion(tmp_path_factory) -> Recording:
    """A recording of the small arm, which does not name it."""
    stated = Arm.load(small(tmp_path_factory.mktemp("arm")))
    world = PlainWorld.of(stated, nominal_inertias(stated))
    return replace(world.record(1, 10.0), arm=None)


def without_efforts(folder: Path, source: str | Path) -> str:
    """An arm's file that states no largest effort, and no velocity."""
    file, _, link = str(source).partition("#")
    text, path = Path(file).read_text(), folder / "robot.urdf"
    for key in ("effort", "velocity"):
        text = re.sub(rf'(<limit[^>]*?) {key}="[^"]*"', rf'\1 {key}="0"', text)
    path.write_text(text)
    return f"{path}#{link}" if link else str(path)


def test_an_assumed_effort_is_of_the_size_of_the_stated_one(tmp_path):
    for source in (UR5, KINOVA, XARM, f"{PANDA}#panda_hand"):
        stated = Arm.load(source).effort_limit
        ratio = Arm.load(without_efforts(tmp_path, source)).effort_limit / stated
        assert (ratio > 0.1).all(), source
        assert (ratio < 1.5).all(), source


def test_identify_and_convert_need_no_effort_limit(motion, tmp_path):
    path = small(tmp_path, limit=PLACEHOLDER)
    assert identify([motion], path, effects=["coulomb_friction"]).model.arm.n == 2
    assert main(["convert", str(path), str(tmp_path / "stated.yaml")]) == 0


def test_efforts_beyond_what_is_assumed_are_read(motion, tmp_path):
    """Nothing shows that they are in another unit, unless the masses do."""
    path = small(tmp_path, limit='<limit lower="-1.5" upper="2"/>')
    path.write_text(re.sub("<inertial>.*?</inertial>", "", path.read_text()))
    arm = Arm.load(path)
    most = np.abs(motion.effort).max(axis=0)
    loud = replace(motion, effort=motion.effort * 30.0 * arm.effort_limit / most)
    assert identify([loud], arm, effects=["coulomb_friction"]).model.arm.n == 2


def test_a_doubted_link_is_reported_before_any_finding_without_an_effort_limit(motion, tmp_path):
    path = small(tmp_path, limit=NONE, moments="0.01 0.01 0.09")
    fitted = identify([motion], path, effects=["coulomb_friction"])
    assert "link b" in str(fitted.warnings[0])
    assert fitted.verdict.level == "good"  # identification does not use the file's inertia
    diagnosis = with_simulation(diagnose(motion, TorqueModel.load(path)))
    assert "link b" in str(diagnosis.warnings[0])
    assert "link b" in json.loads(diagnosis.to_json())["data"]["warnings"][0]
