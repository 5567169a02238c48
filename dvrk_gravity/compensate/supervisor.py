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

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.accepted import Accepted
from dvrk_gravity.compensate.input_gate import InputGate
from dvrk_gravity.compensate.limits import slew
from dvrk_gravity.compensate.passivity import PassivityObserver
from dvrk_gravity.compensate.ramp import Ramp
from dvrk_gravity.compensate.sample import CAUSES, DroppedSampleError, Sample
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.compensate.speed_guard import SpeedGuard
from dvrk_gravity.compensate.start import Start, StartRefusedError

BUILTIN_HELP = (
    "the arm's own gravity compensation is on and would add to ours: publish false (std_msgs/Bool) "
    "on use_gravity_compensation"
)
OR_BY_US = ", or set disable_builtin to true"


LEFT_OUT = "gravity is left out (gravity_enabled: false): what holds the arm fades out"


@dataclass(frozen=True)
class SupervisorSettings:
    """When it gives up, and what it tells.

    Attributes:
        shortest_step: Time between messages that counts at least, s: two at one time leave some
            way.
        longest_step: And at most, s: a longer one is a hiccup of the input, not time in which
            torque may run on.
        interruptions: So often the arm's own compensation may come on again while we command and
            may switch it off. Chosen: more often, somebody wants it on.
        outside: Beyond the arm's limits a position is told from here on, rad (``Arm.scale``), 5
            deg: encoders' zeros are off by less where an arm has been homed.
        cut: Less of a command that a limit takes is rounding, N·m or N.
        compared: So often changed parameters are compared with those of the last start, s: in it a
            joint at its fastest (``FASTEST``) goes 0.2 rad.
        longest_lag: So long a command may be far from what is asked for, s: as the guard of speed.
    """

    shortest_step: float = 1e-6
    longest_step: float = 0.02
    interruptions: int = 2
    outside: float = 0.087
    cut: float = 1e-9
    compared: float = 0.005
    longest_lag: float = 0.1


SETTINGS = SupervisorSettings()


class Status(Enum):
    """What the compensator is doing."""

    DISABLED = "disabled"
    WAITING = "waiting"
    STARTING = "starting"
    RAMPING = "ramping"
    COMMANDING = "commanding"
    FAULT = "fault"


class Supervisor:
    """Turns valid samples into commands while everything is well, and nothing otherwise.

    Times are seconds of a monotonic clock.

    Attributes:
        status: What it is doing.
        reason: Why, in words for a person.
        hold_due: A hold must be sent now; the node clears it when it has done so.
        dropped: Messages dropped, by cause.
        saturated: (n,) whether the last command was cut by a limit.
        origin: What the last start began with, in words; ``""`` before the first.
        change: What changes of parameters have done to the arm's support since the start, in words.
    """

    def __init__(self, settings: Settings) -> None:
        """Start in the state that the settings ask for; nothing is commanded yet."""
        names = settings.model.arm.joint_names
        self.settings = settings
        self.dropped: Counter[str] = Counter(dict.fromkeys(CAUSES, 0))
        self._uncut = np.zeros(len(names), dtype=bool)
        self._uncut.setflags(write=False)
        self.saturated: NDArray[np.bool_] = self._uncut
        self.hold_due = False
        self.origin = self.change = ""
        self._accepted = Accepted(settings)
        self._asked = True  # a person has asked for the next start
        self._changed = False  # since the last start was accepted
        self._compare_at, self._lagging_since = -np.inf, np.inf
        self._interruptions = 0  # by the arm's own compensation, since we were enabled
        self._obstacles: dict[str, str] = {}
        self._gate = InputGate(settings.model.arm)
        self._start: Start | None = None
        self._ramp: Ramp | None = None
        self._command: Array | None = None
        self._watch_energy()
        self._position = np.zeros(len(names))  # of the last command
        self._velocity: Array | None = None
        self._input_fault = False
        self.status = Status.DISABLED
        self.reason = "not enabled"
        if settings.enabled:
            self._wait()

    @property
    def active(self) -> bool:
        """Whether the arm is under our command."""
        return self._command is not None

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """(n,) joints whose velocity was not believed in the last sample."""
        return self._gate.doubtful

    @property
    def outside(self) -> NDArray[np.bool_]:
        """(n,) joints that are further than 5 deg (or 9 mm) outside the arm's limits."""
        arm, position = self.settings.model.arm, self._position
        slack = SETTINGS.outside * arm.scale
        return (position < arm.lower - slack) | (position > arm.upper + slack)

    @property
    def friction_held_back(self) -> NDArray[np.bool_]:
        """(n,) joints whose friction compensation may feed energy in, and is scaled down."""
        return self._passivity.factor < 1.0

    @property
    def begins_by_itself(self) -> bool:
        """Whether the arm, not under our command yet, will be as soon as all is well."""
        if self.status is Status.FAULT:
            return self._input_fault and self.settings.resume_automatically
        return self.status in (Status.WAITING, Status.STARTING)

    def enable(self) -> None:
        """Start, or start again after a fault; commands follow with the next valid input."""
        if not self.active:  # while it is commanded there is no start to ask for
            self._asked = True
        if self.status in (Status.DISABLED, Status.FAULT):
            self._interruptions = 0
            self._wait()

    def disable(self) -> None:
        """Stop commanding, with a hold if the arm was under our command."""
        self._stop(Status.DISABLED, "switched off")

    def fail(self, reason: str) -> None:
        """Stop commanding for an error of our own; only :meth:`enable` leads out of it."""
        self._input_fault = False
        self._stop(Status.FAULT, reason)

    @np.errstate(over="ignore", invalid="ignore")
    def configure(self, settings: Settings, now: float) -> None:
        """Take other settings; the torque goes to the new one by the ramp, without a jump."""
        before, self.settings = self.settings, settings
        self._changed = not settings.asks_as(self._accepted.settings)
        if self._command is not None and not self._deviates(self._position, now):
            self.change = self._accepted.change(settings, self._position)
            # What they know of the motion, a debt above all, stays: parameters may change often.
            self._passivity.limit(settings.friction_part, settings.allowance)
            self._guard.limit(settings.speed_limit)
            self.status, self.reason = Status.RAMPING, "blending to the changed settings' torque"
            try:
                self._begin_ramp(self._command, self._position, self._velocity, now)
            except ArithmeticError as error:
                self.fail(f"internal error: {error}")
        elif self._start is not None:
            self._wait()  # what has been collected belongs to the settings before
        if settings.enabled and not before.enabled:
            self.enable()
        elif before.enabled and not settings.enabled:
            self.disable()

    def obstruct(self, cause: str, reason: str, wait: bool = False) -> None:
        """Take note of something outside for which the arm must not be commanded.

        Args:
            cause: Short name of it.
            reason: Why, in words for a person; ``""``: it is gone.
            wait: An arm under our command is left only until it is gone.
        """
        if reason == self._obstacles.get(cause, "") and not (reason and self.active):
            return
        if reason:
            self._obstacles[cause] = reason
        else:
            self._obstacles.pop(cause, None)
        if self.active and reason:
            self._input_fault = False
            self._stop(Status.WAITING if wait else Status.FAULT, reason)
        elif self.status in (Status.WAITING, Status.STARTING):
            self._wait()

    @property
    def builtin_active(self) -> bool:
        """Whether the arm's own gravity compensation is on."""
        return "builtin" in self._obstacles

    def observe_builtin(self, effort: Array) -> bool:
        """Take a message of the arm's own gravity compensation; return whether to switch it off.

        Only where the arm is ours, or is about to be: it may carry the arm for somebody else.
        """
        on = bool(np.any(effort))  # NaN counts as on
        ours = self.active or self.begins_by_itself
        # Whoever switches it on again and again, after a start, is not to be fought.
        self._interruptions += on and not self.builtin_active and not self._asked
        wait = self.settings.disable_builtin and self._interruptions <= SETTINGS.interruptions
        help_ = BUILTIN_HELP if self.settings.disable_builtin else BUILTIN_HELP + OR_BY_US
        self.obstruct("builtin", help_ if on else "", wait)
        return on and wait and ours

    def check_input(self, now: float) -> None:
        """Notice that valid input has stopped; to be called a few times within the timeout."""
        if not self.active and self._start is None:
            return
        silence = self._gate.silence(now, self.settings.timeout)
        if silence and self.active:
            self._input_fault = True
            self._stop(Status.FAULT, silence)
        elif silence:
            self._wait()

    def in_time(self, now: float) -> bool:
        """Tell whether the command that was just computed may still be sent.

        The process may have stood still since its input came: what is late by now is no answer.
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

        Args:
            sample: The sample.
            now: Monotonic time at which it came, s.
            clock: The node's clock, ns, to which stamps are compared.

        Raises:
            DroppedSampleError: Its stamp, or where it says that the arm is, disqualifies it.
        """
        self.check_input(now)
        settings = self.settings
        sample, step, gap = self._gate.admit(
            sample, now, clock, settings.timeout, settings.max_stamp_age, self.active
        )
        if self.status is Status.FAULT and self._input_fault:
            if gap > settings.timeout:
                raise DroppedSampleError("after_gap", "first message after a gap")
            if settings.resume_automatically:
                self._wait()
        try:
            if self.status is Status.WAITING and not self._obstacles:
                self._start = Start(now, settings.model.arm)
                self.status, self.reason = Status.STARTING, "measuring what holds the arm"
            if self._start is not None:
                self._collect(self._start, sample, now)
            if not self.active:
                return None
            return self._follow(sample, now, step)
        except (ArithmeticError, ValueError, TypeError) as error:
            self.fail(f"internal error: {error}")
            return None

    def _collect(self, start: Start, sample: Sample, now: float) -> None:
        """Begin, once there are enough samples, with the effort that holds the arm."""
        settings = self.settings
        start.add(sample, self._finite(settings.torque(sample.position, None)), now)
        if not start.complete(now):
            return
        try:
            self._command, self.origin = self._accepted.origin(
                start, settings, sample.position, self._asked
            )
        except StartRefusedError as error:
            self.fail(str(error))
            return
        self._start = None
        # Else nothing has been compared, nor confirmed: small changes do not add up.
        if self._asked or settings.weightless or start.measures():
            self._accepted = Accepted(settings)
        self._asked = False
        self._changed = not settings.asks_as(self._accepted.settings)
        self.change = LEFT_OUT if settings.weightless else ""
        self._watch_energy()
        self._begin_ramp(self._command, sample.position, sample.velocity, now)
        self.status, self.reason = Status.RAMPING, "blending to the model's torque"

    def _begin_ramp(
        self, command: Array, position: Array, velocity: Array | None, now: float
    ) -> None:
        """Begin with a command at (n,) positions and velocities, rad and rad/s."""
        settings = self.settings
        conservative, friction = settings.parts(position, velocity)
        torque = self._finite(conservative + friction * self._passivity.factor)
        self._ramp = Ramp(command, settings.limits.clip(torque), now, settings)

    def _watch_energy(self) -> None:
        """Know nothing of the arm's motion until now."""
        settings, arm = self.settings, self.settings.model.arm
        self._passivity = PassivityObserver(
            settings.friction_part, settings.allowance, settings.limits.coupled, arm.scale
        )
        self._guard = SpeedGuard(arm.joint_names, settings.speed_limit, arm.units)

    def _finite(self, torque: Array) -> Array:
        """Return (n,) torques of the model, N·m, if they are numbers."""
        finite = np.isfinite(torque)
        if not finite.all():
            joint = self.settings.model.arm.joint_names[int(np.argmin(finite))]
            raise ArithmeticError(f"the model's torque on {joint} is not a finite number")
        return torque

    def _follow(self, sample: Sample, now: float, step: float) -> Array | None:
        settings = self.settings
        previous = self._command
        assert previous is not None  # set by _collect, before anything is active
        runaway = self._guard.check(self._gate.velocity, previous, now)
        if runaway:
            self.fail(runaway)
            return None
        if self._changed and now >= self._compare_at and self._deviates(sample.position, now):
            return None
        conservative, friction = settings.parts(sample.position, sample.velocity)
        # Of friction no more than is passive.
        factor = self._passivity.update(sample.velocity, friction, now)
        target = conservative + friction * factor
        within = settings.limits.clip(target)
        if within is not target:  # what is within the limits as it is, is finite, too
            self._finite(target)
        self.saturated = self._uncut if within is target else np.abs(within - target) > SETTINGS.cut
        if self._ramp is not None:
            within = self._ramp.blend(within, now, settings)
            if self._ramp.over:
                self._ramp = None
                self.status, self.reason = Status.COMMANDING, "compensating"
        step = min(max(step, SETTINGS.shortest_step), SETTINGS.longest_step)
        largest = settings.slew_limit * step
        self._command = slew(previous, within, largest, settings.limits)
        if self._command is not within and self._lags(within, self._command, now):
            return None
        self._position, self._velocity = sample.position, sample.velocity
        return self._command

    def _deviates(self, position: Array, now: float) -> bool:
        """Hold an arm for which changed parameters ask for what no start has compared."""
        self._compare_at = now + SETTINGS.compared
        deviation = self._accepted.deviation(self.settings, position)
        if deviation is None:
            return False
        if deviation.measurable:
            more = "the arm is held, and what holds it is measured anew"
            self._stop(Status.WAITING, f"{deviation.reason}: {more}")
        else:
            self.fail(f"{deviation.reason}: ~/enable takes it as it is")
        return True

    def _lags(self, asked: Array, command: Array, now: float) -> bool:
        """Hold an arm whose command ``slew_limit`` keeps from what is asked for too long."""
        lag = np.abs(asked - command) / self.settings.model.arm.effort_limit
        worst = int(np.argmax(lag))
        if lag[worst] <= self.settings.start_tolerance:
            self._lagging_since = np.inf
            return False
        self._lagging_since = min(self._lagging_since, now)
        if now - self._lagging_since < SETTINGS.longest_lag:
            return False
        joint = self.settings.model.arm.joints[worst]
        self.fail(
            f"{joint.name} is commanded {command[worst]:.3g} {joint.effort_unit} where "
            f"{asked[worst]:.3g} are asked for: slew_limit is too small for how the arm moves"
        )
        return True

    def _wait(self) -> None:
        self._start = None
        self.status = Status.WAITING
        self.reason = next(iter(self._obstacles.values()), "waiting for valid measured_js")

    def _stop(self, status: Status, reason: str) -> None:
        self.hold_due = self.hold_due or self.active
        self.status, self.reason = status, reason
        self._start = self._ramp = None
        self._command = None
        self.saturated = self._uncut
