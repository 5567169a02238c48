"""What the engine of a fleet costs: scheduler, workers, memory.

    python benchmark/fleet_scaling.py --json out/bench/fleet_scaling.json

A null unit costs a worker nothing: what it takes is of scheduler, client and messages. Of busy
units the part of the time is measured in which a worker works, which another load of the machine
does not change: two workers do 2 u2 / u1 times what one does on cores of their own. Memory is that
of this process, with scheduler and client in it, before and after thousands of results, and after
recordings of other lengths.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import psutil

from dvrk_gravity.fleet import Engine, Unit, client_of, work
from dvrk_gravity.recording import Recording

RESULT = b"x" * 12_000  # bytes of a result's table, as of an ECM's recording


def null(unit: int) -> bytes:
    """Do nothing, and return as much as a recording does."""
    return RESULT + str(unit).encode()


def busy(unit: tuple[int, float]) -> float:
    """Use a processor for some of its seconds; return how long that took by the clock."""
    begun, processor = time.perf_counter(), time.process_time()
    while time.process_time() - processor < unit[1]:
        sum(range(1000))
    return time.perf_counter() - begun


def utilisation(workers: int, units: int, seconds: float) -> float:
    """Return the part of the time in which workers work, of busy units."""
    worked = list[float]()
    with client_of(None, workers) as client:
        engine: Engine[tuple[int, float], float] = Engine(client, busy)
        engine.run([(-k, 0.01) for k in range(2 * workers)], str, _ignore, _lost)  # they are up
        todo = [(k, seconds) for k in range(units * workers)]
        wall = _timed(lambda: engine.run(todo, str, lambda _, its: worked.append(its), _lost))
    return sum(worked) / (workers * wall)


def overhead(units: int) -> dict[str, float]:
    """Return what null units cost, and by how much memory grows while they run."""
    with client_of(None, 2) as client:
        engine: Engine[int, bytes] = Engine(client, null)
        engine.run(range(-100, 0), _name, _ignore, _lost)
        before = _memory()
        processor = time.process_time()
        wall = _timed(lambda: engine.run(range(units), _name, _ignore, _lost))
        processor = time.process_time() - processor
        middle = _memory()
        engine.run(range(units, 2 * units), _name, _ignore, _lost)
        after = _memory()
    return {
        "units": units, "wall_ms": 1e3 * wall / units, "processor_ms": 1e3 * processor / units,
        "mb_before": before, "mb_after": middle, "mb_after_twice_as_many": after,
    }  # fmt: skip


def by_length(seconds: list[float]) -> list[dict[str, float]]:
    """Return by how much client and scheduler grow with recordings of some lengths."""
    found = []
    with TemporaryDirectory() as folder, client_of(None, 1) as client:
        engine: Engine[Unit, object] = Engine(client, work)
        for length in [seconds[0], *seconds]:  # the first twice: whatever is loaded once
            path = _recorded(Path(folder, f"{len(found)}.csv"), length)
            unit = Unit("ecm", "1", str(path), "2025-01-01T00:00:00+00:00", "name", 1, 1)
            sizes, before = list[int](), _memory()  # after making the recording, here
            name = f"length-{len(found)}"
            engine.run([unit], lambda _, name=name: name,
                       lambda _, got, its=sizes: its.append(len(got.table)), _lost)  # fmt: skip
            found.append({"seconds": length, "recording_mb": path.stat().st_size / 1e6,
                          "table_kb": sizes[0] / 1e3, "grows_mb": _memory() - before})  # fmt: skip
    return found[1:]


def _recorded(path: Path, seconds: float) -> Path:
    """Write a recording of any old motion, at 500 Hz."""
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.planning import Multisine
    from dvrk_gravity.simulate import PlantFile

    arm = Arm.load("ecm")
    time_ = np.arange(0.0, seconds, 2e-3)
    motion = Multisine.draw(arm, 0)
    model = PlantFile.of(arm).model
    position, velocity = motion.at(time_ + motion.ramp)
    effort = model.torque(position, velocity, np.gradient(velocity, 2e-3, axis=0))
    effort += 0.01 * np.random.default_rng(0).standard_normal(effort.shape)
    Recording(arm.joint_names, time_, position, velocity, effort).save(path)
    return path


def _memory() -> float:
    gc.collect()
    return psutil.Process().memory_info().rss / 1e6


def _timed(call: Callable[[], object]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def _name(unit: int) -> str:
    return f"null-{unit}"


def _ignore(*_: object) -> None:
    return


def _lost(unit: object, why: str) -> None:
    raise SystemExit(f"{unit}: {why}")


def main() -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=2000, help="null units")
    parser.add_argument("--busy", type=int, default=24, help="busy units a worker")
    parser.add_argument("--seconds", type=float, default=1.0, help="of a busy unit")
    parser.add_argument("--lengths", default="30,120,480", help="of recordings, s")
    parser.add_argument("--json", help="file for the figures")
    arguments = parser.parse_args()
    costs = overhead(arguments.units)
    print(
        f"a null unit: {costs['wall_ms']:.1f} ms, of which client and scheduler compute "
        f"{costs['processor_ms']:.1f} ms; memory {costs['mb_before']:.0f} MB, after "
        f"{costs['units']} units {costs['mb_after']:.0f} MB, after twice as many "
        f"{costs['mb_after_twice_as_many']:.0f} MB"
    )
    one, two = (utilisation(each, arguments.busy, arguments.seconds) for each in (1, 2))
    print(
        f"one worker works {100 * one:.1f} % of the time, two {100 * two:.1f} %: they do "
        f"{2.0 * two / one:.2f} times as much"
    )
    lengths = by_length([float(each) for each in arguments.lengths.split(",")])
    for row in lengths:
        print(
            f"a recording of {row['seconds']:g} s ({row['recording_mb']:.1f} MB): table "
            f"{row['table_kb']:.1f} kB; client and scheduler grow by {row['grows_mb']:.1f} MB"
        )
    figures = {"overhead": costs, "utilisation": [one, two], "lengths": lengths}
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(figures, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
