"""From recordings to a torque model, its uncertainty and its verdict."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
