"""A declared parameter: type, unit, default, range and meaning.

ROS parameters, checks of model files and the table in docs/parameters.md all come from these
declarations.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from dvrk_gravity.errors import ConfigError

# Similarity of names, 0 to 1 (difflib): of a suggestion, a letter or two of a short one differ; and
# of a certain misspelling.
_SIMILARITY, _SLIP = 0.7, 0.85
Value = bool | str | float | tuple[float, ...]


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    Attributes:
        name: Dotted name, as in a ROS 2 parameter file.
        default: Default value, of the parameter's type (bool, str, float or a tuple of floats). An
            empty tuple means "not given".
        unit: SI unit, ``""``: none.
        meaning: In a few words.
        lower: Least value allowed (of every entry of an array).
        upper: Greatest value allowed.
        lengths: Lengths allowed for a tuple that is given; ``()`` means any.
        choices: Values allowed for a string; ``()`` means any.
        read_only: Cannot be changed while the node runs.
        units: Of a tuple's entries, where they differ; ``unit`` is then that of most.
        adjustable: Of a model's: a person may change it beside the model. All others belong to the
            model that they came with (``model/identity.py``).
    """

    name: str
    default: Value
    unit: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf
    lengths: tuple[int, ...] = ()
    choices: tuple[str, ...] = ()
    read_only: bool = False
    units: tuple[str, ...] = ()
    adjustable: bool = False

    @property
    def unit_text(self) -> str:
        """Unit in words: of each entry where they differ."""
        if not self.units:
            return self.unit
        return ", ".join(self.units) if len(set(self.units)) > 1 else self.units[0]

    @property
    def kind(self) -> str:
        """Type in ROS's words."""
        if isinstance(self.default, bool):
            return "bool"
        if isinstance(self.default, str):
            return "string"
        return "double[]" if isinstance(self.default, tuple) else "double"

    def check(self, value: Any) -> Value:
        """Return ``value`` as the parameter's own type.

        Raises:
            ConfigError: Wrong type, length, range, choice, or not finite.
        """
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise ConfigError(self.name, value, "true or false")
            return value
        if isinstance(self.default, str):
            if not isinstance(value, str):
                raise ConfigError(self.name, value, "a text")
            if self.choices and value not in self.choices:
                raise ConfigError(self.name, value, f"one of {', '.join(self.choices)}")
            return value
        if isinstance(self.default, tuple):
            return self._check_array(value)
        return self._check_number(self.name, value, self.unit)

    def _check_array(self, value: Any) -> tuple[float, ...]:
        allowed = " or ".join(map(str, self.lengths)) if self.lengths else "any number of"
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
            raise ConfigError(self.name, value, f"a list of {allowed} numbers")
        values = tuple(value)
        if not values and self.default == ():
            return ()
        if self.lengths and len(values) not in self.lengths:
            raise ConfigError(self.name, f"{len(values)} numbers", f"{allowed} numbers")
        units = self.units if len(self.units) == len(values) else (self.unit,) * len(values)
        return tuple(
            self._check_number(f"{self.name}[{i}]", item, unit)
            for i, (item, unit) in enumerate(zip(values, units, strict=True))
        )

    def _check_number(self, field: str, value: Any, unit: str) -> float:
        unit = f" {unit}" if unit else ""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigError(field, value, f"a number{unit}")
        if not is_finite(value):
            raise ConfigError(field, value, f"a finite number{unit}")
        if not self.lower <= value <= self.upper:
            raise ConfigError(field, value, f"{self.range_text()}{unit}")
        return float(value)

    def range_text(self) -> str:
        """Return the range in words, ``""`` if there is none."""
        if self.choices:
            return ", ".join(self.choices)
        if math.isinf(self.lower) and math.isinf(self.upper):
            return ""
        if math.isinf(self.upper):
            return f"at least {self.lower:g}"
        if math.isinf(self.lower):
            return f"at most {self.upper:g}"
        return f"{self.lower:g} to {self.upper:g}"


def is_finite(value: float) -> bool:
    """Return whether a number is finite; an integer too large for a float is not."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def check_all(
    table: Mapping[str, Parameter], values: Mapping[str, Any], declared_by: str = ""
) -> dict[str, Value]:
    """Return ``values`` checked against ``table``, in the table's order.

    Args:
        table: The declared parameters.
        values: The given ones.
        declared_by: What declares groups of parameters, in words; "": nothing outside.

    Raises:
        ConfigError: A name that the table lacks, or a value that fails its check.
    """
    for name in values:
        if name not in table:
            expected = f"the name of a parameter{_hint(str(name), table, declared_by)}"
            raise ConfigError(str(name), values[name], expected)
    return {name: entry.check(values[name]) for name, entry in table.items() if name in values}


def _hint(name: str, table: Mapping[str, Parameter], declared_by: str) -> str:
    """Return a hint on a name that the table lacks."""
    near = difflib.get_close_matches(name, table, n=1, cutoff=_SIMILARITY)
    meant = f"did you mean {near[0]}?" if near else ""
    group = name.partition(".")[0]
    known = {key.partition(".")[0] for key in table}
    slip = bool(near) and difflib.SequenceMatcher(None, name, near[0]).ratio() > _SLIP
    if not declared_by or group in known or slip:
        return f"; {meant}" if meant else ""
    missing = f"no {declared_by} declares {group}: is its package missing?"
    return f"; {missing} Or {meant}" if meant else f"; {missing}"


def flatten(nested: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return ``{"a": {"b": 1}}`` as ``{"a.b": 1}``.

    Raises:
        ConfigError: A name given twice, as ``a: {b: 1}`` and as ``a.b: 1``.
    """
    flat: dict[str, Any] = {}
    for key, value in nested.items():
        name = f"{prefix}{key}"
        # An empty mapping stays: dropped, a misspelt name above it would go unnoticed.
        nesting = isinstance(value, Mapping) and len(value) > 0
        inner = flatten(value, f"{name}.") if nesting else {name: value}
        for double in flat.keys() & inner.keys():
            raise ConfigError(double, inner[double], "each parameter once")
        flat |= inner
    return flat


def unflatten(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``{"a.b": (1.0,)}`` as ``{"a": {"b": [1.0]}}``, ready for YAML."""
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, leaf = name.split(".")
        node = nested
        for parent in parents:
            node = node.setdefault(parent, {})
        node[leaf] = list(value) if isinstance(value, tuple) else value
    return nested
