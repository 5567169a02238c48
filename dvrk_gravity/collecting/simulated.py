"""A driver of a plant in this process: no ROS, and faster than real time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting.driver import Path, Watch, hold_on_error
from dvrk_gravity.compensate import (
    CommandRefusedError,
    DroppedSampleError,
    FollowingErrorCheck,
    InputGate,
    MotionError,
    Sample,
    require_within,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import encode_joint_state
from dvrk_gravity.simulate import ModelArm, PlantFile, SimulatedArm, initial_position

STEP = 1e-3  # s, of the plant
# Without measured_js for so long the arm is held, s, and it is listened to for so long at first; as
# the driver of a real one does.
TIMEOUT, LISTEN = 0.1, 1.0
_BLOCK = 200  # set points evaluated at a time


class SimulatedDriver:
    """Moves a simulated arm as :class:`dvrk_gravity.ros.Mover` moves a real one.

    Set points go through the simulated console's servo, and measurements through the same checks
    as those of a real arm.

    Attributes:
        topic: Full name of the ``measured_js`` that is recorded.
        arm: The simulated arm.
        disturb: Called before every step of the plant, with the arm: a hand, a fault.
        heard: Whether measurements arrive.
    """

    def __init__(
        self,
        plant: TorqueModel | PlantFile,
        *,
        rate: float = 200.0,
        seed: int = 1,
        at: Array | None = None,
        topic: str = "",
    ) -> None:
        """Switch an arm on.

        Args:
            plant: The truth. Of a model: bodies that can exist, and the sensors of its arm's plant.
            rate: Set points and measurements per second: a whole part of 1000.
            seed: Of the sensors' noise.
            at: (n,) initial position, rad or m; ``None``: the simulator's.
            topic: Where measurements are recorded; ``""``: the arm's ``measured_js``.

        Raises:
            ConfigError: A rate that the steps do not divide into, or inertia that is no arm's.
        """
        self._every = round(1.0 / (rate * STEP)) if rate > 0.0 else 0
        if self._every < 1 or abs(self._every * rate * STEP - 1.0) > 1e-6:
            raise ConfigError("rate", rate, "1000 Hz divided by a whole number")
        if isinstance(plant, PlantFile):
            body, sensors = plant.plant(), plant.sensors
        else:
            body, sensors = ModelArm.of(plant).plant(), PlantFile.of(plant.arm).sensors
        arm = body.model.arm
        body.reset(initial_position(arm) if at is None else at)
        self.topic = topic or f"/{arm.name.upper()}/measured_js"
        self.arm = SimulatedArm(body, sensors, seed, dt=STEP)
        self.disturb: Callable[[SimulatedArm], None] = lambda arm: None
        self.heard = True
        self._type, self._rate = arm, rate
        self._start_ns = time.time_ns()
        self._gate, self._following = InputGate(arm), FollowingErrorCheck(arm)
        self._commanded: tuple[Array, Array] | None = None  # position and velocity
        self._moment = 0.0  # of the set point, on its path, s

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """Hold the arm if it was moved."""
        self.hold()

    def connect(self) -> Array:
        """Listen to the arm, and return its (n,) rest position, rad or m.

        Raises:
            MotionError: It moves, or is outside its limits.
        """
        heard = []
        for _ in range(round(LISTEN * self._rate)):
            self._listen(None, None)
            if self._following.last is None:
                raise MotionError(f"{self.topic}: no arm: nothing publishes it")
            heard.append(self._following.position)
        try:
            position = self._following.rest_position(np.array(heard))
            require_within(self._type, position)
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
        """Drive the arm along a path: :meth:`Driver.follow`."""
        moments = np.append(np.arange(0.0, duration, 1.0 / self._rate), duration)
        with hold_on_error(self.hold):
            for start in range(0, len(moments), _BLOCK):
                block = moments[start : start + _BLOCK]
                position, velocity, _ = path(block)
                for moment, *states in zip(block.tolist(), position, velocity, strict=True):
                    self._command(*states)
                    self._moment = moment
                    if progress is not None:
                        progress(moment / duration if duration else 1.0)
                    if moment < duration:
                        self._listen(record, watch)
        return (len(moments) - 1) / self._rate - duration

    def hold(self) -> bool:
        """Hold the arm where it comes to rest, if it was moved: :meth:`Driver.hold`."""
        if self._commanded is None:
            return False
        self.arm.servo_jp(
            self._following.resting_place(*self._commanded, self._gate.motion.velocity)
        )
        self._commanded = None
        for _ in range(round(LISTEN * self._rate)):  # until it rests
            self._listen(None, None)
        self.arm.hold()
        return True

    def _command(self, position: Array, velocity: Array) -> None:
        """Send a set point, unless anything forbids it."""
        silence = self._gate.silence(self.arm.plant.time, TIMEOUT)
        if silence:
            raise MotionError(f"{self.topic}: {silence}")
        self._following.check(position, velocity, first=self._commanded is None)
        self._commanded = position, velocity
        self.arm.servo_jp(position)

    def _listen(self, record: Callable[[bytes], None] | None, watch: Watch | None) -> None:
        """Let time pass until the next measurement, and take it."""
        arm = self.arm
        for _ in range(self._every):
            self.disturb(arm)
            arm.step()
            measured = arm.measure()
        if not self.heard:
            return
        stamp = self._start_ns + round(measured.time * 1e9)
        sample = Sample(stamp, measured.position, measured.velocity, measured.effort)
        if record is not None:
            read = self._type.reading_of_torque(measured.effort)
            fields = (field.tolist() for field in (measured.position, measured.velocity, read))
            record(encode_joint_state(stamp, self._type.joint_names, *fields))
        active = self._commanded is not None
        try:
            believed = self._gate.admit(sample, measured.time, stamp, TIMEOUT, 0.0, active)
        except DroppedSampleError as error:
            if active and error.cause == "position_jump":
                raise MotionError(f"{self.topic}: {error}") from error
            return
        self._following.add(believed)
        if watch is not None and self._commanded is not None:
            watch(believed, self._moment)
