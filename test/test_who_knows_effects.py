"""An effect is one file: who else knows one by its name is listed here, with the reason."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from pathlib import Path

import pytest
from support import syntax

from dvrk_gravity import effects

PACKAGE = Path(effects.__file__).resolve().parents[1]
MOST = 2  # modules beside an effect's own file
# Rooms whose very subject some effects are; within effects/ one may rest on another.
ROOMS: Mapping[str, str] = {
    "console/file.py": "the fields of the console's file are gravity's and a cable's parameters",
    "arms/mtm/": "beta in closed form is the MTM's weight",
    "effects/": "merging one effect changes others' parameters",
    "identification/poses/": "what poses determine: weight, cables, held load",
}
# Words that are no effect's name there: a section of a file, a kind of warning, a parameter.
OTHER_WORDS = {
    "gravity": "the parameter of weights, and the vector",
    "joint_offset": "a parameter of the model: what positions mean",
    "rotor_inertia": "a section of plant files",
    "effort_saturation": "a kind of warning about data",
    "unknown": "a verdict",
}
# What handles all effects equally.
NAMELESS = (
    "effects/base/", "compensate/", "exports/", "simulate/",
    "console/answer.py", "console/check.py", "console/configuration.py", "console/conversion.py",
    "console/document.py", "console/projection.py",
    "diagnosis/results/extended_model.py", "diagnosis/results/sentences.py", "report/findings.py",
    "diagnosis/inference/selection.py", "diagnosis/inference/cross_validation.py",
    "model/", "identification/trajectories/", "identification/quality/",
)  # fmt: skip


def names_in(path: Path) -> set[str]:
    """Return the identifiers and the texts of a module's code, docstrings apart."""
    docs = {
        id(node.body[0].value)
        for node in syntax(path)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    found: set[str] = set()
    for node in syntax(path):
        if isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, ast.Attribute) and node.attr.isupper():
            found.add(node.attr)
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs
        ):
            found.add(node.value.split(".")[0])
    return found


@pytest.fixture(scope="module")
def modules() -> dict[str, set[str]]:
    return {
        path.relative_to(PACKAGE).as_posix(): names_in(path)
        for path in sorted(PACKAGE.rglob("*.py"))
    }


def test_few_modules_know_an_effect_by_its_name(modules):
    for effect in effects.effects():
        words = {effect.__name__} | ({effect.NAME} - OTHER_WORDS.keys())
        knowing = [path for path, names in modules.items()
                   if names & words and not path.startswith(tuple(ROOMS))]  # fmt: skip
        assert len(knowing) <= MOST, (effect.NAME, knowing)


def test_each_file_beside_base_is_one_effect():
    own = [e for e in effects.effects() if e.__module__.startswith("dvrk_gravity.effects.")]
    files = {path.stem for path in PACKAGE.glob("effects/*.py")} - {"__init__"}
    assert {effect.__module__.split(".")[-1] for effect in own} == files == {e.NAME for e in own}


def test_what_uses_all_effects_names_none_and_every_exception_is_one(modules):
    classes = {effect.__name__ for effect in effects.effects()}
    names = {effect.NAME for effect in effects.effects()}
    for path, found in modules.items():
        if path.startswith(NAMELESS):
            assert not found & (classes | (names - set(OTHER_WORDS))), path
    for room in ROOMS:
        known = [found & (classes | names) for path, found in modules.items()
                 if path.startswith(room)]  # fmt: skip
        assert any(known), room


# The console's file format is that of MTMs.
OF_THE_MTM = ("arms/mtm/", "console/")


def test_no_generic_module_knows_a_number_of_joints_or_their_names(modules):
    for path, names in modules.items():
        if not path.startswith(OF_THE_MTM):
            assert not names & {"N_JOINTS", "JOINT_NAMES"}, path
