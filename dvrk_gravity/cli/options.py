"""Options that several verbs share: the arm, its efforts, its recordings, unrecorded joints."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files.resources import shipped

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.planning import PlanLimits
    from dvrk_gravity.recording import Coordinates, Recording
    from dvrk_gravity.simulate import PlantFile

Bounds = tuple[float, float]
TIMEOUTS: Bounds = (0.02, 1.0)  # s without measured_js; as the compensator's


def arms() -> str:
    """Return the possible values of ``--arm``, for its help."""
    return f"{', '.join(shipped('arms'))}, or an arm's .yaml or .urdf file"


def require_bounds(arguments: argparse.Namespace, bounds: Mapping[str, Bounds]) -> None:
    """Refuse a value outside its bounds, and a negative ``--seed``.

    Raises:
        ConfigError: Naming the option, its value and what was expected.
    """
    for name, (least, most) in bounds.items():
        if not least <= getattr(arguments, name) <= most:
            raise ConfigError(f"--{name}", getattr(arguments, name), f"{least:g} to {most:g}")
    if getattr(arguments, "seed", 0) < 0:
        raise ConfigError("--seed", arguments.seed, "0 or more")


def refuse_ros_args(arguments: argparse.Namespace) -> None:
    """Refuse ``--ros-args``, which a verb that is no node does not read."""
    if arguments.ros_args:
        raise ConfigError("--ros-args", " ".join(arguments.ros_args), "none: use --namespace")


def limits_of(arguments: argparse.Namespace, arm: Arm) -> PlanLimits:
    """Return the limits of ``--limits``, else the arm's own."""
    from dvrk_gravity.planning import PlanLimits, load_limits

    path, beyond = arguments.limits, arguments.beyond_defaults
    return PlanLimits.of(arm) if path is None else load_limits(path, arm, beyond)


def add_beyond_defaults(parser: argparse.ArgumentParser) -> None:
    """Declare ``--beyond-defaults``."""
    parser.add_argument(
        "--beyond-defaults", action="store_true",
        help="take limits of more than twice the arm's default speeds and accelerations, too",
    )  # fmt: skip


def plant_of(arguments: argparse.Namespace, arm: Arm) -> PlantFile:
    """Return the plant of ``--simulated``, else the arm's.

    Raises:
        ConfigError: A plant with other joints.
    """
    from dvrk_gravity.simulate import PlantFile

    given = arguments.simulated
    plant = PlantFile.load(given) if given else PlantFile.of(arm)
    if plant.model.arm.joint_names != arm.joint_names:
        raise ConfigError("--simulated", given, f"a plant of {arm.name}")
    return plant


def planned_model(arguments: argparse.Namespace, arm: Arm) -> TorqueModel | None:
    """Return the model of ``--model``, for efforts that a motion takes, if there is one.

    Raises:
        ConfigError: A model of another arm.
    """
    from dvrk_gravity.model import TorqueModel

    if arguments.model is None:
        return None
    model = TorqueModel.load(arguments.model)
    names = {model.arm.name, arm.name}
    # Two of the package's arms are not the same one, though their joints may have the same names.
    another = len(names) == 2 and names <= set(shipped("arms"))
    if another or model.arm.joint_names != arm.joint_names:
        raise ConfigError("--model", model.arm.name, f"a model of {arm.name}", arguments.model)
    return model.physical()


def add_recordings(parser: argparse.ArgumentParser, required: bool = True) -> None:
    """Declare the recordings."""
    parser.add_argument(
        "recordings", metavar="RECORDING", type=Path, nargs="+" if required else "*",
        help="rosbag2 or CSV; all of them trajectories, or (no time column) static poses",
    )  # fmt: skip


def add_drive_gains(parser: argparse.ArgumentParser) -> None:
    """Declare ``--drive-gains`` and ``--effort-unit``."""
    given = parser.add_mutually_exclusive_group()
    given.add_argument(
        "--drive-gains", metavar="GAIN,...",
        help="efforts are motor currents: N·m/A (N/A if it slides) for each joint",
    )  # fmt: skip
    given.add_argument(
        "--effort-unit", metavar="UNIT",
        help="unit of the efforts if it is not N·m and the gains are unknown: A; or N·m, to "
        "override the masses in the arm's file; or by joint, JOINT=mN·m,JOINT=%% (of its limit)",
    )  # fmt: skip


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Declare how recordings are read: ``--topic``, ``--time-base`` and ``--columns``."""
    parser.add_argument("--topic", help="JointState topic of bags, if they have several")
    parser.add_argument(
        "--time-base", choices=("stamp", "receive"), default="stamp",
        help="time of samples: the header's stamp (default), or when a bag received them",
    )  # fmt: skip
    parser.add_argument(
        "--columns", metavar="NAME=TARGET,...",
        help="meaning of CSV columns, if not recognised: t=time[ms],q1=elbow.position[deg]; joints "
        "of other names than the arm's, in bags, too: ur_elbow=elbow; or a .yaml file with "
        "NAME: TARGET",
    )  # fmt: skip


def reading(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments with which to read a recording."""
    return {name: getattr(arguments, name) for name in ("topic", "time_base", "columns")}


def recordings(
    paths: Iterable[str | Path],
    arguments: argparse.Namespace,
    arm: Arm,
    coordinates: Coordinates = "joint",
) -> list[Recording]:
    """Return the recordings of the command line."""
    from dvrk_gravity.recording import load_excerpt

    given = reading(arguments)
    return [load_excerpt(path, coordinates=coordinates, arm=arm, **given) for path in paths]


def with_drive_gains(arm: Arm, arguments: argparse.Namespace) -> Arm:
    """Return the arm with the gains, or the unit, of the command line.

    Raises:
        ConfigError: Another number of gains than joints, one that is not positive, no unit; or
            others than the arm's own.
    """
    text, unit = arguments.drive_gains, arguments.effort_unit
    if text is not None:
        gains = numbers("--drive-gains", text, arm.n, ", ".join(arm.joint_names))
        if arm.drive_gains is not None and gains != arm.drive_gains.tolist():
            shown = ",".join(f"{gain:g}" for gain in arm.drive_gains)
            raise ConfigError("--drive-gains", text, f"the arm's own, {shown}, or none")
        return arm if arm.drive_gains is not None else arm.with_drive_gains(gains)
    if unit is None or "=" not in unit:
        return arm if unit is None else arm.with_effort_unit(unit)
    return arm.with_drive_gains(_gains_by_joint(unit, arm), [0.0] * arm.n)


def _gains_by_joint(text: str, arm: Arm) -> list[float]:
    """Return each joint's effort unit in N·m or N, from ``JOINT=UNIT,…``; unnamed joints: 1."""
    from dvrk_gravity.arms import newton_metres

    joints, gains = {joint.name: joint for joint in arm.joints}, dict.fromkeys(arm.joint_names, 1.0)
    for entry in text.split(","):
        name, _, unit = (part.strip() for part in entry.partition("="))
        joint = joints.get(name)
        size = newton_metres(unit)
        if joint is not None and unit == "%" and joint.effort_stated:
            size = joint.effort_limit / 100.0
        if joint is None or size is None:
            known = "mN·m, N·mm, N·cm, kN·m, N·m or % (of an effort limit that the file states)"
            raise ConfigError("--effort-unit", entry, f"JOINT={known} with {', '.join(joints)}")
        gains[name] = size
    return list(gains.values())


def add_rehearsal(parser: argparse.ArgumentParser) -> None:
    """Declare ``--rehearsal`` and ``--no-rehearsal``."""
    parser.add_argument("--rehearsal", action=argparse.BooleanOptionalAction,
                        help="go through each motion at a tenth of its speed first (default: with "
                        "an arm, and not with --simulated)")  # fmt: skip


def wants_rehearsal(arguments: argparse.Namespace) -> bool:
    """Return whether motions are rehearsed: there is room around an arm in this process."""
    if arguments.rehearsal is None:
        return arguments.simulated is None
    return bool(arguments.rehearsal)


def model_with_drive_gains(model: TorqueModel, arguments: argparse.Namespace) -> TorqueModel:
    """Return the model with the drive gains, or the unit, of the command line.

    Raises:
        ConfigError: Another unit than the model's, or see :func:`with_drive_gains`.
    """
    from dvrk_gravity.arms import in_newtons

    given, arm, gains = arguments.effort_unit, model.arm, arguments.drive_gains
    if gains is not None and arm.read_in:
        why = f"none: the model is in {arm.read_in}; identify it with them"
        raise ConfigError("--drive-gains", gains, why)
    if gains is not None and arm.drive_gains is None and not model.of_file:
        print(
            "warning: --drive-gains takes efforts as currents, but the model was identified from "
            "efforts in N·m",
            file=sys.stderr,
        )
    if given is None or ("=" in given and model.of_file and arm.drive_gains is None):
        return replace(model, arm=with_drive_gains(arm, arguments))
    expected = f"{arm.read_in or 'N·m'}, the unit of the model's torques"
    if arm.drive_gains is not None and (arm.drive_gains != 1.0).any():
        expected = "none: the model has drive gains, which convert efforts in A to N·m"
    elif given == arm.read_in:
        return model
    elif in_newtons(given) and not arm.read_in:
        return replace(model, arm=arm.with_effort_unit(given))
    raise ConfigError("--effort-unit", given, expected)


def require_parameters(model: TorqueModel, path: Path) -> None:
    """Refuse an arm's file where a node needs a model's file for its parameters.

    Raises:
        ConfigError: Naming it.
    """
    if model.of_file:
        written = "a model file, as `convert robot.urdf model.yaml` writes one"
        raise ConfigError("--model", "an arm's file", written, path)


def numbers(option: str, text: str, count: int, of: str = "") -> list[float]:
    """Return ``count`` comma-separated numbers, or raise ConfigError."""
    each = f", one for each of {of}" if of else ""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise ConfigError(option, text, f"{count} numbers with commas between{each}") from error
    if len(found) != count:
        raise ConfigError(option, f"{len(found)} numbers", f"{count}{each}")
    return found


# By kind of joint; the longer names first, of which the shorter are endings.
_UNITS = {
    "revolute": {"deg": math.pi / 180.0, "rad": 1.0},
    "prismatic": {"mm": 1e-3, "m": 1.0},
}
_FARTHEST = {"revolute": (4.0 * math.pi, "two turns"), "prismatic": (10.0, "10 m")}


def add_at(parser: argparse.ArgumentParser) -> None:
    """Declare ``--at``."""
    parser.add_argument(
        "--at", metavar="JOINT=POSITION,...", action="append", default=[],
        help="positions of joints that the recording lacks, or that stood there, in joint "
        "coordinates: shoulder_pitch=2.5deg,others=0deg; mm or m for prismatic joints",
    )  # fmt: skip


def require_as_recorded(
    texts: Sequence[str], still: Mapping[str, float], recordings: Sequence[Recording]
) -> None:
    """Refuse a position of a joint that every recording has, and has elsewhere.

    Args:
        texts: Of ``--at``.
        still: What they state, rad or m.
        recordings: The recordings.

    Raises:
        ConfigError: Naming it, and where it was recorded.
        RecordingError: A recording that cannot be read.
    """
    from dvrk_gravity.observation import stood_at, travel

    for entry, name, _ in _entries(texts):
        if all(name in recording.joints for recording in recordings):
            for recording in recordings:
                if not stood_at(recording, name, still[name]):
                    low, high = travel(recording, name)
                    where = f"{recording.source} has it at {low:.4g} to {high:.4g}"
                    raise ConfigError("--at", entry, f"where {name} is recorded: {where}")


def _entries(texts: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield each entry, its joint and its position."""
    for entry in ",".join(texts).split(",") if texts else ():
        name, _, position = entry.strip().partition("=")
        yield entry, name, position


def _require_within_reach(entry: str, arm: Arm, name: str, position: float) -> None:
    """Refuse a position further beyond the arm's limits than an encoder zero can be off."""
    from dvrk_gravity.observation import BEYOND

    index = arm.joint_names.index(name)
    joint, lower, upper = arm.joints[index], float(arm.lower[index]), float(arm.upper[index])
    beyond = BEYOND * float(arm.scale[index])
    if not lower - beyond <= position <= upper + beyond:
        limits = f"{joint.shown(lower)} to {joint.shown(upper)}, the limits of {arm.name}"
        raise ConfigError("--at", entry, f"a position of {name} at {limits}")


def fixed_positions(texts: Sequence[str], arm: Arm) -> dict[str, float]:
    """Return joint positions, rad or m, from ``JOINT=POSITION,...``; ``others``: all unnamed."""
    joints = {joint.name: joint for joint in arm.joints}
    named: dict[str, float] = {}
    for entry, name, position in _entries(texts):
        if name not in (*joints, "others"):
            raise ConfigError("--at", entry, f"JOINT=ANGLE of {', '.join(joints)} or others")
        if name in named:
            raise ConfigError("--at", entry, f"{name} once")
        kind = joints[name].kind if name in joints else "revolute"
        units, (farthest, words) = _UNITS[kind], _FARTHEST[kind]
        unit = next((unit for unit in units if position.endswith(unit)), "")
        try:
            value = float(position.removesuffix(unit))
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (not unit and value != 0.0):
            example = "an angle with its unit, like 2.5deg or 0.04rad"
            if kind == "prismatic":
                example = "a length with its unit, like 20mm or 0.02m"
            raise ConfigError("--at", entry, example)
        named[name] = value * units.get(unit, 0.0)
        if abs(named[name]) > farthest:
            what = "an angle" if kind == "revolute" else "a length"
            raise ConfigError("--at", entry, f"{what} within {words}")
        if name in joints:
            _require_within_reach(entry, arm, name, named[name])
    if "others" in named:
        rest = named.pop("others")
        for joint in arm.joints:
            if rest and joint.kind == "prismatic" and joint.name not in named:
                raise ConfigError("--at", f"others={rest:g}rad", f"a position of {joint.name}, too")
        named = dict.fromkeys(joints, rest) | named
    return named
