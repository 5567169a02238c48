"""Momentum of an arm's bodies and the slope of their kinetic energy, beside Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import Arm, build_tree, rigid_body


@pytest.mark.parametrize("name", ["mtmr", "psm"])
def test_momentum_is_mass_times_velocity_and_its_slope_the_transposed_coriolis_matrix(name):
    arm, random = Arm.load(name), np.random.default_rng(3)
    bodies = {
        body.name: pin.Inertia(
            random.uniform(0.1, 1.0),
            random.normal(0.0, 0.1, 3),
            np.diag(random.uniform(0.01, 0.02, 3)),
        )
        for body in arm.bodies
    }
    tree = build_tree(
        arm, {b.name: b.frame.actInv(bodies[b.name]) for b in arm.bodies}, np.zeros(3)
    )
    parameters = np.concatenate([bodies[b.name].toDynamicParameters() for b in arm.bodies])
    q, qd = random.uniform(-0.7, 0.7, (2, 6, arm.n))

    momenta, slopes = rigid_body.momentum(arm, parameters, q, qd)

    for at, rate, momentum, slope in zip(q, qd, momenta, slopes, strict=True):
        mass = tree.mass_matrix(at)
        expand = tree.expand
        coriolis = pin.computeCoriolisMatrix(tree.model, tree.data, expand @ at, expand @ rate)
        np.testing.assert_allclose(momentum, mass @ rate, atol=1e-12)
        np.testing.assert_allclose(slope, expand.T @ coriolis.T @ (expand @ rate), atol=1e-12)
