"""Collecting: an arm moved along a plan, watched, and recorded whole or not at all."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
