"""An arm under command: the effort that answers a sample, from a start's first one to the hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.constant_check import ConstantCheck
from dvrk_gravity.compensate.limits import Ramp, slew
from dvrk_gravity.compensate.passivity import PassivityObserver
from dvrk_gravity.compensate.sample import Sample
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.compensate.speed_guard import SpeedGuard
from dvrk_gravity.compensate.start import CommandRefusedError

HANDS_OFF = "hands off, until its constant torque is seen to move no joint"

# Time between messages counts within these, s: two at one time leave some way; a longer one is a
# hiccup of the input, not time in which torque may run on.
SHORTEST_STEP, LONGEST_STEP = 1e-6, 0.02
# Positions further outside the arm's limits are reported, rad (Arm.scale), 5 deg: encoders' zeros
# are off by less where an arm has been homed.
OUTSIDE = 0.087
# Less of a command that a limit takes is rounding, N·m or N.
CUT = 1e-9
# So long a command may be far from the wanted one, s: as the guard of speed.
LONGEST_LAG = 0.1


class Compensation:
    """Commands the model's torque within all limits, and refuses where the arm runs away.

    Where it begins, and where parameters change, the torque goes to the wanted one by a ramp,
    without a jump.

    Attributes:
        command: (n,) the last effort, N·m or N.
        sample: The last one that was answered.
        stayed: (n,) the constant torque in doubt that the arm was seen to feel, N·m or N.
    """

    def __init__(
        self, settings: Settings, first: Array, sample: Sample, now: float, stayed: Array
    ) -> None:
        """Begin with a (n,) first effort at a sample; ``stayed`` by the last compensation.

        Raises:
            ArithmeticError: A torque that is not finite.
        """
        arm = settings.model.arm
        self.command, self.sample, self.stayed = first, sample, stayed
        self._settings = settings
        self._passivity = PassivityObserver(
            settings.friction_part, settings.allowance, settings.limits.coupled, arm.scale
        )
        self._guard = SpeedGuard(arm, settings.speed_limit)
        self._check: ConstantCheck | None = None
        self._lagging_since = np.inf
        # Of the last command: what is wanted, and that within the limits.
        self._wanted = self._within = np.zeros(arm.n)
        self._blend("the model's torque", now)

    def configure(self, settings: Settings, now: float) -> None:
        """Replace the settings.

        Raises:
            ArithmeticError: A torque that is not finite.
        """
        self._settings = settings
        # Their history, a debt above all, stays: parameters may change often.
        self._passivity.limit(settings.friction_part, settings.allowance)
        self._guard.limit(settings.speed_limit)
        self._blend("the changed parameters' torque", now)

    def _blend(self, what: str, now: float) -> None:
        """Begin a ramp, and watch joints with a constant in doubt if it is another one."""
        model, sample = self._settings.model, self.sample
        conservative, friction = self._settings.parts(sample.position, sample.velocity)
        wanted = self._settings.finite(conservative + friction * self._passivity.factor)
        within = self._settings.limits.clip(wanted)
        self._blending = f"blending to {what}"
        self._ramp: Ramp | None = Ramp(
            self.command, within, now, self._settings.ramp_time, model.arm
        )
        if self._check is not None:
            self._check.change(model.constant, sample.position)
        elif model.constant.any() and not np.array_equal(self.stayed, model.constant):
            self._check = ConstantCheck(model.arm, model.constant, sample.position)

    @property
    def ramping(self) -> bool:
        """Whether the torque is still on its way to the wanted one."""
        return self._ramp is not None

    @property
    def reason(self) -> str:
        """What it is doing, in words for a person."""
        words = "compensating" if self._ramp is None else self._blending
        return words if self._check is None else f"{words}; {HANDS_OFF}"

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """(n,) whether a limit cut the last command."""
        return np.asarray(np.abs(self._within - self._wanted) > CUT)

    @property
    def outside(self) -> NDArray[np.bool_]:
        """(n,) joints further than 5 deg (or 9 mm) outside the arm's limits."""
        arm, position = self._settings.model.arm, self.sample.position
        slack = OUTSIDE * arm.scale
        return (position < arm.lower - slack) | (position > arm.upper + slack)

    @property
    def friction_held_back(self) -> NDArray[np.bool_]:
        """(n,) joints whose friction compensation may feed energy in, and is scaled down."""
        return self._passivity.factor < 1.0

    def require_control(self, sample: Sample, velocity: Array, now: float) -> None:
        """Refuse to go on with an arm that does not move as one under compensation does.

        Args:
            sample: The next one.
            velocity: (n,) at it, rad/s or m/s.
            now: Monotonic time of its arrival, s.

        Raises:
            CommandRefusedError: The last commands drive a joint.
        """
        driven = self._guard.check(velocity, self.command, now)
        if not driven and self._check is not None:
            whole = ~self.saturated & (self._ramp is None and self.command is self._within)
            driven = self._check.check(sample, velocity, now, whole)
            if self._check.finished:
                self.stayed, self._check = self._check.constant, None
        if driven:
            raise CommandRefusedError(driven)

    def follow(self, sample: Sample, now: float, step: float) -> Array:
        """Return the (n,) effort that answers a sample, N·m or N.

        ``step`` is the time since the message before it, s.

        Raises:
            CommandRefusedError: The command stays behind the wanted torque.
            ArithmeticError: A torque that is not finite.
        """
        settings = self._settings
        conservative, friction = settings.parts(sample.position, sample.velocity)
        # Of friction no more than is passive.
        factor = self._passivity.update(sample.velocity, friction, now)
        self._wanted = conservative + friction * factor
        self._within = goal = settings.limits.clip(self._wanted)
        if goal is not self._wanted:  # torques within the limits are finite
            settings.finite(self._wanted)
        if self._ramp is not None:
            goal = self._ramp.blend(goal, now, settings.limits)
            if self._ramp.over:
                self._ramp = None
        largest = settings.slew_limit * min(max(step, SHORTEST_STEP), LONGEST_STEP)
        self.command = slew(self.command, goal, largest, settings.limits)
        if self.command is goal:
            self._lagging_since = np.inf
        else:
            self._require_no_lag(goal, now)
        self.sample = sample
        return self.command

    def _require_no_lag(self, goal: Array, now: float) -> None:
        """Refuse to go on where ``slew_limit`` keeps the command too far behind for too long."""
        arm = self._settings.model.arm
        lag = np.abs(goal - self.command) / arm.effort_limit
        worst = int(np.argmax(lag))
        if lag[worst] <= self._settings.start_tolerance:
            self._lagging_since = np.inf
            return
        self._lagging_since = min(self._lagging_since, now)
        if now - self._lagging_since >= LONGEST_LAG:
            joint = arm.joints[worst]
            raise CommandRefusedError(
                f"the command of {joint.name} lags: {self.command[worst]:.3g} of "
                f"{goal[worst]:.3g} {joint.effort_unit}; slew_limit is too small for this motion"
            )
