"""Estimation from arrays: splits, normal equations, robust weights, covariance, noise, selection.

Knows nothing of effects, arms or ROS; identification (of trajectories and of poses) and diagnosis
stand on it. Arrays are (n, m): samples first, channels (joints or motors) second.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
