"""The sum of effects of one arm, its uncertainty, and the arm that it names."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
