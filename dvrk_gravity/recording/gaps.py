"""What gaps in time cost a trajectory: which were interpolated over, what splitting left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.data_warning import DataWarning
from dvrk_gravity.recording.filters import LowPass
from dvrk_gravity.recording.grid import TimingSettings


@dataclass(frozen=True)
class LossSettings:
    """When the loss of samples is a warning, and not just told.

    Attributes:
        discarded: Part of the samples: with a tenth missing, intervals are some 5 % wider than the
            recording promises (1 / sqrt(0.9)).
    """

    discarded: float = 0.1


@dataclass
class Gaps:
    """Counts gaps while a trajectory is read.

    Attributes:
        low: The low-pass that goes over every part.
        longest: Longest interval that is interpolated over, s.
        bridged: Gaps that were.
        longest_bridged: The longest of these, s.
        splits: Gaps that were not.
        parts: Parts that were kept.
        lost: Samples of parts that are too short for the filter.
    """

    low: LowPass
    longest: float
    bridged: int = 0
    longest_bridged: float = 0.0
    splits: int = 0
    parts: int = 0
    lost: int = 0

    def count(self, time: Array) -> None:
        """Count the gaps between (N,) times, s."""
        intervals = np.diff(time)
        gaps = intervals[intervals > TimingSettings().gap / self.low.rate]
        bridged = gaps[gaps <= self.longest]
        self.bridged += len(bridged)
        self.longest_bridged = max(self.longest_bridged, float(bridged.max(initial=0.0)))
        self.splits += len(gaps) - len(bridged)

    @property
    def discarded(self) -> int:
        """Samples that gaps cost: those of short parts, and the filter's ends on either side."""
        return self.lost + 2 * self.low.edge * max(self.parts - 1, 0)

    def handling(self) -> list[str]:
        """Return what was done, one sentence each."""
        lines = []
        if self.bridged:
            lines.append(
                f"{self.bridged} gaps of up to {1e3 * self.longest_bridged:.3g} ms interpolated "
                f"over (up to {1e3 * self.longest:.3g} ms is short for the filter)"
            )
        if self.splits:
            lines.append(
                f"split at gaps into {self.parts} parts, {self.lost} samples of short ones left out"
            )
        return lines

    def warnings(self, samples: int) -> tuple[DataWarning, ...]:
        """Return a warning if gaps cost too many of the samples of a recording."""
        share = self.discarded / samples
        if share <= LossSettings().discarded:
            return ()
        return (
            DataWarning(
                "samples_discarded",
                None,
                {"samples": self.discarded, "share": share, "gaps": self.splits},
                f"{self.discarded} of {samples} samples ({100 * share:.0f} %) are not used: "
                f"{self.splits} gaps of more than {1e3 * self.longest:.3g} ms leave parts that are "
                "short for the filter, which takes "
                f"{self.low.edge / self.low.rate:.2g} s at either end of each; record without gaps",
            ),
        )
