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
from dvrk_gravity.compensate.constant_check import ConstantCheck
from dvrk_gravity.compensate.input_gate import InputGate
from dvrk_gravity.compensate.limits import Ramp, slew
from dvrk_gravity.compensate.passivity import PassivityObserver
from dvrk_gravity.compensate.sample import CAUSES, DroppedSampleError, Sample
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.compensate.speed_guard import SpeedGuard
from dvrk_gravity.compensate.start import AcceptedParameters, Start, StartRefusedError

BUILTIN_HELP = (
    "the arm's own gravity compensation is on and would add to ours: publish false (std_msgs/Bool) "
    "on use_gravity_compensation"
)
OR_BY_US = ", or set disable_builtin to true"
LEFT_OUT = "gravity is not compensated (gravity_enabled: false): the holding effort fades out"
HANDS_OFF = "hands off, until its constant torque is seen to move no joint"

# Time between messages counts within these, s: two at one time leave some way; a longer one is a
# hiccup of the input, not time in which torque may run on.
SHORTEST_STEP, LONGEST_STEP = 1e-6, 0.02
# So often the arm's own compensation may come on again while we command and may switch it off.
# Chosen: more often, somebody wants it on.
INTERRUPTIONS = 2
# Positions further outside the arm's limits are reported, rad (Arm.scale), 5 deg: encoders' zeros
# are off by less where an arm has been homed.
OUTSIDE = 0.087
# Less of a command that a limit takes is rounding, N·m or N.
CUT = 1e-9
# So often changed parameters are compared with those of the last start, s: in it a joint at its
# fastest (FASTEST) goes 0.2 rad.
COMPARED = 0.005
# So long a command may be far from the wanted one, s: as the guard of speed.
LONGEST_LAG = 0.1


class Status(Enum):
    """What the compensator is doing."""

    DISABLED = "disabled"
    WAITING = "waiting"
    STARTING = "starting"
    RAMPING = "ramping"
    COMMANDING = "commanding"
    FAULT = "fault"


IF_BUSY = "if this computer is busy, raise timeout"


class Supervisor:
    """Answers valid samples with commands while nothing speaks against it.

    Times are seconds of a monotonic clock.

    Attributes:
        status: What it is doing.
        reason: Why, in words for a person.
        hold_due: A hold must be sent now; the node clears it after sending one.
        dropped: Messages dropped, by cause.
        saturated: (n,) whether a limit cut the last command.
        origin: Source of the first command of the last start, in words; ``""`` before the first.
        change: How changed parameters have changed the arm's support since the start, in words.
        busy_advice: What a person can do on a busy computer; ``""``: as with an arm.
    """

    def __init__(self, settings: Settings) -> None:
        names = settings.model.arm.joint_names
        self.settings = settings
        self.dropped: Counter[str] = Counter(dict.fromkeys(CAUSES, 0))
        self._uncut = np.zeros(len(names), dtype=bool)
        self._uncut.setflags(write=False)
        self.saturated: NDArray[np.bool_] = self._uncut
        self.hold_due = False
        self.origin = self.change = self.busy_advice = ""
        self._accepted = AcceptedParameters(settings)
        self._asked = True  # a person has asked for the next start
        self._changed = False  # since the last start was accepted
        self._compare_at, self._lagging_since = -np.inf, np.inf
        self._interruptions = 0  # by the arm's own compensation, since we were enabled
        self._obstacles: dict[str, str] = {}
        self._gate = InputGate(settings.model.arm)
        self._start: Start | None = None
        self._ramp: Ramp | None = None
        self._check: ConstantCheck | None = None
        self._constant_stayed = np.zeros(len(names))  # that the arm was seen to feel
        self._command: Array | None = None
        self._behind = False  # slew_limit keeps it from what is wanted
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
        """(n,) joints whose reported velocity was not believed in the last sample."""
        return self._gate.motion.doubtful

    @property
    def outside(self) -> NDArray[np.bool_]:
        """(n,) joints further than 5 deg (or 9 mm) outside the arm's limits."""
        arm, position = self.settings.model.arm, self._position
        slack = OUTSIDE * arm.scale
        return (position < arm.lower - slack) | (position > arm.upper + slack)

    @property
    def friction_held_back(self) -> NDArray[np.bool_]:
        """(n,) joints whose friction compensation may feed energy in, and is scaled down."""
        return self._passivity.factor < 1.0

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
        self._input_fault = False
        self._stop(Status.FAULT, reason)

    @np.errstate(over="ignore", invalid="ignore")
    def configure(self, settings: Settings, now: float) -> None:
        """Replace the settings; the torque goes to the new one by the ramp, without a jump."""
        before, self.settings = self.settings, settings
        self._changed = not settings.commands_like(self._accepted.settings)
        if self._command is not None and not self._deviates(self._position, now):
            self.change = self._accepted.change(settings, self._position)
            # Their history, a debt above all, stays: parameters may change often.
            self._passivity.limit(settings.friction_part, settings.allowance)
            self._guard.limit(settings.speed_limit)
            self.status, self.reason = (
                Status.RAMPING,
                "blending to the changed parameters' torque",
            )
            self._begin_check(self._position)
            try:
                self._begin_ramp(self._command, self._position, self._velocity, now)
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
            self._input_fault = False
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
            self._input_fault = True
            self._stop(Status.FAULT, f"{silence}; {self.busy_advice or IF_BUSY}")
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
        settings = self.settings
        by_input = self.status is Status.FAULT and self._input_fault
        silent = by_input and self._gate.silence(now, settings.timeout)
        sample = self._gate.admit(
            sample, now, clock, settings.timeout, settings.max_stamp_age, self.active
        )
        if by_input:
            if silent:
                raise DroppedSampleError("after_gap", "first message after a gap")
            if settings.resume_automatically:
                self._wait()
        if self._gate.motion.contradiction and (self.active or self._start is not None):
            self.fail(self._gate.motion.contradiction)
            return None
        try:
            if self.status is Status.WAITING and not self._obstacles:
                self._start = Start(now, settings.model.arm)
                self.status, self.reason = (
                    Status.STARTING,
                    "measuring the holding effort",
                )
            if self._start is not None:
                self._collect(self._start, sample, now)
            if not self.active:
                return None
            return self._follow(sample, now, self._gate.step)
        except (ArithmeticError, ValueError, TypeError) as error:
            self.fail(f"internal error: {error}")
            return None

    def _collect(self, start: Start, sample: Sample, now: float) -> None:
        """Begin, with enough samples, with the effort that holds the arm."""
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
        # Else nothing was compared or confirmed: small changes must not add up.
        if self._asked or settings.weightless or start.has_efforts():
            self._accepted = AcceptedParameters(settings)
        self._asked = False
        self._changed = not settings.commands_like(self._accepted.settings)
        self.change = LEFT_OUT if settings.weightless else ""
        self._watch_energy()
        self._begin_ramp(self._command, sample.position, sample.velocity, now)
        self.status, self.reason = Status.RAMPING, "blending to the model's torque"
        self._begin_check(sample.position)

    def _begin_check(self, position: Array) -> None:
        """Watch joints with a constant in doubt, unless the arm was seen to feel the same."""
        model, seen = self.settings.model, self._constant_stayed
        if (
            self._check is None
            and model.constant.any()
            and not np.array_equal(seen, model.constant)
        ):
            self._check = ConstantCheck(model.arm, model.constant, position)
            self.reason += f"; {HANDS_OFF}"

    def _begin_ramp(
        self, command: Array, position: Array, velocity: Array | None, now: float
    ) -> None:
        settings = self.settings
        conservative, friction = settings.parts(position, velocity)
        torque = self._finite(conservative + friction * self._passivity.factor)
        wanted = settings.limits.clip(torque)
        self._ramp = Ramp(command, wanted, now, settings.ramp_time, settings.model.arm)

    def _watch_energy(self) -> None:
        settings, arm = self.settings, self.settings.model.arm
        self._passivity = PassivityObserver(
            settings.friction_part, settings.allowance, settings.limits.coupled, arm.scale
        )
        self._guard = SpeedGuard(arm, settings.speed_limit)

    def _finite(self, torque: Array) -> Array:
        """Return (n,) torques, N·m, or raise ArithmeticError."""
        finite = np.isfinite(torque)
        if not finite.all():
            joint = self.settings.model.arm.joint_names[int(np.argmin(finite))]
            raise ArithmeticError(f"the model's torque on {joint} is not a finite number")
        return torque

    def _follow(self, sample: Sample, now: float, step: float) -> Array | None:
        settings = self.settings
        previous = self._command
        assert previous is not None  # set by _collect, before anything is active
        runaway = self._guard.check(self._gate.motion.velocity, previous, now)
        if self._check is not None:
            runaway = runaway or self._moved_joint(self._check, sample, now)
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
        if within is not target:  # torques within the limits are finite
            self._finite(target)
        self.saturated = self._uncut if within is target else np.abs(within - target) > CUT
        if self._ramp is not None:
            within = self._ramp.blend(within, now, settings.limits)
            if self._ramp.over:
                self._ramp = None
                self.status, self.reason = Status.COMMANDING, "compensating"
                self.reason += f"; {HANDS_OFF}" * (self._check is not None)
        step = min(max(step, SHORTEST_STEP), LONGEST_STEP)
        largest = settings.slew_limit * step
        self._command = slew(previous, within, largest, settings.limits)
        self._behind = self._command is not within
        if self._behind and self._lags(within, self._command, now):
            return None
        self._position, self._velocity = sample.position, sample.velocity
        return self._command

    def _moved_joint(self, check: ConstantCheck, sample: Sample, now: float) -> str:
        """Return which joint a constant in doubt moves, ``""``: none."""
        whole = ~self.saturated & (self._ramp is None and not self._behind)
        pushed = check.check(sample, self._gate.motion.velocity, now, whole)
        if check.finished:
            self._check, self._constant_stayed = None, self.settings.model.constant
            self.reason = self.reason.removesuffix(f"; {HANDS_OFF}")
        return pushed

    def _deviates(self, position: Array, now: float) -> bool:
        """Hold the arm if changed parameters command torque that no start has compared."""
        self._compare_at = now + COMPARED
        deviation = self._accepted.deviation(self.settings, position)
        if deviation is None:
            return False
        if deviation.measurable:
            more = "the arm is held while the effort is measured again"
            self._stop(Status.WAITING, f"{deviation.reason}; {more}")
        else:
            self.fail(f"{deviation.reason}; ~/enable accepts it")
        return True

    def _lags(self, asked: Array, command: Array, now: float) -> bool:
        """Hold an arm whose command ``slew_limit`` keeps too far behind for too long."""
        lag = np.abs(asked - command) / self.settings.model.arm.effort_limit
        worst = int(np.argmax(lag))
        if lag[worst] <= self.settings.start_tolerance:
            self._lagging_since = np.inf
            return False
        self._lagging_since = min(self._lagging_since, now)
        if now - self._lagging_since < LONGEST_LAG:
            return False
        joint = self.settings.model.arm.joints[worst]
        self.fail(
            f"the command of {joint.name} lags: {command[worst]:.3g} of {asked[worst]:.3g} "
            f"{joint.effort_unit}; slew_limit is too small for this motion"
        )
        return True

    def _wait(self) -> None:
        self._start = None
        self.status = Status.WAITING
        self.reason = next(iter(self._obstacles.values()), "waiting for valid measured_js")

    def _stop(self, status: Status, reason: str) -> None:
        self.hold_due = self.hold_due or self.active
        self.status, self.reason = status, reason
        self._start = self._ramp = self._check = None
        self._command = None
        self.saturated = self._uncut
