"""Findings and fits as pages that a person reads: HTML in one file, no network."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
