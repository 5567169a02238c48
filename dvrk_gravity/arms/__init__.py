"""Arms as data: what joints there are, what they move, and how far."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
