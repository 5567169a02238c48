"""Motions: smooth ways from here to there, motions that excite, and the limits that they keep."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
