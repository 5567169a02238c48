"""A load stays a load where slow motion shows its weight, and of its inertia little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import Payload, PayloadHypothesis, Site, State
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing.lab_motion import draw_calibration

FRICTION, NOISE, BIAS = 0.02, 0.002, 0.004  # of the largest efforts
INSERTION = 2


def recorded(
    name: str, seed: int, speed: float, noise: int,
    load: tuple[str, float, tuple[float, float, float]] | None = None,
) -> Recording:  # fmt: skip
    """Efforts by Pinocchio's inverse dynamics; beside a load the insertion's have a bias."""
    plant = PlantFile.load(name)
    arm, motion = plant.model.arm, draw_calibration(plant.model.arm, seed)
    motion = replace(motion, frequency=speed * motion.frequency)
    time = np.arange(0.0, 25.0, 0.01)
    q, qd, qdd = motion.at(time)
    tree = build_tree(arm, plant.links, arm.gravity)
    effort = np.array([tree.inverse_dynamics(*sample) for sample in zip(q, qd, qdd, strict=True)])
    largest = np.array([joint.effort_limit for joint in arm.joints])
    effort += FRICTION * largest * np.tanh(qd / 0.01)
    effort += NOISE * largest * np.random.default_rng(noise).standard_normal(effort.shape)
    if load is not None:
        link, mass, place = load
        carried = Payload(arm, link, mass, mass * np.array(place), arm.gravity)
        effort += carried.torque(State(q, qd, qdd))
        effort[:, INSERTION] += BIAS * largest[INSERTION]
    return Recording(joints=arm.joint_names, position=q, effort=effort, time=time)


@pytest.mark.parametrize(
    ("name", "seed", "speed", "mass", "place"),
    [
        ("ecm", 2, 0.4, 0.3, (0.03, 0.15, 0.0)),
        pytest.param("ecm", 2, 0.2, 0.3, (0.03, 0.15, 0.0), marks=pytest.mark.slow),
        pytest.param("psm", 1, 0.2, 0.2, (0.15, 0.02, 0.0), marks=pytest.mark.slow),
        pytest.param("psm", 2, 0.2, 0.2, (0.15, 0.02, 0.0), marks=pytest.mark.slow),
    ],
)
def test_a_load_in_slow_motion_is_no_displaced_centre_of_mass_nor_taken_off(
    name, seed, speed, mass, place
):
    """Nor is it on the insertion, whose bias some grams far away would explain.

    Its mass is in the interval, though the load is near the frame and only its moment shows.
    """
    bare = recorded(name, seed, speed, 1)
    loaded = recorded(name, seed, speed, 2, ("link2", mass, place))

    found = diagnose(loaded, arm=name, reference=bare).findings

    assert [(each.effect, each.joints) for each in found] == [
        ("payload", ("pitch",)), ("torque_offset", ("insertion",)),
    ]  # fmt: skip
    weighed = found[0].parameters["mass"]
    assert weighed.low <= mass <= weighed.high


@pytest.mark.parametrize(
    ("mass", "place", "near", "possible"),
    [(0.2, 0.8, True, True), (0.1, 1.5, False, True), (0.004, 5.0, False, False)],
)
def test_a_load_that_fits_best_far_away_is_tried_where_it_is_likely(mass, place, near, possible):
    psm = Arm.load("psm")
    free = PayloadHypothesis(
        arm=psm, site=Site.link(psm.body_names.index("link2")), setting=dict.fromkeys("xyz", 0.0)
    )
    theta = mass * np.array([1.0, 0.0, place, 0.0])

    there = free.confined(theta)

    assert (free.likely(theta), free.plausible(theta)) == (near, possible)
    assert (there is None) == possible
    if there is not None:
        assert there.setting == pytest.approx({"x": 0.0, "y": 1.0, "z": 0.0})
        assert there.likely(np.array([mass]))
        assert there.parameters(np.array([0.1]))["first_moment_y"] == pytest.approx(0.1)
        assert type(there.unconfined) is PayloadHypothesis


def test_a_load_that_fits_as_less_than_nothing_is_tried_where_its_weight_points():
    psm = Arm.load("psm")
    free = PayloadHypothesis(
        arm=psm, site=Site.link(psm.body_names.index("link2")), setting=dict.fromkeys("xyz", 0.0)
    )
    taken_off = np.array([-0.1, 0.0, 0.05, 0.0])

    assert free.confined(taken_off).setting["y"] == pytest.approx(1.0)
    assert replace(free, against_reference=True).confined(taken_off) is None
