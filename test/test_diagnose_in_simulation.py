"""The extended model predicts the motion, and the arm itself stays where it is let go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.diagnosis.in_simulation import let_go
from dvrk_gravity.simulate.hidden import hide
from dvrk_gravity.simulate.model_plant import model_plant
from dvrk_gravity.simulate.world import World
from dvrk_gravity.terms import LinkInertia, State


@pytest.fixture(scope="module")
def weighted():
    """Return the arm as its model knows it, with a weight that it does not know, diagnosed."""
    known = World.draw(5)
    world, _ = hide(known, "payload", np.random.default_rng(5))
    recording = world.record(1, 2, 15.0, 100.0)
    return known, world, diagnose(recording, known.model(), simulated=True)


def test_the_extended_model_predicts_where_measured_efforts_bring_the_arm(weighted):
    _, _, diagnosis = weighted
    said = diagnosis.to_dict()["simulation"]["motion"]
    joint = max(diagnosis.before, key=lambda name: diagnosis.before[name] - diagnosis.after[name])

    assert said["windows"] >= 20
    assert said["rmse_after_rad"][joint] < 0.2 * said["rmse_before_rad"][joint]
    for name in JOINT_NAMES:  # and no joint is the worse for it
        assert said["rmse_after_rad"][name] < 1.1 * said["rmse_before_rad"][name] + 1e-3


def test_the_arm_itself_drifts_less_under_the_extended_model(weighted):
    known, world, diagnosis = weighted
    for pose in ([0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2], [-0.3, 0.5, -0.4, 1.0, 0.2, -0.2, 1.0]):
        given, extended = (
            np.abs(let_go(world.plant(), model, np.array(pose), 1.0)).max()
            for model in (known.model(), diagnosis.model)
        )
        assert given > np.radians(5.0)
        assert extended < 0.05 * given


def test_the_plant_of_identified_parameters_has_the_arm_s_mass_matrix():
    world = World.draw(6)
    model = world.model()
    links = model.term(LinkInertia.NAME)
    # Identified parameters are right in what acts only: links may weigh less than nothing.
    random = np.random.default_rng(0)
    regressor = links.regressor(State(*random.uniform(-1.0, 1.0, (3, 100, N_JOINTS))))
    regressor = regressor.reshape(100 * N_JOINTS, -1)
    silent = np.linalg.svd(regressor)[2][np.linalg.matrix_rank(regressor) :]
    assert len(silent) == 48  # of 90
    odd = links.with_theta(links.theta + random.normal(0.0, 0.3, len(silent)) @ silent)
    assert odd.links[:, 0].min() < 0.0
    terms = tuple(odd if isinstance(one, LinkInertia) else one for one in model.terms)

    arm, found = world.plant(), model_plant(replace(model, terms=terms))

    for q in random.uniform(model.arm.lower, model.arm.upper, (5, N_JOINTS)):
        arm.reset(q)
        found.reset(q)
        assert found.mass_matrix() == pytest.approx(arm.mass_matrix(), abs=1e-9)
