"""``collect --teach``: limits from a person who moves an arm to the corners of its free space."""

from __future__ import annotations

import argparse
import math
import sys
import time
from typing import TYPE_CHECKING

from dvrk_gravity.cli import options
from dvrk_gravity.command_line import CLEAR_LINE
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.files import outputs

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.arrays import Array
    from dvrk_gravity.collecting import TaughtLimits
    from dvrk_gravity.recording import Recording

MARGINS = (0.0, 20.0)  # deg
EVERY = 1.0  # s, between two lines of the coverage
LITTLE = 0.2  # part of a joint's range; less is reported. Chosen


def run(arguments: argparse.Namespace) -> int:
    """Read the arm, or a recording; write the limits; print what they cover."""
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.collecting import TaughtLimits
    from dvrk_gravity.planning import save_limits
    from dvrk_gravity.recording import Recording

    if arguments.arm is None:
        raise ConfigError("--arm", None, "the arm that is shown its room")
    for name, value in (("PLAN", arguments.plan), ("--out", arguments.out)):
        if value is not None:
            raise ConfigError(name, str(value), "nothing beside --teach, which records no motion")
    options.require_bounds(arguments, {"margin": MARGINS})
    outputs.check({"--teach": arguments.teach}, [Arm.file(arguments.arm), arguments.recording])
    arm = Arm.load(arguments.arm)
    taught = TaughtLimits(arm)
    if arguments.recording is not None:
        taught.show(_positions(Recording.load(arguments.recording), arm))
    else:
        _listen(arm, arguments.namespace, taught)
    if not taught.samples:
        raise ConfigError("--teach", "no measurements", "an arm that is moved before Ctrl-C")
    limits = taught.limits(math.radians(arguments.margin))
    save_limits(arguments.teach, limits, arm, f"Shown to dvrk_gravity, less {arguments.margin:g}"
                " deg at either end.")  # fmt: skip
    print(_line(taught))
    little = [name for name, part in taught.coverage.items() if part < LITTLE]
    if little:
        print(f"note: {', '.join(little)} moved through less than {100 * LITTLE:.0f} % of the "
              "range: a plan will not move there either")  # fmt: skip
    print(f"written: {arguments.teach}. Next: plan --arm {arguments.arm} --limits "
          f"{arguments.teach} --out plan.yaml")  # fmt: skip
    return 0


def _positions(recording: Recording, arm: Arm) -> Array:
    """Return (N, n) positions of all joints of an arm, whatever else was recorded."""
    from dvrk_gravity.recording import jumps

    missing = [joint for joint in arm.joint_names if joint not in recording.joints]
    if missing:
        raise RecordingError(recording.source, f"lacks {', '.join(missing)} of {arm.name}")
    recording.require_held(arm)
    if recording.time is not None and (jumped := jumps(recording)):  # an encoder that slipped
        raise RecordingError(recording.source, f"{jumped[0].joint}: {jumped[0].text}")
    return recording.position[:, [recording.joints.index(joint) for joint in arm.joint_names]]


def _listen(arm: Arm, given: str | None, taught: TaughtLimits) -> None:
    """Take in all positions until a signal asks for the end."""
    from dvrk_gravity.ros import Client, listen, namespace_of

    namespace = namespace_of(arm, given)
    print(f"move the arm to the corners of its free space: reading {namespace}/measured_js until "
          "Ctrl-C", flush=True)  # fmt: skip
    terminal = sys.stderr.isatty()
    with Client(namespace, "collect") as client:
        due = time.monotonic() + EVERY
        for position in listen(client, arm):
            if position is not None:
                taught.show(position)
            if time.monotonic() >= due:
                due = time.monotonic() + EVERY
                before, after = (CLEAR_LINE, "") if terminal else ("", "\n")
                nothing = f"nothing on {namespace}/measured_js yet"
                line = _line(taught) if taught.samples else nothing
                print(f"{before}{line}", end=after, file=sys.stderr, flush=True)
    if terminal:
        print(file=sys.stderr)


def _line(taught: TaughtLimits) -> str:
    return "shown: " + ", ".join(f"{name} {100 * part:.0f} %"
                                 for name, part in taught.coverage.items())  # fmt: skip
