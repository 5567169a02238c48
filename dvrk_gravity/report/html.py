"""Pieces of a report: tables, lists, folded parts, and pictures inside the page."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Sequence
from html import escape as html_escape
from typing import TYPE_CHECKING

from dvrk_gravity.errors import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL = (4.0, 2.6)  # inches
# Parts of a panel around its axes: room for numbers, labels and legend. Finding it, picture by
# picture, costs as much as drawing.
_ROOM = {"left": 0.17, "right": 0.98, "bottom": 0.18, "top": 0.89}
_CODE = re.compile(r"`([^`]+)`")
_NUMBER = re.compile(r"(< |[-+−])?(\d[\d.]*|\.\d+)(e[-+]?\d+)?( … .*)?")


def escape(text: str) -> str:
    """Return a text as HTML that shows it; see :func:`printable`."""
    return html_escape(printable(text))


def prose(text: str) -> str:
    """Return a text as HTML, what stands between backticks as code."""
    return _CODE.sub(r"<code>\1</code>", escape(text))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table, every cell escaped; without a head if that is empty.

    Columns that begin with a number are aligned as numbers are.
    """
    rows = list(rows)
    numeric = [bool(_NUMBER.fullmatch(cell)) for cell in rows[0]] if rows else [False] * len(head)

    def line(tag: str, cells: Sequence[str]) -> str:
        kinds = (' class="n"' if number else "" for number in numeric)
        return "".join(
            f"<{tag}{kind}>{prose(cell)}</{tag}>" for kind, cell in zip(kinds, cells, strict=True)
        )

    lines = [f"<tr>{line('th', head)}</tr>"] if head else []
    lines += [f"<tr>{line('td', row)}</tr>" for row in rows]
    return '<div class="table"><table>\n' + "\n".join(lines) + "\n</table></div>"


def item_list(items: Iterable[object], nothing: str = "") -> str:
    """Return a list, every item escaped; of none what stands for it, if anything."""
    texts = [str(item) for item in items] or ([nothing] if nothing else [])
    return "<ul>" + "".join(f"<li>{prose(text)}</li>" for text in texts) + "</ul>"


def collapsible(title: str, *parts: str) -> str:
    """Return parts that a click on their title shows."""
    inside = "\n".join(parts)
    return f"<details><summary>{escape(title)}</summary>\n{inside}\n</details>"


def panel() -> tuple[Figure, Axes]:
    """Return a figure as broad as a phone, with text that can be read there, and its axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_PANEL)
    axes = figure.subplots(gridspec_kw=_ROOM)
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=6)  # numbers that do not touch
    axes.grid(alpha=0.25)
    return figure, axes


def legend(figure: Figure, axes: Axes) -> None:
    """Name a panel's lines above it."""
    figure.legend(
        *axes.get_legend_handles_labels(), loc="upper right", ncols=3, fontsize=8, frameon=False,
        borderaxespad=0.2, columnspacing=1.0, handlelength=1.2,
    )  # fmt: skip


def erase(axes: Axes) -> None:
    """Remove a picture's lines, and forget their limits, for the next: axes take long to make."""
    for line in list(axes.lines):
        line.remove()
    axes.relim()


def picture(address: str, meaning: str, title: str = "") -> str:
    """Return a picture, by its address, with what it shows in words, and a title over it."""
    over = f"<figcaption>{escape(title)}</figcaption>" if title else ""
    return f'<figure>{over}<img alt="{escape(meaning)}" src="{address}"></figure>'


def side_by_side(*pictures: str) -> str:
    """Return pictures side by side where there is room, one below the other on a phone."""
    return f'<div class="pictures">{"".join(pictures)}</div>'


def png(figure: Figure, dpi: float = 110.0) -> bytes:
    """Return a figure as a PNG, on white."""
    return _to_png(figure, dpi, transparent=False)


def inline(figure: Figure, dpi: float = 130.0) -> str:
    """Return a figure as an address that needs no network.

    Its ground is transparent: a page may be dark or light.
    """
    image = _to_png(figure, dpi, transparent=True)
    return "data:image/png;base64," + base64.b64encode(image).decode("ascii")


def _to_png(figure: Figure, dpi: float, transparent: bool) -> bytes:
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)  # a joint's name may have dollar signs
    stream = io.BytesIO()
    # Compressed lightly: a third of the time, for a page larger by a quarter.
    figure.savefig(
        stream, format="png", dpi=dpi, transparent=transparent, pil_kwargs={"compress_level": 1}
    )
    return stream.getvalue()
