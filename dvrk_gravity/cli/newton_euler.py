"""Torques and joint reactions of a serial chain described in YAML."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

NAME = "newton-euler"
EXAMPLE = "newton-euler config/exercises/3_2_with_gravity.yaml --json loads.json"

_COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
_UNITS = ("N", "N", "N", "N·m", "N·m", "N·m")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("mechanism", type=Path, help="YAML description of chain and motion")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="also write all results, unrounded, to FILE"
    )
    parser.add_argument(
        "--decimals", type=_decimals, default=2, help="printed decimals, 0 to 15 (default: 2)"
    )


def _decimals(text: str) -> int:
    value = int(text)
    if not 0 <= value <= 15:
        raise argparse.ArgumentTypeError(f"got {value}, expected 0 to 15")
    return value


def run(args: argparse.Namespace) -> int:
    """Compute and print; return the exit status."""
    from dvrk_gravity.newton_euler import JointType, inverse_dynamics, read

    outputs.check({"--json": args.json}, [args.mechanism])
    mechanism, motion = read(args.mechanism)
    try:
        loads = inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd)
    except ConfigError as error:
        raise error.in_file(args.mechanism) from None
    types = [joint.type for joint in mechanism.joints]
    tau_units = ["N" if kind is JointType.PRISMATIC else "N·m" for kind in types]
    names = [kind.name.lower() for kind in types]
    if args.json is not None:
        content = {
            "title": mechanism.title,
            "gravity": mechanism.gravity.tolist(),
            "joints": [
                {"type": name, "tau_unit": unit}
                for name, unit in zip(names, tau_units, strict=True)
            ],
            "reaction_components": list(_COMPONENTS),
            "reaction_units": list(_UNITS),
            "tau": loads.tau.tolist(),
            "reactions": loads.reactions.tolist(),
        }
        text = json.dumps(content, indent=1, ensure_ascii=False)
        text_file.write(args.json, text + "\n")

    components = zip(_COMPONENTS, _UNITS, strict=True)
    rows = [["sample", "joint", "type", "tau", *(f"{name} [{unit}]" for name, unit in components)]]
    tau = np.atleast_2d(loads.tau)
    reactions = loads.reactions.reshape(*tau.shape, 6)
    for k in range(len(tau)):
        for i, name in enumerate(names):
            torque = f"{_fixed(tau[k, i], args.decimals)} {tau_units[i]}"
            if types[i] is JointType.RIGID:
                torque = "-"
            numbers = [_fixed(value, args.decimals) for value in reactions[k, i]]
            rows.append([str(k + 1), str(i + 1), name, torque, *numbers])
    if loads.tau.ndim == 1:
        rows = [row[1:] for row in rows]
    if mechanism.title:
        print(mechanism.title)
    print(f"gravity {mechanism.gravity.tolist()} m/s² in the absolute frame")
    print("reaction of joint i: link i-1 on link i, axes of link i, moment about Q of link i-1\n")
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))
    return 0


def _fixed(value: float, decimals: int) -> str:
    """Return a number with fixed decimals and no minus before zero."""
    return f"{value:z.{decimals}f}"
