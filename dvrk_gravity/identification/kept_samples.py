"""What an identification keeps of its recordings beside the model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.identification.motion import CalibrationMotion
from dvrk_gravity.model import CalibrationSamples


def kept_samples(parts: Sequence[CalibrationMotion], arm: Arm) -> CalibrationSamples | None:
    """Return the first samples of which all is known; ``None`` if there are none.

    Parts that lack a motor's torque for a while or altogether, or were recorded at another rate
    than the first, are left out: there would be nothing to see of the model's error there.
    """
    whole = [part for part in parts if part.measured.all() and part.told.all()]
    if not whole:
        return None
    rate = whole[0].filter.rate

    def arrays() -> Iterator[tuple[Array, ...]]:
        for part in whole:
            if part.filter.rate == rate:
                q, qd, qdd = part.state.q, part.state.qd, part.state.qdd
                assert qd is not None
                assert qdd is not None
                yield q, qd, qdd, arm.joint_effort(part.effort)

    return CalibrationSamples.of(arrays(), rate)
