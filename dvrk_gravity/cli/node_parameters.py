"""Parameters of running nodes, for those without ros2cli."""

from __future__ import annotations

import argparse
import difflib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file

if TYPE_CHECKING:
    from dvrk_gravity.ros import Client

_LIST = "/list_parameters"
_TIMEOUTS = (0.1, 600.0)  # s
_INTEGERS = 2**63  # from there on ROS has none


class Get:
    """Print the parameters of a running node as YAML, or one of them."""

    NAME = "get"
    EXAMPLE = "python -m dvrk_gravity get /MTMR/compensator timeout"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        _add_node(parser)
        parser.add_argument("parameter", metavar="PARAMETER", nargs="?",
                            help="its name (default: all)")  # fmt: skip

    @staticmethod
    def run(arguments: argparse.Namespace) -> int:
        """Ask and print."""
        with _node(arguments) as (client, node):
            values = client.parameters(node, arguments.timeout)
        name = arguments.parameter
        if name is not None:
            _require(name, values, node)
            values = {name: values[name]}
        print(yaml_file.dump(values), end="")
        return 0


class Set:
    """Change a parameter of a running node; status 1 if the node refuses."""

    NAME = "set"
    EXAMPLE = "python -m dvrk_gravity set /MTMR/compensator timeout 0.2"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        _add_node(parser)
        parser.add_argument("parameter", metavar="PARAMETER", help="its name")
        parser.add_argument("value", metavar="VALUE", help="in YAML: 0.2, true, word, [0.1, 0.2]")

    @staticmethod
    def run(arguments: argparse.Namespace) -> int:
        """Ask, and print the value in force, or what the node says."""
        name, value = arguments.parameter, _value(arguments.value)
        with _node(arguments) as (client, node):
            before = client.parameters(node, arguments.timeout)
            given = _as_floats(value) if _is_float(before.get(name)) else value
            accepted, answer = client.set_parameters({name: given}, node, arguments.timeout)
            if accepted:
                before = client.parameters(node, arguments.timeout)
        if not accepted and name not in before:
            _require(name, before, node)
        shown = yaml_file.dump({name: before.get(name)}).strip()
        because = f": {answer}" if answer else ""
        print(f"{node}: {shown}" + because if accepted else f"{node} refuses {name}{because}")
        return 0 if accepted else 1


def _add_node(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("node", metavar="NODE", help="full name of the node, as /MTMR/compensator")
    parser.add_argument("--timeout", type=float, default=5.0, metavar="S",
                        help="longest wait for the node, and for each answer, s "
                        "(default: 5)")  # fmt: skip


@contextmanager
def _node(arguments: argparse.Namespace) -> Iterator[tuple[Client, str]]:
    """Yield a client, and the full name of the node, once it is there.

    Raises:
        ConfigError: No such node.
    """
    options.refuse_ros_args(arguments)
    options.require_bounds(arguments, {"timeout": _TIMEOUTS})
    from dvrk_gravity.ros import Client, ProcessError, require_name

    node = f"/{arguments.node.strip('/')}"
    require_name("NODE", node)
    with Client("/", f"parameters_{os.getpid()}") as client:

        def there() -> list[str]:
            services = (name for name, _ in client.node.get_service_names_and_types())
            nodes = [name.removesuffix(_LIST) for name in services if name.endswith(_LIST)]
            return sorted({*nodes} - {client.node.get_fully_qualified_name()})

        try:
            client.wait(lambda: node in there(), node, arguments.timeout)
        except ProcessError:
            found = ", ".join(there()) or f"none, ROS_DOMAIN_ID {client.context.get_domain_id()}"
            expected = f"a node that runs (seen in {arguments.timeout:g} s: {found})"
            raise ConfigError("NODE", node, expected) from None
        yield client, node


def _require(name: str, values: dict[str, Any], node: str) -> None:
    if name in values:
        return
    near = difflib.get_close_matches(name, values, n=3) or sorted(values)
    raise ConfigError("PARAMETER", name, f"one that {node} has, as {', '.join(near[:3])}")


def _value(text: str) -> Any:
    """Return a value that a parameter may have.

    Raises:
        ConfigError: Another one.
    """
    value = yaml_file.parse(text, "VALUE")
    entries = value if isinstance(value, list) else [value]
    kinds = {type(entry) for entry in entries}
    if kinds == {int, float}:
        kinds, value = {float}, [float(entry) for entry in entries]
    fits = all(type(e) is not int or -_INTEGERS <= e < _INTEGERS for e in entries)
    if not (fits and len(kinds) < 2 and kinds <= {bool, int, float, str}):
        expected = "a number, true, false, a text, or a list of one kind of these"
        raise ConfigError("VALUE", text, expected)
    return value


def _is_float(value: Any) -> bool:
    return isinstance(value[0] if isinstance(value, list) and value else value, float)


def _as_floats(value: Any) -> Any:
    """Return whole numbers as the floats that a parameter has."""
    if isinstance(value, list):
        return [_as_floats(entry) for entry in value]
    return float(value) if type(value) is int else value
