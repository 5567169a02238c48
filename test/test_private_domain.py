"""ROS domains of one's own, for tests and demonstrations that run side by side."""

from __future__ import annotations

import os
import socket
from itertools import product

import pytest

from dvrk_gravity.ros import PRIVATE, NodeProcess, ProcessError, private_domain


def test_a_domain_whose_ports_are_taken_is_left_to_whoever_has_them():
    """Of any middleware, with announcements to all and without, or over IPv6."""
    for family, place in product((socket.AF_INET, socket.AF_INET6), (0, 11, 249)):
        with private_domain() as first, private_domain() as second:
            assert first != second
        with socket.socket(family, socket.SOCK_DGRAM) as other:
            other.bind(("", 7400 + 250 * first + place))
            with private_domain() as second:
                assert second != first


def test_a_domain_is_given_back():
    """There are a hundred."""
    for _ in range(110):
        with private_domain():
            pass


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
    with private_domain() as number:
        assert os.environ["ROS_DOMAIN_ID"] == str(number) != "0"
        left = {name: os.environ[name] for name in reaching if name in os.environ}
        assert left == {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        assert os.environ["SKIP_DEFAULT_XML_FILE"] == "1"  # one that lies in the working folder
    assert {name: os.environ[name] for name in reaching} == reaching


def test_a_node_is_started_in_no_namespace_that_an_arm_may_have():
    for namespace in ("/MTMR", "/", "", f"{PRIVATE}_of_mine", f"/lab{PRIVATE}"):
        with pytest.raises(ProcessError, match=f"^namespace '{namespace}': one below {PRIVATE}"):
            NodeProcess("simulator", namespace=namespace)
