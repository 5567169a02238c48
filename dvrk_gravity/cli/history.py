"""Show which arms of a fleet changed, since when, how fast, and which need a hand first."""

from __future__ import annotations

import argparse
from pathlib import Path

from dvrk_gravity import command_line
from dvrk_gravity.cli.fleet import require
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

NAME = "history"
EXAMPLE = (
    "python -m dvrk_gravity history results\n"
    "         python -m dvrk_gravity history results --arm 28002"
)
PAGE, CSV, JSON, ARMS = "history.html", "history.csv", "history.json", "arms"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("folder", metavar="DIR", type=Path, help="the folder of `fleet --out`")
    parser.add_argument(
        "--arm", metavar="SERIAL", help="of this arm alone, which is then tested by itself"
    )
    parser.add_argument(
        "--rate", type=float, default=0.05, metavar="PART",
        help="false discovery rate: the part of the reported arms that may be unchanged "
        "(default: 0.05)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Write pages and summaries beside the results, and print what changed."""
    require("pyarrow")
    from dvrk_gravity.fleet import HistorySettings, histories
    from dvrk_gravity.report import (
        FEW_ARMS,
        arm_page,
        history_csv,
        history_json,
        history_page,
        history_text,
    )

    folder, rate = arguments.folder, arguments.rate
    if not 0.0 < rate < 1.0:
        raise ConfigError("--rate", rate, "a part, between 0 and 1")
    outputs.check_folder("DIR", str(folder), [PAGE, CSV, JSON], [], [ARMS])
    with command_line.Progress("history", 1.0) as progress:
        found = histories(
            folder, arguments.arm or "", HistorySettings(false_discovery_rate=rate), progress.update
        )  # fmt: skip
    (folder / ARMS).mkdir(exist_ok=True)
    pages = {}
    for arm in found:
        if arm.changes or len(found) <= FEW_ARMS:
            pages[arm.serial] = f"{ARMS}/{arm.serial}.html"
            text_file.write(folder / pages[arm.serial], arm_page(arm, rate), wait=False)
    written = [folder / ARMS]
    if arguments.arm is None:
        text_file.write(folder / PAGE, history_page(found, rate, pages))
        text_file.write(folder / CSV, history_csv(found))
        text_file.write(folder / JSON, history_json(found, rate))
        written = [folder / PAGE, folder / CSV, folder / JSON]
    for line in history_text(found):
        print(line)
    print(f"written: {', '.join(map(str, written))}")
    return 0
