"""Targets as ratios to units of time, so that they judge the code and not the machine.

A unit is work that every machine does and that this package cannot change: numpy's addition of
seven numbers (0.4 µs on a good machine), a copy of memory, an import of numpy, a bare relay node
(``relay.py``). What is judged takes turns with its unit, in processor time where it waits for
nothing: a slower machine, or a busy one, slows both.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Way = Callable[[], object]

_SEVEN = np.ones(7)
ADDITIONS = 500
"""Additions in one call of :func:`add`: about as long as a scheduler leaves a process alone."""


@dataclass(frozen=True)
class Target:
    """A figure and its bar.

    Attributes:
        name: What is measured.
        value: The figure, in units.
        most: The bar: what it may be at most.
        unit: The unit, in words.
        here: The absolute figure on this machine, in words; it is printed, not judged.
    """

    name: str
    value: float
    most: float
    unit: str
    here: str = ""

    @property
    def met(self) -> bool:
        """Whether the figure is within its bar; NaN is not."""
        return self.value <= self.most


def judge(targets: Sequence[Target]) -> bool:
    """Print a line for each target; return whether all are met."""
    width = max(len(target.name) for target in targets)
    print(f"\n{'target':<{width}}{'figure':>10}{'at most':>10}")
    for target in targets:
        verdict = "met" if target.met else "MISSED"
        here = f" ({target.here})" if target.here else ""
        print(
            f"{target.name:<{width}}{target.value:>10.4g}{target.most:>10.4g} {target.unit}{here}: "
            f"{verdict}"
        )
    return all(target.met for target in targets)


def as_json(targets: Sequence[Target]) -> list[dict[str, Any]]:
    """Return targets and verdicts for a JSON file."""
    return [vars(target) | {"met": target.met} for target in targets]


def add() -> None:
    """Add seven numbers to seven, :data:`ADDITIONS` times."""
    seven = _SEVEN
    for _ in range(ADDITIONS):
        seven + seven


def repeated(call: Way, number: int) -> Way:
    """Return what calls ``call`` a number of times."""

    def calls() -> None:
        for _ in range(number):
            call()

    return calls


def in_turn(ways: Mapping[str, Way], repeats: int) -> dict[str, NDArray[np.float64]]:
    """Return the (repeats,) processor times of calls, s; the ways take turns."""
    times = {name: np.empty(repeats) for name in ways}
    for repeat in range(repeats):
        for name, way in ways.items():
            begin = time.thread_time()
            result = way()
            times[name][repeat] = time.thread_time() - begin
            del result  # so that the next one's memory is as fresh
    return times


def ratio(times: NDArray[np.float64], units: NDArray[np.float64]) -> float:
    """Return the ratio of (repeats,) times to those of the unit in the same turns.

    It is the lower quartile: a turn in which another process empties the caches slows a long way
    through the code more than a short loop.
    """
    return float(np.percentile(times / units, 25.0))


def in_additions(
    ways: Mapping[str, Way], number: int, repeats: int
) -> dict[str, tuple[float, float]]:
    """Return what each of ``number`` parts of a call takes: numpy additions, and seconds."""
    times = in_turn({"": add, **ways}, repeats)
    addition = times.pop("") / ADDITIONS
    return {
        name: (ratio(each, addition) / number, float(np.median(each)) / number)
        for name, each in times.items()
    }


def processor_time(pid: int) -> float:
    """Return the processor time that a process has used so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def process_time(program: Sequence[str]) -> float:
    """Return the processor time of ``python PROGRAM``, from its start to its end, s."""
    process = subprocess.Popen([sys.executable, *program], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"python {' '.join(program)} failed")
    return usage.ru_utime + usage.ru_stime


def import_numpy() -> float:
    """Return the processor time of a process that imports numpy, s."""
    return process_time(("-c", "import numpy"))
