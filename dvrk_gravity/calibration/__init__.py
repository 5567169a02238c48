"""Calibration: from an arm that is switched on to a model with a certificate, step by step."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
