"""Estimation from arrays: splits, normal equations, robust weights, covariance, noise, selection.

Knows nothing of effects, arms or ROS; identification (of trajectories and of poses) and diagnosis
stand on it. Arrays are (n, m): samples first, channels (joints or motors) second.
"""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
