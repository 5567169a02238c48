"""Identify and diagnose many recordings of many arms, each once, on a Dask cluster."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dvrk_gravity import command_line
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs

if TYPE_CHECKING:
    from dvrk_gravity.fleet import Result, Summary, Unit

NAME = "fleet"
EXAMPLE = (
    "python -m dvrk_gravity fleet --scan bags\n"
    "         python -m dvrk_gravity fleet bags --out results\n"
    "         python -m dvrk_gravity fleet bags --out results --scheduler tcp://10.0.0.7:8786"
)
EXTRA = 'pip install "dvrk_gravity[fleet]"'
WRITTEN = ("results", "reports", "models")
_LINES = 20  # of recordings with something wrong, that are printed; all are in the results


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "folders", nargs="+", metavar="FOLDER", type=Path,
        help="folders with a fleet.yaml each, or such files",
    )  # fmt: skip
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument(
        "--scan", action="store_true",
        help="write FOLDER/fleet.yaml: arms by namespaces in bags, serial numbers in names of "
        "console files and folders; to be looked through",
    )  # fmt: skip
    task.add_argument(
        "--out", metavar="DIR",
        help="folder for results; what is there already is not done again. With a scheduler "
        "elsewhere, one that its workers see under the same name, for the models in it",
    )  # fmt: skip
    parser.add_argument(
        "--scheduler", metavar="URL",
        help="tcp://… of a running `dask scheduler` (default: processes of this machine)",
    )  # fmt: skip
    parser.add_argument(
        "--workers", type=int, metavar="N",
        help="processes of this machine (default: its cores)",
    )  # fmt: skip
    parser.add_argument(
        "--no-reports", action="store_true", help="no HTML report of each recording"
    )


def run(arguments: argparse.Namespace) -> int:
    """Scan, or work through the recordings and print a summary.

    Returns:
        0, or 1 if some recordings could not be worked on.
    """
    require("distributed", "pyarrow", "fsspec")
    return _scan(arguments.folders) if arguments.scan else _work(arguments)


def require(*modules: str) -> None:
    """Check that the packages of the extra are there.

    Raises:
        ConfigError: One is not, with the way out.
    """
    from importlib.util import find_spec

    for module in modules:
        if find_spec(module) is None:
            raise ConfigError("", f"no Python module {module}", EXTRA)


def _scan(folders: list[Path]) -> int:
    from dvrk_gravity.fleet import MANIFEST, scan

    for folder in folders:
        if not folder.is_dir():
            raise ConfigError("FOLDER", str(folder), "a folder of recordings")
        path = folder / MANIFEST
        if path.exists():
            raise ConfigError("--scan", "a file that exists", "none: it may be yours", path)
    for folder in folders:
        manifest = scan(folder)
        path = folder / MANIFEST
        manifest.save(path)
        unknown = sum(arm.arm == "ARM" for arm in manifest.arms)
        look = f"; write the kind of {unknown} arms for ARM" if unknown else ""
        print(f"written: {path}, {len(manifest.arms)} arms{look}")
    return 0


def _work(arguments: argparse.Namespace) -> int:
    from dvrk_gravity.fleet import (
        MANIFEST,
        FleetPlan,
        Manifest,
        Store,
        client_of,
        cores,
        run_fleet,
        work,
    )

    read = [path / MANIFEST if path.is_dir() else path for path in arguments.folders]
    out = outputs.check_folder("--out", arguments.out, [], read, WRITTEN)
    if arguments.workers is not None and arguments.workers < 1:
        raise ConfigError("--workers", arguments.workers, "1 or more")
    if arguments.workers is not None and arguments.scheduler is not None:
        expected = "none with --scheduler: a cluster that is there has workers"
        raise ConfigError("--workers", arguments.workers, expected)
    manifest = Manifest.of(arguments.folders)
    store = Store.open(out)
    with command_line.Progress("looking at recordings", len(manifest.arms)) as progress:
        planned = FleetPlan.of(manifest, store, progress.update)
    lines: list[str] = []

    def say(line: str) -> None:
        lines.append(line)
        if len(lines) <= _LINES:
            clear = command_line.CLEAR_LINE if sys.stderr.isatty() else ""
            print(f"{clear}{line}", file=sys.stderr, flush=True)

    function = work if arguments.no_reports else work_with_pages
    with (
        client_of(arguments.scheduler, arguments.workers or cores()) as client,
        command_line.Progress(NAME, planned.total) as progress,
    ):
        summary = run_fleet(planned, client, say, progress.update, function)
    _print(summary, arguments.out)
    return int(bool(summary.lines))


def work_with_pages(unit: Unit) -> Result:
    """Return a recording's result with its report: the function that workers run."""
    from dvrk_gravity.fleet import Pages, work
    from dvrk_gravity.report import diagnosis_page, identification_page

    return work(unit, Pages(identification_page, diagnosis_page))


def _print(summary: Summary, out: str) -> None:
    verdicts = ", ".join(
        f"{count} {verdict.replace('_', ' ')}" for verdict, count in summary.verdicts.most_common()
    )
    print(f"{summary.done} recordings: {verdicts or 'nothing was left to do'}")
    if summary.skipped:
        print(f"{summary.skipped} were there already")
    if summary.lines:
        more = len(summary.lines) - _LINES
        print(f"{len(summary.lines)} with something wrong, see above"
              + (f"; {more} more in the results, kind 'failure'" if more > 0 else ""))  # fmt: skip
    print(f"written: {out}/results (Parquet), {out}/reports; next: `history {out}`")
