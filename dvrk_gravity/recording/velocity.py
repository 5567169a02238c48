"""Is a velocity column as good as the derivative of the positions?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.filters import LowPass, derivative
from dvrk_gravity.recording.grid import longest_bridged, resample, split_at_gaps, stale
from dvrk_gravity.recording.quantization import quantum, velocity_error

DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class ComparisonSettings:
    """When a velocity column disagrees with the derivative of the positions.

    Attributes:
        cutoff: Of both signals' low-pass, Hz; less for slow recordings. Chosen: above the band that
            is fitted (5.65 Hz).
        slope: Relative error of its scale. Chosen.
        residual: Part of it that the derivative leaves. Chosen.
        lag: s that it may be late. Chosen.
        noise: Times the error that the derivative itself has from the encoder's steps: three
            standard deviations.
        alike: Factor within which the scales of several joints are one, and one scale still is an
            estimate's: of a real MTM's wrists, whose encoders are coarse, it is up to 1.18 (1.07
            where all joints of real MTMs, PSMs and UR10es are looked at together). Chosen.
        clock: Relative error of the scale of all joints from which on it is the clock's. Chosen.
        clear: Correlation from which on a scale is one. Chosen.
        slowest: RMS velocity below which a joint does not move, rad/s. Chosen: rounding.
    """

    cutoff: float = 10.0
    slope: float = 0.03
    residual: float = 0.08
    lag: float = 2e-3
    noise: float = 3.0
    alike: float = 1.25
    clock: float = 0.1
    clear: float = 0.9
    slowest: float = 1e-6


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
        settings = ComparisonSettings()
        uncertainty = 4.0 * self.residual / np.sqrt(self.samples)
        noise = settings.noise * self.noise
        scaled = abs(self.slope - 1.0) > max(settings.slope, uncertainty, noise)
        return scaled or self.residual > max(settings.residual, noise)

    @property
    def of_another_scale(self) -> bool:
        """Whether it is the derivative, surely, times a factor that is no estimate's."""
        factor = ComparisonSettings().alike
        clear = abs(self.correlation) > ComparisonSettings().clear
        return clear and not 1.0 / factor < self.slope < factor

    @property
    def late(self) -> bool:
        """Whether the column is beyond doubt not in step with the positions, however clean."""
        return abs(self.lag) > ComparisonSettings().lag + 4.0 * self.lag_error

    @property
    def position_in_degrees(self) -> bool:
        """Whether the slope is that of rad/s over degrees a second."""
        return bool(abs(self.slope / DEGREE - 1.0) < 0.2)

    @property
    def suspicion(self) -> str:
        """What the slope looks like, or nothing."""
        if self.position_in_degrees:
            return " (positions in degrees?)"
        if abs(self.slope * DEGREE - 1.0) < 0.2:
            return " (deg/s?)"
        return ""


def common_factor(fits: Sequence[VelocityFit | None]) -> float | None:
    """Return by what the velocities of all joints are off alike; ``None`` where they are not.

    Args:
        fits: Of the joints; at least two of them moved. A known unit's factor is none.
    """
    settings = ComparisonSettings()
    found = [fit for fit in fits if fit is not None]
    slopes = np.array([fit.slope for fit in found])
    if len(found) < 2 or slopes.min() <= 0.0:
        return None
    factor = float(np.median(slopes))
    off = np.abs(slopes - 1.0) > settings.clock
    alike = np.abs(np.log(slopes / factor)) < np.log(settings.alike)
    clear = all(fit.correlation > settings.clear and not fit.suspicion for fit in found)
    return factor if clear and bool(np.all(off & alike)) else None


def compare_velocity(recording: Recording) -> tuple[VelocityFit | None, ...]:
    """Compare the velocity column of every joint with its differentiated position.

    Stale samples are interpolated over first; the longest part without gaps is used.

    Args:
        recording: With time.

    Returns:
        A fit for every joint; ``None`` where none was recorded, too short a recording, or a
        joint whose motion does not rise above its encoder's steps.
    """
    nothing: tuple[None, ...] = (None,) * len(recording.joints)
    nominal, settings = recording.rate, ComparisonSettings()
    if recording.velocity is None or nominal is None:
        return nothing
    low = LowPass(min(settings.cutoff, nominal / 20.0), nominal)
    parts = split_at_gaps(recording, longest_bridged(nominal, low.cutoff))
    longest = max(parts, key=len)
    fresh = longest.rows(~stale(longest))
    if len(fresh) < 6 * low.edge:
        return nothing
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
        if spread <= max(settings.noise * noise, settings.slowest) or np.isnan(y[0]):
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
