"""What the compensator decides, without ROS: limits, settings, and when to command at all."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
