"""When to command and when to hold: the compensator's state machine, without ROS.

The arm keeps the last effort for ever. Whatever ends commanding therefore ends in a `hold`, which
:attr:`Supervisor.hold_due` requests from the node.
"""

from __future__ import annotations

from collections import Counter
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.compensation import Compensation
from dvrk_gravity.compensate.input_gate import InputGate
from dvrk_gravity.compensate.sample import CAUSES, DroppedSampleError, Sample
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.compensate.start import CommandRefusedError, Start, changed_support, deviation

BUILTIN_HELP = (
    "the arm's own gravity compensation is on and would add to ours: publish false (std_msgs/Bool) "
    "on use_gravity_compensation"
)
OR_BY_US = ", or set disable_builtin to true"
LEFT_OUT = "gravity is not compensated (gravity_enabled: false): the holding effort fades out"
IF_BUSY = "if this computer is busy, raise timeout"

# So often the arm's own compensation may come on again while we command and may switch it off.
# Chosen: more often, somebody wants it on.
INTERRUPTIONS = 2
# So often changed parameters are compared with those of the last start, s: in it a joint at its
# fastest (FASTEST) goes 0.2 rad.
COMPARED = 0.005


class Status(Enum):
    """What the compensator is doing."""

    DISABLED = "disabled"
    WAITING = "waiting"
    STARTING = "starting"
    RAMPING = "ramping"
    COMMANDING = "commanding"
    FAULT = "fault"


class Supervisor:
    """Answers valid samples with commands while nothing speaks against it.

    Times are seconds of a monotonic clock.

    Attributes:
        settings: The parameters in force.
        compensation: Of an arm under our command; ``None``: the arm is not.
        hold_due: A hold must be sent now; the node clears it after sending one.
        dropped: Messages dropped, by cause.
        origin: Source of the first command of the last start, in words; ``""`` before the first.
        change: How changed parameters have changed the arm's support since the start, in words.
        busy_advice: What a person can do on a busy computer; ``""``: as with an arm.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.dropped: Counter[str] = Counter(dict.fromkeys(CAUSES, 0))
        self.compensation: Compensation | None = None
        self.hold_due = False
        self.origin = self.change = self.busy_advice = ""
        self._accepted = settings  # by the last start
        self._asked = True  # a person has asked for the next start
        self._compare_at = -np.inf
        self._interruptions = 0  # by the arm's own compensation, since we were enabled
        self._obstacles: dict[str, str] = {}
        self._gate = InputGate(settings.model.arm)
        self._start: Start | None = None
        self._constant_stayed = np.zeros(settings.model.arm.n)  # that the arm was seen to feel
        # Of an arm that is not under our command.
        self._status, self._reason = Status.DISABLED, "not enabled"
        self._input_fault = False
        if settings.enabled:
            self._wait()

    @property
    def active(self) -> bool:
        """Whether the arm is under our command."""
        return self.compensation is not None

    @property
    def status(self) -> Status:
        """What it is doing."""
        if self.compensation is None:
            return self._status
        return Status.RAMPING if self.compensation.ramping else Status.COMMANDING

    @property
    def reason(self) -> str:
        """Why, in words for a person."""
        return self._reason if self.compensation is None else self.compensation.reason

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """(n,) joints whose reported velocity was not believed in the last sample."""
        return self._gate.motion.doubtful

    @property
    def starts_automatically(self) -> bool:
        """Whether commanding starts without ~/enable as soon as nothing speaks against it."""
        if self.status is Status.FAULT:
            return self._input_fault and self.settings.resume_automatically
        return self.status in (Status.WAITING, Status.STARTING)

    def enable(self) -> None:
        """Start, or start again after a fault; commands follow with the next valid input."""
        if not self.active:  # else there is no start to ask for
            self._asked = True
        if self.status in (Status.DISABLED, Status.FAULT):
            self._interruptions = 0
            self._wait()

    def disable(self) -> None:
        """Stop commanding, with a hold if the arm was under our command."""
        self._stop(Status.DISABLED, "switched off")

    def fail(self, reason: str) -> None:
        """Stop commanding, for a reason that only :meth:`enable` clears."""
        self._stop(Status.FAULT, reason)

    @np.errstate(over="ignore", invalid="ignore")
    def configure(self, settings: Settings, now: float) -> None:
        """Replace the settings; the torque goes to the new one by the ramp, without a jump."""
        before, self.settings = self.settings, settings
        compensation = self.compensation
        if compensation is not None and not self._deviates(compensation.sample.position, now):
            self.change = changed_support(self._accepted, settings, compensation.sample.position)
            try:
                compensation.configure(settings, now)
            except ArithmeticError as error:
                self.fail(f"internal error: {error}")
        elif self._start is not None:
            self._wait()  # the samples collected so far belong to the previous settings
        if settings.enabled and not before.enabled:
            self.enable()
        elif before.enabled and not settings.enabled:
            self.disable()

    def obstruct(self, cause: str, reason: str, wait: bool = False) -> None:
        """Note an outside reason not to command the arm.

        Args:
            cause: Its short name.
            reason: In words for a person; ``""``: it is gone.
            wait: An arm under our command is left only until it is gone.
        """
        if reason == self._obstacles.get(cause, "") and not (reason and self.active):
            return
        if reason:
            self._obstacles[cause] = reason
        else:
            self._obstacles.pop(cause, None)
        if self.active and reason:
            self._stop(Status.WAITING if wait else Status.FAULT, reason)
        elif self.status in (Status.WAITING, Status.STARTING):
            self._wait()

    @property
    def builtin_active(self) -> bool:
        """Whether the arm's own gravity compensation is on."""
        return "builtin" in self._obstacles

    def observe_builtin(self, effort: Array) -> bool:
        """Note the (n,) efforts of the arm's own compensation; return whether to switch it off.

        Only where we command the arm, or are about to: it may carry the arm for somebody else.
        """
        on = bool(np.any(effort))  # NaN counts as on
        ours = self.active or self.starts_automatically
        # We do not fight a person who switches it on again and again after a start.
        self._interruptions += on and not self.builtin_active and not self._asked
        wait = self.settings.disable_builtin and self._interruptions <= INTERRUPTIONS
        help_ = BUILTIN_HELP if self.settings.disable_builtin else BUILTIN_HELP + OR_BY_US
        self.obstruct("builtin", help_ if on else "", wait)
        return on and wait and ours

    def check_input(self, now: float) -> None:
        """Stop if valid input has stopped; to be called a few times within the timeout."""
        if not self.active and self._start is None:
            return
        silence = self._gate.silence(now, self.settings.timeout)
        if silence and self.active:
            words = f"{silence}; {self.busy_advice or IF_BUSY}"
            self._stop(Status.FAULT, words, by_input=True)
        elif silence:
            self._wait()

    def in_time(self, now: float) -> bool:
        """Return whether the command just computed may still be sent.

        The process may have stood still since its input came: a late command is no answer.
        """
        self.check_input(now)
        return self.active

    def drop(self, error: DroppedSampleError) -> None:
        """Count a message that gives no command."""
        self.dropped[error.cause] += 1

    # Readings near the largest number there is are judged like all others.
    @np.errstate(over="ignore", invalid="ignore")
    def command(self, sample: Sample, now: float, clock: int) -> Array | None:
        """Return the (n,) effort that answers a valid sample, ``None`` if there is none.

        ``now`` is the monotonic time of its arrival, s, ``clock`` the node's clock, ns.

        Raises:
            DroppedSampleError: Its stamp or its positions disqualify it.
        """
        self.check_input(now)
        settings, motion = self.settings, self._gate.motion
        stopped_by_input = self._input_fault and self.status is Status.FAULT
        after_gap = stopped_by_input and self._gate.silence(now, settings.timeout)
        sample = self._gate.admit(
            sample, now, clock, settings.timeout, settings.max_stamp_age, self.active
        )
        if after_gap:
            raise DroppedSampleError("after_gap", "first message after a gap")
        if stopped_by_input and settings.resume_automatically:
            self._wait()
        if motion.contradiction and (self.active or self._start is not None):
            self.fail(motion.contradiction)
            return None
        try:
            if self.compensation is None:
                self._go_on_with_start(sample, now)
            if self.compensation is None:
                return None
            self.compensation.require_control(sample, motion.velocity, now)
            due = self.settings is not self._accepted and now >= self._compare_at
            if due and self._deviates(sample.position, now):
                return None
            return self.compensation.follow(sample, now, self._gate.step)
        except CommandRefusedError as error:
            self.fail(str(error))
        except (ArithmeticError, ValueError, TypeError) as error:
            self.fail(f"internal error: {error}")
        return None

    def _go_on_with_start(self, sample: Sample, now: float) -> None:
        """Begin, with enough samples, with the effort that holds the arm."""
        settings = self.settings
        if self.status is Status.WAITING and not self._obstacles:
            self._start = Start(settings, now)
            self._status, self._reason = Status.STARTING, "measuring the holding effort"
        start = self._start
        if start is None:
            return
        start.add(sample, now)
        if not start.complete(now):
            return
        first, self.origin = start.origin(None if self._asked else self._accepted)
        # Else nothing was compared or confirmed: small changes must not add up.
        if self._asked or settings.weightless or start.has_efforts():
            self._accepted = settings
        self.change = LEFT_OUT if settings.weightless else ""
        self.compensation = Compensation(settings, first, sample, now, self._constant_stayed)
        self._start, self._asked = None, False

    def _deviates(self, position: Array, now: float) -> bool:
        """Hold the arm if changed parameters command torque that no start has compared."""
        self._compare_at = now + COMPARED
        found = deviation(self._accepted, self.settings, position)
        if found is None:
            return False
        if found.measurable:
            more = "the arm is held while the effort is measured again"
            self._stop(Status.WAITING, f"{found.reason}; {more}")
        else:
            self.fail(f"{found.reason}; ~/enable accepts it")
        return True

    def _wait(self) -> None:
        self._start = None
        self._status = Status.WAITING
        self._reason = next(iter(self._obstacles.values()), "waiting for valid measured_js")

    def _stop(self, status: Status, reason: str, by_input: bool = False) -> None:
        if self.compensation is not None:
            self.hold_due = True
            self._constant_stayed = self.compensation.stayed
        self._start = self.compensation = None
        self._status, self._reason, self._input_fault = status, reason, by_input
