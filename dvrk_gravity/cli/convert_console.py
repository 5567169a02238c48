"""The console's part of ``convert``: gc-<ARM>-<SN>.json to and from a model file, and its check."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.command_line import one_line
from dvrk_gravity.console import (
    FILE_NAME,
    CheckResult,
    ConsoleFile,
    ConsoleFinding,
    Conversion,
    Severity,
    Use,
    check_file,
    convert_model,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.exports import SUFFIXES
from dvrk_gravity.files import outputs, text_file
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.report import effort_in_table

_COMMENT = """Torque model from the dVRK console's {name} (version {version}).
Units: rad, rad/s, N·m; g is inside beta. Outside valid_lower … valid_upper positions are held at
the edge. The console's safe torque limits are in console.document only: nothing applies them."""


def convert(source: Path, target: Path, report: Path | None = None) -> int:
    """Convert a console's .json to a model's .yaml, or the reverse; return 0.

    Args:
        source: The file.
        target: A file of the other kind.
        report: JSON file for the differences between model and console file.

    Raises:
        ConfigError: Wrong kinds of files, or content that the other format cannot express.
        OSError: The output cannot be written.
    """
    outputs.check({"OUT": target}, [source])
    if source.suffix.lower() == ".json":
        expect_suffix(target, (".yaml", ".yml"))
        if report is not None:
            raise ConfigError("--json", str(report), "a model to convert to a console file")
        console = ConsoleFile.load(source)
        _require_name(source, console.document)
        try:
            model = console.model()
        except ConfigError as error:
            raise error.in_file(source) from None
        answer = check_file(source).answer
        if answer.of_model:
            more = f"see `convert --check {source}`"
            print(f"warning: {source}: {answer.use} ({answer.reason}); {more}", file=sys.stderr)
        model.save(target, _COMMENT.format(name=source.name, version=console.version))
        print(f"{target}: {model.arm.name}, {' + '.join(term.NAME for term in model.terms)}")
    else:
        expect_suffix(target, (".json", *SUFFIXES))  # the others are not a console's
        model = TorqueModel.load(source)
        match = FILE_NAME.fullmatch(target.name)
        try:
            result = convert_model(model, match["serial"] if match else "")
        except ConfigError as error:
            raise error.in_file(source) from None
        _require_name(target, result.file.document)
        text_file.write(target, result.file.text())
        if report is not None:
            content = json.dumps(result.to_json(), indent=1, ensure_ascii=False)
            text_file.write(report, content + "\n")
        for finding in result.findings:
            print(f"{target}: serious: {finding.subject}: {finding.text}", file=sys.stderr)
        print(f"{target}: {result.file.document['ARM_NAME']}, version 2.0")
        notes = [f"  {note}" for note in result.file.notes]
        header = ["the file differs from the model in:"] if notes else []
        for line in (*_cost_table(result, model.arm), *header, *notes):
            print(line)
    return 0


def _require_name(path: Path, document: Mapping[str, Any]) -> None:
    """Refuse a file named for another arm than its content: a console reads it by its name."""
    match, arm = FILE_NAME.fullmatch(path.name), document["ARM_NAME"]
    if match and match["arm"] != arm:
        named = path.with_name(f"gc-{arm}-{match['serial']}.json").name
        raise ConfigError("ARM_NAME", arm, f"{match['arm']}, as in its name, or {named}", path)


def _cost_table(result: Conversion, arm: Arm) -> Iterator[str]:
    """Yield a table of the differences between the console's and the compensator's torque."""
    if result.exact:
        yield "already in the console's form; differences come from rounding and the blend:"
    else:
        yield "projected onto the console's form by least squares; torque error:"
    costs = [(c.torque, c.rest_rms, c.rest_max, c.moving_rms, c.moving_max)
             for c in result.joints.values()]  # fmt: skip
    unit, factor, decimals = effort_in_table(arm, chain.from_iterable(costs))
    yield f"{unit:<16}{'torque':>9}{'at rest':>18}{'moving':>18}{'range':>14}"
    yield f"{'joint':<16}{'RMS':>9}{'RMS':>9}{'max':>9}{'RMS':>9}{'max':>9}{'deg':>14}"
    edges = zip(np.degrees(result.lower), np.degrees(result.upper), strict=True)
    for name, numbers, (low, high) in zip(result.joints, costs, edges, strict=True):
        cells = "".join(f"{factor * number:>9.{decimals - 1}f}" for number in numbers)
        yield f"{name:<16}{cells}{low:>9.0f}{high:>5.0f}"


def check(paths: Sequence[Path], report: Path | None = None) -> int:
    """Print for each console file whether it can be used, and its findings.

    Args:
        paths: The files.
        report: JSON file for answers and findings, by file.

    Returns:
        0: all can be used; 1: some need a repair, or must not be used; 2: one is unreadable.

    Raises:
        OSError: The report cannot be written.
    """
    outputs.check({"--json": report}, paths)
    status = 0
    checked: dict[str, CheckResult] = {}
    for path in paths:
        try:
            result = check_file(path)
        except ConfigError as error:
            print(f"dvrk_gravity convert: {one_line(error)}", file=sys.stderr)
            status = 2
            continue
        checked[str(path)] = result
        found, answer = result.findings, result.answer
        if answer.use is not Use.USABLE:
            status = max(status, 1)
        print(f"{path}: {answer.use}{f' ({answer.reason})' if answer.reason else ''}")
        for line in answer.todo:
            print(f"  {line}")
        print(f"  findings: {_summary(found)}")
        width = max((len(finding.subject) for finding in found), default=0)
        for finding in found:
            print(f"    {finding.severity:<8} {finding.subject:<{width}}  {finding.text}")
    if report is not None:
        content = {name: asdict(result) for name, result in checked.items()}
        text_file.write(report, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return status


def _summary(found: Sequence[ConsoleFinding]) -> str:
    counts = {level: sum(finding.severity is level for finding in found) for level in Severity}
    return ", ".join(f"{count} {level}" for level, count in counts.items() if count) or "none"


def expect_suffix(path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse another kind of file, or raise ConfigError."""
    if path.suffix.lower() not in suffixes:
        raise ConfigError("OUT", str(path), f"a file ending in {' or '.join(suffixes)}")
