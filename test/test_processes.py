"""ROS domains of one's own, for workers, tests and demonstrations that run side by side."""

from __future__ import annotations

import os
import subprocess
import sys

from dvrk_gravity.processes import private_domain

# Begins to look for a free domain where this process does.
CHILD = """
import os, sys
os.getpid = lambda: int(sys.argv[1])
from dvrk_gravity.processes import private_domain
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
