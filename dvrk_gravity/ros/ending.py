"""Every way in which a process that commands an arm can be asked to end, as one."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_NOT_OURS = {
    signal.SIGKILL, signal.SIGSTOP,  # cannot be caught
    signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT, signal.SIGTRAP,
    signal.SIGSYS,  # faults of the process itself
    signal.SIGPIPE, signal.SIGXFSZ,  # which Python turns into an error of the call
    signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH,  # end nothing
    signal.SIGTTIN, signal.SIGTTOU,  # of a process in the background
}  # fmt: skip

SIGNALS = tuple(sorted(signal.valid_signals() - _NOT_OURS))
"""Those that end a process, or suspend it (Ctrl-Z), unless it takes them in hand (signal(7)): an
arm is not left by a process that sleeps."""


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
