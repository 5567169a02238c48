"""The sum of effects of one arm, its uncertainty, and the arm that it names."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
