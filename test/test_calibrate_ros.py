"""Released through ROS: a compensator for each release, held at its end, and early if it drifts."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import TIMEOUT

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import LinearTerm
from dvrk_gravity.ros import PRIVATE, NodeProcess, RosRig
from dvrk_gravity.simulate import PlantFile

ARM = Arm.load("ecm")
NAMESPACE = f"{PRIVATE}/ECM"


@pytest.fixture
def rig(domain):
    """Return a simulated endoscope arm behind topics."""
    words = ("-p", "arm:=ecm", "-p", "rate:=200.0", "-r", "__node:=renamed")
    with NodeProcess("simulator", *words, namespace=NAMESPACE):
        yield RosRig(ARM, NAMESPACE, TIMEOUT)


def test_an_arm_is_moved_released_and_held_and_early_if_it_drifts(rig, tmp_path):
    model = PlantFile.of(ARM).model
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    model.save(good)
    weak = tuple(
        term.with_theta(0.4 * term.theta)
        if term.WEIGHT_OF_ARM and isinstance(term, LinearTerm)
        else term
        for term in model.terms
    )
    replace(model, terms=weak).save(bad)
    with rig.driver() as driver:
        pose = driver.connect()
    assert rig.simulated == f"the node {NAMESPACE}/renamed"
    assert (rig.release(good, pose, 1.0) < np.radians(0.5) * ARM.scale).all()
    begun = time.monotonic()
    assert (rig.release(bad, pose, 60.0) > np.radians(4.0) * ARM.scale).any()
    assert time.monotonic() - begun < 50.0
    with rig.driver() as driver:
        driver.connect()  # at rest: it is held
