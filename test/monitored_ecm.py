"""What a monitor that knows the endoscope's arm says of it, once something adds to its torque."""

import known_ecm as ecm
import numpy as np

from dvrk_gravity.monitoring import monitor

SECONDS, ONSET = 40.0, 24.5


def later(torque):
    """Return what adds a torque from ``ONSET`` on, once the arm has been heard for a while."""

    def more(*state):
        return torque(*state) * (np.arange(len(state[0])) >= ONSET * 100.0)[:, None]

    return more


def heard(more=None):
    return monitor(ecm.recorded(2, SECONDS, more=more), ecm.model()).events
