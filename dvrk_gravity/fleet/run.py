"""A fleet's recordings, all of them, once: the models first that arms lack, then the rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from dvrk_gravity.fleet.engine import Engine, key_of
from dvrk_gravity.fleet.fleet_plan import FleetPlan
from dvrk_gravity.fleet.worker import Result, Unit, work


@dataclass
class Summary:
    """What came of a run.

    Attributes:
        verdicts: How many recordings have which verdict.
        lines: What could not be done, a line each.
        skipped: Recordings whose results were there.
        seconds: Of workers.
    """

    verdicts: Counter[str] = field(default_factory=Counter)
    lines: list[str] = field(default_factory=list)
    skipped: int = 0
    seconds: float = 0.0

    @property
    def done(self) -> int:
        """Recordings that were worked on."""
        return sum(self.verdicts.values())


def run_fleet(
    planned: FleetPlan, client: Any, say: Callable[[str], None], progress: Callable[[float], None],
    function: Callable[[Unit], Result] = work,
) -> Summary:  # fmt: skip
    """Do what is planned, and write each result as it comes.

    Args:
        planned: The recordings.
        client: Of Dask's scheduler.
        say: Called with a line for each recording that something is wrong with.
        progress: Called with the number of recordings that are done.
        function: What a worker does with a unit; importable there by its name.

    Raises:
        EngineLostError: The scheduler went away; what is done is written.
    """
    summary, store = Summary(), planned.store
    engine: Engine[Unit, Result] = Engine(client, function)
    total = planned.total

    def note(unit: Unit, line: str) -> None:
        text = line if line.startswith(unit.recording) else f"{unit.recording}: {line}"
        summary.lines.append(text)
        say(text)

    def take(unit: Unit, result: Result) -> None:
        if result.known:
            summary.skipped += 1
        else:
            for failure in result.failures:
                note(unit, failure)
            store.write(result)
            summary.verdicts[result.verdict] += 1
            summary.seconds += result.seconds
        progress(min(summary.done + summary.skipped, total))

    def lost(unit: Unit, line: str) -> None:
        summary.verdicts["lost"] += 1
        note(unit, line)

    _identify_references(planned, engine, take, lost)
    for serial, _ in planned.references():
        summary.lines.append(f"{serial}: none of its recordings could be identified: no model")
        say(summary.lines[-1])
    engine.run(pending_comparisons(planned, summary), _key, take, lost)
    store.compact()
    return summary


def pending_comparisons(planned: FleetPlan, summary: Summary) -> Iterator[Unit]:
    """Yield recordings still to be compared with models, and count those done already."""
    before = planned.skipped
    for unit in planned.pending_comparisons():
        summary.skipped += planned.skipped - before
        before = planned.skipped
        yield unit
    summary.skipped += planned.skipped - before


def _identify_references(
    planned: FleetPlan, engine: Engine[Unit, Result],
    take: Callable[[Unit, Result], None], lost: Callable[[Unit, str], None],
) -> None:  # fmt: skip
    """Identify the first recording of each arm without a model; where that fails, its next one."""
    waiting = {serial: units for serial, units in planned.references() if units}

    def identified(unit: Unit, result: Result) -> None:
        take(unit, result)
        if result.model is not None:
            path = planned.store.write_model(unit.serial, result.model)
            planned.set_model(unit.serial, str(path))
            del waiting[unit.serial]

    while waiting:
        engine.run([units.popleft() for units in waiting.values()], _key, identified, lost)
        waiting = {serial: units for serial, units in waiting.items() if units}


def _key(unit: Unit) -> str:
    return key_of(unit.recording, unit.size, unit.modified, unit.model_hash)
