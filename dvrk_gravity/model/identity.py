"""A model's identity: which parameters belong together, so that no two models are mixed.

ROS merges parameter files: of two, or of a file and overrides after it, the last value of each
name counts, and a model that nobody identified would be left. Each file of a model therefore has a
hash of each group of its parameters (the part of their names before the first dot), but for those
that a person may change (:attr:`Parameter.adjustable`) and for the nodes' own.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from itertools import groupby

from dvrk_gravity.parameters import Parameter, Value

IDENTITY_PARAMETER = Parameter(
    "identification.identity", "", "",
    "hash of each group of the model's parameters: the compensator refuses others beside them",
    read_only=True, adjustable=True,
)  # fmt: skip
# Characters of a hash: two models agree by chance once in 4e9 groups.
_LENGTH = 8
# Significant digits: a number that is computed from a file's may differ in the last of sixteen.
_DIGITS = 10


def identity_of(values: Mapping[str, Value], table: Mapping[str, Parameter]) -> str:
    """Return the identity of a model's parameters, ``GROUP=HASH`` for each group, in order.

    Args:
        values: As :meth:`TorqueModel.parameters` returns them.
        table: The declarations of the parameters of models; others do not count.
    """
    own = sorted(name for name in values if name in table and not table[name].adjustable)
    return " ".join(
        f"{group}={_hash({name: values[name] for name in names})}"
        for group, names in groupby(own, lambda name: name.partition(".")[0])
    )


def foreign_groups(identity: str, other: str) -> Iterator[str]:
    """Yield the groups in which parameters differ from those of an identity, in order."""
    ours, theirs = (dict(_pairs(text)) for text in (identity, other))
    for group in sorted(ours.keys() | theirs.keys()):
        if ours.get(group) != theirs.get(group):
            yield group


def _pairs(text: str) -> Iterator[tuple[str, str]]:
    for entry in text.split():
        group, _, value = entry.partition("=")
        yield group, value


def _hash(values: Mapping[str, Value]) -> str:
    plain = {name: _plain(value) for name, value in values.items()}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:_LENGTH]


def _plain(value: Value) -> object:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return f"{value + 0.0:.{_DIGITS - 1}e}"  # + 0.0: of -0.0, too, which is the same torque
    return value
