"""Changes that no column has exactly: named once, with what they are."""

import known_ecm as ecm
import numpy as np
from monitored_ecm import ONSET, heard, later

SLIP = np.radians(2.0)


def cable(q, qd, qdd):
    torque, place = np.zeros_like(q), q[:, ecm.PITCH] / np.abs(q[:, ecm.PITCH]).max()
    torque[:, ecm.PITCH] = 0.15 * ecm.ARM.effort_limit[ecm.PITCH] * np.tanh(2.0 * place)
    return torque


def slip(q, qd, qdd):
    """Return what an encoder's slip adds: its joint is brought back to where it reads, at once."""
    time = np.arange(len(q)) * 0.01
    part = np.clip((time - ONSET) / 0.3, 0.0, 1.0)
    steps = [part**3 * (10.0 - 15.0 * part + 6.0 * part**2)]
    for _ in range(2):
        steps.append(np.gradient(steps[-1], 0.01))
    moved = [step[:, None] * SLIP * np.eye(ecm.ARM.n)[ecm.PITCH] for step in steps]
    there = [given - own for given, own in zip((q, qd, qdd), moved, strict=True)]
    return ecm.model().torque(*there) - ecm.model().torque(q, qd, qdd)


def test_a_cable_that_is_no_polynomial_is_named_once():
    (event,) = heard(later(cable))
    assert (event.kind, event.effect, event.joints) == ("change", "elastic_cable", ("pitch",))


def test_an_encoder_that_slips_is_named_though_the_arm_jumps():
    (event,) = [event for event in heard(slip) if event.kind != "push"]
    assert (event.effect, event.joints) == ("joint_offset", ("pitch",))
    assert event.values["offset"].low < SLIP < event.values["offset"].high
