"""The arm that a torque model describes, as a plant that moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate.plant import Plant
from dvrk_gravity.simulate.plant_file import PlantFile
from dvrk_gravity.terms import LinkInertia, RotorInertia, State
from dvrk_gravity.tree import TREE_LINKS, link_frames

Array = NDArray[np.float64]

STAND_IN = "mtmr_28002"
"""Plant file whose inertia stands in where a model has none."""

_STATES = 60  # 7 torques each, for the 42 combinations of parameters that act
_RANK = 1e-9


def model_plant(model: TorqueModel, friction_scale: float = 1.0) -> Plant:
    """Return the arm as a model has it: its torques, and its inertia if it has one.

    A model without link inertia gets that of :data:`STAND_IN`: it balances the same, but does not
    fall as fast.

    Args:
        model: The model.
        friction_scale: Factor on every friction.

    Raises:
        ConfigError: Inertia whose mass matrix is not positive definite.
    """
    links, rotors = model.term(LinkInertia.NAME), model.term(RotorInertia.NAME)
    own = tuple(term for term in model.terms if not isinstance(term, LinkInertia | RotorInertia))
    still = replace(model, terms=own).physical()
    known = PlantFile.load(STAND_IN)
    if not isinstance(links, LinkInertia):
        return Plant(still, known.links, known.rotor_inertia, friction_scale)
    motor = rotors.motor if isinstance(rotors, RotorInertia) else np.zeros(N_JOINTS)
    return Plant(still, _bodies(links, known), motor, friction_scale)


def _bodies(links: LinkInertia, known: PlantFile) -> dict[str, pin.Inertia]:
    """Return bodies that move as identified parameters do.

    Torque depends on combinations of the parameters only, and identified ones may have links
    of no mass. Of all that have the same torque these are nearest to an arm that is known.
    """
    frames = link_frames(links.arm)
    nothing = pin.Inertia.Zero()
    nearest = np.array(
        [
            frames[name].act(known.links.get(name, nothing)).toDynamicParameters()
            for name in TREE_LINKS
        ]
    )
    random = np.random.default_rng(0)
    q, qd, qdd = random.uniform(-2.0, 2.0, (3, _STATES, N_JOINTS))
    regressor = links.regressor(State(q, qd, qdd)).reshape(_STATES * N_JOINTS, -1)
    change = links.theta - nearest.ravel()
    acts = np.linalg.pinv(regressor, rcond=_RANK) @ (regressor @ change)
    rows = (nearest.ravel() + acts).reshape(nearest.shape)
    return {
        name: frames[name].actInv(pin.Inertia.FromDynamicParameters(row))
        for name, row in zip(TREE_LINKS, rows, strict=True)
    }
