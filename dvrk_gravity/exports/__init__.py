"""A torque model as other programs read arms: URDF and MJCF, and what neither can hold."""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
