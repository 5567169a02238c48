"""A model's terms sorted by what they ask of a time step: explicit, implicit, or complementary."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects import (
    CoulombFriction,
    DirectionalCable,
    ElasticCable,
    Gravity,
    LinkInertia,
    Payload,
    PreslidingHysteresis,
    RotorInertia,
    State,
    StribeckFriction,
    Term,
    TorqueOffset,
    ViscousFriction,
)
from dvrk_gravity.effects.polynomial import Range
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.tree import Tree, beta_tree

Array = NDArray[np.float64]

# A motor whose row is one joint's alone rubs where that joint does.
_EYE = np.eye(N_JOINTS)
# What is no torque at a state: of the sensors, with a past, or the mass matrix's business.
_OF_OTHERS = (TorqueOffset, PreslidingHysteresis, LinkInertia, RotorInertia)
# Friction acts downwards on what moves up, upwards on what moves down.
_SIGNS = np.array([[-1.0], [1.0]])


class Effects:
    """The terms of one model, prepared for evaluation at one state after another.

    * Smooth torques (gravity, elastic cable, the mean of a directional cable, any term that is
      no friction) are taken at the step's beginning.
    * Viscous friction becomes a constant damping matrix, taken at the step's end.
    * Dry friction becomes a level for each direction of each row that rubs: the joints first,
      then the motors that move more than one joint. Half of a directional cable's difference is
      dry friction; where a fit made it negative, its size counts, since friction dissipates.
      Stribeck friction adds to the levels what is left of it at the step's first velocity.

    A term's transition velocity, dead band and ratio are a compensator's caution, not physics,
    and are not used.

    Attributes:
        damping: (7, 7) viscous friction in joint space, N·m·s/rad.
        rows: (m, 7) joint velocities -> velocities of what rubs.
    """

    def __init__(self, model: TorqueModel, friction_scale: float = 1.0) -> None:
        """Sort the terms.

        Args:
            model: The arm's true terms.
            friction_scale: Factor on every friction, dry and viscous.

        Raises:
            ConfigError: A friction term that the time step has no form for.
        """
        self._weight: list[Tree] = []
        self._smooth: list[Term] = []
        self._polynomials: list[_Polynomials] = []
        self._stribeck: list[_Stribeck] = []
        self.damping = np.zeros((N_JOINTS, N_JOINTS))
        mixed = _mixed_motors(model.arm)
        self.rows = np.vstack([_EYE, model.arm.joint_to_actuator[mixed]])
        levels = np.zeros((2, len(self.rows)))
        for term in model.terms:
            if isinstance(term, CoulombFriction):
                levels += friction_scale * _levels(term, mixed)
            elif isinstance(term, StribeckFriction):
                self._stribeck.append(_Stribeck(term, friction_scale, mixed))
            elif isinstance(term, ViscousFriction):
                self.damping += friction_scale * _damping(term)
            elif isinstance(term, Gravity):
                if term.enabled:
                    self._weight.append(beta_tree(term.arm, term.beta, term.vector))
            elif isinstance(term, Payload):
                if term.weighs:
                    self._weight.append(term.weight)
            elif isinstance(term, ElasticCable):
                self._polynomials.append(_Polynomials(term.valid, term.coefficients))
            elif isinstance(term, DirectionalCable):
                mean = 0.5 * (term.positive + term.negative)
                half = 0.5 * friction_scale * (term.positive - term.negative)
                self._polynomials.append(_Polynomials(term.valid, mean, half))
            elif isinstance(term, _OF_OTHERS):
                continue
            elif term.FRICTION:
                raise ConfigError(
                    term.NAME, type(term).__name__, "a friction that the plant has a time step for"
                )
            else:
                self._smooth.append(term)
        rubs = np.ones(len(self.rows), dtype=bool)
        rubs[N_JOINTS:] = levels[:, N_JOINTS:].any(axis=0)
        for stribeck in self._stribeck:
            rubs |= stribeck.rows.any(axis=0)
        for stribeck in self._stribeck:
            stribeck.rows = stribeck.rows[:, rubs]
        self.rows = np.ascontiguousarray(self.rows[rubs])
        self._bounds = levels[:, rubs] * _SIGNS

    def smooth(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Evaluate everything that depends on the position.

        Args:
            q: (7,) rad.
            qd: (7,) rad/s.

        Returns:
            Smooth torques (7,) N·m, as the actuators would have to apply them, and what dry
            friction can do against the motion (2, m) N·m: least (moving up), at most 0, and
            greatest (moving down), at least 0.
        """
        torque = np.zeros(N_JOINTS)
        for tree in self._weight:
            # As Tree.gravity; for matrices this small, dot takes half the time of @.
            weight = pin.computeGeneralizedGravity(tree.model, tree.data, tree.expand.dot(q))
            torque += weight.dot(tree.expand)
        if self._smooth:
            state = State(q, qd)
            for term in self._smooth:
                torque += term.torque(state)
        bounds = self._bounds
        for polynomials in self._polynomials:
            value = polynomials.at(q)
            torque += value[:N_JOINTS]
            if len(value) > N_JOINTS:
                level = np.abs(value[N_JOINTS:])
                bounds = bounds.copy()
                bounds[0, :N_JOINTS] -= level
                bounds[1, :N_JOINTS] += level
        for stribeck in self._stribeck:
            bounds = bounds + _SIGNS * stribeck.at(qd)
        return torque, bounds


class _Polynomials:
    """Some (degree + 1, 7) sets of coefficients with one range, evaluated together."""

    def __init__(self, valid: Range, *sets: Array) -> None:
        self._lower, self._upper = valid.lower, valid.upper
        self._powers = np.ones(sets[0].shape)
        self._flat_powers = self._powers.reshape(-1)
        # One product of a vector and a sparse matrix is faster than seven short sums.
        diagonals = [np.vstack([np.diag(row) for row in one]) for one in sets]
        self._matrix = np.hstack(diagonals)

    def at(self, q: Array) -> Array:
        """Return (7 sets,) values at (7,) positions."""
        powers = self._powers
        if len(powers) > 1:
            held = np.maximum(q, self._lower)
            np.minimum(held, self._upper, out=held)
            powers[1:] = held
            np.multiply.accumulate(powers, axis=0, out=powers)
        return self._flat_powers.dot(self._matrix)


class _Stribeck:
    """What is left of Stribeck friction at a velocity, row by row of what rubs.

    Attributes:
        rows: (14, m) level of each row per level of each joint, then of each motor.
    """

    def __init__(self, term: StribeckFriction, scale: float, mixed: NDArray[np.bool_]) -> None:
        self._level = scale * np.concatenate([term.joint, term.motor])
        speed = np.concatenate([term.joint_velocity, term.motor_velocity])
        used = self._level > 0.0
        inverse = np.where(used, 1.0 / np.where(used, speed, 1.0), 0.0)
        self._motion = inverse[:, None] * np.vstack([_EYE, term.arm.joint_to_actuator])
        mine = np.hstack([np.diag(np.where(mixed, 0.0, 1.0)), np.eye(N_JOINTS)[:, mixed]])
        joints = np.hstack([_EYE, np.zeros((N_JOINTS, int(mixed.sum())))])
        self.rows = np.where(used[:, None], np.vstack([joints, mine]), 0.0)

    def at(self, qd: Array) -> Array:
        """Return (m,) levels at (7,) velocities, N·m."""
        ratio = self._motion.dot(qd)
        return (self._level * np.exp(-ratio * ratio)).dot(self.rows)


def _mixed_motors(arm: Arm) -> NDArray[np.bool_]:
    """Return (7,) mask of the motors that are not just one joint's."""
    off: Array = np.abs(arm.joint_to_actuator - _EYE)
    return np.max(off, axis=1) > 1e-12


def _levels(term: CoulombFriction, mixed: NDArray[np.bool_]) -> Array:
    """Return (2, 7 + mixed) Coulomb levels, up and down; motors of one joint join its row."""
    levels = []
    for joint, motor in (
        (term.joint_positive, term.motor_positive),
        (term.joint_negative, term.motor_negative),
    ):
        levels.append(np.concatenate([joint + np.where(mixed, 0.0, motor), motor[mixed]]))
    return np.array(levels)


def _damping(term: ViscousFriction) -> Array:
    to_motor = term.arm.joint_to_actuator
    return np.diag(term.joint) + to_motor.T @ np.diag(term.motor) @ to_motor
