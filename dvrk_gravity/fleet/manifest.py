"""Which recordings are of which arm: ``fleet.yaml``, strictly read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Any

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import entries, text_file, yaml_file
from dvrk_gravity.recording import is_bag, is_recording

MANIFEST = "fleet.yaml"
_KEYS = ("serial", "arm", "model", "recordings", "topic")
_HEAD = """\
# Which recordings are of which arm. `arm`: a name that `identify --arm` takes, or a file; `model`:
# what its recordings are compared with (left out: the first recording's own); `recordings`: paths
# or patterns (** for folders at any depth) as seen from this file, or URLs; `topic`: of a bag that
# has several arms.
"""


@dataclass(frozen=True)
class ArmEntry:
    """One arm of a fleet.

    Attributes:
        serial: Its serial number, or whatever it is known by: no two arms have the same.
        arm: Its kind, as ``--arm`` of identify: a name, or the path of a file.
        recordings: Paths, patterns and URLs of its recordings.
        model: Path or URL of its model's file; ``""``: its first recording is identified.
        topic: JointState topic in bags; ``""``: the only one.
    """

    serial: str
    arm: str
    recordings: tuple[str, ...]
    model: str = ""
    topic: str = ""

    def files(self) -> Iterator[str]:
        """Yield the paths and URLs that its patterns match, each once, in their order.

        Raises:
            ConfigError: A pattern that matches no recording.
        """
        seen = set[str]()
        for pattern in self.recordings:
            found = _remote(pattern) if is_url(pattern) else _local(pattern)
            if not found:
                raise ConfigError(
                    f"arms.{self.serial}.recordings", pattern,
                    "the pattern of at least one recording (a csv, or a bag's folder or file)",
                )  # fmt: skip
            for name in found:
                if name not in seen:
                    seen.add(name)
                    yield name

    def to_yaml(self) -> dict[str, Any]:
        """Return its entry of the file."""
        optional = {"model": self.model, "topic": self.topic}
        return {
            "serial": self.serial, "arm": self.arm,
            **{key: value for key, value in optional.items() if value},
            "recordings": list(self.recordings),
        }  # fmt: skip


@dataclass(frozen=True)
class Manifest:
    """The arms of a fleet; paths are as seen from the working directory.

    Attributes:
        arms: The arms, in the order of the file.
    """

    arms: tuple[ArmEntry, ...]

    @classmethod
    def load(cls, path: str | Path) -> Manifest:
        """Read a manifest, or that of a folder.

        Raises:
            ConfigError: None there, or a wrong, unknown or missing entry; it names file and arm.
        """
        path = Path(path)
        file = path / MANIFEST if path.is_dir() else path
        if not file.exists():
            way = (
                f"a {MANIFEST} there: `fleet --scan {path}` writes one"
                if path.is_dir()
                else "a file"
            )
            raise ConfigError("", "no such file", way, file)
        try:
            return cls._parse(yaml_file.load(file), file.parent)
        except ConfigError as error:
            raise error if error.source else error.in_file(file) from None

    @classmethod
    def of(cls, paths: Sequence[str | Path]) -> Manifest:
        """Return the arms of several manifests.

        Raises:
            ConfigError: As of :meth:`load`; or one arm in two of them.
        """
        arms = tuple(arm for path in paths for arm in cls.load(path).arms)
        _require_once(arms)
        return cls(arms)

    def save(self, path: Path) -> None:
        """Write the manifest, with paths as they are."""
        lines = [f"{_HEAD}arms:"]
        for arm in self.arms:  # a line for each entry, of which a person changes some
            first, *others = yaml_file.dump(arm.to_yaml()).splitlines()
            lines += [f"- {first}", *(f"  {line}" for line in others)]
        text_file.write(path, "\n".join(lines) + "\n")

    @classmethod
    def _parse(cls, content: Any, folder: Path) -> Manifest:
        entries.mapping("", content, ("arms",), ("arms",))
        rows = entries.sequence("arms", content["arms"])
        arms = tuple(_entry(f"arms[{k}]", row, folder) for k, row in enumerate(rows))
        _require_once(arms)
        return cls(arms)


def is_url(text: str) -> bool:
    """Return whether a text is a URL, ``protocol://…``, and no path."""
    return "://" in text


def _require_once(arms: Sequence[ArmEntry]) -> None:
    seen = set[str]()
    for arm in arms:
        if arm.serial in seen:
            raise ConfigError("serial", arm.serial, "one entry for each arm")
        seen.add(arm.serial)


def _entry(where: str, row: Any, folder: Path) -> ArmEntry:
    entries.mapping(where, row, _KEYS, ("serial", "arm", "recordings"))
    texts = {key: _text(f"{where}.{key}", row[key]) for key in row if key != "recordings"}
    given = row["recordings"]
    patterns = [given] if isinstance(given, str) else entries.sequence(f"{where}.recordings", given)
    if not patterns:
        raise ConfigError(f"{where}.recordings", given, "at least one path or pattern")
    recordings = tuple(
        _from(folder, _text(f"{where}.recordings[{k}]", each)) for k, each in enumerate(patterns)
    )
    if any(mark in texts["serial"] for mark in "/\\\0") or texts["serial"].startswith("."):
        raise ConfigError(f"{where}.serial", texts["serial"], "a text that can be a file's name")
    for key in ("model", "arm"):
        if (text := texts.get(key, "")) and text.endswith((".yaml", ".yml", ".urdf", ".json")):
            texts[key] = _from(folder, text)
    return ArmEntry(
        texts["serial"], texts["arm"], recordings, texts.get("model", ""), texts.get("topic", "")
    )


def _text(where: str, value: Any) -> str:
    """Return a text; a serial number is one, whether or not YAML takes it for a number."""
    if isinstance(value, bool) or not isinstance(value, str | int) or not str(value).strip():
        raise ConfigError(where, value, "a text")
    return str(value).strip()


def _from(folder: Path, text: str) -> str:
    return text if is_url(text) else str(folder / text)


def _local(pattern: str) -> list[str]:
    """Return the recordings that a pattern matches; of the files in a bag's folder, the folder."""
    found = [pattern] if Path(pattern).exists() else sorted(glob(pattern, recursive=True))
    paths = [Path(name) for name in found]
    return [str(path) for path in paths if is_whole_recording(path)]


def is_whole_recording(path: Path) -> bool:
    """Return whether a path is a recording: a csv, a bag's file, or its folder, but no part."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or any(
            is_bag(each) for each in path.iterdir() if each.is_file()
        )
    part = (path.parent / "metadata.yaml").is_file() and is_bag(path)
    return path.is_file() and is_recording(path) and not part


def _remote(pattern: str) -> list[str]:
    from dvrk_gravity.fleet.remote import list_matches

    return list_matches(pattern)
