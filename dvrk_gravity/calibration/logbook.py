"""What a calibration has done so far: its steps, and the hash of every file that they left."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from dvrk_gravity import __version__
from dvrk_gravity.calibration.tally import MotionTally
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file, text_file

FORMAT = 1
FILE = "calibration.json"
_BLOCK = 1 << 20  # bytes that are hashed at a time
_TEMPORARY = re.compile(r"\..+\.(html|json|npz|png|yaml)\.[a-z0-9_]{8}")


@dataclass(frozen=True)
class Entry:
    """One step that is done.

    Attributes:
        step: Its name.
        said: What it found, in a line.
        files: SHA-256 of each file that it left, by path within the folder.
        motion: How the arm was moved, by name; empty: it was not.
        version: Of this package.
    """

    step: str
    said: str
    files: Mapping[str, str]
    motion: Mapping[str, Any]
    version: str = __version__


class Logbook:
    """The steps of one calibration, in its folder's file; written whole or not at all.

    Attributes:
        folder: The folder.
        asked: What was asked for, by option.
        entries: The steps that are done, in their order.
        begun: How earlier processes moved the arm in the step that is not done yet; empty: they did
            not.
    """

    def __init__(
        self,
        folder: Path,
        asked: Mapping[str, str],
        entries: Iterable[Entry],
        begun: Mapping[str, Any] | None = None,
    ) -> None:
        self.folder, self.asked, self.entries = folder, dict(asked), list(entries)
        self.begun = dict(begun or {})
        self._moving = self.begun  # with what the present process has moved it in that step

    @classmethod
    def open(cls, folder: Path, asked: Mapping[str, str]) -> Logbook:
        """Return the logbook of a folder: a new one's, or as far as an earlier process came.

        Args:
            folder: The folder; it exists.
            asked: What is asked for, by option, with the hash of each file that is read.

        Raises:
            ConfigError: What is asked for differs from what the folder was begun with; a file was
                changed or removed since; or the folder holds something else.
        """
        file, left = folder / FILE, _half_written(folder)
        if not file.exists():
            others = sorted({path.name for path in folder.iterdir()} - {path.name for path in left})
            if others:
                raise ConfigError(
                    "--out", f"a folder with {others[0]}",
                    f"a new folder, or one that `calibrate` began (with {FILE})", folder,
                )  # fmt: skip
            book = cls(folder, asked, ())
            book._write()
            return book
        content = json_file.load(file)
        try:
            if content["format"] != FORMAT:
                raise ConfigError("format", content["format"], f"{FORMAT}", file)
            before = {str(name): str(value) for name, value in content["asked"].items()}
            entries = [_entry(entry) for entry in content["steps"]]
            begun = dict(content.get("begun", {}))
            MotionTally.total([begun] if begun else [])
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ConfigError("", str(error), "a file as `calibrate` writes it", file) from None
        # Nothing rests on what was asked for before the first step: limits that no motion keeps may
        # be mended. Earlier versions noted, too, what concerns no file: --no-rehearsal.
        for name in asked if entries or begun else ():
            if before.get(name) != asked.get(name):
                raise ConfigError(
                    name, asked.get(name),
                    f"{before.get(name) or 'nothing'}, with which {folder} was begun; or another "
                    "--out",
                )  # fmt: skip
        book = cls(folder, asked, entries, begun)
        book.require_unchanged()
        for path in left:
            path.unlink()
        return book

    def require_unchanged(self) -> None:
        """Check that every file is as its step left it: what follows is based on them.

        Raises:
            ConfigError: One was changed or removed.
        """
        # Of the last step that wrote it: earlier versions' release wrote the model again.
        left_by = {name: entry for entry in self.entries for name in entry.files}
        for name, entry in left_by.items():
            found = _hash_or_none(self.folder / name)
            if found != entry.files[name]:
                what = "no file" if found is None else "a file that was changed since"
                raise ConfigError(
                    "", what, f"it as the step {entry.step!r} left it; put it back, or begin "
                    "with another --out", self.folder / name,
                )  # fmt: skip

    @staticmethod
    def steps_in(folder: Path) -> list[str]:
        """Return the names of the steps that are done in a folder, unchecked."""
        file = folder / FILE
        return [entry["step"] for entry in json_file.load(file)["steps"]] if file.exists() else []

    def entry(self, step: str) -> Entry | None:
        """Return what a step left, ``None`` if it is not done."""
        return next((entry for entry in self.entries if entry.step == step), None)

    def add(self, step: str, said: str, paths: Iterable[Path], motion: Mapping[str, Any]) -> Entry:
        """Note that a step is done, and the hashes of its files and of all in its folders.

        Its motion is that of the present process; that of earlier ones is added.
        """
        if motion and self.begun:
            motion = asdict(MotionTally.total([self.begun, motion]))
        self.begun = self._moving = {}
        files = {
            path.relative_to(self.folder).as_posix(): file_hash(path)
            for path in _files(paths)
        }  # fmt: skip
        entry = Entry(step, said, files, motion)
        self.entries.append(entry)
        self._write()
        return entry

    def note_motion(self, motion: MotionTally) -> None:
        """Note how the arm was moved so far in the step that is not done yet, by this process."""
        before = [self.begun] if self.begun else []
        self._moving = asdict(MotionTally.total([*before, asdict(motion)]))
        self._write()

    def recorded(self, name: str) -> Entry | None:
        """Return the step that recorded a motion, ``None`` if there is no such recording."""
        entry = self.entry(f"collect {name}")
        return entry if entry is not None and entry.files else None

    @property
    def total(self) -> MotionTally:
        """How the arm was moved in all steps that are done."""
        return MotionTally.total(entry.motion for entry in self.entries if entry.motion)

    @property
    def files(self) -> dict[str, str]:
        """SHA-256 of every file so far, by path within the folder."""
        return {name: known for entry in self.entries for name, known in entry.files.items()}

    def _write(self) -> None:
        content: dict[str, Any] = {
            "format": FORMAT,
            "asked": self.asked,
            "steps": [asdict(entry) for entry in self.entries],
            "begun": self._moving,
        }
        text_file.write(self.folder / FILE, json.dumps(content, indent=1) + "\n")


def _entry(content: Mapping[str, Any]) -> Entry:
    """Return a step; raise TypeError or ValueError for what :meth:`Logbook.add` does not write."""
    entry = Entry(**content)
    MotionTally.total([entry.motion] if entry.motion else [])
    return replace(entry, files=dict(entry.files))


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file.

    Raises:
        OSError: It cannot be read.
    """
    found = hashlib.sha256()
    with open(path, "rb") as stream:
        while block := stream.read(_BLOCK):
            found.update(block)
    return found.hexdigest()


def _hash_or_none(path: Path) -> str | None:
    try:  # a pipe or a device has no end
        return file_hash(path) if path.is_file() else None
    except OSError:
        return None


def _files(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield files, and those in folders."""
    for path in paths:
        if path.is_dir():
            yield from sorted(each for each in path.rglob("*") if each.is_file())
        else:
            yield path


def _half_written(folder: Path) -> list[Path]:
    """Return what killed processes have half written: ``text_file`` names it .NAME.RANDOM."""
    return [path for path in folder.iterdir() if path.is_file() and _TEMPORARY.fullmatch(path.name)]
