"""Options of command lines that name an arm, or say how its efforts are read."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files.resources import shipped

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.model import TorqueModel


def arms() -> str:
    """Return what names an arm, for the help of an option."""
    return f"{', '.join(shipped('arms'))}, or an arm's .yaml or .urdf file"


def add_drive_gains(parser: argparse.ArgumentParser) -> None:
    """Declare ``--drive-gains`` and ``--effort-unit``."""
    given = parser.add_mutually_exclusive_group()
    given.add_argument(
        "--drive-gains", metavar="GAIN,...",
        help="efforts are motor currents: N·m (or N) of each A, one a joint",
    )  # fmt: skip
    given.add_argument(
        "--effort-unit", metavar="UNIT",
        help="unit of the efforts where it is not N·m and no gains are known: A; or N·m, if the "
        "masses in the arm's file say otherwise",
    )  # fmt: skip


def with_drive_gains(arm: Arm, arguments: argparse.Namespace) -> Arm:
    """Return the arm with the gains, or the unit, that a command line gives.

    Raises:
        ConfigError: Another number of gains than joints, one that is not positive, no unit; or
            others than the arm has already.
    """
    text, unit = arguments.drive_gains, arguments.effort_unit
    if text is not None:
        if arm.read_in:
            raise ConfigError(
                "--drive-gains", text, f"none: the model is in {arm.read_in}; identify it with them"
            )
        gains = numbers("--drive-gains", text, arm.n, ", ".join(arm.joint_names))
        if arm.drive_gains is not None and gains != arm.drive_gains.tolist():
            shown = ",".join(f"{gain:g}" for gain in arm.drive_gains)
            raise ConfigError("--drive-gains", text, f"those that the arm has, {shown}, or none")
        return arm if arm.drive_gains is not None else arm.with_drive_gains(gains)
    if unit is not None:
        return arm.told_in(unit)
    return arm


def of_model(model: TorqueModel, arguments: argparse.Namespace) -> TorqueModel:
    """Return a model whose arm's efforts are read as a command line says."""
    return replace(model, arm=with_drive_gains(model.arm, arguments))


def numbers(option: str, text: str, count: int, of: str = "") -> list[float]:
    """Return comma-separated numbers.

    Raises:
        ConfigError: Another number of them, or something else.
    """
    each = f", one for each of {of}" if of else ""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise ConfigError(option, text, f"{count} numbers with commas between{each}") from error
    if len(found) != count:
        raise ConfigError(option, f"{len(found)} numbers", f"{count}{each}")
    return found
