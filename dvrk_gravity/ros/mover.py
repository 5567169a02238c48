"""Moves an arm along a path through ROS, and stops it when anything is not as it should be."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.compensate.input_gate import InputGate
from dvrk_gravity.compensate.sample import DroppedSampleError, Sample
from dvrk_gravity.compensate.start import StartRefusedError, require_within
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.processes import ProcessError
from dvrk_gravity.ros.arm_link import MEASURED, ArmLink
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.command_topic import CommandTopic
from dvrk_gravity.ros.ending import asked_to_end

Array = NDArray[np.float64]
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

FOLLOWING_ERROR = np.radians(8.0)
"""How far an arm that is no MTM may be from where it is told to go, rad (see Arm.scale), beside its
lag: as the first joints of one."""

LAG = 0.1
"""How late the arm may be there, s: servos lag by some 0.05 s, the simulated one by 0.08 s, and a
measurement is up to 0.01 s old."""

STILL = np.radians(1.0)
"""How far an arm at rest may move in half of the time of listening, and until the first command,
rad (see Arm.scale). Chosen: encoders' noise is a tenth of it."""

MOST_OF_RANGE = 0.25
"""Part of a joint's range that it may be from where it is told to go at most. Chosen: a joint with
a small range that does not move at all is noticed, too."""

ASLEEP = 0.5
"""After a pause of ours of so long, s, the arm may be somewhere else, or somebody else's: what was
measured before says nothing any more."""

STAMP_AGE = 10.0
"""Farthest stamp from this computer's clock, s, before anything moves: a recording that is played
is days old. The clock of a simulated arm whose machine is slow falls behind by seconds."""

AGREE = 5
"""So many readings in a row have to agree before the arm is stopped where they say. Chosen: two
nodes that measure, or an encoder that slips, are noticed within three."""

# Measurements that may wait for us, a second and more of them: none is to be lost to the recording.
_QUEUE = 2000


class MotionError(DvrkGravityError):
    """The arm could not be moved, or was stopped on its way."""


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
        error = mtm.defaults.FOLLOWING_ERROR if mtm.is_mtm(arm) else FOLLOWING_ERROR * arm.scale
        lower, upper = arm.range
        self._following_error = np.minimum(error, MOST_OF_RANGE * (upper - lower))
        self._link = ArmLink(
            client.node,
            arm,
            CommandTopic.positions(),
            on_other=self._on_other,
            on_rival=self._on_rival,
            on_state=self._on_state,
        )
        self._gate = InputGate(arm)
        self._last: Sample | None = None  # the last measurement that is believed
        self._recent: deque[Sample] = deque(maxlen=AGREE)  # the last of those
        self._awake = time.monotonic()  # when we last listened
        self._dropped = ""  # why the last one was not
        self._against: dict[str, str] = {}  # by cause, why the arm must not be commanded
        self._next_look = 0.0
        self._sink: Callable[[bytes], None] | None = None
        # (n,) position and velocity that the arm was told last, until it is held.
        self._told: tuple[Array, Array] | None = None
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
                lambda: self.interrupted or (self._last is not None and self._link.is_connected()),
                "the arm",
                timeout,
            )
        except ProcessError:
            missing = (
                "nothing takes servo_jp and hold"
                if self._last is not None
                else self._dropped or "nothing publishes it"
            )
            raise MotionError(
                f"{self.topic}: waited {timeout:g} s in vain for the arm: {missing}; is its "
                "console on, and is this its namespace (--namespace)?"
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
            heard.append(self._position())
        return self._at_rest(np.array(heard))

    def _at_rest(self, heard: Array) -> Array:
        """Return the (n,) median of (N, n) positions: a single wrong reading does not count."""
        joints, scale = self._arm.joints, self._arm.scale
        early, late = (np.median(part, axis=0) for part in np.array_split(heard, 2))
        moved = np.abs(late - early)
        worst = int(np.argmax(moved / scale))
        if not moved[worst] <= STILL * scale[worst]:
            raise MotionError(
                f"{self.topic}: {joints[worst].name} moves by {joints[worst].shown(moved[worst])} "
                "while nobody is to move it: let the arm rest, or stop what moves it"
            )
        position: Array = np.median(heard, axis=0)
        try:
            require_within(self._arm, position)
        except StartRefusedError as error:
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
            self.hold()
            raise MotionError(f"{error}; the arm was told to hold") from error
        except BaseException:
            self.hold()
            raise
        finally:
            self._sink = None

    def _stream(
        self, path: Path, duration: float, progress: Callable[[float], None] | None
    ) -> float:
        period, moment, first = 1.0 / self._rate, 0.0, self._stamp()
        start = last = time.monotonic()
        while moment < duration:
            self._command(*path(moment))
            if progress is not None:
                progress(moment / duration)
            # On a grid of instants, so that the rate is kept whatever one round took.
            self._listen_until(start + (int((last - start) / period) + 1) * period)
            now = time.monotonic()
            moment = min(moment + min(now - last, LATE), self._stamp() - first + AHEAD)
            last = now
        self._command(*path(duration))
        return self._stamp() - first - duration

    def hold(self) -> None:
        """Hold the arm where it comes to rest, if it was moved.

        A console's hold keeps the set point: an arm that did not follow would press on for ever.
        Where the last readings contradict each other the set point is the safer place: it is no
        further from the arm than a command may be.

        Raises:
            MotionError: The arm has not acknowledged it.
        """
        if self._told is None:
            return
        if self._link.others.heard_lately() and self._link.others.is_free:
            self._told = None  # whoever freed the arm may have a hand in it
            return
        if not any(self._against.values()) and time.monotonic() - self._awake < ASLEEP:
            self._publish(self._resting_place(*self._told))
        self._told = None
        self._link.hold.send()
        if not self._link.hold.settle():
            raise MotionError("hold was not acknowledged: check that the arm holds")

    def _resting_place(self, told: Array, velocity: Array) -> Array:
        """Return (n,) where an arm that follows comes to rest, by its lag; one that is stuck, is.

        Of a joint whose last readings differ by more than its motion: where it was told to be.

        Args:
            told: (n,) where it was told to go last: it does not go beyond.
            velocity: (n,) how fast.
        """
        recent = np.array([sample.position for sample in self._recent])
        measured, ahead = np.median(recent, axis=0), told - np.median(recent, axis=0)
        way = LAG * self._gate.velocity
        place = measured + np.clip(way, np.minimum(ahead, 0.0), np.maximum(ahead, 0.0))
        span = 1e-9 * (self._recent[-1].stamp - self._recent[0].stamp)
        agree = np.ptp(recent, axis=0) < 0.5 * self._following_error + span * np.abs(velocity)
        return np.where(agree, place, told)

    def _command(self, position: Array, velocity: Array) -> None:
        """Send the arm somewhere, unless anything speaks against it."""
        self._check()
        self._check_lead(position, velocity)
        self._told = position, velocity
        self._publish(position, velocity)

    def _publish(self, position: Array, velocity: Array | None = None) -> None:
        stamp = self._client.node.get_clock().now().to_msg()
        at_rest = np.zeros(self._arm.n)
        self._link.publish(
            (stamp.sec, stamp.nanosec), position, at_rest if velocity is None else velocity
        )

    def _check_lead(self, position: Array, velocity: Array) -> None:
        """Refuse to command (n,) what is too far from where the arm is, rad and rad/s."""
        error = np.abs(position - self._position())
        allowed = self._following_error + LAG * np.abs(velocity)
        if self._told is None:  # the arm has rested since it was listened to
            allowed = 2.0 * STILL * self._arm.scale
        worst = int(np.argmax(error / allowed))
        if not error[worst] <= allowed[worst]:
            joint = self._arm.joints[worst]
            raise MotionError(
                f"{joint.name} is {joint.shown(error[worst], 1)} from where it is told to go, at "
                f"most {joint.shown(allowed[worst], 1)} allowed at this speed: something is in its "
                "way, or the console does not let it move"
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
        if self._told is not None and now - self._awake > ASLEEP:
            self._against["pause"] = f"this process stood still for {now - self._awake:.1f} s"
        self._awake = now

    def _check(self) -> None:
        """Raise for whatever speaks against commanding the arm now."""
        if self.interrupted:
            raise KeyboardInterrupt
        now = time.monotonic()
        if now >= self._next_look:
            self._next_look = now + LOOK
            self._against |= self._link.look(self._told is not None, measuring=True)
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

    def _position(self) -> Array:
        """(n,) where the arm was last, rad or m."""
        assert self._last is not None  # connect has waited for it
        return self._last.position

    def _stamp(self) -> float:
        """Return the arm's own time, s."""
        assert self._last is not None
        return self._last.stamp * 1e-9

    def _on_measured(self, data: bytes, info: Mapping[str, Any]) -> None:
        several = self._link.two_measure(info)
        if self._sink is not None:
            self._sink(data)
        if several:
            self._against["measured_js"] = several
            return
        node: Node = self._client.node
        moved = self._told is not None
        oldest = 0.0 if moved else STAMP_AGE
        try:
            sample, _ = self._link.read(data)
            self._last = self._gate.admit(
                sample, time.monotonic(), node.get_clock().now().nanoseconds, self._timeout,
                oldest, moved,
            ).sample  # fmt: skip
        except DroppedSampleError as error:
            self._dropped = f"{error.cause}: {error}"
            if moved and error.cause == "position_jump":  # the servo may pull it back unnoticed
                self._against["position_jump"] = f"{self.topic}: {error}"
        else:
            self._recent.append(self._last)
            self._dropped = ""

    def _on_other(self) -> None:
        self._against["others"] = self._link.others.reason()

    def _on_rival(self) -> None:
        self._against["rivals"] = self._link.rivals.reason()

    def _on_state(self, reason: str) -> None:
        self._against["operating_state"] = reason
