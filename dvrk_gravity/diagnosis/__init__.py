"""What does a model get wrong about a recording? Named effects, with proof on held-out data."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
