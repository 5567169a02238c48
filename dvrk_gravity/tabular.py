"""Results as tables: a data frame where pandas is installed, HTML in a notebook."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import PackageError, printable

if TYPE_CHECKING:
    import pandas

Columns = Mapping[str, Sequence[object] | Array]
"""A table by its columns, each of the same length; SI units."""


class Tabular:
    """A result with a table, which its class fills in, and a sentence over it."""

    def _columns(self) -> Columns:
        raise NotImplementedError

    def _headline(self) -> str:
        raise NotImplementedError

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the result's table, in SI units.

        Raises:
            PackageError: pandas is not installed.
        """
        return frame_of(self._columns())

    def _repr_html_(self) -> str:
        """Show the sentence and the table where HTML is shown, as in notebooks."""
        columns = self._columns()
        head = "".join(f"<th>{escape(printable(name))}</th>" for name in columns)
        rows = (
            "".join(f"<td>{escape(printable(_shown(cell)))}</td>" for cell in row)
            for row in zip(*columns.values(), strict=True)
        )
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        table = f"<table><tr>{head}</tr>{body}</table>" if body else ""
        return f"<p><b>{escape(printable(self._headline()))}</b></p>{table}"


def frame_of(columns: Columns) -> pandas.DataFrame:
    """Return a data frame of columns.

    Raises:
        PackageError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise PackageError("to_dataframe", "pandas") from None
    return pandas.DataFrame(dict(columns))


def _shown(cell: object) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)
