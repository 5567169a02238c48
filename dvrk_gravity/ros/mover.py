"""Moves an arm along a path through ROS, and stops it when anything is not as it should be."""

from __future__ import annotations

import secrets
import signal
import struct
import time
from array import array
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.processes import ProcessError
from dvrk_gravity.ros.arm_link import ArmLink
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.hold import Hold
from dvrk_gravity.ros.others import COMMANDS, named

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

FOLLOWING_ERROR = np.radians(8.0)
"""How far an arm that is no MTM may be from where it was told to be, rad (see Arm.scale): as the
first joints of one."""

LAG = 0.15
"""How late the arm may be there, s, beside the time for which it may be silent: servos lag by some
0.05 s, the simulated one by 0.08 s."""

OUTSIDE = np.radians(20.0)
"""How far outside its limits an arm may read: more, and it is not the arm that was named, rad."""

# The stamp, after the four bytes with which CDR data begin.
_STAMP = struct.Struct("<iI")

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
        self._delay = LAG + timeout
        self._following_error = (
            mtm.defaults.FOLLOWING_ERROR if mtm.is_mtm(arm) else FOLLOWING_ERROR * arm.scale
        )
        node = client.node
        self._servo = node.create_publisher(JointState, "servo_jp", 10)
        self._link = ArmLink(node, any_subscriber=False)
        self._hold = Hold(node, self._link.listens)
        self._mark = f"excite {secrets.token_hex(4)}"
        self._mark_bytes = self._mark.encode()
        self._measured = b""
        self._heard_arm = -np.inf
        self._stamp = 0  # of the last measurement, ns
        self._foreign = ""  # topic of somebody else's command
        self._sink: Callable[[bytes], None] | None = None
        self._told: deque[tuple[float, Array]] = deque()
        self._moved = False
        self.interrupted = False
        self._measured_sub = node.create_subscription(
            JointState, "measured_js", self._on_measured, _QUEUE, raw=True
        )
        self._subscriptions = [self._measured_sub] + [
            node.create_subscription(kind, topic, self._listener(topic), 10, raw=True)
            for topic, kind in COMMANDS
        ]

    def __enter__(self) -> Mover:
        """Take Ctrl-C and SIGTERM in hand."""

        def interrupt(*_: object) -> None:
            self.interrupted = True

        numbers = (signal.SIGINT, signal.SIGTERM)
        self._before = {number: signal.signal(number, interrupt) for number in numbers}
        return self

    def __exit__(self, *_: object) -> None:
        """Hold the arm if it was moved, and give the signals back."""
        try:
            self.hold()
        finally:
            for number, handler in self._before.items():
                signal.signal(number, handler)

    @property
    def topic(self) -> str:
        """Full name of the measurements' topic."""
        return str(self._measured_sub.topic_name)

    def connect(self, timeout: float = 10.0) -> Array:
        """Wait for the arm, listen whether somebody commands it, and return (n,) where it is, rad.

        Raises:
            MotionError: No arm, another one, or one that somebody else commands.
        """
        try:
            self._client.wait(
                lambda: (
                    self.interrupted
                    or (
                        bool(self._measured)
                        and self._client.connected(self._servo)
                        and self._link.listens()
                    )
                ),
                "the arm",
                timeout,
            )
        except ProcessError:
            missing = (
                "nothing takes servo_jp and hold" if self._measured else "nothing publishes it"
            )
            raise MotionError(
                f"{self.topic}: waited {timeout:g} s in vain for the arm: {missing}; is its "
                "console on, and is this its namespace?"
            ) from None
        end = time.monotonic() + LISTEN
        while time.monotonic() < end:
            self._listen_until(time.monotonic() + 1.0 / self._rate)
            self._check()
        position = self._position()
        beyond = np.maximum(self._arm.lower - position, position - self._arm.upper)
        worst = int(np.argmax(beyond / self._arm.scale))
        if beyond[worst] > OUTSIDE * self._arm.scale[worst]:
            joint = self._arm.joints[worst]
            raise MotionError(
                f"{self.topic}: {joint.name} is at "
                f"{joint.shown(position[worst])}, {joint.shown(beyond[worst])} "
                f"outside the limits of {self._arm.name}: the other hand's arm?"
            )
        return position

    def follow(
        self,
        path: Path,
        duration: float,
        record: Callable[[bytes], None] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> float:
        """Drive the arm along a path in its own time; whatever ends that early holds the arm.

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
        self._catch_up()
        period, moment, first = 1.0 / self._rate, 0.0, self._stamp
        start = last = time.monotonic()
        self._told.clear()
        self._sink = record
        try:
            while moment < duration:
                self._check()
                self._command(*path(moment))
                self._check_following()
                if progress is not None:
                    progress(moment / duration)
                # On a grid of instants, so that the rate is kept whatever one round took.
                self._listen_until(start + (int((last - start) / period) + 1) * period)
                now = time.monotonic()
                moment = min(moment + min(now - last, LATE), (self._stamp - first) * 1e-9 + AHEAD)
                last = now
            self._command(*path(duration))
            return (self._stamp - first) * 1e-9 - duration
        except MotionError as error:
            self.hold()
            raise MotionError(f"{error}; the arm was told to hold") from error
        except BaseException:
            self.hold()
            raise
        finally:
            self._sink = None

    def hold(self) -> None:
        """Hold the arm, if it was moved.

        Raises:
            MotionError: The arm has not acknowledged it.
        """
        if self._moved:
            self._moved = False
            self._hold.send()
            if not self._hold.settle():
                raise MotionError("hold was not acknowledged: check that the arm holds")

    def _command(self, position: Array, velocity: Array) -> None:
        message = JointState(name=self._arm.joint_names)
        message.header.stamp = self._client.node.get_clock().now().to_msg()
        message.header.frame_id = self._mark
        message.position = array("d", position.tobytes())
        message.velocity = array("d", velocity.tobytes())
        self._moved = True
        self._servo.publish(message)
        now = time.monotonic()
        self._told.append((now, position))
        # One that is older than the delay stays: it was in force until the next one.
        while len(self._told) > 1 and self._told[1][0] < now - self._delay:
            self._told.popleft()

    def _listen_until(self, when: float) -> None:
        time.sleep(max(0.0, when - time.monotonic()))
        self._catch_up()

    def _catch_up(self) -> None:
        """Take all that has arrived.

        Not through the executor: it looks at everything anew for each message, which at 1 kHz costs
        a busy machine more than there is.
        """
        for subscription in self._subscriptions:
            for _ in range(_QUEUE):
                taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                subscription.callback(taken[0])
        self._client.spin_once(0.0)

    def _check(self) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        if self._foreign:
            node = self._client.node
            topic = node.resolve_topic_name(self._foreign)
            who = named(node.get_publishers_info_by_topic(topic), node)
            raise MotionError(
                f"another node{who} sends {self._foreign}: stop it first, two would fight"
            )
        if time.monotonic() - self._heard_arm > self._timeout:
            # It may be we who did not listen: what has arrived meanwhile counts.
            self._catch_up()
            silent = time.monotonic() - self._heard_arm
            if silent > self._timeout:
                raise MotionError(
                    f"{self.topic}: nothing valid for {1e3 * silent:.0f} ms, at most "
                    f"{1e3 * self._timeout:.0f} allowed (more with --timeout, where it is this "
                    "computer that is busy)"
                )

    def _check_following(self) -> None:
        told = np.array([position for _, position in self._told])
        position = self._position()
        error = np.maximum(told.min(axis=0) - position, position - told.max(axis=0))
        worst = int(np.argmax(error / self._following_error))
        if error[worst] > self._following_error[worst]:
            joint = self._arm.joints[worst]
            raise MotionError(
                f"{joint.name} is {joint.shown(error[worst], 1)} from where "
                f"it was told to be in the last {self._delay:g} s, at most "
                f"{joint.shown(self._following_error[worst])} allowed: something is in its way, or "
                "the console does not let it move"
            )

    def _position(self) -> Array:
        message = deserialize_message(self._measured, JointState)
        index = {name: i for i, name in enumerate(message.name)}
        missing = [name for name in self._arm.joint_names if name not in index]
        if missing or len(message.position) != len(message.name):
            raise MotionError(
                f"{self.topic}: expected a position of each of {', '.join(self._arm.joint_names)}"
            )
        position = np.array([message.position[index[name]] for name in self._arm.joint_names])
        if not np.isfinite(position).all():
            raise MotionError(f"{self.topic}: positions are not finite: {position.tolist()}")
        return position

    def _on_measured(self, data: bytes) -> None:
        sec, nanosec = _STAMP.unpack_from(data, 4)
        stamp = sec * 1_000_000_000 + nanosec
        # No stamp marks invalid data; an old one, a console that repeats itself.
        if stamp > self._stamp:
            self._measured, self._heard_arm, self._stamp = data, time.monotonic(), stamp
        if self._sink is not None:
            self._sink(data)

    def _listener(self, topic: str) -> Callable[[bytes], None]:
        def hear(data: bytes) -> None:
            if self._mark_bytes not in data:
                self._foreign = topic

        return hear
