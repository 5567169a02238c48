"""How processes end: by signals at any time, in any order, and with whoever started them."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time
from pathlib import Path

from rclpy.duration import Duration
from running import commanding
from std_msgs.msg import Empty
from support import MODEL_FILE

from dvrk_gravity.ros import Client, NodeProcess

FILE = ("--params-file", str(MODEL_FILE))


def catches(node: NodeProcess, number: signal.Signals, mask: str = "SigCgt") -> bool:
    """Tell whether a process handles a signal itself, from what the kernel says of it."""
    status = Path(f"/proc/{node.process.pid}/status").read_text(encoding="ascii")
    caught = next(line for line in status.splitlines() if line.startswith(mask))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


def until(condition, what: str) -> None:
    """Wait for what no callback brings."""
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.002)


def test_a_signal_ends_a_compensator_with_a_hold_and_status_0(arm, start):
    """It comes twice: the second while the first is handled."""
    node = start("compensator")
    commanding(arm)
    assert not arm.holds
    for _ in range(2):
        node.signal(signal.SIGTERM)
    arm.client.wait(lambda: bool(arm.holds), "the hold")
    assert node.wait(20.0) == 0
    assert arm.commands[-1][0] < arm.holds[-1]


def test_ctrl_c_while_it_loads_sets_up_or_waits_ends_it_without_a_word(arm, start):
    def loading(node: NodeProcess) -> bool:
        # Python ignores SIGPIPE for good and, a moment later, handles SIGINT, until the package's
        # first line.
        return catches(node, signal.SIGPIPE, "SigIgn") and not catches(node, signal.SIGINT)

    first, second, third = (start("compensator", wait=False) for _ in range(3))
    until(lambda: loading(first), "its first lines")
    until(lambda: loading(first), "its first lines, seen twice, as the moment may be met")
    first.signal(signal.SIGINT)
    assert first.wait(20.0) in (-signal.SIGINT, 0)
    until(lambda: catches(second, signal.SIGTERM), "its own signals")  # Python has none for it
    second.signal(signal.SIGINT)
    assert second.wait(20.0) == 0
    arm.await_compensator()
    third.signal(signal.SIGINT)
    assert third.wait(20.0) == 0
    assert not arm.holds  # nothing was commanded


PLAYED = ("-p", "disable_builtin:=true", "-p", "max_stamp_age:=0.0", "-p", "ramp_time:=0.2")


def test_all_that_a_launch_file_started_ends_in_order_however_the_signals_come(domain):
    """Ctrl-C reaches every process at once, the simulated arm before those that have to hold it."""
    patient = ("-p", "timeout:=0.9", "-p", "watchdog_timeout:=1.0")
    with (
        NodeProcess("simulator", "-p", "plant:=mtmr_28002") as arm,
        NodeProcess("watchdog", *FILE, *patient) as watchdog,
        NodeProcess("compensator", *FILE, *patient, *PLAYED) as compensator,
    ):
        until(lambda: "commanding: " in compensator.output, "commands")
        nodes = (arm, watchdog, compensator)
        for node in nodes:
            node.signal(signal.SIGINT)
        assert [node.wait(20.0) for node in nodes] == [0, 0, 0]
        for node in nodes:
            assert "ERROR" not in node.output
            assert "Traceback" not in node.output


def test_a_simulated_arm_ends_when_nobody_is_left_who_could_hold_it(domain):
    with NodeProcess("simulator") as arm, Client() as client:
        hold = client.node.create_publisher(Empty, "hold", 1)
        client.wait(lambda: client.connected(hold), "the arm")
        hold.publish(Empty())
        assert hold.wait_for_all_acked(Duration(seconds=15.0))
        client.node.destroy_publisher(hold)
        client.spin(0.5)
        arm.signal(signal.SIGTERM)
        assert arm.wait(20.0) == 0


# Starts a compensator and waits to be killed.
PARENT = """
import sys, time
from dvrk_gravity.ros.processes import NodeProcess
node = NodeProcess("compensator", "--params-file", sys.argv[1], "-p", "timeout:=1.0")
print(node.process.pid, flush=True)
time.sleep(60.0)
"""


def runs(pid: int) -> bool:
    """Tell whether a process is there and has not ended."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def test_a_node_ends_with_the_process_that_started_it_and_holds_the_arm_first(arm):
    command = [sys.executable, "-c", PARENT, str(MODEL_FILE)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        arm.await_compensator()
        commanding(arm)
        arm.holds.clear()
        parent.kill()
        arm.run_until(lambda: not runs(child), "the end of the compensator")
        arm.run_until(lambda: bool(arm.holds), "the hold")
