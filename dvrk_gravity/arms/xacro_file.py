"""URDFs that xacro has yet to expand."""

from __future__ import annotations

from pathlib import Path

from dvrk_gravity.errors import ConfigError


class XacroError(ConfigError):
    """A URDF with something of xacro left in it; the attributes are ``ConfigError``'s."""


def expand(path: Path, found: XacroError) -> str:
    """Return the text of the URDF that xacro makes of a file, with all arguments' defaults.

    Args:
        path: The file.
        found: What is left of xacro in it.

    Raises:
        ConfigError: The package ``xacrodoc`` is not installed, or the file cannot be expanded.
    """
    name = path.name.removesuffix(".xacro")
    target = name if name != path.name else f"{path.stem}_expanded.urdf"
    by_hand = f"`xacro {path.name} > {target}`"
    try:
        from xacrodoc import XacroDoc
    except ImportError:
        expected = f"a URDF without xacro: {by_hand}, or `pip install xacrodoc`"
        raise ConfigError(found.field, found.value, expected, path) from None
    try:
        return str(XacroDoc.from_file(path).to_urdf_string())
    except Exception as error:  # the file's own expressions are run: anything may come of them
        expected = f"what xacro expands with the defaults of all arguments; else {by_hand}"
        raise ConfigError("", f"xacro's {type(error).__name__}: {error}", expected, path) from error
