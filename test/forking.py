"""Node processes that start quickly: each is forked from one that has loaded what a node loads.

A node of its own process takes 0.6 s of processor time to load numpy, Pinocchio and the package,
and this suite starts more than a hundred. The process that forks them has one thread and has not
loaded rclpy, which starts threads; from there on a node does all that it does elsewhere. What is
said of an interpreter that loads (Ctrl-C while it does) is tested with ``loading_itself``.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any

MESSAGES = (
    "builtin_interfaces.msg", "diagnostic_msgs.msg", "rcl_interfaces.msg", "rcl_interfaces.srv",
    "rosgraph_msgs.msg", "sensor_msgs.msg", "std_msgs.msg", "std_srvs.srv",
    "type_description_interfaces.srv",
)  # fmt: skip
LOADED = ("dvrk_gravity.compensate.supervisor", "dvrk_gravity.simulate.simulated_arm")


class Forked:
    """A forked process, with as much of ``subprocess.Popen`` as the package uses."""

    def __init__(self, pid: int, stdout: int, status: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self.stdout = open(stdout, errors="replace")  # noqa: SIM115
        self._status = status

    def poll(self) -> int | None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
            self.returncode = int(os.read(self._status, 100))
            os.close(self._status)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class Forking:
    """Starts processes of Python by forking one that is started at the first request."""

    def __init__(self) -> None:
        self._control: socket.socket | None = None
        self._server: subprocess.Popen[bytes] | None = None

    def popen(self, command: Sequence[str], **options: Any) -> Any:
        """Start ``python -m MODULE …`` or ``python -c CODE …`` as NodeProcess starts it."""
        assert command[0] == sys.executable
        options.pop("preexec_fn")  # `_serve` does the same for the process that it forks
        assert options == {
            "stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT,
            "text": True, "errors": "replace", "start_new_session": True,
        }  # fmt: skip
        if self._control is None:
            self._control, far = socket.socketpair()
            with far:
                # Threads of a linear algebra library would be there before anything is forked.
                self._server = subprocess.Popen(
                    [sys.executable, __file__, str(far.fileno())],
                    pass_fds=[far.fileno()], start_new_session=True,
                    env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
                )  # fmt: skip
        output, output_writer = os.pipe()
        status, status_writer = os.pipe()
        request = json.dumps(
            {"command": list(command[1:]), "environment": dict(os.environ), "folder": os.getcwd()}
        ).encode()
        socket.send_fds(
            self._control, [len(request).to_bytes(4, "little")], [output_writer, status_writer]
        )
        self._control.sendall(request)
        os.close(output_writer)
        os.close(status_writer)
        pid = int.from_bytes(_exactly(self._control, 4), "little")
        return Forked(pid, output, status)

    def close(self) -> None:
        """End the process that forks."""
        if self._control is not None and self._server is not None:
            self._control.close()
            self._server.wait(10.0)


@contextlib.contextmanager
def forked_nodes() -> Iterator[None]:
    """Let the package's ``NodeProcess`` fork its nodes for as long as the context lasts."""
    from dvrk_gravity.ros import processes

    forking = Forking()
    real = processes.subprocess
    processes.subprocess = SimpleNamespace(**vars(real) | {"Popen": forking.popen})  # type: ignore[assignment]
    try:
        yield
    finally:
        processes.subprocess = real
        forking.close()


@contextlib.contextmanager
def loading_itself() -> Iterator[None]:
    """Let ``NodeProcess`` start an interpreter that loads everything, as it does elsewhere."""
    from dvrk_gravity.ros import processes

    forked = processes.subprocess
    processes.subprocess = subprocess
    try:
        yield
    finally:
        processes.subprocess = forked


def _exactly(control: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count and (more := control.recv(count - len(data))):
        data += more
    return data


def _load() -> None:
    """Load what nodes load before they load rclpy."""
    for name in LOADED:
        importlib.import_module(name)
    for name in MESSAGES:
        for kind in vars(importlib.import_module(name)).values():
            if isinstance(kind, type):
                type(kind).__import_type_support__()  # type: ignore[attr-defined]
    # rclpy's logger asks where it is called from: `inspect` then looks for the file of each module.
    inspect.getmodule(sys._getframe())
    assert len(os.listdir("/proc/self/task")) == 1, "a process of several threads cannot be forked"


def _serve(control: socket.socket) -> list[str]:
    """Fork a process for each request until there are no more; return, in it, what it is to run.

    There are no more once the tests' process has ended, and with this one end those it has forked.
    """
    from dvrk_gravity.ros import end_with

    server = os.getpid()
    status_of: dict[int, tuple[int, int]] = {}  # pidfd -> process, where to write its status
    while True:
        for ready in select.select([control, *status_of], [], [])[0]:
            if ready is not control:
                pid, status = status_of.pop(ready)
                os.write(status, str(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])).encode())
                os.close(status)
                os.close(ready)
                continue
            length, fds, _, _ = socket.recv_fds(control, 4, 2)
            if not length:
                sys.exit()
            length += _exactly(control, 4 - len(length))
            request = json.loads(_exactly(control, int.from_bytes(length, "little")))
            pid = os.fork()
            if pid == 0:
                end_with(server)
                control.detach()
                _settle(fds[0], request["environment"], request["folder"])
                return request["command"]
            os.close(fds[0])
            status_of[os.pidfd_open(pid)] = (pid, fds[1])
            control.sendall(pid.to_bytes(4, "little"))


def _settle(output: int, environment: dict[str, str], folder: str) -> None:
    """Make the forked process what one that is started anew is."""
    os.setsid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.closerange(3, 4096)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    given = environment.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[0:1] = ["", *(path for path in given if path and path not in sys.path)]


def _run(command: list[str]) -> None:
    how, program, *words = command
    if how == "-m":
        sys.argv = [program, *words]
        runpy.run_module(program, run_name="__main__", alter_sys=True)
    else:
        sys.argv = [how, *words]
        exec(compile(program, "<string>", "exec"), {"__name__": "__main__"})


if __name__ == "__main__":
    sys.path[0] = ""
    _load()
    _run(_serve(socket.socket(fileno=int(sys.argv[1]))))
