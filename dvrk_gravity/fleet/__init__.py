"""Many recordings of many arms: worked on once each, kept as a table, looked at over time."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
