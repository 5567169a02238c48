"""Units of work on Dask's distributed scheduler: a local cluster, or one that is there already.

Only so many units are with the scheduler at a time that its workers do not wait; what comes of one
is taken before another is sent. Memory of client and scheduler therefore depends neither on the
number of recordings nor on their length.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

from dvrk_gravity import __version__
from dvrk_gravity.errors import ConfigError, DvrkGravityError

U = TypeVar("U")
R = TypeVar("R")

AHEAD = 2
"""Units with the scheduler for each thread of its workers: one that runs, and the next. Chosen: a
unit takes seconds, a message milliseconds."""
_RENEWED = 5.0  # s, after which workers are counted again
_FIRST = 60.0  # s for the first worker to come
_ANY_PORT = "127.0.0.1:0"  # of the scheduler's pages; Dask's own, 8787, may be another cluster's
_LOCAL = {
    # A unit that takes down a worker twice is left out; Dask's own default, 3, is for machines
    # that go away by themselves.
    "distributed.scheduler.allowed-failures": 1,
    # None waits on a worker that another one takes down.
    "distributed.scheduler.worker-saturation": 1.0,
}


class EngineLostError(DvrkGravityError):
    """The scheduler went away.

    Attributes:
        address: Of the scheduler.
    """

    def __init__(self, address: str) -> None:
        """Store the address and build the one-line message."""
        self.address = address
        super().__init__(
            f"the scheduler at {address} went away: what is done is kept; run the same command "
            "again, and only the rest is done"
        )


class Engine(Generic[U, R]):
    """Runs a function over units on a cluster.

    Attributes:
        address: Of the scheduler.
    """

    def __init__(self, client: Any, function: Callable[[U], R]) -> None:
        """Use a client of ``distributed``.

        Args:
            client: The client.
            function: What a worker does: importable there by its name.
        """
        self._client, self._function = client, function
        self.address = str(client.scheduler.address)
        self._threads, self._counted = 0, -_RENEWED

    def run(
        self, units: Iterable[U], key: Callable[[U], str],
        take: Callable[[U, R], None], lost: Callable[[U, str], None],
    ) -> None:  # fmt: skip
        """Run all units; what comes of each is taken at once, in the order in which they end.

        A unit that took down its workers is tried again by itself, after all others: it may have
        been on a worker that another one took down.

        Args:
            units: The units, of which no more are asked for than are sent.
            key: Name of a unit's task: two clients that send the same have it done once.
            take: Called with each unit and what came of it.
            lost: Called with a unit that could not be done, and why, in a line.

        Raises:
            EngineLostError: The scheduler went away.
        """
        suspects = list[U]()
        self._run(units, key, take, lost, suspects.append, None)
        self._run(suspects, lambda unit: f"{key(unit)}-alone", take, lost, None, 1)

    def _run(
        self, units: Iterable[U], key: Callable[[U], str],
        take: Callable[[U, R], None], lost: Callable[[U, str], None],
        suspect: Callable[[U], None] | None, room: int | None,
    ) -> None:  # fmt: skip
        """Run units, at most ``room`` at a time; where a suspect goes, it is not lost."""
        from distributed import CancelledError, as_completed
        from distributed.scheduler import KilledWorker

        waiting, pending = as_completed(), dict[Any, U]()
        rest = iter(units)
        try:
            while True:
                for unit in _up_to(rest, (room or self._room()) - len(pending)):
                    future = self._client.submit(
                        self._function, unit, key=key(unit), pure=False, retries=0
                    )
                    pending[future.key] = unit
                    waiting.add(future)
                if not pending:
                    return
                future = next(waiting)
                unit = pending.pop(future.key)
                try:
                    result = future.result()
                except CancelledError as error:
                    raise EngineLostError(self.address) from error
                except Exception as error:
                    if suspect is not None and isinstance(error, KilledWorker):
                        suspect(unit)
                    else:
                        lost(unit, loss_reason(error))
                else:
                    take(unit, result)
                future.release()
        except EngineLostError:
            raise
        except (StopIteration, OSError, RuntimeError) as error:
            # The client is closed beneath us in whatever call it happens to be.
            if self._client.status != "running":
                raise EngineLostError(self.address) from error
            raise

    def _room(self) -> int:
        """Return how many units the scheduler may have."""
        now = time.monotonic()
        if now - self._counted > _RENEWED:
            self._threads = sum(self._client.nthreads().values())
            self._counted = now
        return max(AHEAD * self._threads, AHEAD)


def _up_to(units: Iterator[U], count: int) -> Iterator[U]:
    for _ in range(count):
        try:
            yield next(units)
        except StopIteration:
            return


def loss_reason(error: Exception) -> str:
    """Return in a line what became of a unit that is lost."""
    from distributed.scheduler import KilledWorker

    if isinstance(error, KilledWorker):
        return "its worker died each time (too little memory, or a crash): run again to retry"
    if isinstance(error, MemoryError):
        return "took more memory than its worker has"
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]


def key_of(*parts: object) -> str:
    """Return the name of a task."""
    import hashlib

    return "recording-" + hashlib.sha256(repr(parts).encode()).hexdigest()[:20]


@contextmanager
def client_of(scheduler: str | None, workers: int) -> Iterator[Any]:
    """Give a client of a scheduler, or of a local cluster, for as long as it is used.

    Args:
        scheduler: Address, ``tcp://…``; ``None``: a cluster of this machine's processes.
        workers: Processes of a local cluster, of one thread each.

    Raises:
        ConfigError: Nobody answers there, no worker comes, or workers have another version.
    """
    import dask
    from distributed import Client, LocalCluster

    quiet = logging.getLogger("distributed")
    before = quiet.level
    quiet.setLevel(logging.CRITICAL + 1)  # what goes wrong is reported in a line, by us
    try:
        if scheduler is None:
            with (
                dask.config.set(_LOCAL),
                LocalCluster(
                    n_workers=workers, threads_per_worker=1, dashboard_address=_ANY_PORT,
                    silence_logs=logging.CRITICAL + 1,
                ) as cluster,
                Client(cluster) as client,
            ):  # fmt: skip
                yield client
            return
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, ValueError, TypeError) as error:
            expected = "the address of a running `dask scheduler`, as it prints it"
            raise ConfigError("--scheduler", scheduler, expected) from error
        try:
            _require_workers(client, scheduler)
            yield client
        finally:
            client.close(timeout=2)
    finally:
        quiet.setLevel(before)


def _require_workers(client: Any, scheduler: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_FIRST)
    except TimeoutError as error:
        expected = f"a worker: `dask worker {scheduler}`"
        raise ConfigError("--scheduler", "no worker", expected, scheduler) from error
    try:
        found = set(client.run(_version).values())
    except ModuleNotFoundError as error:
        raise ConfigError(
            "--scheduler", f"a worker without {error.name}",
            "workers in an environment with dvrk_gravity[fleet]", scheduler,
        ) from error  # fmt: skip
    if found != {__version__}:
        others = ", ".join(sorted(found - {__version__}))
        raise ConfigError("--scheduler", f"workers with version {others}", __version__, scheduler)


def _version() -> str:
    from dvrk_gravity import __version__ as its

    return its


def cores() -> int:
    """Return the processors that this process may use."""
    return len(os.sched_getaffinity(0))
