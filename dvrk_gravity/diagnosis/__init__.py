"""What does a model get wrong about a recording? Named effects, with proof on held-out data."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
