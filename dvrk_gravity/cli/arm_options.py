"""Options of command lines that name an arm, or say how its efforts are read."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

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


def add_verbose(parser: argparse.ArgumentParser) -> None:
    """Declare ``--verbose``."""
    parser.add_argument(
        "--verbose", action="store_true", help="print all that was found, not only what to act on"
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Declare how recordings are read: ``--topic``, ``--time-base`` and ``--columns``."""
    parser.add_argument("--topic", help="JointState topic of bags, if it is not found")
    parser.add_argument(
        "--time-base", choices=("stamp", "receive"), default="stamp",
        help="time of samples: the header's stamp (default), or when a bag received them",
    )  # fmt: skip
    parser.add_argument(
        "--columns", metavar="NAME=TARGET,...",
        help="what columns of a CSV are, if not recognised: t=time[ms],q1=elbow.position[deg]; "
        "or a .yaml file with NAME: TARGET",
    )  # fmt: skip


def reading(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments by which a recording is read as a command line says."""
    return {
        "topic": arguments.topic,
        "time_base": arguments.time_base,
        "columns": arguments.columns,
    }


def with_drive_gains(arm: Arm, arguments: argparse.Namespace) -> Arm:
    """Return the arm with the gains, or the unit, that a command line gives.

    Raises:
        ConfigError: Another number of gains than joints, one that is not positive, no unit; or
            others than the arm has already.
    """
    text, unit = arguments.drive_gains, arguments.effort_unit
    if text is not None:
        gains = numbers("--drive-gains", text, arm.n, ", ".join(arm.joint_names))
        if arm.drive_gains is not None and gains != arm.drive_gains.tolist():
            shown = ",".join(f"{gain:g}" for gain in arm.drive_gains)
            raise ConfigError("--drive-gains", text, f"those that the arm has, {shown}, or none")
        return arm if arm.drive_gains is not None else arm.with_drive_gains(gains)
    if unit is not None:
        return arm.told_in(unit)
    return arm


def of_model(model: TorqueModel, arguments: argparse.Namespace) -> TorqueModel:
    """Return a model whose arm's efforts are read as a command line says.

    Raises:
        ConfigError: Another unit than the model's, or see :func:`with_drive_gains`.
    """
    # Here and not above, as Pinocchio is slow to load.
    from dvrk_gravity.arms import in_newtons

    given, arm, gains = arguments.effort_unit, model.arm, arguments.drive_gains
    if gains is not None and arm.read_in:
        why = f"none: the model is in {arm.read_in}; identify it with them"
        raise ConfigError("--drive-gains", gains, why)
    if gains is not None and arm.drive_gains is None and not model.of_file:
        print(
            "warning: efforts are taken as currents (--drive-gains), and the model was identified "
            "from efforts in N·m",
            file=sys.stderr,
        )
    if given is None:
        return replace(model, arm=with_drive_gains(arm, arguments))
    expected = f"{arm.read_in or 'N·m'}, as the model's torques"
    if arm.drive_gains is not None and (arm.drive_gains != 1.0).any():
        expected = "none: the model has drive gains, which efforts in A are taken to N·m by"
    elif given == arm.read_in:
        return model
    elif in_newtons(given) and not arm.read_in:
        return replace(model, arm=arm.told_in(given))
    raise ConfigError("--effort-unit", given, expected)


def require_parameters(model: TorqueModel, path: Path) -> None:
    """Refuse the file of an arm, where a node is to read the model's as its parameters.

    Raises:
        ConfigError: Naming it.
    """
    if model.of_file:
        written = "a model file, as `convert robot.urdf model.yaml` writes one"
        raise ConfigError("--model", "an arm's file", written, path)


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
