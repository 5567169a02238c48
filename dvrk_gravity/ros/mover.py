"""Moves an arm along a path through ROS, and stops it when anything is not as it should be."""

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
from dvrk_gravity.compensate import (
    DroppedSampleError,
    Following,
    InputGate,
    MotionError,
    StartRefusedError,
    require_within,
)
from dvrk_gravity.ros.arm_link import MEASURED, ArmLink
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.command_topic import CommandTopic
from dvrk_gravity.ros.ending import asked_to_end
from dvrk_gravity.ros.processes import ProcessError

__all__ = ["MotionError", "Mover"]

Path = Callable[[float], tuple[Array, Array]]

TIMEOUT = 0.1
"""Without measured_js for so long the arm is held, s; a console publishes at least every 10 ms."""

LATE = 0.02
"""How far a motion goes on in one step at most, s: at 90 deg/s that is 2 deg. After a longer pause
of ours the arm is not sent after a motion that has run away from it."""

AHEAD = 0.05
"""How far a motion may be ahead of the arm's own clock, s: more than the 10 ms between measurements
and what their way takes. A simulated arm whose machine is too slow has a slow clock."""

LISTEN = 1.0
"""How long nobody else must have been heard to command before we do, s."""

LOOK = 0.075
"""How often it is looked who is there, s: four times in what counts as lately."""

ASLEEP = 0.5
"""After a pause of ours of so long, s, the arm may be somewhere else, or somebody else's: what was
measured before says nothing any more."""

STAMP_AGE = 10.0
"""Farthest stamp from this computer's clock, s, before anything moves: a recording that is played
is days old. The clock of a simulated arm whose machine is slow falls behind by seconds."""

# Measurements that may wait for us, a second and more of them: none is to be lost to the recording.
_QUEUE = 2000


class Mover:
    """Streams positions to an arm (context manager); leaving it holds the arm if it was moved.

    Attributes:
        interrupted: A signal asked for the end.
    """

    def __init__(self, client: Client, arm: Arm, rate: float, timeout: float = TIMEOUT) -> None:
        """Connect the topics.

        Args:
            client: The node that talks; its namespace is the arm's.
            arm: The arm.
            rate: Positions commanded a second, Hz.
            timeout: Without measured_js for so long the arm is held, s.
        """
        self._client, self._arm, self._rate, self._timeout = client, arm, rate, timeout
        self._link = ArmLink(
            client.node,
            arm,
            CommandTopic.positions(),
            on_other=self._on_other,
            on_rival=self._on_rival,
            on_state=self._on_state,
        )
        self._gate = InputGate(arm)
        self._following = Following(arm)
        self._awake = time.monotonic()  # when we last listened
        self._dropped = ""  # why the last measurement was not believed
        self._against: dict[str, str] = {}  # by cause, why the arm must not be commanded
        self._next_look = 0.0
        self._sink: Callable[[bytes], None] | None = None
        # (n,) last set point and its velocity, until the arm is held.
        self._commanded: tuple[Array, Array] | None = None
        self.interrupted = False
        self._input = client.node.create_subscription(
            JointState,
            MEASURED,
            self._on_measured,  # type: ignore[arg-type]  # rclpy hands over information, too
            _QUEUE,
            raw=True,
        )

    def __enter__(self) -> Mover:
        """Take in hand whatever may ask for the end."""

        def interrupt() -> None:
            self.interrupted = True

        self._signals = ExitStack()
        self._signals.enter_context(asked_to_end(interrupt))
        return self

    def __exit__(self, *_: object) -> None:
        """Hold the arm if it was moved, and give the signals back."""
        with self._signals:
            self.hold()

    @property
    def topic(self) -> str:
        """Full name of the measurements' topic."""
        return str(self._input.topic_name)

    def connect(self, timeout: float = 10.0) -> Array:
        """Wait for the arm, listen to it and to others, and return (n,) where it rests, rad.

        Raises:
            MotionError: No arm, another one, one that moves, or that somebody else commands.
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
                "nothing takes servo_jp and hold"
                if self._following.last is not None
                else self._dropped or "nothing publishes it"
            )
            elsewhere = self._link.measured_elsewhere()
            seen = f" {', '.join(elsewhere)} is published" if elsewhere else ""
            raise MotionError(
                f"{self.topic}: waited {timeout:g} s in vain for the arm: {missing}; is its "
                f"console on, and is this its namespace (--namespace)?{seen}"
            ) from None
        if self._link.further:
            raise MotionError(
                f"{self.topic}: holds {', '.join(self._link.further)}, too, which {self._arm.name} "
                "has not: a console takes positions by index, and those of all its joints"
            )
        heard: list[Array] = []
        end = time.monotonic() + LISTEN
        while time.monotonic() < end:
            self._listen_until(time.monotonic() + 1.0 / self._rate)
            self._check()
            heard.append(self._following.position)
        try:
            position = self._following.at_rest(np.array(heard))
            require_within(self._arm, position)
        except (MotionError, StartRefusedError) as error:
            raise MotionError(f"{self.topic}: {error}") from error
        return position

    def follow(
        self,
        path: Path,
        duration: float,
        record: Callable[[bytes], None] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> float:
        """Drive the arm along a path in its own time; whatever ends that early stops the arm.

        Where we pause for longer than :data:`LATE`, the motion pauses with us.

        Args:
            path: Time since its beginning, s, to (n,) position, rad, and (n,) velocity, rad/s.
            duration: s.
            record: Gets every measured_js, as CDR bytes, while the arm moves.
            progress: Gets the part that is done, 0 to 1.

        Returns:
            By how much longer than ``duration`` it took, s of the arm's clock.

        Raises:
            MotionError: The arm does not follow or is not heard, or somebody else commands it.
            KeyboardInterrupt: A signal asked for the end.
        """
        try:
            self._catch_up()
            self._sink = record
            return self._stream(path, duration, progress)
        except MotionError as error:
            held = "; the arm was told to hold" if self._commanded is not None else ""
            self.hold()
            raise MotionError(f"{error}{held}") from error
        except BaseException:
            self.hold()
            raise
        finally:
            self._sink = None

    def _stream(
        self, path: Path, duration: float, progress: Callable[[float], None] | None
    ) -> float:
        period, moment, first = 1.0 / self._rate, 0.0, self._following.time
        start = last = time.monotonic()
        while moment < duration:
            self._command(*path(moment))
            if progress is not None:
                progress(moment / duration)
            # On a grid of instants, so that the rate is kept whatever one round took.
            self._listen_until(start + (int((last - start) / period) + 1) * period)
            now = time.monotonic()
            moment = min(moment + min(now - last, LATE), self._following.time - first + AHEAD)
            last = now
        self._command(*path(duration))
        return self._following.time - first - duration

    def hold(self) -> None:
        """Hold the arm where it comes to rest, if it was moved.

        A console's hold keeps the set point: an arm that did not follow would press on for ever.
        Where the last readings contradict each other the set point is the safer place: it is no
        further from the arm than a command may be.

        Raises:
            MotionError: The arm has not acknowledged it.
        """
        if self._commanded is None:
            return
        if self._link.others.heard_lately() and self._link.others.is_free:
            self._commanded = None  # whoever freed the arm may have a hand in it
            return
        if not any(self._against.values()) and time.monotonic() - self._awake < ASLEEP:
            stop = self._following.resting_place(*self._commanded, self._gate.velocity)
            self._publish(stop)
        self._commanded = None
        self._link.hold.send()
        if not self._link.hold.settle():
            raise MotionError("hold was not acknowledged: check that the arm holds")

    def _command(self, position: Array, velocity: Array) -> None:
        """Send the arm somewhere, unless anything speaks against it."""
        self._check()
        self._following.check(position, velocity, first=self._commanded is None)
        self._commanded = position, velocity
        self._publish(position, velocity)

    def _publish(self, position: Array, velocity: Array | None = None) -> None:
        stamp = self._client.node.get_clock().now().to_msg()
        at_rest = np.zeros(self._arm.n)
        self._link.publish(
            (stamp.sec, stamp.nanosec), position, at_rest if velocity is None else velocity
        )

    def _listen_until(self, when: float) -> None:
        time.sleep(max(0.0, when - time.monotonic()))
        self._catch_up()

    def _catch_up(self) -> None:
        """Take all that has arrived.

        Not through the executor: it looks at everything anew for each message, which at 1 kHz costs
        a busy machine more than there is.
        """
        for subscription in list(self._client.node.subscriptions):
            for _ in range(_QUEUE):
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                if taken is None:
                    break
                subscription.callback(*taken[: 2 if subscription is self._input else 1])
        self._client.spin_once(0.0)
        now = time.monotonic()
        if self._commanded is not None and now - self._awake > ASLEEP:
            self._against["pause"] = f"this process stood still for {now - self._awake:.1f} s"
        self._awake = now

    def _check(self) -> None:
        """Raise for whatever speaks against commanding the arm now."""
        if self.interrupted:
            raise KeyboardInterrupt
        now = time.monotonic()
        if now >= self._next_look:
            self._next_look = now + LOOK
            self._against |= self._link.look(self._commanded is not None, measuring=True)
            if not self._link.rivals.heard_lately():
                self._against["rivals"] = ""
        reason = next(filter(None, self._against.values()), "")
        if reason:
            raise MotionError(reason)
        if self._gate.silence(now, self._timeout):
            # It may be we who did not listen: what has arrived meanwhile counts.
            self._catch_up()
            silence = self._gate.silence(time.monotonic(), self._timeout)
            if silence:
                why = f" ({self._dropped})" if self._dropped else ""
                raise MotionError(
                    f"{self.topic}: {silence}{why}; more with --timeout, where it is this computer "
                    "that is busy"
                )

    def _on_measured(self, data: bytes, info: Mapping[str, Any]) -> None:
        several = self._link.two_measure(info)
        if self._sink is not None:
            self._sink(data)
        if several:
            self._against["measured_js"] = several
            return
        node: Node = self._client.node
        moved = self._commanded is not None
        oldest = 0.0 if moved else STAMP_AGE
        try:
            sample, _ = self._link.read(data)
            accepted = self._gate.admit(
                sample, time.monotonic(), node.get_clock().now().nanoseconds, self._timeout,
                oldest, moved,
            )  # fmt: skip
        except DroppedSampleError as error:
            self._dropped = f"{error.cause}: {error}"
            if moved and error.cause == "position_jump":  # the servo may pull it back unnoticed
                self._against["position_jump"] = f"{self.topic}: {error}"
        else:
            self._following.add(accepted.sample)
            self._dropped = ""

    def _on_other(self) -> None:
        self._against["others"] = self._link.others.reason()

    def _on_rival(self) -> None:
        self._against["rivals"] = self._link.rivals.reason()

    def _on_state(self, reason: str) -> None:
        self._against["operating_state"] = reason
