"""Recordings as all verbs take them: arm, joints, coordinates, units and clock settled."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
