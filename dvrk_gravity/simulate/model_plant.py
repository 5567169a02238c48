"""The arm that a torque model describes, as a plant that moves: with bodies that can exist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import PER_LINK, Arm, link_frames, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import assumed_rotors, motor_columns, prior_scale
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import certificate, nearest_bodies
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate.plant import Plant
from dvrk_gravity.simulate.plant_file import PlantFile


@dataclass(frozen=True)
class CompletionSettings:
    """How bodies and rotors that can exist are found for a model's inertia.

    Attributes:
        states: At so many torques are compared, a torque a joint each. Chosen: 420 torques of an
            MTM for the 42 combinations of parameters that act.
        fastest: Velocity and acceleration of these states, rad/s and rad/s^2 (``Arm.scale``).
            Chosen: both kinds of torque are then of one size.
        hold: How firmly what no torque shows is held at the known arm's. Chosen: enough to decide.
        rank: Part of the largest direction below which one is rounding.
        absurd: Times the known arm's torque: no arm's, and the search would overflow.
    """

    states: int = 60
    fastest: float = 2.0
    hold: float = 1e-4
    rank: float = 1e-9
    absurd: float = 1e3


@dataclass(frozen=True, eq=False)
class ModelArm:
    """What moves as a model says: its terms, and bodies that can exist.

    Attributes:
        model: The terms that act on the arm, inertia apart.
        links: Inertia of the links, each in its distal DH frame.
        rotors: (n,) reflected inertia at the motors, kg·m^2.
        inertia_error: (n,) RMS torque by which this inertia differs from the model's, as a part of
            the RMS torque that a known arm's inertia takes in the same motion; ``None`` of a model
            that has no inertia.
        inertia_source: Where the known inertia is from, in words.
    """

    model: TorqueModel
    links: Mapping[str, pin.Inertia]
    rotors: Array
    inertia_error: Array | None
    inertia_source: str

    @classmethod
    def of(cls, model: TorqueModel, settings: CompletionSettings | None = None) -> ModelArm:
        """Return the arm of a model.

        Torque depends on some combinations of the link parameters only (of an MTM on 42 of 90),
        and identified ones need be no bodies' at all. Of all bodies with positive density, and
        rotors that are not negative, these have the torque that is nearest to the model's; what no
        torque shows is near that of the known arm (:meth:`PlantFile.of`). A model without link
        inertia gets all of that arm's: it balances the same, but does not fall as fast.

        Raises:
            ConfigError: Inertia that is not finite, or no arm's.
        """
        settings = settings or CompletionSettings()
        inertia = [term for term in model.terms if term.OF_LINKS == PER_LINK]
        rotors = {term: r for term in model.terms if (r := term.plant().rotors) is not None}
        own = tuple(t for t in model.terms if t not in inertia and t not in rotors)
        still = replace(model, terms=own).physical()
        known = PlantFile.of(model.arm)
        if not inertia:
            return cls(still, known.links, known.rotor_inertia, None, known.source)
        links = {t.NAME: rows for t in inertia if (rows := t.inertial_parameters) is not None}
        motor = np.sum([0.0 * known.rotor_inertia, *rotors.values()], axis=0)
        return cls(
            still, *_complete_inertia(model.arm, links, motor, known, settings), known.source
        )

    def plant(self, friction_scale: float = 1.0) -> Plant:
        """Return the plant, at rest at zero position, with a factor on every friction."""
        return Plant(self.model, self.links, self.rotors, friction_scale)


def _complete_inertia(
    arm: Arm, links: Mapping[str, Array], motor: Array, known: PlantFile,
    settings: CompletionSettings,
) -> tuple[dict[str, pin.Inertia], Array, Array]:  # fmt: skip
    """Return links and rotors that can exist, and by what part their torque is another.

    Args:
        arm: The arm.
        links: (bodies, 10) parameters by the names of the effects that state them.
        motor: (n,) reflected inertia at the motors.
        known: What is known of the arm.
        settings: How they are found.
    """
    frames, own = link_frames(arm), np.sum(list(links.values()), axis=0).ravel()
    nothing = pin.Inertia.Zero()
    middle = np.concatenate(
        [frames[name].act(known.links.get(name, nothing)).toDynamicParameters()
         for name in arm.body_names]
    )  # fmt: skip
    (q, qd, qdd), count = _motion(arm, settings), settings.states
    size = np.where(known.rotor_inertia > 0.0, known.rotor_inertia, assumed_rotors(arm))
    of_links = rigid_body.regressor(arm, q, qd, qdd, np.zeros(3))
    of_rotors = motor_columns(arm, arm.actuator_position(qdd) * size)
    # Each joint's torque in proportion to what is usual there: the roll's counts as the yaw's.
    usual = np.sqrt(np.mean((of_links @ middle + of_rotors.sum(axis=2)) ** 2, axis=0))
    per_row = 1.0 / (usual[:, None] * np.sqrt(count))
    of_links, of_rotors = (
        (columns * per_row).reshape(count * len(motor), -1) for columns in (of_links, of_rotors)
    )
    right = of_links @ own + of_rotors @ (motor / size)
    if not np.abs(right).max() < settings.absurd:
        raise ConfigError(
            ", ".join(links),
            f"{np.abs(right).max() * np.sqrt(count):.2g} times the torque of the links of "
            f"{known.source}",
            "the inertia of an arm",
        )
    # The same squares from fewer rows.
    orthogonal, triangle = np.linalg.qr(np.column_stack([of_links, of_rotors, right]))
    seen, goal = triangle[:, :-1], triangle[:, -1]
    scale = prior_scale(arm)
    bodies = len(scale)
    unit = np.concatenate([scale, np.ones_like(motor)])

    def exist(both: Array) -> bool:
        return min(certificate(arm, both[:bodies]).values()) > 0.0 and both[bodies:].min() >= 0.0

    theta = np.concatenate([own, motor / size])
    if not exist(theta):
        theta = np.concatenate(
            nearest_bodies(
                arm, seen[:, :bodies], seen[:, bodies:], goal, middle, settings.hold / scale
            )
        )
        # What the solver leaves, exactly, where bodies and rotors can have it.
        residual = goal - seen @ theta
        exact = theta + unit * (np.linalg.pinv(seen * unit, rcond=settings.rank) @ residual)
        theta = exact if exist(exact) else theta
    missed = orthogonal @ (seen @ theta - goal)
    off = np.sqrt(np.sum(missed.reshape(count, -1) ** 2, axis=0))
    rows = theta[:bodies].reshape(len(arm.body_names), -1)
    inertia = {
        name: frames[name].actInv(pin.Inertia.FromDynamicParameters(row))
        for name, row in zip(arm.body_names, rows, strict=True)
    }
    return inertia, theta[bodies:] * size, off


def _motion(arm: Arm, settings: CompletionSettings) -> tuple[Array, Array, Array]:
    """Return (states, n) positions all over the joints' range, velocities and accelerations."""
    random = np.random.default_rng(0)
    shape = (settings.states, arm.n)
    q = random.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), shape)
    qd, qdd = settings.fastest * arm.scale * random.uniform(-1.0, 1.0, (2, *shape))
    return q, qd, qdd
