"""Results in a folder: each a Parquet file under its key, written once and whole.

The folder ``results/`` is one table to whatever reads Parquet. Loose files of thousands of results
are slow to open: :meth:`Store.compact` joins them; a reader sees each result once, whenever it
looks, for a result that is in two files is counted by its key.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dvrk_gravity import __version__
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file
from dvrk_gravity.fleet import rows
from dvrk_gravity.fleet.worker import Result, Unit, key_of

if TYPE_CHECKING:
    import pyarrow

RESULTS, REPORTS, MODELS = "results", "reports", "models"
LOOSE = 2000
"""Results in files of their own, from which on they are joined: half a second to open. Chosen."""


@dataclass
class Store:
    """The results in a folder.

    Attributes:
        folder: The folder.
    """

    folder: Path
    _seen: set[tuple[str, int, int, str]] = field(default_factory=set)
    _contents: dict[tuple[str, str], set[str]] = field(default_factory=dict)

    @classmethod
    def open(cls, folder: Path) -> Store:
        """Open a folder, made where there is none, and look which results it has.

        Raises:
            OSError: It cannot be made.
            ConfigError: It has a file that is no result.
        """
        for name in (RESULTS, REPORTS, MODELS):
            (folder / name).mkdir(parents=True, exist_ok=True)
        store = cls(folder)
        wanted = ("recording", "size", "modified", "model", "serial", "content", "version")
        for row in table(folder, ("recording",), wanted).to_pylist():
            if row["version"] == __version__:
                store._note(
                    row["recording"], row["size"], row["modified"], row["model"], row["serial"],
                    row["content"],
                )  # fmt: skip
        return store

    def has(self, unit: Unit) -> bool:
        """Return whether a file's result is there, by its name, size and time, unread."""
        return (unit.recording, unit.size, unit.modified, unit.model_hash) in self._seen

    def contents(self, serial: str, model: str) -> frozenset[str]:
        """Return the contents of an arm's recordings whose results beside a model are there."""
        return frozenset(self._contents.get((serial, model), ()))

    def write(self, result: Result) -> None:
        """Write a result, its report before it: what is there is whole.

        Raises:
            OSError: The disk is full, or the folder gone.
        """
        if result.report:
            text_file.write(self.folder / REPORTS / f"{result.key}.html", result.report, wait=False)
        text_file.write_bytes(self._file(result.key), result.table, wait=False)

    def write_model(self, serial: str, files: tuple[bytes, bytes]) -> Path:
        """Write an arm's model, its uncertainty before it, and return its path."""
        from dvrk_gravity.model import uncertainty_file

        path = self.model(serial)
        text_file.write_bytes(uncertainty_file(path), files[1])
        text_file.write_bytes(path, files[0])
        return path

    def model(self, serial: str) -> Path:
        """Return where an arm's model is, or would be, that one of its recordings has."""
        return self.folder / MODELS / f"{serial}.yaml"

    def compact(self, least: int = LOOSE) -> int:
        """Join the results that have files of their own, if there are so many.

        Returns:
            How many were joined.
        """
        from pyarrow import parquet

        loose = sorted((self.folder / RESULTS).glob("[0-9a-f]*.parquet"))
        if len(loose) < max(least, 2):
            return 0
        whole = _read(loose, None, ()).combine_chunks()
        first = key_of(" ".join(path.stem for path in loose), "")
        target = self.folder / RESULTS / f"joined-{first}.parquet"
        hidden = target.with_name(f".{target.name}")
        parquet.write_table(whole, hidden, compression="zstd")
        hidden.replace(target)
        for path in loose:
            path.unlink()
        return len(loose)

    def _file(self, key: str) -> Path:
        return self.folder / RESULTS / f"{key}.parquet"

    def _note(
        self, recording: str, size: int, modified: int, model: str, serial: str, content: str
    ) -> None:
        self._seen.add((recording, size, modified, model))
        self._contents.setdefault((serial, model), set()).add(content)


def table(
    folder: Path, kinds: Collection[str] = (), columns: Sequence[str] = (), serial: str = ""
) -> pyarrow.Table:
    """Return the rows of a folder's results, each result once.

    Args:
        folder: The folder that ``fleet --out`` names.
        kinds: Kinds of rows; empty: all.
        columns: Their columns; empty: all.
        serial: Of one arm; ``""``: of all.

    Raises:
        ConfigError: No folder of results, or a file there that is none.
    """
    results = folder / RESULTS
    if not results.is_dir():
        raise ConfigError("", "no folder of results", "the folder of `fleet --out`", folder)
    files = sorted(results.glob("*.parquet"))
    from pyarrow import compute as pc

    condition: Any = None
    if kinds:
        condition = pc.field("kind").isin(sorted(kinds))
    if serial:
        its = pc.field("serial") == serial
        condition = its if condition is None else condition & its
    return _read(files, condition, columns)


def _read(files: Sequence[Path], condition: Any, columns: Sequence[str]) -> pyarrow.Table:
    """Return the rows of some files; those of a result that two have, from the first."""
    import pyarrow as pa
    from pyarrow import dataset

    if not files:
        return rows.schema().empty_table().select(list(columns or rows.COLUMNS))
    names = list(columns or rows.COLUMNS)
    joined = [path for path in files if path.name.startswith("joined-")]
    loose = [path for path in files if path not in set(joined)]
    try:
        parts, known = [], set[str]()
        for group in (joined, loose):
            fresh = [str(path) for path in group if path.stem not in known]
            if not fresh:
                continue
            source = dataset.dataset(fresh, schema=rows.schema(), format="parquet")
            parts.append(source.to_table(columns=names, filter=condition))
            if group is joined and loose:
                keys = source.to_table(columns=["key"]).column("key").unique()
                known = set(keys.to_pylist())
        return pa.concat_tables(parts) if parts else rows.schema().empty_table().select(names)
    except (pa.ArrowInvalid, pa.ArrowTypeError, OSError) as error:
        raise ConfigError("", " ".join(str(error).split())[:200], "results of `fleet`",
                          files[0].parent) from error  # fmt: skip
