"""The dVRK console's JSON: read, written, checked, converted."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
