"""An arm behind ROS topics, as a calibration moves and releases it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.listening import on_position
from dvrk_gravity.ros.mover import TIMEOUT, Mover
from dvrk_gravity.ros.presence import simulator_of
from dvrk_gravity.ros.processes import NodeProcess, ProcessError

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
        arm, way, heard = self._arm, np.zeros(len(pose)), -math.inf
        given: dict[str, Any] = {
            "enabled": "true", "disable_builtin": "true", "timeout": self._timeout,
        }  # fmt: skip
        if self.simulated:
            given["max_stamp_age"] = 0.0
        words = ["--params-file", str(model), *_words(given)]
        watching = _words({"watchdog_timeout": self._timeout})
        with Client(self._namespace, "calibrate_release") as client:

            def measured(position: Array) -> None:
                nonlocal way, heard
                way, heard = np.maximum(way, np.abs(position - pose)), time.monotonic()

            # From where it was held: what it falls before it is known to be released counts.
            on_position(client, arm, measured)
            client.watch_state("compensator")
            with (
                NodeProcess("watchdog", *watching, namespace=self._namespace, of_arm=True),
                NodeProcess(
                    "compensator", *words, namespace=self._namespace, of_arm=True
                ) as compensator,
            ):

                def commands() -> bool:
                    return client.state("compensator").startswith("commanding")

                def settled() -> bool:
                    ended = compensator.process.poll() is not None
                    return commands() or ended or client.state("compensator").startswith("fault")

                try:
                    client.wait(settled, "the compensator to command", _STARTS)
                except ProcessError as error:
                    raise MotionError(f"{error}: {client.state('compensator')}") from None
                begun = time.monotonic()
                while time.monotonic() < begun + seconds and (way < AWAY * arm.scale).all():
                    client.spin(0.05)
                    if not commands():
                        why = client.state("compensator") or compensator.output[-300:]
                        raise MotionError(f"the compensator stopped: {why}")
                    if time.monotonic() - heard > DEAF:
                        raise MotionError(
                            f"released, no measured_js was heard for {DEAF:g} s: how far it "
                            "drifted is not known"
                        )
            self._note_simulator(client.node)
        return way

    def _note_simulator(self, node: Node) -> None:
        """Note that it is no arm if our simulator measures in its namespace, by any name."""
        found = simulator_of(node)
        if found and not self.simulated:
            self.simulated = f"the node {found}"


def _words(parameters: Mapping[str, Any]) -> list[str]:
    return [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
