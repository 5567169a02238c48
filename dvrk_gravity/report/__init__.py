"""Findings and fits as pages that a person reads: HTML in one file, no network."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
