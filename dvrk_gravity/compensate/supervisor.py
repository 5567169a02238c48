"""When to command and when to hold: the compensator's state machine, without ROS.

The arm keeps the last effort for ever. Whatever ends commanding, therefore,
ends in a `hold`: :attr:`Supervisor.hold_due` asks the node for it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.compensate.limits import slew
from dvrk_gravity.compensate.sample import CAUSES, DroppedSampleError, Sample
from dvrk_gravity.compensate.settings import Settings

Array = NDArray[np.float64]

BUILTIN_HELP = (
    "the arm's own gravity compensation is on and would add to ours: publish false (std_msgs/Bool) "
    "on use_gravity_compensation, or set disable_builtin to true"
)
# A longer step than this is a hiccup of the input, not time in which torque may run on; two
# messages at one time still leave a slew limit that is off (infinite) without effect.
_SHORTEST_STEP, _LONGEST_STEP = 1e-6, 0.02
# N·m; less than this is rounding, not a limit.
_CUT = 1e-9
_NONE = np.zeros(N_JOINTS, dtype=bool)
_NONE.setflags(write=False)


class Status(Enum):
    """What the compensator is doing."""

    DISABLED = "disabled"
    WAITING = "waiting"
    RAMPING = "ramping"
    COMMANDING = "commanding"
    FAULT = "fault"


@dataclass
class _Ramp:
    """Blend from the effort that was there to the model's.

    What fades out is the difference between the two, so that the command follows the
    model's torque from the beginning where the arm is moved during the ramp.
    """

    start: float
    difference: Array | None = None  # (7,) N·m, of the first sample after the start


class Supervisor:
    """Turns valid samples into commands while everything is well, and nothing otherwise.

    Times are seconds of a monotonic clock: a step of the wall clock or of
    simulated time neither hides stale input nor makes fresh input look stale.

    Attributes:
        status: What it is doing.
        reason: Why, in words for a person.
        hold_due: A hold must be sent now; the node clears it when it has done so.
        dropped: Messages dropped, by cause.
        saturated: (7,) whether the last command was cut by a limit.
    """

    def __init__(self, settings: Settings) -> None:
        """Start in the state that the settings ask for; nothing is commanded yet."""
        self.settings = settings
        self.dropped: Counter[str] = Counter(dict.fromkeys(CAUSES, 0))
        self.saturated: NDArray[np.bool_] = _NONE
        self.hold_due = False
        self.builtin_active = False
        self._ramp: _Ramp | None = None
        self._command: Array | None = None
        self._last_valid = -np.inf  # when the last valid sample came
        self._last_advance = -np.inf  # when the stamp last moved on
        self._last_stamp = 0
        self._seen_stamp = 0  # of the last message, whether its stamp passed or not
        self._input_fault = False
        self.status = Status.DISABLED
        self.reason = "not enabled"
        if settings.enabled:
            self._wait()

    @property
    def active(self) -> bool:
        """Whether the arm is under our command."""
        return self._command is not None

    def enable(self) -> None:
        """Start, or start again after a fault; commands follow with the next valid input."""
        if self.status in (Status.DISABLED, Status.FAULT):
            self._wait()

    def disable(self) -> None:
        """Stop commanding, with a hold if the arm was under our command."""
        self._stop(Status.DISABLED, "switched off")

    def fail(self, reason: str) -> None:
        """Stop commanding for an error of our own; only :meth:`enable` leads out of it."""
        self._input_fault = False
        self._stop(Status.FAULT, reason)

    def configure(self, settings: Settings, now: float) -> None:
        """Take other settings; the torque goes to the new one by the ramp, without a jump."""
        was_enabled = self.settings.enabled
        self.settings = settings
        if self._command is not None and self.active:
            self._ramp = _Ramp(now)
            self.status, self.reason = Status.RAMPING, "blending to the changed settings' torque"
        if settings.enabled and not was_enabled:
            self.enable()
        elif was_enabled and not settings.enabled:
            self.disable()

    def observe_builtin(self, effort: Array) -> None:
        """Take a message of the arm's own gravity compensation."""
        self.builtin_active = bool(np.any(effort))  # NaN counts as active
        if self.builtin_active and self.active:
            if self.settings.disable_builtin:
                self._stop(Status.WAITING, BUILTIN_HELP)
            else:
                self._input_fault = False
                self._stop(Status.FAULT, BUILTIN_HELP)
        elif self.status is Status.WAITING:
            self._wait()

    def check_input(self, now: float) -> None:
        """Notice that valid input has stopped; to be called a few times within the timeout."""
        if not self.active:
            return
        limit = self.settings.timeout
        if now - self._last_valid > limit:
            self._input_lost(f"no valid measured_js for {limit:g} s")
        elif now - self._last_advance > limit:
            self._input_lost(f"the stamp of measured_js has not moved for {limit:g} s")

    def drop(self, error: DroppedSampleError) -> None:
        """Count a message that gives no command."""
        self.dropped[error.cause] += 1

    def command(self, sample: Sample, now: float, clock: int) -> Array | None:
        """Return the (7,) effort that answers a valid sample, ``None`` if there is none.

        Args:
            sample: The sample.
            now: Monotonic time at which it came, s.
            clock: The node's clock, ns, to which stamps may be compared.

        Raises:
            DroppedSampleError: Its stamp disqualifies it.
        """
        self.check_input(now)
        # Not since the last message: one that repeats a stamp brings nothing new.
        gap = now - self._last_advance
        known, self._seen_stamp = (self._last_stamp, self._seen_stamp), sample.stamp
        self._check_stamp(sample.stamp, now, clock)
        # Times count for messages that pass; a message that waited in a queue while the
        # process or the arm stood still is the first after a gap, and is not answered.
        previous_valid, self._last_valid = self._last_valid, now
        if sample.stamp not in known:
            self._last_advance = now
        elif now - self._last_advance > self.settings.timeout:
            raise DroppedSampleError("stamp_repeated", "the stamp does not move on")
        self._last_stamp = sample.stamp
        if self.status is Status.FAULT and self._input_fault:
            if gap > self.settings.timeout:
                raise DroppedSampleError("after_gap", "first message after a gap")
            if self.settings.resume_automatically:
                self._wait()
        if self.status is Status.WAITING and not self.builtin_active:
            self._begin(sample, now)
        if not self.active:
            return None
        try:
            return self._follow(sample, now, now - previous_valid)
        except (ArithmeticError, ValueError, TypeError) as error:
            self.fail(f"internal error: {error}")
            return None

    def _check_stamp(self, stamp: int, now: float, clock: int) -> None:
        if stamp < self._last_stamp:
            # Once nothing valid has come for long, the clock has been stepped for good.
            stepped = not self.active and now - self._last_valid > self.settings.timeout
            if not stepped:
                late = (self._last_stamp - stamp) * 1e-9
                raise DroppedSampleError(
                    "stamp_backwards", f"stamp {late:.3f} s before the last one"
                )
        oldest = self.settings.max_stamp_age
        if oldest > 0.0 and clock - stamp > oldest * 1e9:
            age = (clock - stamp) * 1e-9
            raise DroppedSampleError(
                "stamp_too_old", f"stamp {age:.3f} s old, at most {oldest:g} s"
            )

    def _begin(self, sample: Sample, now: float) -> None:
        """Start from the effort that holds the arm now, so that it does not drop."""
        origin = np.zeros_like(sample.position) if sample.effort is None else sample.effort
        with np.errstate(over="ignore", invalid="ignore"):
            self._command = self.settings.limits.clip(origin)
        self._ramp = _Ramp(now)
        self.status, self.reason = Status.RAMPING, "blending to the model's torque"

    def _follow(self, sample: Sample, now: float, step: float) -> Array:
        settings = self.settings
        with np.errstate(over="ignore", invalid="ignore"):
            target = settings.torque(sample.position, sample.velocity)
            within = settings.limits.clip(target)
        self.saturated = _NONE
        if within is not target:  # what is within the limits as it is, is finite, too
            if not np.isfinite(target).all():
                joint = settings.model.arm.joint_names[int(np.argmin(np.isfinite(target)))]
                raise ArithmeticError(f"the model's torque on {joint} is not a finite number")
            self.saturated = np.abs(within - target) > _CUT
        previous = self._command
        assert previous is not None  # set by _begin, before anything is active
        if self._ramp is not None:
            within = settings.limits.clip(self._blend(self._ramp, previous, within, now))
        if not _SHORTEST_STEP <= step <= _LONGEST_STEP:
            step = _SHORTEST_STEP if step < _SHORTEST_STEP else _LONGEST_STEP
        largest = settings.slew_limit * step
        self._command = slew(previous, within, largest, settings.limits)
        return self._command

    def _blend(self, ramp: _Ramp, previous: Array, target: Array, now: float) -> Array:
        """Return the torque on the way to ``target``, which is reached when the ramp ends."""
        if ramp.difference is None:
            ramp.difference = previous - target
        ramp_time = self.settings.ramp_time
        over = ramp_time <= 0.0 or now - ramp.start >= ramp_time
        if over or (np.abs(ramp.difference) <= _CUT).all():
            self._ramp = None
            self.status, self.reason = Status.COMMANDING, "compensating"
            return target
        return target + (1.0 - (now - ramp.start) / ramp_time) * ramp.difference

    def _wait(self) -> None:
        self.status = Status.WAITING
        self.reason = BUILTIN_HELP if self.builtin_active else "waiting for valid measured_js"

    def _input_lost(self, reason: str) -> None:
        self._input_fault = True
        self._stop(Status.FAULT, reason)

    def _stop(self, status: Status, reason: str) -> None:
        self.hold_due = self.hold_due or self.active
        self.status, self.reason = status, reason
        self._ramp = None
        self._command = None
        self.saturated = _NONE
