"""The simulated arm: forward dynamics, friction that sticks, sensors, and the dVRK's manners."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
