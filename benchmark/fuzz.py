"""Try many damaged files on every reader: only the package's own errors may come out.

    PYTHONPATH=. python benchmark/fuzz.py [--cases N] [--seed S] [--json FILE]

The same cases as in the trials, but more of them, and others with every seed. The first that brings
another error is made as small as it can be and printed; the exit status is then 1. Then hostile
files, one of each kind and seed: a few kB that unpack, compare or recur without end. Each is read
in a process of its own, within `CPU` s of the processor and `MEMORY` bytes, and ends within `ENDS`
s of Ctrl-C.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path
from random import Random
from typing import Any

import hypothesis

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "trials"))

import hostile_files
import test_damaged_files as files
from recording_samples import joint_state, write_messages

from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.files import text_file

CPU = 20  # s of the processor's time for a file of up to 1 MB: ten times what was measured
MEMORY = 600_000_000  # bytes beside what the process had before
PRESSED, ENDS = 0.3, 1.0  # s from the beginning to Ctrl-C, and from there to the end


def hostile(kind: str, folder: Path, seed: int) -> dict[str, Any]:
    """Read a hostile file twice, the second time until Ctrl-C; return what it took."""
    path = hostile_files.write(kind, folder, Random(seed))
    _, seconds, status = _apart(path)
    late, _, interrupted = _apart(path, press=True)
    path.unlink()
    passed = status == 0 and interrupted in (0, 130) and late < ENDS
    return {"reader": kind, "seed": seed, "seconds": seconds, "late": late, "passed": passed}


def _apart(path: Path, press: bool = False) -> tuple[float, float, int]:
    """Read a file in a process of its own; return s after Ctrl-C, s of processor, and status."""
    process = os.fork()
    if not process:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        gc.callbacks.clear()  # in Hypothesis's own, a Ctrl-C is lost
        before = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))
        resource.setrlimit(resource.RLIMIT_AS, (before + MEMORY, before + MEMORY))
        status = 1
        try:
            hostile_files.read(path)
            status = 0
        except DvrkGravityError:
            status = 0
        except KeyboardInterrupt:
            status = 130
        except BaseException:
            traceback.print_exc()
        os._exit(status)
    pressed = time.monotonic()
    if press:
        time.sleep(PRESSED)
        pressed = time.monotonic()
        os.kill(process, signal.SIGINT)
    _, status, used = os.wait4(process, 0)
    code = os.waitstatus_to_exitcode(status)
    return time.monotonic() - pressed, used.ru_utime + used.ru_stime, code


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
    parser.add_argument("--hostile", type=int, default=3, help="hostile files of each kind")
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
    rows += _hostile_table(range(arguments.seed, arguments.seed + arguments.hostile))
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(rows, indent=1) + "\n")
    return 0 if all(row["passed"] for row in rows) else 1


def _hostile_table(seeds: range) -> list[dict[str, Any]]:
    """Print what hostile files take, and return it."""
    print(f"\n{'hostile file':<32}{'most s':>8}{'s to end':>10}")
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for kind in hostile_files.KINDS:
            found = [hostile(kind, Path(name), seed) for seed in seeds]
            if found:
                seconds, late = (max(row[of] for row in found) for of in ("seconds", "late"))
                verdict = "" if all(row["passed"] for row in found) else "  FAILS"
                print(f"{kind:<32}{seconds:>8.1f}{late:>10.2f}{verdict}", flush=True)
            rows += found
    return rows


if __name__ == "__main__":
    sys.exit(main())
