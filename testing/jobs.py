"""Trials on the processes of a local cluster: the engine that fleets run on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from dvrk_gravity.fleet import Engine, client_of

R = TypeVar("R")


def run_all(
    function: Callable[..., R],
    todo: Sequence[tuple[Any, ...]],
    jobs: int,
    take: Callable[[R], None] = lambda result: None,
) -> list[R]:
    """Return what a function makes of each of some arguments, in their order.

    Args:
        function: The function.
        todo: Its arguments.
        jobs: Processes; 1: this one.
        take: Called with each result as soon as it is there.

    Raises:
        RuntimeError: A process died, or the function raised; the others are done first.
    """
    if jobs == 1:
        results = []
        for arguments in todo:
            results.append(function(*arguments))
            take(results[-1])
        return results
    found, failures = dict[int, R](), list[str]()

    def keep(number: int, result: R) -> None:
        found[number] = result
        take(result)

    def lost(number: int, why: str) -> None:
        failures.append(f"{todo[number]}: {why}")

    with client_of(None, min(jobs, len(todo) or 1)) as client:
        engine: Engine[int, R] = Engine(client, lambda number: function(*todo[number]))
        engine.run(range(len(todo)), lambda number: f"trial-{number}", keep, lost)
    if failures:
        raise RuntimeError("; ".join(failures))
    return [found[number] for number in range(len(todo))]
