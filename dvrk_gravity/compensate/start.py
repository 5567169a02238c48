"""What to begin with: the effort that holds the arm, measured before the first command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.compensate.sample import Sample
from dvrk_gravity.compensate.settings import CONSIDERABLE, Settings
from dvrk_gravity.errors import DvrkGravityError

Array = NDArray[np.float64]

DURATION = 0.1
"""Efforts are averaged over at least so long, s…"""

LEAST_SAMPLES = 10
"""… and so many samples: their mean has less than a third of one sample's noise."""

CONFIDENCE = 3.0
"""Measured and modelled effort differ by what is more than so many standard errors: where they
agree within noise, the start is the model's torque, which sets no joint in motion."""


class StartRefusedError(DvrkGravityError):
    """The arm must not be commanded as things are."""


class Start:
    """Collects samples of an arm that holds itself, and tells what the first command is.

    Attributes:
        begin: Monotonic time of the first sample, s.
    """

    def __init__(self, now: float) -> None:
        """Begin to collect."""
        self.begin = now
        self._efforts: list[Array | None] = []
        self._models: list[Array] = []

    def add(self, sample: Sample, torque: Array) -> None:
        """Take a sample and the model's (n,) torque at it, N·m."""
        self._efforts.append(sample.effort)
        self._models.append(torque)

    def complete(self, now: float) -> bool:
        """Tell whether there is enough to begin with."""
        return now - self.begin >= DURATION and len(self._models) >= LEAST_SAMPLES

    def origin(self, settings: Settings) -> tuple[Array, str]:
        """Return the (n,) first effort, N·m, and in words where it is from.

        The model's torque, and of the difference to the mean effort that was measured as much as
        noise cannot explain (soft thresholding, Donoho & Johnstone 1994). An arm that does not
        measure its efforts (none, not numbers, or all of them exactly zero) begins with the
        model's torque.

        Raises:
            StartRefusedError: Measured and modelled efforts differ by more than
                ``settings.start_tolerance``, or the limits cut what holds the arm.
        """
        model = np.mean(self._models, axis=0)
        measured = [effort for effort in self._efforts if effort is not None]
        names = settings.model.arm.joint_names
        if len(measured) < len(self._efforts) or not np.any(measured):
            origin, source = model, "the model's torque, as measured_js has no usable effort"
        else:
            with np.errstate(over="ignore", invalid="ignore"):
                difference = np.array(measured) - self._models
                mean = difference.mean(axis=0)
                error = difference.std(axis=0, ddof=1) / np.sqrt(len(difference))
                proven = np.maximum(np.abs(mean) - CONFIDENCE * error, 0.0)
            origin, source = model + np.copysign(proven, mean), "the measured effort"
            excess = np.abs(mean) / settings.model.arm.effort_limit
            worst = int(np.argmax(excess))
            if not excess[worst] <= settings.start_tolerance:
                raise StartRefusedError(
                    f"{names[worst]} is held with {model[worst] + mean[worst]:.4g} N·m as measured,"
                    f" with {model[worst]:.4g} by the model: a wrong unit, another arm's model, an "
                    f"arm that leans on something? Allowed are {settings.start_tolerance:g} of the "
                    "arm's effort_limit (start_tolerance)"
                )
        cut = np.abs(settings.limits.clip(origin) - origin) / settings.model.arm.effort_limit
        worst = int(np.argmax(cut))
        if not cut[worst] <= CONSIDERABLE:
            raise StartRefusedError(
                f"{names[worst]} takes {origin[worst]:.4g} N·m to hold, more than its effort "
                "limits leave: it would fall"
            )
        return settings.limits.clip(origin), source
