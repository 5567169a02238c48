"""The URDF's part of ``convert``: the masses that it states, as a model file."""

from __future__ import annotations

import sys
from pathlib import Path

from dvrk_gravity.cli.convert_console import MODEL_SUFFIXES, expect_suffix
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs
from dvrk_gravity.model import TorqueModel


def convert(source: Path, target: Path, report: Path | None = None) -> int:
    """Write the model that a URDF states; return 0.

    Args:
        source: The URDF, with ``#LINK`` what is between the base and that link; a YAML naming one.
        target: Model file; a new one.
        report: No such thing is written here.

    Raises:
        ConfigError: Wrong kinds of files, or a URDF without masses.
        OSError: The output cannot be written.
    """
    if report is not None:
        raise ConfigError("--json", str(report), "--check or a model beside it")
    outputs.check({}, [source], {"OUT": target})
    expect_suffix(target, MODEL_SUFFIXES)
    model = TorqueModel.load(source)
    if not model.of_file:
        raise ConfigError(
            "IN", "a model's parameters", "an arm's .urdf, or a .yaml with one", source
        )
    for doubt in model.arm.doubts:
        print(f"warning: {source}: {doubt}", file=sys.stderr)
    model.save(target, f"The masses that {source.name} states; nothing was measured.")
    print(f"{target}: {model.arm.name}, {' + '.join(term.NAME for term in model.terms)}")
    return 0
