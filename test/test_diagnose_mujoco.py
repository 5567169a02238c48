"""Recordings whose torques MuJoCo computed, with sensors of their own: an independent source."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import Gravity, LinkInertia
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.mujoco_arms import mtm
from testing.world import World

ARM = Arm.load("mtmr")
RATE, DURATION = 125.0, 18.0
DOWN = (0.0, 0.0, -9.81)
NOISE = np.array([0.02, 0.02, 0.02, 0.005, 0.002, 0.002, 0.001])
FRICTION = 0.05  # N·m, hidden on the wrist's platform


@pytest.fixture(scope="module")
def links() -> dict[str, pin.Inertia]:
    return dict(World.draw(21).links)


@pytest.fixture(scope="module")
def model(links) -> TorqueModel:
    """Gravity and inertia of those links, and nothing else."""
    world = replace(
        World.draw(0), arm=ARM, links=links, counterweight=np.zeros(14), gravity=np.array(DOWN)
    )
    terms = world.model().terms
    return TorqueModel(ARM, tuple(t for t in terms if isinstance(t, Gravity | LinkInertia)))


def recording(links, friction=0.0) -> Recording:
    """A motion of beating sines; velocity is a lagging difference of noisy positions."""
    random = np.random.default_rng(5)
    time = np.arange(int(RATE * DURATION)) / RATE
    size = np.array([0.4, 0.25, 0.25, 1.0, 1.0, 0.5, 1.5])
    first, second = random.uniform(0.15, 0.35, 7), random.uniform(0.4, 0.7, 7)
    q, qd, qdd = (np.zeros((len(time), 7)) for _ in range(3))
    for frequency, part in ((first, 0.7), (second, 0.3)):
        phase = 2 * np.pi * (np.outer(time, frequency) + random.uniform(0, 1, 7))
        omega = 2 * np.pi * frequency
        q += part * size * np.sin(phase)
        qd += part * size * omega * np.cos(phase)
        qdd -= part * size * omega**2 * np.sin(phase)
    effort = mtm("mtmr", links, DOWN).torque(q, qd, qdd)
    effort[:, 3] += friction * np.tanh(qd[:, 3] / 0.04)
    effort += NOISE * random.standard_normal(effort.shape)
    position = q + 1e-4 * random.standard_normal(q.shape)
    return Recording(JOINT_NAMES, time, position, None, effort, source="MuJoCo")


def test_mujoco_and_the_model_agree_so_nothing_is_found(links, model):
    assert diagnose(recording(links), model).findings == ()


def test_friction_added_to_mujocos_torques_is_found(links, model):
    diagnosis = diagnose(recording(links, FRICTION), model)

    (finding,) = diagnosis.findings
    assert (finding.effect, finding.joints) == ("coulomb_friction", ("wrist_platform",))
    assert finding.parameters["positive"].value == pytest.approx(FRICTION, rel=0.1)


def test_a_payload_on_mujocos_wrist_is_found(links, model):
    payload = pin.Inertia(0.05, np.array([0.0, 0.02, 0.03]), np.zeros((3, 3)))
    loaded = {**links, "link7": links["link7"] + payload}

    diagnosis = diagnose(recording(loaded), model)

    finding = diagnosis.findings[0]
    assert (finding.effect, finding.joints) == ("payload", ("wrist_roll",))
    assert finding.parameters["mass"].value == pytest.approx(0.05, rel=0.1)
