"""What an arm did: recordings of any kind, in joint space and SI, corrected and filtered."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
