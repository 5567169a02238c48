"""Small files that are long work to read, or that never end: what each makes is fixed by its seed.

``write(kind, folder, random)`` writes one and returns its path; ``READERS`` has what reads it. Some
are valid files, of which nothing is damaged.
"""

from __future__ import annotations

import io
import shutil
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from recording_samples import START, write_messages

from dvrk_gravity.arms import Arm
from dvrk_gravity.console import check_file
from dvrk_gravity.files import array_file, json_file, yaml_file
from dvrk_gravity.newton_euler import reader as mechanism
from dvrk_gravity.planning import Basis, FourierMotion, Plan, PlanLimits, load_limits
from dvrk_gravity.recording import Recording, encode_joint_state

TEXT = 990_000  # characters of a text file


def repeated(part: str, count: int = 0) -> str:
    """Return a text of so many characters, ``TEXT`` if none is given, that repeats a part."""
    count = count or TEXT
    return (part * (count // len(part) + 1))[:count]


def numbered(form: str, count: int) -> str:
    """Return texts with a number in each, one after the other."""
    return "".join(form.replace("#", str(k)) for k in range(count * TEXT // 990_000))


def many_names(random: Random) -> bytes:
    """Return a JointState of 200 000 joints without a name."""
    start = encode_joint_state(random.randrange(10**9), ())[:16]
    return start + struct.pack("<I", 200_000) + bytes(990_000 - 20)


def bag(path: Path, message: bytes) -> Path:
    """Write a bag of one message, as one file."""
    folder = path.with_suffix("")
    write_messages(folder, [(START, message)])
    shutil.move(folder / f"{folder.name}.db3", path)
    shutil.rmtree(folder)
    return path


def npz(path: Path, random: Random) -> Path:
    """Write arrays of 20 MB packed into some kB, twelve times."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        stream = io.BytesIO(b"\x93NUMPY\1\0" + bytes(19_000_000 + random.randrange(9)))
        for k in range(12):
            archive.writestr(f"a{k}.npy", stream.getvalue())
    return path


def plan(path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """Write a plan that was changed."""
    arm = Arm.load("ecm")
    middle, limits_of_arm = arm.range[0] * 0.5 + arm.range[1] * 0.5, PlanLimits.of(arm)
    motion = FourierMotion(Basis(np.array([0.1]), 1.0, 10.0), middle, np.zeros((2, arm.n)))
    Plan(arm, motion, limits_of_arm).save(path)
    content = yaml_file.load(path)
    change(content)
    path.write_text(yaml_file.dump(content))
    return path


def many_waves(content: dict[str, Any]) -> None:
    """Change a plan to one of 20 000 waves."""
    motion, count = content["motion"], 20_000 * TEXT // 990_000
    motion["duration"] = 9000.0
    motion["frequency"] = [0.1 + 1e-6 * k for k in range(count)]
    for name in ("cosine", "sine"):
        motion[name] = {joint: [0] * count for joint in motion[name]}


def robot(content: str) -> str:
    """Return a URDF."""
    return f'<robot name="r">{content}</robot>'


CHILD = '<parent link="l0"/><child link="l#"/>'
TEXTS: dict[str, tuple[str, Callable[[Random], str]]] = {
    "JSON, comments without an end": (".json", lambda _: '{"a": 1, ' + repeated("/*")),
    "JSON, a text without an end": (".json", lambda _: '{"a": ' + repeated('"\\', TEXT - 9)),
    "JSON, quotes": (".json", lambda _: repeated('"\\"') + "\\"),
    "JSON, keys twice": (".json", lambda _: "{" + numbered('"k#":1,"k#":2,', 30_000)[:-1] + "}"),
    "JSON, commas": (".json", lambda _: '{"a": [' + repeated("[1,],\n")[:-7] + "]}"),
    "JSON, nested": (".json", lambda _: '{"a": ' + repeated("[")),
    "JSON, a long number": (".json", lambda _: '{"a": 1.' + repeated("1") + "}"),
    "YAML, nested lists": (".yaml", lambda _: repeated("- - - - - - - - - -\n")),
    "YAML, aliases": (".yaml", lambda _: "a0: &a0 [1]\n" + numbered("b#: &b# [*a0, *a0]\n", 9000)),
    "YAML, brackets": (".yaml", lambda _: "a: " + repeated("[")),
    "YAML, a long integer": (".yaml", lambda _: "a: 0x" + repeated("f")),
    "YAML, keys": (".yaml", lambda _: numbered("k#: 1\n", 80_000)),
    "arm, joints": (".arm.yaml", lambda _: "name: x\njoints:\n" + numbered(
        "  - {name: j#, alpha: 90, a: 0, d: 0, offset: 0, lower: -9, upper: 9, effort_limit: 2}\n",
        9000)),
    "arm, a name of bits": (".arm.yaml", lambda _: "name: 0x" + "f" * 4000),
    "URDF, links": (".urdf", lambda _: robot(numbered('<link name="l#"/>', 40_000))),
    "URDF, joints": (".urdf", lambda _: robot(numbered(
        f'<link name="l#"/><joint name="j#" type="fixed">{CHILD}</joint>', 9000))),
    "URDF, nested": (".urdf", lambda _: robot("<a>" * (TEXT // 8) + "</a>" * (TEXT // 8))),
    "mechanism": (".mechanism.yaml", lambda _: "links:\n" + numbered(
        "- {length: 1, mass: 1, com: [0,0,0], inertia: [[1,0,0],[0,1,0],[0,0,1]]}\n", 9000)),
    "limits, combinations": (".limits.yaml", lambda _: "combinations:\n" + numbered(
        "- {of: {yaw: 1, pitch: 1#}, velocity: 60}\n", 20_000)),
    "limits, boxes": (".limits.yaml", lambda _: "boxes:\n" + numbered(
        "- {lower: [1,1,1], upper: [2,2,2]}\n", 20_000)),
    "CSV, times": (".csv", lambda _: numbered("a#.sec,", 9000)[:90_000] + "\n1,2\n"),
    "CSV, brackets": (".csv", lambda _: "a(" + repeated(" ", 90_000) + "b,c.position\n1,2\n"),
    "CSV, blanks": (".csv", lambda _: "a" + repeated(" ", 90_000) + "b,c.position\n1,2\n"),
    "CSV, long lines": (".csv", lambda _: "time,a.position\n" + "".join(
        f"{k},{repeated('1', 300)}{' ' * 90_000}\n" for k in range(11))),
}  # fmt: skip
OTHERS: dict[str, tuple[str, Callable[[Path, Random], Path]]] = {
    "bag, many joints": (".db3", lambda path, random: bag(path, many_names(random))),
    "arrays": (".npz", npz),
    "plan, waves": (".plan.yaml", lambda path, _: plan(path, many_waves)),
}  # fmt: skip


KINDS = (*TEXTS, *OTHERS)


def write(kind: str, folder: Path, random: Random) -> Path:
    """Write a file of a kind."""
    if kind in TEXTS:
        suffix, made = TEXTS[kind]
        path = folder / f"hostile{suffix}"
        path.write_text(made(random)[:999_000])
        return path
    suffix, write_file = OTHERS[kind]
    return write_file(folder / f"hostile{suffix}", random)


def limits(path: Path) -> PlanLimits:
    """Read limits of an ECM."""
    return load_limits(path, Arm.load("ecm"))


READERS: dict[str, Callable[[Path], Any]] = {
    ".json": lambda path: (json_file.load(path), check_file(path)),
    ".arm.yaml": Arm.load,
    ".mechanism.yaml": mechanism.read,
    ".limits.yaml": limits,
    ".plan.yaml": lambda path: Plan.load(path).still,
    ".yaml": yaml_file.load,
    ".urdf": Arm.load,
    ".npz": array_file.load,
    ".csv": Recording.load,
    ".db3": Recording.load,
}


def read(path: Path) -> Any:
    """Read a file by what reads its kind."""
    return READERS["".join(path.suffixes)](path)
