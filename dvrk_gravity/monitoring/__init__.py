"""What pushes an arm, and what changed in it, while it moves: observer, bands, sequential tests."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
