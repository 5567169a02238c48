"""What the compensator decides, without ROS: limits, settings, and when to command at all."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
