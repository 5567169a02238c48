"""A manifest from what lies in folders: namespaces in bags, serial numbers, names of folders."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError, DvrkGravityError
from dvrk_gravity.files.resources import shipped
from dvrk_gravity.fleet.manifest import MANIFEST, ArmEntry, Manifest, is_whole_recording
from dvrk_gravity.recording import JOINT_STATE, BagReader, is_bag, iterate_recording

_READINGS = ("measured_js", "state_joint_current", "joint_states")
# Of console files: gc-MTMR-28002.json, sawIntuitiveResearchKit-PSM1-28003.json.
_CONSOLE = re.compile(r"(?P<name>MTM[LR]|PSM\d?|ECM)-(?P<serial>[A-Za-z0-9]+)\.(json|xml)$")
_SERIAL = re.compile(r"(?<!\d)(?!20\d\d(?!\d))\d{4,6}(?!\d)")  # of a folder or file, and no year
UNKNOWN = "ARM"
"""What stands for the kind of an arm that a scan does not recognise."""


@dataclass(frozen=True)
class _ArmInRecording:
    """One arm in one recording."""

    path: Path
    name: str  # as its namespace has it, or its path; "" unknown
    topic: str  # of a bag that has several arms


def scan(folder: Path) -> Manifest:
    """Return the arms whose recordings lie in a folder, at whatever depth.

    A serial number is that of a console file of the arm beside its recordings or above them, else
    the number in a path, else the name of the folder. Paths are as seen from the folder.

    Raises:
        ConfigError: No recording there, or recordings whose kind of arm is not recognised.
    """
    numbers = _serial_numbers(folder)
    arms: dict[tuple[str, str, str], list[Path]] = defaultdict(list)
    for path in _recordings(folder):
        for found in _arms_in(path, folder):
            kind = _kind(found.name)
            serial = _serial(found, folder, numbers)
            arms[kind, serial, found.topic].append(path)
    if not arms:
        raise ConfigError("", "no recording", "a folder with bags or csv files", folder)
    entries = []
    for (kind, serial, topic), paths in sorted(arms.items()):
        model = next(
            (str(each.relative_to(folder)) for each in sorted(folder.rglob(f"*{serial}*.yaml"))
             if each.name != MANIFEST and _is_model(each)), "",
        )  # fmt: skip
        entries.append(ArmEntry(serial, kind, _patterns(paths, folder, arms), model, topic))
    serials = [entry.serial for entry in entries]
    twice = {serial for serial in serials if serials.count(serial) > 1}
    return Manifest(tuple(
        entry if entry.serial not in twice
        else ArmEntry(
            f"{entry.arm}-{entry.serial}", entry.arm, entry.recordings, entry.model, entry.topic
        )
        for entry in entries
    ))  # fmt: skip


def _recordings(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if is_whole_recording(path):
            yield path
        elif path.is_dir() and not path.name.startswith("."):
            yield from _recordings(path)


def _arms_in(path: Path, folder: Path) -> Iterator[_ArmInRecording]:
    """Yield the arms of a recording: of a bag its namespaces, of a csv what its path names."""
    if not is_bag(path):
        yield _ArmInRecording(
            path, _name_in(path.relative_to(folder)) or _by_joints(path.parent), ""
        )
        return
    try:
        with BagReader(path) as bag:
            topics = [
                topic for topic, kind in bag.topics.items()
                if kind == JOINT_STATE and topic.rpartition("/")[2] in _READINGS
                and "gripper" not in topic
            ]  # fmt: skip
    except DvrkGravityError:
        return  # a damaged bag names no arm; `fleet` reports it if a pattern matches it
    for topic in topics:
        namespace = topic.rpartition("/")[0].strip("/").rpartition("/")[2]
        name = namespace if _kind(namespace) != UNKNOWN else _name_in(path.relative_to(folder))
        yield _ArmInRecording(path, name or namespace, topic if len(topics) > 1 else "")


def _name_in(path: Path) -> str:
    """Return the part of a path that names a kind of arm; ``""``: none."""
    for part in reversed(path.parts):
        for word in re.split(r"[^A-Za-z0-9]+", part):
            if _kind(word) != UNKNOWN:
                return word
    return ""


def _kind(name: str) -> str:
    """Return the shipped arm that a namespace such as PSM1 is of."""
    plain = re.sub(r"\d+$", "", name.lower())
    return plain if plain in shipped("arms") else UNKNOWN


def _serial_numbers(folder: Path) -> dict[tuple[Path, str], str]:
    """Return serial numbers by folder and arm's name, of the console files."""
    found = {}
    for path in folder.rglob("*"):
        if match := _CONSOLE.search(path.name):
            found[path.parent, match["name"].upper()] = match["serial"]
    return found


def _serial(found: _ArmInRecording, folder: Path, numbers: dict[tuple[Path, str], str]) -> str:
    for parent in found.path.parents:
        if serial := numbers.get((parent, found.name.upper())):
            return serial
        if parent == folder:
            break
    relative = found.path.relative_to(folder)
    for part in reversed(relative.parts):
        if match := _SERIAL.search(re.sub(r"20\d\d[-_]?\d\d[-_]?\d\d([-_T]?[\d-]+)?", "", part)):
            return match[0]
    if found.name and _kind(found.name) != UNKNOWN and found.topic:
        return found.name
    return relative.parts[0] if len(relative.parts) > 1 else found.name or folder.resolve().name


def _patterns(
    paths: list[Path], folder: Path, arms: dict[tuple[str, str, str], list[Path]]
) -> tuple[str, ...]:
    """Return patterns that match these recordings, and none of another arm's."""
    others = {path for its in arms.values() if its is not paths for path in its} - set(paths)
    patterns = set[str]()
    for path in paths:
        pattern = f"{path.parent.relative_to(folder)}/*{'' if path.is_dir() else path.suffix}"
        pattern = pattern.removeprefix("./")
        shared = any(path.parent == other.parent for other in others)
        patterns.add(str(path.relative_to(folder)) if shared else pattern)
    return tuple(sorted(patterns))


def _is_model(path: Path) -> bool:
    try:
        return "ros__parameters:" in path.read_text(encoding="utf-8")[:2000]
    except (OSError, UnicodeDecodeError):
        return False


@lru_cache(maxsize=1024)
def _by_joints(folder: Path) -> str:
    """Return the shipped arm that has all joints of a folder's first csv; ``""``: none, or two."""
    first = next(path for path in sorted(folder.iterdir()) if is_whole_recording(path))
    try:
        joints = set(next(iterate_recording(first)).joints)
    except DvrkGravityError:
        return ""
    fits = [name for name in shipped("arms") if set(Arm.load(name).joint_names) == joints]
    return fits[0] if len(fits) == 1 else ""
