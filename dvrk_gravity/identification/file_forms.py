"""What files of others can hold of a model: the columns that a fit for such a file has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from dvrk_gravity.arms import BODIES as TREE_LINKS
from dvrk_gravity.arms import PER_LINK, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.console import ARMS, N_GRAVITY, N_POLYNOMIALS, N_POWERS
from dvrk_gravity.effects import Column, Kind, LinearTerm, Term
from dvrk_gravity.effects import effects as all_effects
from dvrk_gravity.errors import ArgumentError, ConfigError
from dvrk_gravity.model import Columns

ForFile = Literal["console", "urdf", "mjcf"]

# Link 7's first moments across its axis are what beta 11 and 12 consist of.
_ACROSS = tuple(PER_LINK * TREE_LINKS.index("link7") + k for k in (1, 2))


def _require_console_arm(arm: Arm) -> None:
    if arm.name not in ARMS.values():
        raise ConfigError("--for console", arm.name, f"an arm of the console: {', '.join(ARMS)}")
    if np.abs(arm.gravity[:2]).max() > 1e-9:
        raise ConfigError(
            "--for console", list(arm.base_rpy), "an upright base: the console knows no other"
        )


class FileColumns(Columns):
    """Columns that files of a format of others have.

    Class attributes:
        FORM: The format, as effects call it (``IN_FILES``).
    """

    FORM: ClassVar[ForFile]

    def offers(self, column: Column) -> bool:
        """Whether the file has such a column."""
        own = next((t for t in self.candidate_terms if column.effect == t.NAME), None)
        return (own is None or own.in_file(self.FORM, column)) and super().offers(column)


class BodyColumns(FileColumns):
    """Columns that an MJCF has: bodies, without what springs add to their weight, and friction."""

    FORM: ClassVar[ForFile] = "mjcf"

    def offers(self, column: Column) -> bool:
        """Whether the file has such a column."""
        return column not in self.rigid.springs and super().offers(column)


class UrdfColumns(BodyColumns):
    """Columns that a URDF has: no friction of motors that move several joints."""

    FORM: ClassVar[ForFile] = "urdf"

    def offers(self, column: Column) -> bool:
        """Whether the file has such a column."""
        return column.site.kind is not Kind.MOTOR and super().offers(column)


class ConsoleColumns(FileColumns):
    """Columns that cannot leave the dVRK console's form at rest.

    At rest the console has gravity with ten parameters on an upright base, and for each of joints 1
    to 6 a polynomial of degree four; in motion, Coulomb friction of the joints. Other torque, which
    the console does not send (inertia, viscous friction, presliding), stays in the fit: without the
    friction of motors, say, gravity would compensate for it.
    """

    FORM: ClassVar[ForFile] = "console"
    ABSENT = _ACROSS  # link 7 is balanced about its own axis

    def offers(self, column: Column) -> bool:
        """Whether the console has such a column at rest."""
        own = next((term for term in self.candidate_terms if column.effect == term.NAME), None)
        if own is not None and own.polynomials is not None:
            return column.index < N_POWERS and column.joint < N_POLYNOMIALS
        return super().offers(column)

    def terms(self, theta: Array, links: Array | None = None) -> tuple[Term, ...]:
        """Return the model's terms, gravity with ten parameters."""
        return tuple(
            term.with_theta(term.theta[:N_GRAVITY])
            if term.WEIGHT_OF_ARM and isinstance(term, LinearTerm)
            else term
            for term in super().terms(theta, links)
        )


@dataclass(frozen=True)
class Form:
    """What a model may have that a file must hold.

    Attributes:
        columns: Its columns.
        words: What was fitted, for a person.
        of_bodies: Whether it holds links as bodies.
    """

    columns: type[FileColumns]
    words: str
    of_bodies: bool = True

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects besides the rigid body."""
        form = self.columns.FORM
        return tuple(effect.NAME for effect in all_effects() if form in effect.IN_FILES)


_WORDS = (
    "fitted for {}, all of which `convert` writes: bodies, zeros, mounting, friction at joints{}; "
    "what else the arm does is in the errors"
)
FORMS: Mapping[ForFile, Form] = {
    "console": Form(
        ConsoleColumns,
        "fitted for the dVRK console: at rest only gravity of ten parameters, and polynomials of "
        "degree four of joints 1 to 6; what `convert` cannot write acts in motion only",
        of_bodies=False,
    ),
    "urdf": Form(UrdfColumns, _WORDS.format("a URDF", "")),
    "mjcf": Form(BodyColumns, _WORDS.format("an MJCF", ", motors, rotors")),
}


def require_form(for_file: ForFile, arm: Arm, effects: Sequence[str] | None, static: bool) -> None:
    """Check that a model of an arm can be fitted for a file.

    Raises:
        ArgumentError: No such form.
        ConfigError: An arm that it does not know, static poses, or effects given beside it.
    """
    if for_file not in FORMS:
        raise ArgumentError("for_file", for_file, f"one of {', '.join(FORMS)}")
    if for_file == "console":
        _require_console_arm(arm)
    elif static:
        poses = "trajectories: static poses do not determine the links' inertia"
        raise ConfigError("--for", for_file, poses)
    if effects is not None:
        raise ConfigError("--terms", ",".join(effects), f"no --terms with --for {for_file}")
