"""Estimation from arrays: splits, normal equations, robust weights, covariance, noise, selection.

Knows nothing of effects, arms or ROS; identification (of trajectories and of poses) and diagnosis
stand on it. Arrays are (n, m): samples first, channels (joints or motors) second.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
