"""Every way in which a process that commands an arm can be asked to end, as one."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    signal.SIGHUP,
    signal.SIGQUIT,
    signal.SIGUSR1,
    signal.SIGUSR2,
    signal.SIGALRM,
    signal.SIGVTALRM,
    signal.SIGPROF,
    signal.SIGXCPU,
)
"""Those that end a process unless it takes them in hand (signal(7)), but for faults of its own, for
what cannot be caught, and for SIGPIPE and SIGXFSZ, which Python turns into an error of the call."""


@contextmanager
def asked_to_end(ask: Callable[[], None]) -> Iterator[None]:
    """Call ``ask`` for each signal that would end the process, for as long as the context lasts.

    The process itself goes on: it holds the arm and ends in order.
    """
    before = {number: signal.signal(number, lambda *_: ask()) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
