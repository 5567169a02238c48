"""What imports what: no cycles, and ROS only where nodes are."""

from __future__ import annotations

import ast
import importlib
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from imported import PACKAGE, face, modules, names
from support import REPOSITORY, syntax

# Each room imports only those before it (CONTRIBUTING.md says what they hold).
ROOMS = (
    "faces", "arrays", "errors", "tabular", "validation", "units", "files", "parameters", "arms",
    "parameters.nodes", "gravity", "newton_euler", "effects", "model", "console", "recording",
    "estimation", "observation", "identification", "diagnosis", "planning", "simulate", "exports",
    "compensate", "monitoring", "collecting", "calibration", "fleet", "report", "ros", "cli",
)  # fmt: skip
# Other names than on the index of packages.
DISTRIBUTIONS = {"pinocchio": "pin", "yaml": "pyyaml"}
# Done without where they are not installed: the dVRK's own messages, those of ros2_control's
# actions, what expands xacro, data frames, and what fleets need.
OPTIONAL = {
    "crtk_msgs", "control_msgs", "xacrodoc", "pandas", "dask", "distributed", "fsspec", "pyarrow",
}  # fmt: skip


def everywhere(path: Path) -> Iterable[ast.AST]:
    return syntax(path)


def on_import(path: Path) -> Iterator[ast.AST]:
    return at_module_level(syntax(path)[0])


def at_module_level(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield what runs on import: all but the bodies of functions, and what is for types only."""
    for node in ast.iter_child_nodes(tree):
        yield node
        for_types = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        if not for_types and not isinstance(node, ast.FunctionDef | ast.Lambda):
            yield from at_module_level(node)


@cache
def graph(
    package: Path, walk: Callable[[Path], Iterable[ast.AST]] = everywhere
) -> dict[str, set[str]]:
    """Return what each module of a package imports: modules of the package, others' top names."""
    known = modules(package)
    found: dict[str, set[str]] = {}
    for module, path in known.items():
        imported = found.setdefault(module, set())
        for source, name in names(walk(path)):
            inside = f"{source}.{name}" if f"{source}.{name}" in known else source
            inside = face(source).get(name, inside)
            imported.add(inside if inside in known else source.split(".")[0])
    return found


def reached(start: str, imports: dict[str, set[str]]) -> set[str]:
    """Return all that a module imports, itself or through others."""
    found: set[str] = set()
    pending = [start]
    while pending:
        new = imports.get(pending.pop(), set()) - found
        found |= new
        pending += new
    return found


def ros_packages() -> set[str]:
    """Return what package.xml depends on and is ROS's own."""
    root = ElementTree.parse(REPOSITORY / "package.xml").getroot()
    names = {element.text or "" for element in root.findall("exec_depend")}
    return {name for name in names if not name.startswith("python3-") and name != "pinocchio"}


def test_no_module_imports_itself_through_others_not_even_in_a_function_or_for_types():
    TopologicalSorter(graph(PACKAGE)).prepare()


def room(module: str) -> int | None:
    """Return the position of a module's room, ``None`` of one that is in none."""
    found = (n for n in reversed(range(len(ROOMS)))
             if f"{module}.".startswith(f"dvrk_gravity.{ROOMS[n]}."))  # fmt: skip
    return max(found, key=lambda n: len(ROOMS[n]), default=None)


def test_each_room_imports_only_those_above_it():
    for module, imported in graph(PACKAGE).items():
        for other in imported:
            here, there = room(module), room(other)
            if here is not None and there is not None:
                assert there <= here, f"{module} imports {other}"


def test_only_nodes_import_ros_and_commands_where_they_begin_to_work():
    whenever, first, ros = graph(PACKAGE), graph(PACKAGE, on_import), ros_packages()
    assert "rclpy" in ros & first["dvrk_gravity.ros.compensator_node"]
    for module in modules(PACKAGE):
        if module.startswith("dvrk_gravity.ros"):
            continue
        assert not reached(module, first) & ros, module
        if not module.startswith("dvrk_gravity.cli."):
            assert not reached(module, whenever) & ros, module


def test_what_the_package_imports_is_declared_in_package_xml_or_setup_py():
    setup = (REPOSITORY / "setup.py").read_text(encoding="utf-8").split("extras_require")[0]
    provided = set(sys.stdlib_module_names) | ros_packages() | OPTIONAL
    for module, imported in graph(PACKAGE).items():
        for name in imported - provided:
            assert name.startswith("dvrk_gravity") or (
                f'"{DISTRIBUTIONS.get(name, name)}>=' in setup
            ), f"{module} imports {name}"


def test_each_room_has_the_names_of_its_stub():
    for stub in PACKAGE.rglob("__init__.pyi"):
        package = ".".join(stub.parent.relative_to(PACKAGE.parent).parts)
        assert importlib.import_module(package).__all__ == sorted(face(package)), package


def test_a_layer_of_diagnosis_imports_only_layers_below():
    layers = [f"dvrk_gravity.diagnosis.{name}." for name in ("data", "inference", "results")]
    for module, imported in graph(PACKAGE).items():
        for below, layer in enumerate(layers):
            if module.startswith(layer):
                assert not [
                    name for name in imported if name.startswith(tuple(layers[below + 1 :]))
                ]
