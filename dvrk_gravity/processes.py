"""Start the package's nodes as processes of their own, apart from every other ROS system."""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

from dvrk_gravity.errors import DvrkGravityError

# Domains whose ports no Linux system gives to outgoing connections, but for 0: everybody's.
_DOMAINS = range(1, 101)


class ProcessError(DvrkGravityError):
    """A node's process that did not do what it was started for."""


def end_on_sigterm() -> None:
    """Let SIGTERM end this process as Ctrl-C does, so that what it has started ends with it."""

    def end(number: int, frame: object) -> None:
        sys.exit(128 + number)

    signal.signal(signal.SIGTERM, end)


@contextlib.contextmanager
def private_domain() -> Iterator[int]:
    """Reserve a ROS domain on this machine, local to it, for as long as the context lasts.

    The reservation is a lock on a file, which the system releases even if the
    process is killed. The environment of this process (and of those that it
    starts) is set to the domain.

    Raises:
        ProcessError: All domains are taken.
    """
    with contextlib.ExitStack() as stack:
        start = os.getpid() % len(_DOMAINS)
        for domain in (*_DOMAINS[start:], *_DOMAINS[:start]):
            path = Path(tempfile.gettempdir()) / f"dvrk_gravity_domain_{domain}.lock"
            with contextlib.suppress(OSError):
                lock = path.open("w")
                stack.callback(lock.close)
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
        else:
            raise ProcessError("all ROS domains of this machine are in use by dvrk_gravity")
        wanted = {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        before = {name: os.environ.get(name) for name in wanted}
        os.environ.update(wanted)
        try:
            yield domain
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value


class NodeProcess:
    """One node running as ``python -m dvrk_gravity VERB … --ros-args …``.

    Attributes:
        verb: The verb, or what else was started.
        process: The process.
        lines: What it has printed so far, standard error included.
    """

    def __init__(
        self,
        verb: str | None,
        *ros_args: str,
        namespace: str = "/MTMR",
        program: Sequence[str] = ("-m", "dvrk_gravity"),
    ) -> None:
        """Start ``python PROGRAM VERB --ros-args …``; it lives in this process's ROS domain.

        A program that is one node itself takes no verb (``None``).
        """
        self.verb = verb or program[-1]
        self.lines: list[str] = []
        command = [sys.executable, *program, *([] if verb is None else [verb])]
        command += ["--ros-args", "-r", f"__ns:={namespace}", *ros_args]
        # A group of its own: a Ctrl-C at the terminal reaches us alone, and we end it in order.
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    @property
    def output(self) -> str:
        """All that it has printed so far."""
        return "\n".join(self.lines)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to this process by its id."""
        self.process.send_signal(number)

    def wait(self, timeout: float = 10.0) -> int:
        """Wait for its end and return its exit status.

        Raises:
            ProcessError: It goes on longer than ``timeout`` seconds.
        """
        try:
            status = self.process.wait(timeout)
        except subprocess.TimeoutExpired as error:
            raise ProcessError(f"{self.verb} did not end within {timeout:g} s") from error
        self._reader.join(timeout)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return status

    def stop(self, timeout: float = 10.0) -> int:
        """End it with SIGINT, with SIGKILL if it will not, and return its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)  # in case it was stopped
            self.process.send_signal(signal.SIGINT)
        try:
            return self.wait(timeout)
        except ProcessError:
            self.process.kill()
            return self.wait(timeout)

    def __enter__(self) -> NodeProcess:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.stop()
