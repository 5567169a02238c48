"""Pieces of a report: tables, lists, folded parts, and pictures inside the page."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NUMBER = re.compile(r"[-+−]?(\d[\d.]*|\.\d+)(e[-+]?\d+)?( … .*)?")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table, every cell escaped; without a head if that is empty.

    Columns that begin with a number are aligned as numbers are.
    """
    rows = list(rows)
    numeric = [bool(_NUMBER.fullmatch(cell)) for cell in rows[0]] if rows else [False] * len(head)

    def line(tag: str, cells: Sequence[str]) -> str:
        kinds = (' class="n"' if number else "" for number in numeric)
        return "".join(
            f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, cells, strict=True)
        )

    lines = [f"<tr>{line('th', head)}</tr>"] if head else []
    lines += [f"<tr>{line('td', row)}</tr>" for row in rows]
    return '<div class="table"><table>\n' + "\n".join(lines) + "\n</table></div>"


def listed(items: Iterable[object], nothing: str = "") -> str:
    """Return a list, every item escaped; of none what stands for it, if anything."""
    texts = [str(item) for item in items] or ([nothing] if nothing else [])
    return "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in texts) + "</ul>"


def folded(title: str, *parts: str) -> str:
    """Return parts that a click on their title shows."""
    inside = "\n".join(parts)
    return f"<details><summary>{escape(title)}</summary>\n{inside}\n</details>"


def picture(address: str, meaning: str) -> str:
    """Return a picture, by its address, with what it shows in words."""
    return f'<div class="picture"><img alt="{escape(meaning)}" src="{address}"></div>'


def png(figure: Figure, dpi: float = 110.0) -> bytes:
    """Return a figure as a PNG, on white."""
    return _saved(figure, dpi, transparent=False)


def inline(figure: Figure, dpi: float = 110.0) -> str:
    """Return a figure as an address that needs no network.

    Its ground is transparent: a page may be dark or light.
    """
    image = _saved(figure, dpi, transparent=True)
    return "data:image/png;base64," + base64.b64encode(image).decode("ascii")


def _saved(figure: Figure, dpi: float, transparent: bool) -> bytes:
    stream = io.BytesIO()
    # Compressed lightly: a third of the time, for a page larger by a quarter.
    figure.savefig(
        stream, format="png", dpi=dpi, transparent=transparent, pil_kwargs={"compress_level": 1}
    )
    return stream.getvalue()
