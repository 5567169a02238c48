"""Recordings of an arm: rosbag2 and CSV files, filters, and checks of what they hold."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
