"""Types of arrays, as every module annotates them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers, samples first."""

Mask = NDArray[np.bool_]
"""One truth value a sample, or a sample and a joint."""
