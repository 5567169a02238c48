"""Tell what a model gets wrong about recordings: named effects, proof, extended model."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from dvrk_gravity import command_line
from dvrk_gravity.cli import arm_options
from dvrk_gravity.cli.still_joints import add_at, require_unrecorded, still_joints
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

if TYPE_CHECKING:
    from dvrk_gravity.diagnosis import Diagnosis
    from dvrk_gravity.diagnosis.findings import Finding
    from dvrk_gravity.recording.data import Coordinates

NAME = "diagnose"
EXAMPLE = (
    "python -m dvrk_gravity diagnose my_bag --model config/mtmr_28002.yaml --out out/diagnosis\n"
    "         python -m dvrk_gravity diagnose my_bag --model robot.urdf --out out/urdf\n"
    "         python -m dvrk_gravity diagnose loaded.csv --arm mtmr --reference bare.csv "
    "--out out/load"
)


FINDINGS, EXTENDED, REPORT = WRITTEN = ("findings.json", "extended_model.yaml", "report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("recordings", nargs="+", metavar="RECORDING", help="rosbag2 or CSV")
    parser.add_argument(
        "--model", type=Path, help="model file that is on trial; or a .urdf: its masses are"
    )
    parser.add_argument("--reference", metavar="RECORDING",
                        help="the same motion when all was well: what changed since is told, with "
                        "--arm and no model, too")  # fmt: skip
    parser.add_argument("--arm", help=f"{arm_options.arms()}, without --model")
    parser.add_argument("--known-payload", metavar="KG", type=float,
                        help="mass that a link is said to carry: is the scale right?")  # fmt: skip
    arm_options.add_drive_gains(parser)
    parser.add_argument(
        "--out", required=True, metavar="DIR",
        help="folder for findings.json, extended_model.yaml and report.html",
    )  # fmt: skip
    parser.add_argument(
        "--coordinates", choices=("joint", "actuator"),
        help="what the recordings' columns are (default: what a plain model fits them better in, "
        "of both alike with --reference; what is not joint coordinates is a finding)",
    )  # fmt: skip
    add_at(parser)
    parser.add_argument("--topic", help="JointState topic of a bag, if it has several")
    parser.add_argument("--json", action="store_true", help="print findings.json, nothing else")


def run(args: argparse.Namespace) -> int:
    """Diagnose, write the three files, print a summary; return the exit status."""
    # Here and not above: Pinocchio and SciPy are slow to load and --help needs none of it.
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.diagnosis import diagnose
    from dvrk_gravity.diagnosis.reference import arm_for
    from dvrk_gravity.model import TorqueModel, uncertainty_file
    from dvrk_gravity.recording import RecordingFile
    from dvrk_gravity.report.diagnosis import render

    given = [] if args.model is None else [args.model, uncertainty_file(args.model)]
    given += [] if args.arm is None else [Arm.file(args.arm)]
    given += [] if args.reference is None else [args.reference]
    beside = uncertainty_file(Path(EXTENDED)).name
    out = outputs.check_folder("--out", args.out, [*WRITTEN, beside], [*args.recordings, *given])
    model = None if args.model is None else TorqueModel.load(args.model)
    arm = None if args.arm is None else Arm.load(args.arm)
    arm = arm_for(model, arm, args.reference is not None)
    if model is None:
        arm = arm_options.with_drive_gains(arm, args)
    else:
        model = arm_options.of_model(model, args)
        arm = model.arm
    still = still_joints(args.at, arm)
    files = [*args.recordings, *([] if args.reference is None else [args.reference])]
    read_as: Coordinates = args.coordinates or "joint"
    recordings = [RecordingFile(path, args.topic, coordinates=read_as, arm=arm) for path in files]
    require_unrecorded(args.at, recordings)
    reference = None if args.reference is None else recordings.pop()
    shown = sys.stderr.isatty()

    def progress(line: str) -> None:
        if shown:
            print(f"\r\033[K{line} …", end="", file=sys.stderr, flush=True)

    try:
        diagnosis = diagnose(
            recordings, model, progress, simulated=True, still=still,
            coordinates=args.coordinates, reference=reference, arm=arm,
            known_payload=args.known_payload,
        )  # fmt: skip
    except ConfigError as error:
        of_model = args.model is not None and not error.field.startswith("--")
        raise error.in_file(args.model) if of_model else error from None
    if shown:
        print("\r\033[K", end="", file=sys.stderr)
    out.mkdir(parents=True, exist_ok=True)
    text_file.write(out / FINDINGS, diagnosis.to_json())
    base = f"Given model: {args.model}" if args.model else f"Changes against {args.reference}"
    comment = f"Extended by: dvrk_gravity diagnose\n{base}\n" + "\n".join(
        finding.sentence for finding in diagnosis.findings if finding.in_model
    )
    diagnosis.model.save(out / EXTENDED, comment)
    text_file.write(out / REPORT, render(diagnosis, [str(path) for path in args.recordings]))
    print(diagnosis.to_json() if args.json else _summary(diagnosis, out))
    return 0


def _summary(diagnosis: Diagnosis, out: Path) -> str:
    import numpy as np

    from dvrk_gravity.diagnosis.findings import BETWEEN, ERROR, FLOORS, KNOWN
    from dvrk_gravity.recording import brief

    count = len(diagnosis.findings)
    of_all = f" (the first of {count} findings)" if count > 1 else ""
    lines = [diagnosis.headline] if diagnosis.headline else []
    lines.append(f"{diagnosis.verdict.replace('_', ' ')}: {diagnosis.sentence}{of_all}")
    if diagnosis.findings:
        after = " then what an arm's file says little of," if diagnosis.of_file else ""
        lines.append(
            f"what changed or was missed, the largest gain first,{after} what is not certain last:"
        )
    lines += _told(diagnosis.findings)
    if diagnosis.caveat:
        lines.append(f"note: {diagnosis.caveat}")
    known = [entry for entry in diagnosis.known if entry.effect != ERROR]
    if known:
        lines.append(f"{BETWEEN if diagnosis.beside_reference else KNOWN}:")
        for entry in known:
            lines.append(f"   {entry.sentence}")
            lines += [f"   what to do: {entry.remedy}"] if entry.remedy else []
    suspected = [ambiguity for ambiguity in diagnosis.ambiguities if ambiguity.suspected]
    lines += [f"not to be told apart: {ambiguity.sentence}" for ambiguity in suspected]
    unseen = [ambiguity.pair for ambiguity in diagnosis.ambiguities if ambiguity not in suspected]
    if unseen:
        lines.append(
            f"no sign of these, but this data could not tell them apart: {'; '.join(unseen)} "
            "(numbers in the report)"
        )
    from dvrk_gravity.report.units import effort_in_table

    unit, factor, decimals = effort_in_table(diagnosis.model.arm, diagnosis.sizes)

    def shown(value: float) -> str:
        return f"{factor * value:9.{decimals}f}" if np.isfinite(value) else "  unknown"

    head = f"held-out RMSE [{unit}]"
    width = max(len(head), *(2 + len(joint) for joint in diagnosis.before))
    lines.append(f"errors {diagnosis.compared}:")
    columns = dict(zip(("before", "after", "floor", "expected"), diagnosis.errors, strict=True))
    told = f"floor: {FLOORS[diagnosis.floor_from]}"
    if np.isfinite(list(diagnosis.expected.values())).any():
        told += "; expected: of the model, by its own uncertainty and friction of another day"
        told += ", which grows where it is extrapolated" if diagnosis.outside else ""
    else:
        del columns["expected"]
    lines.append(f"{head:<{width}}" + "".join(f" {word:>9}" for word in columns))
    lines += [
        f"{f'  {joint}':<{width}}"
        + "".join(f" {shown(column[joint])}" for column in columns.values())
        for joint in diagnosis.before
    ]
    lines.append(told)
    if diagnosis.in_simulation is not None:
        from dvrk_gravity.report import in_simulation

        arm, joint = diagnosis.model.arm, diagnosis.gains_most
        lines += in_simulation.lines(diagnosis.in_simulation, arm, joint)
    if diagnosis.weighed is not None:
        lines.append(f"known payload: {diagnosis.weighed.sentence}")
    if diagnosis.outside:
        lines += ["extrapolated:", *(f"   {line}" for line in diagnosis.outside)]
    shown_here = ("warning: ", "not recorded", "not judged")
    lines += [note for note in diagnosis.notes if note.startswith(shown_here)]
    lines += [f"warning: {line}" for line in brief(diagnosis.warnings)]
    lines.append(f"written: {out}/findings.json, extended_model.yaml, report.html")
    return "\n".join(lines)


def _told(findings: Sequence[Finding]) -> list[str]:
    """Return findings in lines; what is done alike about one effect at several joints, once."""
    from dvrk_gravity.effects.unknown import Unknown

    def alike(numbered: tuple[int, Finding]) -> tuple[object, ...]:
        number, finding = numbered
        alone = number if finding.alternatives else 0
        return finding.effect, finding.place, finding.remedy, finding.left_out, alone

    lines = []
    for _, group in groupby(enumerate(findings, start=1), alike):
        numbers, same = zip(*group, strict=True)
        first, last = same[0], numbers[-1]
        to = f" to {last}" if len(same) > 1 else ""
        where = ", ".join(dict.fromkeys(joint for finding in same for joint in finding.joints))
        lines.append(f"{numbers[0]}{to}. {first.effect} at {where or 'the arm'} ({first.place})")
        lines += [f"   {finding.sentence}" for finding in same]
        if first.remedy:
            lines.append(f"   what to do: {first.remedy}")
        lines += [
            f"   or {other.effect} at {', '.join(other.joints) or 'the arm'}: {other.why}"
            for other in first.alternatives
        ]
        if not first.in_model and first.effect != Unknown.NAME:
            lines.append(f"   (not in the extended model: {first.left_out})")
    return lines


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb and return its exit status."""
    return command_line.run(__name__, argv)


if __name__ == "__main__":
    sys.exit(main())
