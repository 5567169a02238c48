"""Quantities as a person writes them: from SI numbers to `12.3 ± 0.4 mN·m`.

For sentences, tables and reports; files that programs read keep SI numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

# Of each SI unit, from small to large: the size from which a unit is used, its factor, its name.
_UNITS: dict[str, tuple[tuple[float, float, str], ...]] = {
    "N·m": ((0.0, 1e6, "µN·m"), (5e-5, 1e3, "mN·m"), (1.0, 1.0, "N·m")),
    "N": ((0.0, 1e3, "mN"), (1.0, 1.0, "N")),
    "m": ((0.0, 1e3, "mm"), (1.0, 1.0, "m")),
    "m/s": ((0.0, 1e3, "mm/s"), (1.0, 1.0, "m/s")),
    "N·m/rad": ((0.0, 1e3, "mN·m/rad"), (1.0, 1.0, "N·m/rad")),
    "N·m·s/rad": ((0.0, 1e3, "mN·m·s/rad"), (1.0, 1.0, "N·m·s/rad")),
    "kg": ((0.0, 1e3, "g"), (1.0, 1.0, "kg")),
    "kg·m": ((0.0, 1e5, "g·cm"), (0.01, 1e2, "kg·cm")),
    "kg·m^2": ((0.0, 1e7, "g·cm²"), (1e-4, 1e4, "kg·cm²"), (0.1, 1.0, "kg·m²")),
    "s": ((0.0, 1e3, "ms"), (0.5, 1.0, "s")),
    "rad": ((0.0, math.degrees(1.0), "deg"),),
    "rad/s": ((0.0, math.degrees(1.0), "deg/s"),),
    "rad/s^2": ((0.0, math.degrees(1.0), "deg/s²"),),
    "1/rev": ((0.0, 1.0, "per turn"),),
}
_POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_DIGITS = 3  # of a number without an interval
_OF_HALF = 2  # of half an interval; the value gets as many decimals
_MOST = 6  # digits of a value, however narrow its interval
_READABLE = (1e-4, 1e6)  # beyond, digits are counted more easily in an exponent


def quantity(value: float, unit: str, half: float = 0.0) -> str:
    """Return a number, half its interval where there is one, and a unit that suits its size.

    Args:
        value: In SI units.
        unit: SI unit as model files and findings have it (``N·m``, ``kg·m^2``), ``""`` if none.
        half: Half of the interval; 0: none is shown.
    """
    shown, spread, name = _shown((value,), half, unit)
    text = shown[0] if float(spread) == 0.0 else f"{shown[0]} ± {spread}"
    return f"{text} {name}".rstrip()


def in_one_unit(values: Sequence[float], unit: str) -> list[str]:
    """Return each of some numbers with the unit that suits the largest, to compare them.

    Args:
        values: In SI units.
        unit: SI unit, as for :func:`quantity`.
    """
    factor, name = suited(max(map(abs, values)), unit)
    texts = (_rounded_texts([value * factor], 0.0)[0][0] for value in values)
    return [f"{text} {name}".rstrip() for text in texts]


def interval(value: float, low: float, high: float, unit: str) -> str:
    """Return a number with both ends of its interval: `12.30 (11.90 to 13.40) mN·m`.

    Args:
        value: In SI units.
        low: Lower end, likewise.
        high: Upper end, likewise.
        unit: SI unit, as for :func:`quantity`.
    """
    # As many digits as its nearer end needs.
    half = min((side for side in (value - low, high - value) if side > 0.0), default=0.0)
    (text, *ends), _, name = _shown((value, low, high), half, unit)
    return f"{text} ({' to '.join(ends)}) {name}".rstrip()


def _shown(values: Sequence[float], half: float, unit: str) -> tuple[list[str], str, str]:
    """Return values and half an interval in the unit that suits them, to the interval's digits."""
    factor, name = suited(max(half, *map(abs, values)), unit)
    texts, spread = _rounded_texts([value * factor for value in values], half * factor)
    return texts, spread, name


def suited(size: float, unit: str) -> tuple[float, str]:
    """Return factor and name of the unit that suits a size, in SI units."""
    factor, name = 1.0, _superscript(unit)
    for least, larger, shown in _UNITS.get(unit, ()):
        if size >= least or size == 0.0:
            factor, name = larger, shown
    return factor, name


def _rounded_texts(numbers: Sequence[float], width: float) -> tuple[list[str], str]:
    """Return numbers and half an interval, to the interval's digits."""
    decimals = _decimals(max(numbers, key=abs), width)
    if decimals is None:
        return [f"{number:.{_DIGITS}g}" for number in numbers], f"{width:.{_OF_HALF}g}"
    # Adding zero makes 0 of -0.
    texts = [f"{round(number, decimals) + 0.0:.{decimals}f}" for number in numbers]
    return texts, f"{width:.{decimals}f}"


def percent(part: float) -> str:
    """Return a part in percent, with two digits or as a whole number: never as a power of ten."""
    value = 100.0 * part
    return f"{value:.0f} %" if abs(value) >= 99.5 else f"{value:.2g} %"


def fixed(size: float, decimals: int) -> str:
    """Return a size with so many decimals; `< 0.01` of one that is not zero and would show as it.

    Args:
        size: In the unit that is shown, 0 or more.
        decimals: Of the text.
    """
    text = f"{size:.{decimals}f}"
    return f"< {10.0**-decimals:.{decimals}f}" if size > 0.0 and float(text) == 0.0 else text


def pose(positions: Iterable[float], units: Sequence[str]) -> str:
    """Return a pose as a person writes it: `[10, -20] deg`, or each with its unit if they differ.

    Args:
        positions: Of the joints, rad or m.
        units: SI unit of each.
    """
    shown = [
        (f"{math.degrees(value):.0f}", "deg") if unit == "rad" else (f"{1e3 * value:.0f}", "mm")
        for value, unit in zip(positions, units, strict=True)
    ]
    if len({unit for _, unit in shown}) == 1:
        return f"[{', '.join(value for value, _ in shown)}] {shown[0][1]}"
    return f"[{', '.join(f'{value} {unit}' for value, unit in shown)}]"


def _decimals(number: float, width: float) -> int | None:
    """Return how many decimals a number has, ``None`` if it is better written with an exponent."""
    size = max(abs(number), width)
    if size == 0.0:
        return 0
    if not (math.isfinite(size) and _READABLE[0] <= size < _READABLE[1]):
        return None
    wanted = _DIGITS - 1 - math.floor(math.log10(size))
    if width > 0.0:
        narrow = _OF_HALF - 1 - math.floor(math.log10(width))
        wanted = min(narrow, wanted + _MOST - _DIGITS)
    return max(wanted, 0)


def _superscript(unit: str) -> str:
    return re.sub(r"\^(\d+)", lambda power: _power(power[1]), unit)


def _power(exponent: str) -> str:
    return "" if exponent == "1" else exponent.translate(_POWERS)
