"""Declared parameters, and those of the nodes."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
