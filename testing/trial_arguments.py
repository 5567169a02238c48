"""What trials of MuJoCo's arms are told on the command line."""

from __future__ import annotations

import argparse

from testing.mujoco_world import NAMES

CLEAN = 3  # recordings with nothing hidden, a seed


def trial_parser(
    doc: str | None, seeds: tuple[int, int], sizes: tuple[float, float], unit: str
) -> argparse.ArgumentParser:
    """Return the parser of what all of them are told.

    Args:
        doc: Of the benchmark's module.
        seeds: By default.
        sizes: By default.
        unit: What sizes are measured by.
    """
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    # fmt: off
    parser.add_argument("--seeds", type=int, nargs=2, default=seeds, metavar=("FIRST", "END"))
    parser.add_argument("--arms", default=",".join(NAMES),
                        help="of MuJoCo's, one a seed in turn (default: %(default)s)")
    parser.add_argument("--effects", nargs="*",
                        help="only these, one named twice twice a seed (default: all once)")
    parser.add_argument("--sizes", type=float, nargs=2, default=sizes,
                        metavar=("LEAST", "GREATEST"),
                        help=f"of what is hidden in MuJoCo's, in units of {unit} "
                             "(default: %(default)s)")
    parser.add_argument("--clean", type=int, default=CLEAN, metavar="N",
                        help="recordings with nothing hidden, a seed (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", help="write every trial here")
    # fmt: on
    return parser


def parsed(parser: argparse.ArgumentParser) -> tuple[argparse.Namespace, list[str]]:
    """Return what it was told, and the arms; ends with a line where there is no such arm."""
    args = parser.parse_args()
    arms = args.arms.split(",")
    unknown = set(arms) - set(NAMES)
    if unknown:
        parser.error(f"--arms: got {', '.join(sorted(unknown))}, expected some of {NAMES}")
    return args, arms
