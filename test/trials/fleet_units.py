"""What workers do in the tests of a fleet: units that take a moment, and some that go wrong."""

from __future__ import annotations

import os
import time
from pathlib import Path

from dvrk_gravity.fleet import Result, Unit, key_of, parquet


def work_for_a_moment(unit: Unit) -> Result:
    """Return a result after as many seconds as the recording says, and leave a line of it."""
    what = Path(unit.recording).read_text()
    if what == "crash":
        os.kill(os.getpid(), 9)
    if what == "memory":
        held = []
        while True:
            held.append(bytearray(os.urandom(1 << 20) * 8))
            time.sleep(0.01)
    time.sleep(float(what))
    with Path(unit.recording).with_suffix(".log").open("a") as log:
        log.write("done\n")
    content = Path(unit.recording).name
    row = {
        "key": key_of(content, unit.model_hash), "kind": "recording", "serial": unit.serial,
        "recording": unit.recording, "content": content, "model": unit.model_hash,
        "version": "0.1.0", "size": unit.size, "modified": unit.modified, "verdict": "explained",
    }  # fmt: skip
    return Result(row["key"], table=parquet([row]), verdict="explained")
