"""A torque model as other programs read arms: URDF and MJCF, and what neither can hold."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
