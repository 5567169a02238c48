"""Thin rclpy nodes over a library that knows no ROS."""
