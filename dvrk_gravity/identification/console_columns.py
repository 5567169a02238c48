"""The columns of a fit whose compensation the dVRK console can hold.

At rest the console has gravity with ten parameters on an upright base, and for each of joints 1 to
6 a polynomial of degree four. In motion it has Coulomb friction of the joints. What torque needs
besides and the console does not send (inertia, viscous friction, presliding) stays in the fit:
without the friction of motors, say, gravity would make up for it.

It names effects as the console's form does: which of them the console has, and how much of each.
"""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import BODIES as TREE_LINKS
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.console import ARMS, N_GRAVITY, N_POLYNOMIALS, N_POWERS
from dvrk_gravity.effects import PER_LINK, Column, Gravity, Term
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification.columns import Columns

CONSOLE_EFFECTS = (
    "coulomb_friction", "elastic_cable", "presliding_hysteresis", "rotor_inertia",
    "viscous_friction",
)  # fmt: skip
# Link 7's first moments across its axis are what beta 11 and 12 consist of.
_ACROSS = tuple(PER_LINK * TREE_LINKS.index("link7") + k for k in (1, 2))


def require_console_arm(arm: Arm) -> None:
    """Check that the console knows an arm.

    Raises:
        ConfigError: It does not, or the arm's base is tilted.
    """
    if arm.name not in ARMS.values():
        raise ConfigError("--for-console", arm.name, f"an arm of the console: {', '.join(ARMS)}")
    if np.abs(arm.gravity[:2]).max() > 1e-9:
        raise ConfigError(
            "--for-console", list(arm.base_rpy), "an upright base: the console knows no other"
        )


class ConsoleColumns(Columns):
    """Columns that cannot leave the console's form at rest."""

    ABSENT = _ACROSS  # link 7 is balanced about its own axis

    def offers(self, column: Column) -> bool:
        """See :meth:`Columns.offers`."""
        if column.effect == "elastic_cable":
            return column.index < N_POWERS and column.joint < N_POLYNOMIALS
        if column.effect == "coulomb_friction":
            return column.site_kind == "joint"  # of a motor, presliding does what it does
        return True

    def terms(self, theta: Array, links: Array | None = None) -> tuple[Term, ...]:
        """See :meth:`Columns.terms`."""
        return tuple(
            Gravity(term.arm, term.beta[:N_GRAVITY], term.vector)
            if isinstance(term, Gravity)
            else term
            for term in super().terms(theta, links)
        )
