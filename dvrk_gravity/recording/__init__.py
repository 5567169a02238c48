"""Recordings of an arm: rosbag2 and CSV files, filters, and checks of what they hold."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
