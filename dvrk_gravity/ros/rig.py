"""An arm behind ROS topics, as a calibration moves and releases it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import UNWATCHED, MotionError, Sample
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.listening import on_sample
from dvrk_gravity.ros.mover import TIMEOUT, Mover
from dvrk_gravity.ros.presence import simulator_of
from dvrk_gravity.ros.processes import NodeProcess, ProcessError
from dvrk_gravity.ros.runtime import catch_end_signals

# An arm that has gone so far, rad (Arm.scale), drifts: it is held. Chosen: ten times what a
# certificate allows, and less than what a hand beside the arm would be hurt by.
AWAY = float(np.radians(5.0))
# Without a measurement that is believed for so long its drift is not known, s. Chosen: the
# compensator, which hears them itself, has ended long before where there are none.
DEAF = 0.5
_RATE = 200.0  # set points per second
_STARTS = 30.0  # s, that a compensator may take until it commands


class RosRig:
    """An arm behind ROS topics, one compensator process for each release.

    Attributes:
        simulated: In words; ``""``: it is an arm.
        friction: Part of its friction that it has while it is released.
        resumes: Always: a motion that was stopped goes on where it was.
    """

    resumes = True

    def __init__(
        self,
        arm: Arm,
        namespace: str,
        timeout: float = TIMEOUT,
        simulated: str = "",
        friction: float = 1.0,
    ) -> None:
        """Store the arguments; nothing is started.

        Args:
            arm: The arm.
            namespace: Of its topics.
            timeout: Without measurements, or commands, for so long it is held, s.
            simulated: What is simulated behind the topics, in words; its clock may lag.
            friction: Part of its friction that it has.
        """
        self.simulated, self.friction = simulated, friction
        self._arm, self._namespace, self._timeout = arm, namespace, timeout
        self._mover: Mover | None = None

    @property
    def interrupted(self) -> bool:
        """Whether a signal has asked for the end while the arm could be moved."""
        return self._mover is not None and self._mover.interrupted

    @contextmanager
    def driver(self) -> Iterator[Mover]:
        """Yield what moves it."""
        with (
            Client(self._namespace, "calibrate") as client,
            Mover(client, self._arm, _RATE, self._timeout) as mover,
        ):
            self._mover = mover
            yield mover
            self._note_simulator(client.node)

    def release(self, model: Path, pose: Array, seconds: float) -> Array:
        """Release it where it is held: :meth:`dvrk_gravity.calibration.Rig.release`.

        A joint that has gone away by :data:`AWAY` ends it early. The compensator holds the arm when
        it ends; if it is killed, the watchdog does.
        """
        drift, asked = _Drift(self._arm, pose), list[bool]()
        given: dict[str, Any] = {
            "enabled": "true", "disable_builtin": "true", "timeout": self._timeout,
        }  # fmt: skip
        if self.simulated:
            given["max_stamp_age"] = 0.0
        of_model = ("--params-file", str(model))
        watching = {"watchdog_timeout": self._timeout}
        with (
            # Suspended (Ctrl-Z), we would leave it released; a second Ctrl-C would end its holding.
            catch_end_signals(lambda: asked.append(True)),
            Client(self._namespace, "calibrate_release") as client,
        ):
            # From where it was held: what it falls before it is known to be released counts.
            on_sample(client, self._arm, drift.add)
            client.watch_state("compensator")
            with (
                NodeProcess(
                    "watchdog", namespace=self._namespace, of_arm=True, parameters=watching
                ) as watchdog,
                NodeProcess(
                    "compensator",
                    *of_model,
                    namespace=self._namespace,
                    of_arm=True,
                    parameters=given,
                ) as compensator,
            ):

                def ended() -> str:
                    """Return why it is not, or not safely, compensated any more, ``""``: it is."""
                    for node in (watchdog, compensator):
                        if node.process.poll() is not None:
                            return f"the {node.verb} has ended: {node.output[-300:]}"
                    state = client.state("compensator")
                    return f"the compensator stopped: {state}" if state.startswith("fault") else ""

                def commands() -> bool:
                    state = client.state("compensator")
                    return state.startswith("commanding") and UNWATCHED not in state

                try:
                    client.wait(
                        lambda: bool(asked or commands() or drift.away or ended()),
                        "the compensator to command", _STARTS,
                    )  # fmt: skip
                except ProcessError as error:
                    raise MotionError(f"{error}: {client.state('compensator')}") from None
                client.watch_state("watchdog")  # from now on: another one may have held it before
                begun, first = time.monotonic(), drift.clock
                drift.silence = 0.0
                # Of its own clock, too: that of a simulated arm may be slow.
                while (
                    not drift.away and min(time.monotonic() - begun, drift.clock - first) < seconds
                ):
                    if asked:
                        raise KeyboardInterrupt
                    client.spin(0.05)
                    if why := ended():
                        raise MotionError(why)
                    # A compensator that stands still does not say so.
                    if (watched := client.state("watchdog")).startswith("hold sent"):
                        raise MotionError(f"the watchdog holds the arm: {watched}")
                    if not commands():
                        raise MotionError(f"the compensator stopped: {client.state('compensator')}")
                    if max(drift.silence, time.monotonic() - drift.heard) > DEAF:
                        raise MotionError(
                            f"released, no measured_js was heard for {DEAF:g} s: how far it "
                            "drifted is not known"
                        )
            self._note_simulator(client.node)
        if status := compensator.process.returncode:
            raise MotionError(
                f"the compensator ended with status {status}: check that the arm holds: "
                f"{compensator.output[-300:]}"
            )
        if asked:
            raise KeyboardInterrupt
        return drift.way

    def _note_simulator(self, node: Node) -> None:
        """Note that it is no arm if our simulator measures in its namespace, by any name."""
        found = simulator_of(node)
        if found and not self.simulated:
            self.simulated = f"the node {found}"


class _Drift:
    """How far a released arm has gone.

    Attributes:
        way: (n,) largest way of each joint, rad or m.
        heard: When it was last heard, monotonic, s.
        silence: Longest time between two measurements, s.
        clock: Its own clock, s.
    """

    def __init__(self, arm: Arm, pose: Array) -> None:
        self._pose, self._away = pose, AWAY * arm.scale
        self.way = np.zeros(len(pose))
        self.heard, self.silence, self.clock = -math.inf, 0.0, 0.0

    def add(self, sample: Sample) -> None:
        """Take a measurement in."""
        now = time.monotonic()
        self.way = np.maximum(self.way, np.abs(sample.position - self._pose))
        self.silence = max(self.silence, now - self.heard)
        self.heard, self.clock = now, 1e-9 * sample.stamp

    @property
    def away(self) -> bool:
        """Whether it is to be held."""
        return bool((self.way >= self._away).any())
