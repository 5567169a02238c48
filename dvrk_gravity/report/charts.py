"""Line charts as SVG: a plotting library loads and draws for as long as an identification takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

from dvrk_gravity.arrays import Array

WIDTH = 900  # of a chart, px
_FINE = 10  # places a point may have within a px, along either axis
_LEFT, _RIGHT, _BOTTOM, _BETWEEN = 76.0, 12.0, 46.0, 20.0  # px around and between panels
_TOP, _LINE = 26.0, 15.0  # px of the legend, and of each line of a title
_MARGIN = 0.05  # part of the data's range left free at either end
_TICKS = {"x": 80.0, "y": 45.0}  # px between numbers, about
_INK, _GRID = "#333333", "#e6e6e6"


@dataclass(frozen=True, eq=False)
class Curve:
    """A line, or dots.

    Attributes:
        x: (N,).
        y: (N,).
        color: As CSS writes it.
        width: Of the line or the dots, px.
        label: In the legend, if any.
        dots: Whether its points are not connected.
    """

    x: Array
    y: Array
    color: str
    width: float
    label: str = ""
    dots: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with curves, the first one at the back.

    Attributes:
        curves: At least one.
        x: What the horizontal axis is.
        y: What the vertical axis is; empty: its numbers are those of the panel to the left.
        title: Lines above it.
        zero: Whether a line marks the vertical zero.
    """

    curves: Sequence[Curve]
    x: str = ""
    y: str = ""
    title: Sequence[str] = field(default=())
    zero: bool = False


def chart(rows: Sequence[Sequence[Panel]], height: float, same_scale: bool = True) -> bytes:
    """Return panels side by side and below each other as an SVG image.

    Args:
        rows: Panels, as many in each row.
        height: Of a row, px.
        same_scale: Whether panels of a row have the same vertical scale.
    """
    size = f"{WIDTH} {_TOP + height * len(rows):g}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" width="{WIDTH}" '
        f'font-family="DejaVu Sans, Arial, sans-serif" font-size="12" fill="{_INK}">'
        '<rect width="100%" height="100%" fill="white"/>',
        _legend(rows),
    ]
    for number, row in enumerate(rows):
        spans = [_span(panel, "y") for panel in row]
        if same_scale:
            spans = [(min(low for low, _ in spans), max(high for _, high in spans))] * len(row)
        left = _LEFT if same_scale else 0.0
        share = (WIDTH - left - _RIGHT + _BETWEEN) / len(row)
        for column, (panel, span) in enumerate(zip(row, spans, strict=True)):
            start = left + column * share + (0.0 if same_scale else _LEFT)
            top = _TOP + number * height + _LINE * len(panel.title)
            box = (
                start, top, left + (column + 1) * share - _BETWEEN,
                _TOP + (number + 1) * height - _BOTTOM,
            )  # fmt: skip
            parts += _panel(panel, box, span, numbered=column == 0 or not same_scale)
    return "\n".join([*parts, "</svg>"]).encode()


Box = tuple[float, float, float, float]  # left, top, right, bottom, px


def _panel(panel: Panel, box: Box, span: tuple[float, float], numbered: bool) -> Iterator[str]:
    left, top, right, bottom = box
    horizontal = _Scale(*_span(panel, "x"), left, right)
    vertical = _Scale(*span, bottom, top)
    middle = 0.5 * (left + right)
    for number, line in enumerate(reversed(panel.title)):
        yield _text(middle, top - 6.0 - _LINE * number, line, "middle")
    across, up = horizontal.ticks(_TICKS["x"]), vertical.ticks(_TICKS["y"])
    grid = [f"M{at:.1f} {top:.1f}V{bottom:.1f}" for at, _ in across]
    grid += [f"M{left:.1f} {at:.1f}H{right:.1f}" for at, _ in up]
    yield f'<path d="{"".join(grid)}" stroke="{_GRID}" fill="none"/>'
    if panel.zero and span[0] < 0.0 < span[1]:
        zero = float(vertical(np.zeros(1))[0])
        yield f'<path d="M{left:.1f} {zero:.1f}H{right:.1f}" stroke="#999999" stroke-width=".6"/>'
    yield f'<path d="M{left:.1f} {top:.1f}V{bottom:.1f}H{right:.1f}" stroke="{_INK}" fill="none"/>'
    for at, text in across:
        yield _text(at, bottom + 16.0, text, "middle")
    yield _text(middle, bottom + 36.0, panel.x, "middle")
    if numbered:
        for at, text in up:
            yield _text(left - 6.0, at + 4.0, text, "end")
    if panel.y:
        x, y = left - 58.0, 0.5 * (top + bottom)
        yield (
            f'<text transform="translate({x:.1f} {y:.1f}) rotate(-90)" text-anchor="middle">'
            f"{escape(panel.y)}</text>"
        )
    for curve in panel.curves:
        yield _drawn(curve, horizontal, vertical)


def _drawn(curve: Curve, horizontal: _Scale, vertical: _Scale) -> str:
    """Return a curve; each point is relative to the one before, which is short."""
    points = np.stack([horizontal(curve.x), vertical(curve.y)], axis=1)
    points = np.rint(_FINE * points[np.isfinite(points).all(axis=1)]).astype(int)
    if not len(points):
        return ""
    steps = np.diff(points, axis=0)
    if curve.dots:
        path = "h0" + "".join(f"m{x} {y}h0" for x, y in steps.tolist())
    else:
        path = "l" + " ".join(map(str, steps.ravel().tolist()))
    (x, y), width = points[0].tolist(), f"{_FINE * curve.width:g}"
    return (
        f'<path transform="scale({1.0 / _FINE:g})" d="M{x} {y}{path}" stroke="{curve.color}" '
        f'stroke-width="{width}" stroke-linecap="round" stroke-linejoin="round" fill="none"/>'
    )


@dataclass(frozen=True)
class _Scale:
    """From values between ``low`` and ``high`` to places between ``start`` and ``end``, px."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, values: Array) -> Array:
        share = (np.asarray(values) - self.low) / (self.high - self.low)
        return np.asarray(self.start + share * (self.end - self.start))

    def ticks(self, apart: float) -> list[tuple[float, str]]:
        """Return places and texts of round numbers, about so many px apart."""
        wanted = (self.high - self.low) * apart / abs(self.end - self.start)
        power = 10.0 ** np.floor(np.log10(wanted))
        step = power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= wanted)
        digits = max(0, -int(np.floor(np.log10(step * 1.001))))
        numbers = np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1.0) * step
        texts = (f"{number:.{digits}f}" for number in (numbers + 0.0).tolist())
        return list(zip(self(numbers).tolist(), texts, strict=True))


def _span(panel: Panel, axis: str) -> tuple[float, float]:
    """Return the least and the greatest value to show."""
    values = np.concatenate([np.ravel(getattr(curve, axis)) for curve in panel.curves])
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    free = _MARGIN * (high - low) if high > low else max(_MARGIN * abs(low), 1e-3)
    return low - free, high + free


def _legend(rows: Sequence[Sequence[Panel]]) -> str:
    named = {
        curve.label: curve.color
        for row in rows for panel in row for curve in panel.curves if curve.label
    }  # fmt: skip
    entries = "&#160;&#160;&#160; ".join(
        f'<tspan fill="{color}" font-weight="bold">&#8212;</tspan> {escape(label)}'
        for label, color in named.items()
    )
    return f'<text x="{WIDTH - _RIGHT:g}" y="16" text-anchor="end">{entries}</text>'


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'
