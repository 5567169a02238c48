"""Diagnose what a model gets wrong: named effects, evidence, extended model."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from dvrk_gravity import command_line
from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

NAME = "diagnose"
EXAMPLE = (
    "python -m dvrk_gravity diagnose my_bag --model config/mtmr_28002.yaml --out out/diagnosis\n"
    "         python -m dvrk_gravity diagnose my_bag --model robot.urdf --out out/urdf\n"
    "         python -m dvrk_gravity diagnose loaded.csv --arm mtmr --reference bare.csv "
    "--out out/load"
)

# Share of the time at the beginning of each: of a diagnosis of a real MTM's motion with twelve
# findings (half a minute), and of a real PSM's with one (nine seconds).
STAGES = (
    ("reading", 0.0),
    ("building hypotheses", 0.03),
    ("comparing hypotheses", 0.1),
    ("looking for unexplained structure", 0.85),
    ("measuring gains on held-out blocks", 0.9),
    ("simulating motion and drift", 0.92),
)

FINDINGS, EXTENDED, REPORT = WRITTEN = ("findings.json", "extended_model.yaml", "report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("recordings", nargs="+", metavar="RECORDING", help="rosbag2 or CSV")
    parser.add_argument("--model", type=Path, help="model file to test; or a .urdf, for its masses")
    parser.add_argument("--reference", metavar="RECORDING",
                        help="baseline recording of the same motion: report what changed since "
                        "(with --arm, no model is needed)")  # fmt: skip
    parser.add_argument("--arm", help=f"{options.arms()}, without --model")
    parser.add_argument("--known-payload", metavar="KG", type=float,
                        help="known mass of a payload, to check the effort scale")  # fmt: skip
    parser.add_argument("--payload-at", metavar="LINK[:X,Y,Z]",
                        help="a load is at this place, m in the link's frame (default: the link's "
                        "end): weigh it there")  # fmt: skip
    options.add_drive_gains(parser)
    parser.add_argument(
        "--out", required=True, metavar="DIR",
        help="folder for findings.json, extended_model.yaml and report.html",
    )  # fmt: skip
    parser.add_argument(
        "--coordinates", choices=("joint", "actuator"),
        help="coordinates of the recordings (default: those that a plain model fits better; "
        "actuator coordinates are then reported as a finding)",
    )  # fmt: skip
    options.add_at(parser)
    options.add_reading(parser)
    parser.add_argument("--json", action="store_true", help="print findings.json only")
    parser.add_argument("--verbose", action="store_true", help="print every finding and note")


def run(args: argparse.Namespace) -> int:
    """Diagnose, write the three files, print a summary.

    Returns:
        0, or 1 if the recordings are of the other arm than the model, or nothing can be judged.
    """
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.compensate import with_simulation
    from dvrk_gravity.diagnosis import Files, arm_for, diagnose
    from dvrk_gravity.identification import require_solver
    from dvrk_gravity.model import TorqueModel, uncertainty_file
    from dvrk_gravity.observation import contradiction
    from dvrk_gravity.report import columns, diagnosis_page, diagnosis_text

    require_solver()  # of the simulated bodies, before any work
    references = [] if args.reference is None else [args.reference]
    read = [] if args.model is None else [args.model, uncertainty_file(args.model)]
    read += [] if args.arm is None else [Arm.file(args.arm)]
    uncertainty_name = uncertainty_file(Path(EXTENDED)).name
    files = [*args.recordings, *references]
    out = outputs.check_folder("--out", args.out, [*WRITTEN, uncertainty_name], [*files, *read])
    model = None if args.model is None else TorqueModel.load(args.model)
    arm = None if args.arm is None else Arm.load(args.arm)
    arm = arm_for(model, arm, args.reference is not None)
    if model is None:
        arm = options.with_drive_gains(arm, args)
    else:
        model = options.model_with_drive_gains(model, args)
        arm = model.arm
    still = options.fixed_positions(args.at, arm)
    recordings = options.recordings(files, args, arm, args.coordinates or "joint")
    options.require_as_recorded(args.at, still, recordings)
    reference = recordings.pop() if references else None
    try:
        with command_line.Progress(NAME, 1.0) as progress:
            stages = command_line.Stages(progress, STAGES)
            diagnosis = diagnose(
                recordings, model, stages, still=still, coordinates=args.coordinates,
                reference=reference, arm=arm, known_payload=args.known_payload,
                payload_at=args.payload_at,
            )  # fmt: skip
            stages("simulating motion and drift")
            diagnosis = with_simulation(diagnosis)
    except ConfigError as error:
        of_model = args.model is not None and not error.field.startswith("--")
        raise error.in_file(args.model) if of_model else error from None
    diagnosis = replace(diagnosis, files=Files.of(out / FINDINGS, args.model, args.recordings))
    out.mkdir(parents=True, exist_ok=True)
    text_file.write(out / FINDINGS, diagnosis.to_json())
    base = f"Given model: {args.model}" if args.model else f"Changes against {args.reference}"
    comment = f"Extended by: dvrk_gravity diagnose\n{base}\n" + "\n".join(
        finding.sentence for finding in diagnosis.findings if finding.in_model
    )
    diagnosis.model.save(out / EXTENDED, comment)
    text_file.write(
        out / REPORT, diagnosis_page(diagnosis, [str(path) for path in args.recordings])
    )
    if args.json:
        print(diagnosis.to_json())
    else:
        for line in diagnosis_text(diagnosis, args.verbose, columns()):
            print(line)
        print(f"written: {out}/{', '.join(WRITTEN)}")
    blind = diagnosis.verdict == "cannot_judge"
    return int(blind or bool(contradiction(diagnosis.warnings)))
