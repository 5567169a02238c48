"""Identified links are bodies that can exist, by default, at the accuracy of a free fit."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from conftest import few_folds
from known_mtm import ARM, truth
from made_up_arm import made_up_arm, random_inertias
from test_psm_identified import recorded

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.cli.identify import add_arguments
from dvrk_gravity.effects import prior_scale
from dvrk_gravity.estimation import NormalEquations, Solution, fit
from dvrk_gravity.identification import (
    Fit,
    certificate,
    identify,
    physical_links,
    possible_links,
)
from dvrk_gravity.identification.trajectories import fit as trajectory_fit
from dvrk_gravity.model import Columns, TorqueModel
from dvrk_gravity.simulate import ModelArm, PlantFile
from testing.plain_world import PlainWorld

UR10E_GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)  # N·m/A, published


def least_eigenvalue(fitted: Fit) -> float:
    """Return the least eigenvalue of all links' pseudo-inertias, by Pinocchio."""
    links = fitted.model.term("link_inertia").links
    return min(
        np.linalg.eigvalsh(pin.PseudoInertia.FromDynamicParameters(row).toMatrix())[0]
        for row in links
    )


def both_ways(recording, arm: Arm) -> tuple[Fit, Fit]:
    """Return the fit by default, and that with whatever link parameters fit best."""
    with few_folds():
        return identify(recording, arm, "joint"), identify(recording, arm, "joint", physical=False)


def mean_error(fitted: Fit) -> float:
    return float(np.mean([error.nrmse for error in fitted.held_out.values()]))


@pytest.mark.parametrize("kind", ["mtm", "ecm", "chain", "ur10e"])
def test_links_are_bodies_by_default_and_the_held_out_error_is_that_of_a_free_fit(
    kind, tmp_path, request
):
    if kind == "ur10e":
        folder = request.getfixturevalue("measured_data") / "ur10e"
        if not folder.is_dir():
            pytest.skip(f"no measurements of a UR10e in {folder}")
        arm = Arm.load(folder / "ur10e.urdf").with_drive_gains(UR10E_GAINS)
        recording = folder / "ur10e_bare.csv"
    elif kind == "mtm":
        recording, arm = truth(1, 16.0), ARM
    elif kind == "ecm":
        plant = PlantFile.load("ecm")
        recording, arm = recorded(plant, 1, 16.0), plant.model.arm
    else:
        arm = made_up_arm(tmp_path)
        recording = PlainWorld.of(arm, random_inertias(arm, 3)).record(1, 16.0)

    physical, free = both_ways(recording, arm)

    assert set(physical.physical) == set(arm.body_names)
    assert min(physical.physical.values()) > 0.0
    assert least_eigenvalue(physical) > 0.0
    assert not free.physical
    assert mean_error(physical) < 1.01 * mean_error(free)


@pytest.fixture(scope="module")
def mtm() -> Fit:
    with few_folds(2):
        return identify(truth(1, 12.0), ARM, "joint")


def test_the_simulator_moves_an_identified_arm_as_it_is(mtm):
    assert ModelArm.of(mtm.model).off.max() < 1e-9


def test_a_saved_model_s_links_are_still_bodies_and_its_uncertainty_is_of_them(mtm, tmp_path):
    mtm.model.save(tmp_path / "m.yaml")
    loaded = TorqueModel.load(tmp_path / "m.yaml")
    links = loaded.term("link_inertia").links
    assert min(certificate(ARM, links.ravel()).values()) > 0.0
    assert loaded.uncertainty is not None
    assert loaded.uncertainty.fits(loaded.terms)


@pytest.mark.parametrize(
    ("option", "expected"), [([], None), (["--physical"], True), (["--no-physical"], False)]
)
def test_bodies_are_the_default_of_the_command_line_and_can_be_left_out(option, expected):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    arguments = parser.parse_args(["run.csv", "--arm", "mtmr", "--out", "m.yaml", *option])
    assert arguments.physical is expected


def fitted(masses: float, noise: float) -> tuple[Columns, list[int], Solution, np.ndarray]:
    """Return a fit to drawn spheres of some mass, kg, and the coefficients that are true."""
    columns = Columns(ARM, ARM.lower, ARM.upper)
    chosen = columns.select(effect="link_inertia")
    random = np.random.default_rng(5)
    rows = []
    for _ in ARM.body_names:
        body = pin.Inertia.FromSphere(masses, 0.08)
        body.lever = random.uniform(-0.03, 0.03, 3)
        rows.append(body.toDynamicParameters())
    q, qd, qdd = random.normal(size=(3, 200, 7))
    full = rigid_body.regressor(ARM, q, qd, qdd, ARM.gravity)
    y = full @ np.ravel(rows) + noise * random.normal(size=(200, 7))
    moments = NormalEquations.of(full @ columns.base, y)
    weight = np.full(7, max(noise, 1e-6) ** -2.0)
    solution = fit(moments, weight, columns.scale[chosen], columns.positive[chosen])
    true = (columns.base / prior_scale(ARM)[:, None] ** 2).T @ np.ravel(rows)
    return columns, chosen, solution, true


def test_a_fit_that_bodies_can_have_is_kept_exactly():
    columns, _, solution, _ = fitted(0.3, 1e-5)
    links = possible_links(columns, solution.theta)
    assert links is not None
    assert min(certificate(ARM, links).values()) > 0.0
    state = np.random.default_rng(0).normal(size=(3, 50, 7))
    full = rigid_body.regressor(ARM, *state, ARM.gravity)
    np.testing.assert_allclose(full @ links, full @ columns.base @ solution.theta, atol=1e-11)


def test_a_fit_that_no_bodies_can_have_moves_no_farther_than_to_the_truth():
    columns, chosen, solution, true = fitted(0.01, 0.02)
    assert possible_links(columns, solution.theta) is None
    theta, links = physical_links(columns, chosen, solution)
    assert min(certificate(ARM, links).values()) > 0.0

    def distance(there: np.ndarray) -> float:
        return float((there - solution.theta) @ solution.precision @ (there - solution.theta))

    assert 0.0 < distance(theta) < distance(true)
    # Towards the truth: bodies are a convex set, and a projection on it is no expansion.
    error, before = theta - true, solution.theta - true
    assert error @ solution.precision @ error < before @ solution.precision @ before


def test_links_of_a_realisable_fit_cost_no_second_fit(monkeypatch):
    monkeypatch.setattr(trajectory_fit, "physical_links", None)  # would fail if it were called
    stated = partial(possible_as_if, trajectory_fit.possible_links)
    monkeypatch.setattr(trajectory_fit, "possible_links", stated)
    with few_folds(2):
        free = identify(truth(1, 12.0), ARM, "joint", physical=False)
        kept = identify(truth(1, 12.0), ARM, "joint")
    q, qd, qdd = np.random.default_rng(3).uniform(-0.5, 0.5, (3, 20, 7))
    np.testing.assert_allclose(
        kept.model.torque(q, qd, qdd), free.model.torque(q, qd, qdd), atol=1e-9
    )
    assert {name: vars(error) for name, error in kept.held_out.items()} == {
        name: vars(error) for name, error in free.held_out.items()
    }


def possible_as_if(find, columns: Columns, base: np.ndarray) -> np.ndarray:
    """Return links of the fit's torque, whether or not they are bodies."""
    found = find(columns, base)
    return columns.base @ base if found is None else found


def test_a_console_s_model_is_of_bodies_too():
    with few_folds(2):
        found = identify(truth(1, 12.0), ARM, "joint", for_console=True)
    assert least_eigenvalue(found) > 0.0
    last = found.model.term("link_inertia").links[-1]
    np.testing.assert_array_equal(last[[1, 2]], 0.0)  # balanced about its axis


def test_signs_hold_beside_bodies():
    """Friction and rotors of the nearest bodies are not negative."""
    columns, chosen, solution, _ = fitted(0.01, 0.02)
    more = replace(
        solution,
        theta=np.append(solution.theta, 1e-9),
        precision=np.pad(solution.precision, (0, 1)),
        data=np.pad(solution.data, (0, 1)),
        free=np.append(solution.free, True),
    )
    more.precision[-1, -1] = 1.0
    coupling = 0.3 * np.sqrt(np.diag(solution.precision)) / len(solution.theta)
    more.precision[-1, :-1] = more.precision[:-1, -1] = coupling
    signed = int(np.flatnonzero(columns.positive)[0])
    theta, _ = physical_links(columns, [*chosen, signed], more)
    assert theta[-1] >= 0.0
