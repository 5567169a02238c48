"""Velocity columns compared with the derivative of the positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.recording.filters import LowPass, derivative
from dvrk_gravity.recording.quantization import quantum, velocity_error
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.timing import longest_bridged, resample, split_at_gaps, stale

DEGREE = np.pi / 180.0


_CUTOFF = 10.0  # Hz, of both signals' low-pass; less for slow recordings. Chosen: above 5.65 Hz
_SLOPE = 0.03  # relative error of the column's scale. Chosen
_RESIDUAL = 0.08  # part of the derivative that the column leaves unexplained. Chosen
_LAG = 2e-3  # s that the column may be late. Chosen
_NOISE = 3.0  # standard deviations of the derivative's error from the encoder's steps
# Factor within which the scales of several joints are one, and one scale still is an estimate's: of
# a real MTM's wrists, whose encoders are coarse, it is up to 1.18 (1.07 where all joints of real
# MTMs, PSMs and UR10es are looked at together). Chosen.
_EQUAL = 1.25
_CLOCK = 0.1  # relative error of the scale of all joints beyond which it is the clock's. Chosen
_CLEAR = 0.9  # correlation beyond which a scale is one. Chosen
_SLOWEST = 1e-6  # rad/s, RMS, below which a joint does not move. Chosen: rounding


@dataclass(frozen=True)
class VelocityFit:
    """A joint's velocity column against its differentiated position, both low-passed.

    Attributes:
        slope: Column over derivative, least squares.
        lag: How late the column is, s.
        lag_error: Standard deviation of that, s.
        correlation: Between the two.
        residual: RMS of what the slope leaves, over the RMS of the derivative.
        noise: RMS error that encoder steps give the derivative, over its RMS.
        samples: Independent samples: twice the cut-off times the duration.
    """

    slope: float
    lag: float
    lag_error: float
    correlation: float
    residual: float
    noise: float
    samples: float

    @property
    def worse(self) -> bool:
        """Whether the column disagrees by more than the derivative's own error can explain."""
        uncertainty = 4.0 * self.residual / np.sqrt(self.samples)
        noise = _NOISE * self.noise
        scaled = abs(self.slope - 1.0) > max(_SLOPE, uncertainty, noise)
        return scaled or self.residual > max(_RESIDUAL, noise)

    @property
    def of_another_scale(self) -> bool:
        """Whether it is clearly the derivative times a factor beyond estimation error."""
        return abs(self.correlation) > _CLEAR and not 1.0 / _EQUAL < self.slope < _EQUAL

    @property
    def late(self) -> bool:
        """Whether the column is significantly late or early, however clean."""
        return abs(self.lag) > _LAG + 4.0 * self.lag_error

    @property
    def position_in_degrees(self) -> bool:
        """Whether the slope is that of rad/s over degrees a second."""
        return bool(abs(self.slope / DEGREE - 1.0) < 0.2)

    @property
    def suspicion(self) -> str:
        """Unit error that the slope suggests, or nothing."""
        if self.position_in_degrees:
            return " (positions in degrees?)"
        if abs(self.slope * DEGREE - 1.0) < 0.2:
            return " (deg/s?)"
        return ""


def common_factor(fits: Sequence[VelocityFit | None]) -> float | None:
    """Return the common factor of all joints' velocities, of two at least, or ``None``.

    A known unit's factor is none.
    """
    found = [fit for fit in fits if fit is not None]
    slopes = np.array([fit.slope for fit in found])
    if len(found) < 2 or slopes.min() <= 0.0:
        return None
    factor = float(np.median(slopes))
    off = np.abs(slopes - 1.0) > _CLOCK
    equal = np.abs(np.log(slopes / factor)) < np.log(_EQUAL)
    clear = all(fit.correlation > _CLEAR and not fit.suspicion for fit in found)
    return factor if clear and bool(np.all(off & equal)) else None


def compare_velocity(recording: Recording) -> tuple[VelocityFit | None, ...]:
    """Compare the velocity column of every joint with its differentiated position.

    Stale samples are interpolated over first; the longest part without gaps is used.

    Returns:
        A fit for every joint; ``None`` without velocities or time, if the recording is too short,
        or if a joint's motion does not rise above its encoder's steps.
    """
    nominal = recording.rate
    if recording.velocity is None or nominal is None:
        return (None,) * len(recording.joints)
    low = LowPass(min(_CUTOFF, nominal / 20.0), nominal)
    parts = split_at_gaps(recording, longest_bridged(nominal, low.cutoff))
    longest = max(parts, key=len)
    fresh = longest.rows(~stale(longest))
    if len(fresh) < 6 * low.edge:
        return (None,) * len(recording.joints)
    grid = resample(replace(fresh, effort=None, direction=None), nominal)
    assert grid.velocity is not None
    inner = slice(low.edge, -low.edge)
    derived = derivative(low(grid.position), nominal)
    column, acceleration = low(grid.velocity)[inner], derivative(derived, nominal)[inner]
    derived = derived[inner]
    samples = 2.0 * low.cutoff * len(derived) / nominal
    fits: list[VelocityFit | None] = []
    for j in range(len(recording.joints)):
        x, y, a = derived[:, j], column[:, j], acceleration[:, j]
        spread = float(np.std(x))
        noise = velocity_error(quantum(longest.position[:, j]), low.cutoff, nominal)
        if spread <= max(_NOISE * noise, _SLOWEST) or np.isnan(y[0]):
            fits.append(None)
            continue
        slope = float(x @ y / (x @ x))
        rest = y - slope * x
        lag = float(-(rest @ a) / (slope * (a @ a))) if slope else 0.0
        unexplained = np.sqrt(np.mean((rest + slope * lag * a) ** 2) / np.mean(a**2))
        fits.append(
            VelocityFit(
                slope,
                lag,
                float(unexplained / (abs(slope) * np.sqrt(samples))) if slope else 0.0,
                float(np.corrcoef(x, y)[0, 1]) if np.std(y) > 0.0 else 0.0,
                float(np.sqrt(np.mean(rest**2) / np.mean(x**2))),
                float(noise / spread),
                samples,
            )
        )
    return tuple(fits)
