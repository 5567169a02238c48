"""The package's errors: one base class, each subclass carrying the value that offended.

Every error's text is one line that names the file (where there is one), the
field or joint, the value found and what was expected, so that a command line
can print it unchanged.
"""

from __future__ import annotations

import unicodedata
from pathlib import Path

import numpy as np


def printable(text: str) -> str:
    r"""Return a text in which what a terminal or a page obeys instead of showing it is spelled out.

    That is, control characters (escape sequences, the ends of lines), marks that turn the direction
    of writing, and bytes that are no text: ``\x1b[2J`` clears no screen. Names of joints, columns,
    topics and files may have anything in them; this is what becomes of them in errors, messages,
    logs and reports.
    """
    if text.isprintable():
        return text
    return "".join(
        letter
        if letter.isprintable() or unicodedata.category(letter) == "Zs"
        else letter.encode("unicode_escape").decode()
        for letter in text
    )


class DvrkGravityError(Exception):
    """Base of every error that this package raises on purpose."""

    def __str__(self) -> str:
        """Return the text on one line, as a terminal can show it."""
        return printable(super().__str__())


class ConfigError(DvrkGravityError):
    """A model, arm, mechanism or parameter file that cannot be used.

    Attributes:
        field: Dotted name of the offending field, or ``""`` for the whole file.
        value: The value that was found.
        expected: What would have been accepted.
        source: File that it came from, if any.
    """

    def __init__(
        self, field: str, value: object, expected: str, source: str | Path | None = None
    ) -> None:
        """Store the parts and build the one-line message."""
        self.field = field
        self.value = value
        self.expected = expected
        self.source = source
        super().__init__()

    def __str__(self) -> str:
        """Return ``file: field: value (expected …)`` on one line."""
        where = "".join(f"{part}: " for part in (self.source, self.field) if part)
        # NumPy's numbers would show their type.
        value = self.value.item() if isinstance(self.value, np.generic) else self.value
        try:
            shown = "nothing" if value is None else " ".join(repr(value).split())
        except ValueError:  # of an integer of thousands of digits
            shown = "a number of thousands of digits"
        if len(shown) > 80:
            shown = shown[:77] + "..."
        return printable(" ".join(f"{where}got {shown}, expected {self.expected}".split()))

    def in_file(self, source: str | Path) -> ConfigError:
        """Return the same error naming the file that it came from."""
        return type(self)(self.field, self.value, self.expected, source)


class EffectError(DvrkGravityError, ValueError):
    """An effect from outside the package that does not keep what effects promise.

    Attributes:
        effect: Its name, or where it was to come from.
        problem: What is wrong with it, and what was expected.
    """

    def __init__(self, effect: str, problem: str) -> None:
        """Store the parts and build the one-line message."""
        self.effect = effect
        self.problem = problem
        super().__init__(f"effect {effect}: {' '.join(problem.split())}")


class ArgumentError(ConfigError, TypeError):
    """An argument of a type that a function cannot use; the attributes are ``ConfigError``'s."""


class RecordingError(DvrkGravityError):
    """A recording that cannot be read or cannot serve its purpose.

    Attributes:
        source: File or folder of the recording.
        problem: What is wrong with it, and what was expected.
    """

    def __init__(self, source: str | Path, problem: str) -> None:
        """Store the parts and build the one-line message."""
        self.source = source
        self.problem = problem
        super().__init__(f"{source}: {' '.join(problem.split())}")


class ShapeError(DvrkGravityError, ValueError):
    """An array whose shape does not fit.

    Attributes:
        name: Name of the argument.
        shape: Shape that was given.
        expected: Shape that was expected, in words.
    """

    def __init__(self, name: str, shape: tuple[int, ...], expected: str) -> None:
        """Store the parts and build the one-line message."""
        self.name = name
        self.shape = shape
        self.expected = expected
        super().__init__(f"{name} has shape {shape}, expected {expected}")


class PackageError(DvrkGravityError, ImportError):
    """Something asked for that needs a Python package which is not installed.

    Attributes:
        wanted: What was asked for.
        package: The package, as pip calls it.
    """

    def __init__(self, wanted: str, package: str) -> None:
        """Store the parts and build the one-line message."""
        self.wanted = wanted
        self.package = package
        super().__init__(f"{wanted}: needs {package}, expected `pip install {package}` before")


class PlanError(DvrkGravityError):
    """Limits that no motion can keep; the text says which would have to give, and by how much."""
