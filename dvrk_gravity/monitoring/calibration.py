"""What a monitor would say of the recording that its model was identified on: nothing."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.change_candidates import find_candidates
from dvrk_gravity.monitoring.change_test import ChangeTest
from dvrk_gravity.monitoring.limits import Key, Limits
from dvrk_gravity.monitoring.observer import MomentumObserver
from dvrk_gravity.monitoring.rows import Rows
from dvrk_gravity.monitoring.transients import transient_torques
from dvrk_gravity.monitoring.window import Band, Sampling, Window
from dvrk_gravity.monitoring.wrench import Tip

_STEP = 4.0  # s, between two looks at the calibration
_SHORTEST = 10.0  # s, of a part that shows what recurs: as long as a monitor learns


def calibration_limits(
    model: TorqueModel, band: Band, sampling: Sampling, longest: float, limits: Limits,
    tip: Tip | None,
) -> Limits:  # fmt: skip
    """Return limits that the calibration's own samples do not exceed.

    What the model lacks recurs in other motions, and not as white noise: after reversals, say.

    Args:
        model: The model; without kept samples the limits are returned as they are.
        band: By how much it is off.
        sampling: Of observer and windows.
        longest: s, of a window.
        limits: Those by chance.
        tip: Where a hand may push.
    """
    kept = None if model.uncertainty is None else model.uncertainty.calibration
    if kept is None or model.of_file:
        return limits
    of_causes = dict[Key, float]()
    of_pushes = np.zeros(model.arm.n + 1)
    for part in kept.parts:
        time = np.arange(part.start, part.stop) / kept.rate
        samples = (kept.q[part], kept.qd[part], kept.effort[part])
        rows = Rows.of(sampling.row_rate, time, *samples)
        size, step = (round(each * sampling.row_rate) for each in (longest, _STEP))
        size = min(size, len(rows))
        if size < _SHORTEST * sampling.row_rate:
            continue
        unexpected = MomentumObserver(model, band.gain, 1.0).advance(rows).unexpected
        for last in range(size, len(rows) + 1, step):
            own = slice(last - size, last)
            window = Window.of(model, rows.at(own), unexpected[own], band, sampling)
            test = ChangeTest(window.uncertain, window.residual)
            firsts = np.arange(0, len(window.time) - 20, 25).tolist()
            for candidate in find_candidates(window, test, firsts, limits):
                key = candidate.hypothesis.key
                if candidate.evidence.gain > of_causes.get(key, 0.0):
                    possible = candidate.plausible_fit
                    if possible is not None:
                        of_causes[key] = max(of_causes.get(key, 0.0), possible.evidence.gain)
            found = transient_torques(window, test, 0, tip)
            of_pushes = np.maximum(of_pushes, found.gain.max(axis=0))
    return Limits(limits.false_alarms, of_causes, of_pushes)
