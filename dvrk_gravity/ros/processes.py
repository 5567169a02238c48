"""Start the package's nodes as processes of their own, apart from every other ROS system."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from dvrk_gravity.errors import DvrkGravityError

PRIVATE = "/dvrk_gravity_private"
"""Root of every namespace in a private domain. No arm has such a name: one that joins the domain,
or that reaches it from another machine, is not commanded."""

# Domains whose ports no Linux system gives to outgoing connections, but for 0: everybody's.
_DOMAINS = range(1, 101)

# Every participant of a domain binds some of these UDP ports, whatever its middleware and its range
# of discovery (RTPS 2.5, 9.6.2.3): two of its own, and one for what is announced to all.
_FIRST_PORT, _PORTS = 7400, 250

ENVIRONMENT: dict[str, str | None] = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "ROS_LOCALHOST_ONLY": None,  # deprecated, and overrules the range
    "ROS_STATIC_PEERS": None,
    "ROS_DISCOVERY_SERVER": None,
    "ROS_SUPER_CLIENT": None,
    "FASTDDS_ENVIRONMENT_FILE": None,  # may name a discovery server
    "FASTRTPS_DEFAULT_PROFILES_FILE": None,
    "SKIP_DEFAULT_XML_FILE": "1",  # Fast DDS reads one that lies in the working folder
    "CYCLONEDDS_URI": None,
}
"""Variables that keep a private domain on this machine; ``None``: unset."""

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>

_ENDING = (signal.SIGTERM, signal.SIGHUP)


class ProcessError(DvrkGravityError):
    """A node's process that failed or did not respond."""


def end_on_signals() -> None:
    """Let SIGTERM and SIGHUP end this process as Ctrl-C does, together with its children.

    A closed terminal sends SIGHUP more than once: later ones are ignored.
    """

    def end(number: int, frame: object) -> None:
        for each in _ENDING:
            signal.signal(each, signal.SIG_IGN)
        sys.exit(128 + number)

    for number in _ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup sets it
            signal.signal(number, end)


def end_with(parent: int) -> None:
    """Have Linux send this process SIGTERM when its parent ends, for whatever reason.

    The parent may have ended already; its end is that of the thread that started this process.
    """
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)


def _lock(domain: int, stack: contextlib.ExitStack) -> bool:
    """Lock a domain's file until the stack ends; return whether it was free."""
    path = Path(tempfile.gettempdir()) / f"dvrk_gravity_domain_{domain}.lock"
    try:
        lock = stack.enter_context(path.open("w"))
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _is_taken(domain: int) -> bool:
    """Return whether a process on this machine has one of a domain's ports."""
    first = _FIRST_PORT + _PORTS * domain
    tables = [Path("/proc/net/udp"), *Path("/proc/net").glob("udp6")]  # or no IPv6 here
    lines = (line for table in tables for line in table.read_text().splitlines()[1:])
    ports = (int(line.split()[1].rpartition(":")[2], 16) for line in lines)
    return any(first <= port < first + _PORTS for port in ports)


@contextlib.contextmanager
def private_domain() -> Iterator[int]:
    """Reserve an empty ROS domain on this machine, local to it, while the context lasts.

    Processes of this package lock a file (the system releases the lock even if the process is
    killed), other participants bind ports; nodes that join later find only namespaces below
    :data:`PRIVATE`. The environment of this process and its children is set accordingly
    (:data:`ENVIRONMENT`).

    Raises:
        ProcessError: All domains are taken.
    """
    with contextlib.ExitStack() as stack:
        start = os.getpid() % len(_DOMAINS)
        for domain in (*_DOMAINS[start:], *_DOMAINS[:start]):
            if _lock(domain, stack) and not _is_taken(domain):
                break
        else:
            ends = f"{_DOMAINS[0]} to {_DOMAINS[-1]}"
            raise ProcessError(f"all ROS domains from {ends} of this machine are in use")
        wanted = {"ROS_DOMAIN_ID": str(domain), **ENVIRONMENT}
        before = {name: os.environ.get(name) for name in wanted}
        try:
            _set_environment(wanted)
            yield domain
        finally:
            _set_environment(before)


def _set_environment(values: Mapping[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


class NodeProcess:
    """One node running as ``python -m dvrk_gravity VERB … --ros-args …`` (context manager).

    It ends with this process, with SIGTERM if that has no time to end it.

    Attributes:
        verb: The verb, or the program.
        process: The process.
        lines: Its output so far, standard error included.
    """

    def __init__(
        self,
        verb: str | None,
        *ros_args: str,
        namespace: str = PRIVATE,
        program: Sequence[str] = ("-m", "dvrk_gravity"),
        of_arm: bool = False,
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        """Start ``python PROGRAM VERB --ros-args …`` in this process's ROS domain.

        A program that is itself a node takes no verb (``None``). A namespace that an arm may have
        is for those that are asked to move one (``of_arm``). ``parameters`` by name follow the
        arguments.

        Raises:
            ProcessError: A namespace that an arm may have.
        """
        if not of_arm and not f"{namespace}/".startswith(f"{PRIVATE}/"):
            raise ProcessError(f"namespace {namespace!r}: one below {PRIVATE}, which no arm has")
        self.verb = verb or program[-1]
        self.lines: list[str] = []
        command = [sys.executable, *program, *([] if verb is None else [verb])]
        command += ["--ros-args", "-r", f"__ns:={namespace}", *ros_args]
        for name, value in (parameters or {}).items():
            command += ["-p", f"{name}:={value}"]
        # A session of its own: Ctrl-C at the terminal reaches us alone, and we end it in order.
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            # It only calls the system: no thread of ours holds a lock that it needs.
            preexec_fn=partial(end_with, os.getpid()),
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    @property
    def output(self) -> str:
        """Its output so far."""
        return "\n".join(self.lines)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the process."""
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
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
