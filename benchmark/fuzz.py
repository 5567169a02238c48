"""Try many damaged files on every reader: only the package's own errors may come out.

    PYTHONPATH=. python benchmark/fuzz.py [--cases N] [--seed S] [--json FILE]

The same cases as in the trials, but more of them, and others with every seed. The first that brings
another error is made as small as it can be and printed; the exit status is then 1.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

import hypothesis

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "trials"))

import test_damaged_files as files
from recording_samples import joint_state, write_messages

from dvrk_gravity.files import text_file


def attempts(folder: Path) -> dict[str, tuple[Any, dict[str, Any]]]:
    """Return what is tried: name -> (hypothesis test, its fixtures)."""
    for storage in ("sqlite3", "mcap"):
        write_messages(folder / storage, [joint_state(k) for k in range(20)], storage)
    small = [folder / "sqlite3" / "sqlite3.db3", folder / "mcap" / "mcap.mcap"]
    own = files.test_any_damaged_file_is_read_or_refused
    targets = {kind: (own, {"tmp_path": folder, "kind": kind}) for kind in files.READERS}
    fixtures = {"tmp_path": folder}
    return targets | {
        "bag, data": (
            files.test_damaged_bags_are_read_or_refused,
            fixtures | {"small_bags": small},
        ),
        "CSV": (files.test_any_csv_is_read_or_refused, fixtures),
        "message": (files.test_any_message_is_decoded_or_refused, {}),
    }


def main() -> int:
    """Print the table; status 1 if a reader lets another error out."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000, help="files for every reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    many = hypothesis.settings(
        max_examples=arguments.cases,
        deadline=None,
        database=None,
        derandomize=False,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    rows = []
    print(f"{'reader':<18}{'cases':>8}{'seconds':>10}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, (test, fixtures) in attempts(folder).items():
            begin, passed = time.perf_counter(), True
            try:
                # Hypothesis offers no other way to replace the settings that a test came with.
                test._hypothesis_internal_use_settings = many
                hypothesis.seed(arguments.seed)(test)(**fixtures)
            except Exception:
                traceback.print_exc()
                passed = False
            seconds = time.perf_counter() - begin
            rows.append({"reader": what, "cases": arguments.cases, "passed": passed})
            verdict = "" if passed else "  FAILS"
            print(f"{what:<18}{arguments.cases:>8}{seconds:>10.1f}{verdict}", flush=True)
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(rows, indent=1) + "\n")
    return 0 if all(row["passed"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
