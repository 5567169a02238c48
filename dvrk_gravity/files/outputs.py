"""Checks of a command's outputs: nothing that it reads, nothing twice, no link, no device.

Every command checks before its work starts: a result that cannot be written is hours lost, one
written over its own recording loses the recording.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.validation import split_link

_NAMING = ("urdf", "arm", "uncertainty")  # keys of file names in our files
_Kind = Literal["file", "folder", "new"]
_BAG_FILES = (".db3", ".mcap")


def check(
    files: Mapping[str, str | Path | None],
    inputs: Iterable[str | Path | None],
    new: Mapping[str, str | Path | None] | None = None,
) -> None:
    """Refuse outputs that a command must not, or cannot, write.

    Args:
        files: Files to be written or replaced, by the option that names them; ``None``: none.
        inputs: Files and folders that are read.
        new: Recordings to be written, by option: files or folders that must not exist yet.

    Raises:
        ConfigError: An output that is an input, in a folder that is an input, another output, a
            link, neither file nor folder, or in a folder that does not exist or is not writable;
            or an input named .yaml that is not YAML.
    """
    inputs = list(inputs)
    wanted: list[tuple[str, Path, _Kind]] = []
    for option, path in files.items():
        if path is not None:
            wanted.append((option, Path(path), "file"))
    for option, path in (new or {}).items():
        if path is not None:
            wanted.append((option, Path(path), "new"))
    _check(wanted, inputs)
    for option, path, _ in wanted:
        _writable(option, path, path.absolute().parent)
    _require_legible(inputs)


def check_folder(
    option: str,
    named: str,
    files: Iterable[str],
    inputs: Iterable[str | Path | None],
    folders: Iterable[str] = (),
) -> Path:
    """Return a folder for outputs, which need not exist yet; see :func:`check`.

    Args:
        option: The option that names the folder.
        named: Its name as given; an empty one is refused, not taken for the working directory.
        files: Names of the files to be written there.
        inputs: Files and folders that are read.
        folders: Names of folders to be written there, which replace earlier ones.

    Raises:
        ConfigError: As :func:`check`, or no name at all.
    """
    if not named:
        raise ConfigError(option, named, "a folder")
    folder, inputs = Path(named), list(inputs)
    _check([(option, folder, "folder")], inputs, holds=True)
    wanted: list[tuple[str, Path, _Kind]] = [(option, folder / name, "file") for name in files]
    wanted += [(option, folder / name, "folder") for name in folders]
    _check(wanted, inputs)
    existing = folder.absolute()
    while not existing.exists():
        existing = existing.parent
    _writable(option, folder, existing)
    _require_legible(inputs)
    return folder


def require_unread(name: str, path: Path, read: str | Path) -> None:
    """Refuse to write over a file that is read, or over one that it names.

    Raises:
        ConfigError: Naming it; or the file that is read, if it cannot be searched for names.
    """
    for source in _with_named_files(str(read), set()):
        if _same(path, source):
            raise ConfigError(name, f"{source.name}, which is read", "another name", path)
    if path.exists():  # else nothing can be lost
        _require_legible([read])


def _check(
    wanted: Iterable[tuple[str, Path, _Kind]],
    inputs: Iterable[str | Path | None],
    holds: bool = False,
) -> None:
    """Check outputs, not the folders that they are in; one that ``holds`` others may be full."""
    read = [
        named
        for path in inputs
        if path is not None
        for named in _with_named_files(str(path), set())
    ]
    # A bag's file is read without its metadata, which must not be lost either.
    read += [path.with_name("metadata.yaml") for path in read if path.suffix in _BAG_FILES]
    before: list[tuple[str, Path]] = []
    for option, path, kind in wanted:
        for source in read:
            inside = source.is_dir() and _within(path, source)
            if (
                _same(path, source)
                or inside
                or (kind == "folder" and not holds and _within(source, path))
            ):
                raise ConfigError(option, f"{source.name}, which is read", "another name", path)
        for other, earlier in before:
            if _same(path, earlier) or _within(path, earlier):
                raise ConfigError(option, f"what is written as {other}", "another name", path)
        before.append((option, path))
        if path.is_symlink():
            raise ConfigError(
                option,
                f"a link to {os.readlink(path)}",
                f"a {'new name' if kind == 'new' else kind}, not a link",
                path,
            )
        _check_kind(option, path, kind)


def _with_named_files(path: str, seen: set[Path]) -> Iterator[Path]:
    """Yield a file, and those that it names: a model its arm's and its own, an arm its URDF."""
    file = Path(split_link(path)[0])
    yield file
    if file in seen or not _is_yaml(file):
        return
    seen.add(file)
    # An illegible one names nothing here, and is refused before anything is written.
    with suppress(ConfigError):
        for name in _names_in(yaml_file.load(file)):
            for folder in (file.parent, Path()):
                with suppress(OSError):  # a name that no file can have
                    if Path(split_link(str(folder / name))[0]).is_file():
                        yield from _with_named_files(str(folder / name), seen)


def _names_in(content: Any) -> Iterator[str]:
    """Yield the files that some YAML content names, at whatever depth a reader may look."""
    if isinstance(content, list):
        for item in content:
            yield from _names_in(item)
    elif isinstance(content, dict):
        for key, value in content.items():
            if isinstance(value, str) and str(key).rpartition(".")[2] in _NAMING:
                yield value
            yield from _names_in(value)


def _require_legible(inputs: Iterable[str | Path | None]) -> None:
    """Refuse illegible YAML files: they may name a file that is to be written."""
    for path in inputs:
        for file in () if path is None else _with_named_files(str(path), set()):
            if _is_yaml(file):
                yaml_file.load(file)


def _is_yaml(file: Path) -> bool:
    return file.suffix.lower() in (".yaml", ".yml") and file.is_file()


def _check_kind(option: str, path: Path, kind: _Kind) -> None:
    if not path.exists():
        return
    found = "a file" if path.is_file() else "a folder" if path.is_dir() else "a device or pipe"
    if kind == "new":
        raise ConfigError(option, f"{found} that exists already", "a new name", path)
    if found != f"a {kind}":
        raise ConfigError(option, found, f"a {kind}", path)


def _writable(option: str, path: Path, folder: Path) -> None:
    if not folder.is_dir():
        raise ConfigError(option, str(folder), "an existing folder", path)
    if not os.access(folder, os.W_OK):
        raise ConfigError(option, str(folder), "a folder that can be written to", path)


def _same(path: Path, other: Path) -> bool:
    """Return whether two names are one file's, by links of either kind, existing or not."""
    if os.path.realpath(path) == os.path.realpath(other):
        return True
    return path.exists() and other.exists() and path.samefile(other)


def _within(path: Path, folder: Path) -> bool:
    """Return whether a path lies below a folder."""
    return Path(os.path.realpath(folder)) in Path(os.path.realpath(path)).parents
