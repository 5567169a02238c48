"""The arm as its console presents it: modes, position servo, compensation, efforts that last."""

from __future__ import annotations

import enum
from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.planning import Move, careful_limits
from dvrk_gravity.simulate.plant import Plant
from dvrk_gravity.simulate.sensors import SensorReader, Sensors

# Four equal lags: positions that come as steps, 1 rad/s at 100 Hz, leave the servo accelerations of
# 0.02 rad/s^2 at that frequency, a hundredth of an exciting motion's; two lags leave 10 rad/s^2.
LAGS = 4
# Time constant of each, s. Together 80 ms behind the commands: industrial controllers that take
# streamed positions look ahead by 30 to 200 ms for the same purpose (UR's `servoj`).
TIME_CONSTANT = 0.02


class SetPointFilter:
    """A low-pass of equal lags, exact for commands that stay until the next one comes.

    The simulated servo is far stiffer than a real MTM's. Given steps as they come it would answer
    each with a blow of torque, too short for a recording to separate from the motion's own.
    Behind this filter the set point is smooth at any rate of the commands, and however unevenly
    they come.
    """

    def __init__(self, start: Array, dt: float) -> None:
        """Begin at rest.

        Args:
            start: (n,) position, rad.
            dt: Time between two calls of :meth:`step`, s.
        """
        from scipy.linalg import expm  # slow to load

        rates = (np.eye(LAGS, k=-1) - np.eye(LAGS)) / TIME_CONSTANT
        self._carry = expm(rates * dt)
        self._take = (1.0 - self._carry.sum(axis=1))[:, None]
        self._state = np.tile(start, (LAGS, 1))

    @property
    def position(self) -> Array:
        """(n,) position that it is at, rad."""
        return self._state[-1]

    def step(self, command: Array) -> tuple[Array, Array]:
        """Go one step on; return (n,) position, rad, and (n,) velocity, rad/s."""
        self._state = self._carry.dot(self._state) + self._take * command
        position = self._state[-1]
        return position, (self._state[-2] - position) / TIME_CONSTANT


# The servo's closed loop is critically damped with this natural frequency, rad/s.
_SERVO_FREQUENCY = 100.0


class Mode(enum.Enum):
    """What drives the motors."""

    HOLD = "hold"
    POSITION = "position"
    EFFORT = "effort"


class Measurement(NamedTuple):
    """One reading of the sensors.

    Attributes:
        time: Simulated time, s.
        position: (n,) rad.
        velocity: (n,) rad/s.
        effort: (n,) torque of the actuators in joint space, N·m.
    """

    time: float
    position: Array
    velocity: Array
    effort: Array


class SimulatedArm:
    """An arm with its console: what one may command it, and what it does about it.

    Starts in hold. In effort mode the last effort stays applied for ever: nothing here watches
    how old it is. The built-in compensation adds its torque to commanded efforts while it is
    on. The position servo always carries the arm's weight, whether or not the compensation of
    effort commands is on. Motor torques saturate at the actuators' limits. Positions that it
    measures and is commanded are the encoders': true ones plus the model's ``joint_offset``; the
    efforts that it measures are read as the plant's parts say. What it measures, and not what it is
    commanded, has the model's ``reading_errors`` but for those of recordings' clocks.

    Attributes:
        plant: The arm.
        mode: What drives the motors.
        dt: Length of a step, s.
        effort: (n,) torque that the actuators applied in the last step, N·m.
        commanded: (n,) the same before saturation, N·m.
        compensation: (n,) part of it that the built-in compensation added; zero while off.
        target: (n,) position set point of the servo, rad; ``None`` in effort
            mode.
    """

    def __init__(
        self,
        plant: Plant,
        sensors: Sensors | None = None,
        seed: int = 0,
        builtin_compensation: bool = True,
        dt: float = 1e-3,
    ) -> None:
        """Switch the arm on.

        Args:
            plant: The arm.
            sensors: Its sensors; ``None``: perfect ones.
            seed: Seed of the sensors' noise.
            builtin_compensation: As on a real console, on unless switched off.
            dt: Length of a step, s.
        """
        self.plant = plant
        self.dt = dt
        arm = plant.model.arm
        self._zero = np.zeros(arm.n)
        self._zero.setflags(write=False)
        self.effort = np.zeros(arm.n)
        self.commanded = np.zeros(arm.n)
        self.compensation = np.zeros(arm.n)
        self._weight = np.zeros(arm.n)  # of where the last step's effort acted
        self._builtin = builtin_compensation
        sensors, self._errors = sensors or Sensors(), plant.model.reading_errors
        late = sensors.effort_delay + self._errors.delay
        self._reader = SensorReader(replace(sensors, effort_delay=max(late, 0.0)), arm, seed, dt)
        self._moved: deque[tuple[Array, Array]] = deque(maxlen=1 + round(max(-late, 0.0) / dt))
        self._reads_wrongly = self._errors.any
        self._offset = plant.model.joint_offset
        self._readings = [part.reading for part in plant.parts if part.reading is not None]
        self._limit, self._least = arm.actuator_effort_limit, -arm.actuator_effort_limit
        self._to_motor = np.ascontiguousarray(arm.actuator_to_joint.T)
        self._from_motor = np.ascontiguousarray(arm.joint_to_actuator.T)
        self._request = np.zeros(arm.n)
        self._push = np.zeros(arm.n)
        self._push_until = -np.inf
        self._velocity = np.zeros(arm.n)
        self._move: Move | None = None
        self._filter: SetPointFilter | None = None
        self.mode = Mode.HOLD
        self.target: Array | None = plant.q + self._offset
        self._placed = plant.placed

    def servo_jf(self, effort: ArrayLike, as_read: bool = False) -> None:
        """Apply joint efforts from now on, for ever.

        Args:
            effort: (n,) N·m by index.
            as_read: They are in what the arm reads and takes instead, which may be A.

        Raises:
            ShapeError: Not one a joint; the arm goes on as before.
            ConfigError: Not finite; the arm goes on as before.
        """
        request = self._finite("effort", effort)
        self._request = self.plant.model.arm.torque_of_reading(request) if as_read else request
        self.mode, self.target, self._move, self._filter = Mode.EFFORT, None, None, None

    def free(self) -> None:
        """Command zero effort: with the compensation on the arm floats, without it falls."""
        self.servo_jf(self._zero)

    def hold(self) -> None:
        """Servo to the present set point, as a console does; out of effort mode to the position.

        An arm that does not follow goes on pressing towards its set point.
        """
        self._servo(Mode.HOLD, self._present())

    def servo_jp(self, position: ArrayLike) -> None:
        """Go to a position, as one of a stream that comes at any rate, and stay there.

        What the servo follows is the stream behind a :class:`SetPointFilter`.

        Args:
            position: (n,) rad; held within the joints' limits.

        Raises:
            ShapeError: Not one a joint.
            ConfigError: Not finite.
        """
        target, stream = self._within(position), self._filter
        if stream is None:
            stream = SetPointFilter(self._present(), self.dt)
        self._servo(Mode.POSITION, target)
        self._filter = stream

    def follow(self, position: ArrayLike, velocity: ArrayLike) -> None:
        """Servo to a set point that changes every step: no console offers this.

        Args:
            position: (n,) rad; held within the joints' limits.
            velocity: (n,) rad/s.

        Raises:
            ShapeError: Not one a joint.
            ConfigError: Not finite.
        """
        target, speed = self._within(position), self._finite("velocity", velocity)
        self._servo(Mode.POSITION, target)
        self._velocity = speed

    def move_jp(self, position: ArrayLike) -> None:
        """Go to a position on a smooth path, and stay there.

        Args:
            position: (n,) rad; held within the joints' limits.

        Raises:
            ShapeError: Not one a joint.
            ConfigError: Not finite.
        """
        goal = self._within(position)
        start = self._present()
        self._servo(Mode.POSITION, start)
        self._move = Move(start, goal, *careful_limits(self.plant.model.arm), self.plant.time)

    def use_gravity_compensation(self, on: bool) -> None:
        """Switch the built-in compensation of effort commands."""
        self._builtin = on

    def push(self, effort: ArrayLike, duration: float) -> None:
        """Push the arm by hand; a push replaces the one before.

        Args:
            effort: (n,) N·m at the joints; no sensor sees it.
            duration: s.

        Raises:
            ShapeError: Not one a joint.
            ConfigError: Not finite.
        """
        self._push = self._finite("effort", effort)
        self._push_until = self.plant.time + duration

    def replace_plant(self, plant: Plant) -> None:
        """Go on as another plant from where the arm is, as when a load is fastened in motion.

        Args:
            plant: One of the same joints; it is put where this arm is.
        """
        before = self.plant
        plant.reset(before.q, before.v)
        plant.time = before.time
        self.plant, self._placed = plant, plant.placed
        self._offset = plant.model.joint_offset
        self._readings = [part.reading for part in plant.parts if part.reading is not None]

    def step(self) -> bool:
        """Go one step on.

        Returns:
            Whether the arm could go: one that is pushed beyond all that can be computed holds where
            it was.
        """
        plant, arm = self.plant, self.plant.model.arm
        before = plant.q
        weight = plant.smooth_torque()
        self._weight = weight
        self.compensation = weight if self._builtin else self._zero
        if self.target is None:
            # An arm that holds its weight itself does so whatever is switched on or off.
            own = self.compensation if arm.gravity_in_command else weight
            self.commanded = self._request + own
        else:
            self.commanded = weight + self._servo_effort(self.target)
        motor = self._to_motor.dot(self.commanded)
        np.minimum(motor, self._limit, out=motor)
        np.maximum(motor, self._least, out=motor)
        self.effort = self._from_motor.dot(motor)
        push = self._push if plant.time < self._push_until else None
        plant.step(self.effort, push, self.dt)
        if np.count_nonzero(np.isfinite(plant.v)) == len(before):
            return True
        plant.reset(before)
        self._push_until = plant.time
        self._servo(Mode.HOLD, plant.q + self._offset)
        return False

    def measure(self) -> Measurement:
        """Read the sensors; once a step, since noise and delay go on with every reading.

        The reading is of where the last step's effort acted: later, the arm's weight would seem to
        be delayed, which looks like viscosity.
        """
        plant = self.plant
        position, velocity = plant.acted
        effort = self.effort
        if not plant.model.arm.gravity_in_reading:
            effort = effort - self._weight
        for reading in self._readings:
            effort = effort + reading(position, velocity)
        position = position + self._offset
        position, velocity, effort = self._reader.read(position, velocity, effort)
        if self._reads_wrongly:
            errors = self._errors
            position = errors.position.dot(position)
            velocity = errors.velocity * errors.position.dot(velocity)
            effort = np.clip(errors.effort.dot(effort), -errors.limit, errors.limit)
            self._moved.append((position, velocity))
            position, velocity = self._moved[0]
        return Measurement(plant.time, position, velocity, effort)

    def _servo_effort(self, target: Array) -> Array:
        """Return M (w^2 (target - q) + 2 w (velocity - v)), equally stiff in every pose."""
        plant = self.plant
        if self._move is not None:
            target, self._velocity = self._move.at(plant.time)
            self.target = target
        elif self._filter is not None:
            target, self._velocity = self._filter.step(target)
        error = target - self._offset
        error -= plant.q
        error *= _SERVO_FREQUENCY**2
        error += (2 * _SERVO_FREQUENCY) * (self._velocity - plant.v)
        return plant.mass_matrix().dot(error)

    def _present(self) -> Array:
        """Return the (n,) measured position that the servo is at, or the arm without one."""
        plant = self.plant
        if self.target is None or self._placed != plant.placed:
            return plant.q + self._offset
        return self.target if self._filter is None else self._filter.position

    def _servo(self, mode: Mode, target: Array) -> None:
        self.mode, self.target, self._move, self._filter = mode, target, None, None
        self._velocity, self._placed = np.zeros(len(target)), self.plant.placed

    def _within(self, position: ArrayLike) -> Array:
        arm = self.plant.model.arm
        return np.minimum(np.maximum(self._finite("position", position), arm.lower), arm.upper)

    def _finite(self, name: str, values: ArrayLike) -> Array:
        """Return (n,) numbers that are finite."""
        array = np.array(values, dtype=float)
        if array.shape != self._zero.shape:
            raise ShapeError(name, array.shape, f"({len(self._zero)},)")
        if np.count_nonzero(np.isfinite(array)) < len(array):
            raise ConfigError(name, array.tolist(), "finite numbers")
        return array
