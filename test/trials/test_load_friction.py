"""Friction that grows with load: fitted beside the load of the other terms, and predicted."""

from __future__ import annotations

import numpy as np
from diagnosed import ARM, COULOMB, PITCH, ROTORS, VISCOUS, eye, moving

from dvrk_gravity import identify
from dvrk_gravity.identification import Fit
from dvrk_gravity.recording import Recording

PART = 0.08  # of the load of pitch


def read(part: float, seed: int) -> Recording:
    """Return half a minute of the small arm, with so much more friction by the load of pitch."""
    motion = moving(seed, 30.0)
    torque = motion.torque()
    before_gear = ARM.joint_effort(ROTORS * ARM.actuator_position(motion.qdd))
    before_gear += COULOMB * np.sign(motion.qd) + VISCOUS * motion.qd
    rubs = part * np.abs(torque - before_gear) * np.sign(motion.qd)
    return motion.read(torque + rubs * eye(PITCH), seed)


def fitted(part: float, terms: list[str] | None = None) -> Fit:
    return identify(read(part, 3), ARM, "joint", terms)


def test_friction_by_load_is_fitted_with_its_part_of_the_load_and_only_where_it_is():
    fit = fitted(PART)
    (found,) = (term for term in fit.model.terms if term.NAME == "load_friction")
    assert np.flatnonzero(found.part).tolist() == [PITCH]
    assert abs(found.part[PITCH] - PART) < 0.1 * PART
    without = fitted(PART, ["coulomb_friction", "viscous_friction", "rotor_inertia"])
    assert fit.held_out["pitch"].rmse < 0.3 * without.held_out["pitch"].rmse
    assert without.model.term("load_friction") is None

    other = read(PART, 4)
    q, qd = moving(4, 30.0).q, moving(4, 30.0).qd
    missed = other.effort - fit.model.torque(q, qd, moving(4, 30.0).qdd)
    fast = np.abs(qd[:, PITCH]) > 0.1
    assert np.sqrt(np.mean(missed[fast, PITCH] ** 2)) < 1.2 * 0.05


def test_an_arm_without_it_has_none():
    assert fitted(0.0).model.term("load_friction") is None
