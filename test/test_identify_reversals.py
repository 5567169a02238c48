"""What friction does where a joint turns round is not explained by a spring."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification import Fit, identify
from dvrk_gravity.recording import Recording

pytestmark = pytest.mark.usefixtures("four_folds")

RATE, DURATION = 100.0, 30.0
LEVEL = np.array([0.8, 0.35])  # N·m
NOISE = np.array([0.05, 0.02])  # N·m
LINK = """<link name="{0}"><inertial><mass value="{1}"/><origin xyz="0.2 0.01 0.02"/>
<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>
<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="{3}" velocity="3"/></joint>"""


@pytest.fixture(scope="module")
def urdf(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("reversals") / "two_links.urdf"
    path.write_text(
        '<robot name="two"><link name="base"/>'
        + LINK.format("a", 2.0) + LINK.format("b", 1.0)
        + JOINT.format("shoulder", "base", "a", 60) + JOINT.format("elbow", "a", "b", 20)
        + "</robot>"
    )  # fmt: skip
    return f"{path}"


def fitted(urdf: str, held: float, spring: float = 0.0) -> Fit:
    """Return the model of joints whose friction keeps its sign until they move again.

    Args:
        urdf: Of the arm.
        held: Part of the RMS speed below which a joint has not moved on yet.
        spring: Of the elbow, N·m/rad.
    """
    time = np.arange(0.0, DURATION, 1.0 / RATE)
    # Of one octave: a spring and an inertia are nearly the same.
    sines = ((0.30, 0.5, 0.0), (0.37, 0.3, 1.0), (0.45, 0.2, 2.5))

    def motion(t: np.ndarray, order: int) -> np.ndarray:
        factor = [2.0 * np.pi * f for f, _, _ in sines]
        return np.stack([
            sum(a * w**order * np.sin(w * t + p * (j + 1) + j + order * np.pi / 2.0)
                for w, (_, a, p) in zip(factor, sines, strict=True))
            for j in range(2)
        ], axis=1)  # fmt: skip

    q, qd, qdd = (motion(time, order) for order in range(3))
    model = pin.buildModelFromUrdf(urdf)
    data = model.createData()
    effort = np.array([pin.rnea(model, data, *s) for s in zip(q, qd, qdd, strict=True)])
    turning = np.abs(qd) < held * qd.std(axis=0)
    effort += LEVEL * np.where(turning, np.sign(q), np.sign(qd)) + 0.2 * qd
    effort[:, 1] += spring * q[:, 1]
    effort += NOISE * np.random.default_rng(5).standard_normal(q.shape)
    recording = Recording(("shoulder", "elbow"), time, q, None, effort)
    return identify(recording, Arm.load(urdf), "joint")


def stiffness(fit: Fit) -> np.ndarray:
    """Return (2,) slopes of the elastic torques in the model, N·m/rad."""
    term = fit.model.term("elastic_cable")
    return np.zeros(2) if term is None or len(term.coefficients) < 2 else term.coefficients[1]


@pytest.mark.parametrize("held", [0.03, 0.07])
def test_friction_that_reverses_late_is_no_spring(urdf, held):
    np.testing.assert_array_equal(stiffness(fitted(urdf, held)), 0.0)


def test_a_spring_beside_friction_that_reverses_late_is_found(urdf):
    assert stiffness(fitted(urdf, 0.05, spring=0.5))[1] == pytest.approx(0.5, rel=0.3)
