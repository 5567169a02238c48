"""Read and write YAML files safely: one clear line for whatever is wrong with one."""

from __future__ import annotations

import math
import re
import sys
from collections import Counter
from collections.abc import Hashable, Mapping
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from dvrk_gravity.errors import ConfigError, printable
from dvrk_gravity.files import text_file

DEEPEST = 50
"""Levels that lists and mappings may be nested; loaders take seconds to refuse thousands."""

MOST_NODES = 200_000
"""Values, lists and mappings of a file: half as many as a long plan has digits. Chosen."""

LONGEST_INTEGER = 10_000  # bits: Python makes no text of more than 4300 digits


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe loader (libyaml's if available) that refuses duplicate keys."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        try:
            doubles = [key for key, count in Counter(keys).items() if count > 1]
            mapping = super().construct_mapping(node, deep)
        except TypeError as error:
            raise yaml.YAMLError("a mapping key is a list or mapping") from error
        if doubles:
            raise yaml.YAMLError(f"key {min(map(str, doubles))!r} appears twice")
        return mapping


# YAML 1.1 wants a point in a float, ROS's own reader does not: `1e-3` is a number to both.
_EXPONENT = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+$")
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+0123456789"))


def _number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> float | str:
    """Return a number; `1:30`, which is ninety in YAML 1.1, is a text as in ROS's reader."""
    if ":" in node.value:
        return str(node.value)
    if node.tag.endswith(":int"):
        value = int(loader.construct_yaml_int(node))
        if value.bit_length() > LONGEST_INTEGER:
            raise ValueError(f"an integer of {value.bit_length()} bits")
        return value
    return float(loader.construct_yaml_float(node))


def _text(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> str:
    """Return a text that can be shown: of names, and of what is said about a model."""
    return printable(str(loader.construct_yaml_str(node)))


_Loader.add_constructor("tag:yaml.org,2002:str", _text)
for _kind in ("int", "float"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _number)


@lru_cache(maxsize=16)
def _parsed(text: str) -> Any:
    """Return the content of a text; cached, for an arm's file is read many times.

    Raises:
        yaml.YAMLError: Not YAML, or with aliases (anchor bombs), endless nesting, too much.
    """
    depth = nodes = 0
    # Before the nodes are built, which recurses into any nesting.
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise yaml.YAMLError("anchors and aliases are not used in these files")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise yaml.YAMLError(f"nested deeper than {DEEPEST} levels")
        nodes += isinstance(event, yaml.NodeEvent)
        if nodes > MOST_NODES:
            raise yaml.YAMLError(f"more than {MOST_NODES} values")
    return yaml.load(text, Loader=_Loader)  # noqa: S506  # derived from the safe one


def load(path: str | Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises:
        ConfigError: No such file, too large, not text, not YAML, or not a mapping.
    """
    content = parse(text_file.read(path, "YAML"), path)
    if not isinstance(content, dict):
        raise ConfigError("", type(content).__name__, "a YAML mapping", path)
    return content


def parse(text: str, source: str | Path) -> Any:
    """Return the content of a YAML text.

    Raises:
        ConfigError: Not YAML; names the ``source``.
    """
    try:
        return deepcopy(_parsed(text))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error)
        raise ConfigError(where, problem, "valid YAML", source) from error
    except (ValueError, RecursionError, LookupError, AttributeError, TypeError) as error:
        # Absurd dates, numbers or nesting, and tags that do not fit (`!!int ""`): PyYAML's own.
        raise ConfigError("", str(error) or type(error).__name__, "valid YAML", source) from error


def dump(content: Mapping[str, Any]) -> str:
    """Return YAML text: keys in their order, number lists on one line, full precision."""
    return yaml.dump(
        dict(content), Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=10_000
    )


class _Dumper(yaml.SafeDumper):
    """Writes floats so that ROS reads them as doubles (`1.0e-05`, never `1e-05`)."""


def _represent_float(dumper: yaml.SafeDumper, value: float) -> yaml.ScalarNode:
    # ROS's reader reads a number below the smallest normal one as a text.
    text = repr(float(value) if abs(value) >= sys.float_info.min else math.copysign(0.0, value))
    if "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return dumper.represent_scalar("tag:yaml.org,2002:float", text.replace("inf", ".inf"))


def _represent_list(dumper: yaml.SafeDumper, value: list[Any]) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=True)


def _represent_text(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
    # ROS's reader, and the loader above, would read it as a number: a link may be called 1e3.
    style = "'" if _EXPONENT.match(value) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(float, _represent_float)
_Dumper.add_representer(list, _represent_list)
