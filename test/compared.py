"""The small arm in the same motion twice, and the diagnosis of the second by the first."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from diagnosed import ARM, Motion, moving

from dvrk_gravity.diagnosis import Diagnosis, diagnose
from dvrk_gravity.recording import Recording

DURATION = 14.0  # s


def motion() -> Motion:
    return moving(0, DURATION)


@cache
def bare() -> Recording:
    return motion().read(motion().torque(), 11)


def again(extra: np.ndarray | float = 0.0) -> Recording:
    """Record the same motion on a clock that began later, with extra torques."""
    cut = motion().read(motion().torque() + extra, 13).between(1.7, np.inf)
    return replace(cut, time=cut.time - cut.time[0])


def changed(recording: Recording, **more) -> Diagnosis:
    return diagnose(recording, arm=ARM, reference=bare(), **more)
