"""The simulated arm: forward dynamics, friction that sticks, sensors, and the dVRK's manners."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
