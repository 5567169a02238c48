"""Small files that are long work to read, or that never end: what each makes is fixed by its seed.

``write(kind, folder, random)`` writes one and returns its path; ``READERS`` has what reads it. Some
are valid files, of which nothing is damaged.
"""

from __future__ import annotations

import bz2
import io
import sqlite3
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from backports import zstd
from lz4 import frame
from recording_samples import TOPIC, joint_state

from dvrk_gravity.arms import Arm
from dvrk_gravity.console import check_file
from dvrk_gravity.files import array_file, json_file, yaml_file
from dvrk_gravity.newton_euler import reader as mechanism
from dvrk_gravity.planning import Basis, FourierMotion, Plan, PlanLimits, load_limits
from dvrk_gravity.recording import JOINT_STATE, Recording, encode_joint_state

CHUNK = 60_000_000  # bytes that a chunk unpacks to: less than is refused at once
PAGE = 1024  # bytes of a page of sqlite3
PACKED = 13_000  # bytes of a bag, about
TEXT = 990_000  # characters of a text file
PACK: dict[str, Callable[[bytes], bytes]] = {
    "bz2": bz2.compress,
    "zstd": zstd.compress,
    "lz4": frame.compress,
}


def record(kind: int, content: bytes) -> bytes:
    """Return a record of an MCAP."""
    return struct.pack("<BQ", kind, len(content)) + content


def empty(random: Random) -> bytes:
    """Return a record of a kind that readers leave out, without content."""
    return record(128 + random.randrange(99), b"")


def text(content: str) -> bytes:
    """Return a text of an MCAP."""
    return struct.pack("<I", len(content)) + content.encode()


def channel(number: int, topic: str) -> bytes:
    """Return the records of a channel of JointStates."""
    schema = struct.pack("<H", 1) + text(JOINT_STATE) + text("ros2msg") + text("")
    content = struct.pack("<HH", number, 1) + text(topic) + text("cdr") + text("")
    return record(3, schema) + record(4, content)


def message(number: int, data: bytes) -> bytes:
    """Return the record of a message."""
    return record(5, struct.pack("<HIQQ", number, 0, 1, 1) + data)


def mcap(path: Path, codec: str, part: bytes, packed: int = PACKED) -> Path:
    """Write an MCAP of equal chunks that repeat a part, each one a packed chunk."""
    content = (part * (CHUNK // len(part) + 1))[:CHUNK]
    data = PACK[codec](content)
    head = struct.pack("<QQQI", 0, 0, len(content), 0)
    chunk = record(6, head + text(codec) + struct.pack("<Q", len(data)) + data)
    magic = b"\x89MCAP0\r\n"
    chunks = chunk * max(packed // len(chunk), 2)
    path.write_bytes(magic + record(1, text("") * 2) + channel(1, TOPIC) + chunks)
    return path


def fields(**given: bytes) -> bytes:
    """Return the header of a record of a ROS 1 bag, with its length."""
    parts = [name.encode() + b"=" + value for name, value in given.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(header)) + header


def ros1(path: Path, part: bytes) -> Path:
    """Write a ROS 1 bag of equal chunks that repeat a part, each one packed by bz2."""
    content = (part * (CHUNK // len(part) + 1))[:CHUNK]
    data = bz2.compress(content)
    size = struct.pack("<I", len(content))
    chunk = fields(op=b"\5", compression=b"bz2", size=size) + struct.pack("<I", len(data)) + data
    described = fields(type=b"sensor_msgs/JointState")[4:]
    connection = fields(op=b"\7", conn=bytes(4), topic=TOPIC.encode())
    connection += struct.pack("<I", len(described)) + described
    path.write_bytes(b"#ROSBAG V2.0\n" + connection + chunk * max(PACKED // len(chunk), 2))
    return path


TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
"""
ENDLESS = "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n)"


def db3(path: Path, random: Random, script: str = "", rows: int = 100) -> Path:
    """Write a sqlite3 file of some messages, changed by a script."""
    connection = sqlite3.connect(path)
    connection.executescript(TABLES)
    connection.execute("INSERT INTO topics VALUES(1, ?, ?, 'cdr')", (TOPIC, JOINT_STATE))
    for k in range(rows):
        received, data = joint_state(k + random.randrange(2))
        connection.execute("INSERT INTO messages VALUES(?, 1, ?, ?)", (k, received, data))
    connection.commit()
    connection.executescript(script)
    connection.commit()
    connection.close()
    return path


def looped(path: Path, random: Random) -> Path:
    """Write a sqlite3 file whose pages name each other as children: its rows have no end."""
    db3(path, random, "PRAGMA page_size=1024; VACUUM", 60)
    raw = bytearray(path.read_bytes())
    connection = sqlite3.connect(path)
    root = connection.execute("SELECT rootpage FROM sqlite_master WHERE name='messages'")
    at = (root.fetchone()[0] - 1) * PAGE
    connection.close()
    assert raw[at] == 5  # an inner page of a table
    children = struct.unpack_from(">H", raw, at + 3)[0]
    cells = struct.unpack_from(f">{children}H", raw, at + 12)
    leaf = struct.unpack_from(">I", raw, at + cells[0])[0]
    inner = bytes(raw[at : at + PAGE])
    for level in range(6):  # each page has all children of the next one: children ** 6 leaves
        page = bytearray(inner)
        number = len(raw) // PAGE + 2 if level < 5 else leaf
        struct.pack_into(">I", page, 8, number)
        for cell in cells:
            struct.pack_into(">I", page, cell, number)
        if level:
            raw += page
        else:
            struct.pack_into(">I", page, 8, len(raw) // PAGE + 1)
            for cell in cells:
                struct.pack_into(">I", page, cell, len(raw) // PAGE + 1)
            raw[at : at + PAGE] = page
    struct.pack_into(">I", raw, 28, len(raw) // PAGE)
    path.write_bytes(raw)
    return path


def packed_messages(path: Path, random: Random) -> Path:
    """Write a sqlite3 file whose messages unpack to a megabyte each."""
    bomb = zstd.compress(bytes(999_000 + random.randrange(999)))
    db3(path, random)
    connection = sqlite3.connect(path)
    connection.executemany(
        "INSERT INTO messages VALUES(?, 1, ?, ?)", ((1000 + k, k, bomb) for k in range(4000))
    )
    connection.commit()
    connection.close()
    return path


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
VIEW = f"DROP TABLE messages; CREATE VIEW messages AS {ENDLESS} SELECT k AS id, 1 AS topic_id, k AS timestamp, zeroblob(900000) AS data FROM n;"  # noqa: E501
TOPICS = f"DROP TABLE topics; CREATE VIEW topics AS {ENDLESS} SELECT k AS id, '/a' AS name, 'b' AS type, 'cdr' AS serialization_format FROM n;"  # noqa: E501
COMPUTED = "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB AS (zeroblob(900000))); WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n LIMIT 20000) INSERT INTO messages(topic_id, timestamp) SELECT 1, k FROM n;"  # noqa: E501
HIDDEN = f"PRAGMA writable_schema=ON; UPDATE sqlite_master SET sql = 'CREATE VIEW messages AS {ENDLESS} SELECT k AS id, 1 AS topic_id, k AS timestamp, zeroblob(9) AS data FROM n' WHERE name = 'messages';"  # noqa: E501
EMPTY_ROS1 = fields(op=b"\x63") + bytes(4)
FULL_ROS1 = struct.pack("<I", 90_000) + bytes(90_000) + bytes(4)
OTHERS: dict[str, tuple[str, Callable[[Path, Random], Path]]] = {
    **{
        f"MCAP, empty records, {codec}": (
            ".mcap",
            lambda path, random, codec=codec: mcap(path, codec, empty(random)),
        )
        for codec in PACK
    },
    "MCAP, zeros": (".mcap", lambda path, _: mcap(path, "bz2", bytes(1000))),
    "MCAP, empty messages": (".mcap", lambda path, _: mcap(path, "zstd", message(1, b""))),
    "MCAP, large messages": (
        ".mcap", lambda path, _: mcap(path, "bz2", message(1, bytes(999_000)))),
    "MCAP, many joints": (
        ".mcap", lambda path, random: mcap(path, "bz2", message(1, many_names(random)))),
    "MCAP, channels": (
        ".mcap", lambda path, _: mcap(path, "bz2", b"".join(
            channel(k, "/" + "a" * 900) for k in range(30_000)))),
    "ROS 1, empty records": (".bag", lambda path, _: ros1(path, EMPTY_ROS1)),
    "ROS 1, empty fields": (".bag", lambda path, _: ros1(path, FULL_ROS1)),
    "packed MCAP": (".mcap.zstd", lambda path, random: packed(path, random)),
    "db3, a view": (".db3", lambda path, random: db3(path, random, VIEW)),
    "db3, a view of topics": (".db3", lambda path, random: db3(path, random, TOPICS)),
    "db3, a hidden view": (".db3", lambda path, random: db3(path, random, HIDDEN)),
    "db3, a computed column": (".db3", lambda path, random: db3(path, random, COMPUTED)),
    "db3, pages without end": (".db3", looped),
    "db3, packed messages": (".db3", packed_messages),
    "arrays": (".npz", npz),
    "plan, waves": (".plan.yaml", lambda path, _: plan(path, many_waves)),
}  # fmt: skip


def packed(path: Path, random: Random) -> Path:
    """Write an MCAP of packed chunks, packed as a whole once more."""
    inner = mcap(path.with_suffix(""), "bz2", empty(random), 3_000_000)
    path.write_bytes(zstd.compress(inner.read_bytes()))
    inner.unlink()
    return path


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
    **dict.fromkeys((".mcap", ".bag", ".mcap.zstd", ".db3"), Recording.load),
}


def read(path: Path) -> Any:
    """Read a file by what reads its kind."""
    return READERS["".join(path.suffixes)](path)
