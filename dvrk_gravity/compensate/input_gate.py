"""What a measurement must pass before a command answers it: it is current, and it is possible."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import FASTEST, UNTIMED_STEP, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.sample import DroppedSampleError, Sample

# Stamps have to cover this part of the time that passes: simulated time may run at a tenth of real
# time; what is slower (nanoseconds a message, say) stands still for all that matters here.
LEAST_PACE = 0.1

# Two clocks drift apart by this at most, s/s: ten times what computers' do. A message that is later
# against the quickest one by more than that and the time-out is as stale as none.
DRIFT = 1e-3

# Reported and observed velocities are compared so often, s, through low-pass filters of this time
# constant, s: longer than consoles' own velocity filters (some 10 ms), and at 0.006 rad a step and
# 100 Hz an encoder's steps leave 0.1 rad/s of ripple.
INTERVAL, TIME_CONSTANT = 0.005, 0.05
# They may differ by five times that ripple, rad/s, and by this part of the larger one.
SLACK, SHARE = 0.5, 0.5
# An encoder that stands still, or drifts: the ways of positions and of velocities differ more and
# more. Of the difference neither SLOW, rad/s, nor TRUSTED of the velocity counts; what does may add
# up to ASTRAY, rad, and to the way of LATE, s, at the largest speed of the last RECENT, s. A real
# MTM's wrist_yaw, which repeats old velocities for 0.2 s, reaches 0.85 of that, all other joints of
# real recordings 0.6.
SLOW, TRUSTED, ASTRAY, LATE, RECENT = 0.02, 0.7, 0.02, 0.12, 0.2
# But no sooner than in this time, s: a single wrong velocity is no fault.
SOONEST = 0.2


class InputGate:
    """Admits current samples whose positions each joint can have reached since the last one.

    Stamps are checked against each other, the node's clock and the time that passes. Times are
    seconds of a monotonic clock: a step of the wall clock or of simulated time neither hides stale
    input nor makes fresh input look stale.

    Attributes:
        motion: What the positions say of the motion, and whether the velocities agree.
        step: Time since the message before the last admitted one, s.
    """

    def __init__(self, arm: Arm) -> None:
        self.motion = MotionCheck(arm)
        self.step = math.inf
        self._valid = -math.inf  # when the last message with a good stamp came
        self._advance = -math.inf  # when the stamp last advanced
        self._advanced_to = -(2**63)
        self._stamp = 0  # of the last admitted message
        self._seen = 0  # of the last message, admitted or not
        self._quickest = math.inf  # least age of a message by the two clocks, s

    def silence(self, now: float, timeout: float) -> str:
        """Return what has been missing for longer than ``timeout`` seconds, ``""``: nothing."""
        if now - self._valid > timeout:
            return f"no valid measured_js for {timeout:g} s"
        if now - self._advance > timeout:
            return f"the stamp of measured_js has not advanced for {timeout:g} s"
        return ""

    def admit(
        self, sample: Sample, now: float, clock: int, timeout: float, oldest: float, active: bool
    ) -> Sample:
        """Return the sample if it is believed, as :meth:`MotionCheck.check` does.

        Args:
            sample: The sample.
            now: Monotonic time of its arrival, s.
            clock: The node's clock, ns.
            timeout: Longest time without fresh input, s.
            oldest: Largest difference between stamp and clock, s; 0: not checked.
            active: The arm is under our command.

        Raises:
            DroppedSampleError: Its stamp or its positions disqualify it.
        """
        stamp = sample.stamp
        known, self._seen = (self._stamp, self._seen), stamp
        if stamp < self._stamp:
            # After a long time without valid input, the clock has been stepped for good.
            if active or now - self._valid <= timeout:
                late = (self._stamp - stamp) * 1e-9
                raise DroppedSampleError(
                    "stamp_backwards", f"stamp {late:.3f} s before the last one"
                )
            self._advanced_to = min(self._advanced_to, stamp)
        if oldest > 0.0:
            _require_recent(stamp, clock, oldest)
            self._require_prompt((clock - stamp) * 1e-9, now, timeout, active)
        gap = now - self._advance
        due = LEAST_PACE * min(gap, timeout)
        advances = stamp not in known and (stamp - self._advanced_to) * 1e-9 >= due
        if not advances and gap > timeout:
            self._valid = now
            raise DroppedSampleError("stamp_repeated", "the stamp does not advance")
        believed = self.motion.check(sample, now, timeout)
        # A message that waited in a queue while the process or the arm stood still is the first
        # after a gap, and is not answered: times count for messages that pass.
        self.step, self._valid, self._stamp = now - self._valid, now, stamp
        if advances:
            self._advance, self._advanced_to = now, stamp
        return believed

    def _require_prompt(self, age: float, now: float, timeout: float, active: bool) -> None:
        """Refuse a message that has been on its way for longer than others, by the time-out."""
        silence = now - self._valid
        if not active and silence > timeout:  # as it is from now on, for all that is known
            self._quickest = math.inf
        quickest = min(age, self._quickest + DRIFT * silence)
        if age - quickest > timeout:
            raise DroppedSampleError(
                "stamp_too_old",
                f"stamp {age - quickest:.3f} s later than that of others, at most {timeout:g} s "
                "allowed (timeout): delayed by a network, or a simulator on a busy computer",
            )
        self._quickest = quickest


def _require_recent(stamp: int, clock: int, oldest: float) -> None:
    age = (clock - stamp) * 1e-9
    if abs(age) <= oldest:
        return
    if clock == 0:
        raise DroppedSampleError("no_clock", "use_sim_time is set, but nothing publishes /clock")
    cause, where = ("stamp_too_old", "behind") if age > 0.0 else ("stamp_ahead", "ahead of")
    raise DroppedSampleError(
        cause,
        f"stamp {abs(age):.3f} s {where} this computer's clock, at most {oldest:g} s allowed: "
        "stale data, unsynchronised computers, or a simulator on a busy one",
    )


class MotionCheck:
    """Compares each measurement with those before it.

    Attributes:
        doubtful: (n,) joints whose reported velocity was not believed in the last sample.
        velocity: (n,) of the last sample, rad/s: as reported; where it is missing or not believed,
            from the positions, filtered.
        contradiction: Which joint's positions and velocities are of two motions, in words; ``""``.
    """

    def __init__(self, arm: Arm) -> None:
        """Start without history."""
        self._arm, self._scale = arm, arm.scale
        self._least = float(self._scale.min())
        self._last: Sample | None = None
        self._time = 0.0  # monotonic, of the last one's arrival
        self._dropped: Sample | None = None  # the last one, if it was out of reach
        self._anchor: Sample | None = None  # the last one at which velocities were compared
        self._observed = self._reported = self.velocity = np.zeros(arm.n)
        self.doubtful: NDArray[np.bool_] = np.zeros(arm.n, dtype=bool)
        self._any_doubtful = False
        self._astray = np.zeros((2, arm.n))  # upwards, downwards
        self._fastest = np.zeros(arm.n)
        self.contradiction = ""

    def check(self, sample: Sample, now: float, timeout: float) -> Sample:
        """Return the sample, with velocity zero at joints where the reported one cannot be true.

        At zero velocity no friction is compensated, which never drives a joint. After ``timeout``
        without a sample nothing is compared. For the arguments see :meth:`InputGate.admit`.

        Raises:
            DroppedSampleError: A joint cannot have got there since the last sample.
        """
        last = self._last
        if last is None or now - self._time > timeout:
            self._anchor = sample
            self._observed = self._reported = np.zeros(self._arm.n)
            self._astray, self.contradiction = np.zeros((2, self._arm.n)), ""
            self.doubtful, self._any_doubtful = np.zeros(self._arm.n, dtype=bool), False
        else:
            step = (sample.stamp - last.stamp) * 1e-9
            if step < 0.0:
                return sample  # out of order, or another clock: its stamp decides
            change = sample.position - last.position
            # Where the joints' way together is short, each one's is: that is quick to check.
            reach = (UNTIMED_STEP + FASTEST * min(step, timeout)) * self._least
            near = self._dropped is None and change.dot(change) <= reach * reach
            if not near and (
                not self._within_reach(last, sample, timeout)
                or (
                    self._dropped is not None and self._within_reach(self._dropped, sample, timeout)
                )
            ):
                self._dropped = sample  # later ones near it are out of reach, too
                raise self._jump_error(change, step)
        self._last, self._time, self._dropped = sample, now, None
        self._compare(sample)
        return self._with_believed_velocity(sample)

    def _compare(self, sample: Sample) -> None:
        """Compare reported velocities with those of the positions, through the same filter."""
        anchor = self._anchor
        assert anchor is not None  # set by the first sample
        step = (sample.stamp - anchor.stamp) * 1e-9
        if step < INTERVAL:
            return
        moved = (sample.position - anchor.position) / step
        part = step / (step + TIME_CONSTANT)
        self._observed = self._observed + part * (moved - self._observed)
        if sample.velocity is None:
            self._reported = self._observed
        else:
            most = 2 * FASTEST * self._scale
            reported = np.minimum(np.maximum(sample.velocity, -most), most)
            self._reported = self._reported + part * (reported - self._reported)
            self._add_up(anchor, sample, step)
        self._anchor = sample
        larger = np.maximum(np.abs(self._observed), np.abs(self._reported))
        difference = np.abs(self._observed - self._reported)
        self.doubtful = difference > SLACK * self._scale + SHARE * larger
        self._any_doubtful = bool(self.doubtful.any())

    def _add_up(self, anchor: Sample, sample: Sample, step: float) -> None:
        """Add up by how much the way of the positions is another one than that of the velocities.

        A cumulative sum in both directions (Page, 1954).
        """
        if anchor.velocity is None or sample.velocity is None:
            return
        way = 0.5 * (anchor.velocity + sample.velocity) * step
        speed = np.abs(self._reported)  # filtered: noise is no speed
        fastest = np.maximum(speed, np.abs(self._observed))
        self._fastest = np.maximum(fastest, self._fastest * (1.0 - min(step / RECENT, 1.0)))
        most = ASTRAY * self._scale + LATE * self._fastest
        apart = sample.position - anchor.position - way
        allowed = np.maximum(SLOW * self._scale, TRUSTED * speed) * step
        counted = np.minimum(np.stack([apart, -apart]) - allowed, most * (step / SOONEST))
        astray = np.maximum(self._astray + counted, 0.0)
        self._astray = np.minimum(astray, 2.0 * most)
        over = (astray > most).any(axis=0)
        if not over.any():
            self.contradiction = ""
            return
        worst = int(np.argmax(over))
        joint = self._arm.joints[worst]
        self.contradiction = (
            f"{joint.name}: positions move by {self._observed[worst]:.2g} {joint.unit}/s, "
            f"velocities are {self._reported[worst]:.2g} {joint.unit}/s: an encoder that stands "
            "still or drifts? Move the joint by hand, and compare both with it"
        )

    def _with_believed_velocity(self, sample: Sample) -> Sample:
        velocity = sample.velocity
        if velocity is None:
            self.velocity = self._observed
            return sample
        self.velocity = velocity
        if not self._any_doubtful and velocity.dot(velocity) <= (FASTEST * self._least) ** 2:
            return sample
        doubtful = np.abs(velocity) > FASTEST * self._scale
        doubtful |= self.doubtful
        if np.count_nonzero(doubtful) == 0:
            return sample
        self.velocity = np.where(doubtful, self._observed, velocity)
        return replace(sample, velocity=np.where(doubtful, 0.0, velocity))

    def _within_reach(self, last: Sample, sample: Sample, timeout: float) -> bool:
        step = min((sample.stamp - last.stamp) * 1e-9, timeout)
        farthest = (UNTIMED_STEP + FASTEST * step) * self._scale
        return bool((np.abs(sample.position - last.position) <= farthest).all())

    def _jump_error(self, change: Array, step: float) -> DroppedSampleError:
        worst = int(np.argmax(np.abs(change / self._scale)))
        joint = self._arm.joints[worst]
        return DroppedSampleError(
            "position_jump",
            f"{joint.name} by {change[worst]:.3g} {joint.unit} in {step * 1e3:.3g} ms, faster "
            f"than {FASTEST * self._scale[worst]:g} {joint.unit}/s: a broken encoder, or another "
            "arm's messages?",
        )
