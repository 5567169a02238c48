"""Motions: smooth ways from here to there, motions that excite, and the limits that they keep."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
