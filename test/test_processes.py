"""ROS domains of one's own, for workers, tests and demonstrations that run side by side."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from support import MODEL_FILE

from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, ProcessError, private_domain

# Begins to look for a free domain where this process does.
CHILD = """
import os, sys
os.getpid = lambda: int(sys.argv[1])
from dvrk_gravity.ros.processes import private_domain
with private_domain() as number:
    print(number)
"""


def test_two_processes_at_once_are_in_two_domains():
    command = [sys.executable, "-c", CHILD, str(os.getpid())]
    with private_domain() as first, private_domain() as second:
        child = subprocess.run(command, capture_output=True, check=True, text=True)
    assert len({first, second, int(child.stdout)}) == 3


def test_a_test_that_asks_for_no_domain_is_in_that_of_its_worker(ambient_domain):
    assert os.environ["ROS_DOMAIN_ID"] == str(ambient_domain)
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert ambient_domain != 0


def test_a_domain_in_which_a_console_is_is_left_to_it():
    with private_domain() as first:
        console = Client("/MTMR", "console")
    with console, private_domain() as second:
        assert second != first


# Of any middleware, with announcements to all and without, or over IPv6.
@pytest.mark.parametrize("family", [socket.AF_INET, socket.AF_INET6], ids=["IPv4", "IPv6"])
@pytest.mark.parametrize("place", [0, 10, 11, 40])
def test_a_domain_whose_ports_are_taken_is_left_to_whoever_has_them(family, place):
    with private_domain() as first:
        pass
    with socket.socket(family, socket.SOCK_DGRAM) as other:
        other.bind(("", 7400 + 250 * first + place))
        with private_domain() as second:
            assert second != first
    with private_domain() as third:
        assert third == first


def test_an_environment_that_reaches_other_machines_is_set_aside(monkeypatch, tmp_path):
    reaching = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "ROS_LOCALHOST_ONLY": "0",
        "ROS_STATIC_PEERS": "192.0.2.1",
        "ROS_DISCOVERY_SERVER": "192.0.2.1:11811",
        "ROS_SUPER_CLIENT": "TRUE",
        "FASTDDS_ENVIRONMENT_FILE": str(tmp_path / "environment.json"),
        "CYCLONEDDS_URI": "file:///nowhere.xml",
    }
    for name, value in reaching.items():
        monkeypatch.setenv(name, value)
    with private_domain():
        left = {name: os.environ[name] for name in reaching if name in os.environ}
        assert left == {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        assert os.environ["SKIP_DEFAULT_XML_FILE"] == "1"  # one that lies in the working folder
    assert {name: os.environ[name] for name in reaching} == reaching


@pytest.mark.parametrize("namespace", ["/MTMR", "/", "", f"{PRIVATE}_of_mine", f"/lab{PRIVATE}"])
def test_a_node_is_started_in_no_namespace_that_an_arm_may_have(namespace):
    with pytest.raises(ProcessError, match=f"^namespace '{namespace}': one below {PRIVATE}"):
        NodeProcess("simulator", namespace=namespace)


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


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_a_node_ends_with_the_process_that_started_it_and_holds_the_arm_first(arm, number):
    command = [sys.executable, "-c", PARENT, str(MODEL_FILE)]
    parent = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    with parent:
        child = int(parent.stdout.readline())
        arm.await_compensator()
        arm.run_until(lambda: len(arm.commands) > 5, "commands")
        assert not arm.holds
        parent.send_signal(number)
        arm.run_until(lambda: not runs(child), "the end of the compensator")
        arm.run_until(lambda: bool(arm.holds), "the hold")


# Takes a while to leave in order, and is sent the signal again meanwhile.
ENDING = """
import os, signal, sys, time
from dvrk_gravity.ros.processes import end_on_signals
end_on_signals()
try:
    print("runs", flush=True)
    time.sleep(60.0)
finally:
    os.kill(os.getpid(), int(sys.argv[1]))
    time.sleep(0.05)
    print("left in order", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_what_ends_on_a_signal_is_not_disturbed_by_the_next(number):
    command = [sys.executable, "-c", ENDING, str(int(number))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "runs\n"
        process.send_signal(number)
        assert process.stdout.read() == "left in order\n"
    assert process.returncode == 128 + number


def test_a_process_that_is_to_outlive_its_terminal_does():
    goes_on = ENDING.replace("time.sleep(60.0)", "os.kill(os.getpid(), signal.SIGHUP)")
    command = ["nohup", sys.executable, "-c", goes_on, "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "runs\nleft in order\n"


def test_a_node_whose_starter_has_ended_meanwhile_does_not_start():
    """The system is asked for the signal too late: who started it is not its parent any more."""
    orphan = """
import os, signal, sys
from dvrk_gravity.ros.processes import end_with
end_with(os.getppid() + 1)
print("goes on")
"""
    done = subprocess.run([sys.executable, "-c", orphan], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (-signal.SIGTERM, "")
