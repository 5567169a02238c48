"""The least that a node in Python can do: publish every measured_js again as servo_jf.

It is what the compensator's round trip is compared with: the same messages, the same queues, the
same executor, and nothing in between.
"""

from __future__ import annotations

import signal
import sys
import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState


def main() -> int:
    """Relay until SIGINT or SIGTERM."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("relay")
    publisher = node.create_publisher(JointState, "servo_jf", 10)
    node.create_subscription(JointState, "measured_js", publisher.publish, 1)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
