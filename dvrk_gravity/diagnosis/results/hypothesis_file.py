"""A hypothesis as findings.json holds it: its class by name, and what differs from defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields
from typing import Any

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.effects import Hypothesis


def given(hypothesis: Hypothesis) -> Iterator[tuple[str, Any]]:
    """Yield names and values of what differs from a hypothesis' defaults, but for arm and site."""
    for each in fields(hypothesis):
        value = getattr(hypothesis, each.name)
        made = each.default_factory
        default = each.default if made is MISSING else made()
        array = isinstance(value, np.ndarray)
        if each.name not in ("arm", "site") and (array or value != default):
            yield each.name, value


def is_plain(value: Any) -> bool:
    """Return whether a file can hold a value."""
    if isinstance(value, Mapping):
        return all(isinstance(name, str) and is_plain(each) for name, each in value.items())
    if isinstance(value, tuple | list):
        return all(map(is_plain, value))
    return value is None or isinstance(value, str | bool | int | float | np.generic | np.ndarray)


def written(value: Any) -> Any:
    """Return a plain value as JSON holds it."""
    if isinstance(value, np.ndarray):
        return {"array": value.tolist()}
    if isinstance(value, Mapping):
        return {"mapping": {name: written(each) for name, each in value.items()}}
    if isinstance(value, tuple | list):
        return [written(each) for each in value]
    plain = value.item() if isinstance(value, np.generic) else value
    # JSON has no infinity, which is the standard deviation of a parameter without a prior.
    infinite = isinstance(plain, float) and not np.isfinite(plain)
    return {"number": str(plain)} if infinite else plain


def as_read(value: Any) -> Any:
    """Return the value that JSON holds."""
    if isinstance(value, list):
        return tuple(map(as_read, value))
    if isinstance(value, dict):
        ((kind, content),) = value.items()
        if kind == "array":
            return np.array(content, dtype=float)
        if kind == "number":
            return float(content)
        return {name: as_read(each) for name, each in content.items()}
    return value


def kind_of(effect: str, name: str) -> type[Hypothesis]:
    """Return the class of an effect's hypotheses with a name.

    Raises:
        ValueError: There is none.
    """
    of = effects.named(effect)  # an installed one is loaded by that
    pending: list[type[Hypothesis]] = Hypothesis.__subclasses__()
    while pending:
        kind = pending.pop()
        pending += kind.__subclasses__()
        if kind.__name__ == name and getattr(kind, "EFFECT", None) is of:
            return kind
    raise ValueError(f"{name} of {effect}")
