"""Moves an arm along a path through ROS, and stops it when anything goes wrong."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting import Path, Watch, hold_on_error
from dvrk_gravity.compensate import (
    CommandRefusedError,
    DroppedSampleError,
    FollowingErrorCheck,
    InputGate,
    MotionError,
    Sample,
    require_within,
)
from dvrk_gravity.ros.arm_link import ArmLink
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.executor import arrived, subscribe_raw
from dvrk_gravity.ros.foreign_commands import LATELY
from dvrk_gravity.ros.presence import MEASURED, simulator_of
from dvrk_gravity.ros.processes import ProcessError
from dvrk_gravity.ros.runtime import catch_end_signals
from dvrk_gravity.ros.wire import CommandTopic

__all__ = ["MotionError", "Mover"]

# Without measured_js for so long the arm is held, s; a console publishes at least every 10 ms.
TIMEOUT = 0.1
# A motion advances in one step by so much at most, s: at 90 deg/s that is 2 deg. After a longer
# pause of ours the arm does not chase a motion that has run away from it.
LATE = 0.02
# A motion may be so far ahead of the arm's own clock, s: more than the 10 ms between measurements
# and their transport. A simulated arm whose machine is too slow has a slow clock. After a stand-
# still of 50 ms a simulated arm is 80 ms behind a set point that is this and LATE ahead: with more
# an undisturbed joint at 230 deg/s is further behind than FollowingErrorCheck allows.
AHEAD = 0.03
# No other node must have commanded the arm for so long before we do, s.
LISTEN = 1.0
# Readings of a rest position at least: a busy machine listens a few times a second. Chosen.
HEARD = 10
# After a pause of ours of so long, s, the arm may be somewhere else, or another node may command
# it: earlier measurements prove nothing.
ASLEEP = 0.5
# Farthest stamp from this computer's clock, s, before anything moves: a bag that is played back is
# days old. The clock of our simulator, which skips time on a busy machine, may lag by minutes.
STAMP_AGE = 10.0
# Measurements that may wait for us, a second and more of them: the recording must not lose any.
_QUEUE = 2000


class Mover:
    """Streams positions to an arm (context manager), and holds it at the end if it was moved.

    Attributes:
        interrupted: A signal has asked for the end.
    """

    def __init__(self, client: Client, arm: Arm, rate: float, timeout: float = TIMEOUT) -> None:
        """Connect the topics of ``client``'s namespace; ``rate`` Hz, ``timeout`` s."""
        self._client, self._arm, self._rate, self._timeout = client, arm, rate, timeout
        self._link = self._make_link(client.node)
        self._gate = InputGate(arm)
        self._following = FollowingErrorCheck(arm)
        self._awake = time.monotonic()  # when we last looked for messages
        self._heard = self._awake  # when the last believed one came
        self._dropped = ""  # why the last measurement was dropped
        self._simulated = False  # our simulator measures, and its stamps are old
        self._against: dict[str, str] = {}  # by cause, why the arm must not be commanded
        self._next_look = 0.0
        self._sink: Callable[[bytes], None] | None = None
        self._watch: Watch | None = None
        self._moment = 0.0  # of the last set point, on its path, s
        # (n,) last set point and its velocity, until the arm is held.
        self._commanded: tuple[Array, Array] | None = None
        self.interrupted = False
        self._input = subscribe_raw(client.node, JointState, MEASURED, self._on_measured, _QUEUE)

    def __enter__(self) -> Mover:
        def interrupt() -> None:
            self.interrupted = True

        self._signals = ExitStack()
        self._signals.enter_context(catch_end_signals(interrupt))
        return self

    def __exit__(self, *_: object) -> None:
        with self._signals:
            self.hold()

    def _make_link(self, node: Node) -> ArmLink:
        return ArmLink(
            node,
            self._arm,
            CommandTopic.positions(),
            on_other=lambda: self._forbid("others", self._link.other_topics.reason()),
            on_same_topic=lambda: self._forbid("same_topic", self._link.same_topic.reason()),
            on_state=lambda reason: self._forbid("operating_state", reason),
        )

    @property
    def topic(self) -> str:
        """Full name of ``measured_js``."""
        return str(self._input.topic_name)

    def connect(self, timeout: float = 10.0) -> Array:
        """Wait for the arm, listen to it and to others, and return its (n,) rest position, rad.

        Raises:
            MotionError: No arm, another one, one that moves, or that another node commands.
        """
        try:
            self._client.wait(
                lambda: (
                    self.interrupted
                    or (self._following.last is not None and self._link.is_connected())
                ),
                "the arm",
                timeout,
            )
        except ProcessError:
            missing = (
                self._link.missing_connection
                if self._following.last is not None
                else self._dropped or "nothing publishes it"
            )
            elsewhere = self._link.presence.other_namespaces()
            seen = f" {', '.join(elsewhere)} is published" if elsewhere else ""
            raise MotionError(
                f"{self.topic}: no arm within {timeout:g} s: {missing}; is its console on, and is "
                f"this its namespace (--namespace)?{seen}"
            ) from None
        if self._link.extra_joints:
            raise MotionError(
                f"{self.topic}: has joints that {self._arm.name} lacks, "
                f"{', '.join(self._link.extra_joints)}: a console takes positions by index, and "
                "needs those of all its joints"
            )
        heard: list[Sample] = []  # no reading twice, however slowly they arrive
        end = time.monotonic() + LISTEN
        while time.monotonic() < end or len(heard) < HEARD:
            self._listen_until(time.monotonic() + 1.0 / self._rate)
            self._check()
            sample = self._following.last
            if sample is not None and (not heard or sample is not heard[-1]):
                heard.append(sample)
        try:
            position = self._following.rest_position(np.array([each.position for each in heard]))
            require_within(self._arm, position)
        except (MotionError, CommandRefusedError) as error:
            raise MotionError(f"{self.topic}: {error}") from error
        return position

    def follow(
        self,
        path: Path,
        duration: float,
        record: Callable[[bytes], None] | None = None,
        progress: Callable[[float], None] | None = None,
        watch: Watch | None = None,
    ) -> float:
        """Drive the arm along a path: :meth:`dvrk_gravity.collecting.Driver.follow`.

        Where we pause for longer than :data:`LATE`, the motion pauses with us.

        Raises:
            MotionError: The arm does not follow or is not heard, or another node commands it.
            KeyboardInterrupt: A signal asked for the end.
        """
        try:
            with hold_on_error(self.hold):
                self._catch_up()
                self._begin(path, duration)
                self._sink, self._watch = record, watch
                return self._stream(path, duration, progress)
        finally:
            self._sink = self._watch = None

    def _stream(
        self, path: Path, duration: float, progress: Callable[[float], None] | None
    ) -> float:
        period, moment, first = 1.0 / self._rate, 0.0, self._following.time
        start = last = time.monotonic()
        while moment < duration:
            self._moment = moment
            self._command(*path(moment)[:2])
            if progress is not None:
                progress(moment / duration)
            # On a grid of instants: the rate does not depend on the duration of one round.
            self._listen_until(start + (int((last - start) / period) + 1) * period)
            now = time.monotonic()
            moment = self._next_moment(moment, now - last, self._following.time - first)
            last = now
        self._command(*path(duration)[:2])
        self._finish()
        return self._following.time - first - duration

    def _begin(self, path: Path, duration: float) -> None:
        """Prepare the arm for a path."""

    def _next_moment(self, moment: float, passed: float, of_arm: float) -> float:
        """Return how far a motion is next, s, after ``passed`` s of ours and ``of_arm`` in all."""
        return min(moment + min(passed, LATE), of_arm + AHEAD)

    def _finish(self) -> None:
        """Wait for what ends later than the set points."""

    def hold(self) -> bool:
        """Hold the arm where it comes to rest, if it was moved; return whether hold was sent.

        A console's hold keeps the set point: an arm that did not follow would press on for ever.
        Where the last readings contradict each other, the set point is safer: it is no further from
        the arm than a command may be.

        Raises:
            MotionError: The arm has not acknowledged it.
        """
        if self._commanded is None:
            return False
        if self._link.freed_by_others():
            self._commanded = None  # the person who freed the arm may have a hand in it
            return False
        if not any(self._against.values()) and time.monotonic() - self._awake < ASLEEP:
            stop = self._following.resting_place(*self._commanded, self._gate.motion.velocity)
            self._publish(stop)
        self._commanded = None
        self._link.hold.send()
        if not self._link.hold.settle():
            raise MotionError("hold was not acknowledged: check that the arm holds")
        return True

    def _command(self, position: Array, velocity: Array) -> None:
        """Send a set point, unless anything forbids it."""
        self._check()
        self._following.check(position, velocity, first=self._commanded is None)
        self._commanded = position, velocity
        self._publish(position, velocity)

    def _publish(self, position: Array, velocity: Array | None = None) -> None:
        stamp = self._client.node.get_clock().now().nanoseconds
        at_rest = np.zeros(self._arm.n)
        self._link.publish(stamp, position, at_rest if velocity is None else velocity)

    def _listen_until(self, when: float) -> None:
        time.sleep(max(0.0, when - time.monotonic()))
        self._catch_up()

    def _catch_up(self) -> None:
        """Process all messages that have arrived.

        Not through the executor, which checks every entity for each message: at 1 kHz a busy
        machine has no time for that.
        """
        for subscription in list(self._client.node.subscriptions):
            for received in arrived(subscription, _QUEUE):
                subscription.callback(*received[: 2 if subscription is self._input else 1])
        self._client.spin_once(0.0)
        now = time.monotonic()
        if self._commanded is not None and now - self._awake > ASLEEP:
            self._against["pause"] = f"this process was suspended for {now - self._awake:.1f} s"
        self._awake = now

    def _check(self) -> None:
        """Raise if anything forbids a command now."""
        if self.interrupted:
            raise KeyboardInterrupt
        now = time.monotonic()
        if now >= self._next_look:
            self._next_look = now + LATELY / 4
            self._against |= self._link.look(self._commanded is not None, measuring=True)
            if not self._link.commanded_by_others():
                self._against["same_topic"] = ""
        reason = next(filter(None, self._against.values()), "")
        if reason:
            raise MotionError(reason)
        if self._gate.silence(now, self._timeout):
            # We may not have listened: messages that have arrived meanwhile count.
            self._catch_up()
            silence = self._gate.silence(time.monotonic(), self._timeout)
            if silence:
                why = f" ({self._dropped})" if self._dropped else ""
                why = why or "; if this computer is busy, raise --timeout"
                raise MotionError(f"{self.topic}: {silence}{why}")

    def _on_measured(self, data: bytes, info: Mapping[str, Any]) -> None:
        several = self._link.presence.note_message(info)
        if self._sink is not None:
            self._sink(data)
        if several:
            self._against["measured_js"] = several
            return
        moved = self._commanded is not None
        clock = self._client.node.get_clock().now().nanoseconds
        oldest = 0.0 if moved or self._simulated else STAMP_AGE
        joints = self._link.measured
        try:
            sample = self._link.read(data)
            if moved and self._link.measured != joints:
                # Which order the console takes positions in is not known any more.
                found, before = (", ".join(names) for names in (self._link.measured, joints))
                self._against["joints"] = (
                    f"{self.topic}: joints {found}, {before} before: is it another arm?"
                )
            now = time.monotonic()
            believed = self._gate.admit(sample, now, clock, self._timeout, oldest, moved)
        except DroppedSampleError as error:
            # That a stamp stands still is what the gate's silence says.
            still = error.cause == "stamp_repeated"
            self._dropped = "" if still else f"{error.cause}: {error}"
            if error.cause == "stamp_too_old":
                self._simulated = bool(simulator_of(self._client.node))
            if moved and error.cause == "position_jump":  # the servo may pull it back unnoticed
                self._against["position_jump"] = f"{self.topic}: {error}"
        else:
            last, self._heard = self._heard, now
            ahead = 1e-9 * sample.stamp - self._following.time - (now - last) if moved else 0.0
            if ahead > ASLEEP:
                self._against["clock"] = (
                    f"{self.topic}: its clock has stepped {ahead:.3g} s forwards: a motion cannot "
                    "be timed by it"
                )
            self._following.add(believed)
            self._dropped = ""
            if self._watch is not None and self._commanded is not None:
                self._watch(believed, self._moment)

    def _forbid(self, cause: str, reason: str) -> None:
        self._against[cause] = reason
