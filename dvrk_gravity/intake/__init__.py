"""Recordings as all verbs take them: arm, joints, coordinates, units and clock settled."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
