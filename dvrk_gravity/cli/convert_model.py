"""The part of ``convert`` that writes a model as other programs read arms: URDF and MJCF."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.exports import SUFFIXES, ExportResult, export_model
from dvrk_gravity.files import outputs, text_file
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.report import effort_in_table
from dvrk_gravity.units import quantity

_NEGLIGIBLE = 0.01  # of the largest, at other joints: not worth a word. Chosen


def convert(source: Path, target: Path, report: Path | None) -> int:
    """Write a model as a URDF or an MJCF, print what that costs, and return 0.

    Raises:
        ConfigError: Content that no such file can hold, or an output that cannot be written.
    """
    outputs.check({"--json": report}, [source], {"OUT": target})
    model = TorqueModel.load(source)
    form = SUFFIXES[target.suffix.lower()]
    try:
        exported = export_model(model, form, target.parent)
    except ConfigError as error:
        raise error if error.source else error.in_file(source) from None
    text_file.write(target, exported.text)
    if report is not None:
        content = json.dumps(exported.to_json(), indent=1, ensure_ascii=False)
        text_file.write(report, content + "\n")
    for doubt in model.arm.warnings if model.of_file else ():
        print(f"warning: {source}: {doubt}", file=sys.stderr)
    print(f"{target}: {model.arm.name}, {form} of {len(model.arm.bodies)} links")
    for line in (*_table(exported), *(f"  {note}" for note in exported.notes)):
        print(line)
    return 0


def _table(exported: ExportResult) -> Iterator[str]:
    """Yield what the file leaves out by joint, then a line for each cause."""
    joints = exported.file_model.arm.joints
    if not exported.left_out:
        yield "the file has all of the model's torque"
        return
    torques, missed = exported.torque.tolist(), exported.total.tolist()
    unit, factor, decimals = effort_in_table(exported.file_model.arm, torques + missed)
    yield "what the file leaves out of the model's torque, over the calibrated range, moving:"
    yield f"{f'RMS, {unit}':<20}{'torque':>10}{'left out':>10}"
    for joint, *values in zip(joints, torques, missed, strict=True):
        cells = (f"{factor * value:>10.{decimals}f}" for value in values)
        yield f"{joint.name:<20}{''.join(cells)}"
    for part in exported.left_out:
        most = sorted(zip(part.largest.tolist(), joints, strict=True), key=lambda each: -each[0])
        shown = [f"{quantity(value, joint.effort_unit)} at {joint.name}"
                 for value, joint in most if value > _NEGLIGIBLE * most[0][0]]  # fmt: skip
        yield f"  left out: {part.name.replace('_', ' ')} ({part.why}): up to {', '.join(shown)}"
    arm = exported.file_model.arm
    yield (
        f"a model that loses nothing: python -m dvrk_gravity identify RECORDING --arm {arm.source} "
        f"--for {exported.form.lower()} --out model.yaml"
    )
