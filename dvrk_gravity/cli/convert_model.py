"""The part of ``convert`` that writes a model as other programs read arms: URDF and MJCF."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from dvrk_gravity.arms import thousandth
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.exports import SUFFIXES, Exported, export_model
from dvrk_gravity.files import outputs, text_file
from dvrk_gravity.model import TorqueModel

_SHOWN = 5e-6  # N·m, what a table of 0.01 mN·m shows


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
    for doubt in model.arm.doubts if model.of_file else ():
        print(f"warning: {source}: {doubt}", file=sys.stderr)
    print(f"{target}: {model.arm.name}, {form} of {len(model.arm.bodies)} links")
    for line in (*_table(exported), *(f"  {note}" for note in exported.notes)):
        print(line)
    return 0


def _table(exported: Exported) -> Iterator[str]:
    """Yield what the file leaves out by joint, then a line for each cause."""
    joints = exported.held.arm.joints
    if not exported.left_out:
        yield "the file has all of the model's torque"
        return
    yield "what the file leaves out of the model's torque, RMS over the calibrated range, moving:"
    yield f"{'joint':<20}{'torque':>10}{'left out':>10}"
    rows = zip(joints, exported.torque.tolist(), exported.total.tolist(), strict=True)
    for joint, torque, missed in rows:
        unit = thousandth(joint.effort_unit)
        yield f"{joint.name:<20}{1e3 * torque:>10.2f}{1e3 * missed:>10.2f} {unit}"
    for part in exported.left_out:
        yield f"  {part.name} ({part.why}): {_by_joint(exported, part.rms)}"


def _by_joint(exported: Exported, rms: Array) -> str:
    joints = exported.held.arm.joints
    shown = [
        f"{joint.name} {1e3 * value:.2f} {thousandth(joint.effort_unit)}"
        for joint, value in zip(joints, rms.tolist(), strict=True)
        if value >= _SHOWN
    ]
    return ", ".join(shown) or "below .01 mN·m"
