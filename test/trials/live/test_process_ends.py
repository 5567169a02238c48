"""Signals to programs that start nodes, and what keeps a node from waiting for ever."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest
from running import commanding

from dvrk_gravity.ros import keep_awake, private_domain

# Takes a while to leave in order, and is sent the signal again meanwhile.
ENDING = """
import os, signal, sys, time
from dvrk_gravity.ros import end_on_signals
end_on_signals()
try:
    {wait}
finally:
    os.kill(os.getpid(), {number})
    time.sleep(0.05)
    print("left in order", flush=True)
"""
PRINT_DOMAIN = """
import os, sys
os.getpid = lambda: int(sys.argv[1])  # begins to look where the other process does
from dvrk_gravity.ros import private_domain
with private_domain() as number:
    print(number)
"""


def run(program: str, *arguments: str, before: tuple[str, ...] = ()) -> tuple[int, str]:
    command = [*before, sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stdout


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_what_ends_on_a_signal_is_not_disturbed_by_the_next(number):
    wait = f"os.kill(os.getpid(), {int(number)}); time.sleep(60.0)"
    program = ENDING.format(wait=wait, number=int(number))
    # Whoever runs these tests under nohup has them ignore SIGHUP.
    program = f"import signal\nsignal.signal({int(number)}, signal.SIG_DFL)\n{program}"
    assert run(program) == (128 + number, "left in order\n")


def test_a_process_that_is_to_outlive_its_terminal_does():
    program = ENDING.format(wait="os.kill(os.getpid(), signal.SIGHUP)", number=1)
    assert run(program, before=("nohup",)) == (0, "left in order\n")


def test_a_node_whose_starter_has_ended_meanwhile_does_not_start():
    """The system is asked for the signal too late: who started it is not its parent any more."""
    orphan = (
        "import os\nfrom dvrk_gravity.ros import end_with\nend_with(os.getppid() + 1)\nprint(1)"
    )
    assert run(orphan) == (-signal.SIGTERM, "")


def test_two_processes_at_once_are_in_two_domains():

    with private_domain() as first, private_domain() as second:
        _, third = run(PRINT_DOMAIN, str(os.getpid()))
    assert len({first, second, int(third)}) == 3


def test_an_executor_that_waits_is_woken_again_and_again():
    woken = threading.Semaphore(0)

    class Executor:
        def wake(self) -> None:
            woken.release()

    with keep_awake(Executor()):
        assert all(woken.acquire(timeout=15.0) for _ in range(3))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP, signal.SIGTSTP])
def test_any_signal_ends_a_compensator_with_a_hold_and_status_0(arm, start, number):
    """SIGTERM is in test/live."""
    node = start("compensator")
    commanding(arm)
    node.signal(number)
    arm.client.wait(lambda: bool(arm.holds), "the hold")
    assert node.wait(20.0) == 0
    assert arm.commands[-1][0] < arm.holds[-1]
