"""The first start of a model with a constant torque that nothing has settled: nothing may move.

A bias of the efforts and a hand that pushed through the recording look like a spring, and at the
start the measured effort has the same bias. Hands off, an arm that begins to move is pushed by its
model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.sample import Sample

# A joint moves, rad (Arm.scale), that has gone so far and goes on in that direction at MOVING, or
# has gone FAR. Chosen: more than encoders' steps (.003 rad) and noise, at half the speed that the
# dVRK console's own test of its compensation allows; starts of a simulated MTM move no joint by 2
# deg (test/test_start.py), drifts of a certified arm are less than .5 deg.
BEGUN, MOVING, FAR = 0.005, 0.1, 0.035
# s, under all of the torque, within which a joint that has not BEGUN to move stays. Chosen: of a
# tenth more torque than friction holds, a joint of an MTM has gone further.
STAYS = 1.0
# rad (Arm.scale), 5 deg: nearer than this to its limit a stop may hold a joint.
STOP = 0.087

WAY_OUT = "an effort bias? calibrate, or identify with --bias-is"


class ConstantCheck:
    """Watches the joints whose constant is in doubt until they have stayed where they are.

    One that is on its way, or at its stop, is watched on. Time counts where it passes for the arm,
    too: a simulated one may be slow, and has then not had the time to move.

    Attributes:
        constant: (n,) N·m or N; zero where none is in doubt.
    """

    def __init__(self, arm: Arm, constant: Array, position: Array) -> None:
        """Begin.

        Args:
            arm: The arm.
            constant: (n,) N·m or N.
            position: (n,) where it is released, rad or m.
        """
        self._arm, self.constant = arm, constant
        self._pushes, self._doubt = constant, constant != 0.0  # what is, or was, commanded
        self._at, self._mark = position, position.copy()
        self._last: tuple[int, float] | None = None  # stamp, ns, and arrival, s
        self._passed = 0.0
        self._until = np.full(arm.n, STAYS)
        self._lower, self._upper = arm.lower + STOP * arm.scale, arm.upper - STOP * arm.scale

    def change(self, constant: Array, position: Array) -> None:
        """Go on with another constant.

        Joints that were watched are so from where they were released, even if theirs is taken back:
        its torque fades.

        Args:
            constant: (n,) N·m or N.
            position: (n,) where other joints are watched from, rad or m.
        """
        if np.array_equal(constant, self.constant):
            return
        self.constant = constant
        self._pushes = np.where(constant != 0.0, constant, self._pushes)
        self._at = np.where(self._doubt, self._at, position)
        self._doubt = self._doubt | (constant != 0.0)
        self._until = np.full(self._arm.n, self._passed + STAYS)

    @property
    def finished(self) -> bool:
        """Whether all joints have stayed where they were released."""
        return not np.count_nonzero(self._doubt)

    def check(self, sample: Sample, velocity: Array, now: float, whole: NDArray[np.bool_]) -> str:
        """Return which joint the model moves, ``""``: none.

        Args:
            sample: The next one.
            velocity: (n,) rad/s or m/s.
            now: Monotonic time of its arrival, s.
            whole: (n,) joints to which the last command gave all of the model's torque.
        """
        position = sample.position
        stamp, before = self._last or (sample.stamp, now)
        self._passed += max(0.0, min(now - before, (sample.stamp - stamp) * 1e-9))
        self._last = sample.stamp, now
        moved = (position - self._at) / self._arm.scale
        along = moved * velocity > MOVING * np.abs(moved) * self._arm.scale
        size = np.abs(moved)
        begun = self._doubt & ((size > FAR) | ((size > BEGUN) & along))
        if np.count_nonzero(begun):
            worst = int(np.argmax(begun * size))
            joint = self._arm.joints[worst]
            return (
                f"the model pushes {joint.name} by {self._pushes[worst]:.2g} "
                f"{joint.effort_unit}, and hands off it moves: {WAY_OUT}"
            )
        on_its_way = np.abs(position - self._mark) > BEGUN * self._arm.scale
        self._mark[on_its_way] = position[on_its_way]
        watched = on_its_way | (position < self._lower) | (position > self._upper)
        self._until[watched | ~whole] = self._passed + STAYS
        self._doubt &= self._passed < self._until
        return ""
