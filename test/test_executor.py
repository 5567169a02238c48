"""The executor of the nodes: what waits for too long is woken."""

from __future__ import annotations

import time

import rclpy
from rclpy.signals import SignalHandlerOptions

from dvrk_gravity.ros import PromptExecutor, PromptNode, kept_awake
from dvrk_gravity.ros import executor as of_nodes

LONG = 10.0  # s, as if the clock on which the middleware waits had been set back


def test_a_wait_that_would_last_is_ended(domain, monkeypatch):
    monkeypatch.setattr(of_nodes, "LOOK", LONG)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = PromptNode("sleeper")
    executor = PromptExecutor(node)
    start = time.monotonic()
    with kept_awake(executor):
        for _ in range(5):  # the first ones may find something to do
            executor.spin_once(timeout_sec=LONG)
    took = time.monotonic() - start
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    assert took < LONG / 2
