"""The bare model in the supervisor's place: every readable sample is answered with its torque."""

from __future__ import annotations

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.sample import DroppedSampleError, Sample
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.compensate.supervisor import Status, Supervisor


class Unsupervised(Supervisor):
    """For replays alone: no limit, no ramp, no time-out, no judgement of what is measured."""

    def __init__(self, settings: Settings) -> None:
        """Answer from the first sample on."""
        super().__init__(settings)
        self._last_stamp = 0
        self.status, self.reason = Status.COMMANDING, "the bare model, for a replay"

    def command(self, sample: Sample, now: float, clock: int) -> Array | None:
        """Return the model's (n,) torque, N·m; see :meth:`Supervisor.command`."""
        if sample.stamp < self._last_stamp:
            raise DroppedSampleError("stamp_backwards", "stamp before the last one")
        self._last_stamp = sample.stamp
        return self._finite(self.settings.torque(sample.position, sample.velocity))

    def in_time(self, now: float) -> bool:
        """Every answer is sent, however late: nothing moves by it."""
        return True
