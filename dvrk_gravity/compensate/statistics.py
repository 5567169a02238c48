"""Input rate, age and compute time over the time between two diagnostics."""

from __future__ import annotations

import math
from collections import deque


class Statistics:
    """Collects cheaply, message by message, what diagnostics tell once a second."""

    def __init__(self) -> None:
        """Start with nothing received."""
        self._received = 0
        self._last = -math.inf
        self._since: float | None = None
        # Two seconds at 1 kHz: enough for a 99th percentile, and bounded.
        self._durations: deque[float] = deque(maxlen=2000)

    def received(self, now: float) -> None:
        """Count a message that came at monotonic time ``now``, s."""
        if self._since is None:
            self._since = now
        self._received += 1
        self._last = now

    def computed(self, seconds: float) -> None:
        """Note how long one answer took."""
        self._durations.append(seconds)

    def take(self, now: float) -> dict[str, str]:
        """Return the figures since the last call, in words, and start anew."""
        elapsed = 0.0 if self._since is None else now - self._since
        rate = self._received / elapsed if elapsed > 0.0 else 0.0
        age = now - self._last
        ordered = sorted(self._durations) or [0.0]
        p50, p99 = (ordered[int(part * len(ordered))] for part in (0.5, 0.99))
        self._received, self._since = 0, now
        self._durations.clear()
        return {
            "input rate Hz": f"{rate:.1f}",
            "input age s": f"{age:.4f}" if math.isfinite(age) else "never",
            "compute p50 us": f"{p50 * 1e6:.1f}",
            "compute p99 us": f"{p99 * 1e6:.1f}",
        }
