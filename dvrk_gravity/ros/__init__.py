"""Thin rclpy nodes over a library that knows no ROS."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
